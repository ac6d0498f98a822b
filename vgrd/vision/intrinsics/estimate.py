"""Intrinsics from pictures of a flat board: start, bundle adjustment, bad pictures named.

Result in the convention of `vgrd.geometry.camera`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from vgrd.errors import InputError, TooFewObservations
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.covariance import rms
from vgrd.vision.intrinsics.fit import BoardView, Bundle, IntrinsicsState, PictureNoise, adjust

MIN_VIEWS, MIN_POINTS = 4, 8  # twice what fixes fx fy cx cy (Zhang 2000), and a homography
LENGTHS = (0, 4, 5, 8)  # of OpenCV's models without thin prism and tilt
_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_WRONG_POINT_SHARE = 0.02  # of the board's extent in the picture: no lens bends a plane so much
_OUTLIER, _BAD_VIEW = 6.0, 4.0  # of the robust noise level; guesses: noise does neither
_MOST_WRONG = 0.2  # of a picture's points; with more of them the picture itself is bad


@dataclass(frozen=True, slots=True, eq=False)
class ViewReport:
    """How one picture fared; rms values in px, held_out: predicted by a fit without the picture."""

    name: str
    used: bool
    points: int
    dropped: int
    reason: str | None = None
    rms_px: float | None = None
    held_out_px: float | None = None
    distance_mm: float | None = None
    tilt_deg: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class IntrinsicsResult:
    """camera with covariance (4 + k, 4 + k) of fx, fy, cx, cy and the distortion; board as it is.

    points_in_board: (m, 3) mm as they were printed; views: those of the fit, in the order of the
    bundle's residuals; reports: one for every picture given.
    """

    camera: CameraModel
    covariance: Array
    points_in_board: Array
    bundle: Bundle
    views: tuple[BoardView, ...]
    reports: tuple[ViewReport, ...]

    @property
    def sigmas(self) -> dict[str, float]:
        """1 sigma by name: fx, fy, cx, cy in px, distortion."""
        values = np.sqrt(np.diag(self.covariance)).tolist()
        return dict(zip(_NAMES[: len(values)], values, strict=True))

    @property
    def rms_px(self) -> float:
        """Residual of both coordinates over all pictures used."""
        return rms(np.concatenate(self.bundle.residuals))

    @property
    def held_out_px(self) -> float:
        """The same, each picture predicted by a fit without it."""
        return rms(np.concatenate(self.bundle.held_out))

    @property
    def distance_mm(self) -> float:
        """Median distance of the board."""
        return float(np.median([r.distance_mm for r in self.reports if r.distance_mm]))


def calibrate_intrinsics(
    points_in_board: Array,
    views: Sequence[BoardView],
    size_px: tuple[int, int],
    *,
    distortion: int = 4,  # k1 k2 p1 p2; a guess: more pay for wide lenses, and widen sigmas
    print_mm: float | None = None,
) -> IntrinsicsResult:
    """Intrinsics from views of a flat board; points (m, 3) mm with z = 0 as they were meant.

    distortion: how many numbers (0, 4, 5, 8); print_mm: 1 sigma of a printed point, None estimates
    it. Bad points and pictures are left out and reported. Raises InputError, TooFewObservations
    (fewer than 4 usable pictures), NotObservable, DidNotConverge.
    """
    if distortion not in LENGTHS:
        raise InputError(f"distortion of {distortion} numbers: one of {LENGTHS} is known")
    nominal = np.asarray(points_in_board, dtype=np.float64)
    screened = [_screened(nominal, view) for view in views]
    inliers = [view for view in screened if isinstance(view, BoardView)]
    reasons = {v.name: r for v, r in zip(views, screened, strict=True) if isinstance(r, str)}
    noise = (
        PictureNoise() if print_mm is None else PictureNoise(print_mm=print_mm, flat_mm=print_mm)
    )
    gross: dict[str, str] | None = None
    while gross != {}:
        _require(inliers, reasons)
        state, residuals = _start(nominal, inliers, size_px, distortion)
        inliers, gross = _without_bad(inliers, residuals)
        reasons |= gross
    while True:
        bundle = adjust(nominal, inliers, state, noise, fixed_print=print_mm is not None)
        candidates, bad = _without_bad(inliers, bundle.residuals)
        if _count(candidates) == _count(inliers):
            break
        reasons |= bad
        poses = dict(zip((view.name for view in inliers), bundle.state.poses, strict=True))
        inliers = candidates
        _require(inliers, reasons)
        state = replace(bundle.state, poses=tuple(poses[view.name] for view in inliers))
    reports = _reports(views, inliers, reasons, bundle)
    return IntrinsicsResult(
        bundle.state.camera(size_px),
        bundle.covariance,
        nominal + bundle.state.offsets,
        bundle,
        tuple(inliers),
        reports,
    )


def _screened(nominal: Array, view: BoardView) -> BoardView | str:
    """The view without points that no plane explains; or why it cannot be used."""
    if len(view.ids) < MIN_POINTS:
        return f"only {len(view.ids)} points of the board found, at least {MIN_POINTS} are needed"
    extent = float(np.ptp(view.pixels, axis=0).max())
    limit = max(_WRONG_POINT_SHARE * extent, 3.0)
    H, inside = cv2.findHomography(nominal[view.ids, :2], view.pixels, cv2.RANSAC, limit)
    if H is None or not np.isfinite(H).all():
        return "its points lie on no plane: is it another board?"
    good = np.ravel(inside).astype(bool)
    if good.mean() < 1 - _MOST_WRONG or good.sum() < MIN_POINTS:
        return f"{int((~good).sum())} of {len(good)} points lie on no common plane"
    return BoardView(view.name, view.ids[good], view.pixels[good])


def _count(views: Sequence[BoardView]) -> int:
    return sum(len(view.ids) for view in views)


def _require(inliers: Sequence[BoardView], reasons: dict[str, str]) -> None:
    if len(inliers) < MIN_VIEWS:
        named = "; ".join(f"{name}: {reason}" for name, reason in reasons.items())
        raise TooFewObservations(
            f"{len(inliers)} usable pictures, at least {MIN_VIEWS} are needed (20 are good)"
            + (f". Not used: {named}" if named else "")
        )


def _start(
    nominal: Array, views: Sequence[BoardView], size_px: tuple[int, int], distortion: int
) -> tuple[IntrinsicsState, list[Array]]:
    """OpenCV's calibration with few distortion terms, and its residuals."""
    flags = cv2.CALIB_FIX_K3
    if distortion == 0:
        flags |= cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_ZERO_TANGENT_DIST
    points = [nominal[view.ids].astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32)[:, None] for view in views]
    _, K, d, rotvecs, translations = cv2.calibrateCamera(
        points, pixels, size_px, np.eye(3), np.zeros(5), flags=flags
    )
    numbers = np.zeros(distortion)
    numbers[: min(4, distortion)] = np.ravel(d)[: min(4, distortion)]
    poses = [
        Pose.from_rotvec(np.ravel(w), np.ravel(t))
        for w, t in zip(rotvecs, translations, strict=True)
    ]
    residuals = [
        cv2.projectPoints(pose @ nominal[view.ids], np.zeros(3), np.zeros(3), K, d)[0][:, 0]
        - view.pixels
        for view, pose in zip(views, poses, strict=True)
    ]
    values = np.concatenate([K[[0, 1, 0, 1], [0, 1, 2, 2]], numbers])
    return IntrinsicsState(values, np.zeros(2), np.zeros_like(nominal), tuple(poses)), residuals


def _without_bad(
    views: Sequence[BoardView], residuals: Sequence[Array]
) -> tuple[list[BoardView], dict[str, str]]:
    """Views without outliers, and the names of those that are bad altogether, the worst first."""
    lengths = [np.linalg.norm(r, axis=1) for r in residuals]
    level = float(np.median([np.median(length) for length in lengths])) / 1.18  # Rayleigh's median
    medians = np.array([float(np.median(length)) / 1.18 for length in lengths])
    worst = int(np.argmax(medians))
    if medians[worst] > _BAD_VIEW * level:
        reason = (
            f"off by {medians[worst]:.2g} px where others are by {level:.2g}: blurred or bent?"
        )
        inliers = [view for i, view in enumerate(views) if i != worst]
        return inliers, {views[worst].name: reason}
    inliers, bad = [], {}
    for view, length in zip(views, lengths, strict=True):
        good = length < _OUTLIER * level
        if good.mean() < 1 - _MOST_WRONG or good.sum() < MIN_POINTS:
            bad[view.name] = (
                f"{int((~good).sum())} of {len(good)} points are off: blurred or bent?"
            )
        else:
            inliers.append(BoardView(view.name, view.ids[good], view.pixels[good]))
    return inliers, bad


def _reports(
    views: Sequence[BoardView],
    inliers: Sequence[BoardView],
    reasons: dict[str, str],
    bundle: Bundle,
) -> tuple[ViewReport, ...]:
    place = {view.name: i for i, view in enumerate(inliers)}
    reports = []
    for view in views:
        if view.name not in place:
            reports.append(ViewReport(view.name, False, len(view.ids), 0, reasons[view.name]))
            continue
        i = place[view.name]
        pose = bundle.state.poses[i]
        reports.append(
            ViewReport(
                view.name,
                True,
                len(view.ids),
                len(view.ids) - len(inliers[i].ids),
                rms_px=rms(bundle.residuals[i]),
                held_out_px=rms(bundle.held_out[i]),
                distance_mm=float(np.linalg.norm(pose.translation)),
                tilt_deg=float(np.degrees(np.arccos(min(abs(pose.rotation[2, 2]), 1.0)))),
            )
        )
    return tuple(reports)
