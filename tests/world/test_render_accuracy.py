"""The rasteriser against integrals in closed form, which share no code with it nor with the product."""

import cv2
import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import multivariate_normal

from fakes.camera.blur import Blur
from fakes.camera.patterns import (
    Disc,
    Pattern,
    charuco_pattern,
    grid_pattern,
    tag_cells,
    tag_pattern,
)
from fakes.camera.pictures import Band, Look, Placed, Spot, clean_levels, draw, pinhole, sense
from fakes.camera.raster import coverage
from fakes.camera.sensor import PixelRegion
from vgrd.geometry import Pose
from vgrd.model import TagSpec
from vgrd.vision.print.boards import Charuco

MATRIX = np.array([[6000.0, 0, 320], [0, 6000.0, 240], [0, 0, 1]])
CAMERA = pinhole(MATRIX, np.zeros(0), (640, 480))
BENT = pinhole(MATRIX, np.array([-0.08, 0.1, 2e-4, -1e-4, 0.0]), (640, 480))
REGION = PixelRegion(284, 220, 72, 48)
SIGMA = 0.7


def tilted(yaw=0.0, tilt=0.0, shift=(0.0, 0.0)):
    turned = Pose.from_rotvec((tilt * np.cos(0.4), tilt * np.sin(0.4), 0.0), (*shift, 600.0))
    return turned @ Pose.from_rotvec((0.0, 0.0, yaw))


def image_line(pose, point, along):
    """Unit normal (2,) and offset of the image of a line of the plane, in pixels."""
    ends = CAMERA.project(pose.apply(np.array([point, point + along])))
    normal = np.array([ends[0, 1] - ends[1, 1], ends[1, 0] - ends[0, 0]])
    normal /= np.linalg.norm(normal)
    return normal, float(normal @ ends[0])


def edge_share(distance, normal, sigma):
    """Half plane through a Gaussian and the box of a pixel: second differences of a double integral."""

    def twice(x):
        density = np.exp(-0.5 * (x / sigma) ** 2) / np.sqrt(2 * np.pi)
        return ((x * x + sigma**2) * ndtr(x / sigma) + x * sigma * density) / 2

    a, b = np.maximum(np.abs(normal), 1e-3)
    corners = [(s, t, s * t) for s in (0.5, -0.5) for t in (0.5, -0.5)]
    return sum(4 * sign * twice(distance + s * a + t * b) for s, t, sign in corners) / (a * b)


def pixels():
    x, y = np.meshgrid(np.arange(REGION.width) + REGION.x, np.arange(REGION.height) + REGION.y)
    return np.stack([x, y], -1).astype(float)


@pytest.mark.parametrize("sigma", [0.5, 0.7, 1.0])
@pytest.mark.parametrize("tilt", [0.0, 1.0])
@pytest.mark.parametrize("yaw", [0.0, 0.02, 0.3, np.pi / 4, 1.2, 2.5, 4.0])
def test_an_edge_at_any_angle_is_the_integral_over_blur_and_pixel(yaw, tilt, sigma):
    pose = tilted(yaw, tilt)
    half = Pattern(np.array([0.013]), np.array([50.0]), np.float32([[0, 1], [0, 1]]))
    drawn = coverage(CAMERA, pose, half, REGION, Blur(sigma))
    normal, offset = image_line(pose, np.array([0.013, 0, 0]), np.array([0, 0.1, 0]))
    toward_white = CAMERA.project(pose @ np.array([[1.0, 0, 0]]))[0] @ normal - offset
    distance = (pixels() @ normal - offset) * np.sign(toward_white)
    error = drawn - edge_share(distance, normal, sigma)
    slope = (
        edge_share(distance + 0.01, normal, sigma) - edge_share(distance, normal, sigma)
    ) / 0.01
    displaced_px = (error * slope).sum() / (slope**2).sum()
    assert abs(displaced_px) < 2.5e-4
    assert np.abs(error).max() < 3e-3
    assert np.sqrt(np.mean(error**2)) < 5e-4


@pytest.mark.parametrize("tilt", [0.0, 0.5, 1.05])
@pytest.mark.parametrize("yaw", [0.1, 0.9])
def test_a_corner_is_the_integral_of_a_bivariate_normal(yaw, tilt):
    pose, corner = tilted(yaw, tilt), np.array([0.017, -0.011, 0.0])
    quarter = Pattern(corner[:1], corner[1:2], np.float32([[1, 1], [1, 0]]))
    spot = np.round(CAMERA.project(pose @ corner[None])[0]).astype(int)
    origin = spot // 4 * 4 - 4
    region = PixelRegion(int(origin[0]), int(origin[1]), 12, 12)
    drawn = 1 - coverage(CAMERA, pose, quarter, region, Blur(SIGMA))
    lines = [image_line(pose, corner, way) for way in 0.1 * np.eye(3)[:2]]
    inside = CAMERA.project(pose @ (corner + np.array([0.1, 0.1, 0]))[None])[0]
    lines = [(n * np.sign(n @ inside - o), o * np.sign(n @ inside - o)) for n, o in lines]
    rho = float(lines[0][0] @ lines[1][0])
    normal = multivariate_normal(cov=[[1, rho], [rho, 1]])
    nodes, weights = np.polynomial.legendre.leggauss(4)
    errors = []
    for x, y in spot + np.array([(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, -1)]):
        places = np.array([(x + a / 2, y + b / 2) for a in nodes for b in nodes])
        distances = np.stack([places @ n - o for n, o in lines], -1) / SIGMA
        expected = np.outer(weights, weights).ravel() @ normal.cdf(distances) / 4
        errors.append(drawn[y - region.y, x - region.x] - expected)
    assert np.abs(errors).max() < 2e-3


def test_distortion_bends_what_is_drawn_as_it_bends_points():
    pose = tilted(0.3, 0.6, (12.0, 9.0))
    half = Pattern(np.array([0.0]), np.array([50.0]), np.float32([[0, 1], [0, 1]]))
    line = BENT.project(
        pose @ np.stack([np.zeros(401), np.linspace(-5, 5, 401), np.zeros(401)], 1)
    )
    region = PixelRegion(400, 300, 64, 64)
    drawn = coverage(BENT, pose, half, region, Blur(SIGMA))
    x, y = np.meshgrid(np.arange(64) + 400.0, np.arange(64) + 300.0)
    places = np.stack([x, y], -1)
    nearest = np.linalg.norm(places[..., None, :] - line, axis=-1).argmin(-1)
    way = np.gradient(line, axis=0)[nearest]
    normal = np.stack([-way[..., 1], way[..., 0]], -1) / np.linalg.norm(way, axis=-1)[..., None]
    distance = ((places - line[nearest]) * normal).sum(-1)
    expected = edge_share(distance * np.sign(drawn[0, -1] - drawn[-1, 0]), normal[0, 0], SIGMA)
    expected = expected if abs(expected - drawn).max() < 0.5 else 1 - expected
    near = np.abs(distance) < 4
    assert near.sum() > 300
    assert np.abs(drawn - expected)[near].max() < 1e-3


@pytest.mark.parametrize("spread", [0.02, -0.03])
def test_ink_spread_moves_every_black_edge_by_its_amount(spread):
    pose = tilted(0.2)
    x = np.array([-1.0, 0.0, 1.5])
    stripes = Pattern(x, np.array([50.0]), np.float32([[1, 0, 1, 0]] * 2))
    drawn = coverage(CAMERA, pose, stripes.with_ink_spread(spread), REGION, Blur(SIGMA))
    normal = np.array([np.cos(0.2), np.sin(0.2)])
    along = (pixels() - MATRIX[:2, 2]) @ normal
    moved = 10.0 * (x + spread * np.array([-1, 1, -1]))
    expected = 1 - sum(
        s * edge_share(along - at, normal, SIGMA) for s, at in zip((1, -1, 1), moved, strict=True)
    )
    assert np.abs(drawn - expected).max() < 5e-4


def test_ink_closes_the_white_corners_of_a_tag():
    tag = tag_pattern(TagSpec("36h11", 3, 8.0))
    thick = tag.with_ink_spread(0.05)
    cells = tag_cells("36h11", 3)
    inside = np.diff(thick.y_mm)[:, None] * np.diff(thick.x_mm) * (1 - thick.white[1:-1, 1:-1])
    black = np.pad(1 - cells, 1)
    edges = np.abs(np.diff(black, axis=0)).sum() + np.abs(np.diff(black, axis=1)).sum()
    corners = sum(
        {1: 1, 2: -2 * (a == d), 3: -1}.get(int(a + b + c + d), 0)
        for a, b, c, d in zip(
            black[:-1, :-1].ravel(), black[:-1, 1:].ravel(),
            black[1:, :-1].ravel(), black[1:, 1:].ravel(), strict=True,
        )
    )  # fmt: skip
    expected = (1 - cells).sum() + 0.05 * edges + 0.05**2 * corners
    assert inside.sum() == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("tilt", [0.0, 0.7, 1.05])
def test_a_disc_covers_its_ellipse(tilt):
    pose, radius = tilted(0.2, tilt, (0.3, -0.2)), 1.5
    homography = MATRIX @ np.column_stack([pose.rotation[:, :2], pose.translation])
    inverse = np.linalg.inv(homography)
    conic = inverse.T @ np.diag([1, 1, -(radius**2)]) @ inverse
    centre = np.linalg.solve(conic[:2, :2], -conic[:2, 2])
    level = conic[2, 2] + conic[:2, 2] @ centre
    area = np.pi * abs(level) / np.sqrt(np.linalg.det(conic[:2, :2]))
    dark = 1 - coverage(CAMERA, pose, Disc(np.zeros(2), radius), REGION, Blur(SIGMA))
    centroid = np.tensordot(dark, pixels(), 2) / dark.sum()
    assert dark.sum() == pytest.approx(area, rel=2e-5)
    assert np.abs(centroid - centre).max() < 1e-4


def test_noise_has_the_variance_of_shots_and_reading():
    rng = np.random.default_rng(4)
    for level in (20.0, 200.0):
        flat = np.full((400, 400), np.float32(level))
        spread = np.var(sense(flat, Look(shot=0.05, read=0.7), rng).astype(float))
        assert spread == pytest.approx(0.05 * level + 0.49 + 1 / 12, rel=0.02)


def test_gamma_and_exposure_follow_their_laws():
    rng = np.random.default_rng(5)
    ramp = np.tile(np.linspace(5, 250, 64, dtype=np.float32), (4, 1))
    quiet = {"shot": 0.0, "read": 0.0}
    bent = sense(ramp, Look(gamma=0.45, **quiet), rng)
    assert np.abs(bent - 255 * (ramp / 255) ** 0.45).max() < 0.51
    bright = sense(ramp, Look(exposure=1.5, **quiet), rng)
    assert np.abs(bright - np.minimum(1.5 * ramp, 255)).max() < 0.51


def test_blurs_spread_light_by_their_second_moments():
    pose, region = tilted(), PixelRegion(288, 208, 64, 64)
    dot = Disc(np.zeros(2), 0.2)
    place = np.arange(64.0)

    def variances(blur):
        dark = 1 - coverage(CAMERA, pose, dot, region, blur).astype(float)
        marginals = [dark.sum(axis) / dark.sum() for axis in (0, 1)]
        return np.array([m @ place**2 - (m @ place) ** 2 for m in marginals])

    plain = variances(Blur(SIGMA))
    assert plain == pytest.approx(SIGMA**2 + 1 / 12 + 2.0**2 / 4, rel=1e-2)
    assert variances(Blur(SIGMA, disc_px=3.0)) - plain == pytest.approx(9 / 4, rel=0.02)
    moved = variances(Blur(SIGMA, motion_px=6.0, motion_rad=np.pi / 6)) - plain
    assert moved == pytest.approx(3 * np.array([0.75, 0.25]), rel=0.03)


def test_faults_show_where_they_are_put():
    tag = [Placed(tag_pattern(TagSpec("36h11", 3, 8.0)), tilted(0.3, 0.4))]
    clean, region = clean_levels(CAMERA, tag, Look())

    def change(**fault):
        return clean_levels(CAMERA, tag, Look(**fault))[0] / clean

    left, right = np.s_[:, : region.width // 4], np.s_[:, -region.width // 4 :]
    shade = change(shadow=Band(), shadow_depth=0.3)
    assert shade[left] == pytest.approx(1.0, abs=1e-3)
    assert shade[right] == pytest.approx(0.7, abs=1e-3)
    spot = Spot(50.0, -60.0, 0.0, 8.0)
    assert change(glare=spot)[left].max() > 1.2
    assert change(glare=spot)[right] == pytest.approx(1.0, abs=1e-3)
    level, light = clean_levels(CAMERA, tag, Look(in_front=Band(), in_front_level=60.0))[0], clean
    assert np.ptp(level[right]) < 0.2 * np.ptp(light[right])


def test_a_mosaic_leaves_grey_paper_grey():
    flat = np.full((64, 64), np.float32(100))
    grey = sense(flat, Look(bayer=(1, 1, 1, 1), shot=0, read=0), np.random.default_rng(1))
    assert np.abs(grey[2:-2, 2:-2].astype(int) - 100).max() <= 1


def test_a_seed_makes_a_picture_and_a_region_is_a_camera():
    tag = [Placed(tag_pattern(TagSpec("36h11", 3, 8.0)), tilted(0.3, 0.4))]
    first, again, other = (draw(CAMERA, tag, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(first.pixels, again.pixels)
    assert not np.array_equal(first.pixels, other.pixels)
    region = first.region
    assert np.array_equal(first.in_frame(CAMERA.size_px)[region.slices], first.pixels)
    point = np.array([[1.0, 2.0, 590.0]])
    shift = CAMERA.project(point) - first.camera.project(point)
    assert shift == pytest.approx(np.array([[region.x, region.y]]))


def test_a_charuco_board_is_as_opencv_defines_it():
    board = Charuco(5, 4, 4.0, 3.0, "4x4_50")
    pose = tilted(0.2, 0.3, (-10.0, -8.0))
    picture = draw(CAMERA, [Placed(charuco_pattern(board), pose)], Look(around=1.0))
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    known = cv2.aruco.CharucoBoard((5, 4), 4.0, 3.0, dictionary)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(known).detectBoard(picture.pixels)
    points = np.asarray(known.getChessboardCorners(), float)[np.ravel(ids)]
    assert len(ids) == 12
    error = np.reshape(corners, (-1, 2)) - picture.camera.project(pose.apply(points))
    assert np.abs(error).max() < 0.15


def test_a_grid_holds_every_tag_at_its_place():
    tags = [TagSpec("4x4_50", i, 6.0) for i in range(4)]
    pose = tilted(0.1, 0.2, (-3.5, -3.5))
    picture = draw(CAMERA, [Placed(grid_pattern(tags, 2, 1.0), pose)])
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(picture.pixels)
    for quad, marker in zip(corners, np.ravel(ids), strict=True):
        centre = np.array([[7.0 * (marker % 2), 7.0 * (marker // 2), 0.0]])
        expected = picture.camera.project(pose.apply(centre))[0]
        assert np.abs(quad[0].mean(0) - expected).max() < 0.6
    assert sorted(np.ravel(ids)) == [0, 1, 2, 3]


def test_a_figure_outside_of_the_picture_cannot_be_drawn():
    with pytest.raises(ValueError, match="change their poses"):
        draw(CAMERA, [Placed(Disc(np.zeros(2), 1.0), tilted(shift=(500.0, 0.0)))])
