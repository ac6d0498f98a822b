"""Hand-eye from a recording of which nothing is stated but its numbers: noise levels come from the samples."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vgrd.calibration.hand_eye.certificate import certified_start
from vgrd.calibration.hand_eye.features import FeaturePlace, first_places
from vgrd.calibration.hand_eye.likelihood import HEAVY, Kind, Likelihood
from vgrd.calibration.hand_eye.null_space import (
    determined_steps,
    open_translations,
    without_part_along,
)
from vgrd.calibration.hand_eye.points import PointSample
from vgrd.calibration.hand_eye.pose_pairs import HandEyeResult, SampleResidual
from vgrd.calibration.hand_eye.rows import Evidence, PointEvidence, PoseEvidence
from vgrd.calibration.hand_eye.state import HandEye, flange_motion_of
from vgrd.calibration.levels import Levels, wider_by_freedom
from vgrd.calibration.observability import check_distinct
from vgrd.errors import CalibrationError, NotObservable, TooFewObservations
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import INTRINSICS, CameraModel
from vgrd.geometry.covariance import covariance_from
from vgrd.geometry.resection import checked_points, pose_from_points
from vgrd.model import Mount

Mask = NDArray[np.bool_]

_WIDE = 10.0  # of a sigma that nobody stated: 0.05 to 5 mm and 0.006 to 0.6 degrees are all common
_ARM_MM = 0.5  # the middle of it: arms of hobby and industry
_ARM_RAD = 1e-3  # the same at 0.5 m
_STARTS = (
    0.0,
    3.0,
)  # log variances of the arm over nominal against the pictures': two modes are rare
_CLEARLY = 10.0  # of minus twice the log-likelihood: a t distribution is no better by chance
_NARROWER = (
    -0.35,
    -3.0,
    -7.0,
)  # of log variances: as a t distribution finds of normal samples, or if few
# samples are what made them large
_HOPELESS = 6.0  # of the same likelihood: no search makes up for it
_REJECT_WEIGHT = 0.1  # a sample that counts less than a tenth is left out and named
_REJECT_ROUNDS = 3  # of leaving out, a bound only
_CAMERA_ROUNDS = 3  # of renewing the noise of pixels under a refined camera
_BEYOND_DOUBT = 10.0  # of minus twice a log-likelihood: odds of 150 to 1
_TRIAL_STEPS = 8  # towards other intrinsics, to see whether it is worth more
_START_SIGMA_MM = 1.0  # of the start only, where their ratio says how to weigh: alike at 500 mm
_START_SIGMA_RAD = 2e-3  # see above
_FEWEST_PX = 1e-3  # no detector is better; keeps exact data solvable


@dataclass(frozen=True, slots=True, eq=False)
class RecordingProblem:
    """Flange poses with evidence of the target, one a sample; `blank` says what is refined beside the poses.

    allow_unobservable: how many translations may stay open. start: the result of nearly the same samples.
    """

    mount: Mount
    names: Sequence[str]
    wrists: Sequence[Pose]
    evidence: Evidence
    cameras: Sequence[Pose]
    blank: HandEye = field(default_factory=HandEye)
    allow_unobservable: int = 0
    start: HandEyeResult | None = None

    @property
    def feature_names(self) -> Sequence[str]:
        """Of the points that the state holds."""
        return self.evidence.places if isinstance(self.evidence, PointEvidence) else ()

    def chosen(self, indices: Sequence[int]) -> "RecordingProblem":
        """The same with some of the samples."""
        return replace(
            self,
            names=[self.names[i] for i in indices],
            wrists=[self.wrists[i] for i in indices],
            cameras=[self.cameras[i] for i in indices],
            evidence=self.evidence.chosen(indices),
        )


def poses_problem(
    mount: Mount, samples: Sequence[tuple[str, Pose, Pose]], *, allow_unobservable: int = 0
) -> RecordingProblem:
    """Samples with the pose of the target as somebody else measured it: name, robot, target."""
    cameras = [camera_from_target for _, _, camera_from_target in samples]
    return RecordingProblem(
        mount,
        [name for name, _, _ in samples],
        [base_from_wrist for _, base_from_wrist, _ in samples],
        PoseEvidence(cameras),
        cameras,
        allow_unobservable=allow_unobservable,
    )


def points_problem(
    mount: Mount,
    camera: CameraModel,
    samples: Sequence[PointSample],
    *,
    refine: bool = False,
    places: Mapping[str, FeaturePlace] | None = None,
    allow_unobservable: int = 0,
) -> RecordingProblem:
    """Pictures of a target with known points; places: of features, where known."""
    cameras = [
        pose_from_points(s.points_in_target, s.pixels, camera).camera_from_target for s in samples
    ]
    sightings = [sample.features for sample in samples]
    found = first_places(sightings, cameras, camera, places or {})
    points = np.array([place.point_in_target for place in found.values()]).reshape(-1, 3)
    blank = HandEye(
        camera=camera,
        refines_camera=refine,
        points=points,
        prior_points=points,
        prior_sigma_mm=np.array([place.sigma_mm for place in found.values()]),
    )
    checked = [checked_points(s.points_in_target, s.pixels) for s in samples]
    evidence = PointEvidence(
        camera,
        [points for points, _ in checked],
        [pixels for _, pixels in checked],
        cameras,
        sightings,
        list(found),
    )
    return RecordingProblem(
        mount,
        [sample.name for sample in samples],
        [sample.base_from_wrist for sample in samples],
        evidence,
        cameras,
        blank,
        allow_unobservable,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    likelihood: Likelihood
    state: HandEye
    levels: Levels
    objective: float


def calibrate_recording(problem: RecordingProblem) -> HandEyeResult:
    """Restricted maximum likelihood; samples that fit no common pose are left out with the reason.

    Raises TooFewObservations, NotObservable (names the missing motion) or InputError (one pose twice).
    """
    check_distinct(problem.names, problem.wrists)
    n = len(problem.names)
    unknowns = 12 + problem.blank.extra - problem.blank.points.size
    null_space = _open(problem, range(n))
    if 6 * n < unknowns + 1:
        raise TooFewObservations(
            f"{n} samples cannot determine {unknowns} unknowns: add samples or refine less"
        )
    state = _start(problem, null_space)
    used: list[int] = list(range(n))
    for _ in range(_REJECT_ROUNDS):
        found = _likeliest(problem.chosen(used), state, null_space)
        state = found.state
        weights = _weights(problem, found)
        kept = [i for i in range(n) if weights[i] >= _REJECT_WEIGHT]
        if kept == used or not _determines(problem, kept):
            break
        null_space = _open(problem, kept)
        used = kept
    else:
        found = _likeliest(problem.chosen(used), state, null_space)
    return _result(problem, found, used, null_space)


def demands_refinement(problem: RecordingProblem, given: HandEyeResult) -> HandEyeResult | None:
    """The result with intrinsics refined where the samples leave no doubt that the given ones are off.

    No doubt: the likelihood of the target's poses in the pictures grows by more than six unknowns may
    cost (Schwarz 1978) and ten more, odds of 150 to 1. given: the result with the intrinsics as given.
    """
    camera = problem.blank.camera
    if camera is None:
        return None
    refined = replace(problem, blank=replace(problem.blank, refines_camera=True))
    if problem.start is None or not problem.start.refined:
        refined = replace(refined, start=given)
    enough = len(INTRINSICS) * np.log(6 * len(problem.names)) + _BEYOND_DOUBT
    used = [i for i, sample in enumerate(given.samples) if sample.used]  # the others prove nothing
    try:
        if _gain_at_once(replace(refined, start=given).chosen(used), given) < enough / 2:
            return None
        result = calibrate_recording(refined)
    except CalibrationError:
        return None
    return replace(result, as_given=given) if given.misfit - result.misfit > enough else None


def _gain_at_once(refined: RecordingProblem, given: HandEyeResult) -> float:
    """How much squared misfit the intrinsics explain at the levels found without them."""
    state = _start(refined, given.null_space)
    basis = determined_steps(given.null_space, state.extra)
    likelihood = Likelihood(
        refined.mount, refined.wrists, refined.evidence, _kinds(refined, state), basis
    )
    levels = 2 * np.log([level.ratio for level in given.levels])
    better = likelihood.descend(state, levels, _TRIAL_STEPS)
    before, after = (likelihood.weighted(one, levels).d2 for one in (state, better))
    return float(before.sum() - after.sum())


def _open(problem: RecordingProblem, used: Sequence[int]) -> Array:
    wrists = [problem.wrists[i] for i in used]
    flange_motions = [flange_motion_of(problem.mount, wrist) for wrist in wrists]
    return open_translations(wrists, flange_motions, problem.allow_unobservable)


def _determines(problem: RecordingProblem, kept: Sequence[int]) -> bool:
    """Whether so few samples leave a fit: leaving out what cannot be spared proves nothing."""
    try:
        _open(problem, kept)
    except CalibrationError:
        return False
    return 6 * len(kept) > 12 + problem.blank.extra - problem.blank.points.size


def _start(problem: RecordingProblem, null_space: Array) -> HandEye:
    if problem.start is not None:
        result = problem.start
        camera = result.camera if problem.blank.refines_camera else problem.blank.camera
        return replace(
            problem.blank, X=result.mount_from_camera, Y=result.mount_from_target, camera=camera
        )
    best = certified_start(
        [flange_motion_of(problem.mount, wrist) for wrist in problem.wrists],
        problem.cameras,
        sigma_mm=_START_SIGMA_MM,
        sigma_rad=_START_SIGMA_RAD,
        null_space=null_space,
    )
    return replace(problem.blank, X=best.X, Y=best.Y, certificate=best.certificate)


def _kinds(problem: RecordingProblem, state: HandEye) -> list[Kind]:
    rows = problem.evidence.at(state)
    if not rows.white_freedom:
        return [
            Kind("places", "positions", "mm", _ARM_MM, _WIDE),
            Kind("turns", "target's turn", "rad", _ARM_RAD, _WIDE),
            Kind("arm turns", "arm's turn", "rad", _ARM_RAD, _WIDE),
        ]
    px = max(float(np.sqrt(rows.white_squares / rows.white_freedom)), _FEWEST_PX)
    known = float(np.exp(1 / np.sqrt(2 * rows.white_freedom)))  # spread of a sigma of so many
    return [
        Kind("pixels", "pixels", "px", px, known),
        Kind("pictures", "pixels alike in a picture", "px", px, _WIDE),
        Kind("arm places", "arm's position", "mm", _ARM_MM, _WIDE),
        Kind("arm turns", "arm's turn", "rad", _ARM_RAD, _WIDE),
    ]


def _likeliest(problem: RecordingProblem, state: HandEye, null_space: Array) -> _Found:
    """The best of the starts, with a normal distribution unless a t distribution is clearly better."""
    basis = determined_steps(null_space, problem.blank.extra)
    normal = _searched(problem, state, basis, np.inf, _starts(problem))
    likelihood = normal.likelihood.with_freedom(HEAVY)
    unsure = likelihood.prior_factors >= _WIDE
    is_near = problem.start is not None and problem.start.refined
    shifts = _NARROWER[:1] if is_near else _NARROWER
    starts = [(normal.state, normal.levels.log_variances + x * unsure) for x in shifts]
    starts = [(likelihood.descend(one, x, _TRIAL_STEPS), x) for one, x in starts]
    costs = [likelihood.objective(one, x) for one, x in starts]
    best = int(np.argmin(costs))
    if costs[best] > normal.objective + _HOPELESS:
        return normal
    heavy = _searched(problem, starts[best][0], basis, HEAVY, [starts[best][1]])
    return heavy if heavy.objective < normal.objective - _CLEARLY else normal


def _starts(problem: RecordingProblem) -> list[Array]:
    """Log variances to start from: those of the earlier result, else some."""
    if problem.start is not None and problem.start.levels:
        ratios = [level.ratio for level in problem.start.levels]
        return [2 * np.log(ratios)]
    count = 4 if problem.blank.camera is not None else 3
    return [np.array([0.0] + [x] * (count - 1)) for x in _STARTS]


def _searched(
    problem: RecordingProblem,
    state: HandEye,
    basis: Array,
    freedom: float,
    starts: Sequence[Array],
) -> _Found:
    """The most likely of what the starts lead to."""
    is_near = problem.start is not None and problem.start.refined
    rounds = _CAMERA_ROUNDS if problem.blank.refines_camera and not is_near else 1
    for _ in range(rounds):
        likelihood = Likelihood(
            problem.mount, problem.wrists, problem.evidence, _kinds(problem, state), basis, freedom
        )
        found = []
        for start in starts:
            there, levels = likelihood.search(state, start)
            objective = likelihood.objective(there, levels.log_variances)
            found.append(_Found(likelihood, there, levels, objective))
        best = min(found, key=lambda one: one.objective)
        state, starts = best.state, [best.levels.log_variances]
    return best


def _weights(problem: RecordingProblem, found: _Found) -> Array:
    """Weight of every sample as in a t distribution at the found levels, the unused ones too."""
    everything = replace(found.likelihood, wrists=problem.wrists, evidence=problem.evidence)
    d2 = everything.weighted(found.state, found.levels.log_variances).d2
    return np.asarray((HEAVY + 6) / (HEAVY + d2))


def _result(
    problem: RecordingProblem, found: _Found, used: Sequence[int], null_space: Array
) -> HandEyeResult:
    X, Y = without_part_along(found.state.X, found.state.Y, null_space)
    state = replace(found.state, X=X, Y=Y)
    likelihood, levels = found.likelihood, found.levels
    covariance, freedom = _covariance(likelihood, state, levels)
    rows = problem.evidence.at(state)
    predicted = [state.predict(problem.mount, wrist) for wrist in problem.wrists]
    px = problem.evidence.rms_px(state, predicted)
    residuals = []
    for i, name in enumerate(problem.names):
        mm, rad = predicted[i].distance(Pose(rows.rotations[i], rows.translations[i]))
        deg = float(np.degrees(rad))
        reason = "" if i in used else f"{mm:.1f} mm and {deg:.2f} deg off what the others say"
        residuals.append(SampleResidual(name, i in used, reason, deg, mm, px[i]))
    sigmas = np.sqrt(np.diag(covariance))
    refines = problem.blank.refines_camera
    return HandEyeResult(
        mount=problem.mount,
        mount_from_camera=state.X,
        mount_from_target=state.Y,
        covariance=covariance[:12, :12],
        noise_scale=1.0,
        samples=tuple(residuals),
        camera=state.camera,
        intrinsics_sigma=sigmas[12:18] if refines else np.zeros(6),
        target_scale=state.scale,
        target_scale_sigma=state.scale * float(sigmas[-1]) if state.refines_scale else 0.0,
        certificate=state.certificate,
        null_space=null_space,
        levels=levels.named([(kind.name, kind.unit, kind.nominal) for kind in likelihood.kinds]),
        freedom=freedom,
        misfit=_misfit(likelihood, state, levels),
        refined=refines,
        shares=_shares(likelihood, state, levels, covariance),
        features=dict(zip(problem.feature_names, state.points, strict=True)),
    )


def _misfit(likelihood: Likelihood, state: HandEye, levels: Levels) -> float:
    here = likelihood.linearize(state)
    W, _, _ = likelihood.whiten(here, levels.log_variances)
    r = np.einsum("nij,nj->ni", W, here.r)[:, :6]
    d2 = np.sum(r * r, axis=1)
    log_det = -2 * float(np.log(np.diagonal(W, axis1=1, axis2=2)[:, :6]).sum())
    nu = likelihood.freedom
    if np.isfinite(nu):
        return float(np.sum((nu + 6) * np.log1p(d2 / nu))) + log_det
    return float(d2.sum()) + log_det


def _covariance(likelihood: Likelihood, state: HandEye, levels: Levels) -> tuple[Array, float]:
    """Of all unknowns, with the spread of the levels; degrees of freedom at the target's place."""
    here = likelihood.weighted(state, levels.log_variances)
    try:
        inner = covariance_from(here.J)
    except NotObservable as fault:
        raise NotObservable(
            f"hand-eye: {fault}; look from more distances and tilts, or refine less",
            rank=fault.rank,
            unknowns=fault.unknowns,
        ) from fault
    gain = likelihood.basis @ inner @ here.J[: here.size].T
    n = len(here.d2)
    by_sample = gain[:3].reshape(3, n, -1)
    parts = np.array(
        [float(np.sum(np.einsum("anq,nqb->anb", by_sample, F) ** 2)) for F in here.factors]
    )
    freedom = levels.freedom_of(parts)
    nu = likelihood.freedom
    heavy = (nu + 8) / (nu + 6) if np.isfinite(nu) else 1.0  # information of a t distribution
    covariance = likelihood.basis @ inner @ likelihood.basis.T
    return covariance * heavy * wider_by_freedom(freedom) ** 2, freedom


def _shares(
    likelihood: Likelihood, state: HandEye, levels: Levels, covariance: Array
) -> dict[str, float]:
    """Variance, mm^2, that each cause adds to the miss of a target's place, mean over the samples."""
    here = likelihood.linearize(state)
    by_pose = np.linalg.pinv(likelihood.evidence.at(state).D[:, :6])
    causes = {
        kind.name: float(np.sum((by_pose @ F[:, :6])[:, :3] ** 2) * np.exp(x) / len(by_pose))
        for kind, F, x in zip(
            likelihood.kinds, likelihood.factors(here), levels.log_variances, strict=True
        )
    }
    J = (by_pose @ here.J[:, :6])[:, :3]
    own = float(np.einsum("nij,jk,nik->", J, covariance, J) / len(by_pose))
    return {**causes, "number and spread of the poses": own}
