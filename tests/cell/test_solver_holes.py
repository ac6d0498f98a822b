"""Holes in the pictures of a session narrow what is solved from it, and are left out where they are wrong."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from fakes.cell.rehearsal import Rehearsal, facts_of
from fakes.world.layout import Layout
from fakes.world.optics import Optics
from fakes.world.poses import retracted_pose
from fakes.world.world import World
from vgrd.calibration.calibration import Calibration, expected_coordinate
from vgrd.calibration.joint import JointFit, calibrate_joint, expected_by_joint
from vgrd.calibration.joint.fit import fit_joint, information_inverse
from vgrd.calibration.joint.problem import HolePixel
from vgrd.calibration.joint.samples import gather
from vgrd.calibration.joint.start import guess
from vgrd.calibration.joint.state import layout_of
from vgrd.calibration.solve import calibrate_system
from vgrd.clock import SystemClock
from vgrd.devices import CameraImage
from vgrd.errors import InputError
from vgrd.geometry.camera import CameraModel
from vgrd.model import Plan, Policy, Recording, frozen_array
from vgrd.solving import hole_sightings
from vgrd.solving.hole_pictures import draw_searched
from vgrd.solving.hole_sightings import HolesSeen, see_holes
from vgrd.solving.session import solve_session
from vgrd.store.sessions import SampleKind, SessionWriter
from vgrd.vision.images.drawing import DOUBTFUL, GOOD, Bgr

LOOKS, SPINS = 4, 3


def small_layout() -> Layout:
    """The fake cell with holes of twice the size on a sensor of a quarter of the pixels."""
    optics = Layout().optics
    matrix = frozen_array(np.diag([0.5, 0.5, 1]) @ optics.matrix, 3, 3)
    size = (optics.size_px[0] // 2, optics.size_px[1] // 2)
    small = Optics(matrix, optics.distortion, size, optics.focus_mm, optics.aperture_mm)
    holes = {
        name: replace(target, hole_diameter_mm=2 * target.hole_diameter_mm)
        for name, target in Layout().targets.items()
    }
    return Layout(optics=small, targets=holes)


class Taught:
    """A session of six touches with one wrist, its pictures, and what they showed of the holes."""

    def __init__(self, folder: Path) -> None:
        self.world = World(small_layout(), 2)
        facts = facts_of(self.world, folder)
        self.rehearsal = Rehearsal(self.world, facts, keeps_pictures=True)
        self.recording = self.rehearsal.teach(looks=LOOKS, spins=SPINS, tilted=0, points=0)
        self.kept = list(self.rehearsal.shots)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(hole_sightings, "PICTURES", 4)
            self.holes = self.see(self.recording)

    def see(self, recording: Recording, only: slice = slice(None)) -> HolesSeen:
        return see_holes(recording, [seen for seen, _ in self.kept[only]], self.rehearsal.images)

    def misses(self, calibration: Calibration) -> tuple[np.ndarray, np.ndarray]:
        """True misses (n, 3) mm of requests at two table angles, and the 95 % told for them."""
        out = []
        for angle in (0.7, 3.8):
            self.rehearsal.stand(retracted_pose(), angle)
            tag_b = self.rehearsal.look().tag_b
            for name in self.world.targets:
                expected = expected_coordinate(calibration, name, tag_b, Policy.FIXED)
                miss = self.world.miss_at(expected.base_from_wrist, name, angle)
                out.append((miss, expected.u95_mm))
        return np.array([miss for miss, _ in out]), np.array([u95 for _, u95 in out])

    def told(self, fit: JointFit) -> float:
        """Mean 95 % radius in a picture of the session."""
        tag_b = self.recording.spins[0].tag_b
        told = [expected_by_joint(fit, name, tag_b).u95_mm for name in self.world.targets]
        return float(np.mean(told))


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory) -> Taught:
    return Taught(tmp_path_factory.mktemp("taught"))


def stored(taught: Taught, state: Path, *, plan: Plan = Plan.JOINT, pictures: bool = True) -> Path:
    recording = taught.recording
    writer = SessionWriter(state, "taught", plan, recording.facts, SystemClock())
    with writer:
        for kind, values in (
            (SampleKind.LOOK, recording.looks),
            (SampleKind.SPIN, recording.spins),
            (SampleKind.TOUCH, recording.touches),
        ):
            for value in values:
                writer.sample(kind, value)
        for frame, (seen, picture) in enumerate(taught.kept if pictures else ()):
            writer.observation(seen)
            writer.image(CameraImage(picture, seen.stamp_s, frame))
    return writer.path


@pytest.mark.parametrize("seed", [1, 2, 8])
def test_what_one_wrist_leaves_open_keeps_its_first_value_and_costs_no_steps(seed, tmp_path):
    world = World(small_layout(), seed)
    rehearsal = Rehearsal(world, facts_of(world, tmp_path))
    data = gather(rehearsal.teach(looks=LOOKS, spins=SPINS, tilted=0, points=0))
    layout, first = layout_of(data), guess(data)
    found = fit_joint(data, layout, first)
    _, undetermined = information_inverse(found.jacobian, layout)
    moved = found.state.tcp_in_wrist - first.tcp_in_wrist
    assert np.abs(undetermined).max() > 1
    assert np.abs(moved).max() < 500
    assert found.report.steps < 20


def test_every_sighting_is_where_the_hole_truly_is(taught):
    layout = taught.world.layout
    optics = layout.optics
    camera = CameraModel(optics.matrix, optics.distortion, optics.size_px)
    off = []
    for one in taught.holes.sightings:
        angle = 0.0 if one.spin is None else 2 * np.pi * one.spin / SPINS
        at = layout.target_in_base(one.target, angle)
        off.append(one.pixel - camera.project(layout.base_from_camera.inverse() @ at[None])[0])
    assert taught.holes.unseen == {}
    assert {one.spin is None for one in taught.holes.sightings} == {True, False}
    assert np.abs(off).max() < 0.03
    assert np.abs(np.mean(off, axis=0)).max() < 0.005


def test_holes_shrink_the_miss_and_what_is_told_of_it(taught):
    without = calibrate_system(taught.recording)
    with_holes = calibrate_system(taught.recording, sightings=taught.holes.sightings)
    (before, _), (after, told_after) = map(taught.misses, (without, with_holes))
    xy_before, xy_after = (np.linalg.norm(m[:, :2], axis=1).mean() for m in (before, after))
    assert xy_after < 0.7 * xy_before
    assert with_holes.residuals["holes_used"] == len(taught.holes.sightings)
    assert with_holes.residuals["holes_rms_px"] < 0.3
    # At one level of noise: what each solve finds of it by itself differs by chance.
    without, with_holes = (
        taught.told(calibrate_joint(taught.recording, seen, find_noise=False))
        for seen in ((), taught.holes.sightings)
    )
    assert with_holes < 0.5 * without
    assert (np.linalg.norm(after, axis=1) <= told_after).mean() > 0.9


def test_many_sightings_of_one_hole_tell_no_more_than_its_tolerance_in_cad(taught):
    facts, seen = taught.recording.facts, taught.holes.sightings
    px_per_mm = facts.camera_matrix[0, 0] / 600
    for name in taught.world.targets:
        precisions = [(px_per_mm / one.sigma_px) ** 2 for one in seen if one.target == name]
        together_mm = 1 / np.sqrt(np.sum(precisions))
        assert together_mm == pytest.approx(facts.object.hole_sigma_mm, rel=0.25)


def test_the_hole_in_which_the_tool_stands_is_never_seen(taught):
    first = LOOKS + SPINS
    touched = taught.recording.touches[0].target
    assert taught.kept[first][0] is taught.recording.touches[0].observation
    seen = taught.see(taught.recording, slice(first, first + 1))
    assert "without the tool" in seen.unseen[touched]
    assert touched not in {one.target for one in seen.sightings}
    assert len(seen.sightings) >= 2


def test_pictures_of_an_object_that_stands_elsewhere_are_not_used(taught):
    elsewhere = replace(taught.recording, spins=())
    spins = slice(LOOKS + 1, LOOKS + SPINS)
    seen = taught.see(elsewhere, spins)
    assert seen.sightings == ()
    assert set(seen.unseen) == set(taught.world.targets)


def test_a_sighting_that_contradicts_is_left_out_and_named(taught):
    good = taught.holes.sightings
    k = next(k for k, one in enumerate(good) if one.spin is not None)
    wrong = replace(good[k], pixel=good[k].pixel + np.array([15.0, 0.0]))
    calibration = calibrate_system(taught.recording, sightings=(*good[:k], wrong, *good[k + 1 :]))
    (finding,) = (f for f in calibration.verdict.findings if f.code == "hole_outlier")
    assert f"hole {wrong.target} in spin {wrong.spin + 1}" in finding.message
    assert calibration.residuals["holes_used"] == len(good) - 1


def test_a_stored_session_is_solved_with_the_holes_in_its_pictures(taught, tmp_path, monkeypatch):
    monkeypatch.setattr(hole_sightings, "PICTURES", 2)
    searched: list[tuple[int, int]] = []
    folder = stored(taught, tmp_path)
    told = solve_session(
        folder,
        report=lambda done, total: searched.append((done, total)),
        draw=tmp_path / "new" / "drawn",
    )
    assert told["holes"]["seen"] == told["residuals"]["holes_used"] >= 6
    assert told["warnings"] == []
    assert searched[:2] == [(1, 2), (2, 2)]
    names = [Path(file).name for file in told["drawn"]]
    assert len(names) == len(searched)
    assert [name[:8] for name in names[:2]] == ["holes-01", "holes-02"]
    assert {name[9:] for name in names[:2]} == {"spin-1.png", "touched.png"}
    assert sorted(file.name for file in (tmp_path / "new" / "drawn").iterdir()) == names


def colours(path: Path, colour: Bgr) -> int:
    return int((np.abs(cv2.imread(str(path)).astype(int) - colour) < 50).all(axis=-1).sum())


def test_drawn_pictures_show_every_fit_and_a_covered_hole_with_the_reason(
    taught, tmp_path, monkeypatch
):
    monkeypatch.setattr(hole_sightings, "PICTURES", 2)
    optics = taught.world.layout.optics
    camera = CameraModel(optics.matrix, optics.distortion, optics.size_px)

    def place(name: str, spin: int | None) -> np.ndarray:
        angle = 0.0 if spin is None else 2 * np.pi * spin / SPINS
        at = taught.world.layout.target_in_base(name, angle)
        return camera.project(taught.world.layout.base_from_camera.inverse() @ at[None])[0]

    def covered(stamps):
        """Half of hole P3 under a sheet of paper."""
        for image in taught.rehearsal.images(stamps):
            pixels = image.pixels.copy()
            spin = image.frame - LOOKS
            x, y = np.rint(place("P3", spin if 0 <= spin < SPINS else None)).astype(int)
            pixels[y - 30 : y + 30, x : x + 30] = 200
            yield CameraImage(pixels, image.stamp_s, image.frame)

    seen = see_holes(taught.recording, [one for one, _ in taught.kept], covered)
    assert "partly hidden" in seen.unseen["P3"]
    files = draw_searched(seen.pictures, covered, tmp_path)
    assert len(files) == len(seen.pictures)
    for path, picture in zip(files, seen.pictures, strict=True):
        for one in picture.sightings:
            truth = place(one.target, picture.spin)
            assert np.linalg.norm(one.hole.outline_px.mean(axis=0) - truth) < 0.5
            apart = one.hole.rim_px[:, None] - one.hole.outline_px
            assert np.linalg.norm(apart, axis=2).min(axis=1).max() < 2.0
        assert colours(path, GOOD) >= 300 * len(picture.sightings)
        assert (colours(path, DOUBTFUL) > 100) == bool(picture.missed)
        for name, missed in picture.missed.items():
            truth = place(name, picture.spin)
            assert np.linalg.norm(missed.outline_px.mean(axis=0) - truth) < 8
    assert sum("P3" in picture.missed for picture in seen.pictures) >= 3


def test_a_folder_for_pictures_that_cannot_be_made_is_refused_before_the_work(taught, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"--draw .*file: cannot be made"):
        solve_session(tmp_path / "no session", draw=tmp_path / "file")


def test_holes_give_plan_special_its_centre_where_the_object_never_turned(taught, tmp_path):
    recording = replace(taught.recording, spins=(), plan=Plan.SPECIAL)
    told = calibrate_system(recording, sightings=still_ones(taught))
    misses, told_mm = taught.misses(told)
    turned, _ = taught.misses(calibrate_system(replace(taught.recording, plan=Plan.SPECIAL)))
    xy, xy_turned = (np.linalg.norm(m[:, :2], axis=1).mean() for m in (misses, turned))
    assert xy < 1.1 * xy_turned
    assert (np.linalg.norm(misses, axis=1) <= told_mm).mean() > 0.9


def still_ones(taught: Taught) -> list[HolePixel]:
    return [one for one in taught.holes.sightings if one.spin is None]


def test_a_stored_session_of_plan_special_is_solved_with_its_holes(taught, tmp_path, monkeypatch):
    monkeypatch.setattr(hole_sightings, "PICTURES", 2)
    told = solve_session(stored(taught, tmp_path, plan=Plan.SPECIAL))
    assert told["method"] == "special"
    assert told["holes"]["seen"] == told["residuals"]["holes_used"] >= 6


@pytest.mark.parametrize("plan", [Plan.JOINT, Plan.SPECIAL, Plan.UNIVERSAL])
def test_without_pictures_or_with_plan_universal_a_session_is_solved_as_before(
    taught, tmp_path, plan
):
    folder = stored(taught, tmp_path, plan=plan, pictures=plan is Plan.UNIVERSAL)
    told = solve_session(folder)
    assert told["holes"]["seen"] == 0
    assert "holes_used" not in told["residuals"]
    warned = any("no pictures" in one for one in told["warnings"])
    assert warned == (plan is not Plan.UNIVERSAL)
