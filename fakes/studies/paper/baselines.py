"""The paper's methods side by side, from one recording: what each would have answered."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from fakes.studies.cameras import EXACT, place_in
from vgrd.calibration.calibration import Calibration, expected_coordinate
from vgrd.calibration.hand_eye import (
    HandEyeProblem,
    HandEyeResult,
    calibrate_hand_eye,
    hand_eye_samples,
)
from vgrd.calibration.observability import Axes, turned_axes
from vgrd.calibration.solve import calibrate_system
from vgrd.calibration.stepwise import (
    flange_for,
    motion_about,
    moved_flange,
    point_in_base_live,
    special_expected,
)
from vgrd.calibration.tcp import calibrate_fixed_point
from vgrd.calibration.touches import CadFit, arm_touches, fit_cad
from vgrd.calibration.turntable import find_rotation_center
from vgrd.errors import CalibrationError, InputError
from vgrd.geometry import Array, Pose
from vgrd.model import Observation, Policy, Recording, TagObservation, Touch

CONVENTIONAL = "conventional"
SPECIAL = "special"
SPECIAL_CAD = "special + CAD"
SERVED = "served"

Method = Callable[[str, Observation], Array]


def expected_by_method(
    methods: Mapping[str, Method], target: str, observation_now: Observation
) -> dict[str, Array]:
    """Flange (3,) in the base by every one of `methods`, policy fixed, mm.

    A method that cannot answer, for want of a touch or of a tag in the picture, is left out.
    """
    answers = {}
    for name, method in methods.items():
        try:
            answers[name] = method(target, observation_now)
        except (CalibrationError, InputError):
            continue
    return answers


def compare_methods(recording: Recording, stability: Array = EXACT) -> Mapping[str, Method]:
    """Every method that the recording allows, prepared: (target, picture) -> flange (3,), mm.

    All that does not depend on the request is computed here, once. stability: (6,) of the camera, as in
    `CameraPlace`, for what is served; the paper's methods take it to stand anywhere where tag A is seen.
    """
    methods: dict[str, Method] = {}
    served = partial(prepare_served, stability=stability)
    for prepare in (_prepare_conventional, _prepare_special, served):
        try:
            methods |= prepare(recording)
        except (CalibrationError, InputError):
            continue
    return methods


def paper_methods(recording: Recording) -> Mapping[str, Method]:
    """The paper's own methods, prepared; raises what one of them refuses."""
    return {**_prepare_conventional(recording), **_prepare_special(recording)}


def _prepare_conventional(recording: Recording) -> Mapping[str, Method]:
    """Section III: fixed-point TCP, hand-eye, one touch of the target, Eq. 6 with the live tag A."""
    touches = arm_touches(recording.points, recording)
    tcp = calibrate_fixed_point(touches, allow_open_axis=True).tcp_in_wrist
    hand_eye = solved_hand_eye(recording)
    return {CONVENTIONAL: partial(_conventional, recording, hand_eye, tcp)}


def _conventional(
    recording: Recording, hand_eye: HandEyeResult, tcp: Array, target: str, now: Observation
) -> Array:
    touch = first_touch(recording, target)
    wrist_from_tag_a = hand_eye.mount_from_target
    A0, B0 = both_tags(touch.observation)
    tip_in_tag_a = wrist_from_tag_a.inverse() @ tcp
    point_in_tag_b = (B0.inverse() @ A0) @ tip_in_tag_a
    A1, B1 = both_tags(now)
    point = point_in_base_live(now.base_from_wrist, wrist_from_tag_a, A1, B1, point_in_tag_b)
    R = touch.base_from_wrist.rotation
    return flange_for(point, R, tcp + recording.facts.tool.work_from_touch_mm)


def _prepare_special(recording: Recording) -> Mapping[str, Method]:
    """Section V: Eq. 19 as published, from one touch of the target, and from touches fitted to CAD."""
    fit = fitted_cad(recording)
    rotation = solved_hand_eye(recording)  # all that Eq. 19 needs of the hand-eye
    special = partial(_special, recording, rotation, fit, pivot_in_tag(recording))
    return {SPECIAL: partial(special, False), SPECIAL_CAD: partial(special, True)}


def _special(
    recording: Recording,
    hand_eye: HandEyeResult,
    fit: CadFit,
    pivot_in_tag_b: Array,
    use_cad: bool,
    target: str,
    now: Observation,
) -> Array:
    touch = first_touch(recording, target)
    ref = touch.observation
    flange = touch.base_from_wrist.translation
    if use_cad:
        flange = fit.flange(recording.facts.object.targets[target].cad)
    pivot_flange = fit.flange(np.asarray(recording.facts.object.center_in_object))
    offset = touch.base_from_wrist.rotation @ recording.facts.tool.work_from_touch_mm
    try:
        A0, B0 = both_tags(ref)
        A1, B1 = both_tags(now)
        answer = special_expected(
            base_from_wrist_ref=touch.base_from_wrist,
            base_from_wrist_now=now.base_from_wrist,
            tag_a_from_tag_b_ref=A0.inverse() @ B0,
            tag_a_from_tag_b_now=A1.inverse() @ B1,
            R_wrist_from_tag_a=hand_eye.mount_from_target.rotation,
            pivot_in_tag_b=pivot_in_tag_b,
            flange_ref=flange,
            pivot_flange_ref=pivot_flange,
        )
    except InputError:
        # Tag A is hidden or the wrist turned since: the camera stands still and serves as well.
        Q = motion_about(
            tag_b_in(now).camera_from_tag, tag_b_in(ref).camera_from_tag, pivot_in_tag_b
        )
        answer = moved_flange(hand_eye.mount_from_camera.rotation, Q, flange, pivot_flange)
    return answer - offset


def prepare_served(recording: Recording, stability: Array) -> Mapping[str, Method]:
    """What the daemon would serve."""
    return {SERVED: partial(_served, calibrate_system(recording), stability)}


def _served(calibration: Calibration, stability: Array, target: str, now: Observation) -> Array:
    place = place_in(now, stability)
    expected = expected_coordinate(calibration, target, tag_b_in(now), Policy.FIXED, camera=place)
    return expected.base_from_wrist.translation


def solved_hand_eye(recording: Recording) -> HandEyeResult:
    """The height along the axis of a 4-axis arm may stay open: it cancels, as that of the TCP does."""
    samples = hand_eye_samples(recording)
    return calibrate_hand_eye(HandEyeProblem(recording.facts.mount, samples, allow_unobservable=1))


def fitted_cad(recording: Recording) -> CadFit:
    """Flange positions that touch CAD points, all touches with one wrist; InputError where they have not."""
    arrays = arm_touches(recording.touches, recording)
    if turned_axes(list(arrays.rotations))[0] is not Axes.NONE:
        raise InputError("the special method needs one wrist orientation in all touches")
    if recording.facts.object.center_in_object is None:
        raise InputError("the special method needs the centre of rotation in CAD")
    targets = recording.facts.object.targets
    points = np.array([targets[touch.target].cad for touch in recording.touches])
    return fit_cad(points, arrays)


def pivot_in_tag(recording: Recording) -> Array:
    """Rotation centre (3,) in tag B by the spins."""
    tags = [spin.tag_b.camera_from_tag for spin in recording.spins if spin.tag_b is not None]
    return find_rotation_center(tags).center_in_tag


def first_touch(recording: Recording, target: str) -> Touch:
    """The first touch of a target; InputError where it was not touched."""
    for touch in recording.touches:
        if touch.target == target:
            return touch
    raise InputError(f"target {target!r} was not touched")


def both_tags(picture: Observation | None) -> tuple[Pose, Pose]:
    """camera_from_tag of tag A and of tag B; InputError where one is not in the picture."""
    if picture is None or picture.tag_a is None:
        raise InputError("tag A is not in the picture")
    return picture.tag_a.camera_from_tag, tag_b_in(picture).camera_from_tag


def tag_b_in(picture: Observation | None) -> TagObservation:
    """Tag B of a picture; InputError where it is not in it."""
    if picture is None or picture.tag_b is None:
        raise InputError("tag B is not in the picture")
    return picture.tag_b
