"""Robots that tell their poses in steps of their Modbus registers: a whole teaching, and answers, by profile.

Every pose of a session passes through the registers of a profile and back, as the driver reads it; pictures and
touches are the same without that. What the steps alone change in an answer is compared with what the error
budget says of them, and the stated 95 % radius with the true miss. A robot that tells floats stands beside.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from drivers import robot_profile
from drivers.robot_profile import RobotProfile
from fakes.studies.sessions import Session
from fakes.studies.study import Figure, Parameters, Study, Trials
from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import COARSE
from fakes.world.simulation import WORK_ROTATION, SimulatedRequest, Simulation
from vgrd.calibration.joint import JointFit, PriorSigmas, calibrate_joint, expected_by_joint
from vgrd.calibration.planning import Systematic, error_budget
from vgrd.charts import COLORS, PAPER, legend, panels
from vgrd.geometry import Array, Pose
from vgrd.model import ExpectedCoordinate, Observation, Plan, Policy, Recording, Touch

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_SESSION = Session(  # the paper's, with three touches more, tilted: they tell the TCP
    Plan.JOINT, looks=8, spins=10, touches=9, tilted=3
)
_PROFILES = ("jaka", "ur", "xarm", "doosan")  # floats, and every rotation format in steps
_REQUESTS = 5  # of one teaching: with 20 teachings the 100 answers of the issue
_ARM = ArmErrors(sigma_mm=0.03 / np.sqrt(3), field_mm=0.09)  # together the cell file's 0.1 mm
_PENDANT_TCP = Pose.from_rotvec((0.0, 0.0, 0.35), (4.0, 1.5, 121.0))  # as the fake cell's
_PICTURES_ONLY = Systematic(PriorSigmas(), 0.0)  # nothing that no picture of the simulation has
_ROUNDING = "pose quantisation"  # as the budget calls it
_BAR = (93.0, 98.0)  # %: what is rounded is taken as worse than it is where it is told in a TCP


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """Means over the requests: squares (mm^2) of misses and of what rounding changed, shares inside u95."""
    profile = robot_profile.load(parameters["robot"])
    cell = Simulation(seed, vision=COARSE, arm=_ARM)
    exact = _SESSION.record(cell)
    told = _as_read(exact, profile)
    fits = calibrate_joint(exact), calibrate_joint(told)
    rows = [_of_request(cell, *fits, cell.request()) for _ in range(_REQUESTS)]
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


def _of_request(
    cell: Simulation, exact: JointFit, told: JointFit, request: SimulatedRequest
) -> dict[str, float]:
    without, answer = _answer(exact, request), _answer(told, request)
    miss = cell.miss(request, answer.base_from_wrist)
    changed = answer.base_from_wrist.translation - without.base_from_wrist.translation
    seen = request.seen.tag_b
    if seen is None:
        raise AssertionError("the simulation always sees tag B")
    budget = error_budget(
        told, seen, Policy.FIXED, WORK_ROTATION, _PICTURES_ONLY, (request.target,)
    )
    share = float(budget.rows()[0].get(_ROUNDING, 0.0))  # a robot that tells floats has none
    return {
        "miss": float(miss @ miss),
        "stated": float(np.trace(answer.position_covariance)),
        "inside": 100.0 * float(np.linalg.norm(miss) <= answer.u95_mm),
        "changed": float(changed @ changed),
        "explained": float(share * np.trace(answer.position_covariance)),
    }


def _answer(fit: JointFit, request: SimulatedRequest) -> ExpectedCoordinate:
    return expected_by_joint(fit, request.target, request.seen, Policy.FIXED, WORK_ROTATION)


def _as_read(recording: Recording, profile: RobotProfile) -> Recording:
    """The recording with every pose as it comes out of the robot's registers, and the steps as told."""
    step_mm, step_rad = profile.flange_steps(_PENDANT_TCP)
    return replace(
        recording,
        facts=replace(recording.facts, robot_step_mm=step_mm, robot_step_rad=step_rad),
        looks=_pictures_as_read(recording.looks, profile),
        spins=_pictures_as_read(recording.spins, profile),
        touches=tuple(_touch_as_read(touch, profile) for touch in recording.touches),
    )


def _pictures_as_read(
    pictures: Sequence[Observation], profile: RobotProfile
) -> tuple[Observation, ...]:
    return tuple(
        replace(one, base_from_wrist=_pose_as_read(one.base_from_wrist, profile))
        for one in pictures
    )


def _touch_as_read(touch: Touch, profile: RobotProfile) -> Touch:
    pose = _pose_as_read(touch.base_from_wrist, profile)
    seen = touch.observation
    return replace(
        touch,
        base_from_wrist=pose,
        observation=None if seen is None else replace(seen, base_from_wrist=pose),
    )


def _pose_as_read(base_from_wrist: Pose, profile: RobotProfile) -> Pose:
    """As `drivers.modbus_robot` reads it; the operator knows the offset of a TCP that is not told."""
    pose, offset = profile.decode(profile.encode(base_from_wrist, _PENDANT_TCP))
    if profile.frame == "flange":
        return pose
    return pose @ (_PENDANT_TCP if offset is None else offset).inverse()


def _figures(trials: Trials) -> list[Figure]:
    figures = []
    for robot in _PROFILES:
        rms = {
            key: math.sqrt(trials.mean(key, robot=robot))
            for key in ("miss", "stated", "changed", "explained")
        }
        figures += [
            Figure(f"{robot}: rms miss of the EC", rms["miss"], "mm"),
            Figure(f"{robot}: rms that is stated", rms["stated"], "mm"),
            Figure(f"{robot}: rms that rounding changes", rms["changed"], "mm"),
            Figure(f"{robot}: rms that the budget gives to rounding", rms["explained"], "mm"),
            Figure(f"{robot}: u95 holds", trials.mean("inside", robot=robot), "%", *_BAR),
        ]
        if rms["explained"] > 0:
            ratio = rms["changed"] / rms["explained"]
            figures.append(Figure(f"{robot}: rounding, changed / explained", ratio, "", None, 1.1))
    return figures


def _draw(trials: Trials) -> "Drawing":
    runs = len(trials.select(robot=_PROFILES[0]))
    drawing, (left, right) = panels(
        f"Robots read over Modbus, {runs} teachings of {_REQUESTS} answers each",
        ("", "rms of the EC, mm"),
        ("", "answers within their u95, %"),
    )
    places = np.arange(len(_PROFILES))
    for k, (key, words) in enumerate(
        {"miss": "true miss", "stated": "stated", "changed": "changed by rounding"}.items()
    ):
        heights: Array = np.sqrt([trials.mean(key, robot=robot) for robot in _PROFILES])
        left.bar(places + 0.27 * (k - 1), heights, 0.25, color=COLORS[k], label=words)
    inside = [trials.mean("inside", robot=robot) for robot in _PROFILES]
    right.plot(places, inside, "o", color=COLORS[0])
    right.axhline(95.0, color=PAPER, ls=(0, (5, 3)), linewidth=1, label="95 %")
    right.set_ylim(85, 100)
    for axes in (left, right):
        axes.set_xticks(places, _PROFILES)
    legend(left)
    return drawing


STUDY = Study(
    name="modbus-robot",
    title="Robots that tell their poses in steps: answers and their stated radius, by profile",
    cases=tuple({"robot": robot} for robot in _PROFILES),
    runs=200,
    full_runs=1000,
    trial=_trial,
    figures=_figures,
    draw=_draw,
)
