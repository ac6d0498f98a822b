"""Pictures in their order, for the paper's plans: each is judged by itself."""

from collections.abc import Callable

from vgrd.errors import InputError
from vgrd.model import CameraPlace, Instant, Link, LinkReport, SlipEstimate, TagObservation


class StepwiseSeries:
    """Judges each picture alone: a plan in steps does not tell how its errors belong together."""

    def __init__(self, examine: Callable[[TagObservation, CameraPlace], LinkReport]) -> None:
        self._examine = examine

    def see(self, tag_b: TagObservation, camera: CameraPlace, _: Instant) -> LinkReport:
        """As `examine` of the solution."""
        return self._examine(tag_b, camera)

    def resume(self) -> str:
        """Nothing lasts: no earlier picture counts."""
        return ""

    def slip(self, link: Link) -> SlipEstimate:
        """Always InputError."""
        raise InputError(
            f"{link} cannot be taken over: only a calibration of plan joint tells what a slip changes"
        )
