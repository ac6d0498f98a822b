"""All checks of one recording, before it is solved or half-way through it."""

from collections.abc import Iterator, Sequence

import numpy as np

from vgrd.calibration.checks.conventions import misinterpreted_poses
from vgrd.calibration.checks.misinterpreted_points import misinterpreted_points
from vgrd.calibration.checks.motion_gaps import missing_motions
from vgrd.calibration.checks.repeats import moved_object, repeated_poses
from vgrd.calibration.checks.size_and_time import tag_size, time_offset
from vgrd.calibration.hand_eye import hand_eye_samples
from vgrd.calibration.observability import Axes, turned_axes
from vgrd.geometry.rotation_formats import RotationFormat
from vgrd.judging.findings import MISSING, finding
from vgrd.model import Finding, Policy, Recording


def examine(
    recording: Recording,
    policy: Policy = Policy.FIXED,
    *,
    read_as: RotationFormat | None = None,
) -> list[Finding]:
    """What the recording tells against itself; empty for a clean and complete one.

    read_as: the format in which the driver reads orientations, None where that is not known. Works
    on half-recorded sessions, whose missing motions are findings too (`missing_motions`). Raises
    InputError where a touched target is not in CAD or a covariance is no covariance.
    """
    return list(_findings(recording, policy, read_as))


def mistakes(findings: Sequence[Finding]) -> list[Finding]:
    """What is wrong with the samples and refuses them, not only missing: it has to be mended first."""
    return [remark for remark in findings if remark.fatal and remark.code not in MISSING]


def _findings(
    recording: Recording, policy: Policy, read_as: RotationFormat | None
) -> Iterator[Finding]:
    repeated = list(repeated_poses(recording))
    yield from repeated
    late = time_offset(recording)
    mistake = late or misinterpreted_poses(recording, read_as=read_as)
    motion = moved_object(recording)
    if mistake is not None:
        yield mistake
        if mistake.fatal:
            return
    if motion is not None:
        yield motion
    yield from (
        finding(gap.code, gap.sentence, fatal=gap.essential)
        for gap in missing_motions(recording, policy)
    )
    samples = hand_eye_samples(recording)
    axes = turned_axes([s.base_from_wrist.rotation for s in samples] or [np.eye(3)])[0]
    if axes is Axes.MANY:
        size = tag_size(samples, recording)
        if size is not None:
            yield size
    points = None if motion is not None else misinterpreted_points(recording)
    if points is not None:
        yield points
