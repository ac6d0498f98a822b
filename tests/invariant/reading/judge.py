"""What a robot read, held against the truth: every valid read is right, or a promise says why it need not be.

A read that is neither is a `Lie`. The counts say how many reads there were, and of which kind.
"""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fakes.world.poses import WORK_ROTATION
from tests.invariant.reading.desk import Desk
from tests.invariant.reading.limits import LimitsInForce
from tests.invariant.reading.promises import Promises
from tests.invariant.reading.robots import Asked
from tests.invariant.reading.undetectable import TOLD_SIGMAS, effect_mm, expected_misfit
from tests.invariant.simulation.pictures import SAME, Exposure, Film
from tests.invariant.simulation.plant import Plant
from tests.invariant.simulation.teaching import Variant
from vgrd.calibration.calibration import Calibration
from vgrd.geometry import Array, Pose
from vgrd.geometry.rotation_formats import RotationFormat, rotation_from
from vgrd.registers import RESPONSE, Command, Frame, RotationCode, State, Status
from vgrd.registers.layout import crc_of

REST_S = 1.0  # so long before and after it an arm that moves may count as one at rest, and the other way
U95S = 3.0  # how many of them an answer may be off
MAX_AGE_S, MOVED_MM = 3.0, 0.3  # as the cell file has them, until it is reloaded
NOISE_MM = 0.4  # five sigmas of a way between two pictures, at the flange
SLOWEST_S = 0.25  # from exposure to evaluation, of a whole picture here
WATCH_S, MARGIN_S = 0.1, 0.1  # told within P + L + 0.1 (docs/registers.md)
WROTE_RAD = 2e-3  # how the wrist stood at the touches, against straight down
CLOCKS_S = 0.0115  # AGE lags by less than 10 ms, and is rounded up to 1 ms
_FORMATS = {
    RotationCode.ROTVEC: RotationFormat.ROTVEC,
    RotationCode.RPY: RotationFormat.RPY_FIXED_XYZ_DEG,
    RotationCode.KUKA_ABC: RotationFormat.KUKA_ABC_DEG,
    RotationCode.ZYZ: RotationFormat.ZYZ_DEG,
}
_UNITS16 = {0: (0.1, 1e-3), 1: (0.1, math.radians(0.01)), 2: (0.05, 1e-4)}
_VALID = {Status.OK, Status.OK_DEGRADED}
_STATUS_AT = slice(2 * (104 - 100), 2 * (105 - 100))
_SENTINELS = RESPONSE.encode(
    {field.name: 0 for field in RESPONSE.fields}
    | {f"EC16_{axis}": -(2**15) for axis in ("X", "Y", "Z", "RX", "RY", "RZ")}
    | {f"EC32_{axis}": -(2**31) for axis in ("X", "Y", "Z", "RX", "RY", "RZ", "U95")}
    | {f"ECF_{axis}": math.nan for axis in ("X", "Y", "Z", "RX", "RY", "RZ", "U95")}
)
_COORDINATES = (slice(40, 52), slice(60, 86), slice(100, 126))  # bytes of EC16, EC32, ECF


class Lie(AssertionError):
    """A read that was valid and must not have been."""


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """A valid coordinate as read, and the picture that it rests on. flange: base_from_wrist."""

    asked: Asked
    target: str
    flange: Pose
    u95_mm: float
    u95_rad: float
    tip: Array
    picture: Exposure
    earlier: Exposure | None

    @property
    def pictures(self) -> list[Exposure]:
        """Those that it rests on."""
        return [self.picture] if self.earlier is None else [self.picture, self.earlier]


class Judge:
    """Judges reads; `counts` by kind, `worst` is the largest miss in u95 of those that nothing excuses."""

    def __init__(
        self,
        plant: Plant,
        film: Film,
        desk: Desk,
        variant: Variant,
        calibrations: Mapping[int, Calibration],
    ) -> None:
        self.plant, self.film, self.desk, self.variant = plant, film, desk, variant
        self.calibrations = calibrations
        self.counts: Counter[str] = Counter()
        self.worst = 0.0
        self.slowest_s, self.watch_s, self.max_age_s = SLOWEST_S, WATCH_S, MAX_AGE_S
        self.promises = Promises()
        self.limits = LimitsInForce()
        self._last: tuple[bytes, Told] | None = None
        self._point: tuple[object, str, Array] | None = None

    @property
    def told_within_s(self) -> float:
        """P + L + 0.1 s; a slow picture delays the next, so P is L where pictures are whole or late."""
        return self.watch_s + self.slowest_s + MARGIN_S

    def slower(self, seconds: float) -> None:
        """Pictures are evaluated so late, one after the other, from now on."""
        self.slowest_s = max(self.slowest_s, SLOWEST_S + seconds)
        self.watch_s = max(self.watch_s, self.slowest_s)

    def faster(self) -> None:
        """They come as they should again; what was slow is remembered for some pictures."""
        is_slow = self.slowest_s > SLOWEST_S
        self.slowest_s = max(SLOWEST_S, 0.7 * self.slowest_s)
        self.watch_s = self.slowest_s if is_slow else WATCH_S

    def read(
        self,
        block: bytes,
        now_s: float,
        as_read: bytes | None = None,
        age_read_s: float | None = None,
    ) -> bool:
        """Judge registers 100-167, in the usual order. Whether they are valid.

        as_read: as they came. age_read_s: when AGE was read, where that was not now.
        """
        self.counts["reads"] += 1
        if int.from_bytes(block[_STATUS_AT], "big") not in _VALID:
            if any(block[part] != _SENTINELS[part] for part in _COORDINATES):
                raise Lie(f"a coordinate beside STATUS {block[_STATUS_AT].hex()}: {block.hex()}")
            return False
        self.counts["valid"] += 1
        if broken := self.promises.broken(now_s):
            raise Lie(f"valid although {broken}")
        told = self._told(block, age_read_s or now_s, as_read)
        self._check_age(told, now_s)
        self.counts[self._verdict(told, now_s)] += 1
        return True

    def _told(self, block: bytes, age_read_s: float, as_read: bytes | None) -> Told:
        """Decode; the same bytes as a moment ago need no second look, unless somebody asked meanwhile."""
        if (
            self._last is not None
            and block == self._last[0]
            and self.desk.asked is self._last[1].asked
        ):
            return self._last[1]
        values = RESPONSE.decode(block)
        _check_whole(values, crc_of(as_read or block))
        asked = self._check_own(values)
        told = self._decode(values, asked, age_read_s)
        self._last = (block, told)
        return told

    def _check_own(self, values: Mapping[str, float]) -> Asked:
        asked = self.desk.asked
        if asked is None:
            raise Lie(f"valid, and nothing is asked: {values}")
        frame = Frame.TCP if asked.options & 2 else Frame.FLANGE
        form = (asked.options >> 4 & 15) | frame << 4
        mine = (asked.trig, asked.point, form)
        if (values["ECHO"], values["POINT"], int(values["FMT"]) & 0xFF) != mine:
            raise Lie(f"of another request than {asked}: {values}")
        return asked

    def _decode(self, values: Mapping[str, float], asked: Asked, age_read_s: float) -> Told:
        code = RotationCode(int(values["FMT"]) & 15)
        unit = 1e-6 if code is RotationCode.ROTVEC else 1e-4
        angles = tuple(unit * values[f"EC32_{axis}"] for axis in ("RX", "RY", "RZ"))
        place = np.array([values[f"EC32_{axis}"] for axis in "XYZ"]) / 1000
        R = rotation_from(angles, _FORMATS[code])
        calibration = self.calibrations.get(int(values["CALID"]))
        if calibration is None:
            raise Lie(f"of no calibration: {values}")
        if asked.options & 2 and calibration.tcp_in_wrist is not None:
            place = place - R @ calibration.tcp_in_wrist
        flange = Pose(R, place)
        tip = flange.translation
        if calibration.tcp_in_wrist is not None:
            tip = flange @ calibration.tcp_in_wrist
        if broken := self.limits.broken(flange, tip):
            raise Lie(f"beyond a limit, {broken}: {values}")
        picture = self._picture(age_read_s - values["AGE"] / 1000)
        if picture is None:
            raise Lie(f"of no picture that shows tag B: {values}")
        if asked.command == Command.EC_FRESH and picture.stamp_s < asked.at_s:
            raise Lie(f"fresh, but of a picture {asked.at_s - picture.stamp_s:.3f} s before")
        target = next(t.name for t in self.plant.layout.targets.values() if t.id == asked.point)
        return Told(
            asked,
            target,
            flange,
            values["EC32_U95"] / 1000,
            1e-5 * values["U95R"],
            self.plant.tip(flange),
            picture,
            self._earlier(picture),
        )

    def _picture(self, stamp_s: float) -> Exposure | None:
        """The newest exposure of tag B at about that time."""
        for exposure in reversed(self.film.exposures.values()):
            if exposure.stamp_s < stamp_s - CLOCKS_S:
                return None
            if exposure.stamp_s <= stamp_s + CLOCKS_S and "b" in exposure.errors:
                return exposure
        return None

    def _earlier(self, picture: Exposure) -> Exposure | None:
        """The newest picture of tag A and an arm at rest, of those before one that is not of both."""
        if "a" in picture.errors and not self._arm_moved(picture):
            return None
        before = (e for e in reversed(self.film.exposures.values()) if e.stamp_s < picture.stamp_s)
        return next((e for e in before if "a" in e.errors and not self._arm_moved(e)), None)

    def _arm_moved(self, picture: Exposure) -> bool:
        """Whether it did at about that time; the cell may or may not have taken it to be at rest."""
        at = picture.base_from_flange
        return any(
            max(at.distance(other.base_from_flange)) > SAME
            for other in self.film.exposures.values()
            if abs(other.stamp_s - picture.stamp_s) < REST_S
        )

    def _check_age(self, told: Told, now_s: float) -> None:
        asked_s = told.asked.max_age_ms / 1000 or self.max_age_s
        age_s = now_s - told.picture.stamp_s
        if age_s > min(asked_s, self.max_age_s) + CLOCKS_S:
            raise Lie(f"valid at an age of {age_s:.3f} s")

    def _verdict(self, told: Told, now_s: float) -> str:
        """The kind of a valid read. Raises Lie."""
        error_mm = float(np.linalg.norm(told.tip - self._truth(told.target, now_s)))
        miss = error_mm / told.u95_mm
        if miss <= U95S and self._turned_right(told, now_s):
            self.worst = max(self.worst, miss)
            return "right"
        moved_mm = self._moved_mm(told, now_s)
        why_moved = self._moved_words(told, now_s, moved_mm)
        allowed_mm = U95S * told.u95_mm + (moved_mm if why_moved else 0.0)
        if why_moved and error_mm <= allowed_mm:
            return why_moved
        wrong_mm, misfit = self._wrong(told, now_s)
        wrongs = {word for picture in told.pictures for word in picture.wrongs}
        if wrongs and misfit < TOLD_SIGMAS and error_mm <= allowed_mm + wrong_mm:
            return f"not told by one picture: {', '.join(sorted(wrongs))}"
        raise Lie(
            f"{error_mm:.3f} mm off at a u95 of {told.u95_mm:.3f} ({self.variant}); moved by "
            f"{moved_mm:.3f} mm since the picture, {now_s - told.picture.stamp_s:.3f} s ago; wrong in "
            f"it: {told.picture.wrongs}, by {wrong_mm:.3f} mm, misfit {misfit:.1f}; {told.asked}"
        )

    def _moved_words(self, told: Told, now_s: float, moved_mm: float) -> str:
        """Why the object may be elsewhere than in the picture while the answer stands; empty: it may not."""
        if moved_mm == 0.0:
            return ""
        if moved_mm <= MOVED_MM + NOISE_MM:
            return "moved by less than is told"
        if self._moved_lately(told, now_s):
            return "moved a moment ago"
        is_held = self.variant.hidden_tag == "hold" and bool(self.desk.state & State.HELD)
        return "moved while its tag was hidden" if is_held else ""

    def _wrong(self, told: Told, now_s: float) -> tuple[float, float]:
        """How far all that is wrong in the picture can put the target, mm, and by how much it contradicts."""
        picture = told.picture
        where = self.plant.base_from_camera.inverse() @ self.plant.point(told.target, now_s)
        wrong_mm = effect_mm(picture, told.earlier, where)
        if "outlier of tag b" in picture.wrongs:
            wrong_mm = 0.0  # the picture before it, or after it, does not show it
        return wrong_mm, expected_misfit(picture, told.earlier, self.variant, self.plant)

    def _truth(self, target: str, now_s: float) -> Array:
        """Where a target is, computed once while the object stands."""
        at = self.plant.placements[-1]
        if now_s < at.since_s + at.turn_s:
            return self.plant.point(target, now_s)
        if self._point is None or self._point[:2] != (at, target):
            self._point = (at, target, self.plant.point(target, now_s))
        return self._point[2]

    def _turned_right(self, told: Told, now_s: float) -> bool:
        """Whether the wrist stands as was asked."""
        policy = told.asked.options >> 8 & 3
        R = WORK_ROTATION
        if policy == 2:
            table = self.plant.layout.base_from_table
            taught = table.rotation.T @ WORK_ROTATION
            R = self.plant.base_from_object(now_s).rotation @ taught
        elif policy == 3:
            form = RotationCode(told.asked.options >> 4 & 15)
            unit = 1e-6 if form is RotationCode.ROTVEC else 1e-4
            R = rotation_from([unit * number for number in told.asked.orientation], _FORMATS[form])
        rad = Pose(R, np.zeros(3)).distance(Pose(told.flange.rotation, np.zeros(3)))[1]
        return rad <= U95S * told.u95_rad + WROTE_RAD

    def _moved_mm(self, told: Told, then_s: float) -> float:
        """How far the target was then from where it was in the picture, or the flange that follows it."""
        then = self.plant.base_from_object(then_s)
        way = then @ told.picture.base_from_object.inverse()
        points = (told.tip, told.flange.translation)
        return max(float(np.linalg.norm(way @ point - point)) for point in points)

    def _moved_lately(self, told: Told, now_s: float) -> bool:
        """Whether the object was at its place, as far as is told, within the time of the promise."""
        since_s = now_s - self.told_within_s
        changes = [p.since_s for p in self.plant.placements if since_s < p.since_s]
        times = [*np.linspace(since_s, now_s, 9), *(s - 1e-9 for s in changes)]
        return any(self._moved_mm(told, float(at)) <= MOVED_MM + NOISE_MM for at in times)


def _check_whole(values: Mapping[str, float], crc: int) -> None:
    """All of a block is of one answer, finite, and the same in every encoding that holds it."""
    if values["EC32_CRC"] != crc:
        raise Lie(f"torn, CRC {crc:08x}: {values}")
    for block in ("EC32", "ECF"):
        same = [values[f"{block}_{name}"] == values[name] for name in ("ECHO", "STATUS", "SEQ")]
        if not all(same) or int(values["SEQ"]) & 1:
            raise Lie(f"torn between STATUS and {block}: {values}")
    if not all(math.isfinite(value) for value in values.values()) or values["EC32_U95"] <= 0:
        raise Lie(f"not finite: {values}")
    rotvec = int(values["FMT"]) & 15 == RotationCode.ROTVEC
    units = [1e-3] * 3 + [1e-6 if rotvec else 1e-4] * 3
    mm16, rad16 = _UNITS16[int(values["FMT"]) >> 8]
    units16 = [mm16] * 3 + [rad16 if rotvec else math.degrees(rad16)] * 3
    for axis, unit, unit16 in zip(("X", "Y", "Z", "RX", "RY", "RZ"), units, units16, strict=True):
        exact = values[f"ECF_{axis}"]
        if abs(values[f"EC32_{axis}"] * unit - exact) > unit + 1e-6 * abs(exact):
            raise Lie(f"{axis} differs between EC32 and ECF: {values}")
        is_there = values["EC16_STATUS"] in _VALID
        if is_there and abs(values[f"EC16_{axis}"] * unit16 - exact) > unit16:
            raise Lie(f"{axis} differs between EC16 and ECF: {values}")
