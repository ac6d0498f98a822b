"""`vgrd detect`: corners in OpenCV's order and convention, poses, remarks, errors, pictures of it."""

import json

import cv2
import numpy as np
import pytest
from PIL import Image

from fakes.camera.patterns import grid_pattern
from fakes.camera.pictures import Placed, draw, pinhole
from vgrd.geometry import Pose
from vgrd.model import TagSpec
from vgrd.vision.print.codes import marker_cells, square_corners
from vgrd.vision.print.targets import TagGrid, config_lines

K = np.array([[2000.0, 0, 402], [0, 2000, 298], [0, 0, 1]])
SIZE = (800, 600)
TAG_MM = 40.0
POSE = Pose.from_rotvec([0.35, -0.25, 0.4], [6.0, -4.0, 420.0])


def opencv_drawing(name, tag_id, side=168, rim=70):
    """A marker as OpenCV itself draws it, upright in the picture; 168 px are whole cells of all."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
    marker = cv2.aruco.generateImageMarker(dictionary, tag_id, side)
    drawn = cv2.copyMakeBorder(marker, rim, rim, rim, rim, cv2.BORDER_CONSTANT, value=225)
    return np.maximum(cv2.GaussianBlur(drawn, (0, 0), 0.6), 25)


def seen(pose=POSE, tag_id=7, bits=8, dirt=1.5):
    """A tag at a known pose, drawn at five times the resolution; no lens distortion."""
    cells = np.pad(marker_cells("36h11", tag_id), 2, constant_values=1.0)
    paper = (25 + 195 * cells).repeat(40, axis=0).repeat(40, axis=1)
    mm = TAG_MM / (len(marker_cells("36h11", tag_id)) * 40)
    mm_from_px = np.array([[mm, 0, 0], [0, mm, 0], [0, 0, 1.0]])
    mm_from_px[:2, 2] = mm * (0.5 - len(paper) / 2)
    H = K @ np.column_stack([pose.rotation[:, :2], pose.translation]) @ mm_from_px
    fine = np.array([[5, 0, 2], [0, 5, 2], [0, 0, 1.0]]) @ H
    size = (5 * SIZE[0], 5 * SIZE[1])
    large = cv2.warpPerspective(paper, fine, size, flags=cv2.INTER_AREA, borderValue=220)
    drawn = cv2.GaussianBlur(cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.6)
    drawn = drawn + np.random.default_rng(0).normal(0, dirt, drawn.shape)
    scale = 16 if bits == 16 else 1  # as of a camera of 12 bits
    return (
        np.rint(drawn * scale).clip(0, 2**bits - 1).astype(np.uint16 if bits == 16 else np.uint8)
    )


@pytest.fixture
def camera(tmp_path):
    path = tmp_path / "camera.toml"
    path.write_text("[camera]\nmatrix = [2000, 2000, 402, 298]\nsize_px = [800, 600]\n")
    return path


@pytest.mark.parametrize(
    ("name", "asked", "first"),
    [
        ("4X4_50", "4x4_50", 0),
        ("6X6_250", "DICT_6X6_250", 0),
        ("ARUCO_ORIGINAL", "original", 0),
        ("APRILTAG_36h11", "apriltag_36h11", 0),
        # The AprilTag library publishes them turned by 180 degrees:
        ("APRILTAG_36h11", "36h11", 2),
        ("APRILTAG_25h9", "tag25h9", 2),
    ],
)
def test_the_first_corner_is_that_of_the_marker_as_its_makers_draw_it(
    vgrd, tmp_path, name, asked, first
):
    path = tmp_path / "marker.png"
    cv2.imwrite(str(path), opencv_drawing(name, 11))
    result = vgrd("detect", path, "--dictionary", asked, "--json", "-").result
    (tag,) = result["images"][0]["tags"]
    clockwise = np.array([[69.5, 69.5], [237.5, 69.5], [237.5, 237.5], [69.5, 237.5]])
    assert tag["id"] == 11
    np.testing.assert_allclose(tag["corners_px"], np.roll(clockwise, -first, axis=0), atol=0.1)


def test_corners_and_pose_of_a_seen_tag_are_true_within_their_covariance(vgrd, tmp_path, camera):
    path = tmp_path / "tag.png"
    cv2.imwrite(str(path), seen())
    words = ("--size-mm", TAG_MM, "--camera", camera, "--json", "-")
    image = vgrd("detect", path, *words).result["images"][0]
    assert (image["width"], image["height"]) == SIZE
    (tag,) = image["tags"]
    inside = POSE @ square_corners(TAG_MM)
    expected = inside[:, :2] / inside[:, 2:] * 2000 + K[:2, 2]
    np.testing.assert_allclose(tag["corners_px"], expected, atol=0.02)
    found = Pose.from_matrix(np.array(tag["camera_from_tag"]))
    xi = (found @ POSE.inverse()).log()
    assert xi @ np.linalg.solve(np.array(tag["covariance"]), xi) < 40
    assert POSE.distance(found)[0] < 0.2
    assert np.array(tag["corner_covariance_px2"]).shape == (8, 8)
    assert tag["quality"]["findings"] == []
    assert tag["quality"]["tilt_deg"] == pytest.approx(25, abs=3)


def test_colour_sixteen_bits_and_jpeg_give_the_same_corners(vgrd, tmp_path):
    plain = seen()
    files = [tmp_path / name for name in ("a.png", "b.png", "c.tiff", "d.jpg")]
    cv2.imwrite(str(files[0]), plain)
    cv2.imwrite(str(files[1]), np.dstack([plain] * 3))
    cv2.imwrite(str(files[2]), seen(bits=16))
    cv2.imwrite(str(files[3]), plain, [cv2.IMWRITE_JPEG_QUALITY, 95])
    images = vgrd("detect", *files, "--json", "-").result["images"]
    corners = np.array([image["tags"][0]["corners_px"] for image in images])
    np.testing.assert_allclose(corners, corners[:1].repeat(4, axis=0), atol=0.03)
    assert "camera_from_tag" not in images[0]["tags"][0]


def test_a_turn_in_the_exif_data_is_told_and_not_applied(vgrd, tmp_path):
    path = tmp_path / "turned.jpg"
    picture = Image.fromarray(seen())
    exif = picture.getexif()
    exif[0x0112] = 6
    picture.save(path, exif=exif, quality=95)
    image = vgrd("detect", path, "--json", "-").result["images"][0]
    assert (image["width"], image["height"]) == SIZE
    assert [finding["code"] for finding in image["findings"]] == ["turned"]


def test_remarks_tell_the_operator_what_to_do(vgrd, tmp_path, camera):
    files = {
        "frontal": seen(Pose.from_rotvec([0.02, 0.01, 0.3], [0, 0, 420])),
        "small": cv2.resize(seen(), None, fx=0.18, fy=0.18, interpolation=cv2.INTER_AREA),
        "contrast": (20 + 0.15 * seen()).astype(np.uint8),
        "overexposed": (1.3 * seen()).clip(0, 255).astype(np.uint8),
        "blurred": cv2.GaussianBlur(seen(), (0, 0), 3.0),
        "repeated": np.hstack([seen()[:, 230:630]] * 2),
    }
    files["shadow"] = seen()
    files["shadow"][:, 400:] = files["shadow"][:, 400:] // 2
    for name, picture in files.items():
        path = tmp_path / f"{name}.png"
        cv2.imwrite(str(path), picture)
        pose = ("--size-mm", TAG_MM, "--camera", camera) if name == "frontal" else ()
        done = vgrd("detect", path, *pose, "--json", "-")
        codes = [
            f["code"]
            for tag in done.result["images"][0]["tags"]
            for f in tag["quality"]["findings"]
        ]
        allowed = {"frontal": {"frontal", "ambiguous"}, "shadow": {"shadow", "glare", "motion"}}
        assert allowed.get(name, {name}) & set(codes)


def test_nothing_found_tells_where_was_looked(vgrd, tmp_path):
    path = tmp_path / "empty.png"
    cv2.imwrite(str(path), np.full((300, 400), 128, np.uint8))
    done = vgrd("detect", path, "--dictionary", "36h11", "--dictionary", "4x4_50")
    assert done.code == 0
    assert "no tag found; looked for 36h11, 4x4_50" in done.out


def test_bad_files_are_named_and_the_others_are_done_all_the_same(vgrd, tmp_path, camera):
    good, other, broken = (tmp_path / name for name in ("good.png", "other.png", "broken.png"))
    cv2.imwrite(str(good), seen())
    cv2.imwrite(str(other), seen()[:500])
    broken.write_bytes(b"\x89PNG nothing")
    out = tmp_path / "out.json"
    files = (broken, good, other, tmp_path / "none.png")
    done = vgrd("detect", *files, "--camera", camera, "--size-mm", TAG_MM, "--json", out)
    assert done.code == 65
    for name, why in (
        ("broken", "save it anew"),
        ("none", "no such file"),
        ("other", "800 x 500"),
    ):
        assert f"{name}.png" in done.err.replace("\n", "")
        assert why in done.err
    images = json.loads(out.read_text())["images"]
    assert [len(image["tags"]) for image in images] == [0, 1, 0, 0]
    assert images[0]["findings"][0]["code"] == "not_used"


def test_overlays_show_the_outline_and_the_axes(vgrd, tmp_path, camera):
    folders = [tmp_path / "x", tmp_path / "y"]
    for folder in folders:
        folder.mkdir()
        cv2.imwrite(str(folder / "tag.png"), seen())
    files = [folder / "tag.png" for folder in folders]
    words = ("--size-mm", TAG_MM, "--camera", camera, "--draw", tmp_path / "drawn")
    done = vgrd("detect", *files, *words)
    assert done.code == 0
    for name in ("tag-1.png", "tag-2.png"):
        drawn = cv2.imread(str(tmp_path / "drawn" / name)).astype(int)
        assert drawn.shape == (600, 800, 3)
        coloured = np.ptp(drawn, axis=2) > 60
        assert 500 < coloured.sum() < 40_000
    residuals = cv2.imread(str(tmp_path / "drawn" / "tag-1-0-tag7.png"))
    assert residuals.shape[1] > 2 * residuals.shape[0]


def test_wrong_options_are_told_before_any_picture_is_read(vgrd, tmp_path):
    for words, message in (
        (("--dictionary", "36h12"), "known: 16h5"),
        (("--size-mm", -1), "edge of the black square"),
        (("--camera", tmp_path / "none.yaml"), "no such file"),
    ):
        done = vgrd("detect", tmp_path / "a.png", *words)
        assert done.code == 65
        assert message in done.err


BOARD = TagGrid("36h11", 3, 2, 24.0, 6.0, first_id=10)
BOARD_POSE = Pose.from_rotvec([0.3, -0.2, 0.3], [-40.0, -30.0, 420.0])


@pytest.fixture
def board(tmp_path):
    path = tmp_path / "board.toml"
    path.write_text("[target]\n" + "\n".join(config_lines(BOARD)))
    return path


@pytest.fixture
def board_picture(tmp_path):
    tags = [TagSpec(BOARD.dictionary, tag_id, BOARD.size_mm) for tag_id in BOARD.corners()]
    first_tag = Pose.from_rotvec([0, 0, 0], [BOARD.size_mm / 2, BOARD.size_mm / 2, 0])
    figure = Placed(grid_pattern(tags, BOARD.columns, BOARD.gap_mm), BOARD_POSE @ first_tag)
    path = tmp_path / "seen.png"
    cv2.imwrite(str(path), draw(pinhole(K, np.zeros(4), SIZE), [figure], seed=2).in_frame(SIZE))
    return path


def test_a_board_is_measured_as_one_target_and_drawn(vgrd, tmp_path, camera, board, board_picture):
    out, drawn = tmp_path / "out.json", tmp_path / "drawn"
    words = ("--board", board, "--camera", camera, "--draw", drawn, "--json", out)
    done = vgrd("detect", board_picture, *words)
    assert done.code == 0, done.err
    assert "1 sigma mm" in done.out
    (image,) = json.loads(out.read_text())["images"]
    assert image["tags"] == image["findings"] == []
    (seen_board,) = image["boards"]
    assert seen_board["board"] == str(board)
    assert seen_board["findings"] == []
    assert seen_board["misfit_px"] < 0.05
    assert seen_board["origin_sigma_mm"] < 0.02
    found = Pose.from_matrix(np.array(seen_board["camera_from_board"]))
    xi = (found @ BOARD_POSE.inverse()).log()
    assert xi @ np.linalg.solve(np.array(seen_board["covariance"]), xi) < 40
    assert BOARD_POSE.distance(found)[0] < 0.02
    outline = BOARD_POSE @ np.array([[0, 0, 0], [84, 0, 0], [84, 54, 0], [0, 54, 0.0]])
    expected = outline[:, :2] / outline[:, 2:] * 2000 + K[:2, 2]
    np.testing.assert_allclose(seen_board["corners_px"], expected, atol=0.02)
    plain, marked = cv2.imread(str(board_picture)), cv2.imread(str(drawn / "seen.png"))
    assert 500 < np.any(plain != marked, axis=2).sum() < 40_000
    assert (drawn / "seen-0-board.png").is_file()


def test_single_tags_beside_a_board_are_looked_for_on_request(vgrd, camera, board, board_picture):
    words = ("--board", board, "--camera", camera, "--dictionary", "36h11", "--json", "-")
    (image,) = vgrd("detect", board_picture, *words).result["images"]
    assert image["tags"] == image["findings"] == []
    assert "camera_from_board" in image["boards"][0]


def test_a_board_that_is_not_in_the_picture_is_said_in_words(vgrd, tmp_path, camera, board):
    path = tmp_path / "tag.png"
    cv2.imwrite(str(path), seen())
    done = vgrd("detect", path, "--board", board, "--camera", camera)
    assert done.code == 0
    assert "none of the board's tags is in the picture" in " ".join(done.out.split())


def test_what_a_board_needs_is_told_before_any_picture_is_read(vgrd, tmp_path, camera, board):
    chess = tmp_path / "chess.toml"
    chess.write_text('type = "chessboard"\ncolumns = 5\nrows = 4\nsquare_mm = 10\n')
    for words, message in (
        (("--board", board), "--board needs --camera"),
        (("--board", chess, "--camera", camera), "ChArUco boards and boards of tags"),
        (("--board", "charuco", "--camera", camera), "ends with .toml"),
    ):
        done = vgrd("detect", tmp_path / "a.png", *words)
        assert done.code == 65
        assert message in done.err
