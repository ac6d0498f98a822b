"""The perturbed run of the suite reaches the solvers, and changes what it says it changes."""

import re
import subprocess
import sys
from dataclasses import replace
from inspect import signature
from pathlib import Path

import numpy as np
import pytest

from fakes.perturbation import SIZE, Jitter, Perturbation, installed
from fakes.world.simulation import Simulation
from vgrd.calibration import solve as system
from vgrd.calibration.joint import estimate as joint
from vgrd.calibration.joint.problem import HolePixel
from vgrd.calibration.tcp import fixed_point as tcp
from vgrd.calibration.tcp.fixed_point import calibrate_fixed_point
from vgrd.calibration.touches.equations import TouchSet
from vgrd.calibration.universal.estimate import UniversalProblem, calibrate_universal
from vgrd.geometry import exp_rotation
from vgrd.orphans import dying_with_us

PROJECT = Path(__file__).parents[1]


def touches(count=8, seed=1):
    rng = np.random.default_rng(seed)
    R = np.array([exp_rotation(rng.uniform(-0.5, 0.5, 3)) for _ in range(count)])
    t = np.array([400.0, 100, 60]) - R @ np.array([5.0, -8, 120]) + rng.normal(size=(count, 3))
    sigma = np.linspace(0.1, 0.2, count)  # tells which touch is which
    return TouchSet(R, t, np.array([0, 0, 1.0]), sigma, sigma)


def what_arrives(monkeypatch, **options):
    """The touches that the solver is given through its door."""
    arrived = []
    monkeypatch.setattr(
        tcp, "_rows", lambda given, rows=tcp._rows: arrived.append(given) or rows(given)
    )
    with installed(Perturbation(1, **options)) as perturbation:
        result = tcp.calibrate_fixed_point(touches())
    assert sum(perturbation.calls.values()) == 1
    return arrived[0], result


def test_a_solver_is_given_other_last_digits_in_another_order(monkeypatch):
    given, _ = what_arrives(monkeypatch)
    plain = touches()
    order = [int(np.argmin(abs(plain.lateral_sigma_mm - s))) for s in given.lateral_sigma_mm]
    assert sorted(order) == list(range(8)) != order
    changed = given.translations / plain.translations[order] - 1
    assert 0.3 * SIZE < changed.std() < 3 * SIZE
    turned = given.rotations - plain.rotations[order]
    assert 0.1 * SIZE < turned.std() < 3 * SIZE
    assert abs(np.linalg.det(given.rotations) - 1).max() < 1e-14


def test_what_a_result_tells_by_sample_comes_back_in_the_order_given(monkeypatch):
    _, result = what_arrives(monkeypatch)
    expected = calibrate_fixed_point(touches())
    np.testing.assert_allclose(result.residuals_mm, expected.residuals_mm, atol=1e-8)
    np.testing.assert_allclose(result.scores, expected.scores, atol=1e-6)
    assert not np.array_equal(result.residuals_mm, expected.residuals_mm)


def test_the_order_can_be_kept(monkeypatch):
    given, _ = what_arrives(monkeypatch, keep_order=True)
    np.testing.assert_array_equal(given.lateral_sigma_mm, touches().lateral_sigma_mm)
    assert not np.array_equal(given.translations, touches().translations)


def test_every_binding_of_a_door_is_replaced_and_put_back():
    before = [joint.calibrate_joint, system.calibrate_system, calibrate_fixed_point]
    with installed(Perturbation(1)) as perturbation:
        calibrate_fixed_point(touches())  # as a test imported it
        assert perturbation.calls == {"vgrd.calibration.tcp.fixed_point:calibrate_fixed_point": 1}
    assert [joint.calibrate_joint, system.calibrate_system, calibrate_fixed_point] == before


def test_only_the_outermost_door_perturbs():
    recording = Simulation(1).record()
    with installed(Perturbation(1)) as perturbation:
        system.calibrate_system(recording)
    assert perturbation.calls == {"vgrd.calibration.solve:calibrate_system": 1}


def test_equal_input_is_perturbed_alike_and_another_seed_differs():
    results = []
    for seed in (1, 1, 2):
        with installed(Perturbation(seed)):
            results.append(tcp.calibrate_fixed_point(touches()).tcp_in_wrist)
    np.testing.assert_array_equal(results[0], results[1])
    assert not np.array_equal(results[0], results[2])


def test_a_hole_stays_with_the_spin_in_which_it_was_seen():
    recording = Simulation(1).record()
    holes = [HolePixel("P1", np.array([1.0 + spin, 2.0]), 0.1, spin) for spin in (0, 4, 7)]
    moved, seen = Jitter(np.random.default_rng(3)).session(recording, holes)
    stamps = [recording.spins[hole.spin].stamp_s for hole in holes]
    assert {moved.spins[one.spin].stamp_s: round(one.pixel[0]) for one in seen} == dict(
        zip(stamps, (1, 5, 8), strict=True)
    )
    assert [one.spin for one in seen] != [0, 4, 7]


def test_points_and_touches_of_a_problem_stay_together():
    problem = UniversalProblem(np.arange(24.0).reshape(8, 3), touches())
    seen = []
    name = "vgrd.calibration.universal.estimate:calibrate_universal"
    Perturbation(1).call(name, seen.append, signature(calibrate_universal), problem)
    sigma = touches().lateral_sigma_mm
    for point, own in zip(seen[0].points_in_object, seen[0].touches.lateral_sigma_mm, strict=True):
        assert point[0] == pytest.approx(3 * int(np.argmin(abs(sigma - own))))


def test_a_refusal_of_the_solver_is_not_hidden():
    with installed(Perturbation(1)), pytest.raises(Exception, match="at least 3 touches"):
        tcp.calibrate_fixed_point(touches(2))
    recording = replace(Simulation(1).record(), touches=())
    with installed(Perturbation(1)), pytest.raises(Exception, match="touch"):
        joint.calibrate_joint(recording)


def test_what_is_refused_for_its_rank_is_refused_with_other_last_digits_too():
    """The quick part of `make test-robust`: decisions of rank at exactly degenerate input."""
    names = ("touch_methods", "universal", "hand_eye", "hand_eye_certificate", "hand_eye_methods")
    files = [
        str(path)
        for name in names
        for path in PROJECT.glob(f"tests/calibration/**/test_{name}.py")
    ]
    argv = [sys.executable, "-m", "pytest", "-q", "-p", "no:xdist", "-p", "no:cacheprovider"]
    argv += ["--perturb", "3", "-k", "refused or rank", *files]
    run = subprocess.run(
        dying_with_us(argv), cwd=PROJECT, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stdout
    calls, reached = re.search(r"perturbed: (\d+) calls of solvers, by (\d+)", run.stdout).groups()
    assert int(calls) >= int(reached) >= 20
