"""Write a DATASET.toml for recordings that other projects publish.

    python config/examples/convert_ros_industrial.py SRC OUT_DIR

SRC with cal_data.yaml: an example of ros-industrial/industrial_calibration (ChArUco board on the
flange, fixed camera). SRC with pose_samples.json: the solver test of moveit/moveit_calibration
(pairs of 4x4 matrices). Pictures are copied. Needs PyYAML for the first.
"""

import argparse
import json
import shutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

BITS = (4, 5, 6, 7)
COUNTS = (50, 100, 250, 1000)


def main(arguments: Sequence[str]) -> int:
    """Convert; 0 when OUT_DIR/dataset.toml was written."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("source", type=Path, help="folder with cal_data.yaml or pose_samples.json")
    parser.add_argument("out_dir", type=Path, help="folder for dataset.toml and its pictures")
    parser.add_argument(
        "--refine", action="store_true", help="let the intrinsics be estimated too"
    )
    options = parser.parse_args(arguments)
    if (options.source / "cal_data.yaml").is_file():
        lines = ros_industrial(options.source, options.out_dir, refine=options.refine)
    elif (options.source / "pose_samples.json").is_file():
        lines = moveit(options.source)
    else:
        parser.error(f"{options.source} holds neither cal_data.yaml nor pose_samples.json")
    options.out_dir.mkdir(parents=True, exist_ok=True)
    written = options.out_dir / "dataset.toml"
    written.write_text("\n".join(lines) + "\n", encoding="utf-8")
    sys.stdout.write(f"{written}\n")
    return 0


def ros_industrial(source: Path, out_dir: Path, *, refine: bool) -> Iterable[str]:
    """Lines of the TOML file of one industrial_calibration example; copies its pictures."""
    import yaml

    data: dict[str, Any] = yaml.safe_load((source / "cal_data.yaml").read_text(encoding="utf-8"))
    board, camera = data["target_finder"], data["intrinsics"]
    family, size = divmod(int(board["dictionary"]), len(COUNTS))
    yield from header("quaternion-xyzw")
    yield from (
        "[camera]",
        f"matrix = [{camera['fx']}, {camera['fy']}, {camera['cx']}, {camera['cy']}]",
        "distortion = []",
        f"refine = {str(refine).lower()}",
        "[target]",
        'type = "charuco"',
        f"columns = {board['cols']}",
        f"rows = {board['rows']}",
        f"square_mm = {1000 * board['chessboard_dim']:.6g}",
        f"marker_mm = {1000 * board['aruco_marker_dim']:.6g}",
        f'dictionary = "{BITS[family]}x{BITS[family]}_{COUNTS[size]}"',
    )
    for entry in data["data"]:
        pose = yaml.safe_load((source / entry["pose"]).read_text(encoding="utf-8"))
        picture = out_dir / entry["image"]
        picture.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source / entry["image"], picture)
        yield from sample(
            Path(entry["image"]).stem,
            [pose[key] for key in ("x", "y", "z", "qx", "qy", "qz", "qw")],
        )
        yield f'image = "{entry["image"]}"'


def moveit(source: Path) -> Iterable[str]:
    """Lines of the TOML file of moveit_calibration's pairs (flange in base, target in camera)."""
    pairs = json.loads((source / "pose_samples.json").read_text(encoding="utf-8"))
    yield from header("quaternion-xyzw")
    for number, (base_from_wrist, camera_from_target) in enumerate(pairs):
        rotation = Rotation.from_matrix([row[:3] for row in base_from_wrist[:3]])
        position = [row[3] for row in base_from_wrist[:3]]
        yield from sample(str(number), [*position, *rotation.as_quat().tolist()])
        yield f"camera_from_target = {[x for row in camera_from_target for x in row]}"


def header(rotation: str) -> Iterable[str]:
    """Mount and pose format: both recordings are eye-to-hand, in metres."""
    yield from ('mount = "eye-to-hand"', "[poses]", 'unit = "m"', f'rotation = "{rotation}"')


def sample(name: str, pose: Sequence[float]) -> Iterable[str]:
    """Start of one sample."""
    yield from ("[[sample]]", f'name = "{name}"', f"pose = {list(pose)}")


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
