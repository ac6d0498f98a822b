"""Questions about the touches of a session, each when it is taken: in the air, under another name, a wrist, a tag.

The session's own touches speak first; where they do not tell yet, the calibration in use does.
"""

from collections.abc import Sequence

from vgrd.calibration.plausibility.calibrated import NONE_IN_USE, InUse, Miss
from vgrd.calibration.plausibility.contradictions import Judge, Judgement, Mistake
from vgrd.calibration.plausibility.wrists import wrong_wrist
from vgrd.model import CellFacts, Observation, Recording

_SHOWN = 3  # explanations of one contradiction: with more, nobody would compare them
_EXACT_MM = 10.0  # from here on whole millimetres are enough


def questions(
    recording: Recording, numbers: Sequence[int], in_use: InUse = NONE_IN_USE
) -> dict[int, str]:
    """By number of the sample what is odd about it, in words with the remedy; touches that fit are not named.

    numbers: of the samples that the touches are, in order; in_use: the calibration in use.
    """
    return _Review(recording, numbers, in_use).asked()


def missing_tags(facts: CellFacts, seen: Observation | None) -> str:
    """Which tag the picture of a touch lacks, in words; "" for none."""
    if seen is None:
        return ""
    told = []
    if facts.tag_a is not None and seen.tag_a is None:
        told.append(
            "tag A is not in the picture: turn it to the camera; the touch counts, its look does not"
        )
    if seen.tag_b is None:
        told.append(
            "tag B is not in the picture, so nothing tells where the object stood: clear the view and touch again"
        )
    return "; ".join(told)


class _Review:
    """Goes through the touches in order; what is doubted does not speak about others until they bear it out."""

    def __init__(self, recording: Recording, numbers: Sequence[int], in_use: InUse) -> None:
        self.recording = recording
        self.numbers = numbers
        self.in_use = in_use
        self.judge = Judge(recording)
        self.trusted: list[int] = []
        self.doubted: dict[int, str] = {}
        self.excused: list[tuple[str, Miss]] = []

    def asked(self) -> dict[int, str]:
        """Everything that is open in the end, with what wrists and pictures show."""
        for index in range(len(self.recording.touches)):
            self._take(index)
            self._clear()
        told = {}
        for index, touch in enumerate(self.recording.touches):
            parts = (
                self._doubt_of(index),
                self._wrist(index),
                missing_tags(self.recording.facts, touch.observation),
            )
            if words := "; ".join(part for part in parts if part):
                told[self.numbers[index]] = words
        return told

    def _take(self, index: int) -> None:
        judged = self.judge.judge(index, self.trusted)
        is_foretold = judged is not None and judged.is_foretold
        by_calibration = "" if is_foretold else self._by_calibration(index)
        if by_calibration:
            self.doubted[index] = by_calibration
        elif judged is None or not judged.is_contradicted:
            self.trusted.append(index)
        else:
            self._doubt(index, judged)

    def _doubt(self, index: int, judged: Judgement) -> None:
        """Doubt what the likeliest mistake is, the new touch where it may be it; the others speak on.

        One mistake that explains the doubts so far as well clears all others.
        """
        level, every = judged.known.level, [*self.trusted, *self.doubted]
        whole = self.judge.judge(index, every) if self.doubted else None
        mistakes = () if whole is None else whole.mistakes(level)
        if whole is not None and mistakes:
            judged = whole
            self.trusted, self.doubted = sorted(every), {}
        else:
            mistakes = judged.mistakes(level) or (Mistake((index,)),)
        is_suspected = any(mistake.indices == (index,) for mistake in mistakes)
        suspects = (index,) if is_suspected else mistakes[0].indices
        words = self._in_words(index, judged, mistakes)
        self.doubted |= dict.fromkeys(suspects, words)
        self.trusted = [i for i in (*self.trusted, index) if i not in suspects]

    def _clear(self) -> None:
        """Trust again what the others bear out."""
        for index in list(self.doubted):
            judged = self.judge.judge(index, self.trusted)
            if judged is not None and judged.is_foretold and not judged.is_contradicted:
                del self.doubted[index]
                self.trusted = sorted([*self.trusted, index])

    def _doubt_of(self, index: int) -> str:
        """Why a touch is doubted, by all that was touched since; "" where it is not."""
        words = self.doubted.get(index, "")
        judged = self.judge.judge(index, self.trusted) if words else None
        if judged is None or not judged.is_foretold:
            return words
        mistakes = judged.mistakes(judged.known.level) or (Mistake((index,)),)
        return self._in_words(index, judged, mistakes)

    def _by_calibration(self, index: int) -> str:
        """What the calibration in use says against a touch; "" where nothing, or where it may hold no more.

        Two touches of different targets that miss alike, and at no other target, speak against the calibration.
        """
        misses = self.in_use.missed(index)
        name = self.recording.touches[index].target
        miss = misses.get(name)
        if miss is None or miss.is_chance:
            return ""
        nearest = min(misses, key=lambda other: misses[other].mm)
        if not misses[nearest].is_chance:
            if any(other != name and miss.is_as(earlier) for other, earlier in self.excused):
                return ""
            self.excused.append((name, miss))
        off_mm = sorted(((n, m.mm) for n, m in misses.items()), key=lambda one: one[1])
        is_meant = nearest != name and misses[nearest].is_chance
        return _at(
            "the calibration puts",
            self.numbers[index],
            name,
            off_mm,
            nearest if is_meant else None,
        )

    def _in_words(self, index: int, judged: Judgement, mistakes: Sequence[Mistake]) -> str:
        number, name = self.numbers[index], self.recording.touches[index].target
        off_mm = judged.off_mm()
        if off_mm and all(mistake.indices == (index,) for mistake in mistakes):
            meant = mistakes[0].targets[0] if mistakes[0].targets else None
            return _at("the touches so far put", number, name, off_mm, meant)
        told = [self._remedy(mistake) for mistake in mistakes[:_SHOWN]]
        more = ", or with another mistake" if len(mistakes) > _SHOWN else ""
        return (
            f"sample {number} ({name}) and the other touches contradict each other; they agree with "
            f"{', or with '.join(told)}{more}"
        )

    def _remedy(self, mistake: Mistake) -> str:
        """What is different then, and what to call for it."""
        numbers = [self.numbers[i] for i in mistake.indices]
        if not mistake.targets:
            return f"sample {numbers[0]} taken again (vgrd undo {numbers[0]})"
        changed = list(zip(numbers, mistake.targets, strict=True))
        what = " and ".join(f"sample {number} of {target}" for number, target in changed)
        return f"{what} ({', '.join(f'vgrd retag {n} {target}' for n, target in changed)})"

    def _wrist(self, index: int) -> str:
        """What is odd about the wrist; of two touches that differ, the second is asked about."""
        every = [touch.base_from_wrist.rotation for touch in self.recording.touches]
        others = [R for i, R in enumerate(every) if i != index]
        if not index and len(every) == 2:
            others = []
        words = wrong_wrist(self.recording, every[index], others, self.in_use.wrists)
        return f"{words}: if that was not meant, vgrd undo {self.numbers[index]}" if words else ""


def _at(
    who: str, number: int, name: str, off_mm: Sequence[tuple[str, float]], meant: str | None
) -> str:
    """Where the tip is; off_mm: by name of the target, the nearest first; meant: which one it fits."""
    away = dict(off_mm)
    place = f"{who} the tip {_mm(away[name])} mm from {name}"
    if meant is not None:
        return (
            f"{place}, nearest target {meant} ({_mm(away[meant])} mm): vgrd undo {number}, or "
            f"vgrd retag {number} {meant}"
        )
    nearest = off_mm[0][0]
    near = (
        "no target is nearer"
        if nearest == name
        else f"nearest target {nearest} ({_mm(away[nearest])} mm)"
    )
    return f"{place}, {near}: vgrd undo {number}, and touch {name} again"


def _mm(length: float) -> str:
    return f"{length:.0f}" if length >= _EXACT_MM else f"{length:.1f}"
