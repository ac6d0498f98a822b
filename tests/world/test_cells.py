"""The paper's two cells beside the default one: their figures, and that their operators see what they need."""

from dataclasses import replace

import numpy as np
import pytest

from fakes.cell.rehearsal import Rehearsal, facts_of
from fakes.commands.layout import scripted
from fakes.world.cells import CELLS, cell_called
from fakes.world.insertions import count_insertions
from fakes.world.layout import Layout
from fakes.world.poses import (
    WORK_ROTATION,
    fixed_point_poses,
    look_poses,
    readable,
    retracted_pose,
)
from vgrd.calibration.calibration import expected_coordinate
from vgrd.calibration.solve import calibrate_system
from vgrd.calibration.stepwise import SpecialSolution
from vgrd.errors import InputError
from vgrd.geometry import log_rotation
from vgrd.model import Plan, Policy

SAMPLER, FRUIT = CELLS["sampler"], CELLS["fruit"]


@pytest.mark.parametrize("kind", [SAMPLER, FRUIT], ids=["sampler", "fruit"])
def test_both_tags_are_readable_wherever_the_operator_of_a_cell_needs_them(kind):
    layout = kind.layout()
    shots = scripted(layout)
    for name in ("hand-eye looks", "touches, wrist constant", "requests and spins"):
        assert all(all(readable(layout, *shot).values()) for shot in shots[name])
    assert all(readable(layout, *shot)["a"] for shot in shots["spike"])
    low, high = layout.workspace_mm
    for pose, _ in (shot for some in shots.values() for shot in some):
        assert (low <= pose.translation).all()
        assert (pose.translation <= high).all()


def test_the_sampler_is_seen_with_12_mp_at_0_047_mm_per_pixel():
    layout = SAMPLER.layout()
    camera_from_tag_b = layout.base_from_camera.inverse() @ (
        layout.base_from_object(0.0) @ layout.object_from_tag_b
    )
    assert layout.optics.size_px == (4024, 3036)
    mm_per_px = camera_from_tag_b.translation[2] / layout.optics.matrix[0, 0]
    assert mm_per_px == pytest.approx(0.047, abs=0.001)


def test_the_arm_of_the_sampler_turns_about_the_vertical_only():
    layout = SAMPLER.layout()
    turns = [p.rotation @ WORK_ROTATION.T for p in look_poses(layout, 8)]
    turns += [p.rotation @ WORK_ROTATION.T for p in fixed_point_poses(layout, 8)]
    rotvecs = np.array([log_rotation(turn) for turn in turns])
    assert np.abs(rotvecs[:, :2]).max() < 1e-9
    assert np.degrees(np.ptp(rotvecs[:, 2])) > 60


def test_the_holes_of_the_tray_are_62_5_mm_apart_both_ways():
    points = np.array([t.point_in_object for t in FRUIT.layout().targets.values()])
    for axis in (0, 1):
        places = np.unique(points[:, axis])
        assert np.diff(places) == pytest.approx(62.5)


def test_a_cell_is_chosen_by_name_and_a_wrong_one_is_told():
    assert cell_called("default").layout().tag_b.size_mm == Layout().tag_b.size_mm
    with pytest.raises(InputError, match=r"'smapler'; did you mean 'sampler'\?.*fruit"):
        cell_called("smapler")


def test_misses_are_counted_as_clean_touching_and_failed_by_their_size_across_the_tool():
    misses = np.array([(0.1, 0.1, 3.0), (0.2, 0.2, 0.0), (-0.3, 0.3, 0.0), (0.0, -0.2, 0.0)])
    assert count_insertions(misses, 0.4) == (2, 1, 1)


def test_the_sampler_is_taught_by_its_special_method_from_its_own_pictures(tmp_path):
    """Perfect touches and arm: what is left is the pictures' noise, far below the bottle's clearance."""
    world = SAMPLER.world(4, 700.0, 3.0, perfect=True)
    rehearsal = Rehearsal(world, facts_of(world, tmp_path))
    recording = rehearsal.teach(looks=5, spins=4, tilted=0, points=0)
    calibration = calibrate_system(replace(recording, plan=Plan.SPECIAL))
    assert isinstance(calibration.solution, SpecialSolution)
    rehearsal.stand(retracted_pose(world.layout), 2.1)
    seen = rehearsal.look()
    answer = expected_coordinate(calibration, "P2", seen.tag_b, Policy.FIXED)
    miss = world.miss_at(answer.base_from_wrist, "P2", 2.1)
    assert np.linalg.norm(miss[:2]) < 0.02
