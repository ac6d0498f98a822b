"""A dataset solved by a published method, as it is, and judged like the default."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgrd.calibration.hand_eye import METHODS, HandEyeResult, PosePair, SampleResidual
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.solving.datasets.fitting import Fitter, TargetScale


def check_method(name: str) -> None:
    """Raise InputError that lists the known methods unless `name` is one of them."""
    if name not in METHODS:
        raise InputError(f"method '{name}' is unknown; known: {', '.join(METHODS)}")


class NamedMethodFitter(Fitter):
    """The poses of one of METHODS from every sample's own pose, without refinement or rejection.

    What the data say apart from the poses (noise, covariance, size of the target) is the
    likelihood's, which `inner` knows.
    """

    def __init__(
        self,
        name: str,
        inner: Fitter,
        samples: Sequence[tuple[str, Pose]],
        camera: CameraModel | None,
    ) -> None:
        self._method = METHODS[name]
        self._inner = inner
        self._samples = samples
        self._camera = camera
        self._target_poses = [inner.own_pose(i, camera) for i in range(len(samples))]

    def fit_all(self) -> HandEyeResult:
        """The method's poses from all samples; noise and covariance of the likelihood."""
        self._likely = self._inner.fit_all()
        return self.fit(range(len(self._samples)), self._likely)

    def fit(self, chosen: Sequence[int], start: HandEyeResult) -> HandEyeResult:
        """The method's poses from the chosen samples; `start` gives noise and covariance only."""
        pairs = [PosePair(self._samples[i][1], self._target_poses[i]) for i in chosen]
        solution = self._method.solve(pairs, start.mount)
        result = replace(
            start,
            mount_from_camera=solution.mount_from_camera,
            mount_from_target=solution.mount_from_target,
            certificate=None,
        )
        return replace(result, samples=tuple(self._residual(i, result) for i in chosen))

    def _residual(self, index: int, result: HandEyeResult) -> SampleResidual:
        name, wrist = self._samples[index]
        predicted = result.predict(wrist)
        mm, rad = predicted.distance(self._target_poses[index])
        residuals = self.off_px(index, self._camera, predicted)
        px = float(np.sqrt(np.mean(residuals**2))) if residuals.size else float("nan")
        return SampleResidual(name, used=True, reason="", deg=float(np.degrees(rad)), mm=mm, px=px)

    def scale(self, start: HandEyeResult) -> TargetScale:
        """The size of the target, by maximum likelihood."""
        del start
        return self._inner.scale(self._likely)

    def own_pose(self, index: int, camera: CameraModel | None) -> Pose:
        """camera_from_target of one sample by itself."""
        return self._inner.own_pose(index, camera)

    def off_px(self, index: int, camera: CameraModel | None, predicted: Pose) -> Array:
        """Predicted minus seen pixels (n, 2)."""
        return self._inner.off_px(index, camera, predicted)
