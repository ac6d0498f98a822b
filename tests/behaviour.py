"""What two trees of the project answer to the same questions, and where they differ.

    python -m tests.behaviour record TREE OUT.json [--data FOLDER] [--sessions FOLDER]
    python -m tests.behaviour compare BEFORE.json AFTER.json

TREE is a checkout, for example one of `git worktree add`; all of it runs in the Python of this
command. DATA holds recordings by others (`hand_eye_datasets`, `touch_files` and `pictures` say which
files count); SESSIONS holds recorded sessions. What changes only names, rooms or words must compare
as equal: numbers to a relative 1e-9, all else exactly.
"""

import argparse
import csv
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

RELATIVE = 1e-9  # a change of the order of sums stays below it, a change of a result does not
ABSOLUTE = 1e-9  # mm, px, deg: what is 0 but for rounding
TIMEOUT_S = 600
STUDIES = {  # trials of each case: few, all is seeded
    "fig4": 3,
    "experiment-a": 3,
    "table3": 2,
    "table4": 2,
    "tilt": 3,
    "certificate": 5,
    "coverage": 2,
    "blunders": 1,
    "coached": 1,
    "conventions": 1,
    "degenerate": 1,
    "degenerate-touches": 3,
}


class Tree:
    """A checkout, and how its commands are run."""

    def __init__(self, root: Path) -> None:
        self.root = root.resolve()
        self._environment = {
            **os.environ,
            "PYTHONPATH": str(self.root),
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }

    def run(self, *argv: str) -> dict[str, Any]:
        """Exit code, JSON (or text) of standard output, and standard error of `python ARGV`."""
        done = subprocess.run(
            [sys.executable, *argv],
            cwd=self.root,
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
        try:
            output = json.loads(done.stdout)
        except ValueError:
            output = done.stdout.splitlines()
        return {"exit": done.returncode, "output": output, "error": done.stderr.splitlines()}

    def vgrd(self, *arguments: str) -> dict[str, Any]:
        """Answer of a command of vgrd, asked for JSON."""
        return self.run("-m", "vgrd.cli", *arguments, "--json", "-")


def hand_eye_datasets(data: Path, tree: Tree, folder: Path) -> Iterator[Path]:
    """Every hand-eye dataset; those of ROS-Industrial are converted first."""
    yield from sorted(data.glob("*/dataset.toml"))
    yield from sorted((data / "cases" / "hand-eye").glob("*.toml"))
    converter = str(tree.root / "config" / "examples" / "convert_ros_industrial.py")
    if (data / "ros-industrial-charuco").is_dir():
        for name, options in (("given", ()), ("refined", ("--refine",))):
            place = folder / name
            tree.run(converter, str(data / "ros-industrial-charuco"), str(place), *options)
            yield place / "dataset.toml"


def touch_files(data: Path) -> list[Path]:
    """Every file of touches."""
    return sorted((data / "cases" / "tcp").glob("*.toml"))


def picture_questions(data: Path) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Name and arguments of `vgrd detect` for every picture with its board."""
    tags = data / "cases" / "tags"
    for picture, board in (
        ("charuco6x8-new.png", "b6x8.toml"),
        ("charuco6x8-new.png", "b6x8-swapped.toml"),
        ("charuco7x5-px8.png", "b7x5.toml"),
        ("kalibr-aprilgrid.png", "kalibr.toml"),
    ):
        if (tags / picture).is_file():
            camera = ("--camera", str(tags / "camera.yaml"))
            yield (
                f"{picture} as {board}",
                (str(tags / picture), "--board", str(tags / board), *camera),
            )
    for picture in sorted(tags.glob("*.png")):
        yield f"{picture.name}, tags", (str(picture), "--dictionary", "36h11", "--size-mm", "20")


def registers(tree: Tree) -> dict[str, Any]:
    """Register image of a fixed script with a clock of its own."""
    return tree.run(str(Path(__file__).with_name("register_script.py")))


def studies(tree: Tree, folder: Path) -> Iterator[tuple[str, Any]]:
    """Every trial of every study, few of them."""
    for name, runs in STUDIES.items():
        place = folder / name
        asked = ("study", name, "--runs", str(runs), "--no-plot", "--out", str(place))
        answer = tree.run("-m", "vgrd.cli", *asked)
        with (place / f"{name}.csv").open(encoding="utf-8") as file:
            yield name, {"exit": answer["exit"], "rows": list(csv.DictReader(file))}


def record(tree: Tree, data: Path, sessions: Path | None) -> dict[str, Any]:
    """Ask everything; shows on standard error what is being asked."""
    answers: dict[str, Any] = {}

    def keep(name: str, answer: object) -> None:
        answers[name] = answer
        print(name, file=sys.stderr, flush=True)

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        keep("registers", registers(tree))
        for path in hand_eye_datasets(data, tree, folder):
            keep(f"solve {_short(path)}", tree.vgrd("solve", str(path)))
        for path in touch_files(data):
            keep(f"tcp {_short(path)}", tree.vgrd("tcp", str(path)))
        for name, arguments in picture_questions(data):
            keep(f"detect {name}", tree.vgrd("detect", *arguments))
        for path in sorted(sessions.iterdir()) if sessions else ():
            keep(f"session {path.name}", tree.vgrd("solve", str(path)))
            keep(f"budget {path.name}", tree.vgrd("budget", str(path)))
        for name, rows in studies(tree, folder / "studies"):
            keep(f"study {name}", rows)
        text = json.dumps(answers).replace(str(folder), "TEMPORARY")
    return dict(json.loads(text.replace(str(tree.root), "TREE")))


def _short(path: Path) -> str:
    return f"{path.parent.name}/{path.name}"


def differences(before: object, after: object, where: str = "") -> Iterator[str]:
    """Each place at which two answers differ, in words."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in before.keys() | after.keys():
            if key not in before or key not in after:
                yield f"{where}.{key}: only {'before' if key in before else 'after'}"
            else:
                yield from differences(before[key], after[key], f"{where}.{key}")
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for i, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from differences(one, other, f"{where}[{i}]")
    elif not _equal(before, after):
        yield f"{where}: {before!r} -> {after!r}"


def _equal(before: object, after: object) -> bool:
    a, b = _number(before), _number(after)
    if a is None or b is None:
        return before == after
    return math.isclose(a, b, rel_tol=RELATIVE, abs_tol=ABSOLUTE) or (a != a and b != b)


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        return float(value)
    except ValueError:
        return None


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 1 where two recordings differ."""
    parser = argparse.ArgumentParser(prog="python -m tests.behaviour", description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    asked = verbs.add_parser("record")
    asked.add_argument("tree", type=Path)
    asked.add_argument("out", type=Path)
    asked.add_argument("--data", type=Path, default=Path(__file__).parents[2] / "shared" / "data")
    asked.add_argument("--sessions", type=Path)
    held = verbs.add_parser("compare")
    held.add_argument("before", type=Path)
    held.add_argument("after", type=Path)
    given = parser.parse_args(argv)
    if given.verb == "record":
        answers = record(Tree(given.tree), given.data, given.sessions)
        given.out.write_text(json.dumps(answers, indent=1), encoding="utf-8")
        return 0
    found = list(differences(*(json.loads(p.read_text()) for p in (given.before, given.after))))
    print("\n".join(found) or "equal")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
