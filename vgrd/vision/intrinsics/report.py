"""What a calibration of a camera tells its user: figures, what to do better, and the files."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from vgrd.model import Finding
from vgrd.vision.images.drawing import write_picture
from vgrd.vision.intrinsics.camera_files import camera_json, write_camera
from vgrd.vision.intrinsics.estimate import IntrinsicsResult
from vgrd.vision.intrinsics.pictures import coverage, draw_coverage

_FEW_PICTURES = 10  # a guess: half of the 20 that are good
_TILTED_DEG = 15.0  # a guess: a little below the 20 to 40 degrees that are asked for
_LEAST_TILTED = 4  # one in each direction: left, right, up, down
_HELD_OUT_RATIO = 1.5  # a guess: it is about 1 where one picture more tells little anew
_EMPTY_SHARE = 0.2  # the four corners, of 24 cells, may be empty


def report_json(result: IntrinsicsResult, unusable: Mapping[str, str]) -> dict[str, object]:
    """As `vgrd intrinsics --json` writes it; unusable: why, by name of the picture."""
    return {
        **camera_json(result.camera),
        "sigma": result.sigmas,
        "covariance": result.covariance.tolist(),
        "rms_px": result.rms_px,
        "held_out_px": result.held_out_px,
        "noise": asdict(result.bundle.noise),
        "pictures": [
            *(asdict(report) for report in result.reports),
            *({"name": name, "used": False, "reason": why} for name, why in unusable.items()),
        ],
        "findings": [{"code": f.code, "message": f.message} for f in improvements(result)],
    }


def improvements(result: IntrinsicsResult) -> list[Finding]:
    """What the operator could do better, most important first."""
    inliers = [report for report in result.reports if report.used]
    tilted = sum((report.tilt_deg or 0) > _TILTED_DEG for report in inliers)
    empty = float(np.mean(coverage(result.views, result.camera.size_px) == 0))
    findings = []
    if tilted < _LEAST_TILTED:
        findings.append(
            Finding(
                "frontal",
                f"only {tilted} pictures show the board tilted by more than 15 degrees: tilt it",
            )
        )
    if len(inliers) < _FEW_PICTURES:
        findings.append(Finding("few_pictures", f"{len(inliers)} pictures used: 20 are good"))
    if empty > _EMPTY_SHARE:
        findings.append(
            Finding(
                "coverage", f"{empty:.0%} of the picture never saw the board: see coverage.png"
            )
        )
    if result.held_out_px > _HELD_OUT_RATIO * result.rms_px:
        findings.append(
            Finding(
                "held_out",
                f"pictures left out are off by {result.held_out_px:.3g} px, those of the fit by "
                f"{result.rms_px:.3g}: take more pictures",
            )
        )
    return findings


def write_report(folder: Path, result: IntrinsicsResult) -> list[str]:
    """Write the camera in every format, and the coverage as a picture; returns the files."""
    write_camera(folder / "camera.yaml", result.camera, "opencv")
    write_camera(folder / "camera_info.yaml", result.camera, "ros")
    write_camera(folder / "camera.toml", result.camera, "toml")
    write_picture(folder / "coverage.png", draw_coverage(result))
    names = ("camera.yaml", "camera_info.yaml", "camera.toml", "coverage.png")
    return [str(folder / name) for name in names]
