"""The measuring loop: takes pictures, finds tags, pairs them with the flange, tells whoever listens."""

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import structlog

from vgrd.cell.feeds import CameraFeed, HealthFeed, RobotFeed
from vgrd.clock import Clock
from vgrd.devices import CameraImage, FlangeReading, Pixels
from vgrd.errors import DeviceUnavailable, InputError, NotSteady, ObservationError, TooOld
from vgrd.geometry import Pose
from vgrd.model import CellFacts, Observation, TagObservation
from vgrd.observing.stillness import RestLimits, rest_pose

LOOP_S = 0.005
BEAT_S = 0.1
RETRIGGER_S = 3.5
EVALUATION_HANG_S = 2.0
ROBOT_STALE_S = 0.2
ROBOT_LOST_S = 1.0
HEALTH_STALE_S = 1.5
SETTLE_S = 0.5
READINGS_WITHIN_S = 3.0
CATCH_UP_S = 0.2

log = structlog.get_logger()


class Detector(Protocol):
    """Finds the known tags in grey pixels; `vgrd.vision.tags.TagDetector` in the product."""

    def detect(
        self, pixels: Pixels, around: Mapping[int, TagObservation] | None = None
    ) -> dict[int, TagObservation]:
        """Tags by id, looked for first near where they were seen before."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """One evaluated picture: the tags in it, and where the flange stood or why that is not known."""

    image: CameraImage
    tag_a: TagObservation | None
    tag_b: TagObservation | None
    base_from_wrist: Pose | None
    unpaired: ObservationError | None

    @property
    def stamp_s(self) -> float:
        """Mid-exposure on the cell clock."""
        return self.image.stamp_s

    def observation(self) -> Observation:
        """Pose and picture of one instant; raises NotSteady or TooOld when the robot was not at rest."""
        if self.base_from_wrist is None:
            raise self.unpaired or ObservationError("no flange pose belongs to the picture")
        return Observation(self.base_from_wrist, self.stamp_s, self.tag_a, self.tag_b)


class Measuring:
    """Owns the feeds and the detector.

    `sight` is the newest evaluated picture, `sight_of_object` the newest one that shows tag B.
    """

    def __init__(
        self,
        runtime_dir: Path,
        detector: Detector,
        facts: CellFacts,
        clock: Clock,
        rate_hz: float,
    ) -> None:
        self.robot = RobotFeed(runtime_dir, clock)
        self.camera = CameraFeed(runtime_dir, clock)
        self.health = {name: HealthFeed(runtime_dir, name) for name in ("robot", "camera")}
        self.detector = detector
        self.facts = facts
        self.clock = clock
        self.period_s = 1.0 / rate_hz
        self.limits = RestLimits()
        self.sight: Sight | None = None
        self.sight_of_object: Sight | None = None
        self.beat = 0
        self.on_readings: list[Callable[[Sequence[FlangeReading]], None]] = []
        self.on_sight: list[Callable[[Sight], None]] = []
        self._eyes = ThreadPoolExecutor(1, thread_name_prefix="vision")
        self._evaluating_since_s: float | None = None
        self._evaluation: asyncio.Task[None] | None = None
        self._unusable = ""
        self._last_tags: Mapping[int, TagObservation] = {}
        self._wishes: list[tuple[float, asyncio.Future[Sight]]] = []
        self._last_trigger_s = -self.period_s
        self._last_beat_s = 0.0

    async def run(self) -> None:
        """Loop until cancelled."""
        while True:
            self._step()
            await asyncio.sleep(LOOP_S)

    async def fresh(self, timeout_s: float) -> Sight:
        """Return a sight whose picture was taken after this call; DeviceUnavailable when none comes."""
        wish: asyncio.Future[Sight] = asyncio.get_running_loop().create_future()
        self._wishes.append((self.clock.monotonic(), wish))
        try:
            async with asyncio.timeout(timeout_s):
                return await wish
        except TimeoutError as err:
            raise DeviceUnavailable(
                f"no picture within {timeout_s:.1f} s: {self.camera_trouble() or 'the camera is slow'}"
            ) from err

    def robot_trouble(self) -> str:
        """Why the robot cannot be relied on now; empty when it can."""
        if self.robot.newest(ROBOT_STALE_S) is not None:
            return ""
        return self._device_words("robot") or "no flange reading"

    def camera_trouble(self) -> str:
        """Why the camera cannot be relied on now; empty when it can."""
        return self._device_words("camera") or self._unusable

    async def rest(self) -> Pose:
        """Flange pose from readings newer than this call; raises NotSteady, TooOld.

        The arm is given a moment to settle, the readings of a busy machine a moment to come.
        """
        start_s = self.clock.monotonic()
        while True:
            now = self.clock.monotonic()
            try:
                return rest_pose(self.robot.readings, max(start_s, self._newest_s()), self.limits)
            except TooOld:
                if now > start_s + READINGS_WITHIN_S:
                    raise
            except NotSteady:
                if self._newest_s() > start_s + SETTLE_S:
                    raise
            await asyncio.sleep(LOOP_S)

    def _newest_s(self) -> float:
        """Stamp of the newest flange reading."""
        return self.robot.readings[-1].stamp_s if self.robot.readings else -math.inf

    def _device_words(self, name: str) -> str:
        health = self.health[name].poll()
        if health is None:
            return f"the {name} process has not started yet"
        if health.state != "ok":
            return f"{health.state}: {health.detail}"
        if self.health[name].age_s(self.clock) > HEALTH_STALE_S:
            return f"the {name} process does not answer"
        return ""

    def _step(self) -> None:
        now = self.clock.monotonic()
        readings = self.robot.poll()
        for listener in self.on_readings if readings else ():
            listener(readings)
        if self._evaluation is not None and self._evaluation.done():
            self._evaluation.result()  # a fault in it is a fault of the loop: the gate starts us anew
            self._evaluation = None
        image = self.camera.newest()
        if image is not None and self._evaluation is None:
            self._evaluating_since_s = now
            self._evaluation = asyncio.create_task(self._evaluate(image))
        self._trigger(now)
        stuck = self._evaluating_since_s and now - self._evaluating_since_s > EVALUATION_HANG_S
        if now - self._last_beat_s >= BEAT_S and not stuck:
            self._last_beat_s = now
            self.beat += 1

    def _trigger(self, now: float) -> None:
        self._wishes = [wish for wish in self._wishes if not wish[1].done()]
        if self._evaluation is not None or 0 < self.camera.waiting_s() < RETRIGGER_S:
            return
        if self._wishes or now - self._last_trigger_s >= self.period_s:
            self._last_trigger_s = now
            self.camera.trigger()

    async def _evaluate(self, image: CameraImage) -> None:
        try:
            loop = asyncio.get_running_loop()
            tags = await loop.run_in_executor(
                self._eyes, self.detector.detect, image.pixels, self._last_tags
            )
            self._last_tags = tags
            await self._readings_until(image.stamp_s + self.limits.after_s)
            self._unusable = ""
            self._announce(self._pair(image, tags))
        except InputError as err:
            self._unusable = str(err)
            log.warning("picture_unusable", reason=self._unusable)
        finally:
            self._evaluating_since_s = None

    async def _readings_until(self, stamp_s: float) -> None:
        """Let the flange readings catch up with the picture."""
        end_s = self.clock.monotonic() + CATCH_UP_S
        while self.clock.monotonic() < end_s:
            if self.robot.readings and self.robot.readings[-1].stamp_s >= stamp_s:
                return
            await asyncio.sleep(LOOP_S)

    def _pair(self, image: CameraImage, tags: dict[int, TagObservation]) -> Sight:
        pose, unpaired = None, None
        try:
            pose = rest_pose(self.robot.readings, image.stamp_s, self.limits)
        except ObservationError as err:
            unpaired = err
        tag_a = tags.get(self.facts.tag_a.id) if self.facts.tag_a else None
        return Sight(image, tag_a, tags.get(self.facts.tag_b.id), pose, unpaired)

    def _announce(self, sight: Sight) -> None:
        self.sight = sight
        if sight.tag_b is not None:
            self.sight_of_object = sight
        for listener in self.on_sight:
            listener(sight)
        for asked_s, wish in self._wishes:
            if sight.stamp_s >= asked_s and not wish.done():
                wish.set_result(sight)
