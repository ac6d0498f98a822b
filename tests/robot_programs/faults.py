"""What goes wrong around a robot program: in the cell, on the way to the client, in the arm."""

import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import count

from tests.robot_programs.cell import FIELDS, put
from tests.robot_programs.world import COORDINATE, World
from vgrd.registers import Command, Status

Fault = Callable[[World], None]


def get(words: list[int], first: int, name: str) -> int:
    """A value of up to two words among those that were read, 0 when it is not."""
    field = FIELDS[name]
    if not first <= field.address < first + len(words):
        return 0
    value = 0
    for at in range(field.address - first, field.address - first + field.count):
        value = value << 16 | words[at]
    return value


def seal(words: list[int], first: int) -> None:
    """Give the int32 block the CRC of what it holds, if all of it was read."""
    start, crc = (FIELDS[name].address - first for name in ("EC32_X", "EC32_CRC"))
    if start >= 0 and crc + 2 <= len(words):
        block = struct.pack(f">{crc - start}H", *words[start:crc])
        put(words, first, "EC32_CRC", zlib.crc32(block))


def shown(**values: int) -> Fault:
    """Registers that hold something else, as whoever wrote them meant it."""

    def tamper(words: list[int], first: int) -> None:
        for name, value in values.items():
            put(words, first, name, value)
        seal(words, first)

    return lambda world: setattr(world.cell, "tamper", tamper)


def added(**steps: int) -> Fault:
    """Registers that are off by so much, as whoever wrote them meant it."""

    def tamper(words: list[int], first: int) -> None:
        _add(words, first, steps)
        seal(words, first)

    return lambda world: setattr(world.cell, "tamper", tamper)


def damaged(**steps: int) -> Fault:
    """Registers that are off by so much, since something on the way changed or mixed them."""

    def tamper(words: list[int], first: int) -> None:
        _add(words, first, steps)

    return lambda world: setattr(world.cell, "tamper", tamper)


def _add(words: list[int], first: int, steps: Mapping[str, int]) -> None:
    for name, step in steps.items():
        old = get(words, first, name)
        if old:
            put(words, first, name, old + step)


def of_cell(**values: object) -> Fault:
    """The cell is so."""

    def fault(world: World) -> None:
        for name, value in values.items():
            setattr(world.cell, name, value)

    return fault


def found_at(*offset: int) -> Fault:
    """The object is elsewhere by so many um and urad."""
    moved = tuple(a + b for a, b in zip(COORDINATE, offset, strict=True))
    return of_cell(coordinate=moved)


def ends(status: Status) -> Fault:
    """The answer that stands ends with a status."""
    return lambda world: world.cell.end(status)


def expires(world: World) -> None:
    """The answer that stands is too old from now on."""
    world.cell.standing = replace(world.cell.standing, valid_until_s=world.clock.monotonic())


def another_asks(world: World) -> None:
    """Another client writes into the same request registers."""
    world.cell.trigger(40_000, Command.EC_FRESH, point=1)


def earlier_program(world: World) -> None:
    """A program that was started before asked the very same, and its answer stands."""
    registers = bytearray(64)
    registers[0:6] = bytes((0, 1, 0, Command.EC_FRESH, 0, 1))
    world.cell.bank.write_registers(0, bytes(registers))
    for _ in range(20):
        world.clock.sleep(0.02)
        world.cell.advance()
        world.cell.bank.refresh()


def last_trigs(world: World) -> None:
    """The program has asked 65,534 times."""
    world.first_trig = 0xFFFE


def half_good(bad: Status) -> Fault:
    """The first answer is a refusal, then all is well."""

    def fault(world: World) -> None:
        cell = world.cell
        found = cell.found

        def first_bad(*of: object):
            cell.found = found
            cell.refuse_with = bad
            refusal = found(*of)
            cell.refuse_with = None
            return refusal

        cell.found = first_bad

    return fault


def pushed_each_time(world: World) -> None:
    """The object is elsewhere in every answer."""
    numbers, found, cell = count(1), world.cell.found, world.cell

    def elsewhere(*of: object):
        x, *rest = COORDINATE
        cell.coordinate = (x + 2000 * (next(numbers) % 2), *rest)
        return found(*of)

    cell.found = elsewhere


def stuck(world: World) -> None:
    """Something stops the arm on its way."""
    world.arm.stuck = True


def out_of_reach(what: str) -> Fault:
    """The arm cannot get there as taught."""
    return lambda world: world.arm.out_of_reach.append(what)


def nothing(_: World) -> None:
    """All is well."""
