"""What pictures since activation told of the errors that stay: a Kalman filter of constants (Kalman 1960).

The errors are those of the estimate's unknowns, of the arm's field at each pose, of the arm's stop in
this rest, and of the pictures of one scene (print, lens, light: what all pictures of it share).
"""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from vgrd.geometry import Array
from vgrd.model import ArmKnowledge, Link

_POSES = (
    16  # chosen: a program waits at a dozen; the one that was visited longest ago is forgotten
)
_SAME_POSE_MM = 2.0  # chosen: the field of an arm changes by 1 % of itself in it
_SCENE_S = 600.0  # chosen: light and warmth change what the pictures of a scene share
TAG_ROWS = 12  # six of each tag
_CAMERA_S = (
    60.0  # a guess, as `MEMORY_S` of the served path: in it a camera moves as far as its stability
)
_GUESSED = np.array([10.0] * 3 + [0.02] * 3)  # mm, rad: far beyond what tag A's chain errs by
_JITTER = 1e-6  # of the field's variance: poses closer than 1 mm are one


@dataclass(frozen=True, slots=True, eq=False)
class Unexplained:
    """The part of a picture that no motion explains: independent residuals (m,) of variance 1.

    J (m, n + 6): by unknowns and, where tag A is seen, the arm's deviation at `flange` (3,); J_scene
    (m, 12): by the whitened residuals of tag B and tag A; J_camera (m, 6): by the camera's displacement,
    left. J_slips: by link (m, 6), by a slip in mm and rad in the link's own frame.
    """

    residual: Array
    J: Array
    J_scene: Array
    J_camera: Array
    J_slips: Mapping[Link, Array]
    flange: Array | None


@dataclass(frozen=True, slots=True, eq=False)
class Innovation:
    """What a picture shows (m,) beyond what was expected, its covariance, and H (m, N) by all errors.

    flange: (3,) where the arm stood, None where tag A was not seen.
    """

    value: Array
    covariance: Array
    H: Array
    flange: Array | None = None

    @property
    def square(self) -> float:
        """Squared sigmas, of m degrees of freedom."""
        return float(self.value @ np.linalg.solve(self.covariance, self.value))


class Belief:
    """Mean (N,) and covariance (N, N) of errors: unknowns, rest, scene (12), slip, camera, each pose; 6 each.

    Scene in whitened residuals of tag B and tag A, slip in usual slips of a link in its own frame (0: no link
    slips), the others in mm and rad. stability: (6,) of the camera, as in `CameraPlace`; it walks so far
    in a minute. A camera that may stand anywhere is no error: pictures are told without it.
    """

    def __init__(self, covariance: Array, arm: ArmKnowledge, stability: Array) -> None:
        self._arm = arm
        self._n = n = len(covariance)
        self._rest, self._scene = slice(n, n + 6), slice(n + 6, n + 6 + TAG_ROWS)
        self._slip = slice(self._scene.stop, self._scene.stop + 6)
        self._camera = slice(self._slip.stop, self._slip.stop + 6)
        self._camera_variances = np.where(np.isfinite(stability), stability, 0.0) ** 2
        size = self._camera.stop
        self.mean = np.zeros(size)
        self.covariance = np.zeros((size, size))
        self.covariance[:n, :n] = covariance
        model = arm.model
        self._stop_variances = model.variances() - model.field_mm**2 * model.scales() ** 2
        self._flanges: list[Array] = []
        self._visits: list[int] = []
        self._is_learned: list[bool] = []
        self._count = 0
        self.begin_rest()
        self.begin_scene()
        self._forget(self._camera, self._camera_variances)

    def copy(self) -> "Belief":
        """One that learns by itself from now on."""
        return deepcopy(self, {id(self._arm): self._arm})

    def begin_slip(self, sigma: float) -> None:
        """From now on a link may sit elsewhere, by so many usual slips."""
        self._forget(self._slip, np.full(6, sigma**2))

    @property
    def slip(self) -> tuple[Array, Array]:
        """Mean (6,) and covariance (6, 6) of the slip."""
        return self.mean[self._slip], self.covariance[self._slip, self._slip]

    def follow_camera(self) -> None:
        """Nothing is known of where it stands but the first guess of a picture that shows tag A."""
        self._forget(self._camera, np.where(self._camera_variances > 0, _GUESSED**2, 0.0))

    def shift_camera(self, tangent: Array) -> None:
        """The first guess of its displacement is another one, by so much less (6,)."""
        self.mean[self._camera] += tangent

    def begin_rest(self) -> None:
        """The arm stopped anew: nothing is known of this stop, nor of tag A's picture.

        What pictures of tag B share stays while the object stands: it would be summed as if it were chance.
        """
        self._forget(self._rest, self._stop_variances)
        tag_a = slice(self._scene.start + TAG_ROWS // 2, self._scene.stop)
        self._forget(tag_a, np.ones(TAG_ROWS // 2))

    def begin_scene(self) -> None:
        """The object stands elsewhere in the picture: what pictures share is as large as their noise."""
        self._forget(self._scene, np.ones(TAG_ROWS))

    def age(self, seconds: float) -> None:
        """What the pictures of a scene share changes slowly and stays as large as it is; the camera walks."""
        share = np.exp(-max(seconds, 0.0) / _SCENE_S)
        self.mean[self._scene] *= share
        self.covariance[self._scene] *= share
        self.covariance[:, self._scene] *= share
        diagonal = np.arange(self._scene.start, self._scene.stop)
        self.covariance[diagonal, diagonal] += 1 - share**2
        walked = min(max(seconds, 0.0) / _CAMERA_S, 1.0) * self._camera_variances
        self.covariance[self._camera, self._camera] += np.diag(walked)

    def knows(self, flange: Array) -> bool:
        """Whether a picture was learned with the flange there, (3,) base, mm."""
        index = self._find(flange)
        return index is not None and self._is_learned[index]

    def compare(self, picture: Unexplained, J_slip: Array | None = None) -> Innovation:
        """What the picture shows beyond what is known; J_slip (m, 6): by a slip, in usual ones."""
        m = len(picture.residual)
        H = np.zeros((m, len(self.mean)))
        H[:, : self._n] = picture.J[:, : self._n]
        H[:, self._scene], H[:, self._camera] = picture.J_scene, picture.J_camera
        if J_slip is not None:
            H[:, self._slip] = J_slip
        if picture.flange is not None:
            H = self._with_arm(H, picture.J[:, self._n :], picture.flange)
        covariance = np.eye(m) + H @ self.covariance @ H.T
        return Innovation(picture.residual + H @ self.mean, covariance, H, picture.flange)

    def learn(self, innovation: Innovation) -> None:
        """Take over what a picture told; Joseph's form, which leaves no variance negative."""
        H = innovation.H
        if innovation.flange is not None and (index := self._find(innovation.flange)) is not None:
            self._is_learned[index] = True
        gain = np.linalg.solve(innovation.covariance, H @ self.covariance).T
        self.mean = self.mean - gain @ innovation.value
        half = self.covariance - gain @ (H @ self.covariance)
        covariance = half - (half @ H.T) @ gain.T + gain @ gain.T
        self.covariance = 0.5 * (covariance + covariance.T)

    def _with_arm(self, H: Array, J_arm: Array, flange: Array) -> Array:
        index = self._find(flange)
        if index is None:
            index = self._add_pose(flange)
            H = np.hstack([H, np.zeros((len(H), len(self.mean) - H.shape[1]))])
        self._count += 1
        self._visits[index] = self._count
        H[:, self._rest] = J_arm
        H[:, self._pose(index)] = J_arm
        return H

    def _find(self, flange: Array) -> int | None:
        for i, known in enumerate(self._flanges):
            if float(np.linalg.norm(known - flange)) <= _SAME_POSE_MM:
                return i
        return None

    def _pose(self, index: int) -> slice:
        start = self._camera.stop + 6 * index
        return slice(start, start + 6)

    def _add_pose(self, flange: Array) -> int:
        """The field there, given what is known of it at the other poses (kriging)."""
        if len(self._flanges) == _POSES:
            self._drop(int(np.argmin(self._visits)))
        flanges = np.array([*self._flanges, flange])
        field = self._arm.deviations(flanges)[2]
        field -= np.kron(np.eye(len(flanges)), np.diag(self._stop_variances))
        known = slice(0, 6 * len(self._flanges))
        scales = np.tile(self._arm.model.scales() ** 2, len(self._flanges))
        jitter = np.diag(_JITTER * scales * max(self._arm.model.field_mm**2, _JITTER))
        by_known = np.linalg.solve(field[known, known] + jitter, field[known, known.stop :]).T
        own = np.asarray(field[known.stop :, known.stop :] - by_known @ field[known, known.stop :])
        self._append(np.asarray(by_known), own)
        self._flanges.append(flange)
        self._visits.append(self._count)
        self._is_learned.append(False)
        return len(self._flanges) - 1

    def _append(self, by_known: Array, own: Array) -> None:
        start, size = self._camera.stop, len(self.mean)
        across = self.covariance[:, start:] @ by_known.T
        grown = np.zeros((size + 6, size + 6))
        grown[:size, :size] = self.covariance
        grown[:size, size:], grown[size:, :size] = across, across.T
        grown[size:, size:] = by_known @ self.covariance[start:, start:] @ by_known.T + own
        self.mean = np.append(self.mean, by_known @ self.mean[start:])
        self.covariance = grown

    def _drop(self, index: int) -> None:
        del self._flanges[index], self._visits[index], self._is_learned[index]
        columns = np.delete(np.arange(len(self.mean)), self._pose(index))
        self.mean = self.mean[columns]
        self.covariance = self.covariance[np.ix_(columns, columns)]

    def _forget(self, part: slice, variances: Array) -> None:
        self.mean[part] = 0.0
        self.covariance[part] = 0.0
        self.covariance[:, part] = 0.0
        self.covariance[part, part] = np.diag(variances)
