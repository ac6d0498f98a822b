"""Samples by the numbers of their replies: what `vgrd undo` and `vgrd retag` want to be told.

Findings count touches, looks and spins by themselves, as files of users do; a session numbers all samples together.
"""

import re
from collections.abc import Mapping

from vgrd.model import Recording
from vgrd.store.sessions import SampleKind, StoredSession

_OF_TARGET = re.compile(
    r"\b(\d+) \(([^()]+)\)"
)  # "touch 3 (P1)", and the second of a list of them
_OF_KIND = re.compile(r"\b(look|spin) (\d+)\b(?! \()")
_SAMPLE = re.compile(r"\bsample (\d+)\)")  # as `told` writes it


def samples_named(told: str) -> list[int]:
    """Numbers of the samples in words that were told, in their order, each once."""
    return list(dict.fromkeys(int(number) for number in _SAMPLE.findall(told)))


class SampleNumbers:
    """Puts them into words about one session."""

    def __init__(self, session: StoredSession) -> None:
        self._recording: Recording = session.recording
        self._numbers: Mapping[SampleKind, tuple[int, ...]] = session.numbers

    def told(self, words: str) -> str:
        """The same words, with the number of every sample that they name."""
        return _OF_KIND.sub(self._of_kind, _OF_TARGET.sub(self._of_target, words))

    def _of_target(self, found: re.Match[str]) -> str:
        """A touch of the object, or else beside it, that stands at this place and has this name."""
        index, name = int(found[1]) - 1, found[2]
        recording = self._recording
        for kind, touches in (
            (SampleKind.TOUCH, recording.touches),
            (SampleKind.POINT, recording.points),
            (SampleKind.VERIFY, recording.verifications),
        ):
            if 0 <= index < len(touches) and touches[index].target == name:
                return f"{found[1]} ({name}, sample {self._numbers[kind][index]})"
        return found[0]

    def _of_kind(self, found: re.Match[str]) -> str:
        numbers = self._numbers[SampleKind(found[1])]
        index = int(found[2]) - 1
        if not 0 <= index < len(numbers):
            return found[0]
        return f"{found[0]} (sample {numbers[index]})"
