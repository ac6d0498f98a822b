"""What the table of cells rests on: the noise of a tag's pose, against OpenCV's solver on noisy corners."""

import cv2
import numpy as np
import pytest

from fakes.studies.robustness.cell_fit import CAMERAS, STUDY
from fakes.studies.runner import run_trials


def test_a_picture_shows_what_the_lens_lets_it():
    paper = CAMERAS["12 MP, 12 mm"]
    assert paper.field_mm(700.0)[0] / paper.width_px == pytest.approx(0.108, abs=0.001)  # mm/px
    assert paper.edge_px(25.0, 700.0) == pytest.approx(231.7, abs=0.1)


@pytest.mark.parametrize(("edge_mm", "distance_mm"), [(15.0, 400.0), (40.0, 1200.0)])
def test_the_noise_of_a_tag_is_that_of_its_corners(edge_mm, distance_mm):
    optics, rng = CAMERAS["5 MP, 12 mm"], np.random.default_rng(3)
    K = np.diag([optics.focal_px, optics.focal_px, 1.0])
    corners = edge_mm / 2 * np.array([(-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)], float)
    lean, place = np.array([np.radians(30), 0.0, 0.0]), np.array([0.0, 0.0, distance_mm])
    R = cv2.Rodrigues(lean)[0]
    pixels = cv2.projectPoints(corners, lean, place, K, None)[0].reshape(4, 2)
    shifts, turns = [], []
    for _ in range(400):
        seen = pixels + rng.normal(size=(4, 2)) * 0.03
        _, rotvec, t = cv2.solvePnP(
            corners, seen, K, None, lean.copy(), place.copy(), useExtrinsicGuess=True
        )
        shifts.append(t.ravel() - place)
        turns.append(cv2.Rodrigues(R.T @ cv2.Rodrigues(rotvec)[0])[0].ravel())
    shift, turn = np.std(shifts, axis=0), np.degrees(np.std(turns, axis=0))
    told = optics.vision(edge_mm, distance_mm)
    assert told.lateral_mm == pytest.approx(np.sqrt(np.mean(shift[:2] ** 2)), rel=0.15)
    assert told.depth_mm == pytest.approx(shift[2], rel=0.15)
    assert told.tilt_deg == pytest.approx(np.sqrt(np.mean(turn[:2] ** 2)), rel=0.15)
    assert told.roll_deg == pytest.approx(turn[2], rel=0.15)


def test_one_session_of_a_cell_is_solved_and_asked():
    study_of_two = type(STUDY)(
        name=STUDY.name,
        title=STUDY.title,
        cases=STUDY.cases[-1:],
        runs=1,
        trial=STUDY.trial,
        figures=lambda _: [],
        draw=STUDY.draw,
    )
    trials = run_trials(study_of_two, 2, 5)
    assert 0.2 < trials.mean("u95_mm") < 2.0  # touches of 0.5 mm
    assert 0 < trials.mean("square_mm2") < 4.0
