"""What robots have written, by the words of docs/registers.md: which request is in force, if any."""

import struct
from dataclasses import replace

from tests.invariant.reading.robots import Asked
from vgrd.registers import REQUEST, Command

_CLEARS = 0


class Desk:
    """`asked` is the request that a valid answer must belong to; `state` the STATE that was read last.

    owner: the robot at a line whose request that is, None for one of the registers.
    """

    def __init__(self) -> None:
        self.state = 0
        self.forget()

    def forget(self) -> None:
        """The gate began anew: nothing is asked, nothing is written."""
        self.put(None)
        self._words = [0] * REQUEST.end
        self._parameters: tuple[int, ...] = ()
        self._coils = [False, False]

    def put(self, asked: Asked | None, owner: object = None) -> None:
        """Only this is asked from now on."""
        self.asked, self.owner = asked, owner

    def wrote(self, address: int, words: list[int], now_s: float) -> None:
        """Registers were written, and the gate has said so."""
        old = self._words[0]
        self._words[address : address + len(words)] = words
        if self._words[0] != old:
            self._triggered(now_s)
        elif address == 0 and old and self._written_parameters() != self._parameters:
            self._parameters = self._written_parameters()
            self.put(None)  # the same TRIG with other parameters is refused

    def wrote_coil(self, address: int, on: bool, now_s: float) -> None:
        """A coil was written; rising edges count."""
        rises = on and not self._coils[address]
        self._coils[address] = on
        if rises and address == 1:
            self.put(None)
        elif rises:
            self._words[0] = self._words[0] % 0xFFFF + 1
            self._triggered(now_s)

    def _triggered(self, now_s: float) -> None:
        self._parameters = self._written_parameters()
        values = REQUEST.decode(struct.pack(f">{REQUEST.end}H", *self._words))
        asked = Asked(
            trig=int(values["TRIG"]),
            command=int(values["CMD"]),
            point=int(values["POINT"]),
            options=int(values["OPT"]),
            max_age_ms=int(values["MAXAGE"]),
            max_u95_um=int(values["MAXU95"]),
            timeout_ms=int(values["TMO"]),
            orientation=(int(values["ORI_RX"]), int(values["ORI_RY"]), int(values["ORI_RZ"])),
            at_s=now_s,
        )
        clears = asked.trig == _CLEARS or asked.command == Command.CLEAR
        self.put(None if clears else replace(asked))

    def _written_parameters(self) -> tuple[int, ...]:
        return (*self._words[1:10], *self._words[23:])
