"""The drawing of the error tree is the tree."""

import inspect

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
