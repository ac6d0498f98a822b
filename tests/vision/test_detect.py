import cv2
import numpy as np
import pytest

from vgrd.errors import InputError
from vgrd.vision.print.codes import SQUARE_FAMILIES, code_count, family_named, marker_cells
from vgrd.vision.tags.detection import find_tags


def drawn(*markers, cell_px=12, size=(640, 400)):
    """Markers (family, id) side by side on grey-white paper, and their true corners."""
    picture, corners = np.full(size[::-1], 200, np.uint8), []
    x = 60
    for family, tag_id in markers:
        cells = np.kron(marker_cells(family, tag_id), np.ones((cell_px, cell_px)))
        side = len(cells)
        picture[80 : 80 + side, x : x + side] = cells * 180 + 20
        rim = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * side + (x, 80) - 0.5
        corners.append(rim)
        x += side + 60
    return picture, corners


@pytest.mark.parametrize("family", SQUARE_FAMILIES)
def test_tags_of_every_family_are_found_upright_where_they_are_drawn(family):
    ids = (1, code_count(family) - 1)
    picture, corners = drawn(*((family, tag_id) for tag_id in ids))
    found = find_tags(cv2.GaussianBlur(picture, (0, 0), 0.8), [family])
    assert [tag.id for tag in found] == list(ids)
    for tag, true in zip(found, corners, strict=True):
        assert np.abs(tag.corners_px - true).max() < 0.7
        assert tag.hamming == 0


def test_families_are_known_by_the_names_that_users_write():
    assert family_named("DICT_4X4_50") == "4x4_50"
    assert family_named("tag36h11") == family_named("36h11") == "36h11"
    assert family_named("DICT_ARUCO_ORIGINAL") == "original"
    with pytest.raises(InputError, match=r"99h9.*known: 16h5"):
        family_named("99h9")


def test_a_tag_that_appears_twice_is_listed_twice():
    picture, _ = drawn(("36h11", 5), ("36h11", 5), ("36h11", 6))
    assert [tag.id for tag in find_tags(picture, ["36h11"])] == [5, 5, 6]


def test_a_damaged_code_is_found_only_on_request_and_counted():
    picture, corners = drawn(("36h11", 5))
    x, y = (corners[0][0] + 0.5).astype(int)
    cell = picture[y + 36 : y + 48, x + 36 : x + 48]
    cell[:] = 220 - cell
    assert find_tags(picture, ["36h11"]) == []
    (tag,) = find_tags(picture, ["36h11"], max_hamming=2)
    assert tag.hamming == 1


def test_noise_holds_no_tags():
    rng = np.random.default_rng(3)
    noise = cv2.GaussianBlur(rng.integers(0, 255, (480, 640), dtype=np.uint8), (0, 0), 2)
    assert find_tags(noise, ["16h5", "4x4_50"]) == []


def test_a_tag_in_a_mirror_is_found_and_called_so():
    picture, corners = drawn(("36h11", 5), ("4x4_50", 3))
    flipped = np.ascontiguousarray(cv2.GaussianBlur(picture, (0, 0), 0.8)[:, ::-1])
    assert not any(tag.mirrored for tag in find_tags(picture, ["36h11", "4x4_50"]))
    found = find_tags(flipped, ["36h11", "4x4_50"])
    assert [(tag.family, tag.id, tag.mirrored) for tag in found] == [
        ("36h11", 5, True),
        ("4x4_50", 3, True),
    ]
    true = np.column_stack([picture.shape[1] - 1 - corners[0][:, 0], corners[0][:, 1]])
    assert np.abs(found[0].corners_px - true).max() < 1.5
