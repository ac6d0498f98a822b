"""What a cell file does not tell of a cell, taken on the careful side until somebody measures it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from vgrd.calibration.first_samples import wanted
from vgrd.errors import InputError
from vgrd.model import CellFacts, Motion, Plan, Stability

_TILTED_ALONE = 4  # a guess: where no turned touch can tell the tip, advice asks for tilted ones
_STEEPEST_DEG = 70.0  # a flatter tag is not found


@dataclass(frozen=True, slots=True)
class Assumptions:
    """Of the scene and of teaching; every figure is a guess, on the careful side, and an option of `vgrd expect`.

    distance_mm: camera to the middle of the object; tag_tilt_deg: between a tag's normal and the line of sight;
    tag_b_mm: from tag B to the axis of turning, None: as far as the outermost target; radius_mm: of the circle of
    targets that have no point_mm; tool_mm: flange to tip; corner_px: of a tag's corner, 1 sigma per axis; arm_mm:
    as `robot.sigma_mm`, None takes that. turned of the touches are taken with the object half round, tilted with
    the wrist leaning. focal_percent, center_px, drift_mm: as of `vgrd budget`.
    four_axes: the wrist turns about the vertical only, in looks and in tilted touches.
    """

    looks: int
    spins: int
    touches: int
    turned: int = 3  # as many tell the centre to 0.1 mm (docs/noise.md)
    tilted: int = 2  # about two axes: fewer leave the tip open
    distance_mm: float = 700.0  # a guess: above a bench, out of the arm's way
    tag_tilt_deg: float = 30.0  # a guess: seen past the arm, and steep enough for one pose
    tag_b_mm: float | None = None
    radius_mm: float = 80.0  # a guess: the paper's sample changer
    tool_mm: float = 150.0  # a guess: a gripper with a pin
    corner_px: float = 0.05  # the upper end of what real prints showed (docs/tag-measuring.md)
    arm_mm: float | None = None
    focal_percent: float = 0.03  # as `Systematic.of`
    center_px: float = 0.5  # as `Systematic.of`
    drift_mm: float = 0.02  # as `Systematic.of`
    four_axes: bool = False

    @classmethod
    def of(cls, facts: CellFacts, given: Mapping[str, Any]) -> "Assumptions":
        """As many samples as teaching asks for, and what is given instead by name."""
        counts = wanted(Plan.JOINT, facts)
        is_free = facts.object.motion is Motion.FREE
        shows_turns = not is_free and facts.camera_stability is Stability.FIXED
        most = cls(
            looks=counts.get("look", 0),
            spins=0 if is_free else counts["spin"],
            touches=counts["touch"],
        )
        if not shows_turns:
            most = replace(most, turned=0, tilted=_TILTED_ALONE)
        few = given.get("touches", most.touches)
        if few < most.touches:  # fewer of each kind, as long as nobody says which
            share = few / most.touches
            most = replace(most, turned=int(most.turned * share), tilted=int(most.tilted * share))
        elif "touches" not in given:
            least = len(facts.object.bare) + most.turned + most.tilted
            most = replace(most, touches=max(most.touches, least))
        return replace(most, **given)

    def check(self, facts: CellFacts) -> None:
        """Raise InputError for a scene that cannot be."""
        for name in ("distance_mm", "radius_mm", "tool_mm", "corner_px", "arm_mm"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise InputError(f"{_option(name)} {value}: give a number above 0")
        if not 0 <= self.tag_tilt_deg <= _STEEPEST_DEG:
            raise InputError(
                f"--tag-tilt-deg {self.tag_tilt_deg}: a tag is found up to {_STEEPEST_DEG:.0f} degrees; "
                "give 10 to 60"
            )
        if self.turned + self.tilted > self.touches:
            raise InputError(
                f"--turned {self.turned} and --tilted {self.tilted} are more than --touches "
                f"{self.touches}: they are some of the touches"
            )
        bare = facts.object.bare
        straight = self.touches - self.turned - self.tilted
        if len(bare) > straight:
            raise InputError(
                f"--touches {self.touches}: {len(bare)} targets have no point_mm and each must be touched "
                f"as it works; give {len(bare) + self.turned + self.tilted} touches or more"
            )
        if self.turned and facts.object.motion is Motion.FREE:
            raise InputError("--turned: an object that moves freely has no half round; give 0")
        if self.turned and facts.camera_stability is Stability.MOVABLE:
            raise InputError(
                "--turned: only a camera that stands still shows how far the object was turned; give 0"
            )
        if self.spins and facts.object.motion is Motion.FREE:
            raise InputError("--spins: an object that moves freely has no axis; give 0")


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")
