"""What one picture cannot tell: held against pictures that are made by plain pose algebra."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fakes.studies.sessions import known_arm
from fakes.world.arm_errors import ArmErrors
from fakes.world.noise import COARSE
from fakes.world.simulation import TAG_A, TAG_B, WORK_ROTATION, Simulation
from vgrd.calibration.blind_spots import Course, blind_spots, sentences
from vgrd.calibration.blind_spots.courses import slips_of
from vgrd.calibration.blind_spots.document import document
from vgrd.calibration.joint import calibrate_joint, solution_of
from vgrd.errors import TagNotSeen
from vgrd.geometry import Array, Pose
from vgrd.model import CameraPlace, FlangeTag, Link, Motion, Policy, TagObservation, frozen_array

ROOT = Path(__file__).parents[2]
FIXED = frozen_array([0.5] * 3 + [5e-4] * 3, 6)
ANYWHERE = frozen_array([np.inf] * 6, 6)
UNITS = np.array([1.0] * 3 + [4e-3] * 3)  # mm, rad
FIELD = ArmErrors(sigma_mm=0.03, field_mm=0.15)
STILL = Pose.identity()
COURSES = {Motion.TURNTABLE: Course.ARC, Motion.PLANAR: Course.PLANE, Motion.FREE: Course.ANY}
PLACES = {"fixed, seen": FIXED, "fixed, hidden": FIXED, "movable, seen": ANYWHERE}
COMBINATIONS = [
    pytest.param(motion, place, id=f"{motion}, {place}") for motion in Motion for place in PLACES
]


@cache
def solved(motion: Motion):
    """A noisy session of a simulated cell, its object free to move so."""
    sim = Simulation(4, vision=COARSE, arm=FIELD)
    tilted = [sim.wrist(np.radians(25)) for _ in range(4)]
    recording = sim.record(wrists=[sim.wrist()] * 6 + tilted)
    facts = replace(recording.facts, object=replace(recording.facts.object, motion=motion))
    recording = replace(recording, facts=facts)
    return sim, recording, solution_of(calibrate_joint(recording, arm=known_arm(FIELD)))


@dataclass(frozen=True)
class Scene:
    """The object on its way, and links that slipped in their own frames."""

    base_from_object: Pose
    stability: Array
    sees_tag_a: bool

    def picture(
        self, link: Link | None = None, slip: Pose = STILL
    ) -> tuple[TagObservation, CameraPlace]:
        """Both tags without noise, with the covariance of a picture that has some."""
        slips = {link: slip}
        camera_from_base = (Simulation.base_from_camera @ slips.get(Link.CAMERA, STILL)).inverse()
        on_flange = Simulation.wrist_from_tag_a @ slips.get(Link.TAG_A, STILL)
        on_object = Simulation.object_from_tag_b @ slips.get(Link.TAG_B, STILL)
        base_from_tag_b = self.moved(slips.get(Link.OBJECT, STILL)) @ on_object
        tag_b = seen(TAG_B, camera_from_base @ base_from_tag_b)
        flange_tag = None
        if self.sees_tag_a:
            in_base = Simulation.standing @ on_flange
            flange_tag = FlangeTag(seen(TAG_A, camera_from_base @ in_base), Simulation.standing)
        return tag_b, CameraPlace(self.stability, flange_tag)

    def moved(self, slip: Pose) -> Pose:
        """The object after it slipped as its tag B tells."""
        on_object = Simulation.object_from_tag_b
        return self.base_from_object @ on_object @ slip @ on_object.inverse()


def seen(spec, camera_from_tag):
    tag = COARSE.observe(np.random.default_rng(0), spec, camera_from_tag)
    return replace(tag, camera_from_tag=camera_from_tag)


def scenes(
    motion: Motion, place: str, count: int = 4
) -> Iterator[tuple[Scene, np.random.Generator]]:
    for seed in range(count):
        rng = np.random.default_rng(seed)
        turn, shift = np.array([0.0, 0.0, rng.uniform(-2, 2)]), np.zeros(3)
        if motion is not Motion.TURNTABLE:
            shift[:2] = rng.uniform(-40, 40, 2)
        if motion is Motion.FREE:
            shift[2], turn[:2] = rng.uniform(-20, 20), rng.uniform(-0.2, 0.2, 2)
        at = Pose.from_rotvec(turn, Simulation.center_in_base + shift)
        yield Scene(at, PLACES[place], place.endswith("seen")), rng


def drawn(rng, basis, size_mm):
    """A slip of that size, in mm over a tag, out of a space (6, k)."""
    slip = basis @ rng.normal(size=basis.shape[1])
    return slip * (size_mm / np.linalg.norm(slip / UNITS))


def error_mm(solution, facts, scene, link, slip):
    """How far the served flange of each target is off the true one, (t, 3)."""
    tag_b, camera = scene.picture(link, Pose.exp(slip))
    truth = scene.moved(Pose.exp(slip) if link is Link.OBJECT else STILL)
    errors = []
    for target in facts.object.targets.values():
        served = solution.expected_for(
            facts, target, tag_b, Policy.FIXED, WORK_ROTATION, camera
        ).base_from_wrist
        tip = served @ Simulation.tcp_in_wrist
        errors.append(tip - truth @ np.asarray(target.point_in_object))
    return np.array(errors)


@pytest.mark.parametrize(("motion", "place"), COMBINATIONS)
def test_a_slip_that_is_said_to_leave_no_trace_leaves_none(motion, place) -> None:
    """And the answer goes wrong by the harmful ones alone."""
    _, recording, solution = solved(motion)
    facts = recording.facts
    for scene, rng in scenes(motion, place):
        picture = scene.picture()
        before = solution.examine(facts, *picture)
        right = error_mm(solution, facts, scene, None, np.zeros(6))
        for link, spot in blind_spots(solution, facts, *picture).items():
            for slips, harms in ((spot.harmful, True), (spot.harmless, False)):
                if not slips:
                    continue
                slip = drawn(rng, slips.basis, 1.0)
                after = solution.examine(facts, *scene.picture(link, Pose.exp(slip)))
                assert after.fits
                assert after.misfit == pytest.approx(before.misfit, abs=0.2), link
                assert after.knocked == before.knocked
                off = error_mm(solution, facts, scene, link, slip) - right
                worst_mm = np.linalg.norm(off, axis=1).max()
                assert (worst_mm > 0.2) == harms, link
                assert harms or worst_mm < 0.02, link


@pytest.mark.parametrize(("motion", "place"), COMBINATIONS)
def test_every_other_slip_of_12_sigma_contradicts(motion, place) -> None:
    _, recording, solution = solved(motion)
    facts = recording.facts
    tried = set()
    for scene, rng in scenes(motion, place):
        tag_b, camera = scene.picture()
        for link, spot in blind_spots(solution, facts, tag_b, camera).items():
            spaces = (spot.untold, spot.harmful_as_knock.basis, spot.harmless_as_knock.basis)
            silent = np.hstack(spaces) / UNITS[:, None]
            told = np.linalg.svd(silent, full_matrices=True)[0][:, silent.shape[1] :]
            if not told.shape[1]:
                continue
            slip = drawn(rng, UNITS[:, None] * told, 1.0)
            if spot.harmful_as_knock:  # the camera is followed once it seems knocked
                camera = replace(camera, stability=ANYWHERE)
            trace = solution.slip_traces(facts, tag_b, camera)[link]
            slip *= 12 / np.linalg.norm(trace @ slip)
            report = solution.examine(facts, *scene.picture(link, Pose.exp(slip)))
            assert not report.fits, link
            tried.add(link)
    assert (motion is Motion.FREE) == (not tried)


@pytest.mark.parametrize("motion", Motion)
def test_what_passes_for_a_knock_is_followed_and_said_to_be_one(motion) -> None:
    """Rightly where the camera was knocked, wrongly where tag A slipped."""
    _, recording, solution = solved(motion)
    facts = recording.facts
    for scene, rng in scenes(motion, "fixed, seen"):
        spots = blind_spots(solution, facts, *scene.picture())
        right = error_mm(solution, facts, scene, None, np.zeros(6))
        for link, slips, harms in (
            (Link.TAG_A, spots[Link.TAG_A].harmful_as_knock, True),
            (Link.CAMERA, spots[Link.CAMERA].harmless_as_knock, False),
        ):
            assert slips.course is (COURSES[motion] if harms else Course.ANY)
            trace = solution.slip_traces(facts, *scene.picture())[link]
            slip = drawn(rng, slips.basis, 1.0)
            slip *= 12 / np.linalg.norm(trace @ slip)
            report = solution.examine(facts, *scene.picture(link, Pose.exp(slip)))
            assert report.fits
            assert report.knocked
            off = np.linalg.norm(error_mm(solution, facts, scene, link, slip) - right, axis=1)
            assert (off.max() > 0.2 * np.linalg.norm(slip / UNITS)) == harms
            assert harms or off.max() < 0.05  # mm, of a knock of 6 mm


@pytest.mark.parametrize(("motion", "place"), COMBINATIONS)
def test_harm_goes_the_way_that_the_object_moves(motion, place) -> None:
    _, recording, solution = solved(motion)
    scene, _ = next(scenes(motion, place))
    spots = blind_spots(solution, recording.facts, *scene.picture())
    way = COURSES[motion]
    harmful = {link: spot.harmful.course for link, spot in spots.items() if spot.harmful}
    assert (
        harmful
        == {
            "fixed, seen": {Link.TAG_B: way},
            "fixed, hidden": {Link.TAG_B: way, Link.CAMERA: way},
            "movable, seen": {Link.TAG_B: way, Link.TAG_A: way},
        }[place]
    )
    assert spots[Link.OBJECT].harmless.course is way


@pytest.mark.parametrize(("motion", "place"), COMBINATIONS)
def test_what_shows_and_what_does_not_lie_far_apart(motion, place) -> None:
    """No size is near the threshold, so that no processor decides otherwise."""
    _, recording, solution = solved(motion)
    for scene, _ in scenes(motion, place):
        for trace in solution.slip_traces(recording.facts, *scene.picture()).values():
            sigmas = np.linalg.svd(trace * UNITS, compute_uv=False)
            assert ((sigmas < 1e-8) | (sigmas > 0.1)).all()


@pytest.mark.parametrize("place", ["fixed, seen", "fixed, hidden", "movable, seen"])
def test_a_shift_of_tag_b_shows_from_the_size_that_is_told(place) -> None:
    _, recording, solution = solved(Motion.PLANAR)
    facts = recording.facts
    scene, _ = next(scenes(Motion.PLANAR, place))
    least_mm = blind_spots(solution, facts, *scene.picture())[Link.TAG_B].shows_from_mm
    up = Simulation.object_from_tag_b.rotation.T @ np.array([0.0, 0.0, 1.0])
    misfits = []
    for side in (-1, 1):
        shift = Pose.exp(np.array([*(side * least_mm * up), 0, 0, 0]))
        misfits.append(solution.examine(facts, *scene.picture(Link.TAG_B, shift)).misfit)
    before = solution.examine(facts, *scene.picture()).misfit
    assert np.mean(misfits) - before == pytest.approx(25, rel=0.05)  # 5 sigma


def test_a_session_without_spins_knows_no_axis() -> None:
    sim = Simulation(4, vision=COARSE)
    recording = sim.record(spins=0, wrists=[sim.wrist(np.radians(25)) for _ in range(8)])
    solution = solution_of(calibrate_joint(recording))
    scene, _ = next(scenes(Motion.TURNTABLE, "fixed, seen"))
    spots = blind_spots(solution, recording.facts, *scene.picture())
    assert spots[Link.TAG_B].harmful.course is Course.ANY
    assert spots[Link.TAG_B].shows_from_mm is None


def test_a_camera_that_is_taken_to_stand_still_tells_every_slip_of_tag_a() -> None:
    _, recording, solution = solved(Motion.TURNTABLE)
    tag_b, camera = Scene(Pose.identity(), np.zeros(6), sees_tag_a=True).picture()
    spot = blind_spots(solution, recording.facts, tag_b, camera)[Link.TAG_A]
    assert spot.untold.shape == (6, 0)
    assert not spot.harmful
    assert not spot.harmful_as_knock


def test_a_space_of_slips_that_is_no_motion_of_an_object_has_no_name() -> None:
    up_and_along = np.eye(6)[:, [0, 2, 5]]
    assert slips_of(up_and_along, Pose.identity()).course is Course.SOME


def test_a_movable_camera_without_tag_a_tells_nothing_at_all() -> None:
    _, recording, solution = solved(Motion.TURNTABLE)
    scene = Scene(Pose.identity(), ANYWHERE, sees_tag_a=False)
    with pytest.raises(TagNotSeen):
        blind_spots(solution, recording.facts, *scene.picture())


def test_the_page_is_what_the_rows_say() -> None:
    page = (ROOT / "docs" / "blind-spots.md").read_text(encoding="utf-8")
    assert page == document(), (
        "python -m vgrd.calibration.blind_spots.document docs/blind-spots.md"
    )


@pytest.mark.parametrize(
    ("motion", "stability", "told"),
    [
        (Motion.TURNTABLE, FIXED, ("along the arc", "Any other shift", "while tag A", "a knock")),
        (Motion.TURNTABLE, ANYWHERE, ("along the arc", "Any other shift", "not told either")),
        (Motion.PLANAR, FIXED, ("in the plane", "out of the plane", "while tag A", "a knock")),
        (Motion.FREE, FIXED, ("in any direction", "while tag A", "a knock")),
    ],
)
def test_two_sentences_say_it_with_the_remedy(motion, stability, told) -> None:
    _, recording, solution = solved(motion)
    of_tag_b, of_the_rest = sentences(solution, recording, stability)
    text = f"{of_tag_b} {of_the_rest}"
    assert not [words for words in told if words not in text]
    assert "a second tag on the object, or its holes" in of_tag_b
    assert ("shows from" in text) == (motion is not Motion.FREE)
    assert ("hidden" in text) == (stability is FIXED)


def test_a_session_without_pictures_of_a_tag_says_nothing() -> None:
    _, recording, solution = solved(Motion.TURNTABLE)
    assert sentences(solution, replace(recording, touches=()), FIXED) == ()
    hidden = [
        replace(touch, observation=replace(touch.observation, tag_a=None))
        for touch in recording.touches
    ]
    blind = replace(recording, looks=(), spins=(), touches=tuple(hidden))
    assert sentences(solution, blind, FIXED) == ()
