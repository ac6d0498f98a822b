"""Dataset in, solution out: detect, fit, leave each sample out once, judge."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vgrd.calibration.hand_eye import HandEyeResult, PointSample, undetermined_in_words
from vgrd.calibration.observability import Axes, turned_axes
from vgrd.errors import CalibrationError, ConfigError, InputError, TagNotSeen, TooFewObservations
from vgrd.geometry import Pose, log_rotation
from vgrd.solving.datasets.fitting import Fitter, TargetScale, fitter_of_points, fitter_of_poses
from vgrd.solving.datasets.half_turns import turn_alike
from vgrd.solving.datasets.judging import DatasetEvidence, Miss, doubtful, judge
from vgrd.solving.datasets.loading import Dataset, load_dataset
from vgrd.solving.datasets.looking import observe
from vgrd.solving.datasets.named_method import NamedMethodFitter, check_method
from vgrd.solving.datasets.point_pairs import PointPairSolution, solve_point_pairs
from vgrd.solving.datasets.quality import Quality, quality_of
from vgrd.solving.datasets.reading.sample_reading import DatasetSample, PointInCamera
from vgrd.solving.datasets.solution import AsGiven, DatasetSolution, LeaveOneOut, SampleReport
from vgrd.solving.datasets.suspects import suspects
from vgrd.solving.flange_poses import MIN_SAMPLES
from vgrd.vision.print.boards import BoardObservation, has_direction

Progress = Callable[[int, int], None]

_PARTLY = 0.5  # of the target's points: fewer are told


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """The samples in which the target was seen, and why it was not in the others."""

    samples: Sequence[DatasetSample]
    observations: Sequence[BoardObservation | Pose]
    unseen: dict[str, str]

    @property
    def names(self) -> list[str]:
        """Their names, in order."""
        return [sample.name for sample in self.samples]


class _Steps:
    """Counts what is done, for a progress bar."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self._progress = progress or (lambda _count, _total: None)
        self._total = total
        self._count = 0
        self._progress(0, total)

    def advance(self) -> None:
        self._count += 1
        self._progress(self._count, self._total)

    def finish(self) -> None:
        self._progress(self._total, self._total)


def solve_dataset(
    path: Path,
    progress: Progress | None = None,
    *,
    method: str | None = None,
    tolerance_mm: float | None = None,
) -> DatasetSolution | PointPairSolution:
    """Solve hand-eye from a DATASET.toml; `progress(done, total)` is called after every step.

    method: one of `vgrd.calibration.hand_eye.published.METHODS`, without refinement; None: maximum
    likelihood. tolerance_mm: what a further look may miss by at 95 %. Raises InputError (method
    unknown, or intrinsics to be refined by it), ConfigError (faults of the file and its pictures),
    TooFewObservations, NotObservable (names the missing motion) or DidNotConverge.
    """
    if method is not None:
        check_method(method)
    dataset = load_dataset(path)
    if any(isinstance(sample.source, PointInCamera) for sample in dataset.samples):
        return solve_point_pairs(dataset, method, tolerance_mm)
    steps = _Steps(progress, 2 * len(dataset.samples) + 2)
    sightings = _look(dataset, steps)
    fitter = _fitter(dataset, sightings, method)
    target_poses = [fitter.own_pose(i, dataset.camera) for i in range(len(sightings.samples))]
    result = _fit_all(fitter, dataset, sightings, target_poses)
    steps.advance()
    folds = _folds(fitter, sightings, result, steps)
    misses = _misses(fitter, sightings, folds)
    scale = fitter.scale(result)
    evidence = DatasetEvidence(
        dataset=dataset,
        names=sightings.names,
        camera_from_target=target_poses,
        result=result,
        misses=misses,
        unseen=sightings.unseen,
        few_points=_few_points(sightings),
        scale=scale,
        quality=_quality(result, sightings, folds, misses, target_poses, scale),
        tolerance_mm=tolerance_mm,
    )
    solution = _solution(evidence, _as_given(fitter, sightings, result, folds), method)
    steps.finish()
    return solution


def _fit_all(
    fitter: Fitter, dataset: Dataset, sightings: Sightings, target_poses: Sequence[Pose]
) -> HandEyeResult:
    """The fit of all samples; what fails says first what was probably meant."""
    try:
        return fitter.fit_all()
    except CalibrationError as error:
        hints = suspects(dataset, sightings.names, target_poses)
        left_out = [told_once(sightings.unseen)] if sightings.unseen else []
        raise _led_by(hints, error).with_hints(left_out) from error


def _solution(
    evidence: DatasetEvidence, as_given: AsGiven | None, method: str | None
) -> DatasetSolution:
    dataset, result = evidence.dataset, evidence.result
    return DatasetSolution(
        mount=dataset.mount,
        mount_from_camera=result.mount_from_camera,
        mount_from_target=result.mount_from_target,
        leave_one_out=_summary(evidence.misses),
        samples=_reports(evidence),
        target_scale=evidence.scale,
        camera=result.camera,
        refined=result.refined,
        verdict=judge(evidence),
        method=method,
        undetermined=undetermined_in_words(dataset.mount, result.null_space),
        features=result.features,
        covariance=result.covariance,
        levels=result.levels,
        quality=evidence.quality,
        tolerance_mm=evidence.tolerance_mm,
        as_given=as_given,
    )


def fit_dataset(dataset: Dataset) -> HandEyeResult:
    """The fit of all samples of a dataset alone, without a verdict; errors as of `solve_dataset`."""
    sightings = _look(dataset, _Steps(None, len(dataset.samples)))
    return _fitter(dataset, sightings, None).fit_all()


def _look(dataset: Dataset, steps: _Steps) -> Sightings:
    """Find the target in every sample; ConfigError names all pictures that cannot be read."""
    samples, observations, unseen, faults = [], [], {}, []
    for sample in dataset.samples:
        try:
            observations.append(observe(sample, dataset.target, dataset.picture_px))
            samples.append(sample)
        except TagNotSeen as reason:
            unseen[sample.name] = str(reason)
        except InputError as error:
            faults.append(f"sample '{sample.name}': {error}")
        steps.advance()
    if faults:
        raise ConfigError(str(dataset.path), faults)
    if len(samples) < MIN_SAMPLES:
        reasons = told_once(unseen)
        raise TooFewObservations(
            f"{dataset.path}: the target was seen in {len(samples)} of {len(dataset.samples)} "
            f"samples, at least {MIN_SAMPLES} are needed. {reasons}"
        )
    return Sightings(samples, observations, unseen)


def told_once(reasons: Mapping[str, str]) -> str:
    """Why samples are not in the fit: equal reasons once, with their number and names."""
    alike: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        alike.setdefault(reason, []).append(name)
    return "; ".join(
        f"{names[0]}: {reason}"
        if len(names) == 1
        else f"{len(names)} samples ({', '.join(names)}): {reason}"
        for reason, names in alike.items()
    )


def _led_by(hints: Sequence[str], error: CalibrationError) -> CalibrationError:
    """The error with what was probably meant before what failed."""
    if not hints:
        return error
    led = type(error).__new__(type(error), "\n".join([*hints, str(error)]))
    led.__dict__.update(vars(error))
    return led


def _fitter(dataset: Dataset, sightings: Sightings, method: str | None) -> Fitter:
    if method is None:
        return _likelihood_fitter(dataset, sightings, may_refine=True)
    if dataset.refine:
        raise InputError(
            f"{dataset.path}: method '{method}' refines no intrinsics: set camera.refine = false, "
            "or leave the method out"
        )
    samples = [(sample.name, sample.base_from_wrist) for sample in sightings.samples]
    return NamedMethodFitter(
        method, _likelihood_fitter(dataset, sightings, may_refine=False), samples, dataset.camera
    )


def _likelihood_fitter(dataset: Dataset, sightings: Sightings, *, may_refine: bool) -> Fitter:
    pairs = list(zip(sightings.samples, sightings.observations, strict=True))
    axes, _ = turned_axes([sample.base_from_wrist.rotation for sample in sightings.samples])
    allow_unobservable = int(axes is not Axes.NONE)
    if dataset.camera is None:
        return fitter_of_poses(
            dataset.mount,
            [
                (s.name, s.base_from_wrist, observation)
                for s, observation in pairs
                if isinstance(observation, Pose)
            ],
            allow_unobservable=allow_unobservable,
        )
    boards = [observation for _, observation in pairs if isinstance(observation, BoardObservation)]
    if dataset.target is not None and not has_direction(dataset.target):
        boards = turn_alike([s.base_from_wrist for s, _ in pairs], boards, dataset.camera)
    points = [
        PointSample(
            s.name, s.base_from_wrist, board.points_in_target, board.pixels, features=s.features
        )
        for (s, _), board in zip(pairs, boards, strict=True)
    ]
    return fitter_of_points(
        dataset.mount,
        dataset.camera,
        points,
        refine=dataset.refine,
        may_refine=may_refine,
        allow_unobservable=allow_unobservable,
        places={name: place for name, place in dataset.features.items() if place is not None},
    )


def _folds(
    fitter: Fitter, sightings: Sightings, result: HandEyeResult, steps: _Steps
) -> list[HandEyeResult | None]:
    """The fit without each sample; None where the others do not determine one.

    Which of the others belong together, their levels of noise and whether they demand other intrinsics is
    found without it too.
    """
    folds: list[HandEyeResult | None] = []
    everything = range(len(sightings.samples))
    for index in everything:
        try:
            folds.append(fitter.fit([i for i in everything if i != index], result))
        except CalibrationError:
            folds.append(None)
        steps.advance()
    return folds


def _misses(
    fitter: Fitter, sightings: Sightings, folds: Sequence[HandEyeResult | None]
) -> list[Miss | None]:
    """How far each fold misses the sample left out; its own pose is seen through the fold's camera.

    Samples that do not fit are predicted and counted as all are.
    """
    misses: list[Miss | None] = []
    for index, (sample, fit) in enumerate(zip(sightings.samples, folds, strict=True)):
        if fit is None:
            misses.append(None)
            continue
        predicted = fit.predict(sample.base_from_wrist)
        own = fitter.own_pose(index, fit.camera)
        residuals_px = fitter.off_px(index, fit.camera, predicted)
        squares_px = float((residuals_px * residuals_px).sum())
        turn = log_rotation(predicted.rotation @ own.rotation.T)
        shift = predicted.translation - own.translation
        misses.append(Miss(shift, turn, squares_px, len(residuals_px)))
    return misses


def _as_given(
    fitter: Fitter,
    sightings: Sightings,
    result: HandEyeResult,
    folds: Sequence[HandEyeResult | None],
) -> AsGiven | None:
    """What belongs to the intrinsics as given, where the samples demanded others."""
    given = result.as_given
    if given is None:
        return None
    own = [None if fold is None else fold.as_given or fold for fold in folds]
    return AsGiven(
        given.mount_from_camera,
        given.mount_from_target,
        _summary(_misses(fitter, sightings, own)),
    )


def _quality(
    result: HandEyeResult,
    sightings: Sightings,
    folds: Sequence[HandEyeResult | None],
    misses: Sequence[Miss | None],
    target_poses: Sequence[Pose],
    scale: TargetScale,
) -> Quality:
    known = [miss for miss in misses if miss is not None]
    expected = [
        fold.pose_covariance(sample.base_from_wrist)
        for sample, fold in zip(sightings.samples, folds, strict=True)
        if fold is not None
    ]
    if len(known) < len(misses):
        known, expected = [], []
    distance = float(np.median([np.linalg.norm(pose.translation) for pose in target_poses]))
    return quality_of(
        result,
        [miss.shift_mm for miss in known],
        [miss.turn_rad for miss in known],
        expected,
        distance,
        scale.excess,
    )


def _summary(misses: Sequence[Miss | None]) -> LeaveOneOut:
    """Means over all; unknown as soon as one is: a mean over the easy samples would flatter."""
    valid_misses = [miss for miss in misses if miss is not None]
    if len(valid_misses) < len(misses):
        return LeaveOneOut(np.nan, np.nan, np.nan)
    count = sum(miss.count for miss in valid_misses)
    return LeaveOneOut(
        deg=float(np.mean([miss.deg for miss in valid_misses])),
        mm=float(np.mean([miss.mm for miss in valid_misses])),
        px=float(np.sqrt(sum(m.squares_px for m in valid_misses) / count)) if count else np.nan,
    )


def _few_points(sightings: Sightings) -> dict[str, str]:
    return {
        sample.name: f"only {len(observation.pixels)} of {observation.total} points seen: "
        "its own pose is weak"
        for sample, observation in zip(sightings.samples, sightings.observations, strict=True)
        if isinstance(observation, BoardObservation)
        and len(observation.pixels) < _PARTLY * observation.total
    }


def _reports(evidence: DatasetEvidence) -> tuple[SampleReport, ...]:
    """One report per sample of the file, in its order."""
    odd = doubtful(evidence)
    reports = {
        name: SampleReport(name, used=False, reason=reason)
        for name, reason in evidence.unseen.items()
    }
    for residual, miss in zip(evidence.result.samples, evidence.misses, strict=True):
        name = residual.name
        reasons = (
            [evidence.few_points.get(name), odd.get(name)] if residual.used else [residual.reason]
        )
        reason = "; ".join(text for text in reasons if text)
        if miss is None:
            reports[name] = SampleReport(name, residual.used, reason)
        else:
            px = float(np.sqrt(miss.squares_px / miss.count)) if miss.count else np.nan
            reports[name] = SampleReport(name, residual.used, reason, px, miss.deg, miss.mm)
    return tuple(reports[sample.name] for sample in evidence.dataset.samples)
