"""What is odd about the samples of the open session, asked after each touch and kept until it is mended."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import structlog

from vgrd.calibration.calibration import Calibration
from vgrd.calibration.plausibility import NONE_IN_USE, InUse, Miss, misses, questions
from vgrd.geometry import Array
from vgrd.model import CameraPlace, FlangeTag, Observation, Recording, Touch
from vgrd.niceness import give_way
from vgrd.store.sessions import SampleKind, SessionWriter, Taught

_OF_OBJECT = frozenset({SampleKind.TOUCH, SampleKind.VERIFY})

log = structlog.get_logger()


class OpenQuestions:
    """By number of the sample what is odd about it; found in a thread of its own, as serving goes first.

    calibration: the one in use, None for none; stability: (6,) of the camera, as in `CameraPlace`.
    """

    def __init__(
        self,
        calibration: Callable[[], Calibration | None] = lambda: None,
        stability: Array | None = None,
    ) -> None:
        self._calibration = calibration
        self._stability = np.zeros(6) if stability is None else stability
        self._thread = ThreadPoolExecutor(1, "questions", initializer=give_way)
        self._misses: dict[tuple[str, int], Mapping[str, Miss]] = {}
        self.open: dict[int, str] = {}

    def forget(self) -> None:
        """Begin with nothing, for a new session."""
        self.open, self._misses = {}, {}

    async def review(self, writer: SessionWriter) -> None:
        """Go through the touches of a session anew."""
        samples = writer.taught
        recording, numbers = _touched(writer, samples), _numbers(samples)
        in_use = self._in_use(recording, numbers)
        loop = asyncio.get_running_loop()
        asked = await loop.run_in_executor(
            self._thread, lambda: questions(recording, numbers, in_use)
        )
        for number in asked.keys() - self.open.keys():
            log.info("sample_questioned", sample=number, question=asked[number])
        self.open = asked

    def told(self) -> dict[str, object]:
        """For a reply and `vgrd status`."""
        return (
            {"questions": {str(n): words for n, words in self.open.items()}} if self.open else {}
        )

    def _in_use(self, recording: Recording, numbers: Sequence[int]) -> InUse:
        """What the calibration in use says; a sample is asked once, whatever its name becomes."""
        calibration = self._calibration()
        if calibration is None:
            return NONE_IN_USE

        def missed(index: int) -> Mapping[str, Miss]:
            touch, key = recording.touches[index], (calibration.id, numbers[index])
            if key not in self._misses and touch.observation is not None:
                place = CameraPlace(self._stability, FlangeTag.of(touch.observation))
                self._misses[key] = misses(calibration, touch, place, recording.facts)
            return self._misses.get(key, {})

        works = [np.asarray(point.base_from_work) for point in calibration.taught.values()]
        return InUse(missed, works)


def _touched(writer: SessionWriter, samples: Sequence[Taught]) -> Recording:
    """Looks and touches of the object in the order in which they were taken, held-out ones too."""
    header = writer.header
    looks = (s.value for s in samples if s.kind is SampleKind.LOOK)
    touches = (s.value for s in samples if s.kind in _OF_OBJECT)
    return Recording(
        header.name,
        header.plan,
        header.facts,
        looks=tuple(look for look in looks if isinstance(look, Observation)),
        touches=tuple(touch for touch in touches if isinstance(touch, Touch)),
    )


def _numbers(samples: Sequence[Taught]) -> list[int]:
    """Of those touches."""
    return [sample.sequence for sample in samples if sample.kind in _OF_OBJECT]
