"""The judge sees lies: a daemon that is broken in one place is found out, and what cannot be told is excused."""

from collections.abc import Callable

import numpy as np
import pytest

from tests.invariant.reading.judge import Lie
from tests.invariant.reading.robots import Asked
from tests.invariant.reading.undetectable import is_told
from tests.invariant.rig import Rig, silence
from tests.invariant.simulation.teaching import Variant
from vgrd.cell.serving import standing_answer, vouching
from vgrd.cell.serving.faults import Faults
from vgrd.geometry import Pose
from vgrd.model import Motion
from vgrd.registers import Command, image

ASKED = Asked(0, Command.EC_FRESH, 2)
SLIP = Pose.from_rotvec((0, 0.002, 0), (0, 5.0, 5.0))


@pytest.fixture
def rig(tmp_path):
    with silence(), Rig(tmp_path, Variant(), seed=3) as rig:
        rig.ask(0, ASKED)
        rig.wait(1.0)
        assert rig.judge.counts["right"] > 100
        yield rig


def turned(rig: Rig) -> None:
    now = rig.clock.now_s
    rig.plant.jerk(rig.plant.placements[-1].angle(now) + 0.3, now)
    rig.wait(2.0)


def unplugged(rig: Rig) -> None:
    rig.unplug("camera")
    rig.wait(1.5)


def aged(rig: Rig) -> None:
    rig.wait(1.0)


def tcp_changed(rig: Rig) -> None:
    rig.change_tcp(10.0)
    rig.wait(1.0)


def slipped(rig: Rig) -> None:
    rig.plant.tag_b_slip = SLIP
    rig.wait(1.0)
    rig.ask(0, ASKED)
    rig.wait(1.0)


def nothing(*_: object, **__: object) -> float:
    return 0.0


def for_ever(*_: object) -> float:
    return 1e9


@pytest.mark.parametrize(
    ("owner", "name", "broken", "accident", "words"),
    [
        (standing_answer, "displacement_mm", nothing, turned, "mm off"),
        (vouching, "_span_s", for_ever, unplugged, "the camera is unplugged"),
        (image, "AGE_STEP_S", 1e9, aged, "of no picture"),
        (Faults, "check_tcp", nothing, tcp_changed, "the TCP was changed"),
    ],
    ids=["moved object", "camera gone", "standing age", "tool changed"],
)
def test_a_daemon_that_is_broken_in_one_place_is_found_out(
    rig: Rig,
    monkeypatch: pytest.MonkeyPatch,
    owner: object,
    name: str,
    broken: object,
    accident: Callable[[Rig], None],
    words: str,
) -> None:
    accident(rig)  # a sound one is not
    rig.repair()
    rig.wait(4.0)
    monkeypatch.setattr(owner, name, broken)
    rig.ask(0, ASKED)
    with pytest.raises(Lie, match=words):  # noqa: PT012  it may be seen at once
        rig.wait(0.5)
        accident(rig)


def test_an_answer_to_another_request_is_found_out(rig: Rig) -> None:
    rig.robots.desk.asked = Asked(3, Command.EC_FRESH, 5)
    with pytest.raises(Lie, match="of another request"):
        rig.wait(0.1)


def test_a_block_that_is_torn_is_found_out(rig: Rig) -> None:
    block = bytearray(rig.robots.links[0].read(100, 68))
    block[60:64] = (1_000).to_bytes(4, "big")
    with pytest.raises(Lie, match="torn"):
        rig.judge.read(bytes(block), rig.clock.now_s)


def test_a_slip_that_shows_is_refused_and_one_that_leaves_no_trace_is_excused_and_counted(
    tmp_path,
):
    for motion in (Motion.TURNTABLE, Motion.FREE):
        folder = tmp_path / motion.value
        folder.mkdir()
        with silence(), Rig(folder, Variant(motion), seed=3) as rig:
            slipped(rig)
            untold = rig.judge.counts["not told by one picture: tag B slipped"]
        assert (untold > 100) == (motion is Motion.FREE)


ALONG, ACROSS = "along", "across"


@pytest.mark.parametrize("stability", ["fixed", "movable"])
@pytest.mark.parametrize("motion", Motion)
@pytest.mark.parametrize("link", ["tag A", "tag B", "camera"])
def test_what_one_picture_tells_is_what_no_motion_of_the_object_explains(link, motion, stability):
    """As docs/invariant.md says; a camera that moved is followed by tag A."""
    axis = np.array([0, 0, 0, 0, 0, 0.05])
    lifted = np.array([0, 0, 5.0, 0, 0, 0])
    told = {
        what: is_told(link, tuple(slip), motion, stability)
        for what, slip in ((ALONG, axis), (ACROSS, lifted))
    }
    assert not told[ALONG]
    assert told[ACROSS] == (motion is not Motion.FREE and link != "camera")
