"""What to tell an operator about a session while it is being recorded."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from vgrd.calibration.checks import examine, mistakes
from vgrd.calibration.first_samples import first_sample
from vgrd.calibration.insertion import Insertion
from vgrd.calibration.joint import (
    JointFit,
    JointSolution,
    TouchMiss,
    as_seen_in_the_end,
    calibrate_joint,
    camera_moves,
    contradicted_targets,
    solution_of,
    touch_misses,
)
from vgrd.calibration.planning.insertions import (
    CLEAN_WANTED,
    further_touches,
    predicted_insertions,
)
from vgrd.calibration.planning.next_sample import (
    Advice,
    Candidate,
    Looking,
    Touching,
    next_best,
    without_pose,
)
from vgrd.calibration.planning.pose_trust import reason_against
from vgrd.calibration.planning.predicted_error import Job, PredictedError, Undetermined
from vgrd.calibration.planning.reach import Reach, camera_sees_tag_a, usual_wrist
from vgrd.calibration.planning.with_cad import errors_with_cad_mm
from vgrd.calibration.scenery import scenery
from vgrd.calibration.stated_error import each_target, u95_in_words
from vgrd.calibration.turntable import without_useless_spins
from vgrd.errors import CalibrationError, DidNotConverge, VgrdError
from vgrd.geometry import Array
from vgrd.geometry.rotation_formats import usual_rotvec
from vgrd.judging.findings import MISSING, finding
from vgrd.judging.thresholds import WRONG_SIGMA
from vgrd.model import Finding, Policy, Recording

_ANGLES_RAD = (0.0, 2.0)  # two turns of the object stand for all: near and far
_OBJECT_MOVED = "object_moved"  # of `examine`
_TOO_LITTLE = (
    "the samples so far allow no estimate: look with tag A in view and the wrist turned about two axes, "
    "touch more targets, some with the wrist tilted, and spin the object at least three times; "
    "where all this was done, some touch may name a wrong target"
)


@dataclass(frozen=True, slots=True, eq=False)
class SessionAdvice:
    """What the samples so far are worth, and which one to take next.

    predicted_mm: 95 % error of the expected coordinate by target under the policy, empty as long as
    it cannot be told; trouble: why not, with the remedy, else "". best: the most useful sample
    within reach, None where nothing can be predicted or a finding has to be mended first; no_pose:
    why it is words without a pose, else "". undetermined: what the samples leave open. insertions: odds by
    target with a clearance; further_touches: so many more make 95 % go in without contact, None: more than
    anybody would touch. with_cad_mm: the error by target without CAD, touched, if CAD knew all targets.
    untouched: names of those without CAD and without a touch, of which nothing is known. first: the sample that
    the plan asks for next, told where there is no best one yet. touches: how each fits the others. solution: the
    estimate so far, None where there is none.
    """

    policy: Policy
    findings: tuple[Finding, ...] = ()
    predicted_mm: Mapping[str, float] = field(default_factory=dict)
    trouble: str = ""
    best: Advice | None = None
    no_pose: str = ""
    undetermined: tuple[Undetermined, ...] = ()
    insertions: Mapping[str, Insertion] = field(default_factory=dict)
    further_touches: int | None = None
    with_cad_mm: Mapping[str, float] = field(default_factory=dict)
    untouched: tuple[str, ...] = ()
    first: str = ""
    touches: tuple[TouchMiss, ...] = ()
    solution: JointSolution | None = None

    def to_json(self) -> dict[str, object]:
        """Everything in words and numbers: poses as flange x, y, z in mm and a rotation vector."""
        return {
            "policy": self.policy.value,
            "findings": [
                {"code": remark.code, "message": remark.message, "fatal": remark.fatal}
                for remark in self.findings
            ],
            "predicted_u95_mm": dict(self.predicted_mm),
            **({"u95_includes": self._includes()} if self.predicted_mm else {}),
            "trouble": self.trouble,
            "unknown_but_irrelevant": [u.what for u in self.undetermined if not u.matters],
            **self._insertions_to_json(),
            "without_cad": {
                name: _without_cad(self.predicted_mm[name], with_cad_mm)
                for name, with_cad_mm in self.with_cad_mm.items()
            },
            "next": self._next(),
            "scenery": None if self.solution is None else scenery(self.solution),
            "touches": [asdict(touch) for touch in self.touches],
        }

    def _includes(self) -> str:
        """Advice is computed without the holes: finding them in the pictures takes minutes."""
        return u95_in_words(each_target(*np.degrees(_ANGLES_RAD)), self.policy, holes=0)

    def _insertions_to_json(self) -> dict[str, object]:
        if not self.insertions:
            return {}
        return {
            "insertions": {name: odds.to_json() for name, odds in self.insertions.items()},
            "insertions_in_words": _insertion_in_words(self.further_touches),
        }

    def _next(self) -> dict[str, object] | None:
        if self.untouched and self.best is not None:
            return in_words_alone(
                f"touch {self.untouched[0]} with the wrist as usual: it has no point_mm, and without a touch it "
                "cannot be served",
                "touch",
                self.untouched[0],
            )
        if self.best is not None:
            return _next(self.best, self.no_pose)
        kind = self.first.partition(" ")[0]
        return in_words_alone(self.first, kind) if self.first else None


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
    findings: tuple[Finding, ...] = ()
    try:
        usable, doubts = without_useless_spins(recording)
        findings = (*doubts, *_examined(recording, usable, policy))
        judgement = _Judgement(policy, findings)
        if judgement.wrong():
            return judgement.remedy(judgement.wrong()[0])
        if recording.plan.touches_surface:
            return judgement.unpredicted(recording)
        reach = reach or Reach.of(recording)
        return _advice(calibrate_joint(usable), judgement, reach, works)
    except (DidNotConverge, np.linalg.LinAlgError):
        return SessionAdvice(policy, findings, trouble=_TOO_LITTLE, first=first_sample(recording))
    except VgrdError as err:
        return SessionAdvice(policy, findings, trouble=str(err), first=first_sample(recording))


@dataclass(frozen=True, slots=True)
class _Judgement:
    """Findings before the estimate."""

    policy: Policy
    findings: tuple[Finding, ...]

    def wrong(self) -> list[Finding]:
        """What is wrong with the samples, not only missing."""
        return mistakes(self.findings)

    def doubted(self, outliers: tuple[Finding, ...]) -> str:
        """Why no pose may rest on the samples, or ""."""
        doubts = [remark for remark in self.findings if remark.fatal or remark.code not in MISSING]
        return next((f"{remark.code}: {remark.message}" for remark in (*doubts, *outliers)), "")

    def remedy(self, wrong: Finding) -> SessionAdvice:
        """Nothing but what to mend first."""
        trouble = f"before any other sample: {wrong.message}"
        return SessionAdvice(self.policy, self.findings, trouble=trouble)

    def unpredicted(self, recording: Recording) -> SessionAdvice:
        """What is missing, of a plan whose TCP the joint estimate does not know; it foresees nothing then."""
        trouble = next((remark.message for remark in self.findings if remark.fatal), "")
        nothing = f"nothing is missing; vgrd solve tells the error, plan {recording.plan.value} foresees none"
        return SessionAdvice(
            self.policy, self.findings, trouble=trouble or nothing, first=first_sample(recording)
        )


def _examined(recording: Recording, usable: Recording, policy: Policy) -> Sequence[Finding]:
    """As `examine`; an object that seems to have moved is no finding where it was the camera."""
    findings = examine(recording, policy)
    if any(remark.code == _OBJECT_MOVED for remark in findings):
        with suppress(CalibrationError):
            fit = calibrate_joint(usable)
            if camera_moves(fit):
                return examine(as_seen_in_the_end(fit, recording), policy)
    return findings


def _advice(
    result: JointFit, judgement: _Judgement, reach: Reach, works: Sequence[Array]
) -> SessionAdvice:
    outliers = _outliers(result)
    if not result.stated_scale <= WRONG_SIGMA:  # not a number is wrong too
        contradiction = _contradiction(result.stated_scale)
        return replace(judgement, findings=(*judgement.findings, contradiction, *outliers)).remedy(
            contradiction
        )
    policy = judgement.policy
    if policy is Policy.REQUESTED and not works:
        axis = np.asarray(result.recording.facts.tool.axis_in_wrist)
        works = reach.orientations(usual_wrist(result.recording), axis, (1.0,))[::2]
    job = Job(policy, works, _ANGLES_RAD)
    foresight = PredictedError(result, job)
    undetermined = foresight.undetermined()
    directions = [direction.what for direction in undetermined if direction.matters]
    trouble = (
        f"the answers still depend on {', '.join(dict.fromkeys(directions))}" if directions else ""
    )
    predicted, insertions, further = {}, {}, None
    if not directions:
        predicted = foresight.target_errors_mm(foresight.covariance, job)
        insertions = predicted_insertions(result, foresight, foresight.covariance)
        further = further_touches(result, foresight) if insertions else None
    best = next_best(result, job, reach, tag_a_in_view=camera_sees_tag_a(result))[0]
    no_pose = ""
    if best.base_from_wrist is not None:
        no_pose = judgement.doubted(outliers) or reason_against(result, best.candidate, reach)
    best = without_pose(result, best) if no_pose else best
    findings = (
        *judgement.findings,
        *contradicted_targets(result),
        *camera_moves(result),
        *outliers,
    )
    bare = result.layout.bare if predicted else ()
    with_cad = errors_with_cad_mm(result, job) if bare else {}
    untouched = tuple(n for n in result.recording.facts.object.bare if n not in result.layout.bare)
    return SessionAdvice(
        policy,
        findings,
        predicted,
        trouble,
        best,
        no_pose,
        undetermined,
        insertions,
        further,
        {name: with_cad[name] for name in bare},
        untouched,
        touches=touch_misses(result),
        solution=solution_of(result),
    )


def _contradiction(noise_scale: float) -> Finding:
    return finding(
        "noisy",
        f"the samples contradict each other, {noise_scale:.0f} times as much as robot, camera and "
        "touch promise",
        fatal=True,
    )


def _outliers(result: JointFit) -> tuple[Finding, ...]:
    """Samples that the others contradict."""
    return tuple(
        finding("sample_outlier", f"{sample.name} is {sample.reason}")
        for sample in result.samples
        if not sample.used
    )


def _insertion_in_words(further: int | None) -> str:
    share = f"{100 * CLEAN_WANTED:g} % of insertions at every target are predicted to go in without contact"
    if further == 0:
        return f"{share}"
    if further is None:
        return f"no number of touches like these brings it about that {share}"
    return f"touch {further} times more, each target in turn as before: then {share}"


def _without_cad(now_mm: float, with_cad_mm: float) -> dict[str, object]:
    return {
        "words": f"touches alone tell where it is: 95 % error {now_mm:.3f} mm, {with_cad_mm:.3f} mm if "
        "point_mm of all targets were known",
        "u95_mm": now_mm,
        "u95_with_cad_mm": with_cad_mm,
    }


def in_words_alone(words: str, kind: str, target: str | None = None) -> dict[str, object]:
    """A next sample of which no pose and no error can be told."""
    return {
        "kind": kind,
        "target": target,
        "words": words,
        "no_pose": "nothing tells where it is",
        "flange_mm": None,
        "rotvec_deg": None,
        "u95_before_mm": None,
        "u95_after_mm": None,
    }


def _next(best: Advice, no_pose: str) -> dict[str, object]:
    pose = best.base_from_wrist
    kind, target = _kind_and_target(best.candidate)
    return {
        "kind": kind,
        "target": target,
        "words": best.sentence,
        "no_pose": no_pose,
        "flange_mm": None if pose is None else [float(x) for x in pose.translation],
        "rotvec_deg": None
        if pose is None
        else [float(x) for x in np.degrees(usual_rotvec(pose.rotation))],
        "u95_before_mm": best.before_mm,
        "u95_after_mm": best.after_mm,
    }


def _kind_and_target(candidate: Candidate) -> tuple[str, str | None]:
    if isinstance(candidate, Touching):
        return "touch", candidate.target
    return ("look" if isinstance(candidate, Looking) else "spin"), None
