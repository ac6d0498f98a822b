import cv2
import numpy as np
import pytest

from fakes.commands.layout import main, scripted
from fakes.world.layout import Layout
from fakes.world.poses import (
    WORK_ROTATION,
    fixed_point_poses,
    frozen_snapshot,
    look_poses,
    readable,
    retracted_pose,
    touch_pose,
)
from fakes.world.visibility import visible
from vgrd.geometry import log_rotation

LAYOUT = Layout()


def test_the_layout_command_prints_the_drawing_and_the_table(capsys):
    main()
    printed = capsys.readouterr().out
    assert "tag A on a bracket" in printed
    assert "requests and spins" in printed
    assert "24/24" in printed


def test_the_picture_has_0_0925_mm_per_pixel_at_600_mm():
    assert 600 / LAYOUT.optics.matrix[0, 0] == pytest.approx(0.0925, abs=1e-4)


def test_projection_agrees_with_opencv_and_rays_undo_it():
    points = np.random.default_rng(0).uniform((-150, -110, 450), (150, 110, 700), (50, 3))
    pixels = LAYOUT.optics.project(points)
    theirs, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), LAYOUT.optics.matrix, LAYOUT.optics.distortion
    )
    assert np.allclose(pixels, theirs[:, 0], atol=1e-8)
    assert np.allclose(LAYOUT.optics.rays(pixels), points[:, :2] / points[:, 2:], atol=1e-11)


@pytest.mark.parametrize(
    "name",
    ["hand-eye looks", "touches, wrist constant", "touches, wrist tilted", "requests and spins"],
)
def test_both_tags_are_readable_wherever_the_operator_needs_them(name):
    shots = scripted(LAYOUT)[name]
    assert all(all(readable(LAYOUT, *shot).values()) for shot in shots)


def test_looks_turn_by_20_to_30_deg_about_many_axes():
    turns = [pose.rotation @ WORK_ROTATION.T for pose in look_poses(LAYOUT, 12)]
    rotvecs = np.array([log_rotation(turn) for turn in turns])
    angles = np.degrees(np.linalg.norm(rotvecs, axis=1))
    assert angles.min() >= 20 - 1e-6
    assert angles.max() <= 30 + 1e-6
    assert np.linalg.svd(rotvecs, compute_uv=False)[2] > 0.3


def test_the_spike_is_touched_by_the_true_tip_with_varied_wrists():
    poses = fixed_point_poses(LAYOUT, 10)
    tips = np.array([pose @ LAYOUT.tcp_in_wrist for pose in poses])
    assert np.abs(tips - LAYOUT.fixed_point_in_base).max() < 1e-9
    assert np.linalg.svd(np.concatenate([p.rotation - poses[0].rotation for p in poses]))[1][2] > 1


def test_the_poses_stay_in_the_workspace():
    low, high = LAYOUT.workspace_mm
    for shots in scripted(LAYOUT).values():
        for pose, _ in shots:
            assert (pose.translation >= low).all()
            assert (pose.translation <= high).all()


def test_a_tag_out_of_view_turned_away_or_behind_the_tool_says_so():
    far = touch_pose(LAYOUT, "P1")
    aside = type(far)(far.rotation, far.translation + np.array([0, 260, 0]))
    assert visible(LAYOUT, "a", frozen_snapshot(aside)).reasons == ("out of view",)
    yawed = type(far)(far.rotation @ np.diag([-1.0, -1.0, 1.0]), far.translation)
    assert "turned away" in visible(LAYOUT, "a", frozen_snapshot(yawed)).reasons
    before_tag_b = type(far)(WORK_ROTATION, np.array([520.0, 0.0, 225.0]))
    hidden = visible(LAYOUT, "b", frozen_snapshot(before_tag_b)).reasons
    assert any("tool" in reason or "tip" in reason for reason in hidden)


def test_focus_is_lost_away_from_the_focal_plane():
    optics = LAYOUT.optics
    assert optics.blur_px(optics.focus_mm) == pytest.approx(optics.psf_px)
    assert optics.defocus_px(400.0) > 2 * optics.defocus_px(480.0) > 4
    assert visible(LAYOUT, "b", frozen_snapshot(retracted_pose(), 1.0)).defocus_px < 4
