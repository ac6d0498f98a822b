"""What every program is judged by: one fault each, and the decision that it must take."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

from tests.robot_programs.brands.world import SERVED, TAUGHT, Fault, Reading
from vgrd.registers.decisions import DECISIONS, LIMITS, STATUS_REACTIONS, Reaction

NUMBERS = {decision.word: decision.number for decision in DECISIONS}
LIMIT = {limit.word: limit.value for limit in LIMITS}
BOX = ((300, 700), (-300, 300), (50, 500))  # as the programs have it before a user edits it


@dataclass(frozen=True)
class Scenario:
    """word: the decision, "USE" where all hold. again: whether the program asks again.

    settings: what the user chose otherwise.
    keys: how often the operator presses the key; the fault is gone then.
    """

    name: str
    word: str
    again: bool
    fault: Fault
    settings: Mapping[str, object] = field(default_factory=dict)
    keys: int = 0

    def __str__(self) -> str:
        return self.name.replace(" ", "_")


def changed(**fields: object) -> Fault:
    """Return a fault that changes a good answer."""
    return Fault(lambda reading: replace(reading, **fields) if reading.good else reading)


def _pose(axis: int, value: float) -> tuple[float, ...]:
    return (*SERVED[:axis], value, *SERVED[axis + 1 :])


def _turned(degrees: float) -> tuple[float, ...]:
    return (*SERVED[:3], TAUGHT[3], TAUGHT[4], degrees)


def _accepting() -> list[Scenario]:
    found = [
        Scenario("all holds", "USE", again=False, fault=Fault()),
        Scenario("degraded", "STATUS", again=False, fault=changed(status=2, block_status=2)),
        Scenario("no link", "LINK", again=False, fault=Fault(lambda r: replace(r, link=False))),
        Scenario(
            "no heartbeat", "HEARTBEAT", again=False, fault=Fault(lambda r: replace(r, beat=-1))
        ),
        Scenario(
            "another trig", "ECHO", again=True, fault=Fault(lambda r: replace(r, echo=r.trig + 1))
        ),
        Scenario("busy for ever", "ECHO", again=True, fault=changed(status=10)),
        Scenario("age at its limit", "USE", again=False, fault=changed(age_ms=LIMIT["AGE_MS"])),
        Scenario("too old", "AGE", again=True, fault=changed(age_ms=LIMIT["AGE_MS"] + 1)),
        Scenario("U95 at its limit", "USE", again=False, fault=changed(u95_um=LIMIT["U95_UM"])),
        Scenario("too uncertain", "U95", again=False, fault=changed(u95_um=LIMIT["U95_UM"] + 1)),
        Scenario(
            "0 at first, then good",
            "USE",
            again=True,
            fault=replace(changed(status=302), since="recovered"),
        ),
    ]
    for status, (reaction, _) in STATUS_REACTIONS.items():
        if status not in (1, 2, 10):
            again = reaction is Reaction.ASK_AGAIN
            found.append(
                Scenario(f"status {status:d}", "STATUS", again, changed(status=int(status)))
            )
    for state in ("refused", "closed"):
        found.append(Scenario(f"link {state}", "LINK", False, Fault(link=state), keys=1))
    found.append(Scenario("a status of later", "STATUS", again=False, fault=changed(status=777)))
    allowed = changed(status=2, block_status=2)
    found.append(
        Scenario("degraded allowed", "USE", False, allowed, settings={"vgrd_degraded_ok": True})
    )
    return found


def _placing() -> list[Scenario]:
    found = []
    for axis in range(6):
        poses = changed(pose=_pose(axis, math.nan))
        found.append(Scenario(f"sentinel {axis + 1}", "SENTINEL", again=False, fault=poses))
    for axis, (low, high) in enumerate(BOX):
        for value in (low - 0.1, high + 0.1):
            found.append(
                Scenario(
                    f"outside {axis + 1} {value}", "BOX", False, changed(pose=_pose(axis, value))
                )
            )
    found += [
        Scenario("far", "STEP", again=False, fault=changed(pose=_pose(0, TAUGHT[0] + 60))),
        Scenario("far aside", "STEP", again=False, fault=changed(pose=_pose(1, TAUGHT[1] - 60))),
        Scenario("far above", "STEP", again=False, fault=changed(pose=_pose(2, TAUGHT[2] + 60))),
        Scenario("far sum", "STEP", again=False, fault=changed(pose=(535, 35, 235, *SERVED[3:]))),
        Scenario("turned within", "USE", again=False, fault=changed(pose=_turned(19.9))),
        Scenario("turned", "STEP", again=False, fault=changed(pose=_turned(20.1))),
        Scenario("turned back", "STEP", again=False, fault=changed(pose=_turned(-20.1))),
        Scenario("tilted", "STEP", again=False, fault=changed(pose=_pose(4, 21.0))),
        Scenario("rolled", "STEP", again=False, fault=changed(pose=_pose(3, 155.0))),
        Scenario(
            "same wrist, other sign", "USE", again=False, fault=changed(pose=_pose(3, -179.5))
        ),
        Scenario(
            "same wrist, other angles",
            "USE",
            again=False,
            fault=changed(pose=(*SERVED[:3], 0, 180, 180)),
        ),
    ]
    return found


def _registers() -> list[Scenario]:
    cases = (
        ("another map", "MAP_VERSION", False, {"mapver": 0x0200}),
        ("another point", "POINT", False, {"point": 9}),
        ("another object", "POINT", False, {"object": 9}),
        ("status of the block", "STATUS", False, {"block_status": 602}),
        ("another rotation format", "FORMAT", False, {"format": 0}),
        ("of the TCP", "FORMAT", False, {"format": 0x11}),
        ("odd seq", "SEQ", True, {"seq": 9, "block_seq": 9}),
        ("torn seq", "SEQ", True, {"block_seq": 10}),
        ("echo of the block", "SEQ", True, {"block_echo": 77}),
    )
    return [Scenario(name, word, again, changed(**fields)) for name, word, again, fields in cases]


def _losing() -> list[Scenario]:
    """Lost on the way: the arm stops."""
    changes = {
        "hidden": changed(status=302, pose=(math.nan,) * 6).change,
        "no link": lambda r: replace(r, link=False),
        "no heartbeat": lambda r: replace(r, beat=-1),
        "another trig": lambda r: replace(r, echo=r.trig + 1),
        "degraded": changed(status=2).change,
    }
    found = []
    for leg in ("approach", "last"):
        for name, change in changes.items():
            found.append(
                Scenario(
                    f"{name} in {leg} leg",
                    "POLL",
                    again=False,
                    fault=Fault(change, leg),
                )
            )
    found.append(
        Scenario(
            "answer of later",
            "POLL",
            again=False,
            fault=Fault(_another_answer, "approach"),
        )
    )
    return found


def _another_answer(reading: Reading) -> Reading:
    return replace(reading, seq=reading.seq + 2)


def _ended() -> list[Scenario]:
    """A leg is over, and the arm does not stand where it was sent."""
    found = []
    for leg in ("approach", "last"):
        near = Fault(since=leg, off=(0.25, -0.25, 0.25))
        found.append(Scenario(f"ended by chance near, {leg} leg", "USE", False, near))
        for axis, off in enumerate(((0.6, 0, 0), (0, -0.6, 0), (0, 0, 0.6))):
            fault = Fault(since=leg, off=off)
            found.append(
                Scenario(f"ended elsewhere {axis + 1}, {leg} leg", "APPROACH", False, fault)
            )
    return found


def _moving() -> list[Scenario]:
    pushed = replace(changed(pose=_pose(0, SERVED[0] + 0.6)), since="second")
    turned = replace(changed(pose=_pose(5, SERVED[5] + 0.6)), since="second")
    near = replace(changed(pose=_pose(0, SERVED[0] + 0.4)), since="second")
    hidden = replace(changed(status=302), since="second")
    return [
        Scenario("unreachable", "REACH", False, Fault(unreachable="low")),
        Scenario("approach unreachable", "REACH", False, Fault(unreachable="high")),
        Scenario(
            "hidden before it goes", "POLL", False, replace(changed(status=302), since="answered")
        ),
        Scenario(
            "unreachable second",
            "REACH",
            False,
            Fault(unreachable="low high", since="second"),
        ),
        Scenario("pushed between", "ASK_AGAIN", again=True, fault=pushed),
        Scenario("turned between", "ASK_AGAIN", again=True, fault=turned),
        Scenario("moved by chance", "USE", again=False, fault=near),
        Scenario("hidden at the second", "STATUS", again=True, fault=hidden),
        Scenario("task died", "LINK", again=False, fault=Fault(task_dies=True)),
        Scenario(
            "task died, old place out of reach",
            "LINK",
            False,
            Fault(task_dies=True, unreachable="low high"),
        ),
        Scenario(
            "task died once answered",
            "LINK",
            False,
            Fault(since="answered", task_dies=True),
        ),
        Scenario(
            "hidden, old place out of reach",
            "STATUS",
            True,
            replace(changed(status=302), unreachable="low high"),
        ),
        Scenario(
            "hidden at the second, out of reach",
            "STATUS",
            True,
            replace(hidden, unreachable="low high"),
        ),
        Scenario(
            "pushed out of reach", "ASK_AGAIN", True, replace(pushed, unreachable="low high")
        ),
    ]


def _garbled() -> list[Scenario]:
    garbles: dict[str, Callable[[str], str]] = {
        "cut off": lambda line: line[:7] + "\n",
        "one field more": lambda line: line.rstrip() + ",5\n",
        "one field less": lambda line: line.rpartition(",")[0] + "\n",
        "words": lambda line: line.replace("512.35", "five"),
        "empty field": lambda line: line.replace("512.35", ""),
        "nothing but an end": lambda _line: "\n",
        "no end": str.rstrip,
        "a flood": lambda _line: "7" * 300,
    }
    return [
        Scenario(name, "LINK", False, Fault(garble=garble)) for name, garble in garbles.items()
    ]


def _lacking() -> list[Scenario]:
    """Documents of XML without one of their values."""
    found = []
    for name in ("Echo", "Status", "Age", "Hb", "U95", "X", "Y", "Z", "A", "B", "C"):
        garble = partial(re.sub, f' {name}="[^"]*"', "")
        found.append(Scenario(f"without {name}", "LINK", False, Fault(garble=garble)))
    return found


def _orphaned() -> list[Scenario]:
    """The task that looks after the answer ends while the arm is under way."""
    faults = {leg: Fault(since=leg, task_dies=True) for leg in ("approach", "last")}
    return [
        Scenario(f"no heartbeat of the task in {leg} leg", "POLL", False, fault)
        for leg, fault in faults.items()
    ]


def _restarted() -> list[Scenario]:
    """The task that looks after the answer is started anew while the arm is under way."""
    faults = {leg: Fault(since=leg, task_restarts=True) for leg in ("approach", "last")}
    return [
        Scenario(f"task began anew in {leg} leg", "POLL", False, fault)
        for leg, fault in faults.items()
    ]


ACCEPTING = [*_accepting(), *_placing()]
REGISTERS = [
    *ACCEPTING,
    *_registers(),
    *(scenario for scenario in _losing() if scenario.fault.since == "approach"),
    *_ended(),
]
ROBOTS = [*ACCEPTING, *_losing()[:-1], *_ended(), *_moving(), *_restarted()]
LINES = [*ROBOTS, *_garbled()]
DOCUMENTS = [*ROBOTS, *_orphaned(), *_lacking()]
