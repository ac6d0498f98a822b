"""Another library's tag finder in a process of its own: what crashes there costs that library's rows only.

pupil-apriltags does crash: its `Detector.__del__` frees the tag families, then lets the library read them.
"""

import os
import time
from collections.abc import Callable
from importlib import import_module
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Self

import cv2
import numpy as np

from tests.benchmarks.harness import ending
from vgrd.geometry import Array
from vgrd.orphans import die_with
from vgrd.vision.print.codes import dictionary_of

ANSWER_TIMEOUT_S = (
    300.0  # 12 MP take seconds; a machine with other work may need a hundred times that
)
Finder = Callable[[np.ndarray], list[Array]]


class PeerLost(Exception):
    """The peer crashed, raised or fell silent; the words say which."""


class Peer:
    """A finder of 36h11 tags, from `with` to its end.

    name: "pyapriltags" or "pupil_apriltags", options those of its Detector; or "OpenCV", option
    `refinement`, the end of the name of a cv2.aruco.CORNER_REFINE_ constant.
    """

    def __init__(self, name: str, **options: Any) -> None:
        self.name = name
        self._options = options

    def __enter__(self) -> Self:
        spawn = get_context(
            "spawn"
        )  # nothing of this process, least of all another library, comes along
        self._link, theirs = spawn.Pipe()
        arguments = (theirs, os.getpid(), self.name, self._options)
        self._process = spawn.Process(target=_serve, args=arguments, daemon=True)
        self._process.start()
        theirs.close()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.join()
        self._link.close()

    def corners(self, pixels: np.ndarray) -> Array | None:
        """Corners (4, 2) px of one tag as the library tells them, from centres of pixels. PeerLost."""
        found: list[Array] = self._ask("corners", pixels)
        return found[0] if found else None

    def keep(self, pixels: np.ndarray) -> int:
        """Give it the picture for `seconds`; returns how many tags it finds there. PeerLost."""
        return len(self._ask("keep", pixels))

    def seconds(self) -> float:
        """How long it searches the kept picture, by its own clock. PeerLost."""
        return float(self._ask("seconds"))

    def _ask(self, *request: object) -> Any:
        try:
            self._link.send(request)
            if not self._link.poll(ANSWER_TIMEOUT_S):
                raise PeerLost(f"{self.name} was silent for {ANSWER_TIMEOUT_S:g} s")
            return self._link.recv()
        except (EOFError, ConnectionError) as err:
            self._process.join()
            raise PeerLost(f"{self.name} {ending(self._process.exitcode or 0)}") from err


def _serve(link: Connection, parent: int, name: str, options: dict[str, Any]) -> None:
    die_with(parent)
    find = _opencv(**options) if name == "OpenCV" else _apriltag(name, **options)
    kept = np.zeros((1, 1), np.uint8)
    while True:
        what, *arguments = link.recv()
        if what == "seconds":
            start = time.perf_counter()
            find(kept)
            link.send(time.perf_counter() - start)
        else:
            (pixels,) = arguments
            kept = pixels if what == "keep" else kept
            link.send(find(pixels))


def _apriltag(library: str, **options: Any) -> Finder:
    detector = import_module(library).Detector(families="tag36h11", **options)

    def find(pixels: np.ndarray) -> list[Array]:
        # Both libraries count pixels from their rim.
        return [np.array(tag.corners) - 0.5 for tag in detector.detect(pixels)]

    return find


def _opencv(refinement: str) -> Finder:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = getattr(cv2.aruco, f"CORNER_REFINE_{refinement}")
    detector = cv2.aruco.ArucoDetector(dictionary_of("36h11"), parameters)

    def find(pixels: np.ndarray) -> list[Array]:
        corners, ids, _ = detector.detectMarkers(pixels)
        return [] if ids is None else [np.array(quad, float).reshape(4, 2) for quad in corners]

    return find
