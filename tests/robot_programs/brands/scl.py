"""SCL: as the IEC 61131-3 has it, its lines, its built-ins, and stand-ins for MB_CLIENT and TON."""

import math
import re
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

from tests.robot_programs.brands.outcome import Outcome
from tests.robot_programs.brands.stand_ins import StandIns
from tests.robot_programs.brands.translation import Dialect, Rule, load
from tests.robot_programs.brands.world import LEG_S, TAUGHT, Fault, Reading, World, quaternion
from vgrd.registers.layout import encode_response

SCAN_S = 0.01
JOB_S = 0.03  # of one turn of Modbus
CONNECT_S = 1.0  # of the first
WATCHED_S = 6.0  # longer than every limit, and than MB_CLIENT waits
APPROACH_MM = 50
BLOCKS = {
    "ton_time": ("in", "pt"),
    "mb_client": (
        "req",
        "disconnect",
        "mb_mode",
        "mb_data_addr",
        "mb_data_len",
        "mb_data_ptr",
        "connect",
    ),
}
BUILTINS = dict.fromkeys(
    (
        "abs",
        "sqrt",
        "sin",
        "cos",
        "word_to_uint",
        "word_to_int",
        "uint_to_word",
        "int_to_dint",
        "uint_to_dint",
        "dint_to_real",
        "dword_to_dint",
    ),
    "in",
)
DIALECT = Dialect(
    name="SCL",
    comment="//",
    routine=r"FUNCTION_BLOCK (?P<name>\w+)(?P<parameters>)$",
    end=r"END_FUNCTION_BLOCK$",
    builtins=BUILTINS,
    rules=(
        Rule(r"IF (.+) THEN", "if {0}:", after=1),
        Rule(r"ELSE", "else:", -1, 1),
        Rule(r"END_IF;", before=-1),
        Rule(r"FOR (.+) := (.+) TO (.+) DO", "for {0} in range({1}, {2} + 1):", after=1),
        Rule(r"END_FOR;", before=-1),
        Rule(r"CASE (.+) OF", "case = {0}\nif False:", after=1),
        Rule(r"([\w, ]+):", "elif case in ({0},):", -1, 1),
        Rule(r"END_CASE;", before=-1),
        Rule(r"(\w+)\(\s*(\w+ := .+)\);", lambda line, m: _block_call(line.value, m[1], m[2])),
    ),
)
_DECLARED = re.compile(r"^\s+(\w+) : ([\w\[\]. ]+?)(?: := ([^;]+))?;", re.MULTILINE)


def _block_call(value: Any, instance: str, arguments: str) -> str:
    pairs = (pair.split(" := ") for pair in arguments.split(","))
    given = (f"{name.strip().lower()}_={value(text)}" for name, text in pairs)
    return f"v.{instance.lower()}({', '.join(given)})"


def normalised(source: str) -> str:
    """Return the function block as IEC 61131-3 writes it: without what only SCL has."""
    block = source[
        source.index("FUNCTION_BLOCK") : source.index("END_FUNCTION_BLOCK")
        + len("END_FUNCTION_BLOCK")
    ]
    block = re.sub(r"\{.*?\}", "", block)
    block = re.sub(
        r"^(VERSION .*|BEGIN|\s*REGION .*|\s*END_REGION)$", "", block, flags=re.MULTILINE
    )
    return re.sub(r'(?<!\w)#|"', "", block)


class Timer:
    """TON of IEC 61131-3."""

    def __init__(self, world: World) -> None:
        self.world, self.since_s, self.q = world, math.inf, False

    def __call__(self, *, in_: bool, pt_: float) -> None:
        if not in_:
            self.since_s = math.inf
        elif self.since_s == math.inf:
            self.since_s = self.world.now_s
        self.q = in_ and self.world.now_s - self.since_s >= pt_ - 1e-9


class Client:
    """MB_CLIENT: one job at a time, REQ is a level, parameters must stay while it runs."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.busy = self.done = self.error = False
        self.status = 0
        self.job: tuple[Any, ...] = ()
        self.calls: list[float] = []
        self.wrote: list[tuple[int, ...]] = []
        self.ends_s = 0.0
        self.connected = False

    def __call__(
        self,
        *,
        req_: bool,
        disconnect_: bool,
        mb_mode_: int,
        mb_data_addr_: int,
        mb_data_len_: int,
        mb_data_ptr_: dict[int, int],
        connect_: str,
    ) -> None:
        assert not disconnect_
        assert connect_ == "TCON_IP_v4"
        assert self.world.now_s not in self.calls[-1:], "one call a scan"
        self.calls.append(self.world.now_s)
        self.done = self.error = False
        if self.job:
            assert not req_, "REQ is a pulse"
            assert self.job == (mb_mode_, mb_data_addr_, mb_data_len_), (
                "parameters changed while BUSY"
            )
            if self.world.now_s >= self.ends_s:
                self._end(mb_data_ptr_)
        elif req_:
            self.job = (mb_mode_, mb_data_addr_, mb_data_len_)
            assert self.job in ((116, 0, 29), (103, 100, 68))
            lost = (
                self.world.link_is("refused")
                or self.world.link_is("closed")
                or not self.world.read().link
            )
            takes_s = 5.0 if lost else JOB_S if self.connected else CONNECT_S
            self.ends_s = self.world.now_s + takes_s
        self.busy = bool(self.job)

    def _end(self, words: dict[int, int]) -> None:
        mode, self.job = self.job[0], ()
        if (
            not self.world.read().link
            or self.world.link_is("refused")
            or self.world.link_is("closed")
        ):
            self.error, self.status = True, 0x80C8
            return
        self.done = self.connected = True
        if mode == 116:
            self.wrote.append(tuple(words[i] for i in range(29)))
            trig, command, point, options, *rest = self.wrote[-1]
            assert not any(rest)
            if trig:
                self.world.ask(trig, point, command, options)
        else:
            words.update(enumerate(registers(self.world.read())))


def registers(reading: Reading) -> tuple[int, ...]:
    """Return registers 100-167 as the gate has them."""
    good = reading.good
    numbers = {
        axis: _scaled(n, 1000 if i < 3 else 10000) for i, (axis, n) in enumerate(_axes(reading))
    }
    status = reading.status if reading.block_status is None else reading.block_status
    echo = reading.trig if reading.echo is None else reading.echo
    seq = reading.seq if good else reading.seq + 1
    values: dict[str, float] = {
        **dict.fromkeys(("STATE", "DETAIL", "U95R", "NTAG", "CALID", "TCAP", "MOVED"), 0),
        "MAPVER": reading.mapver,
        "HB": reading.beat,
        "ECHO": echo,
        "STATUS": reading.status,
        "POINT": reading.point,
        "OBJECT": reading.object,
        "AGE": int(reading.age_ms),
        "U95P": int(reading.u95_um),
        "FMT": reading.format,
        "SEQ": seq,
        "EC32_U95": int(reading.u95_um),
        "ECF_U95": math.nan,
        **{f"EC16_{axis}": -0x8000 for axis, _ in _axes(reading)},
        **{f"EC32_{axis}": number if good else -0x80000000 for axis, number in numbers.items()},
        **{f"ECF_{axis}": math.nan for axis, _ in _axes(reading)},
    }
    for block in ("EC16", "EC32", "ECF"):
        values[f"{block}_ECHO"] = echo if reading.block_echo is None else reading.block_echo
        values[f"{block}_STATUS"] = status
        values[f"{block}_SEQ"] = seq if reading.block_seq is None else reading.block_seq
    block, _ = encode_response(values)
    return tuple(int.from_bytes(block[i : i + 2], "big") for i in range(0, len(block), 2))


def _axes(reading: Reading) -> list[tuple[str, float]]:
    return list(zip(("X", "Y", "Z", "RX", "RY", "RZ"), reading.pose, strict=True))


def _scaled(number: float, by: int) -> int:
    return round(number * by) if math.isfinite(number) else -0x80000000


class Builtins(StandIns):
    """Conversions, and the functions of angles in radians."""

    def sin(self, radians: float) -> float:
        return math.sin(radians)

    def cos(self, radians: float) -> float:
        return math.cos(radians)

    def word_to_uint(self, word: int) -> int:
        assert 0 <= word < 65536
        return word

    def word_to_int(self, word: int) -> int:
        return word - 65536 if word > 32767 else word

    def uint_to_word(self, number: int) -> int:
        assert 0 <= number < 65536
        return number

    def int_to_dint(self, number: int) -> int:
        return number

    def uint_to_dint(self, number: int) -> int:
        return number

    def dint_to_real(self, number: int) -> float:
        assert -(2**31) <= number < 2**31
        return float(number)

    def dword_to_dint(self, number: int) -> int:
        return number - 2**32 if number >= 2**31 else number


def variables(source: str, world: World) -> SimpleNamespace:
    """Return what the block and its data block declare."""
    v = SimpleNamespace(
        vgrddata=SimpleNamespace(words=dict.fromkeys(range(68), 0), connection="TCON_IP_v4")
    )
    for name, type_, value in _DECLARED.findall(normalised(source)):
        setattr(v, name.lower(), _initial(type_, value, world))
    return v


def _initial(type_: str, value: str, world: World) -> Any:
    match type_:
        case "TON_TIME":
            return Timer(world)
        case "MB_CLIENT":
            return Client(world)
        case "Bool":
            return value == "TRUE"
        case "Time":
            number, unit = re.fullmatch(r"T#(\d+)(m?s)", value).groups() if value else ("0", "s")
            return int(number) / (1000 if unit == "ms" else 1)
        case array if array.startswith("Array"):
            return dict.fromkeys(range(6), 0)
    return float(value or 0) if type_ == "Real" else int(value or 0)


def run_siemens(source: str, world: World, settings: Mapping[str, object]) -> Outcome:
    """Ask for point 7 as often as the block says that it helps, then watch the answer for a second."""
    v = variables(source, world)
    v.__dict__.update({name.removeprefix("vgrd_"): value for name, value in settings.items()})
    v.trig = world.first_trig
    for name, number in zip(("x", "y", "z", "roll", "pitch", "yaw"), TAUGHT, strict=True):
        setattr(v, f"taught{name}", number)
    v.pointid = 7
    block = load(executable(source), DIALECT, v, Builtins())
    decisions: list[int] = []
    arrived = False
    for _ in range(3):
        arrived = _attempt(v, block.fb_vgrdask, world)
        if arrived:
            break
        decisions.append(v.word)
        if not v.again:
            break
    if world.keys and not arrived:
        world.fault = Fault()
        arrived = _attempt(v, block.fb_vgrdask, world)
    pose = (v.x, v.y, v.z, v.roll, v.pitch, v.yaw)
    return Outcome(world, arrived, tuple(decisions), (), pose)


def _go_on(v: SimpleNamespace, world: World) -> None:
    """The arm goes to the approach point, stands there, goes to the coordinate, stands there."""
    if not world.legs or (world.now_s >= world.leg_began_s + 2 * LEG_S and world.legs < 2):
        world.legs, world.leg_began_s = world.legs + 1, world.now_s
    v.stands = world.legs if world.now_s >= world.leg_began_s + LEG_S else 0
    back_mm = APPROACH_MM if v.stands == 1 else 0
    qw, qx, qy, qz = quaternion(v.roll, v.pitch, v.yaw)
    along = (2 * (qx * qz + qw * qy), 2 * (qy * qz - qw * qx), qw**2 - qx**2 - qy**2 + qz**2)
    sent = tuple(at - back_mm * part for at, part in zip((v.x, v.y, v.z), along, strict=True))
    v.atx, v.aty, v.atz = world.ended_at(sent) if v.stands else (math.nan,) * 3


def executable(source: str) -> str:
    """Return the statements of the block, as a routine."""
    text = normalised(source)
    return f"FUNCTION_BLOCK FB_VgrdAsk\n{text[text.rindex('END_VAR') + len('END_VAR') :]}"


def _attempt(v: SimpleNamespace, scan: Any, world: World) -> bool:
    """One rise of `ask`. Return whether the coordinate became valid, and stayed so."""

    def turn() -> None:
        world.now_s += SCAN_S
        scan()

    v.ask, v.stands = False, 0
    turn()
    assert not v.valid
    v.ask = True
    turn()
    assert (v.valid, v.word, v.x, v.roll, v.agems) == (False, 0, 0, 0, 65535)
    began_s = world.now_s
    while v.busy or v.valid:
        turn()
        if v.valid:
            _go_on(v, world)
        if v.valid and world.now_s > world.leg_began_s + WATCHED_S:
            v.ask = False
            turn()
            assert not v.valid
            assert not v.busy
            return True
        assert world.now_s < began_s + 20, "the block goes on and on"
    world.stopped_s, word = world.now_s, v.word
    while world.now_s < world.stopped_s + WATCHED_S:
        turn()
        assert (v.valid, v.busy, v.word) == (False, False, word), (
            "a refusal stands until ask falls"
        )
    return False
