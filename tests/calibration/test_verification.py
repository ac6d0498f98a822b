"""A verification weighs what its touch tells in each direction: across and along the tool axis."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.recordings import SimulatedCell, fixed_wrist
from vgrd.calibration.system import calibrate_system
from vgrd.calibration.verdict import verify
from vgrd.geometry import Pose

HONEST = 200


@pytest.fixture(scope="module")
def taught():
    world = SimulatedCell(np.random.default_rng(10))
    calibration = calibrate_system(world.record())
    touch = world.touch("P2", fixed_wrist(), angle_rad=1.0)
    axis = touch.base_from_wrist.rotation @ calibration.facts.tool.axis_in_wrist
    return calibration, touch, axis


def moved(touch, offset):
    pose = touch.base_from_wrist
    return replace(touch, base_from_wrist=Pose(pose.rotation, pose.translation + offset))


def failed(calibration, touch, lateral_mm, axial_mm):
    touch = replace(touch, lateral_sigma_mm=lateral_mm, axial_sigma_mm=axial_mm)
    findings, _ = verify(calibration, [touch])
    return any(finding.fatal for finding in findings)


def test_honest_touches_that_are_rough_along_the_axis_pass(taught) -> None:
    """34 of 40 were fatal when the lateral sigma stood for all three axes."""
    calibration, touch, axis = taught
    rng = np.random.default_rng(7)
    refused = sum(
        failed(
            calibration,
            moved(touch, axis * rng.normal() + across(axis, rng) * 0.2),
            lateral_mm=0.25,
            axial_mm=1.0,
        )
        for _ in range(HONEST)
    )
    assert refused <= 2


def test_a_miss_across_a_rough_axis_is_told_and_one_along_it_is_not(taught) -> None:
    calibration, touch, axis = taught
    sideways = across(axis, np.random.default_rng(3))
    assert failed(calibration, moved(touch, 2.5 * sideways), 0.25, 1.0)
    assert not failed(calibration, moved(touch, 2.5 * axis), 0.25, 1.0)
    assert failed(calibration, moved(touch, 2.5 * axis), 1.0, 0.25)
    assert not failed(calibration, moved(touch, 2.0 * sideways), 1.0, 0.25)


@pytest.mark.parametrize("lateral_mm", [0.25, np.inf])
@pytest.mark.parametrize("axial_mm", [0.25, np.inf])
def test_only_what_a_touch_tells_is_judged(taught, lateral_mm, axial_mm) -> None:
    """A miss of 50 mm passed beside an infinite sigma, since what is not a number is never greater."""
    calibration, touch, axis = taught
    sideways = across(axis, np.random.default_rng(3))
    assert failed(calibration, moved(touch, 50 * sideways), lateral_mm, axial_mm) == np.isfinite(
        lateral_mm
    )
    assert failed(calibration, moved(touch, 50 * axis), lateral_mm, axial_mm) == np.isfinite(
        axial_mm
    )


def test_a_touch_that_tells_nothing_is_said_to_be_unusable(taught) -> None:
    calibration, touch, _ = taught
    blunt = replace(touch, lateral_sigma_mm=np.inf, axial_sigma_mm=np.inf)
    findings, residuals = verify(calibration, [blunt])
    assert [finding.code for finding in findings] == ["verification_unusable"]
    assert residuals == {}


def across(axis, rng):
    sideways = np.cross(axis, rng.normal(size=3))
    return sideways / np.linalg.norm(sideways)
