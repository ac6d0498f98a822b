"""What the registers show of the cell's image: a pose or sentinels, in every encoding, for the one who asked."""

import math
import struct
from dataclasses import replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from vgrd.errors import IpcError
from vgrd.registers import (
    PACKED_BYTES,
    RESPONSE,
    Answer,
    Frame,
    RegisterImage,
    Request,
    RotationCode,
    Scale16,
    State,
    Status,
    View,
    view,
)
from vgrd.registers.layout import crc_of

DEADLINE_S = 0.25
NOW_S = 1000.0
OK = (Status.OK, Status.OK_DEGRADED)
AXES = ("X", "Y", "Z", "RX", "RY", "RZ")

u16 = st.integers(0, 0xFFFF)
i32 = st.integers(-(2**31), 2**31 - 1)
i64 = st.integers(-(2**63), 2**63 - 1)
nonces = st.sampled_from((0, 77, 78)) | st.integers(0, 2**64 - 1)
near = st.floats(NOW_S - 2, NOW_S + 2)
any_float = st.floats(allow_nan=True, allow_infinity=True)
angles = st.floats(-180, 180)
answers = st.builds(
    Answer,
    status=st.sampled_from(Status) | st.sampled_from(OK),
    echo=u16,
    seq=u16,
    nonce=nonces,
    detail=u16,
    point=u16,
    object=u16,
    captured_s=near | any_float,
    captured_unix_us=st.integers(0, 2**63),
    valid_until_s=near | any_float,
    position_um=st.tuples(i64, i64, i64)
    | st.tuples(i32, i32, i32)
    | st.tuples(*[st.integers(-3_000_000, 3_000_000)] * 3),
    rotation=st.tuples(angles, angles, angles) | st.tuples(any_float, any_float, any_float),
    u95_um=st.integers(0, 2**31 - 1),
    u95_rot_10urad=u16,
    tags=u16,
    calibration_id=st.integers(0, 2**32 - 1),
    rotation_format=st.sampled_from(RotationCode),
    frame=st.sampled_from(Frame),
)
images = st.builds(
    RegisterImage,
    answer=answers,
    state=st.integers(0, 0xFFFF).map(State),
    beat=u16,
    published_s=near | any_float,
)
requests = st.builds(Request.parse, st.binary(min_size=64, max_size=64), nonces)

GOOD = Answer(
    status=Status.OK,
    echo=7,
    seq=3,
    nonce=77,
    point=4,
    object=1,
    captured_s=NOW_S - 0.125,
    captured_unix_us=1_700_000_000_000_000,
    valid_until_s=NOW_S + 0.375,
    position_um=(412_345, -100_060, 350_000),
    rotation=(1.1, -2.2, 0.5),
    u95_um=180,
    u95_rot_10urad=25,
    tags=2,
    calibration_id=0xDEADBEEF,
)
LIVE = State.READY | State.CAMERA_OK | State.ROBOT_OK | State.CALIBRATED
IMAGE = RegisterImage(GOOD, LIVE, beat=11, published_s=NOW_S - 0.02)
ASKED = Request.parse(struct.pack(">3H", 9, 2, 5) + bytes(58))


def asker(answer: Answer) -> Request:
    """The very request that `answer` is to."""
    words = [answer.echo, 2, answer.point, 0, 0, answer.object]
    return Request.parse(struct.pack(">6H", *words) + bytes(52), answer.nonce)


def look(image: RegisterImage | None = IMAGE, now_s: float = NOW_S, **more) -> View:
    """What the asker of the image's answer sees."""
    if image and "answered" not in more:
        more["answered"] = asker(image.answer)
    return view(image, now_s, deadline_s=DEADLINE_S, **more)


def values(seen: View) -> dict[str, float]:
    return RESPONSE.decode(seen.response)


def holds_only_sentinels(v: dict[str, float]) -> bool:
    return (
        all(v[f"EC16_{a}"] == -0x8000 and v[f"EC32_{a}"] == -(2**31) for a in AXES)
        and all(math.isnan(v[f"ECF_{a}"]) for a in AXES)
        and v["EC32_U95"] == -(2**31)
        and math.isnan(v["ECF_U95"])
        and v["U95P"] == v["U95R"] == 0xFFFF
    )


def test_a_valid_answer_stands_in_all_three_encodings():
    v = values(look())
    assert [v[f"EC32_{a}"] for a in AXES] == [412345, -100060, 350000, 1100000, -2200000, 500000]
    assert [v[f"EC16_{a}"] for a in AXES] == [4123, -1001, 3500, 1100, -2200, 500]
    assert [v[f"ECF_{a}"] for a in AXES] == pytest.approx([412.345, -100.06, 350, 1.1, -2.2, 0.5])
    assert (v["STATUS"], v["ECHO"], v["AGE"], v["U95P"], v["EC32_U95"]) == (1, 7, 125, 180, 180)
    assert (v["HB"], v["CALID"], v["TCAP"]) == (11, 0xDEADBEEF, 1_700_000_000_000_000)
    assert v["STATE"] == LIVE | State.VALID
    for block in ("EC16", "EC32", "ECF"):
        assert [v[f"{block}_{n}"] for n in ("ECHO", "STATUS", "SEQ")] == [7, 1, 6]


def test_the_addresses_on_the_wire_are_those_of_the_map():
    block = look().response
    at = {a: struct.unpack_from(">i", block, 2 * (a - 100))[0] for a in (130, 134, 142)}
    assert at == {130: 412345, 134: 350000, 142: 180}
    assert struct.unpack_from(">H", block, 0)[0] == 0x0100
    assert struct.unpack_from(">f", block, 2 * 54)[0] == 350.0
    low, high = struct.unpack_from(">2H", look().swapped, 2 * 30)
    assert high << 16 | low == 412345


@pytest.mark.parametrize(
    ("scale", "fmt", "rotation", "expected"),
    [
        (Scale16.MRAD, RotationCode.ROTVEC, (1.1, -2.2, 0.5), (1100, -2200, 500)),
        (
            Scale16.CENTIDEGREE,
            RotationCode.RPY,
            (-175.587, -42.477, 90.0),
            (-17559, -4248, 9000),
        ),
        (Scale16.FINE, RotationCode.ROTVEC, (math.pi, 0.0, -0.5), (31416, 0, -5000)),
        (Scale16.MRAD, RotationCode.KUKA_ABC, (180.0, -90.0, 1.0), (3142, -1571, 17)),
    ],
)
def test_the_int16_block_is_in_the_units_that_fmt_names(scale, fmt, rotation, expected):
    answer = replace(GOOD, rotation_format=fmt, rotation=rotation)
    v = values(look(replace(IMAGE, answer=answer), scale=scale))
    assert (v["EC16_RX"], v["EC16_RY"], v["EC16_RZ"]) == expected
    assert v["EC16_X"] == (8247 if scale == Scale16.FINE else 4123)
    assert v["FMT"] == fmt | scale << 8
    for other in (look(None, scale=scale), look(pending=ASKED, scale=scale)):
        assert int(values(other)["FMT"]) >> 8 == scale


def test_euler_angles_are_ten_thousandths_of_a_degree_in_the_int32_block():
    answer = replace(GOOD, rotation_format=RotationCode.ZYZ, rotation=(-122.0661, 137.3384, 1.0))
    v = values(look(replace(IMAGE, answer=answer)))
    assert [v[f"EC32_{a}"] for a in AXES[3:]] == [-1220661, 1373384, 10000]
    assert v["ECF_RX"] == pytest.approx(-122.0661)


def test_an_answer_expires_while_nobody_publishes():
    before = look(now_s=NOW_S + 0.2)
    assert before.valid
    fresh = replace(IMAGE, published_s=GOOD.valid_until_s)
    after = look(fresh, now_s=GOOD.valid_until_s)
    v = values(after)
    assert (v["STATUS"], v["ECHO"], v["AGE"]) == (Status.IMAGE_TOO_OLD, 7, 500)
    assert holds_only_sentinels(v)
    assert v["SEQ"] != values(before)["SEQ"]


def test_age_runs_on_and_saturates():
    ages = [values(look(replace(IMAGE, published_s=t), now_s=t))["AGE"] for t in (1000.0, 1000.25)]
    assert ages == [125, 375]
    old = replace(IMAGE, published_s=NOW_S + 100)
    assert values(look(old, now_s=NOW_S + 100))["AGE"] == 0xFFFF


def test_a_pending_request_shows_busy_and_no_coordinate():
    v = values(look(pending=ASKED))
    assert (v["STATUS"], v["POINT"], v["ECHO"]) == (Status.BUSY, 5, 0)
    assert State(int(v["STATE"])) == LIVE | State.BUSY
    assert holds_only_sentinels(v)


def test_a_lost_cell_is_invalid_with_a_standing_heartbeat():
    late = look(now_s=IMAGE.published_s + DEADLINE_S)
    v = values(late)
    assert (v["STATUS"], v["HB"], v["STATE"]) == (Status.INTERNAL_ERROR, 11, State.ERROR)
    assert holds_only_sentinels(v)
    asked = values(look(now_s=NOW_S + 9, pending=ASKED))
    assert (asked["STATUS"], asked["ECHO"]) == (Status.INTERNAL_ERROR, ASKED.trig)


def test_before_the_first_image_the_daemon_is_starting():
    v = values(look(None))
    assert (v["STATUS"], v["STATE"], v["HB"]) == (Status.STARTING, State.ERROR, 0)
    assert holds_only_sentinels(v)
    assert values(look(None, pending=ASKED))["ECHO"] == ASKED.trig


def test_a_simulated_cell_says_so_also_when_it_is_lost():
    simulated = replace(IMAGE, state=LIVE | State.SIMULATION)
    assert look(simulated).state & State.SIMULATION
    assert look(simulated, now_s=NOW_S + 9).state == State.SIMULATION | State.ERROR


@pytest.mark.parametrize(
    ("change", "scale", "axis"),
    [
        ({"position_um": (3_276_800, 0, 0)}, Scale16.MRAD, 1),
        ({"position_um": (0, 0, -3_276_800)}, Scale16.CENTIDEGREE, 3),
        ({"position_um": (0, 1_700_000, 0)}, Scale16.FINE, 2),
        ({"rotation": (0.0, 33.0, 0.0)}, Scale16.MRAD, 5),
    ],
)
def test_a_coordinate_too_large_for_int16_is_served_by_the_other_blocks(change, scale, axis):
    answer = replace(GOOD, **change)
    v = values(look(replace(IMAGE, answer=answer), scale=scale))
    assert (v["STATUS"], v["DETAIL"], v["EC16_STATUS"]) == (Status.OK, axis, 602)
    assert all(v[f"EC16_{a}"] == -0x8000 for a in AXES)
    assert (v["EC16_ECHO"], v["EC16_SEQ"], v["SEQ"]) == (7, 7, 6)
    assert v["EC32_STATUS"] == v["ECF_STATUS"] == Status.OK
    assert v["EC32_SEQ"] == v["ECF_SEQ"] == 6
    assert tuple(v[f"EC32_{a}"] for a in AXES[:3]) == answer.position_um
    assert v["EC32_U95"] == 180
    assert v["U95P"] == 180
    assert int(v["STATE"]) & State.VALID


def test_a_coordinate_too_large_for_int32_is_served_as_floats():
    answer = replace(GOOD, position_um=(0, 2**31, 0))
    v = values(look(replace(IMAGE, answer=answer)))
    assert (v["STATUS"], v["DETAIL"]) == (Status.OK, 2)
    assert (v["EC16_STATUS"], v["EC32_STATUS"], v["ECF_STATUS"]) == (602, 602, Status.OK)
    assert all(v[f"EC32_{a}"] == -(2**31) for a in AXES)
    assert v["EC32_U95"] == -(2**31)
    assert v["ECF_Y"] == pytest.approx(2**31 / 1000)


def test_a_coordinate_that_no_block_holds_is_refused():
    answer = replace(GOOD, rotation=(0.0, 0.0, 1e39))
    v = values(look(replace(IMAGE, answer=answer)))
    assert (v["STATUS"], v["DETAIL"]) == (Status.ENCODING_OVERFLOW, 6)
    assert holds_only_sentinels(v)


def test_the_largest_coordinate_that_fits_is_served_and_u95_saturates():
    answer = replace(GOOD, position_um=(3_276_700, -3_276_700, 0), u95_um=70_000)
    v = values(look(replace(IMAGE, answer=answer)))
    assert (v["STATUS"], v["EC16_X"], v["EC16_Y"]) == (Status.OK, 32767, -32767)
    assert (v["U95P"], v["EC32_U95"], v["ECF_U95"]) == (0xFFFF, 70_000, 70.0)


@given(
    images,
    st.floats(NOW_S - 2, NOW_S + 2),
    st.none() | requests,
    st.none() | answers,
    st.sampled_from(("asker", "nobody")) | requests,
    st.sampled_from(Scale16),
)
def test_no_pose_is_ever_in_a_view_that_is_not_ok(image, now_s, pending, refusal, answered, scale):
    a = image.answer
    answered = {"asker": asker(a), "nobody": None}.get(answered, answered)
    told = {"pending": pending, "refusal": refusal, "answered": answered}
    seen = look(image, now_s, scale=scale, **told)
    v = values(seen)
    asked = answered and (answered.nonce, answered.trig, answered.point, answered.object)
    may_be_valid = (
        (a.nonce == a.echo == 0 or (a.nonce and asked == (a.nonce, a.echo, a.point, a.object)))
        and abs(now_s - image.published_s) < DEADLINE_S
        and pending is None
        and refusal is None
        and a.status in OK
        and now_s < a.valid_until_s < math.inf
        and all(map(math.isfinite, (a.captured_s, *a.rotation)))
    )
    assert seen.valid == (v["STATUS"] in OK) == bool(int(v["STATE"]) & State.VALID)
    assert seen.valid == (v["SEQ"] % 2 == 0)
    assert not seen.valid or may_be_valid
    if seen.valid:
        for block, nothing in (("EC16", -0x8000), ("EC32", -(2**31))):
            holds = v[f"{block}_STATUS"] in OK
            assert holds or v[f"{block}_STATUS"] == Status.ENCODING_OVERFLOW
            assert holds == (v[f"{block}_SEQ"] % 2 == 0)
            assert [v[f"{block}_{x}"] == nothing for x in AXES] == [not holds] * 6
            assert holds or 1 <= v["DETAIL"] <= 6
        assert v["ECF_STATUS"] == v["STATUS"]
        assert not any(math.isnan(v[f"ECF_{x}"]) for x in AXES)
    else:
        assert holds_only_sentinels(v)
        assert may_be_valid <= (v["STATUS"] == Status.ENCODING_OVERFLOW)


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"nonce": 78}, Status.IDLE),
        ({"nonce": 0}, Status.IDLE),
        ({"echo": 8}, Status.INTERNAL_ERROR),
        ({"point": 5}, Status.INTERNAL_ERROR),
        ({"object": 2}, Status.INTERNAL_ERROR),
    ],
)
def test_the_answer_to_another_request_is_never_shown(change, status):
    v = values(look(replace(IMAGE, answer=replace(GOOD, **change)), answered=asker(GOOD)))
    assert v["STATUS"] == status
    assert holds_only_sentinels(v)
    if status != Status.IDLE:
        assert (v["ECHO"], v["POINT"], v["OBJECT"]) == (7, 4, 1)


@given(images, st.floats(NOW_S - 2, NOW_S + 2))
def test_until_it_says_so_a_view_does_not_change_but_for_its_age(image, now_s):
    seen = look(image, now_s)
    later = math.nextafter(min(seen.good_until_s, now_s + 10), 0)
    assume(later >= now_s)
    again = values(look(image, later))
    assert again.pop("AGE") - values(seen)["AGE"] <= 11
    before = values(seen)
    del before["AGE"]
    assert str(again) == str(before)


@given(images, st.floats(NOW_S - 2, NOW_S + 2))
def test_both_word_orders_hold_the_same_values_and_their_own_crc(image, now_s):
    seen = look(image, now_s)
    straight, swapped = values(seen), RESPONSE.decode(RESPONSE.swapped(seen.swapped))
    assert straight.pop("EC32_CRC") == crc_of(seen.response)
    assert swapped.pop("EC32_CRC") == crc_of(seen.swapped)
    assert str(straight) == str(swapped)


@given(images)
def test_an_image_survives_the_ring(image):
    packed = image.pack()
    assert len(packed) == PACKED_BYTES
    assert str(RegisterImage.unpack(packed)) == str(image)


def test_what_is_no_image_is_refused():
    with pytest.raises(IpcError, match="cannot be sent"):
        replace(IMAGE, answer=replace(GOOD, u95_um=-1)).pack()
    with pytest.raises(IpcError, match="not a register image"):
        RegisterImage.unpack(b"short")
    with pytest.raises(IpcError, match="not a register image"):
        RegisterImage.unpack(b"\xff" * PACKED_BYTES)
