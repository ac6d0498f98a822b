"""A calibration is of the cell that the file describes, or it is refused, and every difference is named."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, make_dataclass, replace
from enum import Enum
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.cell.rehearsal import facts_of
from fakes.world.layout import Layout
from fakes.world.world import CellNoise, World
from vgrd.geometry import Pose
from vgrd.model import CellFacts, Motion, TagSpec, Target, frozen_array
from vgrd.solving.differences import (
    MAY_CHANGE,
    MAY_CHANGE_OF_TARGETS,
    MAY_GROW,
    fact_differences,
    file_key,
)
from vgrd.store.encoding import decode, encode


@pytest.fixture(scope="module")
def facts(tmp_path_factory: pytest.TempPathFactory) -> CellFacts:
    """With no field left None, so that each can be changed."""
    found = facts_of(World(Layout(), 5, CellNoise.none()), tmp_path_factory.mktemp("facts"))
    targets = {
        name: replace(
            target,
            base_from_work=frozen_array(np.eye(3), 3, 3),
            hole_diameter_mm=target.id + 5.0,
            clearance_mm=0.4,
        )
        for name, target in found.object.targets.items()
    }
    spec = replace(found.object, targets=targets, center_in_object=frozen_array([1, 2, 3], 3))
    distortion = frozen_array([0.1, 0.2, 0.0, 0.0, 0.1], 5)
    return replace(found, object=spec, distortion=distortion, robot_id="r", camera_id="c")


def leaves(value: object, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], object]]:
    """Everything that holds nothing else; written apart from the code under test."""
    if is_dataclass(value) and not isinstance(value, Pose):
        for item in fields(value):
            yield from leaves(getattr(value, item.name), (*path, item.name))
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from leaves(item, (*path, key))
    else:
        yield path, value


def changed(value: object) -> object:
    if isinstance(value, Enum):
        return next(other for other in type(value) if other is not value)
    if isinstance(value, np.ndarray):
        moved = np.array(value)
        moved.flat[-1] += 1e-3
        return frozen_array(moved, *moved.shape)
    if isinstance(value, Pose):
        return Pose(value.rotation, value.translation + 1e-3)
    if isinstance(value, tuple):
        return (*value[:-1], value[-1] + 1)
    if isinstance(value, str):
        return value + "x"
    if isinstance(value, int):
        return value + 1
    assert isinstance(value, float)
    return value * 1.001


def with_leaf(value: object, path: tuple[str, ...], leaf: object) -> object:
    if not path:
        return leaf
    first, *rest = path
    if isinstance(value, Mapping):
        return {**value, first: with_leaf(value[first], tuple(rest), leaf)}
    return replace(value, **{first: with_leaf(getattr(value, first), tuple(rest), leaf)})  # type: ignore[type-var]


def test_every_single_fact_that_changed_is_named_and_nothing_else(facts: CellFacts) -> None:
    assert fact_differences(facts, facts) == []
    checked = 0
    for path, value in leaves(facts):
        other = with_leaf(facts, path, changed(value))
        told = fact_differences(facts, other)
        if ".".join(path) in MAY_CHANGE or path[-1] in MAY_CHANGE_OF_TARGETS:
            assert told == []
            continue
        assert len(told) == 1, (path, told)
        assert told[0].startswith(f"{file_key('.'.join(path))} was "), told
        assert fact_differences(other, facts) != []
        checked += 1
    assert checked > 40


def test_a_fact_that_is_gone_or_new_is_named(facts: CellFacts) -> None:
    assert any("tags.a" in one for one in fact_differences(facts, replace(facts, tag_a=None)))
    bare = replace(facts, object=replace(facts.object, center_in_object=None))
    assert fact_differences(bare, facts) == ["object.center_mm was none, is [1.0, 2.0, 3.0]"]
    shorter = replace(facts, distortion=frozen_array([], 0))
    assert len(fact_differences(facts, shorter)) == 1


def test_a_field_that_the_model_gets_later_is_compared_without_another_line() -> None:
    Later = make_dataclass("Later", [("cad_sigma_mm", float)], frozen=True)
    assert fact_differences(Later(0.1), Later(0.2)) == ["cad_sigma_mm was 0.1, is 0.2"]  # type: ignore[arg-type]


def test_a_kind_of_value_without_a_rule_is_a_fault_and_not_taken_for_equal() -> None:
    Later = make_dataclass("Later", [("shape", object)], frozen=True)
    with pytest.raises(TypeError, match="no rule"):
        fact_differences(Later({1}), Later({1}))  # type: ignore[arg-type]


def test_what_may_change_is_a_fact_and_has_a_reason(facts: CellFacts) -> None:
    paths = {path for path, _ in leaves(facts)}
    for key, why in {**MAY_CHANGE, **MAY_GROW}.items():
        assert any(".".join(path).startswith(key) for path in paths), key
        assert len(why) > 20


def test_a_new_target_is_no_difference_but_a_missing_or_renamed_one_is(facts: CellFacts) -> None:
    targets = dict(facts.object.targets)
    more = {**targets, "new": Target(99, "new", frozen_array([1, 1, 1], 3))}
    with_more = replace(facts, object=replace(facts.object, targets=more))
    assert fact_differences(facts, with_more) == []
    assert fact_differences(with_more, facts) == ["object.targets.new was there, is not there now"]


@given(st.floats(-1e-13, 1e-13))
def test_rounding_of_another_processor_is_no_difference(wobble: float) -> None:
    @dataclass(frozen=True)
    class One:
        point: np.ndarray
        motion: Motion
        tag: TagSpec

    def one(by: float) -> One:
        return One(np.array([60.0 + by, 1e-3 + by]), Motion.FREE, TagSpec("36h11", 1, 25.0))

    assert fact_differences(one(0.0), one(wobble)) == []  # type: ignore[arg-type]


def test_facts_that_were_stored_and_read_are_the_same(facts: CellFacts, tmp_path: Path) -> None:
    again = decode(CellFacts, encode(facts), "facts")
    assert fact_differences(again, facts) == []
    frozen = replace(
        facts, object=replace(facts.object, targets=MappingProxyType(dict(facts.object.targets)))
    )
    assert fact_differences(frozen, facts) == []


def test_a_clearance_may_be_written_into_the_file_of_a_cell_that_serves(facts: CellFacts) -> None:
    targets = {n: replace(t, clearance_mm=None) for n, t in facts.object.targets.items()}
    before = replace(facts, object=replace(facts.object, targets=targets))
    assert fact_differences(before, facts) == []
