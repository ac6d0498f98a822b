"""What a teaching is like at this moment: samples, what they are worth, the next step, the operator's minutes."""

import asyncio
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from vgrd.calibration.verification import turned_apart
from vgrd.cell.recording.counting import repeats
from vgrd.cell.recording.next_step import Step, Taken, step_in_session, step_without_session
from vgrd.cell.recording.teaching import Teaching, sample_in_words
from vgrd.cell.serving.activation import Activation
from vgrd.cell.serving.service import Serving
from vgrd.clock import Clock
from vgrd.errors import CalibrationError
from vgrd.judging.findings import MISSING
from vgrd.judging.operator_time import operator_minutes
from vgrd.model import Observation, Touch
from vgrd.solving.shelf import active_calibration, calibration_row
from vgrd.store.results import read_result
from vgrd.store.sessions import (
    SampleKind,
    SessionWriter,
    Taught,
    list_sessions,
    load_session,
    session_directory,
)


class Wizard:
    """Looks at the open session whenever it is asked; nothing is changed by looking."""

    def __init__(
        self, teaching: Teaching, activation: Activation, serving: Serving, clock: Clock
    ) -> None:
        self._teaching, self._activation, self._serving = teaching, activation, serving
        self._clock = clock
        self.solving = ""  # name of the session that is being solved
        self.rejected: dict[str, str] = {}  # by name of a session why its calibration was
        self._session = ""
        self._advice: Mapping[str, Any] = {}
        self._trend: list[dict[str, Any]] = []
        self._candidate: tuple[str, Mapping[str, Any] | None] = ("", None)

    def take_up(self, state_dir: Path) -> None:
        """After a start: the newest session, where it has touches and nobody solved it. Raises StoreError."""
        names = list_sessions(state_dir)
        if not names or self._teaching.last_session or self._teaching.recorder.writer:
            return
        folder = session_directory(state_dir, names[-1])
        if read_result(folder) is None and load_session(folder).recording.touches:
            self._teaching.last_session = folder

    @property
    def scenery(self) -> Mapping[str, Any]:
        """Where things stand by the estimate of the open session, empty while there is none."""
        if self._teaching.recorder.writer is None:
            return {}
        return self._advice.get("scenery") or {}

    async def state(self) -> dict[str, Any]:
        """Everything for a page or a terminal; JSON-able."""
        writer = self._teaching.recorder.writer
        if writer is None:
            return await self._without_session()
        advice = await self._advised(writer)
        told, taught = self._teaching.status(), writer.taught
        minutes = operator_minutes(_asked(taught))
        predicted = advice.get("predicted_u95_mm") or {}
        self._note(taught, sum(minutes.values()), predicted)
        return {
            "session": {
                "name": writer.header.name,
                "plan": writer.header.plan.value,
                "folder": str(writer.path),
            },
            "step": self._step(writer, told, advice).to_json(),
            **{key: told[key] for key in ("have", "missing", "harvested", "warning", "trouble")},
            "computing": "pending" in advice,
            "unknown": advice.get("trouble") or "; ".join(_messages(advice, are_missing=True)),
            "odd": _messages(advice, are_missing=False),
            "questions": told.get("questions", {}),
            "tolerance_mm": self._serving.limits.max_u95_mm,
            "targets": [
                {"name": n, "touches": writer.touched[n], "u95_mm": predicted.get(n)}
                for n in writer.header.facts.object.targets
            ],
            "trend": self._trend,
            "samples": _samples(taught, self._teaching.questions.open),
            "touches": advice.get("touches", []),
            "clock": {
                "minutes": round(sum(minutes.values()), 2),
                "by_step": minutes,
                "elapsed_s": round(self._clock.wall() - writer.header.created_unix_s, 1),
            },
        }

    def _step(
        self, writer: SessionWriter, told: Mapping[str, Any], advice: Mapping[str, Any]
    ) -> Step:
        if self._teaching.is_taking:
            return Step("wait", "a sample is being taken")
        return step_in_session(
            Taken(
                told["have"],
                told["missing"],
                writer.touched,
                tuple(writer.header.facts.object.targets),
                self._teaching.harvest is not None,
                advice,
                self._teaching.questions.open,
                len(verified(writer.taught)),
                self._serving.limits.max_u95_mm,
            )
        )

    async def _without_session(self) -> dict[str, Any]:
        """What was taught last, and whether it is in use."""
        last = self._teaching.last_session
        name = "" if last is None else last.name
        active, candidate = await asyncio.to_thread(self._made_of, name)
        served = self._serving.calibration
        is_served = served is not None and served.id == active
        refused = "" if is_served else self._serving.faults.absence[1]
        step = step_without_session(name, candidate, active, refused)
        if self.solving:
            step = Step("wait", f"solving session {self.solving}")
        elif step.kind == "solve" and name in self.rejected:
            step = Step("start", f"{name} is rejected, teach again: {self.rejected[name]}")
        return {
            "session": None,
            "step": step.to_json(),
            "last": name or None,
            "candidate": candidate,
            "active": active,
            "tolerance_mm": self._serving.limits.max_u95_mm,
        }

    def _made_of(self, session: str) -> tuple[str | None, Mapping[str, Any] | None]:
        """Id of the active calibration, and the newest one if it was made of that session."""
        store = self._activation.store
        active, names = active_calibration(store), store.list()
        if not names or not session:
            return active, None
        if self._candidate[0] != names[-1]:
            self._candidate = names[-1], calibration_row(store, names[-1])
        row = self._candidate[1]
        if row is None or row.get("session") != session:
            return active, None
        return active, {**row, "active": names[-1] == active}

    async def _advised(self, writer: SessionWriter) -> Mapping[str, Any]:
        """Advice for the samples as they are; as it was for fewer of them while it is computed anew."""
        if writer.header.name != self._session:
            self._session, self._advice, self._trend = writer.header.name, {}, []
        if self._teaching.advisor is None:
            return {}
        try:
            advice = await self._teaching.advise(0.0)
        except CalibrationError as err:  # a newer sample came in between
            advice = {"pending": str(err)}
        if "pending" in advice:
            return {**self._advice, **advice}
        self._advice = advice
        return advice

    def _note(
        self, taught: tuple[Taught, ...], minutes: float, predicted: Mapping[str, float]
    ) -> None:
        """Keep how the largest predicted error fell."""
        if not taught or not predicted:
            return
        number, u95_mm = taught[-1].sequence, max(predicted.values())
        point = {"sample": number, "minutes": round(minutes, 2), "u95_mm": u95_mm}
        if self._trend and self._trend[-1]["sample"] >= number:  # computed anew, or one was undone
            self._trend = [one for one in self._trend if one["sample"] < number]
        self._trend.append(point)


def verified(taught: tuple[Taught, ...]) -> set[int]:
    """Numbers of the verifications that count: the object turned from every touch and earlier verification."""
    touches = [one.value for one in taught if one.kind is SampleKind.TOUCH]
    held_out = [one for one in taught if one.kind is SampleKind.VERIFY]
    counted = turned_apart(_touches(touches), _touches([one.value for one in held_out]))
    return {held_out[i].sequence for i in counted}


def _touches(values: Sequence[Observation | Touch]) -> list[Touch]:
    return [value for value in values if isinstance(value, Touch)]


def _asked(taught: tuple[Taught, ...]) -> dict[str, int]:
    """Samples that somebody asked for, by kind; what repeats an earlier one cost its time too."""
    kinds = [one.kind.value for one in taught if not one.harvested]
    return {kind.value: kinds.count(kind.value) for kind in SampleKind}


def _samples(taught: tuple[Taught, ...], questions: Mapping[int, str]) -> list[dict[str, Any]]:
    same, counted = repeats(taught), verified(taught)
    return [
        {
            "sample": one.sequence,
            "kind": one.kind.value,
            "target": one.value.target if isinstance(one.value, Touch) else None,
            "harvested": one.harvested,
            "words": sample_in_words(one),
            "remark": _remark(one, same, counted),
            "question": questions.get(one.sequence, ""),
        }
        for one in taught
    ]


def _messages(advice: Mapping[str, Any], *, are_missing: bool) -> list[str]:
    """Findings that say that a sample is still to come, or those that say that something is wrong."""
    return [
        str(one["message"])
        for one in advice.get("findings", ())
        if (one["code"] in MISSING) is are_missing
    ]


def _remark(sample: Taught, same: Mapping[int, int], counted: Collection[int]) -> str:
    """Why a sample does not count, or ""."""
    number = sample.sequence
    if number in same:
        return f"tells the same as sample {same[number]}"
    if sample.kind is SampleKind.VERIFY and number not in counted:
        return "does not count: the object had not turned by 60 degrees from every other, or tag B was hidden"
    return ""
