"""A whole teaching session without processes: the same world, pictures and detector, its own time.

For tests that need many sessions, or a calibration before the daemon starts; nothing sleeps.
"""

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import numpy as np

from fakes.camera.render import Renderer
from fakes.camera.sensor import Picture
from fakes.cell.cell import cell_text
from fakes.cell.robot_link import Driver
from fakes.world.layout import FIXED_POINT
from fakes.world.poses import (
    WORK_ROTATION,
    fixed_point_poses,
    look_poses,
    retracted_pose,
    touch_tilts,
)
from fakes.world.world import World
from vgrd.config.cell_file import load_config
from vgrd.config.setup import cell_facts
from vgrd.devices import CameraImage
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.model import CellFacts, Observation, Plan, Recording, Touch
from vgrd.vision.tags.tag_finder import TagDetector

# Where nobody listens: for cell files from which only the facts are read.
NO_ROBOT = Driver("ur_rtde", {"host": "127.0.0.2"})
NO_CAMERA = Driver("aravis", {"address": "127.0.0.3"})


def facts_of(world: World, folder: Path) -> CellFacts:
    """Facts of the fake cell, by way of its cell file (written into `folder`)."""
    path = folder / "cell.toml"
    text = cell_text(world.layout, robot=NO_ROBOT, camera=NO_CAMERA, port=1502)
    path.write_text(text, encoding="utf-8")
    return cell_facts(load_config(path), world.arm.wrist_from_tcp)


class Rehearsal:
    """Teaches in the world's time, which advances by the moves only."""

    def __init__(self, world: World, facts: CellFacts, *, keeps_pictures: bool = False) -> None:
        self.world = world
        self.facts = facts
        self.now_s = 0.0
        self._rest_since_s = 0.0
        self.shots: list[tuple[Observation, Picture]] = []
        self._keeps_pictures = keeps_pictures
        self._renderer = Renderer(world.layout)
        self._detector = TagDetector(
            facts.camera_matrix,
            facts.distortion,
            facts.tags,
            facts.image_size_px,
            facts.tag_sigmas_mm,
        )

    def picture(self) -> Picture:
        """What the camera shows now."""
        return self._renderer.render(self.world.snapshot(self.now_s))

    def look(self) -> Observation:
        """What is seen now."""
        picture = self.picture()
        tags = self._detector.detect(picture)
        tag_a = tags.get(self.facts.tag_a.id) if self.facts.tag_a else None
        pose = self.world.reported_flange(self.now_s)
        tag_b = tags.get(self.facts.tag_b.id)
        observation = Observation(pose, self.now_s, tag_a, tag_b, self._rest_since_s)
        if self._keeps_pictures:
            self.shots.append((observation, picture))
        return observation

    def images(self, stamps: Collection[float]) -> Iterator[CameraImage]:
        """The kept pictures of these stamps, as `vgrd.store.sessions.iterate_images` gives them."""
        for i, (observation, picture) in enumerate(self.shots):
            if observation.stamp_s in stamps:
                yield CameraImage(picture, observation.stamp_s, i)

    def stand(self, flange: Pose, angle_rad: float | None = None) -> None:
        """Move the flange, and turn the table if an angle is given."""
        arrival = self._rest_since_s = self.world.move_flange(flange, self.now_s)
        if angle_rad is not None:
            arrival = max(arrival, self.world.turn_table(angle_rad, self.now_s))
        self.now_s = arrival + 1.0

    def turn(self, angle_rad: float) -> None:
        """Turn the table; the arm rests where it is."""
        self.now_s = self.world.turn_table(angle_rad, self.now_s) + 1.0

    def touch(self, name: str, rotation: Array, *, has_picture: bool = True) -> Touch:
        """Touch a target (or the spike) with a wrist orientation (3, 3)."""
        self._rest_since_s = self.world.jog_onto(name, rotation, self.now_s)
        self.now_s = self._rest_since_s + 1.0
        sigma = self.world.noise.touch_sigma_mm or 0.02
        observation = self.look() if has_picture else None
        pose = self.world.reported_flange(self.now_s)
        return Touch(name, pose, sigma, sigma, observation)

    def teach(
        self, *, looks: int = 8, spins: int = 10, tilted: int = 6, points: int = 10
    ) -> Recording:  # as many as `fakes.demo.show`
        """Record what the demo records."""
        layout, seed = self.world.layout, self.world.seed
        look_observations = [self._after(pose) for pose in look_poses(layout, looks, seed=seed)]
        angles = np.linspace(0, 2 * np.pi, spins, endpoint=False)
        self.stand(retracted_pose(self.world.layout))
        spin_observations = []
        for angle in angles:
            self.turn(float(angle))
            spin_observations.append(self.look())
        self.turn(0.0)
        names = list(self.world.targets)
        touches = [self.touch(name, WORK_ROTATION) for name in names]
        touches += self._tilted(names[:tilted])
        poses = fixed_point_poses(layout, points, seed=seed) if points else []
        spikes = [self.touch(FIXED_POINT, pose.rotation, has_picture=False) for pose in poses]
        return Recording(
            session="rehearsal",
            plan=Plan.JOINT,
            facts=self.facts,
            looks=tuple(look_observations),
            spins=tuple(spin_observations),
            touches=tuple(touches),
            points=tuple(spikes),
        )

    def _after(self, flange: Pose) -> Observation:
        self.stand(flange)
        return self.look()

    def _tilted(self, names: Sequence[str]) -> list[Touch]:
        tilts = touch_tilts(self.world.layout, list(names), seed=self.world.seed)
        return [
            self.touch(name, exp_rotation(tilt) @ WORK_ROTATION)
            for name, tilt in zip(names, tilts, strict=True)
        ]
