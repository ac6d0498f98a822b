"""What the registers say: every refusal, the running answer, the object that moved, the TCP that changed."""

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fakes.layout import Layout
from fakes.poses import retracted_pose
from fakes.rehearsal import Rehearsal, facts_of
from fakes.testing import ManualClock
from fakes.world import Noise, World
from vgrd.calibration.system import calibrate_system
from vgrd.cell.answering import Limits, answer_request, check_request, object_displacement_mm
from vgrd.cell.measuring import Sight
from vgrd.cell.serving import Serving, tcp_difference
from vgrd.devices import CameraImage, FlangeReading
from vgrd.errors import ControlError, DeviceUnavailable, NotSteady
from vgrd.geometry import Pose
from vgrd.ipc.ring import RingReader, RingWriter
from vgrd.model import Calibration, Policy, Verdict
from vgrd.registers import (
    PACKED_BYTES,
    REGISTER_KIND,
    REQUEST,
    Command,
    RegisterImage,
    Request,
    RotationFormat,
    State,
    Status,
)
from vgrd.registers import Policy as PolicyCode

LIMITS = Limits(Policy.FIXED, 3.0, 1.0, 0.9, 0.3)
CALIBRATION_ID = 0xC0FFEE


class Taught:
    """One perfect rehearsed cell, shared by the tests of this file."""

    def __init__(self, folder: Path) -> None:
        self.world = World(Layout(), 5, Noise.none())
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


def request(**fields: int) -> Request:
    values = dict.fromkeys((field.name for field in REQUEST.fields), 0)
    values |= {"TRIG": 7, "CMD": Command.EC_FRESH, "POINT": 1} | fields
    return Request.parse(REQUEST.encode(values))


def answered(taught: Taught, asked: Request, sight: Sight | None = None, now_s: float = 1000.5):
    return answer_request(
        asked, taught.calibration, CALIBRATION_ID, sight or taught.sight, LIMITS, now_s, 1.7e9
    )


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


@pytest.mark.parametrize("code", list(RotationFormat))
def test_all_rotation_formats_mean_the_same_orientation(
    taught: Taught, code: RotationFormat
) -> None:
    from scipy.spatial.transform import Rotation

    answer = answered(taught, request(OPT=code << 4))
    euler = {RotationFormat.RPY: "xyz", RotationFormat.KUKA_ABC: "ZYX", RotationFormat.ZYZ: "ZYZ"}
    turned = (
        Rotation.from_rotvec(answer.rotation)
        if code is RotationFormat.ROTVEC
        else Rotation.from_euler(euler[code], answer.rotation, degrees=True)
    )
    reference = Rotation.from_rotvec(answered(taught, request()).rotation)
    assert (turned.inv() * reference).magnitude() < 1e-9


@pytest.mark.parametrize("code", list(RotationFormat))
def test_the_tip_meets_the_target_with_the_wrist_as_the_robot_requests(
    taught: Taught, code: RotationFormat
) -> None:
    from scipy.spatial.transform import Rotation

    work = Rotation.from_euler("xyz", (170.0, 12.0, 35.0), degrees=True)
    euler = {RotationFormat.RPY: "xyz", RotationFormat.KUKA_ABC: "ZYX", RotationFormat.ZYZ: "ZYZ"}
    if code is RotationFormat.ROTVEC:
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


def test_a_tcp_that_is_not_known_is_not_served(taught: Taught) -> None:
    unknown = replace(taught.calibration, tcp_in_wrist=None)
    refusal = check_request(request(OPT=2), unknown)
    assert refusal is not None
    assert refusal.status is Status.BAD_PARAMETER


def test_each_doubt_has_its_status(taught: Taught) -> None:
    blind = replace(taught.sight, tag_b=None)
    moving = replace(taught.sight, base_from_wrist=None, unpaired=NotSteady("moving"))
    assert answered(taught, request(), blind).status is Status.TAG_B_NOT_FOUND
    assert answered(taught, request(OPT=1), moving).status is Status.ROBOT_MOVING
    assert answered(taught, request(), moving).status is Status.OK
    assert answered(taught, request(), now_s=1003.0).status is Status.IMAGE_TOO_OLD
    assert answered(taught, request(MAXAGE=100)).status is Status.IMAGE_TOO_OLD
    assert answered(taught, request(MAXU95=1)).status is Status.UNCERTAINTY_TOO_HIGH


def test_displacement_bounds_that_of_every_target(taught: Taught) -> None:
    first = taught.see(0.0).tag_b
    assert first is not None
    taught.rehearsal.stand(retracted_pose(), 0.71)
    second = taught.see(0.0).tag_b
    taught.rehearsal.stand(retracted_pose(), 0.7)
    assert second is not None
    assert object_displacement_mm(taught.calibration, first, first) == pytest.approx(0.0, abs=1e-9)
    moved = object_displacement_mm(taught.calibration, first, second)
    assert 0.01 * 60 <= moved <= 0.01 * (60 + 120) + 0.05


class StillMeasuring:
    """A measuring loop of the tests: what it sees is set by hand."""

    def __init__(self, clock: ManualClock, sight: Sight, tcp: Pose | None) -> None:
        self.clock = clock
        self.sight: Sight | None = sight
        self.sight_of_object: Sight | None = sight
        self.tcp = tcp
        self.beat = 0
        self.on_sight: list[Callable[[Sight], None]] = []
        self.robot = self
        self.running = True
        self.troubles = {"robot": "", "camera": ""}

    def newest(self, within_s: float) -> FlangeReading | None:
        del within_s
        if self.troubles["robot"]:
            return None
        now = self.clock.monotonic()
        return FlangeReading(Pose.identity(), self.tcp, now, now, running=self.running)

    def robot_trouble(self) -> str:
        return self.troubles["robot"]

    def camera_trouble(self) -> str:
        return self.troubles["camera"]

    async def fresh(self, timeout_s: float) -> Sight:
        if self.sight is None:
            raise DeviceUnavailable(f"no picture within {timeout_s} s")
        return self.sight

    def show(self, sight: Sight) -> None:
        self.sight = sight
        if sight.tag_b is not None:
            self.sight_of_object = sight
        for listener in self.on_sight:
            listener(sight)


class Bench:
    """A `Serving` on a bench: request it, read its registers."""

    def __init__(self, folder: Path, taught: Taught) -> None:
        self.clock = ManualClock(1000.2)
        facts = taught.calibration.facts
        self.measuring = StillMeasuring(self.clock, taught.sight, facts.wrist_from_tcp)
        writer = RingWriter.create(folder / "registers.ring", 4, PACKED_BYTES, REGISTER_KIND)
        self.serving = Serving(self.measuring, writer, LIMITS, 1.5, self.clock, simulation=True)  # type: ignore[arg-type]
        self.reader = RingReader.open(folder / "registers.ring", REGISTER_KIND)

    def ask(self, **fields: int) -> RegisterImage:
        async def serve() -> None:
            self.serving.request(request(**fields))
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            await asyncio.sleep(0)

        asyncio.run(serve())
        return self.read()

    def read(self) -> RegisterImage:
        self.serving._guard_tcp()
        self.serving.publish()
        message = self.reader.newest()
        assert message is not None
        return RegisterImage.unpack(message.payload)


@pytest.fixture
def bench(tmp_path: Path, taught: Taught) -> Iterator[Bench]:
    bench = Bench(tmp_path, taught)
    bench.serving.use(taught.calibration, CALIBRATION_ID)
    yield bench
    with contextlib.suppress(ValueError):
        bench.reader.close()


def test_an_answer_stands_until_the_object_moves(bench: Bench, taught: Taught) -> None:
    assert bench.ask().answer.status is Status.OK
    bench.measuring.show(replace(taught.sight))
    assert bench.read().answer.status is Status.OK
    taught.rehearsal.stand(retracted_pose(), 0.72)
    turned = taught.see(1000.4)
    taught.rehearsal.stand(retracted_pose(), 0.7)
    bench.measuring.show(turned)
    assert bench.read().answer.status is Status.OBJECT_MOVED
    bench.measuring.show(taught.sight)
    assert bench.read().answer.status is Status.OBJECT_MOVED


def test_a_hidden_object_does_not_move(bench: Bench, taught: Taught) -> None:
    bench.ask()
    bench.measuring.show(replace(taught.sight, tag_b=None))
    assert bench.read().answer.status is Status.OK


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


def test_the_newest_picture_of_the_object_serves_until_it_is_too_old(
    bench: Bench, taught: Taught
) -> None:
    bench.measuring.show(replace(taught.sight, tag_b=None))
    assert bench.ask(CMD=Command.EC_NEWEST).answer.status is Status.OK
    assert bench.ask(CMD=Command.EC_FRESH).answer.status is Status.TAG_B_NOT_FOUND
    bench.clock.sleep(3.0)
    assert bench.ask(CMD=Command.EC_NEWEST).answer.status is Status.IMAGE_TOO_OLD


def test_clear_drops_the_answer(bench: Bench) -> None:
    bench.ask()
    image = bench.ask(CMD=Command.CLEAR, TRIG=8)
    assert (image.answer.status, image.answer.echo) == (Status.IDLE, 8)


def test_without_a_calibration_nothing_is_served(bench: Bench) -> None:
    bench.serving.use(None, 0)
    assert bench.ask().answer.status is Status.NOT_CALIBRATED


def test_a_tcp_that_the_robot_does_not_tell_is_no_difference() -> None:
    assert tcp_difference(None, Pose.identity()) == ""
    assert tcp_difference(Pose.identity(), None) == ""
    assert "5.00 mm" in tcp_difference(Pose.identity(), Pose.from_rotvec((0, 0, 0), (0, 0, 5.0)))


def test_the_calibration_of_the_tests_is_accepted(taught: Taught) -> None:
    calibration: Calibration = taught.calibration
    assert calibration.verdict.ok, calibration.verdict
    assert isinstance(calibration.verdict, Verdict)
