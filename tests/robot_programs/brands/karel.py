"""KAREL and TP: their lines, KAREL's built-ins (names and arity from the manuals), and stand-ins for them."""

import math
import re
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

from tests.robot_programs.brands.lines import LineServer
from tests.robot_programs.brands.outcome import Outcome, run
from tests.robot_programs.brands.pendant import Pendant
from tests.robot_programs.brands.stand_ins import StandIns
from tests.robot_programs.brands.translation import Dialect, Place, Rule, load
from tests.robot_programs.brands.world import TAUGHT, World, quaternion

BUILTINS = {
    "abs": "in",
    "sin": "in",
    "cos": "in",
    "sqrt": "in",
    "round": "in",
    "pos": "in in in in in in in",
    "str_len": "in",
    "sub_str": "in in in",
    "index": "in in",
    "ord": "in in",
    "cnv_int_str": "in in in out",
    "cnv_str_real": "in out",
    "uninit": "in",
    "get_reg": "in out out out out",
    "set_int_reg": "in in out",
    "get_pos_reg": "in out in?",
    "set_pos_reg": "in in out in?",
    "check_epos": "in in in out in?",
    "msg_disco": "in out",
    "msg_connect": "in out",
    "set_file_atr": "in in in?",
    "io_status": "in",
    "bytes_ahead": "in out out",
}
DIALECT = Dialect(
    name="KAREL",
    comment="--",
    routine=r"ROUTINE (?P<name>\w+)(?:\((?P<parameters>.*)\))?$",
    end=r"END \w+$",
    assign="=",
    ignored=r"BEGIN$",
    builtins=BUILTINS,
    rules=(
        Rule(r"IF (.+) THEN", "if {0}:", after=1),
        Rule(r"ELSE:?", "else:", -1, 1),
        Rule(r"ENDIF", before=-1),
        Rule(r"WHILE (.+) DO", "while {0}:", after=1),
        Rule(r"ENDWHILE", before=-1),
        Rule(r"SELECT (.+) OF", "case = {0}\nif False:", after=1),
        Rule(r"CASE \((.+)\):", "elif case in ({0},):", -1, 1),
        Rule(r"ENDSELECT", before=-1),
        Rule(r"RETURN", "return"),
        Rule(r"DELAY (.+)", "b.delay({0})"),
        Rule(r"CONNECT TIMER TO (\w+)", lambda _line, m: f"b.connect_timer({m[1]!r})"),
        Rule(r"CLOSE FILE (\w+)", "b.close_file({0})"),
        Rule(r"OPEN FILE (\w+)\((.+), (.+)\)", "b.open_file({0}, {1}, {2})"),
        Rule(r"WRITE (\w+)\((\w+), CR\)", "b.write({0}, {1})"),
        Rule(
            r"READ (\w+)\((\w+)::(\w+)\)",
            lambda line, m: f"b.read({line.value(m[1])}, Place(v, {m[2]!r}), {line.value(m[3])})",
        ),
        Rule(r"(\w+)", lambda line, m: line.call(m[1], "")),
    ),
)
_CONSTANT = re.compile(r"^  ([A-Z][A-Z0-9_]*) = (\S+)$", re.MULTILINE)
_VARIABLE = re.compile(r"^  (\w+) : ", re.MULTILINE)


class Variables(SimpleNamespace):
    """Variables of a task; those that are connected to the timer count milliseconds."""

    _timers: dict[str, float]
    _world: World

    def __getattribute__(self, name: str) -> Any:
        timers = super().__getattribute__("__dict__").get("_timers", {})
        if name in timers:
            return round((self._world.now_s - timers[name]) * 1000)
        return super().__getattribute__(name)

    def __setattr__(self, name: str, value: Any) -> None:
        if name in self.__dict__.get("_timers", {}):
            self._timers[name] = self._world.now_s - value / 1000
        else:
            super().__setattr__(name, value)


class Builtins(StandIns):
    """Stand-ins for the routines of the controller."""

    def __init__(self, world: World, v: Variables, pendant: Pendant) -> None:
        self.world, self.v, self.pendant = world, v, pendant
        self.server = LineServer(world)
        self.tagged = self.opened = False
        self.closed = False
        world.closing.append(lambda: setattr(self, "closed", True))
        self.pending: list[str] = []
        self.attributes: set[str] = set()

    def round(self, number: float) -> int:
        return round(number)

    def pos(self, *numbers: Any) -> tuple[Any, ...]:
        return numbers

    def str_len(self, text: str) -> int:
        assert len(text) <= 128, "a string of 128"
        return len(text)

    def sub_str(self, text: str, start: int, length: int) -> str:
        assert start >= 1
        assert length >= 1
        assert start - 1 + length <= len(text)
        return text[start - 1 : start - 1 + length]

    def index(self, text: str, what: str) -> int:
        return text.find(what) + 1

    def ord(self, text: str, at: int) -> int:
        assert 1 <= at <= len(text)
        return ord(text[at - 1])

    def cnv_int_str(self, number: int, length: int, base: int, place: Place) -> None:
        assert (length, base) == (1, 10)
        place.put(f" {number}")  # a blank before it, as WRITE has

    def cnv_str_real(self, text: str, place: Place) -> None:
        try:
            place.put(float(text))
        except ValueError:
            place.put(None)

    def uninit(self, value: Any) -> bool:
        return value is None

    def get_reg(
        self, number: int, is_real: Place, whole: Place, _real: Place, status: Place
    ) -> None:
        is_real.put(value=False)
        whole.put(self.pendant.numbers[number])
        status.put(0)

    def set_int_reg(self, number: int, value: int, status: Place) -> None:
        assert isinstance(value, int)
        self.pendant.numbers[number] = value
        status.put(0)

    def get_pos_reg(self, number: int, status: Place) -> SimpleNamespace:
        status.put(0)
        return self.pendant.places[number]

    def set_pos_reg(self, number: int, place: SimpleNamespace, status: Place) -> None:
        self.pendant.places[number] = SimpleNamespace(**vars(place))
        status.put(0)

    def check_epos(
        self, place: SimpleNamespace, frame: tuple[Any, ...], tool: tuple[Any, ...], status: Place
    ) -> None:
        assert frame[:6] == tool[:6] == (0,) * 6
        assert place.config_data == "N U T"
        status.put(0 if self.world.reachable(place.z) else 15018)

    def connect_timer(self, name: str) -> None:
        self.v._timers[name] = self.world.now_s

    def delay(self, milliseconds: int) -> None:
        self.world.now_s += milliseconds / 1000

    def msg_disco(self, tag: str, status: Place) -> None:
        assert tag == "C1:"
        self.tagged = False
        status.put(0)

    def msg_connect(self, tag: str, status: Place) -> None:
        assert tag == "C1:"
        self.tagged = not self.world.link_is("refused")
        status.put(0 if self.tagged else 67208)

    def set_file_atr(self, _file: str, attribute: str, value: int | None = None) -> None:
        assert not self.opened
        assert attribute != "atr_timeout" or value
        self.attributes.add(attribute)

    def close_file(self, _file: str) -> None:
        self.opened = False

    def open_file(self, _file: str, usage: str, tag: str) -> None:
        assert (usage, tag) == ("RW", "C1:")
        assert self.attributes == {"atr_ia", "atr_timeout"}, "a READ without ATR_TIMEOUT hangs"
        assert self.tagged, "the tag is not connected"
        self.opened, self.closed = True, False
        self.pending = []

    def io_status(self, _file: str) -> int:
        return 0 if self.opened else 1

    def write(self, _file: str, text: str) -> None:
        assert self.opened
        assert not self.closed
        assert not self.world.link_is("closed")
        answer = self.server.answer(text + "\r\n")  # CR, and what comes with it
        body = answer.rstrip("\r\n")
        half = len(body) // 2
        ends = answer[len(body) :]  # LF may come late
        self.pending = [piece for piece in (body[:half], body[half:], *ends) if piece]

    def bytes_ahead(self, _file: str, ahead: Place, status: Place) -> None:
        status.put(0)
        if self.closed or self.world.link_is("closed"):
            ahead.put(None)  # the manual's INTP-311 waits there
            status.put(67213)
        elif self.pending:
            ahead.put(len(self.pending[0]))

    def read(self, _file: str, place: Place, count: int) -> None:
        piece = self.pending.pop(0)
        assert 0 < count <= len(piece)
        assert count <= 128, "a string of 128"
        if piece[count:]:
            self.pending.insert(0, piece[count:])
        place.put(piece[:count])


def xyzwpr(pose: tuple[float, ...]) -> SimpleNamespace:
    return SimpleNamespace(
        **dict(zip(("x", "y", "z", "w", "p", "r"), pose, strict=True)), config_data="N U T"
    )


def variables(source: str, world: World) -> Variables:
    """Return the constants, and the variables without a value."""
    v = Variables()
    v.__dict__.update(_timers={}, _world=world)
    for name in _VARIABLE.findall(source):
        setattr(v, name.lower(), None)
    for name, value in _CONSTANT.findall(source):
        setattr(
            v,
            name.lower(),
            {"TRUE": True, "FALSE": False}.get(value) if value.isalpha() else _number(value),
        )
    v.field = {}
    v.sock, v.atr_ia, v.atr_timeout = "sock", "atr_ia", "atr_timeout"
    return v


def _number(text: str) -> float:
    return float(text) if "." in text else int(text)


def _clear_of(pose: tuple[float, ...]) -> tuple[float, ...]:
    w, x, y, z = quaternion(*pose[3:])
    tool_z = (2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z)
    return (*(at - 50 * along for at, along in zip(pose, tool_z, strict=False)), *pose[3:])


def run_fanuc(source: str, world: World, settings: Mapping[str, object]) -> Outcome:
    """Take the flange to point 7, in a cell of stepped time: the KAREL task and the program of the pendant."""
    karel, _, pendant_source = source.partition("/PROG")
    v = variables(karel, world)
    v.__dict__.update({name.removeprefix("vgrd_"): value for name, value in settings.items()})
    pendant = Pendant(pendant_source, world)
    pendant.numbers.update(dict.fromkeys(range(81, 91), 0))
    pendant.numbers[82] = 7
    pendant.numbers[81] = pendant.numbers[83] = world.asked_before
    pendant.places.update({81: xyzwpr(TAUGHT), 83: xyzwpr(_clear_of(TAUGHT))})
    v.flag = pendant.flags
    task = load(karel, DIALECT, v, Builtins(world, v, pendant))
    task.setup()
    v.trig = world.first_trig
    world.background, world.restart = task.turn, task.setup
    assert math.isclose(v.poll_s, world.period_s)
    return run(world, pendant.run, lambda: pendant.numbers[84])
