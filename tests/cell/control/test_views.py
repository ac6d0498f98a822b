"""What people look at is what the registers hold and what the camera saw."""

import asyncio
import base64
import math
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.testing import ManualClock
from vgrd.cell.control.live_picture import WIDTH_PX, LivePicture
from vgrd.cell.control.robot_view import robot_view, state_word
from vgrd.cell.measuring import Sight
from vgrd.devices import CameraImage
from vgrd.errors import DeviceUnavailable, NotSteady
from vgrd.geometry import Pose
from vgrd.ipc.messages import GateReport
from vgrd.model import TagObservation, TagSpec
from vgrd.registers import Answer, RegisterImage, State, Status, view
from vgrd.registers.remedies import REMEDIES

DEADLINE_S = 0.25
TAG = TagSpec("36h11", 1, 30.0)
HEIGHT, WIDTH = 300, 400


def told(image: RegisterImage | None, now_s: float, fault: Any = None) -> dict[str, Any]:
    """What a page shows of an image that the gate shows to robots."""
    seen = view(image, now_s, deadline_s=DEADLINE_S)
    report = GateReport(1, "127.0.0.1", 502, {"triggers": 3}, (), registers=seen.response.hex())
    shown = robot_view(report, now_s, now_s + 0.1, fault)
    assert shown["valid"] == seen.valid
    return shown


@given(
    status=st.sampled_from(Status),
    state=st.integers(0, 0xFFFF).map(State),
    um=st.tuples(*[st.integers(-2_000_000, 2_000_000)] * 3),
    age_s=st.floats(0, 3),
    left_s=st.floats(-1, 2),
    silent_s=st.floats(0, 0.5),
)
def test_a_coordinate_is_shown_exactly_while_robots_read_one(
    status, state, um, age_s, left_s, silent_s
):
    now_s = 1000.0
    answer = Answer(
        status,
        position_um=um,
        rotation=(0.1, -0.2, 0.3),
        captured_s=now_s - age_s,
        valid_until_s=now_s + left_s,
        u95_um=432,
    )
    shown = told(RegisterImage(answer, state, 7, now_s - silent_s), now_s)
    if shown["valid"]:
        assert status.is_ok
        assert left_s > 0
        assert silent_s < DEADLINE_S
        assert shown["position_mm"] == pytest.approx(np.array(um) / 1000, abs=1e-9)
        assert shown["rotvec_deg"] == pytest.approx(np.degrees([0.1, -0.2, 0.3]), abs=1e-4)
        assert shown["u95_mm"] == pytest.approx(0.432)
    else:
        assert shown["position_mm"] is shown["rotvec_deg"] is shown["u95_mm"] is None
        assert shown["age_ms"] is None
    assert shown["state"] != "READY" or shown["status"] in (Status.IDLE, Status.OK)
    assert len(shown["registers"]) == 68
    assert all(value is None or math.isfinite(value) for value in [shown["age_ms"]])


def test_before_the_cell_lives_nothing_is_ready():
    shown = told(None, 5.0)
    assert (shown["state"], shown["name"]) == ("STARTING", "STARTING")


def test_the_cause_of_a_cell_that_cannot_serve_is_told_with_its_remedy():
    image = RegisterImage(Answer(), State(0), 7, 1000.0)
    shown = told(image, 1000.0, (Status.CAMERA_OFFLINE, "no answer from 10.0.0.7"))
    assert (shown["state"], shown["cause"]) == ("INVALID", "CAMERA_OFFLINE")
    assert shown["words"] == "no answer from 10.0.0.7"
    assert shown["remedy"] == REMEDIES["CAMERA_OFFLINE"].operator


@pytest.mark.parametrize(
    ("status", "bits", "word"),
    [
        (Status.IDLE, State.READY, "READY"),
        (Status.OK, State.READY | State.VALID, "READY"),
        (Status.OK_DEGRADED, State.READY | State.VALID | State.DEGRADED, "DEGRADED"),
        (Status.OK, State.READY | State.VALID | State.HELD, "DEGRADED"),
        (Status.TAG_B_NOT_FOUND, State.READY | State.ERROR, "INVALID"),
        (Status.IDLE, State(0), "INVALID"),
        (Status.BUSY, State.READY | State.BUSY, "BUSY"),
    ],
)
def test_one_word_tells_the_whole(status, bits, word):
    assert state_word(status, bits) == word


class Camera:
    """Shows one picture with a bright square where tag B is."""

    period_s = 0.5

    def __init__(self) -> None:
        pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
        pixels[100:140, 200:240] = 255
        corners = np.array([[199.5, 99.5], [239.5, 99.5], [239.5, 139.5], [199.5, 139.5]])
        seen = TagObservation(TAG, Pose.identity(), np.eye(6), corners, 0.1)
        self.facts = SimpleNamespace(tag_a=None, tag_b=TAG)
        image = CameraImage(pixels, 999.0, 7)
        self.sight: Sight | None = Sight(image, None, seen, Pose.identity(), None)

    def camera_trouble(self) -> str:
        return "no cable"


@pytest.mark.parametrize("width_px", [200, 400, 1024])
def test_the_corners_are_where_the_small_picture_shows_the_tag(width_px):
    live = LivePicture(Camera(), ManualClock())  # type: ignore[arg-type]
    told = asyncio.run(live.newest(None, 0.0, width_px))
    grey = cv2.imdecode(
        np.frombuffer(base64.b64decode(told["jpeg"]), np.uint8), cv2.IMREAD_GRAYSCALE
    )
    assert grey.shape == (told["height_px"], told["width_px"])
    assert told["width_px"] == min(width_px, WIDTH)  # never larger than it was
    rows, columns = np.nonzero(grey > 128)
    corners = np.array(told["tags"]["b"]["corners"])
    assert corners.min(axis=0) == pytest.approx((columns.min() - 0.5, rows.min() - 0.5), abs=0.6)
    assert corners.max(axis=0) == pytest.approx((columns.max() + 0.5, rows.max() + 0.5), abs=0.6)


def test_who_has_the_newest_picture_waits_for_another_one():
    camera, clock = Camera(), ManualClock()
    live = LivePicture(camera, clock)  # type: ignore[arg-type]
    first = camera.sight

    async def shown() -> list[int]:
        asked = asyncio.create_task(live.newest(7, 1.0, WIDTH_PX))
        await asyncio.sleep(0)
        assert not asked.done()
        image = CameraImage(first.image.pixels, 999.5, 8)
        camera.sight = Sight(image, None, None, None, NotSteady("it moves"))
        told = await asked
        assert told["robot_at_rest"] is False
        assert told["tags"]["b"]["corners"] is None
        return [told["frame"], (await live.newest(8, 0.0, WIDTH_PX))["frame"]]

    assert asyncio.run(shown()) == [8, 8]


def test_a_camera_that_has_shown_nothing_is_told_as_such():
    camera = Camera()
    camera.sight = None
    live = LivePicture(camera, ManualClock())  # type: ignore[arg-type]
    with pytest.raises(DeviceUnavailable, match="no cable"):
        asyncio.run(live.newest(None, 0.0, WIDTH_PX))
