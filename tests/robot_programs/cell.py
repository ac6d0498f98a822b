"""A cell that answers in stepped time behind the real register bank, and what can go wrong on the way to a client."""

import struct
from collections.abc import Callable
from dataclasses import replace

from tests.gate.register_bank.bench import Bench
from vgrd.gate.pdu import respond
from vgrd.registers import RESPONSE, Answer, Request, State, Status, reply

LATENCY_S = 0.15  # from a request to its answer; the fake cell takes 0.1 to 0.5 s
PUBLISHED_S = 0.02  # as the cell does
EXPIRES_S = 3.0  # max_age_s of the cell file, by default
PICTURE_AGE_S = 0.1  # of an answer that comes
FIELDS = {field.name: field for field in RESPONSE.fields}
READS = (3, 4, 23)  # functions whose answer is words

Tamper = Callable[[list[int], int], None]


def put(words: list[int], first: int, name: str, value: int) -> None:
    """Put a value into the words that were read from register `first` on, if it is among them."""
    field = FIELDS[name]
    for index in range(field.count):
        at = field.address + index - first
        if 0 <= at < len(words):
            words[at] = value >> 16 * (field.count - 1 - index) & 0xFFFF


class Cell(Bench):
    """Answers each request with `coordinate` (um, urad); every fault is a field that a scenario sets.

    alive: the cell publishes. link: the network carries. impostor: something in between goes on
    answering with what was read last. tamper: changes words on their way to the client.
    """

    def __init__(self, runtime_dir, coordinate: tuple[int, ...]):
        super().__init__(runtime_dir)
        self.coordinate = self.standing_coordinate = self._taught_coordinate = coordinate
        self.trigs: list[int] = []
        self.standing = Answer()
        self.seq = 7
        self._due: tuple[float, Request] | None = None
        self._published_s = 0.0
        self._copy: bytes | None = None
        self.start_cell()
        self.heal()

    def heal(self) -> None:
        """Nothing is wrong any more."""
        self.__dict__.pop("found", None)  # a scenario may find other answers
        self.alive = self.link = self.answering = True
        self.impostor, self._copy = False, None
        self.tamper: Tamper | None = None
        self.refuse_with: Status | None = None
        self.picture_age_s = PICTURE_AGE_S
        self.u95_um = 300
        self.degraded = False
        self.coordinate = self._taught_coordinate

    def forward(self, request: Request) -> bool:
        """Take a request as the cell would."""
        self.trigs.append(request.trig)
        self._due = (self.clock.monotonic() + LATENCY_S, request)
        return True

    def advance(self) -> None:
        """Do what is due at this time of the clock."""
        now_s = self.clock.monotonic()
        if not self.alive or now_s - self._published_s < PUBLISHED_S:
            return
        if self._due and now_s >= self._due[0] and self.answering:
            self.standing, self._due = self.found(self._due[1], now_s), None
        self._published_s = now_s
        self.publish(self.standing, State.READY, beat=int(now_s / 0.1))

    def end(self, status: Status) -> None:
        """The answer that stands ends."""
        self.standing = replace(self.standing, status=status)

    def answer_anew(self) -> None:
        """Another answer takes its place, to the same request."""
        self.seq += 1
        position, rotation = self._shown()
        self.standing = replace(
            self.standing, seq=self.seq, position_um=position, rotation=rotation
        )

    def exchange(self, pdu: bytes) -> bytes | None:
        """What a client's request is answered with; None: nothing comes."""
        if not self.link:
            return None
        answer = self._remembered(pdu) if self.impostor else respond(self.bank, pdu)
        if pdu[0] not in READS or answer[0] != pdu[0]:
            return answer
        words = list(struct.unpack(f">{answer[1] // 2}H", answer[2:]))
        if self.tamper:
            self.tamper(words, struct.unpack(">H", pdu[1:3])[0])
        return answer[:2] + struct.pack(f">{len(words)}H", *words)

    def _remembered(self, pdu: bytes) -> bytes:
        """As the server would answer whose registers stand still since the first time."""
        if self._copy is None:
            self._copy = self.bank.read_registers(RESPONSE.start, RESPONSE.end - RESPONSE.start)
        if pdu[0] not in READS:
            return pdu[:5]
        first, count = struct.unpack(">HH", pdu[1:5])
        at = 2 * (first - RESPONSE.start)
        return bytes((pdu[0], 2 * count)) + self._copy[at : at + 2 * count]

    def found(self, request: Request, now_s: float) -> Answer:
        self.seq += 1
        if self.refuse_with is not None:
            return replace(reply(request, self.refuse_with), seq=self.seq)
        position, rotation = self._shown()
        captured_s = now_s - self.picture_age_s
        return replace(
            reply(request, Status.OK_DEGRADED if self.degraded else Status.OK),
            seq=self.seq,
            captured_s=captured_s,
            valid_until_s=captured_s + EXPIRES_S,
            position_um=position,
            rotation=rotation,
            u95_um=self.u95_um,
        )

    def _shown(self) -> tuple[tuple[int, ...], tuple[float, ...]]:
        """The coordinate that an answer holds from now on."""
        self.standing_coordinate = self.coordinate
        return self.coordinate[:3], tuple(urad * 1e-6 for urad in self.coordinate[3:])
