"""Pictures since activation, one after the other: each against what the earlier ones told, and their sum."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from vgrd.calibration.contradiction import words_of
from vgrd.calibration.joint.picture import Rows
from vgrd.calibration.joint.sequence.belief import (
    TAG_ROWS,
    Belief,
    Innovation,
    Unexplained,
)
from vgrd.calibration.joint.sequence.slips import Named, SlipSums
from vgrd.errors import InputError
from vgrd.geometry import Array, Pose
from vgrd.geometry.chi2 import chi2_quantile
from vgrd.judging.thresholds import CONTRADICTS
from vgrd.model import (
    ArmKnowledge,
    CameraPlace,
    Instant,
    Link,
    LinkReport,
    SlipEstimate,
    TagObservation,
    frozen_array,
)

_SCENE_MM = 0.1  # chosen: the object was moved, beyond the noise of a good tag
_SCENE_RAD = 1e-3  # the same at a radius of 100 mm
_WATCHED = 20  # chosen: pictures, ten seconds at 2 Hz
_TAGS = (Link.TAG_A, Link.TAG_B)  # whose slips pictures add up


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """What one picture tells by itself.

    slips: derivative (r, 6) of the rows by a slip of each link, in its own frame. camera_from_tag_b: as
    the taught camera expects the object where it stands now. taught_from_camera: first guess of the
    camera's displacement, about which the rows are.
    """

    report: LinkReport
    rows: Rows
    slips: Mapping[Link, Array]
    camera_from_tag_b: Pose
    taught_from_camera: Pose


Sight = Callable[[TagObservation, CameraPlace], Sighting]


class JointSeries:
    """Judges pictures in their order.

    Errors that stay are learned, so that they neither alarm nor hide a slip: those of the calibration, of
    the arm at each pose, of the arm's stop, and those of print and light. Where tag A is seen with the arm
    at rest the camera is followed, whatever it does; else it is where it was, as far as it is stable.
    """

    def __init__(
        self, covariance: Array, arm: ArmKnowledge, stability: Array, sight: Sight
    ) -> None:
        self._belief = Belief(covariance, arm, stability)
        self._is_free = bool(np.isinf(stability).all())
        self._sums: list[SlipSums] = []
        self._apart: SlipSums | None = None  # of pictures in a row of which each one contradicts
        self._sight = sight
        self._alarm: Named | None = None
        self._rest_since_s: float | None = None
        self._place: Pose | None = None
        self._last_s = -np.inf
        self._taught_from_camera = Pose.identity()
        self._begun = False
        self._is_blind = False  # an object that may move anyhow contradicts nothing

    def see(self, tag_b: TagObservation, camera: CameraPlace, instant: Instant) -> LinkReport:
        """What a picture says, after all earlier ones.

        Raises TagNotSeen for a camera that may stand anywhere while nothing tells where.
        """
        sighting = self._sight(tag_b, camera)
        self._is_blind = sighting.report.freedom == 0
        if self._is_blind:
            return sighting.report
        self._note(sighting, instant)
        picture = _unexplained(sighting, camera, instant, is_free=self._is_free)
        flange = picture.flange
        is_known = self._begun if flange is None else self._belief.knows(flange)
        innovation = self._belief.compare(picture)
        report = sighting.report
        if is_known:
            report = _judge(report, innovation, picture, self._belief)
        self._begun = True
        self._note_contradiction(report, picture)
        if report.fits:
            self._learn(picture, innovation)
        if self._alarm is None:
            return report
        suspects, sizes = self._alarm
        return replace(report, fits=False, suspects=suspects, slips=sizes, lasting=True)

    def resume(self) -> str:
        """Judge anew after a slip that lasted; why not, in words, while it shows or too few pictures came."""
        told = self._apart or next((sums for sums in self._sums if sums.tells), None)
        if told is not None:
            suspects, sizes = told.named()
            return words_of(LinkReport(False, 0.0, suspects=suspects, slips=sizes))
        count = max((sums.count for sums in self._sums), default=0)
        if count < _WATCHED and not self._is_blind:
            return (
                f"{count} of {_WATCHED} pictures have shown where things are now: let both tags be seen, "
                "and confirm in a moment"
            )
        self._alarm = None
        return ""

    def slip(self, link: Link) -> SlipEstimate:
        """How the link slipped, by the newest pictures; InputError where they do not tell."""
        windows = [self._apart] if self._apart else list(self._sums) if self._alarm else []
        if not windows:
            raise InputError("the pictures show no slip: nothing is to be taken over")
        known = [sums for sums in windows if sums.live_count >= _WATCHED]
        if not known:
            count = max(sums.live_count for sums in windows)
            raise InputError(
                f"{count} of {_WATCHED} pictures with tag A and the arm at rest have come: wait"
            )
        suspects = known[-1].named()[0]
        if link not in suspects:
            raise InputError(f"it may be {' or '.join(suspects)} that slipped, not {link}")
        estimates = [one.estimate() for sums in known for one in sums.sums if one.link is link]
        if not estimates:
            raise InputError(
                f"pictures do not tell how far {link} is off: seat it as it was taught"
            )
        return _agreed(estimates)

    def sums(self) -> list[Array]:
        """Of each link and window, numbers (d,) that are independent of variance 1 while nothing slips."""
        return [of_link.told()[0] for sums in self._sums for of_link in sums.sums]

    def _note_contradiction(self, report: LinkReport, picture: Unexplained) -> None:
        """Add up pictures of which each one contradicts; one that fits ends it."""
        if report.fits:
            self._apart = None
            return
        if picture.flange is not None:
            self._apart = self._apart or SlipSums(self._belief, _TAGS)
            self._apart.add(picture)

    def _learn(self, picture: Unexplained, innovation: Innovation) -> None:
        """Take a picture over.

        Where the sums tell a slip, what was learned since it began is forgotten, and nothing is learned
        until a person has seen to it: it would be taken for an error that stays.
        """
        if not self._sums or self._sums[-1].is_old:
            self._sums = [*self._sums[-1:], SlipSums(self._belief, _TAGS)]
        if self._alarm is None:
            self._belief.learn(innovation)
        for sums in self._sums:
            sums.add(picture)
        told = next((sums for sums in self._sums if sums.tells), None)
        if self._alarm is None and told is not None:
            self._alarm, self._belief = told.named(), told.before
            self._belief.begin_rest()
            self._sums = []

    def _note(self, sighting: Sighting, instant: Instant) -> None:
        """Which errors begin anew with this picture."""
        every = [*self._sums, *([self._apart] if self._apart else [])]
        beliefs = [self._belief, *(of_link.belief for sums in every for of_link in sums.sums)]
        if np.isfinite(self._last_s):
            for belief in beliefs:
                belief.age(instant.stamp_s - self._last_s)
        self._last_s = instant.stamp_s
        for belief in beliefs:
            self._note_camera(belief, sighting.taught_from_camera, instant)
        self._taught_from_camera = sighting.taught_from_camera
        place, is_new_rest = sighting.camera_from_tag_b, False
        if instant.shows_tag_a:
            since_s = instant.rest_since_s
            is_new_rest = since_s is None or since_s != self._rest_since_s
            self._rest_since_s = since_s
        is_new_scene = self._place is None or _is_elsewhere(self._place, place)
        for belief in beliefs:
            if is_new_rest:
                belief.begin_rest()
            if is_new_scene:
                belief.begin_scene()
        self._place = place if is_new_scene else self._place

    def _note_camera(self, belief: Belief, taught_from_camera: Pose, instant: Instant) -> None:
        if instant.shows_tag_a:
            belief.follow_camera()
        else:
            way = self._taught_from_camera @ taught_from_camera.inverse()
            belief.shift_camera(way.log())


def _unexplained(
    sighting: Sighting, camera: CameraPlace, instant: Instant, *, is_free: bool
) -> Unexplained:
    """The part of a picture that no motion explains; is_free: the camera may stand anywhere.

    What earlier pictures and the camera's stability tell of its place stands in the belief, not here.
    """
    rows, count = sighting.rows, TAG_ROWS if instant.shows_tag_a else TAG_ROWS // 2
    free = rows.free(is_exact=not is_free)[:count]
    across = np.linalg.svd(free, full_matrices=True)[0][:, free.shape[1] :].T
    J_scene = np.zeros((len(across), TAG_ROWS))
    J_scene[:, :count] = across
    J_camera = across @ rows.J_camera[:count]
    slips: dict[Link, Array] = {
        link: across @ J[:count]
        for link, J in sighting.slips.items()
        if link in (Link.TAG_B, Link.OBJECT) or (link is Link.TAG_A and instant.shows_tag_a)
    }
    seen = camera.flange_tag if instant.shows_tag_a else None
    return Unexplained(
        residual=across @ rows.residual[:count],
        J=across @ rows.J_known[:count],
        J_scene=J_scene,
        J_camera=J_camera,
        J_slips=slips if instant.shows_tag_a else {**slips, Link.CAMERA: J_camera},
        flange=None if seen is None else seen.base_from_wrist.translation,
    )


def _judge(
    report: LinkReport, innovation: Innovation, picture: Unexplained, belief: Belief
) -> LinkReport:
    """A picture's report by what the earlier ones told.

    By itself it must fit too: what is learned may not grow beyond what the calibration allows.
    """
    is_expected = innovation.square <= chi2_quantile(CONTRADICTS, len(innovation.value))
    if is_expected and report.misfit <= chi2_quantile(CONTRADICTS, report.freedom):
        return replace(report, fits=True, suspects=(), slips=MappingProxyType({}))
    if not report.fits and picture.flange is not None:
        return report
    links = [link for link in picture.J_slips if link is not Link.OBJECT]
    sums = SlipSums(belief, links)
    sums.add(picture)
    suspects, sizes = sums.named()
    return replace(report, fits=False, suspects=suspects, slips=sizes)


def _agreed(estimates: Sequence[SlipEstimate]) -> SlipEstimate:
    """The newest; what the others say differently is not known."""
    newest = estimates[-1]
    spread = newest.covariance
    for other in estimates[:-1]:
        way = newest.tangent - other.tangent
        spread = spread + np.outer(way, way)
    return replace(newest, covariance=frozen_array(spread, 6, 6))


def _is_elsewhere(old: Pose, new: Pose) -> bool:
    mm, rad = old.distance(new)
    return mm > _SCENE_MM or rad > _SCENE_RAD
