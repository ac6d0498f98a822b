"""What is stored comes back to the last bit, and nothing else is taken for it."""

import json
import math
from dataclasses import dataclass, fields, is_dataclass

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.world.samples import Samples
from vgrd.calibration.calibration import Calibration
from vgrd.devices import FlangeReading
from vgrd.errors import Corrupt, StoreError
from vgrd.geometry import Array, Pose
from vgrd.model import CellFacts, Observation, TagObservation, Tool, Touch
from vgrd.store.encoding import canonical, decode, encode, parse

SEEDS = st.integers(0, 2**32 - 1)
FLOATS = st.floats(allow_nan=False)


@dataclass(frozen=True, eq=False)
class Numbers:
    """Every kind of number the model has."""

    grid: Array
    one: float
    count: int
    pair: tuple[int, int]
    many: tuple[float, ...]
    named: dict[str, float | None]


def assert_same(a, b):
    """Equal types and bits, all the way down."""
    assert type(a) is type(b)
    if isinstance(a, np.ndarray):
        assert a.shape == b.shape
        assert a.tobytes() == b.tobytes()
        assert not b.flags.writeable
    elif is_dataclass(a):
        for field in fields(a):
            assert_same(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            assert_same(a[key], b[key])
    elif isinstance(a, tuple):
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            assert_same(x, y)
    elif isinstance(a, float):
        assert a.hex() == b.hex()
    else:
        assert a == b


def through_json(value, kind):
    return decode(kind, parse(canonical(encode(value)), "file"), "file")


@given(
    st.builds(
        Numbers,
        grid=arrays.arrays(
            np.float64, arrays.array_shapes(max_dims=3, max_side=4), elements=FLOATS
        ),
        one=FLOATS,
        count=st.integers(),
        pair=st.tuples(st.integers(), st.integers()),
        many=st.lists(FLOATS).map(tuple),
        named=st.dictionaries(st.text(), st.none() | FLOATS),
    )
)
def test_every_number_comes_back_to_the_last_bit(value):
    assert_same(value, through_json(value, Numbers))


@pytest.mark.parametrize(
    ("kind", "draw"),
    [
        (Pose, lambda s: s.pose()),
        (TagObservation, lambda s: s.observation().tag_b),
        (Observation, lambda s: s.observation()),
        (Touch, lambda s: s.touch()),
        (CellFacts, lambda s: s.facts()),
        (Calibration, lambda s: s.calibration()),
        (FlangeReading, lambda s: s.flange(1.5)),
    ],
)
@pytest.mark.parametrize("seed", range(5))
def test_model_values_come_back_to_the_last_bit(kind, draw, seed):
    value = draw(Samples(seed))
    assert_same(value, through_json(value, kind))


@given(st.data())
def test_a_missing_or_an_unknown_key_is_refused_by_name(data):
    encoded = encode(Samples(1).calibration())
    node, path = encoded, []
    while data.draw(st.booleans()) and (
        inner := [k for k in ("facts", "tool", "verdict") if k in node]
    ):
        path.append(data.draw(st.sampled_from(inner)))
        node = node[path[-1]]
    key = data.draw(st.sampled_from(sorted(node.keys())))
    value = node.pop(key)
    with pytest.raises(Corrupt, match=rf"cal\.json.*{key}"):
        decode(Calibration, encoded, "cal.json")
    node[key] = value
    node["colour"] = 1
    with pytest.raises(Corrupt, match=r"cal\.json.*unknown key 'colour'"):
        decode(Calibration, encoded, "cal.json")


@pytest.mark.parametrize(
    ("key", "wrong"),
    [
        ("name", 3),
        ("axis_in_wrist", "inf"),
        ("axis_in_wrist", [1, 2, "three"]),
        ("axis_in_wrist", [[1, 2], [3]]),
        ("axis_in_wrist", [True, False, True]),
        ("axis_in_wrist", {"x": 1}),
    ],
)
def test_a_value_of_a_wrong_type_is_refused_by_name(key, wrong):
    with pytest.raises(Corrupt, match=key):
        decode(Tool, encode(Tool()) | {key: wrong}, "file")


@pytest.mark.parametrize("wrong", [True, "1", "nan", None, pytest.param(10**400, id="huge")])
def test_a_number_is_a_number(wrong):
    with pytest.raises(Corrupt, match="expected a number"):
        decode(float, wrong, "file")


def test_a_pose_that_is_no_rigid_motion_is_refused_by_name():
    data = encode(Pose.identity()) | {"rotation": (2 * np.eye(3)).tolist()}
    with pytest.raises(Corrupt, match="file: not a rotation"):
        decode(Pose, data, "file")


def test_a_number_that_is_none_is_never_stored():
    with pytest.raises(StoreError, match=r"touch\.lateral_sigma_mm is not a number"):
        encode(Touch("P1", Pose.identity(), math.nan, 1.0), "touch")


def test_numpy_scalars_are_stored_as_the_numbers_they_are():
    assert canonical(encode((np.float64(0.1), np.int64(3), np.bool_(True)))) == b"[0.1,3,true]"


@pytest.mark.parametrize("text", [b"{", b"NaN", b"[1e999]", b"\xff", b"[" * 100_000])
def test_what_is_not_json_is_corrupt(text):
    with pytest.raises(Corrupt, match="file: not readable"):
        parse(text, "file")


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | FLOATS.filter(math.isfinite) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=10,
)


@given(JSON)
def test_the_canonical_spelling_is_json_and_stable(data):
    text = canonical(data)
    assert canonical(json.loads(text)) == text


@given(JSON)
def test_the_spelling_in_parts_is_that_of_one_call(data):
    whole = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    assert canonical(data) == whole.encode("ascii")


def test_no_single_call_spells_much_of_a_large_calibration(monkeypatch):
    """A call of the encoder holds the GIL, and the serving loop, until it is done."""
    spelled = []
    dumps = json.dumps

    def measured(data, **options):
        text = dumps(data, **options)
        spelled.append(len(text))
        return text

    monkeypatch.setattr(json, "dumps", measured)
    large = {"matrix": np.random.default_rng(1).normal(size=(300, 300)).tolist(), "id": "x"}
    whole = canonical(large)
    assert max(spelled) < len(whole) / 250
