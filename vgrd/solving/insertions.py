"""What `vgrd solve` says of targets with a clearance: how often things will go in."""

import numpy as np

from vgrd.calibration.calibration import Calibration, expected_coordinate
from vgrd.calibration.insertion import Insertion, insertion_of, mean_insertion
from vgrd.errors import CalibrationError, InputError
from vgrd.model import Observation, Policy, Recording, place_in


def insertion_sentences(
    calibration: Calibration, recording: Recording, policy: Policy
) -> list[str]:
    """One for each target with a clearance: the mean over the pictures of the session in which it can be told."""
    pictures = (*recording.touch_pictures, *recording.spins)
    sentences = []
    for name, taught in calibration.taught.items():
        clearance_mm = taught.target.clearance_mm
        if clearance_mm is None:
            continue
        odds = [
            each for picture in pictures if (each := _odds(calibration, name, picture, policy))
        ]
        if odds:
            sentences.append(f"{name}: {_in_words(mean_insertion(odds), clearance_mm)}")
    return sentences


def _odds(
    calibration: Calibration, target: str, picture: Observation, policy: Policy
) -> Insertion | None:
    """None where the picture allows no answer, which the verdict or the blind spots tell."""
    if picture.tag_b is None:
        return None
    place = place_in(picture, calibration.facts.camera_stability)
    work = np.asarray(calibration.taught[target].base_from_work)
    try:
        expected = expected_coordinate(calibration, target, picture.tag_b, policy, work, place)
    except (CalibrationError, InputError):
        return None
    return insertion_of(expected, calibration.facts.tool, expected.target.clearance_mm)


def _in_words(odds: Insertion, clearance_mm: float) -> str:
    clean, touching, failed = (100 * share for share in (odds.clean, odds.touching, odds.failed))
    return (
        f"goes in without contact in {clean:.1f} %, with contact in {touching:.1f} %, not in {failed:.1f} % "
        f"(clearance {clearance_mm:g} mm)"
    )
