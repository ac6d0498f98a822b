"""Tag vision against other libraries, each in a process of its own: corners, time and memory.

VGRD_BENCH_SHARE scales the number of pictures; 1 means 300.
"""

import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np

from fakes.camera.patterns import tag_pattern
from fakes.camera.pictures import Placed, draw
from tests.benchmarks.harness import Row, ratio_of
from tests.benchmarks.peers import Peer, PeerLost
from tests.benchmarks.vision.vision_truth import NARROW, measured, random_pose, rms, shot
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.model import TagSpec
from vgrd.orphans import die_with
from vgrd.vision.print.codes import square_corners
from vgrd.vision.print.raster import tag_raster
from vgrd.vision.tags.planar_pose import planar_poses
from vgrd.vision.tags.tag_finder import TagDetector

SHARE = float(os.environ.get("VGRD_BENCH_SHARE", "0.05"))
TAG = TagSpec("36h11", 7, 10.0)
REFINEMENTS = ("NONE", "SUBPIX", "CONTOUR", "APRILTAG")
# Name of the row, peer, bar: RMSE of the corners of the peer's pose over that of ours.
CORNERS = (
    ("vision_vs_pyapriltags", "pyapriltags", 4.0),
    ("vision_vs_pupil", "pupil_apriltags", 15.0),
    ("vision_vs_opencv", "OpenCV", 100.0),
)
# quad_decimate of pyapriltags; its default, 2, is as accurate here. Bars of a cold and of a tracking search.
DECIMATIONS = {1.0: (30.0, 100.0), 2.0: (5.0, 10.0), 4.0: (1.0, 2.0)}
ROUNDS = 5


def rows() -> Iterator[Row]:
    """All rows against peers."""
    yield from _corners()
    yield from _times()
    yield _memory()


class _Contest:
    """Errors of the peers' corners, as they are and as those of the pose that fits them; a lost peer drops out."""

    def __init__(self, peers: dict[str, Peer]) -> None:
        self.peers = peers
        self.raw: dict[str, list[Array]] = {}
        self.fitted: dict[str, list[Array]] = {}
        self.lost: dict[str, str] = {}

    def run(self, pixels: np.ndarray, camera: CameraModel, true: Array) -> None:
        """Let every peer find the one tag."""
        for name, peer in self.peers.items():
            if name in self.lost:
                continue
            try:
                corners = peer.corners(pixels)
            except PeerLost as lost:
                self.lost[name] = str(lost)
                continue
            if corners is not None:
                corners = _in_order(corners, true)
                self.raw.setdefault(name, []).append(corners - true)
                self.fitted.setdefault(name, []).append(_fitted(corners, camera) - true)


def _corners() -> Iterator[Row]:
    """Corners of poses, six unknowns against six; the peers' bare corners (eight) in the note."""
    rng = np.random.default_rng(5)
    raster = tag_raster(TAG.family, TAG.id, TAG.size_mm)
    ours: list[Array] = []
    with ExitStack() as stack:
        opened = {
            library: stack.enter_context(Peer(library, quad_decimate=1.0))
            for library in ("pyapriltags", "pupil_apriltags")
        }
        for refinement in REFINEMENTS:
            opened[f"OpenCV {refinement}"] = stack.enter_context(
                Peer("OpenCV", refinement=refinement)
            )
        contest = _Contest(opened)
        for _ in range(max(round(300 * SHARE), 10)):
            pose = random_pose(NARROW, rng, 20)
            seen = shot(NARROW, tag_pattern(TAG), pose, rng)
            _, poses, true = measured(seen, raster, pose, rng)
            ours.append(
                seen.camera.project(poses[0].pose.apply(square_corners(TAG.size_mm))) - true
            )
            contest.run(seen.pixels, seen.camera, true)
    for row, peer, bar in CORNERS:
        yield _corner_row(row, peer, bar, contest, rms(ours))


def _corner_row(row: str, peer: str, bar: float, contest: _Contest, ours: float) -> Row:
    """The ratio of a peer, by the best of its ways."""
    ways = [name for name in contest.peers if name.startswith(peer)]
    told = [name for name in ways if name in contest.fitted and name not in contest.lost]
    if not told:
        return Row.failed(row, ", ".join(contest.lost.get(n, f"{n} found no tag") for n in ways))
    best = min(told, key=lambda name: rms(contest.fitted[name]))
    figures = ", ".join(
        f"{n} {rms(contest.fitted[n]):.4f} (bare corners {rms(contest.raw[n]):.4f})" for n in told
    )
    return Row.at_least(
        row, rms(contest.fitted[best]) / ours, "x", bar, f"ours {ours:.4f}, {figures} px"
    )


def _in_order(corners: Array, true: Array) -> Array:
    """The same four corners, starting and turning as the true ones."""
    turned = [np.roll(way, k, 0) for way in (corners, corners[::-1]) for k in range(4)]
    return min(turned, key=lambda c: float(np.abs(c - true).sum()))


def _fitted(corners: Array, camera: CameraModel) -> Array:
    """Corners of the pose that fits these best, all trusted alike: what a caller makes of them."""
    square = square_corners(TAG.size_mm)
    return camera.project(planar_poses(camera, square, corners, np.eye(8))[0].pose.apply(square))


def _scene() -> tuple[np.ndarray, CameraModel, list[TagSpec]]:
    """A picture of 12 MP with two tags among clutter, its camera, the tags."""
    rng = np.random.default_rng(3)
    tags = [TagSpec("36h11", 7, 15.0), TagSpec("36h11", 11, 10.0)]
    places = [Pose(random_pose(NARROW, rng, 20, 0.0).rotation, (x, 5.0, 600.0)) for x in (-40, 35)]
    scene = draw(NARROW, [Placed(tag_pattern(t), p) for t, p in zip(tags, places, strict=True)])
    width, height = NARROW.size_px
    clutter = cv2.resize(rng.uniform(70, 120, (48, 64)).astype(np.float32), (width, height))
    for _ in range(250):
        corner, size = rng.integers(0, [width, height]), int(rng.integers(20, 200))
        quad = (corner + rng.integers(-size, size, (4, 2))).astype(np.int32)
        cv2.fillConvexPoly(clutter, quad, float(rng.uniform(30, 180)))
    picture = np.clip(clutter + rng.normal(0, 1.5, clutter.shape), 0, 255).astype(np.uint8)
    picture[scene.region.slices] = scene.pixels
    return picture, CameraModel(NARROW.matrix, NARROW.distortion, NARROW.size_px), tags


def _times() -> Iterator[Row]:
    """Wall time of ours, cold and tracking, against pyapriltags with two threads on all of the picture."""
    picture, camera, tags = _scene()
    with TagDetector(camera.matrix, camera.distortion, tags, camera.size_px) as detector:
        last = detector.detect(picture)
        if sorted(last) != [7, 11]:
            raise AssertionError("the benchmark's tags were not found")

        def cold() -> float:
            start = time.perf_counter()
            detector.detect(picture)
            return time.perf_counter() - start

        def tracking() -> float:
            start = time.perf_counter()
            detector.detect(picture, last)
            return time.perf_counter() - start

        for decimate, bars in DECIMATIONS.items():
            for way, ours, bar in zip(("cold", "tracking"), (cold, tracking), bars, strict=True):
                name = f"vision_{way}_vs_pyapriltags_{decimate:g}"
                with Peer("pyapriltags", nthreads=2, quad_decimate=decimate) as peer:
                    try:
                        found = peer.keep(picture)
                        ratio, peer_s, ours_s = ratio_of(peer.seconds, ours, ROUNDS)
                    except PeerLost as lost:
                        yield Row.failed(name, str(lost))
                        continue
                note = (
                    f"{1e3 * ours_s:.1f} ms against {1e3 * peer_s:.0f} ms of quad_decimate "
                    f"{decimate:g}, which finds {found} of {len(tags)} tags"
                )
                yield Row.at_least(name, ratio, "x", bar, note)


def _memory() -> Row:
    picture, camera, tags = _scene()
    with ProcessPoolExecutor(
        1, get_context("spawn"), initializer=die_with, initargs=(os.getpid(),)
    ) as fresh:
        used = fresh.submit(_peak_mib, camera, tags, picture).result()
    return Row.at_most("vision_memory", used, "MiB", 400.0, "peak of a process of its own")


def _peak_mib(camera: CameraModel, tags: list[TagSpec], picture: np.ndarray) -> float:
    """Peak memory of this process after it measured a picture cold and tracking."""
    with TagDetector(camera.matrix, camera.distortion, tags, camera.size_px) as detector:
        detector.detect(picture, detector.detect(picture))
    status = Path("/proc/self/status").read_text()  # getrusage would count the parent's
    (peak,) = (line.split()[1] for line in status.splitlines() if line.startswith("VmHWM"))
    return int(peak) / 1024
