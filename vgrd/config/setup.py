"""From the checked cell file to the values that the layers below work with."""

import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vgrd.config.resolved import Resolved
from vgrd.geometry import Array, Pose, exp_rotation
from vgrd.model import (
    Bounds,
    CellBounds,
    CellFacts,
    Motion,
    Mount,
    ObjectSpec,
    Stability,
    TagSpec,
    Target,
    Tool,
    frozen_array,
)

if TYPE_CHECKING:  # at run time the sections are those of `vgrd.config.resolved`
    from vgrd.config.cell_file import CellConfig, TagSection
    from vgrd.config.limits_section import LimitsSection

_LIMIT_KEYS: Mapping[str, tuple[str, Callable[[Any], object]]] = {  # of the file: name, conversion
    "lowest_mm": ("lowest", lambda corner: frozen_array(corner, 3)),
    "highest_mm": ("highest", lambda corner: frozen_array(corner, 3)),
    "inner_radius_mm": ("inner_radius_mm", float),
    "outer_radius_mm": ("outer_radius_mm", float),
    "volume_margin_mm": ("margin_mm", float),
    "cone_deg": ("cone_rad", math.radians),
    "step_mm": ("step_mm", float),
    "step_deg": ("step_rad", math.radians),
}
CONTROL_SOCKET = "control.sock"
SOCKET_FOLDER_BYTES = 90  # of the 108 of sun_path (unix(7)); "/control.sock" and NUL need 14
# What earlier versions left open to all, and what tells that a folder is the daemon's.
RUNTIME_PARTS = ("health", "processes.json", "gate.lock")
STATE_PARTS = ("sessions", "calibrations")
# The processes share the cores among themselves; libraries that start a thread per core fight over them.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
DEVICE_HANG_S = 5.0  # longer than a picture may take (2 s), or a slow camera would be killed
METRICS_HANG_S = 5.0  # its loop turns each 0.1 s
PAGE_HANG_S = 20.0  # idem; its libraries load for some seconds on a busy machine
CELL_HANG_S = 5.0  # its loop tells every 20 ms: only one that is stuck is silent so long


def cell_facts(config: "CellConfig", wrist_from_tcp: Pose | None = None) -> CellFacts:
    """What a calibration must know about the cell; `wrist_from_tcp` is what the pendant says."""
    fx, fy, cx, cy = config.camera.matrix
    width, height = config.camera.size_px
    return CellFacts(
        mount=Mount(config.camera.mount),
        camera_matrix=frozen_array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], 3, 3),
        distortion=frozen_array(config.camera.distortion, len(config.camera.distortion)),
        image_size_px=(width, height),
        tag_a=_tag(config.tags.a),
        tag_b=_tag(config.tags.b),
        tool=_tool(config),
        object=_object(config),
        robot_sigma_mm=config.robot.sigma_mm,
        robot_id=config.robot.id,
        camera_id=config.camera.id,
        wrist_from_tcp=wrist_from_tcp,
        camera_stability=Stability(config.camera.stability),
        tag_a_sigma_mm=config.tags.a.size_sigma_mm,
        tag_b_sigma_mm=config.tags.b.size_sigma_mm,
    )


def camera_stability(config: "CellConfig") -> Array:
    """(6,) sigmas (mm, rad) of the camera's displacement since teaching, infinite where people move it."""
    camera = config.camera
    if camera.stability == "movable":
        return frozen_array(np.full(6, np.inf), 6)
    sigmas = [camera.stability_mm] * 3 + [1e-3 * camera.stability_mrad] * 3
    return frozen_array(sigmas, 6)


def cell_bounds(config: "CellConfig") -> CellBounds:
    """Where answers may send the arm: the keys of a target, then those of the cell, then the defaults."""
    targets = {
        target.name: _bounds(target.limits, config.limits)
        for target in config.object.targets
        if any(getattr(target.limits, key) is not None for key in _LIMIT_KEYS)
    }
    return CellBounds(_bounds(config.limits), targets)


def _bounds(*sections: "LimitsSection") -> Bounds:
    """The first section that has a key counts."""
    given: dict[str, Any] = {}
    for key, (name, convert) in _LIMIT_KEYS.items():
        value = next((v for s in sections if (v := getattr(s, key)) is not None), None)
        if value is not None:
            given[name] = convert(value)
    return Bounds(**given)


def _tag(section: "TagSection") -> TagSpec:
    return TagSpec(section.family, section.id, section.size_mm)


def _tool(config: "CellConfig") -> Tool:
    axis = np.array(config.tool.axis)
    return Tool(
        name=config.tool.name,
        axis_in_wrist=frozen_array(axis / np.linalg.norm(axis), 3),
        work_from_touch_mm=frozen_array(config.tool.work_offset_mm, 3),
    )


def _object(config: "CellConfig") -> ObjectSpec:
    section = config.object
    targets = {
        target.name: Target(
            id=target.id,
            name=target.name,
            point_in_object=None if target.point_mm is None else frozen_array(target.point_mm, 3),
            base_from_work=None
            if target.work_rotvec_deg is None
            else frozen_array(exp_rotation(np.radians(target.work_rotvec_deg)), 3, 3),
            hole_diameter_mm=target.hole_diameter_mm,
            clearance_mm=target.clearance_mm,
        )
        for target in section.targets
    }
    center = None if section.center_mm is None else frozen_array(section.center_mm, 3)
    return ObjectSpec(
        targets,
        Motion(section.motion),
        center,
        section.hole_sigma_mm,
        section.center_sigma_mm,
        section.cad_sigma_mm,
    )


def process_table(resolved: Resolved, path: Path) -> dict[str, object]:
    """The table that the gate supervises: one entry per process, as data.

    path: of the resolved file; its name tells the content, so a changed cell file changes the row.
    """
    config = resolved.config
    runtime = config.cell.runtime_dir
    width, height = config.camera.size_px
    picture_bytes = width * height * config.camera.bits // 8

    def device(kind: str, driver: str, settings: dict[str, object], size: int) -> object:
        module = [sys.executable, "-m", "vgrd.devices.host"]
        arguments = [kind, runtime, driver, json.dumps(settings), str(size)]
        return {
            "name": kind,
            "kind": "device",
            "argv": module + arguments,
            "env": ONE_THREAD,
            "hang_s": DEVICE_HANG_S,
        }

    camera = device("camera", config.camera.driver, config.camera.settings, picture_bytes)
    pedal = config.pedal
    pedals = [device("pedal", pedal.driver, pedal.settings, 0)] if pedal.driver else []
    return {
        "cell": config.cell.name,
        "loaded_unix_s": resolved.loaded_unix_s,
        "deadline_s": config.serving.deadline_s,
        "timeout_s": config.serving.timeout_s,
        "int16_scale": config.serving.int16_scale,
        "modbus": {
            "host": config.serving.host,
            "port": config.serving.port,
            "line_port": config.serving.line_port,
            "allow": list(config.serving.allow),
        },
        "processes": [
            device("robot", config.robot.driver, config.robot.settings, 0),
            camera,
            *pedals,
            {
                "name": "cell",
                "kind": "cell",
                "argv": [sys.executable, "-m", "vgrd.cell", str(path)],
                "env": ONE_THREAD,
                "hang_s": CELL_HANG_S,
            },
            *_telling(config),
        ],
    }


def _telling(config: "CellConfig") -> Iterator[object]:
    """The processes that tell Prometheus and people, where a port is named for them."""
    page = config.page
    terms = {key: getattr(page, key) for key in ("names", "certificate", "key", "password_file")}
    for name, section, hang_s, more in (
        ("metrics", config.metrics, METRICS_HANG_S, []),
        ("page", page, PAGE_HANG_S, [json.dumps(terms)]),
    ):
        if section.port is not None:
            told = [config.cell.runtime_dir, section.host, str(section.port), *more]
            yield {
                "name": name,
                "kind": name,
                "argv": [sys.executable, "-m", f"vgrd.{name}", *told],
                "env": ONE_THREAD,
                "hang_s": hang_s,
            }
