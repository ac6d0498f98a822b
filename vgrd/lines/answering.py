"""From an answer to its text: numbers while they hold, sentinels for everything else."""

import math
from typing import Final

from vgrd.lines.asking import Frame
from vgrd.registers import Answer, RotationCode, Status, age_ms

NO_MM: Final = 99999.0  # 100 m: beyond every arm
NO_DEG: Final = 999.0  # no angle is larger than 360
FARTHEST_MM: Final = 9999.99  # what eight characters hold with sign and two decimals
UNKNOWN4: Final = 9999  # of AGE and U95, four characters: more, or unknown
HB_MODULO: Final = 100  # two characters; comes back after 10 s, so it counts within each second
_FORMS: Final = {
    Frame.BARE: "{0},{1},{2},{3},{4:.2f},{5:.2f},{6:.2f},{7:.3f},{8:.3f},{9:.3f},{10}",
    Frame.BRACKETS: "({0},{1},{2},{3},{4:.2f},{5:.2f},{6:.2f},{7:.3f},{8:.3f},{9:.3f},{10})",
    Frame.XML: '<Vgrd Echo="{0}" Status="{1}" Age="{2}" Hb="{3}" U95="{10}"><Ec X="{4:.2f}"'
    ' Y="{5:.2f}" Z="{6:.2f}" A="{7:.3f}" B="{8:.3f}" C="{9:.3f}"/></Vgrd>',
}


def answer_text(frame: Frame, trig: int, answer: Answer, beat: int, now_s: float) -> str:
    """The answer's line without its end, or its document."""
    status, numbers = answer.status, (NO_MM, NO_MM, NO_MM, NO_DEG, NO_DEG, NO_DEG)
    u95 = UNKNOWN4
    if status.is_ok and max(map(abs, answer.position_um)) > 1000 * FARTHEST_MM:
        status = Status.ENCODING_OVERFLOW
    if status.is_ok:
        x, y, z = answer.position_um
        numbers = (x / 1000, y / 1000, z / 1000, *_degrees(answer))
        u95 = min(answer.u95_um, UNKNOWN4)
    age = min(age_ms(answer, now_s), UNKNOWN4)
    return _FORMS[frame].format(trig, int(status), age, beat % HB_MODULO, *numbers, u95)


def _degrees(answer: Answer) -> tuple[float, float, float]:
    if answer.rotation_format == RotationCode.ROTVEC:
        rx, ry, rz = map(math.degrees, answer.rotation)
        return rx, ry, rz
    return answer.rotation
