"""What is told of the hand-eye of a recording: poses with covariance, every sample, levels, what limits it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgrd.calibration.hand_eye.fit import observed_covariance
from vgrd.calibration.hand_eye.likelihood import Likelihood
from vgrd.calibration.hand_eye.null_space import without_part_along
from vgrd.calibration.hand_eye.pose_pairs import HandEyeResult, SampleResidual
from vgrd.calibration.hand_eye.recording_problem import RecordingProblem
from vgrd.calibration.hand_eye.recording_search import Found
from vgrd.calibration.hand_eye.state import HandEye
from vgrd.calibration.levels import Levels, wider_by_freedom
from vgrd.geometry import Array, Pose


def result_of(
    problem: RecordingProblem, found: Found, used: Sequence[int], null_space: Array
) -> HandEyeResult:
    """The found state in words and figures; used: indices of the samples that are in it."""
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
        looks=_looks(likelihood.of_samples(problem.wrists, problem.evidence), state, levels),
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
    inner = observed_covariance(here.J, "look from more distances and tilts, or refine less")
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


def _looks(likelihood: Likelihood, state: HandEye, levels: Levels) -> Array:
    """(n, 6, 6) noise of the difference between the predicted pose of a target and its own one."""
    F = likelihood.factors(likelihood.linearize(state))
    by_pose = np.linalg.pinv(likelihood.evidence.at(state).D[:, :6])
    noise = [
        by_pose @ f[:, :6] * np.exp(x / 2) for f, x in zip(F, levels.log_variances, strict=True)
    ]
    return np.asarray(sum(f @ np.swapaxes(f, 1, 2) for f in noise))


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
