"""The measuring loop: takes pictures, finds tags, pairs them with the flange, tells whoever listens."""

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import structlog

from vgrd.cell.detector import Detector
from vgrd.cell.feeds import CameraFeed, HealthFeed, RobotFeed
from vgrd.cell.schedule import PictureSchedule
from vgrd.clock import Clock
from vgrd.devices import CameraImage, FlangeReading
from vgrd.devices.passing import passing_pose
from vgrd.devices.rate import catch_up_s, reading_period_s, silence_limit_s
from vgrd.devices.rests import Rests
from vgrd.devices.stillness import RestLimits, is_covered, rest_pose, rest_pose_since
from vgrd.errors import DeviceUnavailable, InputError, NotSteady, ObservationError, TooOld
from vgrd.geometry import Pose
from vgrd.model import CellFacts, Observation, TagObservation

LOOP_S = 0.005  # chosen: a reading of a 125 Hz robot waits less than its period (8 ms)
BEAT_S = 0.1  # HB of the registers counts each 100 ms
RETRIGGER_S = 2.5  # longer than a device process waits for the picture (2 s)
EVALUATION_HANG_S = 2.0  # chosen: as long as a device may take for its picture; then HB stands
# Of a picture beyond its period: asked for once more and evaluated, none that still comes is later.
LATE_S = RETRIGGER_S + EVALUATION_HANG_S
ROBOT_LOST_S = 1.0  # for the TCP that is noted in a session; chosen: five periods of 5 Hz
HEALTH_STALE_S = 1.5  # a device whose process has been silent so long is refused without a try
BLIND_S = 0.2  # four missed beats of a device's process: with the registers' 40 ms below 260 ms
SETTLE_S = 0.5  # chosen: arms are said to tremble for 0.1 to 0.3 s after a move (not measured)
READINGS_WITHIN_S = 3.0  # chosen: a busy machine delivers readings late

log = structlog.get_logger()


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """One evaluated picture: the tags in it, and where the flange stood or why that is not known.

    rest_since_s: when the arm came to the rest in which the picture was taken. passing: where the
    flange passed, of an arm that was not at rest, None where that is not known. delay_s: so much after
    its stamp the picture was taken, by the clock of the poses.
    """

    image: CameraImage
    tag_a: TagObservation | None
    tag_b: TagObservation | None
    base_from_wrist: Pose | None
    unpaired: ObservationError | None
    rest_since_s: float | None = None
    passing: Pose | None = None
    delay_s: float = 0.0

    @property
    def stamp_s(self) -> float:
        """Mid-exposure on the cell clock."""
        return self.image.stamp_s

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole picture, not a region around tag B."""
        return self.image.region is None

    @property
    def is_at_rest(self) -> bool | None:
        """Whether the arm stood while it was taken; None where the readings do not tell."""
        if self.base_from_wrist is None and not isinstance(self.unpaired, NotSteady):
            return None
        return self.base_from_wrist is not None

    def observation(self) -> Observation:
        """Pose and picture of one instant; raises NotSteady or TooOld when the robot was not at rest."""
        if self.base_from_wrist is None:
            raise self.unpaired or ObservationError("no flange pose belongs to the picture")
        return Observation(
            self.base_from_wrist, self.stamp_s, self.tag_a, self.tag_b, self.rest_since_s
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Wish:
    """Somebody waits for a picture exposed after `since_s`; a region will do unless `whole`."""

    since_s: float
    whole: bool
    sight: asyncio.Future[Sight]


class Measuring:
    """Owns the feeds and the detector.

    `sight` is the newest evaluated whole picture, `sight_of_object` the newest one that shows tag B.
    While `watching`, pictures of the region around tag B are taken at the watch rate too; a camera that
    sends no regions takes whole ones. `on_watch` is called with every picture, `on_sight` with whole ones.
    delay_s: pictures were taken so much after their stamps, by the clock of the poses; only what pairs
    both goes by it, the age of a picture does not.
    """

    def __init__(
        self,
        runtime_dir: Path,
        detector: Detector,
        facts: CellFacts,
        clock: Clock,
        rate_hz: float,
        watch_rate_hz: float,
        delay_s: float = 0.0,
    ) -> None:
        self.delay_s = delay_s
        self.robot = RobotFeed(runtime_dir, clock)
        self.camera = CameraFeed(runtime_dir, clock)
        self.health = {name: HealthFeed(runtime_dir, name, clock) for name in ("robot", "camera")}
        self.detector = detector
        self.facts = facts
        self.clock = clock
        self.schedule = PictureSchedule(facts, rate_hz, watch_rate_hz)
        self.limits = RestLimits()
        self.rests = Rests(self.limits)
        self.sight: Sight | None = None
        self.sight_of_object: Sight | None = None
        self.beat = 0
        self.on_readings: list[Callable[[Sequence[FlangeReading]], None]] = []
        self.on_sight: list[Callable[[Sight], None]] = []
        self.on_watch: list[Callable[[Sight], None]] = []
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="vision")
        self._evaluating_since_s: float | None = None
        self._evaluation: asyncio.Task[None] | None = None
        self._unusable = ""
        self._last_tags: Mapping[int, TagObservation] = {}
        self._wishes: list[_Wish] = []
        self._camera_pid = 0
        self._last_beat_s = 0.0

    @property
    def period_s(self) -> float:
        """From one whole picture to the next."""
        return self.schedule.period_s

    @property
    def watch_period_s(self) -> float:
        """From one picture to the next while an answer stands."""
        return self.schedule.watch_period_s

    @property
    def watching(self) -> bool:
        """Whether an answer stands that pictures must vouch for."""
        return self.schedule.watching

    @watching.setter
    def watching(self, watching: bool) -> None:
        self.schedule.watching = watching

    async def run(self) -> None:
        """Loop until cancelled; a fault in an evaluation is a fault of the loop."""
        async with asyncio.TaskGroup() as tasks:
            while True:
                self._step(tasks)
                await asyncio.sleep(LOOP_S)

    async def fresh(self, timeout_s: float, *, whole: bool = True) -> Sight:
        """Return a sight whose picture was taken after this call; DeviceUnavailable when none comes.

        whole False: a picture of the region around tag B will do, which comes sooner.
        """
        wish = _Wish(self.clock.monotonic(), whole, asyncio.get_running_loop().create_future())
        self._wishes.append(wish)
        try:
            async with asyncio.timeout(timeout_s):
                return await wish.sight
        except TimeoutError as err:
            raise DeviceUnavailable(
                f"no picture within {timeout_s:.1f} s: {self.camera_trouble() or 'the camera is slow'}"
            ) from err

    def sight_of_now(self) -> Sight | None:
        """The newest whole picture while the camera works and the next one is not overdue."""
        sight = self.sight
        if sight is None or self.camera_trouble():
            return None
        age_s = self.clock.monotonic() - sight.stamp_s
        return sight if age_s <= self.period_s + LATE_S else None

    def robot_trouble(self) -> str:
        """Why the robot cannot be relied on now; empty when it can."""
        if self.reading() is not None:
            return ""
        return self._device_words("robot", HEALTH_STALE_S) or "no flange reading"

    def reading(self) -> FlangeReading | None:
        """The newest flange reading, None when the robot is silent for longer than its rate explains."""
        return self.robot.newest(silence_limit_s(self.robot.readings))

    def camera_trouble(self) -> str:
        """Why the camera cannot be relied on now; empty when it can."""
        return self._device_words("camera", HEALTH_STALE_S) or self._unusable

    def camera_blind(self) -> str:
        """Why nothing can be seen at this moment; empty while the camera's process lives and works."""
        return self._device_words("camera", BLIND_S) or self._unusable

    async def rest(self) -> Pose:
        """Flange pose from readings newer than this call; raises NotSteady, TooOld.

        The arm is given a moment to settle, the readings of a busy machine a moment to come.
        """
        start_s = self.clock.monotonic()
        while True:
            now = self.clock.monotonic()
            try:
                return rest_pose_since(self.robot.readings, start_s, self.limits)
            except TooOld:
                if now > start_s + READINGS_WITHIN_S:
                    raise
            except NotSteady:
                if self._newest_s() > start_s + self._settled_s():
                    raise
            await asyncio.sleep(LOOP_S)

    def _settled_s(self) -> float:
        """How long an arm may go on moving: the settling, and what it takes to see that it is over."""
        return SETTLE_S + self.limits.minimum_readings * reading_period_s(self.robot.readings)

    def _newest_s(self) -> float:
        """Stamp of the newest flange reading."""
        return self.robot.readings[-1].stamp_s if self.robot.readings else -math.inf

    def _device_words(self, name: str, stale_s: float) -> str:
        health = self.health[name].poll()
        if health is None:
            return f"the {name} process has not started yet"
        if health.state != "ok":
            return f"{health.state}: {health.detail}"
        if self.health[name].age_s > stale_s:
            return f"the {name} process does not answer"
        return ""

    def _step(self, tasks: asyncio.TaskGroup) -> None:
        now = self.clock.monotonic()
        readings = self.robot.poll()
        self.rests.add(readings)
        for listener in self.on_readings if readings else ():
            listener(readings)
        if self._evaluation is not None and self._evaluation.done():
            self._evaluation = None
        image = self.camera.newest()
        if image is not None and self._evaluation is None:
            self._evaluating_since_s = now
            self._evaluation = tasks.create_task(self._evaluate(image))
        self._trigger(now)
        is_stuck = self._evaluating_since_s and now - self._evaluating_since_s > EVALUATION_HANG_S
        if now - self._last_beat_s >= BEAT_S and not is_stuck:
            self._last_beat_s = now
            self.beat += 1

    def _trigger(self, now: float) -> None:
        self._wishes = [wish for wish in self._wishes if not wish.sight.done()]
        camera = self.health["camera"].poll()
        if camera is not None and camera.state == "ok" and camera.pid != self._camera_pid:
            self._camera_pid = camera.pid
            self.camera.forget()  # what an earlier process was asked for will never come
        if self._evaluation is not None or 0 < self.camera.waiting_s() < RETRIGGER_S:
            return
        is_whole_wanted = any(wish.whole for wish in self._wishes)
        if is_whole_wanted or self.schedule.is_whole_due(now):
            self.schedule.take_whole(now)
            self.camera.trigger(None)
        elif self._wishes or self.schedule.is_watch_due(now):
            self.camera.trigger(self.schedule.take_watch_picture(now))

    async def _evaluate(self, image: CameraImage) -> None:
        try:
            loop = asyncio.get_running_loop()
            _check_past(image, self.clock.monotonic())
            last_tags = self._last_tags
            if image.region is not None:
                tag_b_id = self.facts.tag_b.id
                last_tags = {i: tag for i, tag in last_tags.items() if i == tag_b_id}
            tags = await loop.run_in_executor(
                self._executor, self.detector.detect, image.pixels, last_tags, image.region
            )
            self._last_tags = tags if image.region is None else {**self._last_tags, **tags}
            if image.region is None:
                await self._readings_after(image.stamp_s + self.delay_s)
            self._unusable = ""
            self._announce(self._pair(image, tags))
        except InputError as err:
            self._unusable = str(err)
            log.warning("picture_unusable", reason=self._unusable)
        finally:
            self._evaluating_since_s = None

    async def _readings_after(self, stamp_s: float) -> None:
        """Let the flange readings catch up with the picture."""
        end_s = max(self.clock.monotonic(), stamp_s) + catch_up_s(self.robot.readings)
        while self.clock.monotonic() < end_s:
            if is_covered(self.robot.readings, stamp_s, self.limits):
                return
            await asyncio.sleep(LOOP_S)

    def _pair(self, image: CameraImage, tags: dict[int, TagObservation]) -> Sight:
        pose, passing = None, None
        unpaired: ObservationError | None = None
        taken_s = image.stamp_s + self.delay_s
        try:
            pose = rest_pose(self.robot.readings, taken_s, self.limits)
        except NotSteady as err:
            unpaired, passing = err, passing_pose(self.robot.readings, taken_s)
        except ObservationError as err:
            unpaired = err
        tag_a = tags.get(self.facts.tag_a.id) if self.facts.tag_a else None
        since_s = self.rests.since_s(taken_s)
        tag_b = tags.get(self.facts.tag_b.id)
        return Sight(image, tag_a, tag_b, pose, unpaired, since_s, passing, self.delay_s)

    def _announce(self, sight: Sight) -> None:
        self.schedule.note(sight.tag_b, whole=sight.is_whole)
        if sight.is_whole:
            self.sight = sight
            self.sight_of_object = sight if sight.tag_b is not None else self.sight_of_object
        for listener in (*self.on_watch, *(self.on_sight if sight.is_whole else ())):
            listener(sight)
        for wish in self._wishes:
            is_suitable = sight.is_whole or not wish.whole
            if is_suitable and sight.stamp_s >= wish.since_s and not wish.sight.done():
                wish.sight.set_result(sight)


def _check_past(image: CameraImage, now_s: float) -> None:
    """InputError for a picture of the future: it would vouch for what nobody has seen yet."""
    if not image.stamp_s <= now_s:
        raise InputError(
            f"a picture is stamped {image.stamp_s - now_s:.3f} s ahead of now: the driver takes the "
            "camera's clock for ours"
        )
