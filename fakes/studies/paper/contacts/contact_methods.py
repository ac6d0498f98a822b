"""Figure 3: the TCP by a fixed point, by a plane and by a ball, as many touches each.

The same noise of a touch, 0.233 mm in every direction, and wrists turned alike by up to 30 degrees about each axis. A
fixed point tells three directions, a plane or a ball only the one across its surface; the paper does not know
where plane and ball are. The predicted error is the root of the trace of the covariance that each fit states.
"""

from collections.abc import Callable, Mapping
from itertools import product
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.random import Generator, SeedSequence, default_rng
from scipy.spatial.transform import Rotation

from fakes.studies.paper.paper_data import NOISE_MM, truncated_noise
from fakes.studies.study import REFUSED, Figure, Parameters, Study, Trials
from vgrd.calibration.tcp import Plane, calibrate_fixed_point, calibrate_plane, calibrate_sphere
from vgrd.calibration.touches import TouchSet
from vgrd.charts import COLORS, legend, panels, plain_log_ticks
from vgrd.geometry import Array
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.geometry.covariance import rms

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_TOUCHES = (8, 12, 16, 24, 32)  # the first: one more than a ball has unknowns
_SHOWN = (12, 24)  # as many as an operator takes, and twice that
_TILT_DEG = 30.0  # what an operator reaches
_TCP = np.array([5.0, -8.0, 120.0])  # a tool of 120 mm, a little off the axis: any will do
_DOWN = np.diag([1.0, -1.0, -1.0])
_AXIS = np.array([0.0, 0.0, 1.0])
_PLACE = np.array([400.0, 100.0, 60.0])  # of point, plate and ball: any within reach
_HALF_PLATE_MM = 100.0  # half the side of a plate, a guess
_RADIUS_MM = 20.0  # of a ball on a stem, a guess
_LOWEST = -0.3  # sine below the equator of the ball, where its stem begins
_CHI2_95 = chi2_quantile(0.95, 3)


class _Contact(NamedTuple):
    """Where the tips are, (m, 3) in the base, and how their touches are solved."""

    tips: Callable[[Generator, int], Array]
    solve: Callable[[TouchSet], tuple[Array, Array]]


def _point(rng: Generator, m: int) -> Array:
    del rng  # always the same
    return np.tile(_PLACE, (m, 1))


def _plate(rng: Generator, m: int) -> Array:
    return np.asarray(_PLACE + rng.uniform(-_HALF_PLATE_MM, _HALF_PLATE_MM, (m, 3)) * (1, 1, 0))


def _ball(rng: Generator, m: int) -> Array:
    """Evenly over what the stem leaves free."""
    z, turn = rng.uniform(_LOWEST, 1, m), rng.uniform(-np.pi, np.pi, m)
    flat = np.sqrt(1 - z * z)
    return np.asarray(
        _PLACE + _RADIUS_MM * np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
    )


def _by_point(touches: TouchSet) -> tuple[Array, Array]:
    fit = calibrate_fixed_point(touches)
    return fit.tcp_in_wrist, fit.covariance[:3, :3]


def _by_plane(plane: Plane | None) -> Callable[[TouchSet], tuple[Array, Array]]:
    def solve(touches: TouchSet) -> tuple[Array, Array]:
        fit = calibrate_plane(touches, plane)
        return fit.tcp_in_wrist, fit.covariance

    return solve


def _by_ball(radius_mm: float | None) -> Callable[[TouchSet], tuple[Array, Array]]:
    def solve(touches: TouchSet) -> tuple[Array, Array]:
        fit = calibrate_sphere(touches, radius_mm)
        return fit.tcp_in_wrist, fit.covariance

    return solve


POINT, PLANE, BALL = "fixed point", "plane", "ball"
_CONTACTS: Mapping[str, _Contact] = MappingProxyType(
    {
        POINT: _Contact(_point, _by_point),
        PLANE: _Contact(_plate, _by_plane(None)),
        f"known {PLANE}": _Contact(_plate, _by_plane(Plane(_AXIS, float(_PLACE[2])))),
        BALL: _Contact(_ball, _by_ball(None)),
        f"{BALL} of known radius": _Contact(_ball, _by_ball(_RADIUS_MM)),
    }
)


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Error of the TCP and the one that its covariance predicts, mm.

    sigmas: the error in units of its covariance; inside: whether the 95 % region holds it.
    """
    rng, m = default_rng(seed), parameters["touches"]
    contact = _CONTACTS[parameters["contact"]]
    angles = rng.uniform(-_TILT_DEG, _TILT_DEG, (m, 3))
    R = _DOWN @ Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    tips = contact.tips(rng, m) + truncated_noise(rng, (m, 3))
    sigma = np.full(m, NOISE_MM)
    tcp, covariance = contact.solve(TouchSet(R, tips - R @ _TCP, _AXIS, sigma, sigma))
    miss = tcp - _TCP
    squares = float(miss @ np.linalg.solve(covariance, miss))
    return {
        "error_mm": float(np.linalg.norm(miss)),
        "predicted_mm": float(np.sqrt(np.trace(covariance))),
        "sigmas": float(np.sqrt(squares)),
        "inside": float(squares <= _CHI2_95),
    }


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for name, m in product(_CONTACTS, _SHOWN):
        case = {"contact": name, "touches": m}
        where = f"{name}, {m} touches"
        for column, what in (("error_mm", "rms error of the TCP"), ("predicted_mm", "predicted")):
            figures.append(Figure(f"{where}: {what}", _rms(trials, column, **case), "mm"))
    for name in _CONTACTS:
        sigmas = _rms(trials, "sigmas", contact=name) / np.sqrt(3)  # it has three numbers
        figures.append(Figure(f"{name}: error / predicted, all counts", sigmas, "", 0.93, 1.07))
        inside = 100 * trials.mean("inside", contact=name)
        figures.append(Figure(f"{name}: 95 % region holds, all counts", inside, "%", 93, 97))
        refused = 100 * np.mean([row[REFUSED] for row in trials.select(contact=name)])
        figures.append(Figure(f"{name}: refused, all counts", float(refused), "%"))
    for name in list(_CONTACTS)[1:]:
        errors = [_rms(trials, "error_mm", contact=c, touches=_SHOWN[0]) for c in (name, POINT)]
        label = f"{name} / {POINT}, {_SHOWN[0]} touches"
        figures.append(Figure(label, errors[0] / errors[1], "", at_least=1.0))
    return figures


def _rms(trials: Trials, column: str, **case: object) -> float:
    values = trials.values(column, **case)
    return rms(values) if values.size else float("nan")


def _draw(trials: Trials) -> "Drawing":
    runs = len(trials.select(contact=POINT, touches=_SHOWN[0]))
    drawing, (errors, shares) = panels(
        f"TCP by three kinds of contact, touches of {NOISE_MM:.2f} mm, {runs} each (figure 3)",
        ("touches", "rms error of the TCP, mm (dotted: predicted)"),
        ("touches", "95 % region holds, %"),
    )
    for color, name in zip(COLORS, _CONTACTS, strict=False):
        cases = [{"contact": name, "touches": m} for m in _TOUCHES]
        for column, style in (("error_mm", "o-"), ("predicted_mm", "s:")):
            label = name if column == "error_mm" else None
            values = [_rms(trials, column, **case) for case in cases]
            errors.plot(_TOUCHES, values, style, color=color, label=label)
        inside = [100 * trials.mean("inside", **case) for case in cases]
        shares.plot(_TOUCHES, inside, "o-", color=color)
    shares.axhspan(93, 97, color="#dddddd", alpha=0.6, lw=0)
    plain_log_ticks(errors, (0.2, 0.5, 1, 2, 5, 10), x=False)
    for axes in (errors, shares):
        axes.set_xticks(_TOUCHES)
    legend(errors, "upper right")
    return drawing


STUDY = Study(
    name="contact-methods",
    title="Figure 3: the TCP by a fixed point, a plane and a ball on equal touches",
    cases=tuple({"contact": name, "touches": m} for name in _CONTACTS for m in _TOUCHES),
    runs=400,
    trial=_trial,
    figures=_figures,
    most_refused=0.06,  # of an unknown ball, 8 touches are ambiguous in more than half
    draw=_draw,
)
