"""A state of teaching in words and numbers, as lines. Pure: states are replies of `teaching`."""

from collections.abc import Iterator, Sequence

from vgrd.commands.wizard.steering import State

_TREND_LENGTH = 8  # points; as many as fit in a line of 80 columns


def line_of(state: State) -> str:
    """The whole state as one line, for pipes."""
    return " | ".join(" ".join(one.split()) for one in (headline(state), *details(state)))


def headline(state: State) -> str:
    """The one next step."""
    step = state["step"]
    count = f" ({step['done']} of {step['of']} done)" if step["of"] else ""
    return f"{step['kind'].upper()}{count}: {step['words']}"


def details(state: State) -> Iterator[str]:
    """What belongs to it: pose, what is unknown, errors, suspects, clock."""
    yield from _pose(state["step"])
    if state["session"] is None:
        yield f"calibration in use: {state['active'] or 'none'}"
        return
    yield from _trouble(state)
    yield from _errors(state)
    yield from _suspects(state)
    have = ", ".join(f"{n} {kind}" for kind, n in state["have"].items()) or "no samples"
    missing = ", ".join(f"{n} {kind}" for kind, n in state["missing"].items())
    yield f"session {state['session']['name']}: {have}" + (f"; missing {missing}" * bool(missing))
    clock = state["clock"]
    yield f"operator {clock['minutes']:.1f} min, since the start {clock['elapsed_s'] / 60:.1f} min"


def _pose(step: State) -> Iterator[str]:
    if step["flange_mm"] is not None and step["rotvec_deg"] is not None:
        place, turn = _numbers(step["flange_mm"], 1), _numbers(step["rotvec_deg"], 1)
        yield f"flange in base: {place} mm, rotation vector {turn} deg"
    if step["no_pose"]:
        yield f"no pose is advised: {step['no_pose']}"


def _trouble(state: State) -> Iterator[str]:
    told = dict.fromkeys((state["trouble"], state["unknown"]))
    yield from (f"unknown yet: {one}" for one in told if one)
    if state["warning"]:
        yield f"warning: {state['warning']}"
    yield from state["odd"]


def _errors(state: State) -> Iterator[str]:
    """Predicted 95 % error by target, and how the largest fell."""
    tolerance_mm, late = state["tolerance_mm"], " (being computed anew)" * state["computing"]
    errors = ", ".join(f"{one['name']} {_mm(one['u95_mm'])}" for one in state["targets"])
    yield f"predicted 95 % error, mm: {errors}; tolerance {tolerance_mm:g}{late}"
    trend = [_mm(one["u95_mm"]) for one in state["trend"][-_TREND_LENGTH:]]
    if len(trend) > 1:
        yield f"largest of them, by sample: {' > '.join(trend)}"


def _suspects(state: State) -> Iterator[str]:
    for touch in state["touches"]:
        if touch["reason"]:
            yield f"suspect: {touch['name']} is off by {_mm(touch['off_mm'])} mm: {touch['reason']}"
    for one in state["samples"]:
        if one["remark"]:
            yield f"sample {one['sample']} ({one['words']}): {one['remark']}"


def _mm(value: float | None) -> str:
    return "?" if value is None else f"{value:.2f}"


def _numbers(values: Sequence[float], digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
