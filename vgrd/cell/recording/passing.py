"""Which pictures are kept that no sample can be of: the arm moved, or no tag was seen.

Tags of a moving arm tell the time between poses and pictures, and take 3 kB. A picture without tags
tells why none was seen, and takes 5 MB: few of them are kept.
"""

from vgrd.cell.measuring import Sight
from vgrd.geometry import Pose
from vgrd.model import MovingSight

_PERIOD_S = 0.3  # pictures come twice a second; a faster camera tells little more
_MOST = 4000  # 12 MB, half an hour of an arm that never rests
_UNSEEN_PERIOD_S = 10.0  # a hand before a tag is seen by one picture
_MOST_UNSEEN = 40  # 200 MB of 12 megapixels
_SAME_MM, _SAME_RAD = 0.1, 2e-4  # as of a rest (`RestPlace`)


class PassingSights:
    """Counts what was kept of one session."""

    def __init__(self) -> None:
        self._count = self._unseen = 0
        self._last_s = self._last_unseen_s = float("-inf")
        self._last_pose: Pose | None = None

    def kept(self, sight: Sight) -> MovingSight | None:
        """What to keep of a picture; None: nothing. Without tags, the picture is to be kept too."""
        pose = sight.passing or sight.base_from_wrist
        if pose is None:
            return None
        is_seen = sight.tag_a is not None or sight.tag_b is not None
        is_wanted = self._is_seen_wanted(sight) if is_seen else self._is_unseen_wanted(sight, pose)
        if not is_wanted:
            return None
        return MovingSight(pose, sight.stamp_s, sight.tag_a, sight.tag_b, sight.delay_s)

    def _is_seen_wanted(self, sight: Sight) -> bool:
        if self._count >= _MOST or sight.stamp_s - self._last_s < _PERIOD_S:
            return False
        self._count, self._last_s = self._count + 1, sight.stamp_s
        return True

    def _is_unseen_wanted(self, sight: Sight, pose: Pose) -> bool:
        is_early = sight.stamp_s - self._last_unseen_s < _UNSEEN_PERIOD_S
        if self._unseen >= _MOST_UNSEEN or is_early or self._is_same_place(pose):
            return False
        self._unseen, self._last_unseen_s, self._last_pose = self._unseen + 1, sight.stamp_s, pose
        return True

    def _is_same_place(self, pose: Pose) -> bool:
        """Whether the arm still stands where it was pictured without tags."""
        if self._last_pose is None:
            return False
        mm, rad = self._last_pose.distance(pose)
        return mm <= _SAME_MM and rad <= _SAME_RAD
