"""The drawing of the error tree is the tree."""

import inspect
import pickle

import pytest

from vgrd import errors


def drawn() -> dict[str, str]:
    """Class -> parent, as drawn at the head of the module."""
    parents, stack = {}, []
    for line in (errors.__doc__ or "").splitlines():
        words = line.split()
        depth = len(line) - len(line.lstrip())
        if depth < 4 or not words:
            continue
        stack = [(d, name) for d, name in stack if d < depth]
        parents[words[0]] = stack[-1][1] if stack else "Exception"
        stack.append((depth, words[0]))
    return parents


def test_every_error_is_drawn_below_its_parent() -> None:
    real = {
        name: value.__bases__[0].__name__
        for name, value in inspect.getmembers(errors, inspect.isclass)
        if issubclass(value, Exception)
    }
    assert drawn() == real


def test_every_error_has_an_exit_code_and_a_contract() -> None:
    for name in drawn():
        error = getattr(errors, name)
        assert error.__doc__
        assert 0 < error.exit_code < 128


def test_a_refusal_of_the_daemon_ends_with_the_code_of_its_reason() -> None:
    assert errors.ControlError("no", error="NotSteady").exit_code == errors.NotSteady.exit_code
    assert errors.ControlError("no", error="InputError").exit_code == errors.InputError.exit_code
    assert errors.ControlError("no", error="never heard of").exit_code == 1
    assert errors.DaemonUnreachable("gone").exit_code == 69


EXAMPLES = {
    errors.ConfigError: errors.ConfigError("cell.toml", ["a fault"]),
    errors.Contradiction: errors.Contradiction("moved", ["tag A"], 2.0),
    errors.NotObservable: errors.NotObservable("more", rank=5, unknowns=6),
    errors.ControlError: errors.ControlError("no", error="NotSteady"),
}
"""Errors that are made from more than a message."""


@pytest.mark.parametrize("name", sorted(drawn()))
def test_an_error_is_the_same_after_its_way_from_a_worker(name: str) -> None:
    kind = getattr(errors, name)
    error = EXAMPLES.get(kind) or kind("told")
    again = pickle.loads(pickle.dumps(error))  # noqa: S301 - our own bytes
    assert type(again) is kind
    assert str(again) == str(error)
    assert vars(again) == vars(error)
