"""Where arm, camera, tags and targets stand now in the robot's base, for a drawing: no answer depends on it."""

from collections.abc import Mapping
from typing import Any

from vgrd.calibration.joint import JointSolution
from vgrd.calibration.scenery import scenery
from vgrd.cell.control.lines import Arguments
from vgrd.cell.control.server import Operation
from vgrd.cell.measuring import Measuring
from vgrd.cell.recording.wizard import Wizard
from vgrd.cell.serving.service import Serving
from vgrd.geometry import Pose


class Scene:
    """Operation `scene`: by the estimate of the open session, else by the calibration in use."""

    def __init__(self, measuring: Measuring, serving: Serving, wizard: Wizard) -> None:
        self._measuring, self._serving, self._wizard = measuring, serving, wizard

    def table(self) -> Mapping[str, Operation]:
        """Operations by name."""
        return {"scene": Operation(self._tell)}

    async def _tell(self, _: Arguments) -> Mapping[str, Any]:
        known, places = self._known()
        reading, sight = self._measuring.reading(), self._measuring.sight
        flange = None if reading is None else reading.base_from_wrist
        facts = self._measuring.facts
        told: dict[str, Any] = {"known": known, "flange": _rows(flange), "tip_in_wrist": None}
        if known:
            camera = Pose.from_matrix(places["base_from_camera"])
            tag_a = None if sight is None else sight.tag_a
            tag_b = self._tag_b()
            object_from_tag_b = places.get("object_from_tag_b")
            told |= {
                "camera": _rows(camera),
                "tag_a": None if tag_a is None else _rows(camera @ tag_a.camera_from_tag),
                "tag_b": None if tag_b is None else _rows(camera @ tag_b),
                "axis": places.get("base_from_axis"),
                "tip_in_wrist": places.get("tip_in_wrist"),
                "targets": {},
            }
            if tag_b is not None and object_from_tag_b is not None:
                base_from_object = camera @ tag_b @ Pose.from_matrix(object_from_tag_b).inverse()
                told["targets"] = {
                    name: (base_from_object @ target.cad).tolist()
                    for name, target in facts.object.targets.items()
                    if target.point_in_object is not None
                }
        sizes = {"a": facts.tag_a, "b": facts.tag_b}
        told["tag_mm"] = {name: tag.size_mm for name, tag in sizes.items() if tag is not None}
        return told

    def _tag_b(self) -> Pose | None:
        """Where the newest whole picture that shows it has it, camera_from_tag_b."""
        sight = self._measuring.sight_of_object
        if sight is None or sight.tag_b is None:
            return None
        return sight.tag_b.camera_from_tag

    def _known(self) -> tuple[str, Mapping[str, Any]]:
        """What tells it: "session", "calibration" or "", and the places."""
        if self._wizard.scenery:
            return "session", self._wizard.scenery
        calibration = self._serving.calibration
        if calibration is None:
            return "", {}
        solution = calibration.solution
        places = scenery(solution) if isinstance(solution, JointSolution) else None
        if places is not None:
            return "calibration", places
        return "calibration", {"base_from_camera": _rows(calibration.base_from_camera)}


def _rows(pose: Pose | None) -> list[list[float]] | None:
    return None if pose is None else pose.matrix().tolist()
