"""Is a calibration of a session good? In words, what limits it, what to add; poses with their sigmas."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from vgrd.calibration.calibration import Calibration
from vgrd.calibration.joint import JointFit, JointSolution, StepLayout
from vgrd.calibration.levels import Level
from vgrd.calibration.planning import Budget, Source
from vgrd.calibration.stated_error import EVERY_PICTURE, u95_in_words
from vgrd.geometry import Array, Pose
from vgrd.model import Policy, Recording

_MATTERS = 1.1  # times the error with an exact centre, from which on it is worth a sentence
_TO_ADD: Mapping[Source, str] = MappingProxyType(
    {
        Source.TOUCHES: "touch again, with more care or with the wrist tilted",
        Source.TCP: "touch the fixed point again, with the wrist tilted about two axes",
        Source.HAND_EYE: "look from more places, tilted by 20 degrees and more",
        Source.TAG_B: "spin more often; a larger or sharper tag B",
        Source.TURNTABLE: "let the camera see holes, touch with the object turned, or tilt the wrist while touching",
        Source.CAD: "measure the part, or touch the targets that matter twice",
        Source.HOLES: "look at the holes in more spins",
        Source.FIELD: "touch near where the arm will work, or have the arm calibrated",
        Source.REPEATABILITY: "nothing: the arm repeats no better",
        Source.QUANTISATION: "let the robot tell its pose with more digits",
        Source.PRINT: "measure the tags' edges",
    }
)


def goodness(
    calibration: Calibration,
    fit: JointFit | None,
    recording: Recording,
    tolerance_mm: float | None,
    policy: Policy,
    budget: Budget | None,
) -> dict[str, object]:
    """The first line of `vgrd solve`, and what limits the calibration; JSON-able.

    fit: that it was taken from, None in the paper's plans. budget: as `budget_of`.
    """
    includes = {}
    if fit is not None:
        holes = len(fit.data.holes.cad)
        includes = {"u95_includes": u95_in_words(EVERY_PICTURE, policy, holes)}
    said = _sentence(calibration, recording, tolerance_mm)
    if budget is None:
        return {"good": said, **includes, "limits": "", "add": ""}
    shares = budget.means
    worst = max(shares, key=lambda source: shares[source])
    limits = f"{worst}, {100 * shares[worst]:.0f} % of the variance"
    return {
        "good": said,
        **includes,
        "limits": f"{limits}{_center_in_words(calibration)}",
        "add": _TO_ADD.get(Source(worst), ""),
    }


def _sentence(calibration: Calibration, recording: Recording, tolerance_mm: float | None) -> str:
    residuals = calibration.residuals
    counts = (
        (len(recording.touches), "touches"),
        (len(recording.spins), "spins"),
        (len(recording.looks), "looks"),
    )
    samples = ", ".join(f"{count} {what}" for count, what in counts if count)
    if "predicted_u95_mm" not in residuals:
        return f"no error is predicted for plan {recording.plan.value}; from {samples}"
    said = (
        f"at 95 % a target is met within {residuals['predicted_u95_mm']:.2g} mm and "
        f"{residuals['predicted_u95_deg']:.2g} deg, from {samples}"
    )
    if residuals.get("touch_left_out_mm", np.nan) > 0:
        said += f"; each touch was predicted by the others to {residuals['touch_left_out_mm']:.2g} mm (rms)"
    return said if tolerance_mm is not None else f"{said}; no tolerance given"


def _center_in_words(calibration: Calibration) -> str:
    """What it costs that the centre is not known exactly, and what measures it."""
    told_mm = calibration.residuals.get("predicted_u95_mm", 0.0)
    exact_mm = calibration.residuals.get("predicted_u95_exact_center_mm", told_mm)
    if told_mm < _MATTERS * exact_mm:
        return ""
    return (
        f"; an exact centre would leave {exact_mm:.2g} mm, it is stated to "
        f"{calibration.facts.object.center_sigma_mm:g} mm: turn the object half round and touch three targets "
        "again; holes and tilted touches measure it too"
    )


def transforms_of(calibration: Calibration) -> dict[str, object]:
    """Poses of a joint calibration: matrix, sigmas (mm, deg) and covariance of the left tangent; JSON-able."""
    solution = calibration.solution
    if not isinstance(solution, JointSolution):
        return {}
    poses: Mapping[str, tuple[Pose, slice]] = {
        "base_from_camera": (solution.base_from_camera, StepLayout.CAMERA),
        "wrist_from_tag_a": (solution.wrist_from_tag_a, StepLayout.TAG_A),
        "base_from_object": (solution.base_from_object, StepLayout.OBJECT),
        "camera_from_tag_b": (solution.camera_from_tag_b, StepLayout.TAG_B),
    }
    unknown = solution.undetermined @ solution.undetermined.T
    whole = solution.covariance + unknown
    return {name: _pose(pose, whole[part, part]) for name, (pose, part) in poses.items()}


def _pose(pose: Pose, covariance: Array) -> dict[str, object]:
    """Sigmas are those of the place itself and of the turn about it, in the frame the pose is told in."""
    at_place = Pose(np.eye(3), -pose.translation).adjoint()
    sigmas = np.sqrt(np.diag(at_place @ covariance @ at_place.T))
    return {
        "matrix": pose.matrix().tolist(),
        "sigma_mm": sigmas[:3].tolist(),
        "sigma_deg": np.degrees(sigmas[3:]).tolist(),
        "covariance": covariance.tolist(),
    }


def levels_in_words(calibration: Calibration) -> dict[str, str]:
    """The same for people, by kind."""
    return {
        level.name: f"stated {level.stated:.2g}, found {level.found:.2g} {level.unit}"
        for level in _levels(calibration)
    }


def levels_of(calibration: Calibration) -> list[dict[str, object]]:
    """Noise as stated and as found, by kind; JSON-able, none where it was taken as stated."""
    return [
        {
            "noise": level.name,
            "unit": level.unit,
            "stated": level.stated,
            "found": level.found,
            "within": float(np.exp(level.log_sigma)),
        }
        for level in _levels(calibration)
    ]


def _levels(calibration: Calibration) -> tuple[Level, ...]:
    solution = calibration.solution
    return solution.levels if isinstance(solution, JointSolution) else ()
