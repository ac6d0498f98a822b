"""RAPID: its lines, its built-ins (names and arity from the manuals), and stand-ins for them."""

import ast
import math
import re
import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

from tests.robot_programs.brands.lines import LineServer
from tests.robot_programs.brands.outcome import Outcome, run
from tests.robot_programs.brands.stand_ins import StandIns
from tests.robot_programs.brands.translation import ControllerError, Dialect, Place, Rule, load
from tests.robot_programs.brands.world import TAUGHT, World, quaternion

BUILTINS = {
    "socketcreate": "in",
    "socketconnect": r"in in in \time",
    "socketclose": "in",
    "socketsend": r"in \str",
    "socketreceive": r"in \str=out \time",
    "strmatch": "in in in",
    "strpart": "in in in",
    "strlen": "in",
    "strtoval": "in out",
    "numtostr": r"in in \exp",
    "clkreset": "in",
    "clkstart": "in",
    "clkread": "in",
    "abs": "in",
    "cos": "in",
    "distance": "in in",
    "orientzyx": "in in in",
    "reltool": r"in in in in \rx \ry \rz",
    "calcjointt": r"in in \wobj \errornumber",
    "cpos": r"\tool \wobj",
    "movej": r"in in in in \wobj",
    "movel": r"in in in in \wobj",
    "searchl": r"cond out in in in \stop \pstop \sstop \wobj",
    "waittime": r"in \inpos",
    "waituntil": r"cond \maxtime \timeflag=out \pollrate",
    "tpwrite": r"in \num \bool",
    "stop": "",
}
DIALECT = Dialect(
    name="RAPID",
    comment="!",
    routine=r"PROC (?P<name>\w+)\((?P<parameters>.*)\)$",
    end=r"ENDPROC$",
    ignored=r"(CONST|VAR|PERS) ",
    builtins=BUILTINS,
    rules=(
        Rule(r"IF (.+) THEN", "if {0}:", after=1),
        Rule(r"ENDIF", before=-1),
        Rule(r"WHILE (.+) DO", "while {0}:", after=1),
        Rule(r"ENDWHILE", before=-1),
        Rule(r"IF (.+?) (\w+) := (.+);", "if {0}: {1} = {2}"),
        Rule(r"ERROR", "except ControllerError as fault:\n    v.errno = fault.args[0]", -1, 1),
        Rule(r"RETURN;", "return"),
        Rule(r"(\w+)(\\.+| (?!:=).+)?;", lambda line, m: line.call(m[1], m[2] or "")),
    ),
)
_DECLARED = re.compile(r"^  (CONST|PERS|VAR) (\w+) (\w+)(\{\d+\})?(?: := (.+))?;", re.MULTILINE)


def variables(source: str, shared: SimpleNamespace) -> "Task":
    """Return what a task that has loaded the module declares, with the values declared."""
    task = Task(shared)
    for kind, type_, name, array, value in _DECLARED.findall(source):
        if kind == "PERS":
            task.__dict__["_persistent"].add(name.lower())
        setattr(task, name.lower(), _initial(type_, array, value))
    for name in ("err_whlsearch", "err_sigsupsearch", "err_sock_timeout", "err_roblimit"):
        setattr(task, name, name)
    for name in ("tool0", "wobj0", "fine"):
        setattr(task, name, name)
    return task


class Task:
    """The variables of one task; those declared PERS are shared with the other, and outlive it.

    A num is a float of 32 bits.
    """

    def __init__(self, shared: SimpleNamespace) -> None:
        self.__dict__.update(_shared=shared, _persistent=set())

    def __setattr__(self, name: str, value: Any) -> None:
        if isinstance(value, int | float) and not isinstance(value, bool):
            value = type(value)(*struct.unpack("f", struct.pack("f", value)))
        if name in self._persistent:
            setattr(self._shared, name, value)
        else:
            self.__dict__[name] = value

    def __getattr__(self, name: str) -> Any:
        return getattr(self._shared, name)


def _initial(type_: str, array: str, value: str) -> Any:
    if type_ == "robtarget":
        return robtarget(TAUGHT)
    if type_ in ("speeddata", "socketdev", "jointtarget", "pos"):
        return type_
    if type_ == "clock":
        return SimpleNamespace(began_s=math.nan)
    literal = ast.literal_eval(value.replace("TRUE", "True").replace("FALSE", "False"))
    return dict(enumerate(literal, 1)) if array else literal


def robtarget(pose: tuple[float, ...]) -> SimpleNamespace:
    x, y, z, *angles = pose
    return SimpleNamespace(trans=SimpleNamespace(x=x, y=y, z=z), rot=_orient(*angles))


def _orient(roll: float, pitch: float, yaw: float) -> SimpleNamespace:
    return SimpleNamespace(
        **dict(zip(("q1", "q2", "q3", "q4"), quaternion(roll, pitch, yaw), strict=True))
    )


class TurnOverError(Exception):
    """The background task waits for its next turn."""


class Builtins(StandIns):
    """Stand-ins for the instructions of the controller."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.server = LineServer(world)
        self.connected = False
        self.pending = ""
        self.in_background = False
        world.closing.append(lambda: self.socketclose(""))

    def socketcreate(self, _socket: str) -> None:
        self.connected = False

    def socketclose(self, _socket: str) -> None:
        self.connected = False

    def socketconnect(self, _socket: str, host: str, port: int, opt_time: float) -> None:
        assert host
        assert port
        assert opt_time > 0
        if self.world.link_is("refused"):
            raise ControllerError("err_sock_timeout")
        self.connected = True

    def socketsend(self, _socket: str, opt_str: str) -> None:
        if not self.connected:
            raise ControllerError("err_sock_closed")
        self.pending = self.server.answer(opt_str)

    def socketreceive(self, _socket: str, opt_str: Place, opt_time: float) -> None:
        assert 0 < opt_time < 1, "a receive without a limit waits for a minute"
        if self.world.link_is("closed"):
            raise ControllerError("err_sock_closed")
        if not self.pending:
            self.world.now_s += opt_time
            raise ControllerError("err_sock_timeout")
        half = min(max(len(self.pending) // 2, 1), 80)  # TCP is a stream: lines come in pieces
        opt_str.put(self.pending[:half])
        self.pending = self.pending[half:]

    def strmatch(self, text: str, start: int, pattern: str) -> int:
        self.strlen(text)
        assert 1 <= start <= len(text) + 1
        at = text.find(pattern, start - 1)
        return at + 1 if at >= 0 else len(text) + 1

    def strpart(self, text: str, start: int, length: int) -> str:
        assert 1 <= start <= len(text)
        assert start - 1 + length <= len(text)
        return text[start - 1 : start - 1 + length]

    def strlen(self, text: str) -> int:
        if len(text) > 80:
            raise ControllerError("err_strtoolng")
        return len(text)

    def strtoval(self, text: str, place: Place) -> bool:
        try:
            place.put(float(text))
        except ValueError:
            return False
        return True

    def numtostr(self, number: float, decimals: int) -> str:
        return f"{number:.{decimals}f}"

    def clkreset(self, clock: SimpleNamespace) -> None:
        clock.began_s = math.nan

    def clkstart(self, clock: SimpleNamespace) -> None:
        clock.began_s = self.world.now_s

    def clkread(self, clock: SimpleNamespace) -> float:
        return self.world.now_s - clock.began_s

    def distance(self, one: SimpleNamespace, other: SimpleNamespace) -> float:
        return math.dist((one.x, one.y, one.z), (other.x, other.y, other.z))

    def orientzyx(self, yaw: float, pitch: float, roll: float) -> SimpleNamespace:
        return _orient(roll, pitch, yaw)

    def reltool(self, place: SimpleNamespace, dx: float, dy: float, dz: float) -> SimpleNamespace:
        assert dx == dy == 0
        w, x, y, z = (getattr(place.rot, name) for name in ("q1", "q2", "q3", "q4"))
        tool_z = (2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z)
        trans = (place.trans.x, place.trans.y, place.trans.z)
        moved = (at + dz * along for at, along in zip(trans, tool_z, strict=True))
        return SimpleNamespace(
            trans=SimpleNamespace(**dict(zip("xyz", moved, strict=True))), rot=place.rot
        )

    def calcjointt(self, place: SimpleNamespace, tool: str, opt_wobj: str) -> str:
        assert (tool, opt_wobj) == ("tool0", "wobj0")
        if not self.world.reachable(place.trans.z):
            raise ControllerError("err_roblimit")
        return "joints"

    def cpos(self, opt_tool: str, opt_wobj: str) -> SimpleNamespace:
        assert (opt_tool, opt_wobj) == ("tool0", "wobj0")
        return SimpleNamespace(**dict(zip("xyz", self.world.stands_at, strict=True)))

    def movej(
        self, place: SimpleNamespace, _speed: str, zone: str, tool: str, opt_wobj: str
    ) -> None:
        assert (zone, tool, opt_wobj) == ("fine", "tool0", "wobj0")
        self.world.go(_tuple(place))

    def movel(
        self, place: SimpleNamespace, _speed: str, zone: str, tool: str, opt_wobj: str
    ) -> None:
        assert (zone, tool, opt_wobj) == ("fine", "tool0", "wobj0")
        self.world.go(_tuple(place), way="straight")

    def searchl(
        self,
        found: Callable[[], bool],
        _at: Place,
        place: SimpleNamespace,
        _speed: str,
        tool: str,
        *,
        opt_sstop: bool,
        opt_wobj: str,
    ) -> None:
        assert opt_sstop
        assert (tool, opt_wobj) == ("tool0", "wobj0")
        if found():
            raise ControllerError("err_sigsupsearch")
        if self.world.go(_tuple(place), found):
            raise ControllerError("err_whlsearch")

    def waittime(self, seconds: float) -> None:
        if self.in_background:
            raise TurnOverError
        self.world.told.append("pause")
        self.world.advance(seconds)

    def waituntil(
        self, holds: Callable[[], bool], opt_maxtime: float, opt_timeflag: Place
    ) -> None:
        opt_timeflag.put(not self.world.wait(holds, opt_maxtime))

    def tpwrite(self, text: str) -> None:
        assert len(text) <= 80
        self.world.told.append(text)

    def stop(self) -> None:
        self.world.halt()


def _tuple(place: SimpleNamespace) -> tuple[float, ...]:
    return (place.trans.x, place.trans.y, place.trans.z)


def run_rapid(source: str, world: World, settings: Mapping[str, object]) -> Outcome:
    """Take the flange to point 7, in a cell of stepped time."""
    shared = SimpleNamespace()
    tasks = [variables(source, shared) for _ in range(2)]
    builtins = [Builtins(world) for _ in tasks]
    front, back = (load(source, DIALECT, *pair) for pair in zip(tasks, builtins, strict=True))
    for task in tasks:
        task.__dict__.update(settings)
    tasks[1].vgrdtrig = world.first_trig
    tasks[0].vgrdask = tasks[0].vgrddone = world.asked_before
    builtins[1].in_background = True

    def begin() -> None:
        with suppress(TurnOverError):
            back.vgrdwatch()

    begin()
    world.background, world.restart = back.vgrdturn, begin
    world.period_s = tasks[1].vgrd_poll_s
    return run(world, lambda: front.vgrdgo(7, robtarget(TAUGHT)), lambda: tasks[0].vgrdword)
