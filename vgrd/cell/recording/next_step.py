"""The one next step of a teaching, for whoever shows it: page, terminal, script. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from vgrd.calibration.confirmation import LEAST_ANGLES
from vgrd.judging.findings import MISSING

BESIDE: Final = "beside"  # name of the one point, plane or ball that a session has there
SPINS: Final = 4  # as `first_samples.WANTED`: fewer tell the axis badly


@dataclass(frozen=True, slots=True)
class Step:
    """kind: start, spin, look, point, touch, mend, wait, verify, solve, activate or done.

    words: a whole sentence. target: of a touch; of a point its name. tilted: the wrist shall stand otherwise than it
    works. next: as `advice` tells it, with pose and errors, or empty. sample: number of the one to mend, None where it
    is none or one of several, which the words name.
    done, of: how many of this kind there are, and are wanted; 0 where nobody counts.
    """

    kind: str
    words: str
    target: str | None = None
    next: Mapping[str, Any] = field(default_factory=dict)
    done: int = 0
    of: int = 0
    tilted: bool = False
    sample: int | None = None

    def to_json(self) -> dict[str, Any]:
        """For a reply; poses are the flange in the robot's base."""
        return {
            "kind": self.kind,
            "words": self.words,
            "target": self.target,
            "tilted": self.tilted,
            "sample": self.sample,
            "done": self.done,
            "of": self.of,
            "flange_mm": self.next.get("flange_mm"),
            "rotvec_deg": self.next.get("rotvec_deg"),
            "no_pose": self.next.get("no_pose", ""),
            "u95_before_mm": self.next.get("u95_before_mm"),
            "u95_after_mm": self.next.get("u95_after_mm"),
        }


@dataclass(frozen=True, slots=True)
class Taken:
    """An open session: what it has by kind, lacks by kind, its touches by target, and what is odd about it.

    targets: names in the order of the cell file. advice: as `advise_session` gives it, or that it is pending.
    verified: how many verifications count.
    """

    have: Mapping[str, int]
    missing: Mapping[str, int]
    touched: Mapping[str, int]
    targets: Sequence[str]
    harvests: bool
    advice: Mapping[str, Any]
    questions: Mapping[int, str]
    verified: int
    tolerance_mm: float


def step_in_session(taken: Taken) -> Step:
    """What comes next while a session is open."""
    for number, question in taken.questions.items():
        return Step("mend", f"sample {number}: {question}", sample=number)
    if wrong := _mistake(taken.advice):
        samples = wrong.get("samples", ())
        return Step(
            "mend", str(wrong["message"]), sample=samples[0] if len(samples) == 1 else None
        )
    first = _first_of_plan(taken)
    if first is not None:
        return first
    if "pending" in taken.advice:  # what is known of fewer samples is no reason to ask for another
        return Step("wait", "the computer works out what the samples are worth")
    predicted = taken.advice.get("predicted_u95_mm") or {}
    best = taken.advice.get("next") or {}
    is_good = all(u95_mm <= taken.tolerance_mm for u95_mm in predicted.values())
    if not (predicted and is_good):  # what is no number is not good
        return _further(taken, best)
    if taken.verified < LEAST_ANGLES:
        worst = max(predicted, key=lambda name: predicted[name])
        return Step(
            "verify",
            f"turn the object by 60 degrees or more from where it was touched and verified, touch {worst} "
            f"as it works: verification {taken.verified + 1} of {LEAST_ANGLES}",
            worst,
            done=taken.verified,
            of=LEAST_ANGLES,
        )
    return Step("solve", "all is there: end the session and solve it")


def step_without_session(
    last: str, candidate: Mapping[str, Any] | None, active: str | None, refused: str = ""
) -> Step:
    """What comes next while none is open. last: name of the last one, "" for none; candidate: made of it.

    active: id of what was put in use; refused: why it does not serve, "" where it does.
    """
    if candidate is not None and not candidate["active"]:
        if candidate["verdict"] == "good":
            return Step("activate", f"{candidate['id']} is accepted: put it in use")
        return Step(
            "start", f"{candidate['id']} is {candidate['verdict']}: teach again, a new session"
        )
    if last and candidate is None:
        return Step("solve", f"solve session {last}")
    if active is not None and refused:
        words = (
            f"{active} was put in use and does not serve: {refused}. Mend that, or start a session"
        )
        return Step("start", words)
    if active is not None:
        words = (
            f"{active} is in use. To verify it: turn the object by 60 degrees, drive to where the flange must be, "
            "jog the rest until the tip meets the target, VERIFY. A new session teaches again"
        )
        return Step("done", words)
    return Step("start", "nothing is taught yet: start a session")


def _mistake(advice: Mapping[str, Any]) -> Mapping[str, Any]:
    """The finding that has to be mended before any other sample, or empty."""
    for finding in advice.get("findings", ()):
        if finding["fatal"] and finding["code"] not in MISSING:
            return dict(finding)
    return {}


def _first_of_plan(taken: Taken) -> Step | None:
    """What the plan asks for before anything else; None where an estimate may choose."""
    if not taken.harvests:  # looks and spins do not come by themselves: in the order of the plan
        return _further(taken, taken.advice.get("next") or {}) if taken.missing else None
    spins = taken.have.get("spin", 0)
    if "spin" in taken.missing:
        words = (
            "turn the object by about 90 degrees from where it stood, arm aside, tag B in view"
            if spins
            else "arm aside, tag B in view"
        )
        return Step("spin", words, done=spins, of=spins + taken.missing["spin"])
    untouched = [name for name in taken.targets if not taken.touched.get(name)]
    return _first_touch(taken.targets, untouched) if untouched else None


def _first_touch(targets: Sequence[str], untouched: Sequence[str]) -> Step:
    """Each target once, the second half with the wrist tilted: that saves the looks, as it tells hand-eye."""
    done, of = len(targets) - len(untouched), len(targets)
    is_tilted = 2 * done >= of > 1
    how = (
        "the wrist tilted by 20 to 30 degrees, each time to another side (an arm of four axes: turned)"
        if is_tilted
        else "the wrist as it works"
    )
    words = f"put the tip on {untouched[0]}, {how}"
    return Step("touch", words, untouched[0], done=done, of=of, tilted=is_tilted)


def _further(taken: Taken, best: Mapping[str, Any]) -> Step:
    """A sample that the plan or the estimate names, or that it is still being computed."""
    if not best:
        return Step("wait", str(taken.advice.get("pending") or taken.advice.get("trouble") or ""))
    kind = str(best.get("kind", "touch"))
    have, missing = taken.have.get(kind, 0), taken.missing.get(kind, 0)
    of = have + missing if missing else 0
    return Step(
        kind, str(best["words"]), best.get("target") or _named(kind, taken), best, have, of
    )


def _named(kind: str, taken: Taken) -> str | None:
    """Target of a sample that the plan asks for by its kind alone; a touch beside the object is of none."""
    if kind == "touch":
        return min(taken.targets, key=lambda name: taken.touched.get(name, 0))
    return BESIDE if kind == "point" else None
