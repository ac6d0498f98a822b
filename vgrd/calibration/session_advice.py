"""What to tell an operator about a session while it is being recorded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from vgrd.calibration.checks import examine
from vgrd.calibration.coaching import Advice, next_best
from vgrd.calibration.foresight import Foresight, Job, Undetermined
from vgrd.calibration.joint import JointResult, calibrate_joint
from vgrd.calibration.reach import Reach, camera_sees_tag_a, usual_wrist
from vgrd.calibration.spins import without_useless_spins
from vgrd.errors import DidNotConverge, VgrdError
from vgrd.geometry import Array
from vgrd.model import Finding, Policy, Recording

_ANGLES_RAD = (0.0, 2.0)
_TOO_LITTLE = (
    "the samples so far allow no estimate: look with tag A in view and the wrist turned about two axes, "
    "touch more targets, some with the wrist tilted, and spin the object at least three times"
)


@dataclass(frozen=True, slots=True, eq=False)
class SessionAdvice:
    """What the samples so far are worth, and which one to take next.

    predicted_mm: 95 % error of the expected coordinate by target under the policy, empty as long as
    it cannot be told; trouble: why not, with the remedy, else "". best: the most useful sample
    within reach, None where nothing can be predicted. undetermined: what the samples leave open.
    """

    policy: Policy
    findings: tuple[Finding, ...] = ()
    predicted_mm: Mapping[str, float] = field(default_factory=dict)
    trouble: str = ""
    best: Advice | None = None
    undetermined: tuple[Undetermined, ...] = ()

    def to_json(self) -> dict[str, object]:
        """Everything in words and numbers: poses as flange x, y, z in mm and a rotation vector."""
        return {
            "policy": self.policy.value,
            "findings": [
                {"code": one.code, "message": one.message, "fatal": one.fatal}
                for one in self.findings
            ],
            "predicted_u95_mm": dict(self.predicted_mm),
            "trouble": self.trouble,
            "unknown_but_irrelevant": [u.what for u in self.undetermined if not u.matters],
            "next": None if self.best is None else _next(self.best),
        }


def advise_session(
    recording: Recording,
    policy: Policy = Policy.FIXED,
    reach: Reach | None = None,
    works: Sequence[Array] = (),
) -> SessionAdvice:
    """Judge what was recorded so far; a half-recorded session is told about, never an error.

    reach: None takes `Reach.of(recording)`. works: orientations (3, 3) for policy requested; none
    take orientations all over the reach.
    """
    try:
        usable, doubts = without_useless_spins(recording)
        reach = reach or Reach.of(recording)
        return _advice(calibrate_joint(usable), policy, reach, works, doubts)
    except (DidNotConverge, np.linalg.LinAlgError):
        return SessionAdvice(policy, trouble=_TOO_LITTLE)
    except VgrdError as err:
        return SessionAdvice(policy, trouble=str(err))


def _advice(
    result: JointResult,
    policy: Policy,
    reach: Reach,
    works: Sequence[Array],
    doubts: tuple[Finding, ...],
) -> SessionAdvice:
    if policy is Policy.REQUESTED and not works:
        axis = np.asarray(result.recording.facts.tool.axis_in_wrist)
        works = reach.orientations(usual_wrist(result.recording), axis, (1.0,))[::2]
    job = Job(policy, works, _ANGLES_RAD)
    foresight = Foresight(result, job)
    left = foresight.undetermined()
    minded = [one.what for one in left if one.matters]
    trouble = f"the answers still depend on {', '.join(minded)}" if minded else ""
    predicted = {} if minded else foresight.target_errors_mm(foresight.covariance, job)
    best = next_best(result, job, reach, tag_a_in_view=camera_sees_tag_a(result))[0]
    findings = (*doubts, *examine(result.recording, policy), *_findings(result))
    return SessionAdvice(policy, findings, predicted, trouble, best, left)


def _findings(result: JointResult) -> tuple[Finding, ...]:
    """Samples that the others contradict."""
    return tuple(
        Finding("sample_outlier", f"{one.name}: {one.reason}; undo it and take it again")
        for one in result.samples
        if not one.used
    )


def _next(best: Advice) -> dict[str, object]:
    pose = best.base_from_wrist
    return {
        "words": best.sentence,
        "flange_mm": None if pose is None else [float(x) for x in pose.translation],
        "rotvec_deg": None if pose is None else [float(x) for x in np.degrees(pose.rotvec())],
        "u95_before_mm": best.before_mm,
        "u95_after_mm": best.after_mm,
    }
