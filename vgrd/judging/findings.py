"""Every finding: its code, what it means, and what to do; docs/checks.md is written from this."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from vgrd.model import Finding


class Kind(NamedTuple):
    """A kind of finding. remedy: "" where the sentence of each finding says it; basis: what tells it."""

    meaning: str
    remedy: str
    basis: str


BEFORE_SOLVING: Mapping[str, Kind] = MappingProxyType(
    {
        "hand_eye_motion": Kind("the wrist turned too little for the hand-eye", "", "rank"),
        "wrist_tilt": Kind("the wrist turned too little for the TCP", "", "rank"),
        "targets_in_line": Kind("all touched points lie on one line", "", "rank"),
        "few_touches": Kind("too few touches", "", "count"),
        "target_untouched": Kind(
            "a target without CAD was not touched; a request for it is refused (102)", "", "count"
        ),
        "fixed_point_motion": Kind("the fixed point was touched with one wrist", "", "rank"),
        "surface_motion": Kind(
            "the plane or ball was touched too alike or too little", "", "rank"
        ),
        "object_turn": Kind("the object turned too little for a rotation centre", "", "rank"),
        "rotation_misread": Kind(
            "the numbers of a rotation are those of another format",
            "correct that and record again",
            "robot and tag A agree under that reading, and under no other",
        ),
        "unit_misread": Kind(
            "lengths have another unit than stated",
            "correct the unit of the robot's poses",
            "scale of the robot's positions against tag A",
        ),
        "poses_inverted": Kind(
            "poses are inverted (base seen from the flange)",
            "correct that and record again",
            "tag A; tag B stands still while the wrist moves",
        ),
        "mount_wrong": Kind(
            "the camera is mounted elsewhere than stated",
            "correct that and record again",
            "tag A; tag B moves in the picture while the wrist moves",
        ),
        "poses_inverted_or_mount": Kind(
            "poses are inverted, or the camera is mounted elsewhere",
            "correct that and record again",
            "tag A; tag B was seen too little to tell which",
        ),
        "poses_contradict": Kind(
            "robot and pictures of tag A agree under no reading",
            "check that poses and pictures belong together and that tag A and camera are tight",
            "the same",
        ),
        "points_mirrored": Kind(
            "the CAD points are a mirror image",
            "correct them",
            "fit of the touches",
        ),
        "targets_swapped": Kind(
            "two targets have each other's name",
            "correct the names (in a session: vgrd retag SAMPLE TARGET), or undo these touches and take them again",
            "fit of the touches",
        ),
        "points_order": Kind(
            "the list of targets is in another order",
            "correct the list, or the names of the touches",
            "fit of the touches",
        ),
        "tag_size": Kind(
            "tag A has another size than the cell file says",
            "measure its black square with a caliper; if the file is right, check the camera's focal "
            "length and the robot's unit",
            "hand-eye with a scale factor: 4 sigma and 0.4 %",
        ),
        "time_offset": Kind(
            "pictures are later or earlier than their poses",
            "take looks at rest, or correct the camera's delay",
            "looks on the move, at least six, at most 0.35 s apart",
        ),
        "pose_not_read_again": Kind(
            "the picture changed and the robot's pose did not",
            "check the connection to the robot and undo them",
            "equality to the last digit",
        ),
        "pose_repeated": Kind(
            "a pose was recorded twice",
            "move the robot between samples, or undo one of them",
            "equality to the last digit",
        ),
        "object_moved": Kind(
            "the object stood elsewhere in some touch",
            "hold it still while touching, undo those touches and touch again",
            "scatter of tag B",
        ),
    }
)

OF_A_SESSION: Mapping[str, Kind] = MappingProxyType(
    {
        "flange_not_proven": Kind(
            "no sample can tell the flange from an active TCP",
            "set TCP and user frame on the pendant to zero, or compare with the pendant's flange pose",
            "the robot does not tell its TCP",
        ),
        "look_outlier": Kind(
            "a look was left out", "look again there", "leaving it out: 4.5 sigma"
        ),
        "touch_outlier": Kind(
            "a touch was left out",
            "undo it (vgrd undo SAMPLE) and touch that target again",
            "leaving it out: 3.5 sigma",
        ),
        "names_unproven": Kind(
            "touches by foot have the names of the order in which they came; one press too many or too few "
            "shifts them all",
            "vgrd verify NAME at the target that was touched last by foot",
            "no verification of that target in the session",
        ),
        "target_contradicted": Kind(
            "the touches of a target without CAD contradict each other and none is borne out",
            "",
            "as many of them left out as kept",
        ),
        "point_outlier": Kind(
            "a touch of the fixed point, plane or ball does not belong to the others",
            "undo it and touch there again",
            "leaving it out: 3.5 sigma",
        ),
        "reference_outlier": Kind(
            "tag B stood elsewhere in a touch",
            "hold the object still while touching",
            "leaving it out: 4.5 sigma",
        ),
        "spin_outlier": Kind(
            "a spin was left out",
            "the object slipped or the picture was bad: spin again",
            "leaving it out: 4.5 sigma",
        ),
        "hole_outlier": Kind(
            "a hole was left out",
            "check its CAD point and hole_diameter_mm",
            "leaving it out: 4.5 sigma",
        ),
        "sample_outlier": Kind(
            "a sample contradicts the others",
            "undo it (vgrd undo SAMPLE) and take it again",
            "leaving it out",
        ),
        "camera_moved": Kind(
            "a fixed camera moved while it was taught; it is followed",
            "it was followed by tag A, and the answers hold; fasten it",
            "pictures before against after, tag A seen in both: 1 in 1,000 good sessions",
        ),
        "center_off": Kind(
            "the centre in CAD is not where the object turns; what was measured counts instead",
            "",
            "spins, touches and holes against the centre: 1 in 1,000 good sessions",
        ),
        "cad_off": Kind(
            "a target is not where CAD says; what was measured counts instead",
            "",
            "its touches and holes against all others: 1 in 50,000 good targets",
        ),
        "tag_stretched": Kind(
            "a tag is printed wider or higher than stated; what was measured counts instead",
            "print it again, not scaled to the page",
            "its pictures against the robot's motion: 1 in 1,000 good sessions",
        ),
        "lens_off": Kind(
            "the focal length is not what the camera file says; what was measured counts instead",
            "calibrate the intrinsics again (vgrd intrinsics), focus and zoom as they are now",
            "pictures against the robot's motion, where these are at odds: 4 sigma",
        ),
        "touch_noise": Kind(
            "touches scatter more or less than the cell file says; what was found counts",
            "touch with more care, or set [touch] as found",
            "likelihood of the level: 1 in 10,000 good sessions, and a third of itself",
        ),
        "point_noise": Kind(
            "touches of the fixed point scatter more or less than stated; what was found counts",
            "touch with more care, or set [touch] as found",
            "the same",
        ),
        "tag_noise": Kind(
            "poses of a tag scatter more or less than its pictures promise; what was found counts",
            "check light, focus and print, and that nothing shakes",
            "the same",
        ),
        "hole_noise": Kind(
            "holes scatter more or less in the pictures than stated; what was found counts",
            "check hole_diameter_mm and hole_sigma_mm",
            "the same",
        ),
        "arm_noise": Kind(
            "the arm errs more or less than the cell file says; what was found counts",
            "set [robot] sigma_mm as found, or have the arm calibrated",
            "the same",
        ),
        "cad_noise": Kind(
            "targets are off CAD by more or less than the cell file says; what was found counts",
            "set [object] cad_sigma_mm as found, or measure the part",
            "the same",
        ),
        "picture_delay": Kind(
            "pictures were taken earlier or later than their stamps say, by the robot's clock",
            "set [camera] delay_ms to what is told; samples at rest do not suffer",
            "tag A in pictures of the moving arm: 4 sigma and 10 ms",
        ),
        "noisy": Kind(
            "the samples scatter more than robot, camera and touch promise",
            "check intrinsics, tag sizes, CAD points and the targets that the touches name, and that "
            "nothing is loose or moved",
            "residuals 3 times as large as promised; fatal at 6",
        ),
        "hand_eye_noise": Kind(
            "the looks scatter more than robot and camera promise",
            "check the intrinsics, the size of tag A, and that bracket and camera are tight",
            "residuals 3 times as large as promised",
        ),
        "tag_a_unseen": Kind(
            "tag A was not in view while touching", "", "pictures of the touches"
        ),
        "tcp_open": Kind(
            "the TCP is not determined; answers do not need it while the wrist stands as it was touched",
            "touch with tilted wrists to know it",
            "covariance of the estimate",
        ),
        "tcp_axis_open": Kind(
            "the fixed point was touched with turns about one axis, as a 4-axis arm must: the TCP along "
            "that axis is not determined; answers do not need it while the wrist has the tilt of the touches",
            "nothing while that tilt is kept, else touch with tilted wrists",
            "rank of the touches of the fixed point",
        ),
        "constant_wrist": Kind(
            "the plan was universal and all touches have one wrist orientation",
            "touch some targets again with the wrist tilted",
            "orientations of the touches",
        ),
        "varied_wrist": Kind(
            "the plan was special and the wrist turned between touches", "", "the same"
        ),
        "no_pivot": Kind(
            "no rotation centre: coordinates rest on the hand-eye translation",
            "record spins of the turntable",
            "spins of the session",
        ),
        "no_cad_center": Kind(
            "the turntable's centre is not known in CAD",
            "set [object] center_mm for less error",
            "the cell file",
        ),
        "few_spins": Kind(
            "few spins, or over a small angle",
            "turn the object further, at least 4 times",
            "fewer than 4, or less than 25 degrees rms",
        ),
        "spins_unusable": Kind("the spins tell no axis", "", "rank of the spins"),
        "spins_not_about_one_axis": Kind(
            "a spin is off the common axis: the object slipped or the camera moved",
            "record the spins again",
            "5 sigma and 0.2 mm",
        ),
        "pivot_disagrees": Kind(
            "two ways to the rotation centre disagree",
            "check [object] center_mm, the CAD points and the size of the tags, and that tag B did not "
            "shift on the object",
            "3 mm apart; between holes and turning 5 sigma",
        ),
        "holes_unusable": Kind("the holes tell no rotation centre", "", "rank of the holes"),
        "position_free": Kind(
            "where the camera is stays open: the wrist did not turn",
            "turn the wrist, or measure where the target is",
            "rank of the hand-eye",
        ),
        "height_free": Kind(
            "the camera's height stays open: the wrist turned about one axis",
            "measure that height, touch one point, or tilt the wrist; expected coordinates at this "
            "tilt do not need it",
            "rank of the hand-eye",
        ),
        "meets_tolerance": Kind(
            "95 % of the misses are within the tolerance", "", "predicted covariance"
        ),
        "misses_tolerance": Kind(
            "too many misses are predicted beyond the tolerance",
            "record the sample that the coach proposes, or relax the tolerance",
            "predicted covariance",
        ),
        "cannot_be_served": Kind(
            "every request for these targets would be refused", "", "trial under the policy"
        ),
        "verification_failed": Kind(
            "a held-out touch misses by more than chance allows",
            "touch the targets again, or check that nothing moved",
            "1.5 times what 95 % of the misses stay within",
        ),
        "tool_suspected": Kind(
            "held-out touches miss although both tags are where they were taught: the tool, or the touching",
            "see whether the tool is the one that was taught, straight and tight, and touch again; if it is, "
            "see whether tag B turned about the object's axis",
            "tag A and tag B in the pictures of these touches",
        ),
        "verification_unseen": Kind("tag B was not in view in a verification", "", "its picture"),
        "verification_unusable": Kind(
            "a verification tells nothing", "", "its sigmas, or the coordinate that is refused"
        ),
    }
)

OF_FILES: Mapping[str, Kind] = MappingProxyType(
    {
        "contradictory": Kind(
            "the samples of a dataset belong to no common set-up",
            "",
            "25 mm, 3 degrees, or half left out",
        ),
        "weak_motion": Kind(
            "the result is uncertain", "", "10 mm or 1 degree (camera), 5 mm (TCP)"
        ),
        "intrinsics_doubtful": Kind(
            "the intrinsics as given do not fit robot and pictures; they were refined",
            "use the transforms with the refined ones, or calibrate the camera anew",
            "likelihood, odds of 150 to 1 beyond six unknowns",
        ),
        "tolerance_exceeded": Kind(
            "further looks are predicted worse than the tolerance",
            "mend what limits it, or allow more",
            "--tolerance-mm",
        ),
        "target_size": Kind(
            "the target has another size than the file says",
            "measure it with a caliper; if it is right, check the robot's unit and the camera's focal "
            "length",
            "3 sigma and 0.1 %; fatal beyond 0.5 % or the tolerance",
        ),
        "samples_scatter": Kind(
            "the samples of a dataset scatter far more than arms and cameras do",
            "see whether something moved or is loose (camera, target, its grip), and read poses at rest",
            "restricted maximum likelihood: factor 3 and 3 of its own sigmas",
        ),
        "camera_scale": Kind(
            "lengths of a 3D camera are not those of the robot",
            "check both units, and the camera with a bar of known length",
            "3 sigma and 0.1 %",
        ),
        "tool_point": Kind(
            "the point that a 3D camera saw is not where the tool is said to have it",
            'correct tcp_in_wrist, or write tcp_in_wrist = "unknown" to have it estimated',
            "F test, 1 in 1,000, and 0.5 mm",
        ),
        "target_not_seen": Kind("a picture does not show the target", "", "detection"),
        "few_points": Kind("a picture shows part of the target", "", "detection"),
        "sample_rejected": Kind("a sample was left out", "", "leaving it out"),
        "sample_doubtful": Kind("a sample is far off the fit of the others", "", "leaving it out"),
        "no_leave_one_out": Kind(
            "without one of the samples the rest determines no fit",
            "record 10 to 20 samples that turn about different axes",
            "leaving each out",
        ),
        "touches_contradict": Kind(
            "the touches of a file contradict each other",
            "check targets, unit and rotation format, that the object stood still and the tool kept "
            "its tip",
            "3 times the promised scatter and 3 mm rms",
        ),
        "rotations_misread": Kind(
            "the orientations of the touches are written in another format, or inverted",
            "correct rotation in [poses]",
            "fit of the touches under every reading: a third of the scatter as written",
        ),
        "tcp_at_flange": Kind(
            "the TCP comes out at the flange's origin",
            "if so, set the pendant's TCP to zero and read the poses again",
            "5 mm",
        ),
        "tool_short": Kind(
            "the TCP is so near the flange's origin that the poses may be those of an active TCP",
            "in that case set the pendant's TCP to zero and read the poses again",
            "40 mm",
        ),
        "touches_alike": Kind(
            "errors are shared by touches of like orientation: a distorted field of a tracker, a bent arm",
            "keep metal away from a magnetic tracker, touch where the tool will work, or calibrate the arm",
            "covariance by 16 groups of orientations, from 64 touches on: twice the one of single touches",
        ),
        "reference_moved": Kind(
            "what was touched moved between two touches",
            "fasten it and touch anew, or keep the larger group only",
            "a jump of the place at one touch: 1 in 1,000 good files, and 3.5 sigma of a touch",
        ),
        "targets_scaled": Kind(
            "the CAD points are in another unit, or longer or shorter by one factor than what was touched",
            "give target in mm as the part is",
            "fit of the touches with a free scale: a third of the scatter as written",
        ),
        "target_off": Kind(
            "a CAD point stands elsewhere than its touches say",
            "correct it, or see whether another point was touched",
            "F test of a free point, 1 in 1,000, and better than any single bad touch",
        ),
        "plane_off": Kind(
            "the plane that a file states is not the one that its touches find by themselves",
            "correct plane, or leave it out, then it is found as well",
            "F test of the free fit, 1 in 1,000",
        ),
        "radius_off": Kind(
            "the radius that a file states is not the one that its touches find by themselves",
            "correct radius_mm (the tip's own included), or leave it out, then it is found as well",
            "F test of the free fit, 1 in 1,000",
        ),
        "touches_scatter": Kind(
            "the touches scatter more or less than the file states; the level that was found is used",
            "touch more carefully or correct sigma_mm",
            "restricted maximum likelihood: factor 1.5 and 3 of its own sigmas",
        ),
        "tcp_beyond_tolerance": Kind(
            "the tip is not known as well as was asked for",
            "add touches with the wrist tilted to several sides, or relax the tolerance",
            "covariance of the TCP, the spread of the levels included",
        ),
        "not_proven": Kind(
            "another solution may fit better",
            "add touches with other wrist orientations",
            "certificate of the optimum",
        ),
    }
)

# What the estimate says when a mistake before it is named already (`BEFORE_SOLVING`): it follows from that.
FOLLOWING = frozenset(
    {
        "look_outlier",
        "touch_outlier",
        "point_outlier",
        "reference_outlier",
        "spin_outlier",
        "sample_outlier",
        "noisy",
        "hand_eye_noise",
        "touch_noise",
        "point_noise",
        "tag_noise",
        "arm_noise",
        "cad_noise",
        "cad_off",
        "center_off",
    }
)
# What is not recorded yet; every other fatal finding is a mistake in what was.
MISSING = frozenset(
    {
        "hand_eye_motion",
        "wrist_tilt",
        "targets_in_line",
        "few_touches",
        "target_untouched",
        "fixed_point_motion",
        "surface_motion",
        "object_turn",
        "spins_unusable",
    }
)
KINDS: Mapping[str, Kind] = MappingProxyType({**BEFORE_SOLVING, **OF_A_SESSION, **OF_FILES})


def finding(code: str, sentence: str, *, fatal: bool = False) -> Finding:
    """A finding of a known kind: what was found, in a sentence with its figures, and the remedy.

    Raises KeyError for a code that is in no table here.
    """
    remedy = KINDS[code].remedy
    return Finding(code, f"{sentence}: {remedy}" if remedy else sentence, fatal)
