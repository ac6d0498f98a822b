"""What the page shows, in its order: which studies, with how many runs, and what the paper says there."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Chapter:
    """One study. runs: of each case, so that the whole page takes about ten minutes on two cores."""

    study: str
    runs: int
    heading: str
    text: str


_SIMULATIONS = (
    Chapter(
        "fig4",
        2000,
        "Figure 4: error of the TCP by eight touches",
        "The paper calibrates with the universal method from simulated touches (sigma 0.233 mm, cut at 0.7 mm) and "
        "draws how often the TCP errs by how much: mostly 0.1 to 0.2 mm, at most a little above 0.4 mm.",
    ),
    Chapter(
        "fig5",
        300,
        "Figure 5: more touches",
        "With twice the touches the mean error is nearly halved, says the paper.",
    ),
)
_EXPERIMENTS = (
    Chapter(
        "experiment-a",
        100,
        "Table 2: eight TCPs by each method (figures 6 and 7)",
        "A tray with holes at 62.5 mm. The paper's error is the distance to the TCP in CAD.",
    ),
    Chapter(
        "fig10",
        60,
        "Figure 10: circles around placements and answers",
        "Smallest circles around eight placements of one hole, and around the answers of five calibrations.",
    ),
    Chapter(
        "table3-means",
        25,
        "Table 3 in the paper's metric",
        "The paper's error is the distance of an answer to the mean of five; beside it the distance to the truth, "
        "which only a simulation knows.",
    ),
    Chapter(
        "table3",
        20,
        "Table 3 against the truth, and by other ways to solve",
        "The same experiment with the same touches, by the paper's methods and by the joint estimate that is served; "
        "the camera at rest, fixed and movable; the arm with six and with four axes.",
    ),
    Chapter(
        "table4",
        1,
        "Table 4: the operator's minutes",
        "From the samples that a session really has.",
    ),
    Chapter(
        "insertions",
        40,
        "Section VI-B: does the bottle go in?",
        "A bottle of 11.6 mm in a hole of 12 mm: clean within 0.2 mm, in within 0.4 mm.",
    ),
)
_CONTACTS = (
    Chapter(
        "contact-methods",
        40,
        "Figure 3: fixed point, plane and ball",
        "The three contacts on equal touches. The paper draws them and does not compare them.",
    ),
)
_SLIPS = (
    Chapter(
        "eq19",
        20,
        "A sign in Eq. 16, and a term that Eq. 19 lacks",
        "With the printed sign the answer is off by twice the tool. Without the displacement of the flange between "
        "both pictures, it is off by as much as the flange moved.",
    ),
    Chapter(
        "eq25",
        20,
        "The rank of Eq. 22 to 25",
        "A turntable turns about one axis, so the printed matrix has no inverse: along the axis the centre is not "
        "determined. Noise alone makes it invertible. Solved across the axis, the answers are right.",
    ),
    Chapter(
        "eq9",
        50,
        "Eq. 9 to 15 from the identity",
        "Plain Gauss-Newton ends in another minimum now and then. The default here starts everywhere and proves its "
        "minimum.",
    ),
)
_BEYOND = (
    Chapter(
        "tilt",
        100,
        "What an operator can reach",
        "Figures 4 and 5 turn the wrist by any angle. With 30 degrees of tilt the same touches tell less.",
    ),
    Chapter(
        "coached",
        20,
        "Touches that the coach plans",
        "Six planned touches against six random ones, within 30 degrees of tilt.",
    ),
    Chapter(
        "jog-and-touch",
        20,
        "Jog and touch, nothing else",
        "Rests of the arm become looks and spins by themselves, in 5.6 of the paper's minutes.",
    ),
    Chapter(
        "bare-targets",
        40,
        "Section III-C: parts without CAD",
        "A target without CAD is three unknowns that its touches tell.",
    ),
)
CHAPTERS: tuple[tuple[str, tuple[Chapter, ...]], ...] = (
    ("Simulations of section VI-A", _SIMULATIONS),
    ("Experiments of sections VI-B and VI-C", _EXPERIMENTS),
    ("The contacts of section III", _CONTACTS),
    ("Slips of the paper, with proof", _SLIPS),
    ("Beyond the paper", _BEYOND),
)
