"""First values of what pictures tell: hand-eye, tag B while touching, and where the camera stood."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgrd.calibration.hand_eye import park_martin_start
from vgrd.calibration.joint.problem import EvidenceKind, JointData, Looks, Tags
from vgrd.calibration.joint.start.touches import linear_start
from vgrd.calibration.joint.state import Columns
from vgrd.calibration.observability import Axes, turned_axes
from vgrd.errors import TooFewObservations
from vgrd.geometry import Pose, nearest_rotation

_REFERENCE = -1  # as `CameraPlaces.of`


def guess_reference(tags: Tags) -> Pose:
    """camera_from_tag_b while the targets were touched; raises TooFewObservations."""
    if not len(tags):
        raise TooFewObservations(
            "tag B was not seen in any touch, so there is no reference picture: "
            "touch with tag B in view"
        )
    R = nearest_rotation(tags.rotations.sum(axis=0), tolerance=np.inf)
    return Pose(R, np.median(tags.translations, axis=0))


def guess_hand_eye(looks: Looks) -> tuple[Pose, Pose]:
    """base_from_camera and wrist_from_tag_a; raises TooFewObservations."""
    rounded = np.round(np.column_stack([looks.translations, 1e3 * looks.rotations[:, 0]]), 1)
    distinct = np.unique(rounded, axis=0, return_index=True)[1]
    if len(distinct) < 3:
        raise TooFewObservations(
            f"tag A was seen from {len(distinct)} robot poses, at least 3 are needed: record looks, "
            "or touch with tag A in view"
        )
    looks = looks.subset(distinct)
    object_motions, tags = looks.poses(), looks.tags.poses()
    if turned_axes(list(looks.rotations))[0] is Axes.MANY:
        return park_martin_start(object_motions, tags)
    X, tag_in_wrist = linear_start(looks.rotations, looks.translations, looks.tags.translations)
    rotation_sum = sum(
        R.T @ X.rotation @ tag.rotation for R, tag in zip(looks.rotations, tags, strict=True)
    )
    return X, Pose(nearest_rotation(rotation_sum, tolerance=np.inf), tag_in_wrist)


def guess_places(data: JointData) -> tuple[Pose, Pose, tuple[Pose, ...]]:
    """base_from_camera, wrist_from_tag_a, and how the camera was displaced in the other places.

    While it is touched the object stands still, so that tag B is a camera that does not move: what it
    sees of tag A is the hand-eye problem. Where too few touches show both tags, the place is taken from
    which tag A was seen most.
    """
    looks, places = data.looks, data.places.of(data.stamps_s[EvidenceKind.HAND_EYE])
    base_from_tag_b = None
    by_tag_b, seen = _seen_by_tag_b(data)
    try:
        base_from_tag_b, wrist_from_tag_a = guess_hand_eye(
            replace(looks.subset(seen), tags=by_tag_b)
        )
    except TooFewObservations:
        most = np.bincount(places + 1).argmax() - 1
        wrist_from_tag_a = guess_hand_eye(looks.subset(np.flatnonzero(places == most)))[1]
    chains = [
        wrist @ wrist_from_tag_a @ tag.inverse()
        for wrist, tag in zip(looks.poses(), looks.tags.poses(), strict=True)
    ]
    touched = data.places.of(data.stamps_s[EvidenceKind.REFERENCE])
    still = list(zip(touched, data.reference.poses(), strict=True))
    cameras = {
        int(place): _middle([c for c, p in zip(chains, places, strict=True) if p == place])
        for place in np.unique(places)
    }
    if base_from_tag_b is None:
        in_base = [cameras[place] @ tag for place, tag in still if place in cameras]
        base_from_tag_b = _middle(in_base) if in_base else None
    if base_from_tag_b is not None:
        for place, tag in still:
            cameras.setdefault(int(place), base_from_tag_b @ tag.inverse())
    camera = cameras[_REFERENCE]
    return (
        camera,
        wrist_from_tag_a,
        tuple(
            camera.inverse() @ cameras.get(place, camera) for place in range(data.places.displaced)
        ),
    )


def _seen_by_tag_b(data: JointData) -> tuple[Tags, Columns]:
    """Tag A from tag B in the touches that show both, and which of the looks these are."""
    of_b = {name: i for i, name in enumerate(data.names[EvidenceKind.REFERENCE])}
    seen = [i for i, name in enumerate(data.names[EvidenceKind.HAND_EYE]) if name in of_b]
    names = data.names[EvidenceKind.HAND_EYE]
    tags_a, tags_b = data.looks.tags.poses(), data.reference.poses()
    poses = [tags_b[of_b[names[i]]].inverse() @ tags_a[i] for i in seen]
    return _tags_at(poses), np.array(seen, dtype=np.intp)


def as_taught(data: JointData, taught_from_camera: Sequence[Pose]) -> JointData:
    """Tag B as the camera in the reference would have seen it; its noise is left as it was."""
    displacements = [*taught_from_camera, Pose.identity()]

    def moved(tags: Tags, kind: EvidenceKind) -> Tags:
        poses = zip(data.places.of(data.stamps_s[kind]), tags.poses(), strict=True)
        return _tags_at([displacements[place] @ pose for place, pose in poses])

    return replace(
        data,
        reference=moved(data.reference, EvidenceKind.REFERENCE),
        spins=moved(data.spins, EvidenceKind.SPINS),
    )


def _tags_at(poses: Sequence[Pose]) -> Tags:
    """Tags (n) of which only the poses count."""
    R = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
    t = np.array([pose.translation for pose in poses]).reshape(-1, 3)
    return Tags(R, t, np.broadcast_to(np.eye(6), (len(R), 6, 6)))


def _middle(poses: Sequence[Pose]) -> Pose:
    R = nearest_rotation(np.sum([pose.rotation for pose in poses], axis=0), tolerance=np.inf)
    return Pose(R, np.median([pose.translation for pose in poses], axis=0))
