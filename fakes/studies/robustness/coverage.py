"""Coverage: how often the truth lies in the 95 % regions that a calibration states.

Two estimates of the same session: `system` is what the daemon serves (independent errors of the arm, added to
every sample), `joint` models what the arm does: a new draw at every stand and a smooth error field. The camera
stands exactly where it was taught; or it gives as much as a fixed one may, or it is moved, both tags in view: then
what the daemon serves is asked, by the joint estimate and by the special plan, and its 95 % radius counts as well.
Here the file is right; where it is wrong: study `misfits`.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence
from scipy.special import chdtri

from fakes.studies.cameras import STABILITIES, move, place_in
from fakes.studies.sessions import Session, known_arm
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.arm_errors import EXACT_ARM, ArmErrors
from fakes.world.noise import COARSE
from fakes.world.simulation import BORED_CENTER_MM, WORK_ROTATION, SimulatedRequest, Simulation
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.joint import calibrate_joint, expected_by_joint
from vgrd.calibration.solve import calibrate_system
from vgrd.charts import COLORS, PAPER, legend, panels
from vgrd.errors import CalibrationError, Contradiction
from vgrd.geometry import Array
from vgrd.model import ExpectedCoordinate, Plan, Policy, Recording, TagObservation

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_SESSION = Session(  # the paper's, with four touches more, tilted: they tell the TCP
    Plan.JOINT, looks=8, spins=10, touches=10, tilted=4
)
_SPECIAL = Session(Plan.SPECIAL, looks=8, spins=10)  # the paper's
_LEVEL = 0.95  # of the regions that are stated
_ARMS = {  # as UR states for the UR5e; the field is a guess
    "exact": EXACT_ARM,
    "field": ArmErrors(sigma_mm=0.03, field_mm=0.15),
}
_REGIONS = {"tcp": "TCP", "xy": "EC in xy", "z": "EC in z"}
_MOVED_REGIONS = {"u95": "radius u95", "xy": "EC in xy", "z": "EC in z"}
_CAMERAS = [name for name, stability in STABILITIES.items() if stability.any()]
_CASES = [  # new ones last: the trials of the others stay what they were
    *[(arm, "exact") for arm in _ARMS],
    *[(arm, camera) for camera in _CAMERAS for arm in _ARMS],
]
_BAR = (93.0, 97.0)  # %, 95 +- 2: more than chance leaves at 4000 runs, less than matters
_SERVED_BAR = (
    93.0,
    98.0,
)  # the daemon knows one number of an arm, not its field: a point more above
_SPECIAL_BAR = (
    93.0,
    100.0,
)  # the special plan takes errors that its samples share for independent


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Squared error over the 95 % quantile, by estimate and region: at most 1 is inside."""
    arm = _ARMS[parameters["arm"]]
    cell = Simulation(seed, vision=COARSE, arm=arm, center_sigma_mm=BORED_CENTER_MM)
    if parameters["camera"] != "exact":
        return _of_served(cell, STABILITIES[parameters["camera"]])
    recording = _SESSION.record(cell)
    request = cell.request()
    return _of_system(cell, recording, request) | _of_joint(cell, recording, request, arm)


def _of_system(
    cell: Simulation, recording: Recording, request: SimulatedRequest
) -> dict[str, float]:
    calibration = calibrate_system(recording)
    if calibration.tcp is None:
        raise CalibrationError("the tilted touches left the TCP undetermined")
    expected = expected_coordinate(
        calibration, request.target, _tag_b(request), Policy.FIXED, WORK_ROTATION
    )
    tcp = _ratio(calibration.tcp.in_wrist - cell.tcp_in_wrist, calibration.tcp.covariance)
    return {"system, tcp": tcp, **_of_answer("system", cell, request, expected)}


def _of_served(cell: Simulation, stability: Array) -> dict[str, float]:
    """What the daemon serves from a camera that moved after teaching, by both plans."""
    calibrations = {
        "system": calibrate_system(_SESSION.record(cell)),
        "special": calibrate_system(_SPECIAL.record(cell)),
    }
    move(cell, stability)
    request = cell.request()
    place = place_in(request.seen, stability)
    out: dict[str, float] = {}
    for estimate, calibration in calibrations.items():
        try:
            expected = expected_coordinate(
                calibration, request.target, _tag_b(request), Policy.FIXED, WORK_ROTATION, place
            )
        except Contradiction as err:
            raise CalibrationError(str(err)) from err
        length = float(np.linalg.norm(cell.miss(request, expected.base_from_wrist)))
        out |= _of_answer(estimate, cell, request, expected)
        out[f"{estimate}, u95"] = (length / expected.u95_mm) ** 2
    return out


def _of_joint(
    cell: Simulation, recording: Recording, request: SimulatedRequest, arm: ArmErrors
) -> dict[str, float]:
    result = calibrate_joint(recording, arm=known_arm(arm))
    expected = expected_by_joint(result, request.target, request.seen, Policy.FIXED, WORK_ROTATION)
    part = result.layout.TCP
    error = result.state.tcp_in_wrist - cell.tcp_in_wrist
    tcp = _ratio(error, result.covariance[part, part])
    return {"joint, tcp": tcp, **_of_answer("joint", cell, request, expected)}


def _of_answer(
    estimate: str, cell: Simulation, request: SimulatedRequest, expected: ExpectedCoordinate
) -> dict[str, float]:
    miss = cell.miss(request, expected.base_from_wrist)
    C = expected.position_covariance
    return {
        f"{estimate}, xy": _ratio(miss[:2], C[:2, :2]),
        f"{estimate}, z": _ratio(miss[2:], C[2:, 2:]),
    }


def _tag_b(request: SimulatedRequest) -> TagObservation:
    tag = request.seen.tag_b
    if tag is None:
        raise CalibrationError("tag B is not in the picture")
    return tag


def _ratio(error: Array, covariance: Array) -> float:
    square = float(error @ np.linalg.solve(covariance, error))
    return square / float(chdtri(len(error), 1 - _LEVEL))


def _figures(trials: Trials) -> list[Figure]:
    figures = [
        _figure(trials, estimate, region, words, arm)
        for estimate in ("joint", "system")
        for arm in _ARMS
        for region, words in _REGIONS.items()
    ]
    return figures + [
        _figure(trials, estimate, region, words, arm, camera)
        for camera in _CAMERAS
        for estimate in ("system", "special")
        for arm in _ARMS
        for region, words in _MOVED_REGIONS.items()
    ]


def _figure(
    trials: Trials, estimate: str, region: str, words: str, arm: str, camera: str = "exact"
) -> Figure:
    inside = trials.values(f"{estimate}, {region}", arm=arm, camera=camera) <= 1
    where = f"arm {arm}" if camera == "exact" else f"arm {arm}, camera {camera}"
    return Figure(
        f"{estimate}, {where}: {words}",
        100 * float(np.mean(inside)) if inside.size else float("nan"),
        "%",
        *_bar(estimate, arm),
    )


def _bar(estimate: str, arm: str) -> tuple[float, float]:
    if estimate == "joint" or arm == "exact":
        return _BAR
    return _SPECIAL_BAR if estimate == "special" else _SERVED_BAR


def _draw(trials: Trials) -> "Drawing":
    runs = len(trials.select(arm="exact", camera="exact"))
    drawing, all_axes = panels(
        f"How often the truth lies in the stated region, {runs} calibrations each",
        *[("stated, %", "observed, %")] * len(_REGIONS),
    )
    stated = np.linspace(0.02, 0.995, 120)
    for axes, (region, words) in zip(all_axes, _REGIONS.items(), strict=True):
        degrees_of_freedom = {"tcp": 3, "xy": 2, "z": 1}[region]
        limits = chdtri(degrees_of_freedom, 1 - stated) / chdtri(degrees_of_freedom, 1 - _LEVEL)
        axes.plot((0, 100), (0, 100), color=PAPER, linewidth=1, label="as stated")
        for color, (estimate, arm) in zip(
            COLORS, [(e, a) for e in ("joint", "system") for a in _ARMS], strict=False
        ):
            values = trials.values(f"{estimate}, {region}", arm=arm, camera="exact")
            observed = [100 * np.mean(values <= limit) for limit in limits]
            axes.plot(100 * stated, observed, color=color, label=f"{estimate}, arm {arm}")
        axes.axvline(100 * _LEVEL, color=PAPER, ls=(0, (5, 3)), linewidth=1)
        axes.set(title=words, xlim=(0, 100), ylim=(0, 100), aspect="equal")
    legend(all_axes[0])
    return drawing


STUDY = Study(
    name="coverage",
    title="Coverage of the stated 95 % regions",
    cases=tuple({"arm": arm, "camera": camera} for arm, camera in _CASES),
    runs=1000,
    full_runs=4000,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
