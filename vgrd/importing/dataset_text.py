"""The text of a DATASET.toml, with what was assumed as comments at its head."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vgrd.model import Mount


@dataclass(frozen=True, slots=True)
class DatasetParts:
    """What a dataset holds; poses: unit, format and numbers; seen: key and value of each sample."""

    mount: Mount
    poses: tuple[str, str, Sequence[Sequence[float]]]
    camera_poses: tuple[str, str] | None
    camera_unit: str | None
    camera: str | None
    camera_name: str | None
    camera_size: Sequence[int] | None
    target: Mapping[str, object] | None
    names: Sequence[str]
    seen: Sequence[tuple[str, object]]


def dataset_text(parts: DatasetParts, assumed: Sequence[str]) -> str:
    """The file as a whole."""
    unit, rotation, poses = parts.poses
    lines = [
        "# Written by vgrd import. It took the files for what they seem to be:",
        *(f"# - {' '.join(sentence.split())}" for sentence in assumed),
        f'mount = "{parts.mount}"',
    ]
    if parts.camera is not None:
        lines += ["[camera]", f"file = {_text(parts.camera)}"]
        lines += [f"name = {_text(parts.camera_name)}"] if parts.camera_name else []
        lines += [f"size_px = {list(parts.camera_size)}"] if parts.camera_size else []
    lines += ["[poses]", f'unit = "{unit}"', f'rotation = "{rotation}"']
    if parts.camera_poses is not None:
        lines += ["[camera_poses]", f'unit = "{parts.camera_poses[0]}"']
        lines += [f'rotation = "{parts.camera_poses[1]}"']
    elif parts.camera_unit is not None:
        lines += ["[camera_poses]", f'unit = "{parts.camera_unit}"']
    if parts.target is not None:
        lines += ["[target]", *(f"{key} = {_value(v)}" for key, v in parts.target.items())]
    for name, pose, (key, value) in zip(parts.names, poses, parts.seen, strict=True):
        lines += ["[[sample]]", f"name = {_text(name)}", f"pose = {list(pose)}"]
        lines.append(f"{key} = {_value(value)}")
    return "\n".join([*lines, ""])


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return _text(value) if isinstance(value, str) else str(value)


def _text(text: str) -> str:
    """A string of TOML: JSON's escapes are its own."""
    return json.dumps(text, ensure_ascii=True)
