"""The judge of hand-eye on recordings: each sample predicted without itself, against its own PnP pose by cv2.

`python -m tests.benchmarks.hand_eye.judge [NAME ...]` prints a line per method of every recording whose name
holds one of the words. A solver is given the other samples only: what it leaves out, its levels of noise and
its intrinsics are of those. All samples count, those that a solver would leave out too.
"""

import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tests.benchmarks.hand_eye.peers import METHODS, Poses, predicted
from tests.benchmarks.hand_eye.recordings import DRAWN, Array, Recorded, draw, of_others
from vgrd.errors import CalibrationError
from vgrd.solving.datasets import fit_dataset, load_dataset
from vgrd.solving.datasets.loading import Dataset

SEED = 100
RESAMPLES = 400
FAILED = (180.0, 1000.0)  # deg and mm of a sample that a solver could not predict
FIGURES: Mapping[str, Callable[[Array], Array]] = {
    "rms_deg": lambda misses: np.sqrt(np.mean(misses[..., 0] ** 2, axis=-1)),
    "rms_mm": lambda misses: np.sqrt(np.mean(misses[..., 1] ** 2, axis=-1)),
    "mean_deg": lambda misses: np.mean(misses[..., 0], axis=-1),
    "mean_mm": lambda misses: np.mean(misses[..., 1], axis=-1),
}


@dataclass(frozen=True)
class Judged:
    """misses: (n, 2) deg and mm of every method; "vgrd" is ours.

    Ours is judged by each sample's own pose through the intrinsics that it hands back; `given`: (n, 2)
    through those of the recording.
    """

    name: str
    misses: Mapping[str, Array]
    given: Array

    def ratio(self, figure: str) -> tuple[float, float, str]:
        """Ours over the best method's, its paired bootstrap standard error, and that method."""
        of = FIGURES[figure]
        peers = {name: float(of(m)) for name, m in self.misses.items() if name != "vgrd"}
        best = min(peers, key=lambda name: peers[name])
        ours, theirs = self.misses["vgrd"], self.misses[best]
        rng = np.random.default_rng(SEED)
        drawn = rng.integers(0, len(ours), (RESAMPLES, len(ours)))
        spread = float(np.std(of(ours[drawn]) / of(theirs[drawn])))
        return float(of(ours)) / peers[best], spread, best


def recordings() -> Iterator[Recorded]:
    """All recordings: of others where they are beside the checkout, and drawn ones."""
    yield from of_others()
    for number, kind in enumerate(DRAWN):
        yield draw(kind, SEED + number)


def judged(recorded: Recorded) -> Judged:
    """All methods on one recording."""
    misses = {name: _misses_of(recorded, solver) for name, solver in METHODS.items()}
    ours, given = _our_misses(recorded)
    return Judged(recorded.name, {**misses, "vgrd": ours}, given)


def _misses_of(recorded: Recorded, solver: Callable[[Recorded, Sequence[int]], Poses]) -> Array:
    misses = []
    for index in range(len(recorded)):
        others = [i for i in range(len(recorded)) if i != index]
        try:
            pose = predicted(recorded, solver(recorded, others), index)
            misses.append(_off(pose, recorded.own(index)))
        except (cv2.error, np.linalg.LinAlgError, ValueError):
            misses.append(FAILED)
    return np.array(misses)


def _off(pose: Array, own: Array) -> tuple[float, float]:
    turn = Rotation.from_matrix(pose[:3, :3] @ own[:3, :3].T).magnitude()
    return float(np.degrees(turn)), float(np.linalg.norm(pose[:3, 3] - own[:3, 3]))


def _our_misses(recorded: Recorded) -> tuple[Array, Array]:
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
            pose = result.predict(dataset.samples[index].base_from_wrist).matrix()
            given.append(_off(pose, recorded.own(index)))
            if result.camera is None:
                misses.append(given[-1])
            else:
                own = recorded.own(index, result.camera.matrix, result.camera.distortion)
                misses.append(_off(pose, own))
    return np.array(misses), np.array(given)


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


def main(words: Sequence[str]) -> None:
    """Print all methods on the chosen recordings."""
    for recorded in recordings():
        if words and not any(word in recorded.name for word in words):
            continue
        one = judged(recorded)
        sys.stdout.write(f"{one.name}, {len(recorded)} samples: rms deg, mm; mean deg, mm\n")
        lines = {**one.misses, "vgrd, given camera": one.given}
        for name, misses in lines.items():
            figures = "  ".join(f"{float(of(misses)):9.4f}" for of in FIGURES.values())
            sys.stdout.write(f"  {name:20} {figures}\n")
        for figure in FIGURES:
            ratio, spread, best = one.ratio(figure)
            sys.stdout.write(f"  {figure}: {ratio:.3f} +- {spread:.3f} of {best}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
