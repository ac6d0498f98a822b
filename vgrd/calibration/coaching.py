"""Coaching: the sample that would lower the expected coordinate's 95 % error the most.

What counts is the job: its policy and the orientation in which the tool works, not the TCP. Every
candidate is predicted at the present estimate and added to its information.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaincinv

from vgrd.calibration.joint import JointResult, calibrate_joint, information_inverse
from vgrd.calibration.joint_expected import predict, work_orientation
from vgrd.calibration.joint_problem import JointData, Link, Looks, Tags, target_of
from vgrd.calibration.joint_rows import arm_jacobian, linearize, moves
from vgrd.calibration.joint_state import JointState, Layout
from vgrd.calibration.touches import TouchSet, touch_set
from vgrd.geometry import Array, Pose, exp_rotation, log_rotation
from vgrd.geometry.covariance import whitener
from vgrd.model import Policy, Recording, TagObservation, TagSpec, frozen_array

_QUARTERS = (0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi)
_NONE = np.zeros(0, dtype=np.intp)


@dataclass(frozen=True, slots=True)
class Touching:
    """Touch a target with the wrist oriented as base_from_wrist (3, 3)."""

    target: str
    base_from_wrist: Array


@dataclass(frozen=True, slots=True)
class Looking:
    """Look at tag A from a flange pose."""

    base_from_wrist: Pose


@dataclass(frozen=True, slots=True)
class Spinning:
    """Take a picture of the object turned by an angle since it was touched."""

    angle_rad: float


Candidate = Touching | Looking | Spinning


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """What will be asked for; everything in it counts alike.

    works: orientations (3, 3) of the wrist at work, none for the one of the touches; angles_rad:
    turns of the object; targets: names, None for all of CAD.
    """

    policy: Policy = Policy.FIXED
    works: Sequence[Array] = ()
    angles_rad: Sequence[float] = _QUARTERS
    targets: Sequence[str] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Advice:
    """A candidate, the mean 95 % error (mm) of the job without and with it, and a sentence."""

    candidate: Candidate
    before_mm: float
    after_mm: float
    sentence: str = field(repr=False, default="")


def next_best(
    taught: Recording | JointResult,
    candidates: Sequence[Candidate],
    job: Job | None = None,
    *,
    tag_a_in_view: Callable[[Pose], bool] | None = None,
) -> tuple[Advice, ...]:
    """Candidates ranked, the best first, with the error predicted after each one.

    tag_a_in_view: whether the camera can see tag A at a camera_from_tag_a; None: it always can.
    Raises what `calibrate_joint` raises where too little was recorded for a first estimate.
    """
    result = taught if isinstance(taught, JointResult) else calibrate_joint(taught)
    coach = _Coach(result, job or Job(), tag_a_in_view)
    before = coach.error_mm(coach.covariance)
    advice = []
    for candidate in candidates:
        after = coach.error_mm(coach.with_rows(coach.covariance, coach.rows(candidate)))
        sentence = f"{in_words(result, candidate)}: 95 % error {before:.3f} -> {after:.3f} mm"
        advice.append(Advice(candidate, before, after, sentence))
    return tuple(sorted(advice, key=lambda one: one.after_mm))


def plan_touches(
    nominal: JointResult,
    count: int,
    candidates: Sequence[Touching],
    job: Job | None = None,
    *,
    tag_a_in_view: Callable[[Pose], bool] | None = None,
) -> tuple[Touching, ...]:
    """The `count` touches that serve the job best, touches of `nominal` itself left out.

    Greedy, then exchanged one by one until none improves (Fedorov 1972). nominal: any estimate of
    a cell like this one, an earlier session's or a drawing's.
    """
    coach = _Coach(nominal, job or Job(), tag_a_in_view)
    rows = [coach.rows(candidate) for candidate in candidates]
    empty = coach.without_touches()
    chosen: list[int] = []

    def best(kept: Sequence[int]) -> int:
        P = empty
        for i in kept:
            P = coach.with_rows(P, rows[i])
        return int(np.argmin([coach.error_mm(coach.with_rows(P, J)) for J in rows]))

    for _ in range(count):
        chosen.append(best(chosen))
    for _ in range(3):
        before = list(chosen)
        for k in range(count):
            chosen[k] = best(chosen[:k] + chosen[k + 1 :])
        if chosen == before:
            break
    return tuple(candidates[i] for i in chosen)


def tilted_touches(
    result: JointResult,
    tilt_rad: float,
    yaw_rad: float = 0.0,
    *,
    directions: int = 6,
    targets: Sequence[str] | None = None,
) -> list[Touching]:
    """Touches of every target: straight, and tilted by `tilt_rad` to all sides; turned by +-yaw."""
    names = targets or sorted(result.recording.facts.object.targets)
    axis = np.asarray(result.recording.facts.tool.axis_in_wrist)
    across = np.linalg.svd(axis[None])[2][1:]
    sides = np.arange(directions) * 2 * np.pi / directions
    tilts = [
        np.zeros(3),
        *(tilt_rad * (np.cos(a) * across[0] + np.sin(a) * across[1]) for a in sides),
    ]
    yaws = [0.0] if yaw_rad == 0 else [-yaw_rad, 0.0, yaw_rad]
    out = []
    for name in names:
        R = work_orientation(result.recording, name, Policy.FIXED, None)
        out += [
            Touching(name, R @ exp_rotation(tilt) @ exp_rotation(yaw * axis))
            for tilt in tilts
            for yaw in yaws
        ]
    return out


def in_words(result: JointResult, candidate: Candidate) -> str:
    """What the operator is to do."""
    if isinstance(candidate, Spinning):
        return (
            f"turn the object to {np.degrees(candidate.angle_rad):.0f} degrees and take a picture"
        )
    if isinstance(candidate, Looking):
        x, y, z = candidate.base_from_wrist.translation
        return f"look with the flange at ({x:.0f}, {y:.0f}, {z:.0f}) mm"
    axis = np.asarray(result.recording.facts.tool.axis_in_wrist)
    R = work_orientation(result.recording, candidate.target, Policy.FIXED, None)
    now, then = R @ axis, candidate.base_from_wrist @ axis
    tilt = float(np.arctan2(np.linalg.norm(np.cross(now, then)), now @ then))
    if tilt < np.radians(0.5):
        return f"touch {candidate.target} with the wrist as usual"
    x, y = (then - now * (now @ then))[:2]
    side = np.degrees(np.arctan2(y, x))
    turn = np.degrees(np.linalg.norm(log_rotation(R.T @ candidate.base_from_wrist)))
    return (
        f"touch {candidate.target} with the tip tilted by {np.degrees(tilt):.0f} degrees towards "
        f"{side:.0f} degrees of the base ({turn:.0f} degrees of turn in all)"
    )


class _Coach:
    """Predicts rows of candidates at the present estimate, and the job's error from them."""

    def __init__(
        self, result: JointResult, job: Job, tag_a_in_view: Callable[[Pose], bool] | None
    ) -> None:
        self._result = result
        self._in_view = tag_a_in_view or (lambda _: True)
        self._body_a = _body_covariance(result.data.looks.tags)
        self._body_b = _body_covariance(result.data.reference)
        N = result.undetermined
        self.covariance = result.covariance + N @ N.T
        self._asked = self._ask(job)

    def error_mm(self, covariance: Array) -> float:
        """Mean 95 % radius over everything that the job asks for."""
        B, rest = self._asked
        return float(_radii95(B @ covariance @ B.transpose(0, 2, 1) + rest).mean())

    @staticmethod
    def with_rows(covariance: Array, rows: Array) -> Array:
        """Covariance after rows (r, n) of unit noise were measured."""
        gain = covariance @ rows.T
        S = np.eye(len(rows)) + rows @ gain
        return np.asarray(covariance - gain @ np.linalg.solve(S, gain.T))

    def without_touches(self) -> Array:
        """Covariance from looks, spins and holes: no touches, nor what was seen while touching."""
        data, layout = self._result.data, self._result.layout
        kept = np.flatnonzero(~np.isin(data.looks.stands, data.touch_stands))
        rest = replace(_blank(data), looks=data.looks.some(kept))
        J = _whitened(self._result.state, rest, replace(layout, spins=0))
        rows = [_embedded(J, layout)]
        for link in (Link.SPINS, Link.HOLES, Link.TURNTABLE):
            rows.append(self._result.jacobian[data.rows_of(link)])
        P, N = information_inverse(np.vstack(rows), layout)
        return P + N @ N.T

    def rows(self, candidate: Candidate) -> Array:
        """Rows (r, n) of unit noise that the candidate would add."""
        state, layout = self._result.state, self._result.layout
        if isinstance(candidate, Spinning):
            return self._spin_rows(candidate.angle_rad)
        if isinstance(candidate, Looking):
            data = self._seen(_blank(self._result.data), candidate.base_from_wrist)
        else:
            data = self._touched(candidate)
        return _embedded(_whitened(state, data, replace(layout, spins=0)), layout)

    def _touched(self, candidate: Touching) -> JointData:
        result, R = self._result, candidate.base_from_wrist
        state, tool = result.state, result.recording.facts.tool
        p = np.asarray(target_of(result.recording, candidate.target).point_in_object)
        pose = Pose(R, state.base_from_object @ p - R @ state.tcp_in_wrist)
        known = result.data.touches
        lateral = float(np.median(known.lateral_sigma_mm))
        axial = float(np.median(known.axial_sigma_mm))
        data = self._seen(_blank(result.data), pose)
        return replace(
            data,
            touches=touch_set([pose], tool.axis_in_wrist, [lateral], [axial]),
            cad=p[None],
            touch_stands=np.zeros(1, dtype=np.intp),
            reference=_tag(state.camera_from_tag_b, self._body_b),
            flange_at=pose.translation[None],
        )

    def _seen(self, data: JointData, pose: Pose) -> JointData:
        state = self._result.state
        tag = state.base_from_camera.inverse() @ pose @ state.wrist_from_tag_a
        if not self._in_view(tag):
            return data
        stands = np.zeros(1, dtype=np.intp)
        tags = _tag(tag, self._body_a)
        looks = Looks(tags, pose.rotation[None], pose.translation[None], stands)
        return replace(data, looks=looks, flange_at=pose.translation[None])

    def _spin_rows(self, angle_rad: float) -> Array:
        """A spin more; its own angle, which nobody knows, is eliminated."""
        result, layout = self._result, self._result.layout
        if not layout.axis:
            return np.zeros((0, layout.size))
        alone = replace(layout, spins=1)
        planar = np.array([[0.0, 0.0, angle_rad]])
        state = replace(result.state, planar=planar)
        tag = _tag(self._moved(angle_rad), self._body_b)
        J = linearize(state, replace(_blank(result.data), spins=tag), alone)[1]
        own = alone.spin_columns()[0]
        Q = np.linalg.qr(J[:, own])[0]
        return _embedded(J - Q @ (Q.T @ J), layout)

    def _moved(self, angle_rad: float) -> Pose:
        state, layout = self._result.state, self._result.layout
        at = moves(state, np.array([[0.0, 0.0, angle_rad]]), layout)
        return Pose(at.rotations[0], at.translations[0]) @ state.camera_from_tag_b

    def _ask(self, job: Job) -> tuple[Array, Array]:
        """Derivatives (j, 3, n) by the unknowns and the rest of the covariance (j, 3, 3)."""
        result = self._result
        facts = result.recording.facts
        by, rests = [], []
        works: Sequence[Array | None] = job.works or (None,)
        names = job.targets or sorted(facts.object.targets)
        for angle in job.angles_rad:
            tag = _sighting(self._moved(angle), self._body_b, facts.tag_b)
            for name, work in product(names, works):
                made = predict(result, name, tag, job.policy, work, refuse=False)
                rest = made.by_picture @ tag.covariance @ made.by_picture.T
                rest = rest + made.by_arm @ made.arm_covariance @ made.by_arm.T
                by.append(made.by_unknowns)
                rests.append(rest)
        return np.array(by), np.array(rests)


def _radii95(covariances: Array) -> Array:
    """`radius95` of many (j, 3, 3)."""
    total = np.trace(covariances, axis1=1, axis2=2)
    squares = np.einsum("jab,jba->j", covariances, covariances)
    return np.asarray(np.sqrt(squares / total * 2 * gammaincinv(total**2 / squares / 2, 0.95)))


def _body_covariance(tags: Tags) -> Array:
    """Mean covariance (6, 6) of a tag's pose, in the tag's own frame."""
    out = []
    for pose, W in zip(tags.poses(), tags.whiteners, strict=True):
        half = pose.inverse().adjoint() @ np.linalg.inv(W)
        out.append(half @ half.T)
    return np.asarray(np.mean(out, axis=0))


def _sighting(pose: Pose, body: Array, spec: TagSpec) -> TagObservation:
    A = pose.adjoint()
    covariance = frozen_array(A @ body @ A.T, 6, 6)
    return TagObservation(spec, pose, covariance, frozen_array(np.zeros((4, 2)), 4, 2), 0.0)


def _tag(pose: Pose, body: Array) -> Tags:
    A = pose.adjoint()
    return Tags(pose.rotation[None], pose.translation[None], whitener(A @ body @ A.T)[None])


def _blank(data: JointData) -> JointData:
    """The same cell with nothing recorded."""
    nothing = np.zeros((0, 3))
    tags = Tags(np.zeros((0, 3, 3)), nothing, np.zeros((0, 6, 6)))
    axis = data.touches.axis_in_wrist
    touches = TouchSet(np.zeros((0, 3, 3)), nothing, axis, np.zeros(0), np.zeros(0))
    holes = replace(data.holes, cad=nothing, spin=_NONE, pixels=np.zeros((0, 2)))
    return replace(
        data,
        looks=Looks(tags, np.zeros((0, 3, 3)), nothing, _NONE),
        touches=touches,
        cad=nothing,
        touch_stands=_NONE,
        points=touches,
        point_stands=_NONE,
        reference=tags,
        spins=tags,
        holes=replace(holes, sigma_px=np.zeros(0)),
        center=None,
        turntable=replace(data.turntable, axis_in_object=None),
    )


def _whitened(state: JointState, data: JointData, layout: Layout) -> Array:
    """Jacobian with the noise of the arm; every stand's error is taken as its own."""
    J = linearize(state, data, layout)[1]
    if data.arm.is_exact or not data.arm_rows:
        return J
    G = arm_jacobian(state, data).reshape(data.arm_rows, -1, 6) * data.arm.scales()
    G = G.reshape(data.arm_rows, -1) * np.hypot(data.arm.sigma_mm, data.arm.field_mm)
    L = np.linalg.cholesky(np.eye(len(G)) + G @ G.T)
    first = solve_triangular(L, J[: len(G)], lower=True)
    return np.vstack([first, J[len(G) :]])


def _embedded(J: Array, layout: Layout) -> Array:
    """Rows of a smaller layout in the columns of `layout`; spins of their own left out."""
    out = np.zeros((len(J), layout.size))
    common = layout.axis_columns.stop
    out[:, :common] = J[:, :common]
    return out
