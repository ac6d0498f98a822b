"""Efficiency and honesty of the estimates: error over the Cramer-Rao bound, and coverage of the 95 % regions.

Simulated sessions with known truth. The bound is the covariance predicted at the truth. Joint: 6 looks, 5 spins
and 8 touches, 4 of them tilted, once with an exact arm and once with an arm whose error field is modelled; the
expected coordinate is that of a picture taken after the table has turned.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.random import SeedSequence
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from fakes.world.arm_errors import EXACT_ARM, ArmErrors
from fakes.world.noise import COARSE
from fakes.world.simulation import BORED_CENTER_MM, WORK_ROTATION, SimulatedRequest, Simulation
from tests.benchmarks.harness import Row
from vgrd.calibration.hand_eye.fit import PoseSample
from vgrd.calibration.hand_eye.pose_pairs import HandEyeProblem, calibrate_hand_eye
from vgrd.calibration.joint.estimate import calibrate_joint, fit_as_if
from vgrd.calibration.joint.expected import expected_by_joint
from vgrd.calibration.joint.fit import JointFit
from vgrd.calibration.joint.problem import EvidenceKind, JointData
from vgrd.calibration.joint.samples import gather
from vgrd.calibration.joint.state import JointState
from vgrd.calibration.touches.equations import TouchSet
from vgrd.calibration.universal.estimate import Equations, UniversalProblem, calibrate_universal
from vgrd.geometry import Array, Pose, hat
from vgrd.geometry.covariance import covariance_from
from vgrd.model import ArmModel, Mount, Policy, Recording

SEED = 31
UNIVERSAL_RUNS = 1000
HAND_EYE_RUNS = 300
JOINT_RUNS = 1000
TOUCHES = 8
LOOKS = 8
SIGMA_MM = 0.233
ROBOT_MM, ROBOT_RAD = 0.05, 1e-4
TILT = np.radians(25)
BAR = 1.05
POINTS = 2.0
SEEN_AT = np.array([0.0, 0.0, 650.0])
ARMS = {"exact": EXACT_ARM, "field": ArmErrors(sigma_mm=0.03, field_mm=0.15)}
REGIONS = ("TCP", "EC xy", "EC z")


def rows() -> Iterator[Row]:
    """universal_vs_bound, hand_eye_vs_bound, and of both arms coverage_*, joint_*_vs_bound."""
    yield _universal()
    yield _hand_eye()
    for name, arm in ARMS.items():
        yield from _joint(name, arm)


def _universal() -> Row:
    rng = np.random.default_rng(SEED)
    errors, bounds = [], []
    for _ in range(UNIVERSAL_RUNS):
        p, t = rng.uniform(-150, 150, (TOUCHES, 3)), rng.uniform(-500, 500, 3)
        R, tcp = Rotation.random(random_state=rng).as_matrix(), np.array([10.0, -20.0, 150.0])
        wrists = Rotation.from_rotvec(rng.uniform(-1, 1, (TOUCHES, 3))).as_matrix()
        noise = rng.normal(0, SIGMA_MM, p.shape)
        sigma = np.full(TOUCHES, SIGMA_MM)
        tips = (p - t + noise) @ R
        axis = np.array([0.0, 0.0, 1.0])
        touches = TouchSet(wrists, tips - wrists @ tcp, axis, sigma, sigma)
        errors.append(calibrate_universal(UniversalProblem(p, touches)).tcp_in_wrist - tcp)
        J = Equations(p, touches).linearize((R, t, tcp))[1]
        bounds.append(covariance_from(J)[6:, 6:])
    note = f"TCP, {UNIVERSAL_RUNS} calibrations of {TOUCHES} touches"
    return _efficiency("universal_vs_bound", errors, bounds, note)


def _hand_eye() -> Row:
    rng = np.random.default_rng(SEED + 1)
    truth = Simulation.base_from_camera
    lever = np.hstack([np.eye(3), -hat(truth @ SEEN_AT)])
    errors, bounds = [], []
    for seed in range(HAND_EYE_RUNS):
        cell = Simulation(seed, vision=COARSE)
        samples = [_sample(cell, i, rng) for i in range(LOOKS)]
        problem = HandEyeProblem(Mount.EYE_TO_HAND, samples, ROBOT_MM, ROBOT_RAD)
        found = calibrate_hand_eye(problem).mount_from_camera
        errors.append(found @ SEEN_AT - truth @ SEEN_AT)
        bounds.append(lever @ _hand_eye_bound(cell, samples) @ lever.T)
    note = f"a point 650 mm before the camera, {HAND_EYE_RUNS} calibrations of {LOOKS} looks"
    return _efficiency("hand_eye_vs_bound", errors, bounds, note)


def _sample(cell: Simulation, number: int, rng: np.random.Generator) -> PoseSample:
    """One look; the robot reports its pose with noise in the flange's frame."""
    seen = cell.looks(1)[0]
    noise = Pose.exp(rng.normal(size=6) * ([ROBOT_MM] * 3 + [ROBOT_RAD] * 3))
    assert seen.tag_a is not None
    pose, tag = seen.base_from_wrist @ noise, seen.tag_a
    return PoseSample(f"look {number}", pose, tag.camera_from_tag, tag.covariance)


def _hand_eye_bound(cell: Simulation, samples: Sequence[PoseSample]) -> Array:
    """Covariance (6, 6) of base_from_camera, left tangent: tags' and robot's noise whitened."""
    information = np.zeros((12, 12))
    X_inv = cell.base_from_camera.inverse()
    robot = np.diag(np.array([ROBOT_MM] * 3 + [ROBOT_RAD] * 3) ** 2)
    for sample in samples:
        turn = X_inv @ sample.base_from_wrist
        J = np.hstack([-X_inv.adjoint(), turn.adjoint()])
        S = sample.covariance + turn.adjoint() @ robot @ turn.adjoint().T
        information += J.T @ np.linalg.solve(S, J)
    scale = 1 / np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    return np.asarray(inverse[:6, :6])


def _joint(name: str, arm: ArmErrors) -> list[Row]:
    model = ArmModel(arm.sigma_mm, arm.field_mm, arm.length_mm, arm.rad_per_mm)
    inside, errors, bounds = [], [], []
    for seed in SeedSequence(SEED).spawn(JOINT_RUNS):
        cell = Simulation(seed, vision=COARSE, arm=arm, center_sigma_mm=BORED_CENTER_MM)
        wrists = [cell.wrist()] * 4 + [cell.wrist(TILT) for _ in range(4)]
        recording = cell.record(looks=6, spins=5, wrists=wrists)
        request = cell.request()
        (tcp, T), (flange, C) = _answers(calibrate_joint(recording, arm=model), request)
        off, miss = tcp - cell.tcp_in_wrist, cell.miss(request, flange)
        parts = ((off, T), (miss[:2], C[:2, :2]), (miss[2:], C[2:, 2:]))
        inside.append([e @ np.linalg.solve(S, e) <= chdtri(len(e), 0.05) for e, S in parts])
        errors.append((off, miss))
        true = fit_as_if(*_truth(cell, recording, model))
        bounds.append([covariance for _, covariance in _answers(true, request)])
    return [
        *_coverage(name, np.mean(inside, axis=0)),
        *(
            _efficiency(
                f"joint_{what}_{name}_vs_bound",
                [error[k] for error in errors],
                [bound[k] for bound in bounds],
                f"{what.upper()}, arm {name}, {JOINT_RUNS} sessions",
            )
            for k, what in enumerate(("tcp", "ec"))
        ),
    ]


def _answers(
    result: JointFit, request: SimulatedRequest
) -> tuple[tuple[Array, Array], tuple[Pose, Array]]:
    """TCP and flange pose of the expected coordinate, each with its covariance."""
    part = result.layout.TCP
    expected = expected_by_joint(result, request.target, request.seen, Policy.FIXED, WORK_ROTATION)
    tcp = result.state.tcp_in_wrist, result.covariance[part, part]
    return tcp, (expected.base_from_wrist, expected.position_covariance)


def _truth(cell: Simulation, recording: Recording, arm: ArmModel) -> tuple[JointData, JointState]:
    """The evidence, and the unknowns as they are."""
    data = gather(recording, arm=arm)
    camera_from_base = cell.base_from_camera.inverse()
    angles = [
        cell.spin_angles[int(name.split()[1]) - 1] for name in data.names[EvidenceKind.SPINS]
    ]
    state = JointState(
        base_from_camera=cell.base_from_camera,
        wrist_from_tag_a=cell.wrist_from_tag_a,
        tcp_in_wrist=cell.tcp_in_wrist,
        base_from_object=cell.base_from_object(0.0),
        camera_from_tag_b=camera_from_base @ cell.base_from_object(0.0) @ cell.object_from_tag_b,
        camera_from_axis=camera_from_base @ cell.base_from_object(0.0),
        table_motion=np.column_stack([np.zeros((len(angles), 2)), angles]),
        fixed_point_in_base=cell.fixed_point_in_base,
    )
    return data, state


def _coverage(arm: str, shares: Array) -> list[Row]:
    """Percentage points between what the 95 % regions hold and 95."""
    return [
        Row.at_most(
            f"coverage_{arm}_{region.replace(' ', '_').lower()}",
            abs(100 * float(share) - 95),
            "points off 95 %",
            POINTS,
            f"{100 * share:.1f} % of {JOINT_RUNS} sessions, {region}, arm {arm}",
        )
        for region, share in zip(REGIONS, shares, strict=True)
    ]


def _efficiency(name: str, errors: Sequence[Array], bounds: Sequence[Array], note: str) -> Row:
    """Root mean square of the errors over the root of the mean bound."""
    rmse = float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1))))
    bound = float(np.sqrt(np.mean(np.trace(bounds, axis1=1, axis2=2))))
    return Row.at_most(name, rmse / bound, "x", BAR, f"{rmse:.4f} against {bound:.4f} mm; {note}")
