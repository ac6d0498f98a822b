"""A whole teaching against a living daemon in which nobody types `look` or `spin`."""

import pytest

from fakes.world.poses import look_poses, retracted_pose
from vgrd.store.sessions import load_session

pytestmark = pytest.mark.system

LARGEST_SKEW_MS = 10.0  # the world tells camera and controller every 4 ms; a busy machine later
TURNS = (1.2, 2.4, 3.6, 4.8)


def harvested(status: dict, kind: str) -> int:
    return int(status["recording"]["harvested"].get(kind, 0))


def test_a_session_of_jogging_and_touching_is_solved_and_accepted(live) -> None:
    daemon, world = live.daemon, live.cell.world
    operator = live.cell.operator(daemon)
    operator.press("record.start", session="jogged", plan="joint")
    operator.jog(retracted_pose())
    daemon.wait_until(lambda status: harvested(status, "look") == 1)
    for count, angle in enumerate(TURNS, 1):
        operator.turn(angle)
        daemon.wait_until(lambda status, count=count: harvested(status, "spin") == count)
    operator.turn(0.0)
    for count, pose in enumerate(look_poses(world.layout, 4), 2):
        operator.jog(pose)
        daemon.wait_until(lambda status, count=count: harvested(status, "look") >= count)
    names = list(world.targets)
    for step in operator.touches(names, tilted=False) + operator.touches(names[:3], tilted=True):
        step()
    assert set(operator.taught) == {"touch"}
    operator.jog(retracted_pose())
    operator.turn(2.0)
    daemon.wait_until(lambda status: harvested(status, "spin") >= len(TURNS) + 1)
    undone = daemon.call("undo", kind="harvested")
    assert undone["was_harvested"] is True
    stopped = operator.press("record.stop")
    solved = daemon.control.call("solve", timeout_s=120.0)
    assert solved["calibration"] is not None, solved["verdict"]
    assert solved["harvested"] == stopped["harvested"]
    offset = solved["time_offset"]  # of a fast arm few pictures tell it
    assert offset["unknown"] or abs(offset["offset_ms"]) < LARGEST_SKEW_MS
    session = load_session(live.cell.state / "sessions" / "jogged")
    assert len(session.recording.touches) == len(names) + 3
    assert session.harvested == stopped["harvested"]
