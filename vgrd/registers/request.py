"""What the robot asks for, read from registers 0-31."""

from dataclasses import dataclass
from typing import Self

from vgrd.registers.codes import Policy, RotationFormat
from vgrd.registers.layout import REQUEST


@dataclass(frozen=True, slots=True)
class Request:
    """A request as written; the numbers are not judged, except that they have a type.

    request_pose_um_urad: REQ_POSE, the flange at capture (x, y, z um; rotation vector urad).
    request_orientation: REQ_ORI, how the wrist will stand, in the format of OPT: rad or deg.
    """

    trig: int
    command: int
    point: int
    options: int
    robot: int
    object: int
    tool: int
    max_age_s: float
    max_u95_um: int
    timeout_s: float
    request_pose_um_urad: tuple[int, int, int, int, int, int]
    client_beat: int
    request_orientation: tuple[float, float, float]

    @classmethod
    def parse(cls, registers: bytes) -> Self:
        """Read the 64 bytes of registers 0-31."""
        v = REQUEST.decode(registers)
        options = int(v["OPT"])
        unit = 1e-6 if (options >> 4) & 15 == RotationFormat.ROTVEC else 1e-4
        x, y, z, rx, ry, rz = (int(v[f"REQ_{a}"]) for a in ("X", "Y", "Z", "RX", "RY", "RZ"))
        return cls(
            trig=int(v["TRIG"]),
            command=int(v["CMD"]),
            point=int(v["POINT"]),
            options=options,
            robot=int(v["ROBOT"]),
            object=int(v["OBJECT"]),
            tool=int(v["TOOL"]),
            max_age_s=v["MAXAGE"] / 1000,
            max_u95_um=int(v["MAXU95"]),
            timeout_s=v["TMO"] / 1000,
            request_pose_um_urad=(x, y, z, rx, ry, rz),
            client_beat=int(v["CLHB"]),
            request_orientation=(v["ORI_RX"] * unit, v["ORI_RY"] * unit, v["ORI_RZ"] * unit),
        )

    @property
    def refuse_if_moving(self) -> bool:
        """OPT b0."""
        return bool(self.options & 1)

    @property
    def wants_tcp(self) -> bool:
        """OPT b1: the TCP pose instead of the flange."""
        return bool(self.options & 2)

    @property
    def has_pose(self) -> bool:
        """OPT b2: REQ_POSE holds the flange at capture."""
        return bool(self.options & 4)

    @property
    def rotation_format(self) -> RotationFormat | None:
        """OPT b4-7, None when unknown."""
        code = (self.options >> 4) & 15
        return RotationFormat(code) if code in list(RotationFormat) else None

    @property
    def policy(self) -> Policy:
        """OPT b8-9."""
        return Policy((self.options >> 8) & 3)

    @property
    def position_mm(self) -> tuple[float, float, float]:
        """REQ_POSE's position."""
        x, y, z = self.request_pose_um_urad[:3]
        return x / 1000, y / 1000, z / 1000

    @property
    def rotvec_rad(self) -> tuple[float, float, float]:
        """REQ_POSE's rotation vector."""
        rx, ry, rz = self.request_pose_um_urad[3:]
        return rx * 1e-6, ry * 1e-6, rz * 1e-6


NOTHING_ASKED = Request.parse(bytes(64))
