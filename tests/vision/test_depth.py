"""A camera's depth changes nothing but the rounding, and one pixel decides nothing about the others."""

import re

import cv2
import numpy as np
import pytest

from fakes.camera.patterns import Disc, tag_pattern
from fakes.camera.pictures import Look, Placed, camera_of, clean_levels, pinhole
from fakes.camera.sensor import with_noise
from vgrd.devices import CameraImage, full_scale
from vgrd.errors import InputError
from vgrd.geometry import Pose
from vgrd.geometry.camera import CameraModel
from vgrd.model import TagSpec
from vgrd.solving.datasets.reading.sample_reading import DatasetSample
from vgrd.solving.datasets.solving import observe
from vgrd.store.images import decode_image, encode_image
from vgrd.vision.holes.hole_finder import find_hole
from vgrd.vision.images.pictures import read_picture
from vgrd.vision.tags.tag_finder import TagDetector

MATRIX = np.array([[2500.0, 0, 350], [0, 2500.0, 350], [0, 0, 1]])
TAG = TagSpec("36h11", 5, 20.0)
POSE = Pose.from_rotvec((0.5, 0.3, 0.4), (1.0, -2.0, 300.0))
DEPTHS = (8, 10, 12, 16)
DIM = Look(white=100.0, black=10.0)  # a hot pixel is far brighter than the paper
SAME_PX = 0.02  # rounding to 8 bits, beside noise of one level
HOT = (3, 4)


@pytest.fixture(scope="module")
def levels():
    """What reaches the sensor, with its noise, 0 to 255, before it is rounded."""
    camera = pinhole(MATRIX, np.zeros(5), (700, 700))
    clean, region = clean_levels(camera, [Placed(tag_pattern(TAG), POSE)], DIM, margin_px=30)
    noisy = with_noise(clean, np.random.default_rng(0), DIM.shot, DIM.read)
    return noisy, camera_of(camera, region)


def counts(noisy, bits, hot=False):
    """What a camera of so many bits sends."""
    most = (1 << bits) - 1
    sent = np.clip(np.rint(noisy * 2.0 ** (bits - 8)), 0, most)
    if hot:
        sent[HOT] = most
    return sent.astype(np.uint8 if bits == 8 else np.uint16)


def taken(noisy, bits, hot=False):
    """What its driver makes of it."""
    sent = counts(noisy, bits, hot)
    return sent if bits == 8 else full_scale(sent, bits)


def corners(pixels, camera):
    with TagDetector(camera.matrix, np.zeros(5), [TAG], camera.size_px) as detector:
        return detector.detect(pixels)[TAG.id].corners_px


def test_every_depth_gives_the_same_corners_with_and_without_a_hot_pixel(levels):
    noisy, camera = levels
    reference = corners(taken(noisy, 8), camera)
    for bits in DEPTHS:
        clean, hot = (corners(taken(noisy, bits, hot), camera) for hot in (False, True))
        np.testing.assert_allclose(clean, reference, atol=SAME_PX)
        np.testing.assert_allclose(hot, clean, atol=1e-9)


def test_every_depth_gives_the_same_hole_with_and_without_a_hot_pixel():
    camera = pinhole(MATRIX, np.zeros(5), (700, 700))
    disc = Disc(np.zeros(2), 6.0)
    clean, region = clean_levels(camera, [Placed(disc, POSE)], DIM, margin_px=60)
    noisy = with_noise(clean, np.random.default_rng(1), DIM.shot, DIM.read)
    seen = camera_of(camera, region)
    model = CameraModel(seen.matrix, np.zeros(5), seen.size_px)

    def centre(pixels):
        return find_hole(pixels, model, POSE, 6.0, np.zeros(2)).center_px

    reference = centre(taken(noisy, 8))
    for bits in DEPTHS:
        for hot in (False, True):
            np.testing.assert_allclose(centre(taken(noisy, bits, hot)), reference, atol=SAME_PX)


@pytest.mark.parametrize("bits", DEPTHS)
def test_what_was_seen_is_replayed_from_a_session_and_from_a_file(levels, bits, tmp_path):
    noisy, _ = levels
    seen = taken(noisy, bits, hot=True)
    stored = decode_image(encode_image(CameraImage(seen, 1.0, 2)).data)
    assert stored.pixels.dtype == seen.dtype
    assert np.array_equal(stored.pixels, seen)
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), counts(noisy, bits, hot=True))
    assert np.array_equal(read_picture(path).pixels, seen)


def test_a_picture_that_is_cut_off_is_named_without_a_word_of_the_library(capfd, tmp_path):
    path = tmp_path / "cut.png"
    whole = cv2.imencode(".png", np.arange(40000, dtype=np.uint8).reshape(200, 200))[1].tobytes()
    path.write_bytes(whole)
    assert read_picture(path).pixels.shape == (200, 200)
    path.write_bytes(whole[: len(whole) // 2])
    sample = DatasetSample("1", Pose.identity(), path)
    for read in (read_picture, lambda _: observe(sample, None)):
        with pytest.raises(InputError, match=re.escape(f"{path}: the picture is cut off")):
            read(path)
    assert capfd.readouterr().err == ""


def test_a_deep_picture_of_an_older_recording_is_brought_to_the_same_scale(levels):
    noisy, _ = levels
    sent = counts(noisy, 12, hot=True)
    new = encode_image(CameraImage(sent, 1.0, 2)).data
    header = len(b"VGI2") + 8 + 8
    old = b"VGI1" + new[4:header] + new[header + 1 :]
    assert np.array_equal(decode_image(old).pixels, full_scale(sent, 12))


def test_bits_that_a_camera_does_not_have_take_no_room_in_a_recording(levels):
    noisy, _ = levels
    twelve = len(encode_image(CameraImage(taken(noisy, 12), 1.0, 2)).data)
    assert twelve < 1.02 * len(encode_image(CameraImage(counts(noisy, 12), 1.0, 2)).data)
    black = CameraImage(np.zeros((4, 5), np.uint16), 1.0, 2)
    assert not decode_image(encode_image(black).data).pixels.any()
