"""KRL: its lines, its built-ins (names and arity from manuals and examples), and stand-ins for them."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from tests.robot_programs.brands.lines import LineServer
from tests.robot_programs.brands.outcome import Outcome, run
from tests.robot_programs.brands.stand_ins import StandIns
from tests.robot_programs.brands.translation import Dialect, Place, Rule, load
from tests.robot_programs.brands.world import TAUGHT, World

CHANNEL = Path(__file__).parents[3] / "config/robot_programs/kuka/Vgrd.xml"
BUILTINS = {
    "abs": "in",
    "sin": "in",
    "cos": "in",
    "sqrt": "in",
    "inverse": "in in out",
    "bas": "in in",
    "eki_init": "in",
    "eki_open": "in",
    "eki_clear": "in",
    "eki_clearbuffer": "in in",
    "eki_send": "in in",
    "eki_setint": "in in in",
    "eki_getint": "in in out",
    "eki_getreal": "in in out",
}
DIALECT = Dialect(
    name="KRL",
    comment=";",
    routine=r"(GLOBAL )?DEF (?P<name>\w+)\((?P<parameters>.*)\)$",
    end=r"END$",
    equal="==",
    assign="=",
    ignored=r"(DECL|INT|REAL|BOOL|E6POS) |TAUGHT_\w+=\{",
    marks={"/": "//"},  # of two INT, as it is used here
    builtins=BUILTINS,
    rules=(
        Rule(r"IF (.+) THEN", "if {0}:", after=1),
        Rule(r"ENDIF", before=-1),
        Rule(r"WHILE (.+)", "while {0}:", after=1),
        Rule(r"ENDWHILE", before=-1),
        Rule(r"SWITCH (.+)", "case = {0}\nif False:", after=1),
        Rule(r"CASE (.+)", "elif case in ({0},):", -1, 1),
        Rule(r"ENDSWITCH", before=-1),
        Rule(r"RETURN", "return"),
        Rule(r"WAIT SEC (.+)", "b.wait_sec({0})"),
        Rule(r"PTP (\w+)", "b.ptp({0})"),
        Rule(r"LIN (\w+)", "b.lin({0})"),
        Rule(r"HALT", "b.halt()"),
        Rule(r"BRAKE", "b.brake()"),
        Rule(r"RESUME", "b.resume()"),
        Rule(
            r"INTERRUPT DECL (\d+) WHEN (.+) DO (\w+)\(\)",
            lambda line, m: f"b.declare({m[1]}, lambda: {line.value(m[2])}, f.{m[3].lower()})",
        ),
        Rule(r"INTERRUPT ON (\d+)", "b.arm({0})"),
        Rule(r"INTERRUPT OFF (\d+)", "b.disarm({0})"),
    ),
)
_DECLARED = re.compile(r"^DECL GLOBAL (\w+) (\w+)(?:=(.+))?$", re.MULTILINE)
_FIELDS = ("x", "y", "z", "c", "b", "a")  # of roll, pitch, yaw


class ResumeError(Exception):
    """RESUME: ends all routines below the one that declared the interrupt."""


class Timers(dict[int, float]):
    """$TIMER: milliseconds that go on while $TIMER_STOP is FALSE."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.stopped: dict[int, bool] = {}

    def __setitem__(self, number: int, value: float) -> None:
        super().__setitem__(number, self.world.now_s - value / 1000)

    def __getitem__(self, number: int) -> float:
        assert self.stopped[number] is False
        return (self.world.now_s - super().__getitem__(number)) * 1000


class TimerFlags:
    """$TIMER_FLAG: whether a timer has run above zero."""

    def __init__(self, timers: Timers) -> None:
        self._timers = timers

    def __getitem__(self, number: int) -> bool:
        return self._timers[number] > 0


class Channel:
    """EthernetKRL on the shipped channel file: only what stands there can be set and read."""

    def __init__(self, world: World, flags: dict[int, bool]) -> None:
        root = ET.parse(CHANNEL).getroot()  # noqa: S314, our own file
        self.received = {e.attrib["Tag"]: e.attrib for e in root.iterfind("RECEIVE/XML/ELEMENT")}
        self.sent = [e.attrib["Tag"] for e in root.iterfind("SEND/XML/ELEMENT")]
        self.alive = int(root.find("CONFIGURATION/INTERNAL/ALIVE").attrib["Set_Flag"])
        self.server, self.flags, self.world = LineServer(world), flags, world
        self.made = False
        self.values: dict[str, int] = {}
        self.memory: dict[str, list[str]] = {tag: [] for tag in self.received}

    def send(self, root: str) -> None:
        """Send a document, and store what comes back, element by element."""
        document = ET.Element(root)
        for tag in self.sent:
            document.set(tag.removeprefix(f"{root}/@"), str(self.values[tag]))
        answer = self.server.answer(ET.tostring(document, encoding="unicode"))
        if not answer:
            return
        for tag, attributes in self.received.items():
            element, _, attribute = tag.partition("/@")
            value = _within(ET.fromstring(answer), element)  # noqa: S314, from our own stand-in
            if value is not None and (not attribute or attribute in value.attrib):
                self.memory[tag].append(value.get(attribute, ""))
                assert len(self.memory[tag]) <= 16, "EthernetKRL closes the connection"
                if "Set_Flag" in attributes:
                    self.flags[int(attributes["Set_Flag"])] = True


def _within(root: ET.Element, path: str) -> ET.Element | None:
    name, _, rest = path.partition("/")
    if root.tag != name:
        return None
    return root.find(rest) if rest else root


class Builtins(StandIns):
    """Stand-ins for the functions of the controller."""

    def __init__(self, world: World, v: SimpleNamespace) -> None:
        self.world, self.v = world, v
        self.channel = Channel(world, v.sys_flag)
        self.depth, self.declared_at = 0, -1
        self.interrupts: dict[int, tuple[Callable[[], bool], Callable[[], None]]] = {}
        self.armed: set[int] = set()
        world.closing.append(lambda: v.sys_flag.update({self.channel.alive: False}))

    def run(self, routine: Callable[..., None], *arguments: Any) -> None:
        """Call a routine; RESUME comes back to the level that declared the interrupt."""
        self.depth += 1
        try:
            routine(*arguments)
        except ResumeError:
            if self.depth - 1 != self.declared_at:
                raise
        finally:
            self.depth -= 1

    def declare(self, number: int, holds: Callable[[], bool], routine: Callable[[], None]) -> None:
        self.declared_at, self.interrupts[number] = self.depth, (holds, routine)

    def arm(self, number: int) -> None:
        holds, _ = self.interrupts[number]
        if not holds():  # an edge is waited for
            self.armed.add(number)

    def disarm(self, number: int) -> None:
        self.armed.discard(number)

    def _due(self) -> Callable[[], None] | None:
        """The routine of an interrupt whose condition has come."""
        due = (self.interrupts[number] for number in sorted(self.armed))
        return next((routine for holds, routine in due if holds()), None)

    def brake(self) -> None:
        self.world.told.append("brake")

    def resume(self) -> None:
        assert self.world.told[-1] == "brake"
        raise ResumeError

    def bas(self, command: str, value: int) -> None:
        self.world.told.append(f"{command} {value}")

    def ptp(self, place: SimpleNamespace) -> None:
        self._flange()
        self.world.go(_tuple(place))

    def lin(self, place: SimpleNamespace) -> None:
        self._flange()
        if self.armed:
            if not self.world.go(_tuple(place), lambda: self._due() is not None):
                self.run(self._due())
        else:
            self.world.go(_tuple(place), way="straight")

    def _flange(self) -> None:
        assert self.v.sys_base == self.v.sys_tool == "nullframe"
        assert self.v.sys_advance == 0

    def wait_sec(self, seconds: float) -> None:
        if seconds == self.v.vgrd_pause_s:
            self.world.told.append("pause")
        self.world.advance(seconds)

    def halt(self) -> None:
        self.world.halt()

    def inverse(self, place: SimpleNamespace, axes: str, error: Place) -> str:
        assert axes == "axes"
        assert (place.s, place.t) == (2, 2)
        error.put(0 if self.world.reachable(place.z) else 1)
        return "joints"

    def eki_init(self, _name: str) -> SimpleNamespace:
        assert not self.channel.made, "EKI00023"
        self.channel.made = True
        return _status(0)

    def eki_open(self, _name: str) -> SimpleNamespace:
        self.v.sys_flag[self.channel.alive] = not self.world.link_is("refused")
        return _status(0)

    def eki_clear(self, _name: str) -> SimpleNamespace:
        assert self.channel.made, "EKI00009"
        self.channel.made = False
        return _status(0)

    def eki_clearbuffer(self, _name: str, _root: str) -> SimpleNamespace:
        for values in self.channel.memory.values():
            values.clear()
        return _status(0)

    def eki_setint(self, _name: str, tag: str, value: int) -> SimpleNamespace:
        assert tag in self.channel.sent
        assert isinstance(value, int)
        self.channel.values[tag] = value
        return _status(0)

    def eki_send(self, _name: str, root: str) -> SimpleNamespace:
        assert self.v.sys_flag[self.channel.alive]
        if self.world.link_is("closed"):
            self.v.sys_flag[self.channel.alive] = False
            return _status(1)
        self.channel.send(root)
        return _status(0)

    def eki_getint(self, _name: str, tag: str, place: Place) -> SimpleNamespace:
        return self._get(tag, place, "INT", int)

    def eki_getreal(self, _name: str, tag: str, place: Place) -> SimpleNamespace:
        return self._get(tag, place, "REAL", float)

    def _get(
        self, tag: str, place: Place, type_: str, of: Callable[[str], Any]
    ) -> SimpleNamespace:
        assert self.channel.received[tag]["Type"] == type_
        if not self.channel.memory[tag]:
            return _status(1)
        place.put(of(self.channel.memory[tag].pop(0)))
        return _status(0)


def _status(number: int) -> SimpleNamespace:
    return SimpleNamespace(msg_no=number)


def _tuple(place: SimpleNamespace) -> tuple[float, ...]:
    return (place.x, place.y, place.z)


def e6pos(pose: tuple[float, ...]) -> SimpleNamespace:
    return SimpleNamespace(**dict(zip(_FIELDS, pose, strict=True)), s=2, t=2)


class Variables(SimpleNamespace):
    """The variables of both interpreters; $POS_ACT is where the arm stands."""

    _world: World

    @property
    def sys_pos_act(self) -> SimpleNamespace:
        return e6pos((*self._world.stands_at, *TAUGHT[3:]))


def variables(source: str, world: World) -> SimpleNamespace:
    """Return what the data lists declare, and the system variables that are used."""
    v = Variables(_world=world)
    for type_, name, value in _DECLARED.findall(source):
        text = {"TRUE": "1", "FALSE": "0"}.get(value, value)
        of: Mapping[str, Callable[[str], Any]] = {
            "INT": int,
            "REAL": float,
            "BOOL": lambda text: text == "1",
        }
        setattr(v, name.lower(), of[type_](text) if type_ in of else e6pos(TAUGHT))
    v.sys_flag = dict.fromkeys(range(1, 1000), False)
    v.sys_timer = Timers(world)
    v.sys_timer_stop = v.sys_timer.stopped
    v.sys_timer_flag = TimerFlags(v.sys_timer)
    v.sys_vel = SimpleNamespace(cp=0)
    v.sys_nullframe, v.sys_axis_act = "nullframe", "axes"
    return v


def run_krl(source: str, world: World, settings: Mapping[str, object]) -> Outcome:
    """Take the flange to point 7, in a cell of stepped time."""
    v = variables(source, world)
    v.__dict__.update(settings)
    v.vgrd_trig_no = world.first_trig
    v.vgrd_ask = v.vgrd_done = world.asked_before
    builtins = [Builtins(world, v) for _ in range(2)]
    front, back = (load(source, DIALECT, v, b) for b in builtins)
    back.vgrd_setup()
    world.background, world.restart = back.vgrd_turn, back.vgrd_setup
    world.period_s = 0.025
    world.decides_within_s = 0.045  # it reads in the turn after the one that sends
    return run(world, lambda: front.vgrd_go(7, e6pos(TAUGHT)), lambda: v.vgrd_word)
