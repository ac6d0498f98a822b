"""The judge of hand-eye on recordings: each sample predicted without itself, against its own PnP pose by cv2.

`python -m tests.benchmarks.hand_eye.judge [NAME ...] [DATASET.toml ...] [--data FOLDER]` prints a line per
method of every recording whose name holds one of the words and of every dataset that is named, then a table.
A solver is given the other samples only: what it leaves out, its levels of noise and its intrinsics are of
those. All samples count, those that a solver would leave out too.

A pose from a picture is one through some intrinsics, and through wrong ones it is wrong. So the others are judged
by PnP through the recording's intrinsics, which they assumed, and ours twice where it found that these do not fit:
what it hands back for them ("as given") through them, and what it hands back with its own through its own. Pixels
of the sample left out, each through the camera that was assumed, compare them all by what was seen.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tests.benchmarks.hand_eye.drawn import DRAWN, draws
from tests.benchmarks.hand_eye.peers import METHODS, Poses, predicted
from tests.benchmarks.hand_eye.published import DATA, of_dataset, of_others
from tests.benchmarks.hand_eye.recordings import Array, Recorded
from vgrd.calibration.hand_eye import HandEyeResult
from vgrd.errors import CalibrationError
from vgrd.solving.datasets import fit_dataset, load_dataset
from vgrd.solving.datasets.loading import Dataset

SEED = 100
RESAMPLES = 400
SET_BAR = 1.05  # of a recording's best method, or one paired bootstrap standard error
FAILED = (180.0, 1000.0, 1000.0)  # deg, mm and px of a sample that a solver could not predict
FIGURES: Mapping[str, Callable[[Array], Array]] = {
    "rms_deg": lambda misses: np.sqrt(np.mean(misses[..., 0] ** 2, axis=-1)),
    "rms_mm": lambda misses: np.sqrt(np.mean(misses[..., 1] ** 2, axis=-1)),
    "mean_deg": lambda misses: np.mean(misses[..., 0], axis=-1),
    "mean_mm": lambda misses: np.mean(misses[..., 1], axis=-1),
}
OURS, GIVEN = "vgrd", "vgrd, as given"


@dataclass(frozen=True)
class Judged:
    """misses: (n, 3) deg, mm and px (NaN of pairs) of every method; OURS and GIVEN are ours."""

    name: str
    misses: Mapping[str, Array]

    def ratio(self, figure: str, ours: str = OURS) -> tuple[float, float, str]:
        """Ours over the best method's, its paired bootstrap standard error, and that method."""
        of = FIGURES[figure]
        peers = {name: float(of(self.misses[name])) for name in METHODS}
        best = min(peers, key=lambda name: peers[name])
        mine, theirs = self.misses[ours], self.misses[best]
        rng = np.random.default_rng(SEED)
        drawn = rng.integers(0, len(mine), (RESAMPLES, len(mine)))
        spread = float(np.std(of(mine[drawn]) / of(theirs[drawn])))
        return float(of(mine)) / peers[best], spread, best

    def passes(self, figure: str, ours: str = OURS) -> bool:
        """Whether a recording is within the bar."""
        ratio, spread, _ = self.ratio(figure, ours)
        return ratio <= max(SET_BAR, 1 + spread)

    @property
    def refined(self) -> bool:
        """Whether any fit found that the recording's intrinsics do not fit."""
        return not np.array_equal(self.misses[OURS], self.misses[GIVEN], equal_nan=True)


def single(figure: str, all_judged: Sequence[Judged], ours: str = OURS) -> tuple[float, str]:
    """Geometric mean over the recordings of ours over the best single method's, and that method."""
    of = FIGURES[figure]
    means = {
        name: float(
            np.exp(np.mean([np.log(of(j.misses[ours]) / of(j.misses[name])) for j in all_judged]))
        )
        for name in METHODS
    }
    best = max(means, key=lambda name: means[name])
    return means[best], best


def recordings(folder: Path = DATA) -> Iterator[list[Recorded]]:
    """All that is judged: recordings of others where they are beside the checkout, and drawn ones by kind."""
    yield from ([recorded] for recorded in of_others(folder))
    for number, kind in enumerate(DRAWN):
        yield draws(kind, SEED * (1 + number))


def judged(alike: Sequence[Recorded]) -> Judged:
    """All methods on one recording, or on all of a kind: their samples count together."""
    misses: dict[str, list[Array]] = {name: [] for name in (*METHODS, OURS, GIVEN)}
    for recorded in alike:
        for name, solver in METHODS.items():
            misses[name].append(_misses_of(recorded, solver))
        for name, ours in zip((OURS, GIVEN), _our_misses(recorded), strict=True):
            misses[name].append(ours)
    count = f", {len(alike)} recordings" if len(alike) > 1 else ""
    pooled = {name: np.concatenate(found) for name, found in misses.items()}
    return Judged(f"{alike[0].name}{count}", pooled)


def _misses_of(recorded: Recorded, solver: Callable[[Recorded, Sequence[int]], Poses]) -> Array:
    misses = []
    for index in range(len(recorded)):
        others = [i for i in range(len(recorded)) if i != index]
        try:
            pose = predicted(recorded, solver(recorded, others), index)
            misses.append(off(recorded, index, pose, recorded.K, recorded.distortion))
        except (cv2.error, np.linalg.LinAlgError, ValueError):
            misses.append(FAILED)
    return np.array(misses)


def off(
    recorded: Recorded, index: int, pose: Array, K: Array | None, distortion: Array | None
) -> tuple[float, float, float]:
    """deg, mm and px by which a predicted pose misses a sample's own one through a camera."""
    own = recorded.own(index, K, distortion)
    turn = Rotation.from_matrix(pose[:3, :3] @ own[:3, :3].T).magnitude()
    shift = float(np.linalg.norm(pose[:3, 3] - own[:3, 3]))
    px = np.nan
    if recorded.seen is None:
        rvec = cv2.Rodrigues(pose[:3, :3])[0]
        seen = cv2.projectPoints(recorded.points[index], rvec, pose[:3, 3], K, distortion)[0]
        px = float(np.sqrt(np.mean((seen.reshape(-1, 2) - recorded.pixels[index]) ** 2)))
    return float(np.degrees(turn)), shift, px


def _our_misses(recorded: Recorded) -> tuple[Array, Array]:
    """As handed back, and as handed back for the intrinsics as given."""
    misses, given = [], []
    with tempfile.TemporaryDirectory() as folder:
        dataset = load_dataset(written(recorded, Path(folder)))
        for index in range(len(recorded)):
            try:
                result = fit_dataset(_without(dataset, index))
            except CalibrationError:
                misses.append(FAILED)
                given.append(FAILED)
                continue
            misses.append(_our_miss(recorded, dataset, index, result))
            given.append(_our_miss(recorded, dataset, index, result.as_given or result))
    return np.array(misses), np.array(given)


def _our_miss(
    recorded: Recorded, dataset: Dataset, index: int, result: HandEyeResult
) -> tuple[float, float, float]:
    pose = result.predict(dataset.samples[index].base_from_wrist).matrix()
    if result.camera is None or not result.refined:
        return off(recorded, index, pose, recorded.K, recorded.distortion)
    return off(recorded, index, pose, result.camera.matrix, result.camera.distortion)


def _without(dataset: Dataset, index: int) -> Dataset:
    keep = [i for i in range(len(dataset.samples)) if i != index]
    return replace(
        dataset,
        samples=tuple(dataset.samples[i] for i in keep),
        pose_values=tuple(dataset.pose_values[i] for i in keep),
    )


def written(recorded: Recorded, folder: Path) -> Path:
    """The recording as a user would write it: DATASET.toml, and points beside it."""
    mount = "eye-in-hand" if recorded.in_hand else "eye-to-hand"
    lines = [f'mount = "{mount}"']
    if recorded.K is not None and recorded.distortion is not None:
        K = recorded.K
        matrix = [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])]
        distortion = recorded.distortion.tolist() if recorded.distortion.any() else []
        lines += ["[camera]", f"matrix = {matrix}", f"distortion = {distortion}"]
    lines += ["[poses]", 'unit = "mm"', 'rotation = "quaternion-xyzw"']
    for index, pose in enumerate(recorded.flange):
        values = [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
        lines += ["[[sample]]", f'name = "{index}"', f"pose = {[float(v) for v in values]}"]
        if recorded.seen is not None:
            lines.append(f"camera_from_target = {recorded.seen[index].ravel().tolist()}")
            continue
        rows = np.column_stack([recorded.points[index], recorded.pixels[index]])
        text = "\n".join(",".join(f"{v:.12g}" for v in row) for row in rows)
        (folder / f"{index}.csv").write_text(f"x_mm,y_mm,z_mm,u_px,v_px\n{text}\n")
        lines.append(f'points = "{index}.csv"')
    path = folder / "dataset.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def report_of(one: Judged) -> Iterator[str]:
    """A line per method."""
    yield f"{one.name}, {len(one.misses[OURS])} samples: rms deg, mm; mean deg, mm; rms px"
    for name, misses in one.misses.items():
        figures = "  ".join(f"{float(of(misses)):9.4f}" for of in FIGURES.values())
        px = float(np.sqrt(np.mean(misses[:, 2] ** 2)))
        yield f"  {name:16} {figures}  {px:9.3f}"


def table_of(all_judged: Sequence[Judged]) -> Iterator[str]:
    """Ours over each recording's best method, and over the best single one, in Markdown."""
    yield "| recording | " + " | ".join(FIGURES) + " | within the bar |"
    yield "|---|" + "---|" * (len(FIGURES) + 1)
    for one in all_judged:
        for ours in (OURS, GIVEN) if one.refined else (OURS,):
            cells = []
            for figure in FIGURES:
                ratio, spread, best = one.ratio(figure, ours)
                cells.append(f"{ratio:.3f} +- {spread:.3f} of {best}")
            kind = ", intrinsics as given" if ours == GIVEN else ""
            missed = [figure for figure in FIGURES if not one.passes(figure, ours)]
            told = "no: " + ", ".join(missed) if missed else "yes"
            yield f"| {one.name}{kind} | {' | '.join(cells)} | {told} |"
    for ours, name in ((OURS, "geometric mean"), (GIVEN, "the same, intrinsics as given")):
        cells = []
        for figure in FIGURES:
            mean, best = single(figure, all_judged, ours)
            cells.append(f"{mean:.3f} of {best}")
        yield f"| {name} | {' | '.join(cells)} | |"


def _asked(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="tests.benchmarks.hand_eye.judge")
    parser.add_argument("chosen", nargs="*", metavar="NAME or DATASET.toml", default=[])
    parser.add_argument("--data", type=Path, default=DATA, help="folder of recordings of others")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str]) -> None:
    """Print all methods on the chosen recordings, and the table."""
    asked = _asked(arguments)
    words = [word for word in asked.chosen if not word.endswith(".toml")]
    files = [Path(word) for word in asked.chosen if word.endswith(".toml")]
    known = recordings(asked.data) if words or not files else iter(())
    chosen = [r for r in known if not words or any(word in r[0].name for word in words)]
    all_judged = []
    for alike in [*chosen, *([of_dataset(path)] for path in files)]:
        all_judged.append(judged(alike))
        sys.stdout.write("\n".join([*report_of(all_judged[-1]), ""]))
        sys.stdout.flush()
    sys.stdout.write("\n".join([*table_of(all_judged), ""]))


if __name__ == "__main__":
    main(sys.argv[1:])
