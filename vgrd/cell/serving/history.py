"""What robots were answered lately, for people: no answer depends on it."""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass

from vgrd.clock import Clock
from vgrd.registers import Answer, Status
from vgrd.registers.answer import LARGEST32

_KEPT = 50  # answers; chosen: some minutes of a busy cell


@dataclass(frozen=True, slots=True)
class Answered:
    """One answer as it was given. latency_s: from the request's arrival in the cell; u95_mm: None for unknown."""

    unix_s: float
    point: int
    target: str
    status: Status
    u95_mm: float | None
    age_s: float | None
    latency_s: float
    position_mm: tuple[float, ...] | None

    def to_json(self) -> dict[str, object]:
        """For a reply."""
        return {
            "unix_s": round(self.unix_s, 3),
            "point": self.point,
            "target": self.target,
            "status": int(self.status),
            "name": self.status.name,
            "words": self.status.description,
            "u95_mm": self.u95_mm,
            "age_ms": None if self.age_s is None else round(1e3 * self.age_s),
            "latency_ms": round(1e3 * self.latency_s),
            "position_mm": None if self.position_mm is None else list(self.position_mm),
        }


class AnswerHistory:
    """The newest answers, and how many there were of each status since this process began."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._answers: deque[Answered] = deque(maxlen=_KEPT)
        self._counts: Counter[str] = Counter()

    def note(self, answer: Answer, target: str, asked_s: float) -> None:
        """Remember an answer to a request that came at `asked_s`; target: name of the point, "" for unknown."""
        now_s, is_ok = self._clock.monotonic(), answer.status.is_ok
        self._counts[answer.status.name] += 1
        known = answer.u95_um < LARGEST32
        self._answers.appendleft(
            Answered(
                self._clock.wall(),
                answer.point,
                target,
                answer.status,
                answer.u95_um / 1000 if is_ok and known else None,
                now_s - answer.captured_s if is_ok else None,
                now_s - asked_s,
                tuple(um / 1000 for um in answer.position_um) if is_ok else None,
            )
        )

    def to_json(self) -> Mapping[str, object]:
        """Newest first, and the counts."""
        return {
            "answers": [answered.to_json() for answered in self._answers],
            "counts": dict(self._counts.most_common()),
        }
