"""One tag in one photograph: whether its covariance tells how wrong its pose is.

The photographs share neither model nor constants with the fit (`fakes.camera.foreign`). Each trial draws a
pose of the case's tilt, the print's blotches, and noise. NEES: squared error of the pose over its
covariance, 6 where that is right.
"""

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.random import SeedSequence

from fakes.camera.foreign.faults import FAULTS
from fakes.camera.foreign.photograph import photograph
from fakes.studies.study import Figure, Parameters, Study, Trials
from vgrd.charts import COLORS, panels
from vgrd.geometry import Array, Pose
from vgrd.geometry.camera import CameraModel
from vgrd.geometry.print_size import print_covariance
from vgrd.model import TagObservation, TagSpec
from vgrd.vision.print.tolerance import PrintTolerance
from vgrd.vision.tags.tag_finder import TagDetector

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

TILTS_DEG = (0, 20, 40, 60)
_TAG = TagSpec("apriltag_36h11", 3, 10.0)
_DICTIONARY = cv2.aruco.DICT_APRILTAG_36h11
_SIZE_PX = (168, 168)  # of the picture: the tag, its rim and some paper
_MATRIX = np.array([[2400.0, 0, 83.2], [0, 2400.0, 83.8], [0, 0, 1]])  # 5 MP, 8 mm lens
_CAMERA = CameraModel(_MATRIX, np.zeros(0), _SIZE_PX)
_DISTANCE_MM = 240.0  # the tag is 100 px wide
_DIMENSIONS = 6
_BAND = (0.5, 1.5)  # NEES over its dimension; the bar of a covariance that holds
_FLAGGED = 0.95  # share of flagged or refused pictures that excuses the rest


def pose_at(tilt_deg: float, rng: np.random.Generator) -> Pose:
    """camera_from_tag, tilted around any axis in its plane, turned at random, nearly in the middle."""
    around, spin = rng.uniform(0, 2 * np.pi, 2)
    tilted = Pose.from_rotvec(
        np.radians(tilt_deg) * np.array([np.cos(around), np.sin(around), 0]), np.zeros(3)
    )
    turned = Pose.from_rotvec(np.array([0, 0, spin]), np.zeros(3))
    place = np.array([*rng.uniform(-0.5, 0.5, 2), _DISTANCE_MM + rng.uniform(-3, 3)])
    return Pose(tilted.rotation @ turned.rotation, place)


def nees(observation: TagObservation, camera_from_tag: Pose, size: float) -> float:
    """Squared error of the pose over its covariance, with a print that is exact to `size`."""
    error = (observation.camera_from_tag @ camera_from_tag.inverse()).log()
    pose = observation.camera_from_tag
    covariance = observation.covariance + print_covariance(_CAMERA, _TAG.size_mm, pose, size)
    return float(error @ np.linalg.solve(covariance, error))


def _trial(seed: SeedSequence, parameters: Parameters) -> dict[str, float]:
    """NEES (NaN without a pose) and whether the picture was flagged or refused."""
    rng = np.random.default_rng(seed)
    pose = pose_at(parameters["tilt_deg"], rng)
    conditions = FAULTS[parameters["fault"]]
    picture = photograph(
        _DICTIONARY, _TAG.id, _TAG.size_mm, pose, _MATRIX, _SIZE_PX, conditions, rng
    )
    with TagDetector(_MATRIX, np.zeros(0), [_TAG], _SIZE_PX) as detector:
        sighting = detector.examine(picture).get(_TAG.id)
    if sighting is None or sighting.observation is None:
        return {"nees": np.nan, "flagged": 1.0}
    size = PrintTolerance().size if any(conditions.printer.stretch) else 0.0
    return {
        "nees": nees(sighting.observation, pose, size),
        "flagged": float(bool(sighting.findings)),
    }


def _figures(trials: Trials) -> list[Figure]:
    out = []
    for case in _CASES:
        name = f"{case['fault']}, tilt {case['tilt_deg']}"
        ratio = trials.finite_mean("nees", **case) / _DIMENSIONS
        flagged = trials.mean("flagged", **case)
        is_flagged = flagged >= _FLAGGED
        low, high = (None, None) if is_flagged else _BAND
        out.append(Figure(f"{name}: NEES over 6", ratio, "", at_least=low, at_most=high))
        out.append(Figure(f"{name}: flagged or refused", 100 * flagged, "%"))
    return out


def _draw(trials: Trials) -> "Drawing":
    drawing, (axes,) = panels("One tag in one photograph", ("NEES over 6", ""))
    faults = list(FAULTS)
    for k, tilt in enumerate(TILTS_DEG):
        ratios = _ratios(trials, tilt)
        axes.plot(ratios, range(len(faults)), "o", color=COLORS[k], ms=5, label=f"tilt {tilt}")
    axes.axvspan(*_BAND, color=COLORS[1], alpha=0.15)
    axes.set_xscale("log")
    axes.set_yticks(range(len(faults)), faults)
    axes.invert_yaxis()
    axes.legend()
    return drawing


def _ratios(trials: Trials, tilt_deg: int) -> Array:
    means = [trials.finite_mean("nees", fault=fault, tilt_deg=tilt_deg) for fault in FAULTS]
    return np.array(means) / _DIMENSIONS


_CASES: tuple[Parameters, ...] = tuple(
    {"fault": fault, "tilt_deg": tilt} for fault in FAULTS for tilt in TILTS_DEG
)
STUDY = Study(
    name="single-tags",
    title="Covariance of single tags, as printed and photographed",
    cases=_CASES,
    runs=20,
    trial=_trial,
    figures=_figures,
    draw=_draw,
    full_runs=100,
)
