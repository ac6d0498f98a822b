"""A simulated cell whose world differs from what its file says."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.random import SeedSequence

from fakes.studies.misfits.prints import Print, seen_as
from fakes.studies.misfits.worlds import USUAL_CAD_MM, USUAL_EDGE_MM, Move, Touching, World
from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import COARSE
from fakes.world.simulation import TAG_A, TAG_B, WORK_ROTATION, Simulation
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.model import (
    CellFacts,
    Observation,
    TagObservation,
    TagSpec,
    frozen_array,
)

STATED_ARM = ArmErrors(
    sigma_mm=0.03, field_mm=0.15
)  # as UR states for the UR5e; the field is a guess
_BLUNDERS = 0.1  # share of the touches
_BLUNDER_MM = (1.0, 5.0)  # a guess: beside the hole, and in the next one's chamfer
_T3_VARIANCE = 3.0  # of Student's t of 3 degrees of freedom
_FILMED_S = 0.3  # between looks of an arm that is filmed on its way
_WAY_MM, _WAY_RAD = 80.0, (0.3, 0.3, 0.6)  # it swings so far either way, within the looks' volume
_SWING_RAD_S = (0.5, 1.5)  # a guess: 40 to 120 mm/s, turning back now and then, as a jog does


class MisfitCell(Simulation):
    """Draws as the world is, states what a file would that knows nothing of it."""

    def __init__(self, seed: SeedSequence, world: World, *, looks: int, pictures: int) -> None:
        """looks: of the session that will be recorded, pictures: of all of it."""
        draws, misfit = seed.spawn(2)
        field_mm = STATED_ARM.field_mm * world.field_times
        super().__init__(
            draws,
            vision=COARSE.finer(1 / world.vision_times),
            arm=replace(STATED_ARM, field_mm=field_mm),
        )
        self.world = world
        rng = np.random.default_rng(misfit)
        self._sign = float(rng.choice([-1, 1]))
        self._center = self._center_off(rng)
        self._prints = {
            TAG_A.id: self._printed(world.size_a),
            TAG_B.id: self._printed(world.size_b),
        }
        self._cad = {name: rng.normal(size=3) * world.cad_mm for name in self.targets}
        self._knock = _unit(rng) * world.camera_mm, _unit(rng) * world.camera_mm * 1e-3
        self._axis = np.radians(world.axis_tilt_deg) * _flat(rng) + (0, 0, 1)
        self._knocked_at = {
            Move.NEVER: -1,
            Move.BEFORE: looks,
            Move.DURING: int(rng.integers(looks + 1, pictures)),
            Move.AFTER: pictures,
        }[world.move]
        self._taken = 0

    def observe(
        self,
        reported: Pose,
        angle_rad: float,
        deviation: Array | None = None,
        *,
        tag_a: bool = True,
    ) -> Observation:
        """As the cell does, from where the camera stands by then."""
        if self._taken == self._knocked_at:
            displacement = Pose.exp(np.concatenate(self._knock))
            self.base_from_camera = Simulation.base_from_camera @ displacement
        self._taken += 1
        return super().observe(reported, angle_rad, deviation, tag_a=tag_a)

    def base_from_object(self, angle_rad: float) -> Pose:
        """Object on its turntable, whose axis need not stand straight in it."""
        axis = self._axis / np.linalg.norm(self._axis)
        return Pose.from_rotvec(axis * angle_rad, self.center_in_base)

    def looks(self, count: int) -> tuple[Observation, ...]:
        """As the cell takes them; or of an arm on its way, its pose told for another moment."""
        if not self.world.skew_s:
            return super().looks(count)
        rates = self.rng.uniform(*_SWING_RAD_S, size=6)
        phases = self.rng.uniform(-np.pi, np.pi, 6)

        def way(time_s: float) -> Pose:
            swing = np.sin(rates * time_s + phases)
            position = np.array([350.0, 0, 250]) + _WAY_MM * swing[:3]
            return Pose(WORK_ROTATION @ exp_rotation(_WAY_RAD * swing[3:]), position)

        skew_s = self._sign * self.world.skew_s
        times_s = [_FILMED_S * k for k in range(count)]
        seen = [self.observe(way(t + skew_s), 0.0) for t in times_s]
        start_s = seen[0].stamp_s
        return tuple(
            replace(look, base_from_wrist=way(t), stamp_s=start_s + t)
            for look, t in zip(seen, times_s, strict=True)
        )

    def touch_miss(self) -> Array:
        """As the cell does, or as this world has it."""
        miss = super().touch_miss() * self.world.touch_times
        match self.world.touching:
            case Touching.TAILS:
                draws = self.rng.standard_t(3, size=3) / np.sqrt(_T3_VARIANCE)
                return np.asarray(draws * self.sigmas_mm[0])
            case Touching.OUTLIERS if self.rng.uniform() < _BLUNDERS:
                return np.asarray(miss + _unit(self.rng) * self.rng.uniform(*_BLUNDER_MM))
            case _:
                return miss

    def facts(self) -> CellFacts:
        """What the cell file tells."""
        facts = super().facts()
        targets = {
            name: replace(target, point_in_object=frozen_array(target.cad + self._cad[name], 3))
            for name, target in self.targets.items()
        }
        spec = replace(
            facts.object,
            targets=MappingProxyType(targets),
            center_in_object=frozen_array(self._center, 3),
            center_sigma_mm=self.world.center_sigma_mm,
            cad_sigma_mm=USUAL_CAD_MM,
        )
        return replace(
            facts,
            object=spec,
            robot_sigma_mm=float(np.hypot(STATED_ARM.sigma_mm, STATED_ARM.field_mm)),
            tag_a_sigma_mm=USUAL_EDGE_MM,
            tag_b_sigma_mm=USUAL_EDGE_MM,
        )

    def _see(self, spec: TagSpec, truth: Pose) -> TagObservation:
        """What a detector that trusts the file makes of it, and the noise that it states."""
        printed = self._prints[spec.id]
        pose = truth
        if self.world.focal or not printed.is_as_stated:
            K = np.asarray(super().facts().camera_matrix)
            K_true = K.copy()
            K_true[[0, 1], [0, 1]] *= 1 + self._sign * self.world.focal
            pose = seen_as(spec, printed, truth, K_true, K)
        seen = super()._see(spec, pose)
        stated = np.asarray(seen.covariance) / self.world.vision_times**2
        return replace(seen, covariance=frozen_array(stated, 6, 6))

    def _printed(self, size: float) -> Print:
        ink_mm = self._sign * np.array([self.world.ink_x_mm, self.world.ink_y_mm])
        return Print(1 + self._sign * size, ink_mm)

    def _center_off(self, rng: np.random.Generator) -> Array:
        drawn = np.append(rng.normal(size=2) * self.world.center_drawn_mm, 0.0)
        return np.asarray(drawn + _flat(rng) * self.world.center_mm)


def _unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def _flat(rng: np.random.Generator) -> Array:
    turn = rng.uniform(-np.pi, np.pi)
    return np.array([np.cos(turn), np.sin(turn), 0.0])
