import numpy as np
import pytest

from fakes.camera.patterns import Disc
from fakes.camera.pictures import Band, Look, Placed, draw, pinhole
from vgrd.errors import HoleNotSeen, InputError
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.vision.holes.hole_finder import HoleSpec, find_hole, sight_holes

BENT = np.array([-0.08, 0.1, 2e-4, -1e-4, 0.0])
CAMERA = pinhole(np.array([[6500.0, 0, 2000], [0, 6500.0, 1500], [0, 0, 1]]), BENT, (4000, 3000))
RADIUS = 2.5
NOWHERE = np.zeros(2)


def tilted(tilt=0.4, about=0.3):
    axis = np.array([np.cos(about), np.sin(about), 0.0])
    return Pose.from_rotvec(tilt * axis, (30.0, 20.0, 600.0))


def picture(*discs, pose=None, look=None, seed=1, margin_px=60.0):
    pose = tilted() if pose is None else pose
    drawn = draw(
        CAMERA, [Placed(disc, pose) for disc in discs], look, seed=seed, margin_px=margin_px
    )
    return drawn.pixels, CameraModel(drawn.camera.matrix, BENT, drawn.camera.size_px)


def hole(x=0.0, y=0.0, radius=RADIUS, **levels):
    return Disc(np.array([x, y]), radius, **levels)


@pytest.mark.parametrize("tilt", [0.0, 0.5, 1.0])
def test_a_hole_is_measured_within_what_it_says_of_itself(tilt):
    rng = np.random.default_rng(5)
    squares, errors = [], []
    for _ in range(4):
        place = rng.uniform(-1, 1, 2)
        pose = tilted(tilt, rng.uniform(0, 6))
        grey, camera = picture(hole(*place), pose=pose, seed=rng)
        guess = place + rng.uniform(-0.5, 0.5, 2)
        found = find_hole(grey, camera, pose, RADIUS, guess, rim_height_sigma_mm=0.0)
        error = found.center_in_plane - place
        errors.append(np.linalg.norm(error))
        squares.append(error @ np.linalg.solve(found.covariance, error))
        center = camera.project(pose.apply(np.append(place, 0.0))[None])[0]
        assert np.linalg.norm(found.center_px - center) < 0.02
        assert found.radius_mm == pytest.approx(RADIUS, abs=6 * found.radius_sigma_mm)
    assert max(errors) < 1e-3
    assert 0.2 < np.mean(squares) < 7.0  # chi-square of 8: 0.1 % on either side


def test_the_centre_of_the_image_of_a_hole_is_not_the_image_of_its_centre():
    pose = tilted(0.9)
    grey, camera = picture(hole(radius=8.0), pose=pose)
    found = find_hole(grey, camera, pose, 8.0, NOWHERE)
    y, x = np.nonzero(grey < 50)
    of_the_image = np.array([x.mean(), y.mean()])
    center = camera.project(pose.translation[None])[0]
    assert np.linalg.norm(of_the_image - center) > 0.3
    assert np.linalg.norm(found.center_px - center) < 0.01


def test_an_unknown_rim_height_and_an_uncertain_plane_widen_the_covariance_as_they_move_the_centre():
    pose = tilted(0.5)
    grey, camera = picture(hole(), pose=pose)
    plain = find_hole(grey, camera, pose, RADIUS, NOWHERE, rim_height_sigma_mm=0.0)
    high = find_hole(grey, camera, pose, RADIUS, NOWHERE, rim_height_mm=0.1, rim_height_sigma_mm=0)
    moved = high.center_in_plane - plain.center_in_plane
    unsure = find_hole(grey, camera, pose, RADIUS, NOWHERE, rim_height_sigma_mm=0.1)
    assert np.linalg.norm(moved) == pytest.approx(0.1 * np.tan(0.5), rel=0.2)
    assert unsure.covariance - plain.covariance == pytest.approx(np.outer(moved, moved), rel=0.02)

    turn = np.array([0.02, -0.01, 0.05, 3e-4, 2e-4, -4e-4])
    covariance = np.outer(turn, turn)
    turned = find_hole(grey, camera, Pose.exp(turn) @ pose, RADIUS, NOWHERE, rim_height_sigma_mm=0)
    shift = turned.center_in_plane - plain.center_in_plane
    spread = find_hole(
        grey, camera, pose, RADIUS, NOWHERE, rim_height_sigma_mm=0, plane_covariance=covariance
    )
    expected = np.outer(shift, shift)
    assert spread.covariance - plain.covariance == pytest.approx(expected, rel=0.05, abs=1e-7)


def test_a_hole_without_a_guess_is_found_and_a_bright_one_too():
    grey, camera = picture(hole(4.0, -3.0, inside=0.9), margin_px=150)
    found = find_hole(grey, camera, tilted(), RADIUS)
    assert found.center_in_plane == pytest.approx([4.0, -3.0], abs=1e-3)


def test_what_hides_a_small_part_of_the_rim_is_left_out():
    finger = Look(in_front=Band(0.3, 12.0, 20.0))
    grey, camera = picture(hole(), look=finger)
    found = find_hole(grey, camera, tilted(), RADIUS, NOWHERE)
    assert found.rim < 0.97
    assert found.center_in_plane == pytest.approx([0, 0], abs=1e-3)


def test_a_shadow_across_a_hole_does_not_move_it():
    grey, camera = picture(hole(), look=Look(shadow=Band(0.3, 5.0, softness_px=4.0)))
    found = find_hole(grey, camera, tilted(), RADIUS, NOWHERE)
    assert found.center_in_plane == pytest.approx([0, 0], abs=1.5e-3)


@pytest.mark.parametrize(
    ("discs", "look", "reason"),
    [
        ([hole(12.0), hole(-12.0)], None, "no circle"),
        ([hole(radius=1.2 * RADIUS)], None, "circle"),
        ([hole()], Look(in_front=Band(0.3, 0.0)), "hidden|no circle|no rim"),
        ([hole(-2.6), hole(2.6)], None, "2 holes"),
    ],
)
def test_what_is_not_there_hidden_or_ambiguous_is_said_and_not_guessed(discs, look, reason):
    grey, camera = picture(*discs, look=look, margin_px=150)
    with pytest.raises(HoleNotSeen, match=reason):
        find_hole(grey, camera, tilted(), RADIUS, NOWHERE, search_mm=4.0)


def chamfered(ratio):
    """The hole, and a chamfer around it."""
    around, pose = Look().around, tilted()
    wide, _ = picture(hole(radius=ratio * RADIUS, inside=0.8), margin_px=60)
    both, camera = picture(
        hole(radius=ratio * RADIUS, inside=0.8), hole(inside=around - 0.8), pose=pose
    )
    assert both.shape == wide.shape
    return both, camera


def test_a_chamfer_is_told_and_the_rim_of_the_given_radius_counts():
    grey, camera = chamfered(1.4)
    found = find_hole(grey, camera, tilted(), RADIUS, NOWHERE)
    assert found.radius_mm == pytest.approx(RADIUS, abs=2e-3)
    assert "second rim of 3.4" in " ".join(found.findings)


def test_two_rims_that_both_could_be_meant_are_not_chosen_from():
    grey, camera = chamfered(1.25)
    with pytest.raises(HoleNotSeen, match="two rims"):
        find_hole(grey, camera, tilted(), 1.12 * RADIUS, NOWHERE)


def test_holes_are_sighted_at_their_cad_places_and_missing_ones_named():
    camera_from_tag = tilted(0.3)
    object_from_tag = Pose.from_rotvec((0.0, np.pi, 0.0), (40.0, 5.0, 0.3))
    places = {"P1": (0.0, 0.0), "P2": (14.0, 3.0), "P3": (-9.0, 8.0)}
    specs = {
        name: HoleSpec(object_from_tag.apply(np.array([*place, 0.0])), RADIUS)
        for name, place in places.items()
    }
    drawn = [hole(*places[name]) for name in ("P1", "P2")]
    grey, camera = picture(*drawn, pose=camera_from_tag, margin_px=120)
    seen, missing = sight_holes(grey, camera, camera_from_tag, object_from_tag, specs)
    assert [each.target for each in seen] == ["P1", "P2"]
    assert list(missing) == ["P3"]
    for each in seen:
        point = camera_from_tag @ object_from_tag.inverse() @ specs[each.target].point_in_object
        error = each.pixel - camera.project(point[None])[0]
        assert np.abs(error).max() < 6 * each.sigma_px < 0.06


def test_a_radius_must_be_positive():
    grey, camera = picture(hole())
    with pytest.raises(InputError, match="above 0"):
        find_hole(grey, camera, tilted(), 0.0, NOWHERE)
