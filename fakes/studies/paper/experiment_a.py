"""Experiment A (table 2): TCP by the conventional fixed point and by the universal method.

The paper tells that each method was performed eight times, that the holes are 62.5 mm apart, and that
without a special tool the fixed hole leaves less room to tilt than several holes do; it does not tell the tilts.
Here a calibration has six touches, wrists turn by up to 10 degrees in one hole and by up to 15 over several, and
turn about the tool by up to 90 degrees in both. A second case gives both methods the same tilt. The eight TCPs of the
first experiment are listed as in table 2, with their errors against CAD, which is the truth here.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator, SeedSequence, default_rng
from scipy.spatial.transform import Rotation

from fakes.studies.paper.paper_data import NOISE_MM, truncated_noise
from fakes.studies.sampling import beside_the_paper
from fakes.studies.study import REFUSED, Figure, Parameters, Study, Trials
from vgrd.calibration.tcp import calibrate_fixed_point
from vgrd.calibration.touches import TouchSet
from vgrd.calibration.universal import UniversalProblem, calibrate_universal
from vgrd.charts import COLORS, PAPER, legend, panels, published
from vgrd.geometry import Array, Pose, exp_rotation

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_REPEATS = 8  # as the paper performed each method
_TOUCHES = 6  # 6 to 8 are the paper's best choice (figure 5)
_PITCH_MM = 62.5  # between the paper's holes
_TURN_DEG = 90.0  # a guess: either way about the tool; the paper does not tell it
_TCP = np.array([3.0, -2.0, 180.0])  # a tool of 180 mm, a little off the axis: any will do
_DOWN = np.diag([1.0, -1.0, -1.0])
_AXIS = np.array([0.0, 0.0, 1.0])
_BASE_FROM_TRAY = Pose(exp_rotation((0.02, -0.03, 0.6)), np.array([420.0, -60.0, 40.0]))  # any
_COLUMNS = ("x", "y", "z", "error")  # of table 2
_PAPER = {"conventional": 2.308, "universal": 1.868}  # its table 2, mm


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Mean TCP error, mm, of eight calibrations by each method, and the TCPs."""
    rng = default_rng(seed)
    tcps: dict[str, list[Array]] = {name: [] for name in _PAPER}
    for _ in range(_REPEATS):
        tcps["conventional"].append(_fixed_point(rng, parameters["one_hole_deg"]))
        tcps["universal"].append(_universal(rng, parameters["many_holes_deg"]))
    row: dict[str, float] = {}
    for name, found in tcps.items():
        errors = np.linalg.norm(np.array(found) - _TCP, axis=1)
        row[f"{name}_mm"] = float(errors.mean())
        for k, (tcp, error) in enumerate(zip(found, errors, strict=True)):
            for column, number in zip(_COLUMNS, (*tcp, error), strict=True):
                row[f"{name} {k + 1}: {column}"] = float(number)
    return row


def _fixed_point(rng: Generator, tilt_deg: float) -> Array:
    """TCP (3,) by the conventional method."""
    point = _BASE_FROM_TRAY.translation
    touches = _touch(rng, tilt_deg, np.tile(point, (_TOUCHES, 1)))
    return calibrate_fixed_point(touches).tcp_in_wrist


def _universal(rng: Generator, tilt_deg: float) -> Array:
    """TCP (3,) by the paper's method."""
    holes = np.array([(i % 3, i // 3, 0.0) for i in range(_TOUCHES)]) * _PITCH_MM
    touches = _touch(rng, tilt_deg, _BASE_FROM_TRAY @ holes)
    return calibrate_universal(UniversalProblem(holes, touches)).tcp_in_wrist


def _touch(rng: Generator, tilt_deg: float, points: Array) -> TouchSet:
    angles = rng.uniform(-1, 1, points.shape) * (tilt_deg, tilt_deg, _TURN_DEG)
    R = _DOWN @ Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    sigma = np.full(len(points), NOISE_MM)
    t = points + truncated_noise(rng, points.shape) - R @ _TCP
    return TouchSet(R, t, _AXIS, sigma, sigma)


def _figures(trials: Trials) -> list[Figure]:
    room = {"tilts": "the hole limits"}
    means = {name: trials.mean(f"{name}_mm", **room) for name in _PAPER}
    each = {name: trials.values(f"{name}_mm", **room) for name in _PAPER}
    wins = each["universal"] < each["conventional"]
    ratio = Figure(
        "universal / conventional",
        means["universal"] / means["conventional"],
        "",
        None,
        0.9,
        "0.81",
    )
    ratios = each["universal"] / each["conventional"]
    same_tilt = [trials.mean(f"{name}_mm", tilts="the same") for name in _PAPER]
    return [
        *(
            beside_the_paper(Figure(f"mean error, {k}", means[k], "mm", paper=f"{v}"), each[k], v)
            for k, v in _PAPER.items()
        ),
        beside_the_paper(ratio, ratios, _PAPER["universal"] / _PAPER["conventional"]),
        Figure("experiments won by the universal method", float(wins.mean()), "", at_least=0.75),
        Figure("universal / conventional, same tilts", same_tilt[1] / same_tilt[0]),
        *_listed(trials),
    ]


def _listed(trials: Trials) -> list[Figure]:
    """Table 2: the TCPs of the first experiment, x, y, z and error, mm, and those of CAD."""
    rows = [row for row in trials.select(tilts="the hole limits") if not row[REFUSED]]
    keys = [f"{name} {k + 1}: {c}" for name in _PAPER for k in range(_REPEATS) for c in _COLUMNS]
    cad = [Figure(f"CAD: {c}", float(v), "mm") for c, v in zip("xyz", _TCP, strict=True)]
    return [*cad, *(Figure(key, row[key], "mm") for row in rows[:1] for key in keys)]


def _draw(trials: Trials) -> "Drawing":
    labels = [("", "TCP error, mean of 8 calibrations, mm"), ("", "")]
    runs = len(trials.select(tilts="the same"))
    drawing, all_axes = panels(f"TCP by two methods, {runs} experiments each (table 2)", *labels)
    for axes, tilts in zip(all_axes, trials.distinct("tilts"), strict=True):
        values = [trials.values(f"{name}_mm", tilts=tilts) for name in _PAPER]
        boxes = axes.boxplot(
            values, tick_labels=list(_PAPER), widths=0.5, patch_artist=True, showfliers=False
        )
        for middle in boxes["medians"]:
            middle.set(color=PAPER)
        for color, box in zip(COLORS, boxes["boxes"], strict=False):
            box.set(facecolor=color, alpha=0.55)
        case = trials.select(tilts=tilts)[0]
        axes.set_title(
            f"tilts up to {case['one_hole_deg']:g} and {case['many_holes_deg']:g} degrees",
            fontsize=10,
        )
        for color, (name, value) in zip(COLORS, _PAPER.items(), strict=False):
            published(axes, value, f"paper, {name}: {value} mm", color=color)
        axes.set_ylim(bottom=0)
    legend(all_axes[0], "center right")
    return drawing


STUDY = Study(
    name="experiment-a",
    title="Experiment A: TCP by the conventional fixed point and by the universal method",
    cases=(
        {"tilts": "the hole limits", "one_hole_deg": 10.0, "many_holes_deg": 15.0},
        {"tilts": "the same", "one_hole_deg": 15.0, "many_holes_deg": 15.0},
    ),
    runs=300,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
