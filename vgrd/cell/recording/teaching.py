"""Teaching: samples become durable one by one; each reply says what is there and what is missing."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import structlog

from vgrd.calibration.checks import check_plan
from vgrd.calibration.first_samples import first_sample
from vgrd.calibration.harvest import STEADY_PX, Harvest, shift_px
from vgrd.cell.measuring import ROBOT_LOST_S, Measuring, Sight
from vgrd.cell.recording.counting import HARVESTED, counts, recording_of, repeat_in_words
from vgrd.cell.recording.questions import OpenQuestions
from vgrd.cell.recording.recorder import Recorder
from vgrd.cell.serving.faults import tcp_difference
from vgrd.devices import FlangeReading
from vgrd.errors import ControlError, DeviceUnavailable, InputError, NotSteady, TagNotSeen, TooOld
from vgrd.model import CellFacts, Observation, Plan, Touch
from vgrd.solving.advisor import Advisor
from vgrd.store.sessions import SampleKind, SessionWriter, Taught

if TYPE_CHECKING:
    from vgrd.config.cell_file import TouchSection

PICTURE_TIMEOUT_S = 5.0  # chosen: a device that was lost serves again within 5 s
PICTURES_AT_MOST = 4  # chosen: with three more tries a busy machine covers one with readings

_CLOSED = -1  # instead of a version: nothing changes a closed session

log = structlog.get_logger()


class Teaching:
    """The operator's session: started, filled sample by sample, stopped.

    A session of plan joint harvests: rests of arm and object become looks and spins unasked.
    """

    def __init__(
        self,
        measuring: Measuring,
        recorder: Recorder,
        facts: CellFacts,
        touch: "TouchSection",
        advisor: Advisor | None = None,
        now_name: Callable[[], str] = lambda: time.strftime("%Y%m%d-%H%M%S"),
        questions: OpenQuestions | None = None,
    ) -> None:
        self.measuring = measuring
        self.recorder = recorder
        self.facts = facts
        self.touch_sigma = touch
        self.advisor = advisor
        self.now_name = now_name
        self.questions = questions or OpenQuestions()
        self.last_session: Path | None = None
        self.last_touch: Touch | None = None
        self.harvest: Harvest | None = None
        self._pressed = 0

    @property
    def is_taking(self) -> bool:
        """Whether a sample that somebody asked for is being taken, stored and looked at."""
        return self._pressed > 0

    async def start(
        self, plan: str, session: str | None, *, harvest: bool = True
    ) -> dict[str, object]:
        """Open a session; the active TCP of the pendant and the steps of the robot are noted in it.

        harvest: whether rests become looks and spins unasked, in a session of plan joint.
        """
        if plan not in list(Plan):
            raise InputError(f"plan {plan!r}: choose one of {', '.join(Plan)}")
        check_plan(Plan(plan), self.facts)
        name = session or self.now_name()
        reading = self._reading()
        facts = replace(
            self.facts,
            wrist_from_tcp=reading.wrist_from_tcp,
            robot_step_mm=reading.step_mm,
            robot_step_rad=reading.step_rad,
        )
        await self.recorder.start(name, Plan(plan), facts)
        self.questions.forget()
        self.harvest = Harvest(facts) if harvest and plan == Plan.JOINT else None
        if self.advisor is not None:
            await self.advisor.start()
        return {
            "session": name,
            "plan": plan,
            "folder": str(self._session().path),
        } | self._warning()

    async def stop(self) -> dict[str, object]:
        """Close the session."""
        told = self._counts()
        self.harvest = None
        self.last_session = (
            self._session().path
        )  # at once: who looks meanwhile sees what is to be solved
        await self.recorder.stop()
        if self.advisor is not None:
            await self.advisor.close()
        return {
            "session": self.last_session.name,
            "folder": str(self.last_session),
            **told,
            **self._warning(),
        }

    async def look(self) -> dict[str, object]:
        """Record a hand-eye sample: robot at rest, tag A seen."""
        with self._asked():
            observation = await self._observe()
            if observation.tag_a is None:
                raise TagNotSeen(
                    "tag A at the flange is not in the picture: turn it to the camera"
                )
            return await self._store(SampleKind.LOOK, observation)

    async def spin(self) -> dict[str, object]:
        """Record the object as it stands now: robot at rest, tag B seen."""
        with self._asked():
            observation = await self._observe()
            if observation.tag_b is None:
                raise TagNotSeen("tag B on the object is not in the picture: move the arm aside")
            return await self._store(SampleKind.SPIN, observation)

    async def touch(
        self, target: str, kind: SampleKind, *, by_foot: bool = False
    ) -> dict[str, object]:
        """Record that the tip rests on a target (kind touch or verify).

        by_foot: nobody named the target, so two touches of one rest of the arm are one press too many.
        """
        self._check_target(target)
        with self._asked():
            touch = self._touch(target, await self._observe())
            if by_foot and _same_rest(touch, self.last_touch):
                raise NotSteady("the arm has not moved since the last touch")
            self.last_touch = touch
            return await self._store(kind, touch, by_foot=by_foot)

    async def tip_at(self, target: str) -> Touch:
        """That the tip rests on a target, recorded nowhere."""
        self._check_target(target)
        with self._asked():
            return self._touch(target, await self._stand())

    async def point(self, name: str) -> dict[str, object]:
        """Record a touch beside the object, of a fixed point, a plane or a ball; no picture is needed."""
        self._check_tcp()
        with self._asked():
            pose = await self.measuring.rest()
            sigma = self.touch_sigma
            touch = Touch(name, pose, sigma.lateral_sigma_mm, sigma.axial_sigma_mm)
            return await self._store(SampleKind.POINT, touch)

    def on_sight(self, sight: Sight) -> None:
        """Harvest the rest that a picture shows, unless somebody just takes a sample of it."""
        reading = self.measuring.robot.newest(ROBOT_LOST_S)
        if self.harvest is None or sight.base_from_wrist is None or reading is None:
            return
        if self._pressed or self.recorder.paused or self._tcp_trouble(reading):
            return
        harvested = self.harvest.consider(sight.observation())
        if harvested is not None:
            self.recorder.harvest(harvested)

    async def undo(self, which: str | None = None, number: int | None = None) -> dict[str, object]:
        """Take back the last sample that was asked for, of a kind, or harvested; number: that sample."""
        undone = await self.recorder.call(_undoing(which, number))
        seen = undone.value if isinstance(undone.value, Observation) else undone.value.observation
        if self.harvest is not None and seen is not None:
            self.harvest.refuse(seen)
        await self._review(undone.kind)
        return {**_described(undone, "undone"), **self._counts(), **await self._advice()}

    async def retag(self, number: int, target: str) -> dict[str, object]:
        """Book a touch under the target that was meant; its number stays."""
        self._check_target(target)
        renamed = await self.recorder.call(lambda writer: writer.retag(number, target))
        await self._review(renamed.kind)
        return {**_described(renamed, "retagged"), **self._counts(), **await self._advice()}

    def samples(self) -> dict[str, object]:
        """Every sample of the open session by its number, undone ones left out."""
        taught = self._session().taught
        return {"samples": {str(sample.sequence): sample_in_words(sample) for sample in taught}}

    async def advise(self, wait_s: float, **limits: str | float) -> Mapping[str, object]:
        """What the session, open or last, is worth and needs, as it is now; limits: policy, tilt_deg, yaw_deg.

        wait_s: how long to wait for what has to be computed; then what needs no computing.
        """
        if self.advisor is None:
            raise ControlError("this cell gives no advice")
        writer = self.recorder.writer
        if writer is not None:
            told = await self.advisor.full(writer.path, writer.version, wait_s, **limits)
            return self._with_first(told)
        if self.last_session is None:
            raise ControlError("no session was recorded yet: vgrd record start --plan joint")
        return await self.advisor.full(self.last_session, _CLOSED, wait_s, **limits)

    def status(self) -> dict[str, object]:
        """Describe the session for `vgrd status`."""
        if self.recorder.writer is None:
            last = self.last_session.name if self.last_session else None
            return {"session": None, "last": last}
        return {
            "session": self._session().header.name,
            "trouble": self.recorder.trouble,
            "warning": self.recorder.warning(),
            "dropped": self.recorder.dropped + sum(self._session().dropped),
            **self._counts(),
        }

    def _check_target(self, name: str) -> None:
        if name not in self.facts.object.targets:
            names = ", ".join(self.facts.object.targets)
            raise InputError(f"unknown target {name!r}; the cell file has: {names}")

    def _touch(self, target: str, observation: Observation) -> Touch:
        sigma = self.touch_sigma
        return Touch(
            target,
            observation.base_from_wrist,
            sigma.lateral_sigma_mm,
            sigma.axial_sigma_mm,
            observation,
        )

    async def _store(
        self, kind: SampleKind, value: Observation | Touch, *, by_foot: bool = False
    ) -> dict[str, object]:
        observation = value if isinstance(value, Observation) else value.observation
        replaced: tuple[Observation, ...] = ()
        if self.harvest is not None and observation is not None:
            replaced = self.harvest.note(observation)

        def store(writer: SessionWriter) -> int:
            number = writer.sample(kind, value, by_foot=by_foot)
            writer.give_back(replaced)
            return number

        sequence = await self.recorder.call(store)
        tags = [
            name for name in ("tag_a", "tag_b") if getattr(observation, name, None) is not None
        ]
        await self._review(kind)
        repeat = repeat_in_words(self._session().taught, sequence)
        result: dict[str, object] = {"sample": sequence, "kind": kind.value, "tags": tags}
        result |= {"remark": repeat} if repeat else {}
        return result | self._counts() | self._warning() | await self._advice()

    async def _review(self, kind: SampleKind) -> None:
        """Ask about the touches anew, where one came, went or got another name."""
        if kind in (SampleKind.TOUCH, SampleKind.VERIFY):
            await self.questions.review(self._session())

    async def _advice(self) -> dict[str, object]:
        """What comes of the samples so far, if it can be told without a delay."""
        if self.advisor is None:
            return {}
        writer = self._session()
        return {"advice": self._with_first(await self.advisor.brief(writer.path, writer.version))}

    def _with_first(self, advice: Mapping[str, object]) -> Mapping[str, object]:
        """Advice that is pending, with the sample that the plan asks for next: it needs no computing."""
        if "pending" not in advice or self.recorder.writer is None:
            return advice
        words = first_sample(recording_of(self.recorder.writer))
        kind = words.partition(" ")[0]
        return {**advice, "next": {"kind": kind, "words": words}} if words else advice

    async def _observe(self) -> Observation:
        """For a sample of the open session, with its TCP; as `_stand`."""
        self._session()
        self._check_tcp()
        return await self._stand()

    async def _stand(self) -> Observation:
        """Pose and picture of one rest; NotSteady when robot or object still move."""
        pose = await self.measuring.rest()
        spread_mm, spread_rad = self.measuring.limits.of(self._reading())
        first, second = await self._paired(), await self._paired()
        moved_mm, moved_rad = pose.distance(second.base_from_wrist)
        if moved_mm > 2 * spread_mm or moved_rad > 2 * spread_rad:  # each end is known so well
            raise NotSteady(
                f"the arm moved on by {moved_mm:.2f} mm before both pictures were taken: let it stand longer"
            )
        for name in ("tag_a", "tag_b"):
            moved_px = shift_px(getattr(first, name), getattr(second, name))
            if moved_px > STEADY_PX:
                raise NotSteady(
                    f"{name.replace('_', ' ')} moved {moved_px:.1f} px between two pictures: "
                    "wait until everything stands still"
                )
        return second

    async def _paired(self) -> Observation:
        """One picture with its flange pose; taken again where no readings cover it (a busy machine)."""
        for _ in range(PICTURES_AT_MOST - 1):
            try:
                return (await self.measuring.fresh(PICTURE_TIMEOUT_S)).observation()
            except TooOld as err:
                log.info("picture_again", reason=str(err))
        return (await self.measuring.fresh(PICTURE_TIMEOUT_S)).observation()

    def _warning(self) -> dict[str, object]:
        """What the operator should know of the recording, if there is something."""
        warning = self.recorder.warning()
        return {"warning": warning} if warning else {}

    def _reading(self) -> FlangeReading:
        reading = self.measuring.robot.newest(ROBOT_LOST_S)
        if reading is None:
            raise DeviceUnavailable(f"the robot is offline: {self.measuring.robot_trouble()}")
        return reading

    def _check_tcp(self) -> None:
        if trouble := self._tcp_trouble(self._reading()):
            raise ControlError(f"not recorded: {trouble}")

    def _tcp_trouble(self, reading: FlangeReading) -> str:
        """How the active TCP differs from the session's; empty when it does not."""
        session_tcp = self._session().header.facts.wrist_from_tcp
        return tcp_difference(session_tcp, reading.wrist_from_tcp)

    @contextmanager
    def _asked(self) -> Iterator[None]:
        """While somebody takes a sample of a rest it is not harvested."""
        self._pressed += 1
        try:
            yield
        finally:
            self._pressed -= 1

    def _session(self) -> SessionWriter:
        return self.recorder.open_session()

    def _counts(self) -> dict[str, object]:
        return {**counts(self._session()), **self.questions.told()}


def _same_rest(touch: Touch, last: Touch | None) -> bool:
    """Whether the arm has stood still from one touch to the other."""
    if last is None or last.observation is None or touch.observation is None:
        return False
    since_s = touch.observation.rest_since_s
    return since_s is not None and since_s <= last.observation.stamp_s


def _undoing(which: str | None, number: int | None) -> Callable[[SessionWriter], Taught]:
    """What takes back that sample; InputError for one that there is not."""
    if number is not None:
        if which is not None:
            raise InputError(f"undo either the last {which} or sample {number}, not both")
        return lambda writer: writer.undo_sample(number)
    if which is None:
        return lambda writer: writer.undo(harvested=False)
    if which == HARVESTED:
        return lambda writer: writer.undo(harvested=True)
    if which not in list(SampleKind):
        raise InputError(
            f"nothing undone: {which!r} is neither the number of a sample nor a kind of it: choose "
            f"one of {', '.join(SampleKind)}, {HARVESTED}"
        )
    return lambda writer: writer.undo(SampleKind(which))


def sample_in_words(sample: Taught) -> str:
    """Its kind, what it is of, and whether nobody asked for it."""
    of = f" {sample.value.target}" if isinstance(sample.value, Touch) else ""
    return f"{sample.kind.value}{of}{', harvested' if sample.harvested else ''}"


def _described(sample: Taught, done: str) -> dict[str, object]:
    """A sample that was changed, for a reply; done: what was done to it."""
    target = {"target": sample.value.target} if isinstance(sample.value, Touch) else {}
    told = {done: sample.kind.value, "sample": sample.sequence, **target}
    return {**told, "was_harvested": sample.harvested}
