"""A register bank, the cell's side of it, and a clock that stands still."""

import struct
from dataclasses import replace

from fakes.testing import ManualClock
from vgrd.gate.image_feed import ImageFeed
from vgrd.gate.register_bank import RegisterBank
from vgrd.ipc.ring import RingWriter
from vgrd.registers import (
    PACKED_BYTES,
    REGISTER_KIND,
    REGISTER_RING,
    RESPONSE,
    Answer,
    Command,
    RegisterImage,
    Request,
    Scale16,
    State,
    Status,
    reply,
)

DEADLINE_S = 0.25
TIMEOUT_S = 5.0


class Bench:
    """A desk, the cell's side of it, and the clock."""

    def __init__(self, runtime_dir, scale=Scale16.MRAD):
        self.clock = ManualClock()
        self.runtime_dir = runtime_dir
        self.ring = None
        self.forwarded: list[Request] = []
        self.aborts = 0
        self.reachable = True
        self.bank = RegisterBank(
            ImageFeed(runtime_dir, self.clock),
            self.clock,
            deadline_s=DEADLINE_S,
            timeout_s=TIMEOUT_S,
            forward=self.forward,
            abort=self.abort,
            scale=scale,
        )

    def forward(self, request: Request) -> bool:
        """Take a request as the cell would."""
        if self.reachable:
            self.forwarded.append(request)
        return self.reachable

    def abort(self) -> None:
        """Count."""
        self.aborts += 1

    def start_cell(self) -> None:
        """Make the ring anew, as a cell that starts."""
        path = self.runtime_dir / REGISTER_RING
        self.ring = RingWriter.create(path, 4, PACKED_BYTES, REGISTER_KIND)

    def publish(self, answer: Answer | None = None, state: State = State.READY, beat=0) -> None:
        """Publish as the cell."""
        now = self.clock.monotonic()
        image = RegisterImage(answer or Answer(), state, beat, now)
        self.ring.publish(image.pack(), stamp_s=now)

    def answer(self, trig: int, seq: int, **more) -> Answer:
        """An answer that holds for a second, to the last request with that TRIG, 0: nobody's."""
        now = self.clock.monotonic()
        asked = [request for request in self.forwarded if request.trig == trig]
        to = reply(asked[-1], Status.OK) if asked else Answer(Status.OK)
        valid = {"captured_s": now, "valid_until_s": now + 1.0, "position_um": (1, 2, 3)}
        return replace(to, seq=seq, **{**valid, **more})

    def trigger(self, trig: int, command: int = Command.EC_FRESH, point=4, timeout_ms=0) -> None:
        """Write a request in one piece."""
        words = [trig, command, point, 0, 0, 0, 0, 0, 0, timeout_ms]
        assert self.bank.write_registers(0, struct.pack(">10H", *words))

    def see(self) -> dict[str, float]:
        """Read the response."""
        return RESPONSE.decode(self.bank.read_registers(100, 68))

    def status(self) -> tuple[float, float]:
        """ECHO and STATUS."""
        v = self.see()
        return v["ECHO"], v["STATUS"]
