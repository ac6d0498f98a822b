"""A simulated cell whose camera sees tags by their corners: pixels, noise on each, and the pose that fits them."""

from dataclasses import replace

import numpy as np
from numpy.random import SeedSequence
from scipy.spatial.transform import Rotation

from fakes.world.arm_errors import ArmErrors
from fakes.world.simulation import TAG_A, TAG_B, Simulation
from vgrd.geometry import Array, Pose, exp_rotation, hat
from vgrd.model import CellFacts, Motion, Stability, TagObservation, TagSpec, frozen_array

_SQUARE = np.array([(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)])
_STEPS = 4  # of Gauss and Newton from the truth, which is within a pixel
_TILT_RAD = np.radians(30)  # of the camera from the vertical, and so of tags that lie flat


class CornerCell(Simulation):
    """edge_mm: of both tags; distance_mm: from the camera to the middle of the table; corner_px: 1 sigma per axis.

    print_mm: how far the edges are off, 1 sigma along and across each. four_axes: the wrist turns about the
    vertical only. The other arguments are as of `Simulation` and of `CellFacts`.
    """

    def __init__(
        self,
        seed: SeedSequence,
        *,
        edge_mm: float,
        distance_mm: float,
        corner_px: float,
        touch_mm: float,
        arm: ArmErrors,
        center_mm: float,
        motion: Motion = Motion.TURNTABLE,
        print_mm: float = 0.0,
        camera: Stability = Stability.FIXED,
        four_axes: bool = False,
    ) -> None:
        super().__init__(
            seed, touch_sigma_mm=touch_mm, arm=arm, center_sigma_mm=center_mm, one_axis=four_axes
        )
        self.edge_mm, self.corner_px = edge_mm, corner_px
        self._motion, self._print_mm, self._camera = motion, print_mm, camera
        off = self.rng.normal(size=(2, 2)) * print_mm
        self._printed = {TAG_A.id: edge_mm + off[0], TAG_B.id: edge_mm + off[1]}  # along, across
        self._K = np.asarray(super().facts().camera_matrix)
        R = Rotation.from_euler("xyz", [np.pi, _TILT_RAD, 0.2]).as_matrix()
        self.base_from_camera = Pose(R, self.center_in_base - distance_mm * R[:, 2])

    def facts(self) -> CellFacts:
        """With tags of this size on an object that moves so."""
        facts = super().facts()
        a, b = facts.tag_a or facts.tag_b, facts.tag_b
        spec = facts.object
        if self._motion is not Motion.TURNTABLE:
            spec = replace(spec, motion=self._motion, center_in_object=None)
        return replace(
            facts,
            tag_a=replace(a, size_mm=self.edge_mm),
            tag_b=replace(b, size_mm=self.edge_mm),
            tag_a_sigma_mm=self._print_mm,
            tag_b_sigma_mm=self._print_mm,
            object=spec,
            camera_stability=self._camera,
        )

    def _see(self, spec: TagSpec, truth: Pose) -> TagObservation:
        """The pose that fits the noisy corners best, its covariance that of their noise."""
        square = self.edge_mm * _SQUARE
        printed = _SQUARE * np.append(self._printed[spec.id], 0.0)
        pixels = self._project(truth @ printed) + self.rng.normal(size=(4, 2)) * self.corner_px
        pose = truth
        for _ in range(_STEPS):
            J = self._by_pose(pose @ square)
            step = np.linalg.lstsq(J, (pixels - self._project(pose @ square)).ravel())[0]
            turn = exp_rotation(step[3:])
            pose = Pose(turn @ pose.rotation, turn @ pose.translation + step[:3])
        J = self._by_pose(pose @ square)
        covariance = self.corner_px**2 * np.linalg.inv(J.T @ J)
        tag = replace(spec, size_mm=self.edge_mm)
        return TagObservation(
            tag, pose, frozen_array(covariance, 6, 6), frozen_array(pixels, 4, 2), self.corner_px
        )

    def _project(self, corners: Array) -> Array:
        """Pixels (4, 2)."""
        return np.asarray((corners @ self._K.T)[:, :2] / corners[:, 2:])

    def _by_pose(self, corners: Array) -> Array:
        """Derivative (8, 6) of the pixels by a left tangent of the pose."""
        rows = []
        for X, Y, Z in corners:
            pinhole = self._K[0, 0] / Z * np.array([[1, 0, -X / Z], [0, 1, -Y / Z]])
            rows.append(pinhole @ np.hstack([np.eye(3), -hat(np.array([X, Y, Z]))]))
        return np.vstack(rows)
