"""What the registers say: every refusal, the running answer, the object that moved, the TCP that changed."""

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fakes.cell.rehearsal import Rehearsal, facts_of
from fakes.testing import ManualClock
from fakes.world.layout import Layout
from fakes.world.poses import retracted_pose
from fakes.world.world import CellNoise, World
from vgrd.calibration.calibration import Calibration
from vgrd.calibration.joint.state import StepLayout
from vgrd.calibration.solve import calibrate_system
from vgrd.cell.measuring import Sight
from vgrd.cell.serving.answering import Limits, answer_request, check_request
from vgrd.cell.serving.faults import tcp_difference
from vgrd.cell.serving.service import Serving
from vgrd.cell.serving.vouching import MARGIN_S, Hold
from vgrd.devices import CameraImage, FlangeReading
from vgrd.errors import (
    ControlError,
    DeviceUnavailable,
    InputError,
    NotObservable,
    NotSteady,
    StoreError,
)
from vgrd.geometry import Pose
from vgrd.ipc.ring import RingReader, RingWriter
from vgrd.model import Policy, Verdict
from vgrd.registers import (
    PACKED_BYTES,
    REGISTER_KIND,
    REQUEST,
    Command,
    PolicyCode,
    RegisterImage,
    Request,
    RotationCode,
    State,
    Status,
)

LIMITS = Limits(Policy.FIXED, 3.0, 1.0, 0.9, 0.3)
CALIBRATION_ID = 0xC0FFEE
NONCE = 2**63 + 5


class Taught:
    """One perfect rehearsed cell, shared by the tests of this file."""

    def __init__(self, folder: Path) -> None:
        self.world = World(Layout(), 5, CellNoise.none())
        self.rehearsal = Rehearsal(self.world, facts_of(self.world, folder))
        recording = self.rehearsal.teach(looks=5, spins=4, points=0)
        self.calibration = calibrate_system(recording)
        self.rehearsal.stand(retracted_pose(), 0.7)
        self.sight = self.see(1000.0)

    def see(self, stamp_s: float) -> Sight:
        seen = self.rehearsal.look()
        image = CameraImage(np.zeros((2, 2), np.uint8), stamp_s, 1)
        return Sight(image, seen.tag_a, seen.tag_b, seen.base_from_wrist, None)


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory) -> Taught:
    return Taught(tmp_path_factory.mktemp("taught"))


def request(*, oriented: bool = True, **fields: int) -> Request:
    values = dict.fromkeys((field.name for field in REQUEST.fields), 0)
    values |= {"TRIG": 7, "CMD": Command.EC_FRESH, "POINT": 1} | fields
    return Request.parse(REQUEST.encode(values), NONCE, orientation_written=oriented)


def answered(taught: Taught, asked: Request, sight: Sight | None = None, now_s: float = 1000.5):
    answer, _ = answer_request(
        asked, taught.calibration, CALIBRATION_ID, sight or taught.sight, LIMITS, now_s, 1.7e9
    )
    return answer


def test_a_good_request_leads_the_true_tip_to_the_target(taught: Taught) -> None:
    for number in range(1, 7):
        asked = request(POINT=number)
        assert check_request(asked, taught.calibration) is None
        answer = answered(taught, asked)
        assert (answer.status, answer.echo, answer.point) == (Status.OK, 7, number)
        pose = Pose.from_rotvec(answer.rotation, np.array(answer.position_um) / 1000)
        assert np.linalg.norm(taught.world.miss_at(pose, f"P{number}", 0.7)) < 0.05
        assert answer.calibration_id == CALIBRATION_ID
        assert answer.valid_until_s == 1003.0
        assert answer.tags == 2


@pytest.mark.parametrize("code", list(RotationCode))
def test_all_rotation_formats_mean_the_same_orientation(
    taught: Taught, code: RotationCode
) -> None:
    from scipy.spatial.transform import Rotation

    answer = answered(taught, request(OPT=code << 4))
    euler = {RotationCode.RPY: "xyz", RotationCode.KUKA_ABC: "ZYX", RotationCode.ZYZ: "ZYZ"}
    turned = (
        Rotation.from_rotvec(answer.rotation)
        if code is RotationCode.ROTVEC
        else Rotation.from_euler(euler[code], answer.rotation, degrees=True)
    )
    reference = Rotation.from_rotvec(answered(taught, request()).rotation)
    assert (turned.inv() * reference).magnitude() < 1e-9


@pytest.mark.parametrize("code", list(RotationCode))
def test_the_tip_meets_the_target_with_the_wrist_as_the_robot_requests(
    taught: Taught, code: RotationCode
) -> None:
    from scipy.spatial.transform import Rotation

    work = Rotation.from_euler("xyz", (170.0, 12.0, 35.0), degrees=True)
    euler = {RotationCode.RPY: "xyz", RotationCode.KUKA_ABC: "ZYX", RotationCode.ZYZ: "ZYZ"}
    if code is RotationCode.ROTVEC:
        values = work.as_rotvec() * 1e6
    else:
        values = work.as_euler(euler[code], degrees=True) * 1e4
    x, y, z = (round(value) for value in values)
    options = PolicyCode.REQUESTED << 8 | code << 4
    answer = answered(taught, request(OPT=options, ORI_RX=x, ORI_RY=y, ORI_RZ=z))
    assert answer.status is Status.OK
    pose = Pose(work.as_matrix(), np.array(answer.position_um) / 1000)
    assert np.linalg.norm(taught.world.miss_at(pose, "P1", 0.7)) < 0.08


def test_the_wrist_turns_with_the_object_when_it_is_to_follow(taught: Taught) -> None:
    fixed = answered(taught, request(OPT=PolicyCode.FIXED << 8))
    follow = answered(taught, request(OPT=PolicyCode.FOLLOW << 8))
    turn = Pose.from_rotvec(fixed.rotation).inverse() @ Pose.from_rotvec(follow.rotation)
    assert np.linalg.norm(turn.rotvec()) == pytest.approx(0.7, abs=2e-3)
    pose = Pose.from_rotvec(follow.rotation, np.array(follow.position_um) / 1000)
    assert np.linalg.norm(taught.world.miss_at(pose, "P1", 0.7)) < 0.08


def test_the_tcp_pose_is_given_where_the_tcp_is_known(taught: Taught) -> None:
    flange, tcp = answered(taught, request()), answered(taught, request(OPT=2))
    way = (np.array(tcp.position_um) - np.array(flange.position_um)) / 1000
    assert np.linalg.norm(way) == pytest.approx(
        np.linalg.norm(taught.world.layout.tcp_in_wrist), abs=0.05
    )


@pytest.mark.parametrize(
    ("fields", "status", "detail"),
    [
        ({"CMD": 3}, Status.UNKNOWN_COMMAND, 3),
        ({"CMD": 99}, Status.UNKNOWN_COMMAND, 99),
        ({"POINT": 77}, Status.UNKNOWN_POINT, 77),
        ({"OPT": 9 << 4}, Status.BAD_PARAMETER, 3),
        *(({"OPT": 1 << bit}, Status.BAD_PARAMETER, 3) for bit in (2, 3, *range(10, 16))),
        ({"OPT": 3 << 8, "oriented": False}, Status.BAD_PARAMETER, 23),
        ({"CMD": 5}, Status.UNKNOWN_COMMAND, 5),
        ({"CMD": 6}, Status.UNKNOWN_COMMAND, 6),
        ({"ROBOT": 2}, Status.BAD_PARAMETER, 4),
        ({"TOOL": 5}, Status.BAD_PARAMETER, 6),
    ],
)
def test_what_cannot_be_served_is_refused_with_its_code(
    taught: Taught, fields: dict[str, int], status: Status, detail: int
) -> None:
    refusal = check_request(request(**fields), taught.calibration)
    assert refusal is not None
    assert (refusal.status, refusal.detail, refusal.echo) == (status, detail, 7)


@pytest.mark.parametrize("register", [10, 21, 29, 31])
def test_a_value_in_a_reserved_register_is_refused_with_the_register(
    taught: Taught, register: int
) -> None:
    registers = bytearray(request().registers)
    registers[2 * register] = 1
    refusal = check_request(Request.parse(bytes(registers), NONCE), taught.calibration)
    assert refusal is not None
    assert (refusal.status, refusal.detail) == (Status.BAD_PARAMETER, register)


def test_a_client_that_counts_in_clhb_is_not_refused(taught: Taught) -> None:
    assert check_request(request(CLHB=0xFFFF), taught.calibration) is None


def test_a_tcp_that_is_not_known_is_not_served(taught: Taught) -> None:
    solution = taught.calibration.solution
    left_open = np.zeros((len(solution.covariance), 1))
    left_open[StepLayout.TCP] = 500.0
    unknown = replace(taught.calibration, solution=replace(solution, undetermined=left_open))
    assert unknown.tcp is None
    for options in (2, 3 << 8):
        refusal = check_request(request(OPT=options), unknown)
        assert refusal is not None
        assert (refusal.status, refusal.detail) == (Status.BAD_PARAMETER, 3)


def test_each_doubt_has_its_status(taught: Taught) -> None:
    blind = replace(taught.sight, tag_b=None)
    moving = replace(taught.sight, base_from_wrist=None, unpaired=NotSteady("moving"))
    assert answered(taught, request(), blind).status is Status.TAG_B_NOT_FOUND
    assert answered(taught, request(OPT=1), moving).status is Status.ROBOT_MOVING
    assert answered(taught, request(), moving).status is Status.OK
    assert answered(taught, request(), now_s=1003.0).status is Status.IMAGE_TOO_OLD
    assert answered(taught, request(MAXAGE=100)).status is Status.IMAGE_TOO_OLD
    assert answered(taught, request(MAXU95=1)).status is Status.UNCERTAINTY_TOO_HIGH


class StillMeasuring:
    """A measuring loop of the tests: what it sees is set by hand.

    `coming`: pictures that answer the next wishes; the last of them goes on being seen.
    """

    def __init__(self, clock: ManualClock, sight: Sight, tcp: Pose | None) -> None:
        self.clock = clock
        self.sight: Sight | None = sight
        self.coming: list[Sight] = []
        self.tcp = tcp
        self.flange = Pose.identity()
        self.beat = 0
        self.period_s, self.watch_period_s = 0.5, 0.1
        self.watching = False
        self.on_watch: list[Callable[[Sight], None]] = []
        self.robot = self
        self.running = True
        self.wishes = 0
        self.troubles = {"robot": "", "camera": "", "blind": ""}

    def newest(self, within_s: float) -> FlangeReading | None:
        del within_s
        if self.troubles["robot"]:
            return None
        now = self.clock.monotonic()
        return FlangeReading(self.flange, self.tcp, now, now, running=self.running)

    def reading(self) -> FlangeReading | None:
        return self.newest(0.0)

    def robot_trouble(self) -> str:
        return self.troubles["robot"]

    def camera_trouble(self) -> str:
        return self.troubles["camera"]

    def camera_blind(self) -> str:
        return self.troubles["camera"] or self.troubles["blind"]

    async def fresh(self, timeout_s: float, *, whole: bool = True) -> Sight:
        del whole
        self.wishes += 1
        if self.coming:
            self.show(self.coming.pop(0))
        elif self.sight is not None:
            self.show(at(self.sight, self.clock.monotonic()))
        if self.sight is None:
            raise DeviceUnavailable(f"no picture within {timeout_s} s")
        return self.sight

    def watched(self, sight: Sight) -> None:
        """A region is seen, not the whole picture."""
        for listener in self.on_watch:
            listener(sight)

    def show(self, sight: Sight) -> None:
        self.sight = sight
        for listener in self.on_watch:
            listener(sight)


def at(sight: Sight, stamp_s: float) -> Sight:
    """The same view, seen at another time."""
    return replace(sight, image=replace(sight.image, stamp_s=stamp_s))


class Bench:
    """A `Serving` on a bench: request it, read its registers."""

    def __init__(self, folder: Path, taught: Taught, limits: Limits = LIMITS) -> None:
        self.clock = ManualClock(1000.2)
        facts = taught.calibration.facts
        self.measuring = StillMeasuring(self.clock, taught.sight, facts.wrist_from_tcp)
        writer = RingWriter.create(folder / "registers.ring", 4, PACKED_BYTES, REGISTER_KIND)
        self.serving = Serving(self.measuring, writer, limits, 1.5, self.clock, simulation=True)  # type: ignore[arg-type]
        self.serving.use(taught.calibration, CALIBRATION_ID)
        self.reader = RingReader.open(folder / "registers.ring", REGISTER_KIND)
        self.measuring.show(taught.sight)

    def ask(self, **fields: int) -> RegisterImage:
        async def serve() -> None:
            async with asyncio.TaskGroup() as self.serving._tasks:
                self.serving.request(request(**fields))

        asyncio.run(serve())
        image = self.read()
        assert image.answer.nonce == NONCE
        return image

    def read(self) -> RegisterImage:
        self.serving.faults.check_tcp()
        self.serving.publish()
        message = self.reader.newest()
        assert message is not None
        return RegisterImage.unpack(message.payload)

    def status_after(self, seconds: float) -> Status:
        """What a robot reads so much later, and that the registers had expired by themselves if it is over."""
        until_s = self.read().answer.valid_until_s
        self.clock.sleep(seconds)
        status = self.read().answer.status
        assert status.is_ok or self.clock.monotonic() >= until_s
        return status


@pytest.fixture
def bench(tmp_path: Path, taught: Taught) -> Iterator[Bench]:
    bench = Bench(tmp_path, taught)
    yield bench
    with contextlib.suppress(ValueError):
        bench.reader.close()


def turned(taught: Taught, angle_rad: float, stamp_s: float) -> Sight:
    """What is seen when the table has turned."""
    taught.rehearsal.stand(retracted_pose(), 0.7 + angle_rad)
    try:
        return taught.see(stamp_s)
    finally:
        taught.rehearsal.stand(retracted_pose(), 0.7)


def hidden(sight: Sight, stamp_s: float) -> Sight:
    return replace(at(sight, stamp_s), tag_b=None)


def test_an_answer_stands_until_the_object_moves(bench: Bench, taught: Taught) -> None:
    assert bench.ask().answer.status is Status.OK
    assert bench.measuring.watching
    bench.measuring.show(at(taught.sight, 1000.3))
    assert bench.read().answer.status is Status.OK
    bench.measuring.show(turned(taught, 0.02, 1000.4))
    assert bench.read().answer.status is Status.OBJECT_MOVED
    assert not bench.measuring.watching
    bench.measuring.show(at(taught.sight, 1000.5))
    assert bench.read().answer.status is Status.OBJECT_MOVED


@pytest.mark.parametrize("trouble", ["robot", "blind", "camera"])
def test_an_answer_that_a_fault_has_ended_does_not_come_back_with_its_cause_gone(
    bench: Bench, trouble: str
) -> None:
    assert bench.ask().answer.status is Status.OK
    before = bench.read().answer.seq
    bench.measuring.troubles[trouble] = "gone"
    assert not bench.read().answer.status.is_ok
    bench.measuring.troubles[trouble] = ""
    image = bench.read()
    assert not image.answer.status.is_ok
    assert image.answer.seq != before
    assert image.state & State.READY
    assert bench.ask().answer.status is Status.OK


def test_without_pictures_an_answer_expires_in_the_registers_after_period_latency_and_margin(
    bench: Bench, taught: Taught
) -> None:
    """The camera froze or is off the net; the registers need nobody to tell them."""
    vouch = bench.serving.vouch
    assert bench.ask().answer.status is Status.OK
    for _ in range(5):
        bench.clock.sleep(0.1)
        bench.measuring.show(at(taught.sight, bench.clock.monotonic() - 0.03))
    assert vouch.latency_s <= 0.2 + 1e-9
    assert bench.read().answer.valid_until_s == pytest.approx(vouch.until_s)
    last_s = bench.measuring.sight.stamp_s  # type: ignore[union-attr]
    assert vouch.until_s == pytest.approx(last_s + vouch.span_s)
    bench.clock.now_s = vouch.until_s - 0.001
    assert bench.read().answer.status is Status.OK
    assert bench.status_after(0.002) is Status.GRAB_TIMEOUT


def test_the_first_picture_after_an_answer_must_come_in_time(bench: Bench) -> None:
    assert bench.ask().answer.status is Status.OK
    vouch = bench.serving.vouch
    assert bench.status_after(vouch.interval_s + MARGIN_S - 0.01) is Status.OK
    assert bench.status_after(0.02) is Status.GRAB_TIMEOUT


def test_pictures_never_make_an_answer_older_than_it_may_be(bench: Bench, taught: Taught) -> None:
    assert bench.ask().answer.status is Status.OK
    until_s = taught.sight.stamp_s + LIMITS.max_age_s
    while bench.clock.monotonic() < until_s + 1.0:
        bench.clock.sleep(0.05)
        bench.measuring.show(at(taught.sight, bench.clock.monotonic() - 0.02))
        assert bench.read().answer.valid_until_s <= bench.serving.answer.captured_s + 3.0


def test_a_hidden_tag_ends_the_answer(bench: Bench, taught: Taught) -> None:
    bench.ask()
    bench.measuring.show(hidden(taught.sight, 1000.3))
    assert bench.read().answer.status is Status.TAG_B_NOT_FOUND
    bench.measuring.show(at(taught.sight, 1000.4))
    assert bench.read().answer.status is Status.TAG_B_NOT_FOUND


class TestHold:
    """hidden_tag = "hold": bounded in time, and to an arm that may well hide the tag itself."""

    LIMITS = replace(LIMITS, hold=Hold(1.0, 60.0))

    @pytest.fixture
    def bench(self, tmp_path: Path, taught: Taught) -> Bench:
        bench = Bench(tmp_path, taught, self.LIMITS)
        image = bench.ask()
        assert image.answer.status is Status.OK
        position_mm = np.array(image.answer.position_um) / 1000
        bench.measuring.flange = Pose(np.eye(3), position_mm + np.array((0, 0, 50.0)))
        return bench

    def test_an_arm_near_the_target_may_hide_the_tag_for_a_while(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.show(hidden(taught.sight, 1000.3))
        image = bench.read()
        assert image.answer.status is Status.OK
        assert image.state & State.HELD
        seen_s = bench.serving.standing.basis.latest_stamp_s
        while (
            bench.clock.monotonic() < seen_s + 0.9
        ):  # pictures without the tag do not lengthen it
            bench.clock.sleep(0.1)
            bench.measuring.show(hidden(taught.sight, bench.clock.monotonic() - 0.02))
            assert bench.read().answer.status is Status.OK
        bench.measuring.show(hidden(taught.sight, seen_s + 0.98))
        bench.clock.now_s = seen_s + 0.99
        assert bench.read().answer.status is Status.OK
        assert bench.status_after(0.02) is Status.TAG_B_NOT_FOUND

    def test_a_camera_that_freezes_ends_it_as_it_ends_every_answer(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.show(hidden(taught.sight, 1000.25))
        assert bench.read().answer.status is Status.OK
        until_s = bench.serving.vouch.until_s
        assert until_s < bench.serving.standing.basis.latest_stamp_s + 1.0
        bench.clock.now_s = until_s + 0.001
        assert bench.read().answer.status is Status.GRAB_TIMEOUT

    def test_it_goes_on_when_the_tag_comes_back_in_its_place_and_ends_when_elsewhere(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.show(hidden(taught.sight, 1000.3))
        bench.clock.sleep(0.3)
        bench.measuring.show(at(taught.sight, bench.clock.monotonic()))
        image = bench.read()
        assert image.answer.status is Status.OK
        assert not image.state & State.HELD
        assert image.answer.valid_until_s < bench.clock.monotonic() + 1.0
        bench.measuring.show(hidden(taught.sight, bench.clock.monotonic() + 0.01))
        bench.measuring.show(turned(taught, 0.02, bench.clock.monotonic() + 0.02))
        assert bench.read().answer.status is Status.OBJECT_MOVED

    def test_an_arm_that_is_away_or_goes_away_cannot_be_what_hides_it(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.show(hidden(taught.sight, 1000.3))
        assert bench.read().answer.status is Status.OK
        away_mm = bench.measuring.flange.translation + np.array((0, 0, 20.0))
        bench.measuring.flange = Pose(np.eye(3), away_mm)
        assert bench.read().answer.status is Status.TAG_B_NOT_FOUND

    @pytest.mark.parametrize("trouble", ["robot", "blind", "camera"])
    def test_it_ends_with_the_camera_or_the_robot(
        self, bench: Bench, taught: Taught, trouble: str
    ) -> None:
        bench.measuring.show(hidden(taught.sight, 1000.3))
        bench.measuring.troubles[trouble] = "gone"
        assert not bench.read().answer.status.is_ok


class TestNewest:
    """EC_NEWEST rests on the newest picture of all, and that must be new."""

    def ask(self, bench: Bench) -> Status:
        return bench.ask(CMD=Command.EC_NEWEST).answer.status

    def test_a_picture_that_a_newer_region_disproved_is_not_served_again(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.show(at(taught.sight, 1000.1))
        assert self.ask(bench) is Status.OK
        moved = turned(taught, 0.02, 1000.25)
        bench.measuring.watched(moved)
        assert bench.read().answer.status is Status.OBJECT_MOVED
        bench.measuring.sight = at(taught.sight, 1000.1)
        bench.measuring.coming = [turned(taught, 0.02, 1000.3)]
        image = bench.ask(CMD=Command.EC_NEWEST)
        assert bench.measuring.wishes >= 1
        assert image.answer.captured_s > 1000.2

    def test_a_region_without_the_tag_is_newer_evidence_too(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.show(at(taught.sight, 1000.1))
        bench.measuring.watched(hidden(taught.sight, 1000.25))
        bench.measuring.coming = [hidden(taught.sight, 1000.3)]
        assert self.ask(bench) is Status.TAG_B_NOT_FOUND

    def test_a_camera_that_hangs_is_not_believed_for_its_last_picture(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.show(at(taught.sight, 1000.1))
        assert self.ask(bench) is Status.OK
        bench.clock.sleep(1.0)
        bench.measuring.sight, kept = None, bench.measuring.sight
        assert self.ask(bench) is Status.GRAB_TIMEOUT
        bench.measuring.sight = kept
        assert self.ask(bench) is Status.OK  # with a picture of now
        assert bench.serving.answer.captured_s > 1001.0

    def test_a_picture_after_the_answered_one_is_heard_before_the_answer_is_given(
        self, bench: Bench, taught: Taught
    ) -> None:
        fresh = bench.measuring.fresh

        async def then_moved(timeout_s: float, *, whole: bool = True) -> Sight:
            sight = await fresh(timeout_s, whole=whole)
            bench.measuring.watched(turned(taught, 0.02, sight.stamp_s + 0.05))
            return sight

        bench.measuring.fresh = then_moved  # type: ignore[method-assign]
        assert bench.ask().answer.status is Status.OBJECT_MOVED


def test_an_answer_that_is_too_old_ends_and_is_watched_no_more(
    bench: Bench, taught: Taught
) -> None:
    assert bench.ask().answer.status is Status.OK
    until_s = bench.read().answer.captured_s + LIMITS.max_age_s
    while bench.clock.monotonic() < until_s:
        bench.clock.sleep(0.05)
        bench.measuring.show(at(taught.sight, bench.clock.monotonic() - 0.02))
    assert bench.read().answer.status is Status.IMAGE_TOO_OLD
    assert not bench.measuring.watching


class TestAgreement:
    """One picture may be of a moving object: OK needs two that agree."""

    def test_an_earlier_picture_that_agrees_saves_the_second(self, bench: Bench) -> None:
        assert bench.ask().answer.status is Status.OK
        assert bench.measuring.wishes == 1

    def test_a_turned_table_takes_a_second_picture_and_is_answered_where_it_stands(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.coming = [turned(taught, 0.3, 1000.21), turned(taught, 0.3, 1000.25)]
        image = bench.ask()
        assert image.answer.status is Status.OK
        assert bench.measuring.wishes == 2
        pose = Pose.from_rotvec(image.answer.rotation, np.array(image.answer.position_um) / 1000)
        assert np.linalg.norm(taught.world.miss_at(pose, "P1", 1.0)) < 0.1

    def test_a_table_that_turns_during_the_request_is_refused(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.coming = [turned(taught, 0.3, 1000.21), turned(taught, 0.31, 1000.25)]
        assert bench.ask().answer.status is Status.OBJECT_MOVED

    def test_a_tag_that_the_second_picture_does_not_show_is_refused(
        self, bench: Bench, taught: Taught
    ) -> None:
        bench.measuring.coming = [turned(taught, 0.3, 1000.21), hidden(taught.sight, 1000.25)]
        assert bench.ask().answer.status is Status.TAG_B_NOT_FOUND

    def test_a_picture_of_long_ago_agrees_with_nothing(self, bench: Bench) -> None:
        bench.clock.sleep(10.0)
        assert bench.ask().answer.status is Status.OK
        assert bench.measuring.wishes == 2


@pytest.mark.parametrize("moment", ["picture", "second"])
def test_a_calibration_activated_during_a_request_ends_it(
    bench: Bench, taught: Taught, moment: str
) -> None:
    """Neither the old one's coordinate nor its identity may come out afterwards."""
    other = replace(taught.calibration, id="cal-000009")
    turning = moment == "second"
    bench.measuring.coming = [turned(taught, 0.3, 1000.21), turned(taught, 0.3, 1000.25)]
    fresh = bench.measuring.fresh

    async def switching(timeout_s: float, *, whole: bool = True) -> Sight:
        sight = await fresh(timeout_s, whole=whole)
        if whole is not turning:
            bench.serving.use(other, 77)
        return sight

    bench.measuring.fresh = switching  # type: ignore[method-assign]
    assert bench.ask().answer.status is Status.CALIBRATION_MISMATCH


class Unforeseen(Exception):
    """A fault of ours."""


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (NotObservable("no", rank=1, unknowns=2), Status.CALIBRATION_MISMATCH),
        (InputError("no pivot"), Status.BAD_PARAMETER),
        (np.linalg.LinAlgError("singular"), Status.INTERNAL_ERROR),
        (StoreError("disk"), Status.INTERNAL_ERROR),
    ],
)
def test_every_error_of_a_request_ends_it_with_a_status(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, error: Exception, status: Status
) -> None:
    monkeypatch.setattr("vgrd.cell.serving.service.answer_request", raising(error))
    image = bench.ask()
    assert (image.answer.status, image.answer.echo) == (status, 7)
    monkeypatch.undo()
    assert bench.ask(TRIG=8).answer.status is Status.OK


def test_a_fault_of_ours_ends_the_request_with_900_and_then_the_process(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vgrd.cell.serving.service.answer_request", raising(Unforeseen()))
    with pytest.raises(ExceptionGroup):
        bench.ask()
    image = bench.read()
    assert (image.answer.status, image.answer.echo) == (Status.INTERNAL_ERROR, 7)


def raising(error: Exception) -> Callable[..., None]:
    def fail(*_: object) -> None:
        raise error

    return fail


@pytest.mark.parametrize(
    ("spoil", "status"),
    [
        (lambda m: m.troubles.update(robot="gone"), Status.ROBOT_OFFLINE),
        (lambda m: setattr(m, "running", False), Status.ROBOT_SAFETY_STOP),
        (lambda m: setattr(m, "tcp", Pose.identity()), Status.TCP_OFFSET_CHANGED),
    ],
)
def test_a_fault_of_the_robot_withdraws_the_answer(
    bench: Bench, spoil: Callable[[StillMeasuring], None], status: Status
) -> None:
    assert bench.ask().answer.status is Status.OK
    spoil(bench.measuring)
    image = bench.read()
    assert image.answer.status is status
    assert not image.state & State.READY
    assert bench.ask().answer.status is status


def test_a_changed_tcp_stays_a_fault_until_it_is_confirmed(bench: Bench) -> None:
    bench.ask()
    right, bench.measuring.tcp = bench.measuring.tcp, Pose.from_rotvec((0, 0, 0.01))
    assert bench.read().answer.status is Status.TCP_OFFSET_CHANGED
    with pytest.raises(ControlError, match="still there"):
        bench.serving.confirm()
    bench.measuring.tcp = right
    assert bench.read().answer.status is Status.TCP_OFFSET_CHANGED
    bench.serving.confirm()
    assert bench.ask().answer.status is Status.OK


def test_a_latched_fault_is_not_confirmed_while_the_robot_tells_nothing(bench: Bench) -> None:
    bench.ask()
    right, bench.measuring.tcp = bench.measuring.tcp, Pose.from_rotvec((0, 0, 0.01))
    assert bench.read().answer.status is Status.TCP_OFFSET_CHANGED
    bench.measuring.troubles["robot"] = "gone"
    with pytest.raises(ControlError, match="nobody can tell"):
        bench.serving.confirm()
    bench.measuring.troubles["robot"], bench.measuring.tcp = "", right
    assert bench.read().answer.status is Status.TCP_OFFSET_CHANGED
    bench.serving.confirm()
    assert bench.ask().answer.status is Status.OK


def test_a_latch_and_its_end_are_handed_on_to_be_kept(bench: Bench) -> None:
    kept: list[object] = []
    bench.serving.faults.on_latch.append(kept.append)
    right, bench.measuring.tcp = bench.measuring.tcp, Pose.from_rotvec((0, 0, 0.01))
    bench.read()
    bench.read()
    bench.measuring.tcp = right
    assert [status for status, _ in kept] == [Status.TCP_OFFSET_CHANGED]  # type: ignore[misc]
    bench.serving.confirm()
    assert kept[1:] == [None]


def test_a_camera_without_pictures_is_told(bench: Bench) -> None:
    bench.measuring.sight = None
    assert bench.ask().answer.status is Status.GRAB_TIMEOUT
    bench.measuring.troubles["camera"] = "unplugged"
    assert bench.ask().answer.status is Status.CAMERA_OFFLINE


def test_a_camera_known_to_be_lost_is_told_without_waiting_for_a_picture(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def never(timeout_s: float) -> Sight:
        raise AssertionError(f"waited {timeout_s} s")

    monkeypatch.setattr(bench.measuring, "fresh", never)
    bench.measuring.troubles["camera"] = "unplugged"
    assert bench.ask().answer.status is Status.CAMERA_OFFLINE


def test_a_cell_that_drifted_stops_serving(bench: Bench, taught: Taught) -> None:
    assert taught.sight.base_from_wrist is not None
    bumped = Pose.from_rotvec((0, 0, 0), (3.0, 0, 0)) @ taught.sight.base_from_wrist
    for _ in range(3):
        bench.measuring.show(replace(taught.sight, base_from_wrist=bumped))
    assert bench.ask().answer.status is Status.CALIBRATION_DRIFT
    bench.measuring.show(taught.sight)
    assert bench.ask().answer.status is Status.OK


@pytest.mark.parametrize("pictures", [0, 1, 2])
def test_no_answer_is_given_while_tag_a_may_have_moved(
    bench: Bench, taught: Taught, pictures: int
) -> None:
    """A watch shows no tag A: what the whole pictures began to say must be heard to its end before."""
    assert taught.sight.base_from_wrist is not None
    bumped = Pose.from_rotvec((0, 0, 0), (3.0, 0, 0)) @ taught.sight.base_from_wrist
    bumped_sight = replace(taught.sight, base_from_wrist=bumped)
    for k in range(pictures):
        bench.measuring.show(at(bumped_sight, 1000.05 + 0.01 * k))
    bench.measuring.coming = [at(bumped_sight, 1000.21 + 0.01 * k) for k in range(4)]
    assert bench.ask().answer.status is Status.CALIBRATION_DRIFT


def test_one_picture_that_errs_about_tag_a_costs_another_one(bench: Bench, taught: Taught) -> None:
    assert taught.sight.base_from_wrist is not None
    bumped = Pose.from_rotvec((0, 0, 0), (3.0, 0, 0)) @ taught.sight.base_from_wrist
    erring = at(replace(taught.sight, base_from_wrist=bumped), 1000.21)
    bench.measuring.coming = [erring, at(taught.sight, 1000.25)]
    assert bench.ask().answer.status is Status.OK
    assert bench.measuring.wishes == 2


def test_the_newest_picture_serves_while_it_shows_the_object(bench: Bench, taught: Taught) -> None:
    bench.measuring.show(at(taught.sight, 1000.2))
    assert bench.ask(CMD=Command.EC_NEWEST).answer.status is Status.OK
    assert bench.measuring.wishes == 0
    bench.measuring.show(hidden(taught.sight, 1000.3))
    assert bench.ask(CMD=Command.EC_NEWEST).answer.status is Status.TAG_B_NOT_FOUND
    bench.measuring.show(at(taught.sight, 1000.4))
    bench.clock.sleep(3.3)
    assert bench.ask(CMD=Command.EC_NEWEST).answer.status is Status.OK
    assert bench.serving.answer.captured_s > 1003.0  # of a new picture: the old one is too old


def test_clear_drops_the_answer(bench: Bench) -> None:
    bench.ask()
    image = bench.ask(CMD=Command.CLEAR, TRIG=8)
    assert (image.answer.status, image.answer.echo) == (Status.IDLE, 8)


def test_an_answer_that_another_calibration_drops_stays_the_answer_to_its_request(
    bench: Bench, taught: Taught
) -> None:
    first = bench.ask().answer
    bench.serving.use(taught.calibration, CALIBRATION_ID + 1)
    dropped = bench.read().answer
    assert dropped.status is Status.IDLE
    assert (dropped.nonce, dropped.echo, dropped.point) == (first.nonce, 7, 1)


def test_without_a_calibration_nothing_is_served(bench: Bench) -> None:
    bench.serving.serve_none(Status.CALIBRATION_MISMATCH, "of another cell")
    assert bench.ask().answer.status is Status.CALIBRATION_MISMATCH
    assert bench.serving.fault() == (Status.CALIBRATION_MISMATCH, "of another cell")


def test_a_tcp_that_the_robot_does_not_tell_is_no_difference() -> None:
    assert tcp_difference(None, Pose.identity()) == ""
    assert tcp_difference(Pose.identity(), None) == ""
    assert "5.00 mm" in tcp_difference(Pose.identity(), Pose.from_rotvec((0, 0, 0), (0, 0, 5.0)))


def test_the_calibration_of_the_tests_is_accepted(taught: Taught) -> None:
    calibration: Calibration = taught.calibration
    assert calibration.verdict.ok, calibration.verdict
    assert isinstance(calibration.verdict, Verdict)
