"""One signature for all named methods, and their list."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from vgrd.calibration.hand_eye.published.motions import Motions, mean_of
from vgrd.calibration.hand_eye.published.robot_world import li, shah
from vgrd.calibration.hand_eye.published.separable import horaud_dornaika, park_martin, tsai_lenz
from vgrd.calibration.hand_eye.published.simultaneous import andreff, daniilidis, gwak, lu_chou, wu
from vgrd.calibration.hand_eye.state import flange_motion_of
from vgrd.calibration.observability import (
    Axes,
    check_distinct,
    check_hand_eye_motion,
    turned_axes,
)
from vgrd.errors import NotObservable
from vgrd.geometry import Pose
from vgrd.model import Mount


@dataclass(frozen=True, slots=True, eq=False)
class PosePair:
    """One look: a flange pose, and the pose of the target in the picture."""

    base_from_wrist: Pose
    camera_from_target: Pose


@dataclass(frozen=True, slots=True, eq=False)
class HandEyePoses:
    """base_from_camera and wrist_from_target (eye-to-hand), or wrist_from_camera and base_from_target."""

    mount_from_camera: Pose
    mount_from_target: Pose


class PublishedMethod(ABC):
    """A published method; all pairs count alike, the order of the pairs does not matter."""

    equation: str

    def solve(self, pairs: Sequence[PosePair], mount: Mount) -> HandEyePoses:
        """Both poses from all pairs.

        Raises TooFewObservations (below 3), InputError (one flange pose twice), NotObservable
        (names the missing motion), DidNotConverge (Gwak).
        """
        _check_motion(pairs)
        flange_motions = [flange_motion_of(mount, pair.base_from_wrist) for pair in pairs]
        return self._solve(flange_motions, [pair.camera_from_target for pair in pairs])

    @abstractmethod
    def _solve(self, flange_motions: Sequence[Pose], cameras: Sequence[Pose]) -> HandEyePoses: ...


class _FromMotions(PublishedMethod):
    equation = "AX = XB"

    def __init__(self, core: Callable[[Motions], Pose]) -> None:
        self._core = core

    def _solve(self, flange_motions: Sequence[Pose], cameras: Sequence[Pose]) -> HandEyePoses:
        X = self._core(Motions.between_all(flange_motions, cameras))
        Y = mean_of([m.inverse() @ X @ c for m, c in zip(flange_motions, cameras, strict=True)])
        return HandEyePoses(X, Y)


class _FromPoses(PublishedMethod):
    equation = "AX = ZB"

    def __init__(self, core: Callable[[Motions], tuple[Pose, Pose]]) -> None:
        self._core = core

    def _solve(self, flange_motions: Sequence[Pose], cameras: Sequence[Pose]) -> HandEyePoses:
        Y, X = self._core(Motions.absolute(flange_motions, cameras))
        return HandEyePoses(X, Y)


METHODS: Mapping[str, PublishedMethod] = MappingProxyType(
    {
        "tsai-lenz": _FromMotions(tsai_lenz),
        "park-martin": _FromMotions(park_martin),
        "horaud-dornaika": _FromMotions(horaud_dornaika),
        "daniilidis": _FromMotions(daniilidis),
        "andreff": _FromMotions(andreff),
        "lu-chou": _FromMotions(lu_chou),
        "wu": _FromMotions(wu),
        "gwak": _FromMotions(gwak),
        "shah": _FromPoses(shah),
        "li": _FromPoses(li),
    }
)


def _check_motion(pairs: Sequence[PosePair]) -> None:
    """Robot and target must both have turned, about two axes."""
    wrists = [pair.base_from_wrist for pair in pairs]
    check_distinct([str(i + 1) for i in range(len(pairs))], wrists)
    check_hand_eye_motion(wrists)
    axes, _ = turned_axes([pair.camera_from_target.rotation for pair in pairs])
    if axes is not Axes.MANY:
        motion = "kept its orientation" if axes is Axes.NONE else "turned about one axis only"
        raise NotObservable(
            f"hand-eye: the target {motion} in the pictures although the wrist turned about two "
            "axes: check that poses and pictures belong together, and record them again",
            rank=6 if axes is Axes.NONE else 11,
            unknowns=12,
        )
