"""Rules: what robots' programs and other clients do."""

import numpy as np

from tests.invariant.reading.robots import Asked
from tests.invariant.rig import Rig
from tests.invariant.rules.table import SEEDS, Among, Between, rule
from vgrd.registers import Command

CLIENTS = Among((0, 1))
POINTS = Among((1, 2, 3, 4, 5, 6))
OPTIONS = Among(
    (
        0x000,  # as the cell file says, flange, rotation vector
        0x001,  # not while the robot moves
        0x002,  # the TCP
        0x200,  # the wrist follows
        0x212,  # follows, TCP, roll pitch yaw
        0x120,  # fixed, KUKA
        0x130,  # fixed, ZYZ
        0x800,  # without a meaning
    )
)
TURNED_DOWN = (3_000_000, 100_000, 0)  # urad: a wrist that stands nearly as at the touches
UPSIDE_DOWN = (0, 0, 0)  # the tool points up, the flange is below the table
LYING = (1_800_000, 0, 0)


@rule(
    weight=20,
    client=CLIENTS,
    point=POINTS,
    fresh=Among((True, False)),
    options=OPTIONS,
    max_age_ms=Among((0, 0, 300)),
    patience_s=Between(0.0, 2.0),
)
def line_request(
    rig: Rig,
    client: int,
    point: int,
    fresh: bool,
    options: int,
    max_age_ms: int,
    patience_s: float,
) -> None:
    """A program without Modbus asks by a line, and polls it while the arm moves."""
    command = Command.EC_FRESH if fresh else Command.EC_NEWEST
    rig.ask_by_line(client, Asked(0, command, point, options, max_age_ms))
    rig.wait(patience_s)


@rule(client=CLIENTS)
def line_dropped(rig: Rig, client: int) -> None:
    rig.drop_by_line(client)


@rule("F42 F44", client=CLIENTS, seed=SEEDS)
def line_garbage(rig: Rig, client: int, seed: int) -> None:
    """Lines that are refused, halves of lines, and bytes that are no line."""
    rng = np.random.default_rng(seed)
    for data in (
        b"EC,1\nGO\n",
        b"EC,1,",
        bytes(rng.integers(0, 256, int(rng.integers(1, 300)), dtype=np.uint8)),
    ):
        rig.garbage_by_line(client, data)


@rule(
    weight=40,
    client=CLIENTS,
    point=POINTS,
    fresh=Among((True, False)),
    options=OPTIONS,
    patience_s=Between(0.0, 2.0),
)
def request(
    rig: Rig, client: int, point: int, fresh: bool, options: int, patience_s: float
) -> None:
    """A program asks for a point and reads on while the arm moves."""
    command = Command.EC_FRESH if fresh else Command.EC_NEWEST
    rig.ask(client, Asked(0, command, point, options))
    rig.wait(patience_s)


@rule(
    client=CLIENTS,
    point=POINTS,
    max_age_ms=Among((1, 300, 2000)),
    max_u95_um=Among((0, 1, 400)),
    timeout_ms=Among((0, 1, 150)),
)
def narrow_request(
    rig: Rig, client: int, point: int, max_age_ms: int, max_u95_um: int, timeout_ms: int
) -> None:
    """A program wants little age, little uncertainty, an answer at once."""
    rig.ask(
        client,
        Asked(0, Command.EC_NEWEST, point, 0, max_age_ms, max_u95_um, timeout_ms),
    )


@rule("S4", client=CLIENTS, point=Among((0, 1, 9, 65535)), command=Among((0, 2, 3, 4, 5)))
def odd_request(rig: Rig, client: int, point: int, command: int) -> None:
    """No such command, no such point, or a clear."""
    rig.ask(client, Asked(0, command, point))


@rule(client=CLIENTS, point=POINTS, again=Among((False, True)))
def oriented_request(rig: Rig, client: int, point: int, again: bool) -> None:
    """Policy 3: the orientation goes with the request, or is left over from the one before."""
    asked = Asked(0, Command.EC_FRESH, point, 0x300, orientation=TURNED_DOWN)
    rig.ask(client, asked)
    rig.wait(1.0)
    if again:
        rig.write(client, 0, [77, Command.EC_FRESH, point, 0x300])


# Not in the walk, which counts what is valid: this is always refused.
@rule(weight=0.0, client=CLIENTS, point=POINTS, orientation=Among((UPSIDE_DOWN, LYING)))
def leaning_request(rig: Rig, client: int, point: int, orientation: tuple[int, int, int]) -> None:
    """Policy 3 with a tool that would come from below, or lie."""
    rig.ask(client, Asked(0, Command.EC_FRESH, point, 0x300, orientation=orientation))
    rig.wait(1.0)


@rule("S5", weight=3, trigs=Among(((1, 2, 1), (5, 5), (1, 2, 3, 1))), gap_s=Between(0.0, 0.2))
def reused_trigs(rig: Rig, trigs: tuple[int, ...], gap_s: float) -> None:
    """Two programs that use the same TRIG for different points, one upon the other."""
    for number, trig in enumerate(trigs):
        rig.ask(number % 2, Asked(0, Command.EC_FRESH, number % 6 + 1), trig=trig)
        rig.wait(gap_s)


@rule("C4", client=CLIENTS, count=Among((5, 60)))
def request_storm(rig: Rig, client: int, count: int) -> None:
    """More requests than a cell that stands for a moment can read."""
    rig.daemon.stop("cell")
    for number in range(count):
        rig.ask(client, Asked(0, Command.EC_NEWEST, number % 6 + 1))
    rig.wait(0.1)
    rig.daemon.go_on("cell")


@rule("S5", client=CLIENTS, order=Among(("trig first", "point alone", "same trig")), point=POINTS)
def careless_writes(rig: Rig, client: int, order: str, point: int) -> None:
    """Registers of a request written one by one, in any order."""
    if order == "trig first":
        rig.write(client, 0, [int(rig.rng.integers(1, 5))])
        rig.write(client, 1, [Command.EC_FRESH, point])
    elif order == "point alone":
        rig.write(client, 2, [point])
    else:
        rig.write(client, 0, [3, Command.EC_FRESH, point])
        rig.write(client, 0, [3, Command.EC_FRESH, point % 6 + 1])


@rule(client=CLIENTS, address=Among((0, 1)))
def coil(rig: Rig, client: int, address: int) -> None:
    """A PLC that asks and clears by coils."""
    rig.coil(client, address, on=True)
    rig.wait(0.05)
    rig.coil(client, address, on=False)


@rule(client=CLIENTS)
def clear(rig: Rig, client: int) -> None:
    rig.write(client, 0, [0])


@rule("F42 F44", client=CLIENTS, seed=SEEDS)
def garbage(rig: Rig, client: int, seed: int) -> None:
    """Bytes that are no Modbus, frames that are cut, writes into a coordinate."""
    rng = np.random.default_rng(seed)
    for data in (
        bytes(rng.integers(0, 256, int(rng.integers(1, 300)), dtype=np.uint8)),
        b"\0\1\0\0\0\6\1\3\0",
        b"\0\1\0\0\0\6\1\6\0\x82\x12\x34",
        b"\0\1\0\0\0\6\0\x10\0\x64\0\1",
    ):
        rig.garbage(client, data)


@rule("F43 C11", count=Among((10, 100)))
def connections(rig: Rig, count: int) -> None:
    """A robot that connects again and again."""
    rig.crowd(count)


@rule("F45", seconds=Between(0.0, 70.0), weight=0.1)
def silence_of_a_client(rig: Rig, seconds: float) -> None:
    """Nobody reads for a while; connections that are idle end."""
    rig.robots.pause = True
    rig.wait(seconds)
    rig.robots.pause = False
