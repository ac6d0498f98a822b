import tracemalloc

import numpy as np
import pytest

from fakes.camera.blur import Blur
from fakes.camera.patterns import tag_pattern
from fakes.camera.raster import coverage
from fakes.camera.render import Renderer
from fakes.camera.sensor import BLACK, PixelRegion
from fakes.world.layout import Layout
from fakes.world.poses import frozen_snapshot, retracted_pose, touch_pose
from fakes.world.world import World, WorldSnapshot
from vgrd.errors import HoleNotSeen
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.vision.holes.hole_finder import find_hole

LAYOUT = Layout()


@pytest.fixture(scope="module")
def renderer():
    return Renderer(LAYOUT)


def camera_from_tag_a(pose):
    return LAYOUT.base_from_camera.inverse() @ pose @ LAYOUT.wrist_from_tag_a


def drawn(camera_from_tag, region):
    """Share of white of tag A."""
    blur = Blur(LAYOUT.optics.blur_px(camera_from_tag.translation[2]))
    return coverage(LAYOUT.optics, camera_from_tag, tag_pattern(LAYOUT.tag_a), region, blur)


def test_a_picture_is_repeatable_and_every_exposure_has_fresh_noise(renderer):
    world = World(LAYOUT, 2)
    now = world.move_flange(retracted_pose(), 0.0)
    first, second = world.snapshot(now), world.snapshot(now)
    picture = renderer.render(first)
    assert picture.shape == (3036, 4024)
    assert picture.dtype == np.uint8
    assert np.array_equal(picture, renderer.render(first))
    assert np.array_equal(picture, Renderer(LAYOUT).render(first))
    assert not np.array_equal(picture, renderer.render(second))


def test_paper_and_ink_have_their_levels_and_shot_noise(renderer):
    pose = touch_pose(LAYOUT, "P3")
    camera_from_tag = camera_from_tag_a(pose)
    centre = LAYOUT.optics.project(camera_from_tag @ np.array([-11.2, 0.0, 0.0]))
    x, y = (np.round(centre).astype(int) - 4).tolist()
    flat = PixelRegion(x, y, 8, 8)
    assert drawn(camera_from_tag, flat).max() < 1e-3
    patches = [
        renderer.render(WorldSnapshot(frozen_snapshot(pose).flange, 0.0, exposure=i))[flat.slices]
        for i in range(8)
    ]
    assert np.mean(patches) == pytest.approx(BLACK, rel=0.1)
    assert np.std(patches, 0).mean() == pytest.approx(np.sqrt(0.0209 * BLACK + 0.25), rel=0.25)


def test_a_covered_tag_and_a_dark_cell_show_no_tag(renderer):
    pose = retracted_pose()
    bare = frozen_snapshot(pose)
    covered = WorldSnapshot(bare.flange, 0.0, covered=("b",))
    dark = WorldSnapshot(bare.flange, 0.0, lights=False)
    assert renderer.visible("b", bare).seen
    assert renderer.visible("b", covered).reasons == ("covered",)
    assert renderer.visible("b", dark).reasons == ("dark",)
    assert renderer.render(dark).max() < 10
    difference = np.abs(renderer.render(covered).astype(int) - renderer.render(bare))
    assert (difference > 50).sum() > 20_000


def test_a_tag_at_the_edge_is_clipped_and_one_outside_draws_nothing(renderer):
    pose = retracted_pose()
    for shift in (-60.0, -90.0, -400.0):
        moved = type(pose)(pose.rotation, pose.translation + np.array([0, shift, 0]))
        assert renderer.render(frozen_snapshot(moved)).shape == (3036, 4024)


def test_an_out_of_focus_tag_is_blurred():
    def steepest(depth_shift):
        pose = retracted_pose()
        toward = LAYOUT.base_from_camera.rotation[:, 2] * depth_shift
        camera_from_tag = camera_from_tag_a(type(pose)(pose.rotation, pose.translation + toward))
        outline = LAYOUT.optics.project(camera_from_tag @ np.array([-12.5, 0.0, 0.0]))
        x, y = (np.round(outline).astype(int) // 4 * 4 - 12).tolist()
        shares = drawn(camera_from_tag, PixelRegion(x, y, 24, 24))
        return np.abs(np.diff(shares, axis=1)).max()

    in_focus = LAYOUT.optics.focus_mm - camera_from_tag_a(retracted_pose()).translation[2]
    assert steepest(in_focus) > 2 * steepest(in_focus - 150)


def test_drawing_needs_little_memory(renderer):
    renderer.render(frozen_snapshot(touch_pose(LAYOUT, "P1")))
    tracemalloc.start()
    renderer.render(frozen_snapshot(touch_pose(LAYOUT, "P1")))
    peak_mib = tracemalloc.get_traced_memory()[1] / 2**20
    tracemalloc.stop()
    assert peak_mib < 120


def test_the_holes_of_the_object_can_be_measured_to_a_thousandth_of_a_millimetre(renderer):
    angle = 0.4
    parked = frozen_snapshot(retracted_pose())
    picture = renderer.render(WorldSnapshot(parked.flange, angle, exposure=3))
    camera = CameraModel(LAYOUT.optics.matrix, LAYOUT.optics.distortion, LAYOUT.optics.size_px)
    camera_from_object = LAYOUT.base_from_camera.inverse() @ LAYOUT.base_from_object(angle)
    errors = []
    for target in LAYOUT.targets.values():
        rim = camera_from_object @ Pose(np.eye(3), target.point_in_object)
        try:
            found = find_hole(picture, camera, rim, target.hole_diameter_mm / 2, np.zeros(2))
        except HoleNotSeen:
            continue  # behind the arm or under the plate of tag B
        errors.append(np.linalg.norm(found.center_in_plane))
    assert len(errors) >= 3
    assert max(errors) < 1e-3


def test_ink_that_spreads_makes_the_fake_cells_tags_darker():
    pose = retracted_pose()
    snapshot = frozen_snapshot(pose)
    centre = LAYOUT.optics.project(camera_from_tag_a(pose).translation[None])[0]
    x, y = np.round(centre).astype(int)
    tag = np.s_[y - 100 : y + 100, x - 100 : x + 100]
    plain, inked = (
        Renderer(layout).render(snapshot)[tag].mean() for layout in (LAYOUT, Layout(ink_mm=0.1))
    )
    assert inked < plain - 1
