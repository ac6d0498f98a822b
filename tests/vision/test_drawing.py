"""Overlays: what is drawn is where it was measured."""

import re

import cv2
import numpy as np
import pytest

from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.vision.images.drawing import (
    BLUE,
    GOOD,
    RED,
    TagMark,
    axes_px,
    draw_hole,
    draw_residuals,
    draw_tags,
    in_colour,
    write_picture,
)

GREY = np.full((300, 400), 90, np.uint8)
SQUARE = np.array([[120.3, 90.6], [260.1, 95.2], [255.8, 230.4], [115.2, 225.9]])


def near(picture, colour, tolerance=60):
    return np.abs(picture.astype(int) - np.array(colour)).max(axis=2) < tolerance


def test_the_outline_of_a_tag_lies_on_its_corners():
    drawn = draw_tags(GREY, [TagMark("7", SQUARE)])
    y, x = np.nonzero(near(drawn[110:], GOOD))  # below the label
    np.testing.assert_allclose([x.min(), x.max(), y.max() + 110], [115.2, 259.5, 230.4], atol=3)
    first = near(drawn, RED)
    y, x = np.nonzero(first)
    np.testing.assert_allclose([x.mean(), y.mean()], SQUARE[0], atol=2)


def test_axes_end_where_the_camera_sees_them():
    camera = CameraModel(
        np.array([[500.0, 0, 200], [0, 500, 150], [0, 0, 1]]), np.zeros(0), (400, 300)
    )
    pose = Pose.from_rotvec([0.3, 0.2, 0.1], [5, -3, 400])
    np.testing.assert_allclose(
        axes_px(camera, pose, 20),
        camera.project(pose @ (20 * np.vstack([np.zeros(3), np.eye(3)]))),
    )


def test_a_tag_at_the_rim_and_a_frame_behind_the_camera_do_no_harm():
    behind = np.full((4, 2), np.nan)
    drawn = draw_tags(GREY, [TagMark("12345", SQUARE - 150, behind, doubtful=True)])
    assert drawn.shape == (300, 400, 3)


def test_residuals_are_blue_red_and_grey_where_nothing_was_compared():
    residuals = np.zeros((300, 400))
    residuals[:100], residuals[100:200], residuals[:, 350:] = 3.0, -3.0, np.nan
    drawn = draw_residuals(GREY, residuals, 3.0, "sigma")
    right = drawn[:, 408:808]
    assert near(right[50, :300][None], RED).all()
    assert near(right[150, :300][None], BLUE).all()
    assert (right[250, :300] > 240).all()
    assert (right[250, 360:] == 128).all()
    with pytest.raises(InputError, match="crop them alike"):
        draw_residuals(GREY, residuals[1:], 3.0, "sigma")


def test_the_centre_of_a_hole_is_drawn_where_it_is():
    turn = np.linspace(0, 2 * np.pi, 80, endpoint=False)
    rim = np.array([200.25, 140.5]) + 40 * np.column_stack([np.cos(turn), 0.8 * np.sin(turn)])
    drawn = draw_hole(GREY, rim[::4], rim, np.array([200.25, 140.5]), "hole 1")
    scale = drawn.shape[1] / (drawn.shape[1] // 6)
    y, x = np.nonzero(near(drawn, RED))
    # The crop starts a quarter of the hole's width before its outline.
    start = np.floor(rim.min(0) - 20)
    scale = round(700 / max(np.ceil(rim.max(0) + 20) - start + 1))
    place = (np.array([200.25, 140.5]) - start + 0.5) * scale - 0.5
    np.testing.assert_allclose([np.median(x), np.median(y)], place, atol=1.5)
    assert near(drawn, BLUE).sum() > 50
    with pytest.raises(InputError, match="outside"):
        draw_hole(GREY, rim + 1000, rim + 1000, np.array([1200.0, 1100.0]), "")


def test_pictures_of_sixteen_bits_are_drawn_on_too(tmp_path):
    deep = (GREY.astype(np.uint16) * 16) + 7
    assert in_colour(deep).dtype == np.uint8
    path = tmp_path / "a.png"
    write_picture(path, draw_tags(deep, []))
    assert cv2.imread(str(path)).shape == (300, 400, 3)
    for bad in (tmp_path / "a.xyz", tmp_path / "none" / "a.png"):
        with pytest.raises(InputError, match=re.escape(str(bad))):
            write_picture(bad, in_colour(GREY))
