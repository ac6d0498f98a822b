"""Verifying the calibration in use: where the flange must go for the picture of now, and what verifications say."""

import math
import time

from nicegui import ui

from vgrd.page import texts
from vgrd.page.link import Reply
from vgrd.page.moment import FADE_S, Moment
from vgrd.page.parts import Grid, button, card, moment, numbers, plain_button, show_if, tell
from vgrd.page.shown import choice, fact, offer
from vgrd.page.visitor import Seen, Visitor

_WHERE_S = 10.0  # of a pose: the object may be turned at any time


class TrialsCard:
    """Of the calibration in use, never of a session: while one is open its buttons are off."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        self._moment = Moment(visitor.link, _WHERE_S)
        self._told: Reply = {}  # the pose that is shown
        self._told_unix_s = 0.0
        with card(texts.TRIALS):
            self._words = ui.label().mark("trials")
            self._why_off = ui.label().mark("trials-off")
            self._calibration = fact("trial")
            with ui.element("div").classes("buttons"):
                self._target = choice("trial-target", texts.TARGET)
                plain_button(texts.WHERE, self._show_where).mark("where")
                self._buttons = (button("verify", self._verify), button("undo", self._undo))
            self._where = ui.label().mark("where-words")
            self._grid = Grid(("target", "off_mm", "counts", "fails", "trouble"))
        ui.timer(FADE_S, self.fade)

    async def _show_where(self) -> None:
        """Where the flange has to go for the picture of now."""
        self._forget()
        self._moment.begin()
        told = await self._visitor.ask("ec", target=str(self._target.value or ""))
        if told is None or self._moment.is_over:
            return
        self._told, self._told_unix_s = told, time.time() - float(told.get("age_s", 0.0))
        pose = texts.POSE.format(
            position=numbers(told["position_mm"], 2), rotation=numbers(told["rotvec_deg"], 2)
        )
        words = {"target": told["target"], "pose": pose, "u95": told["u95_mm"]}
        tell(self._where, texts.WHERE_IS.format(time=moment(self._told_unix_s), **words))

    def fade(self) -> None:
        """Take the pose away when it is old, or may not be so any more."""
        if self._told and (self._moment.is_over or self._is_contradicted()):
            self._forget()

    def _forget(self) -> None:
        self._told = {}
        tell(self._where, "")

    def _is_contradicted(self) -> bool:
        """Whether a robot was told something else about this target since."""
        for answer in self._visitor.link.reply("answers").get("answers", ()):
            if answer["unix_s"] <= self._told_unix_s:
                return False  # newest first: so are all the others
            if answer["target"] == self._told["target"]:
                return _apart_mm(answer, self._told) > float(self._told["u95_mm"])
        return False

    async def _verify(self, seen: Seen) -> None:
        what = {"target": seen["trial-target"], "calibration": seen["trial"]}
        await self._visitor.command("verify", seen, **what)

    async def _undo(self, seen: Seen) -> None:
        await self._visitor.command("undo", seen, kind="verify", calibration=seen["trial"])

    def _trials(self) -> Reply:
        """What was told of them, empty where that was of a calibration that is not in use any more."""
        told = self._visitor.link.reply("trials")
        of = told.get("calibration")
        return told if of == self._visitor.link.reply("status").get("calibration", of) else {}

    def refresh(self) -> None:
        """Show what was heard."""
        link = self._visitor.link
        told, session = self._trials(), link.reply("teaching").get("session")
        tell(self._words, link.trouble("trials") or _in_words(told))
        tell(self._calibration, str(told.get("calibration") or ""))
        self._grid.show(reversed(told.get("verifications", ())))
        if targets := link.reply("status").get("targets"):
            offer(self._target, targets, targets[0])
        show_if(self._why_off, is_shown=bool(session))
        tell(self._why_off, texts.TRIALS_OFF.format(session=session["name"]) if session else "")
        for one in self._buttons:
            one.set_enabled(not session)


def _apart_mm(answer: Reply, told: Reply) -> float:
    """Between two answers; endless where one is none."""
    position_mm = answer.get("position_mm")
    return math.inf if position_mm is None else math.dist(position_mm, told["position_mm"])


def _in_words(trials: Reply) -> str:
    """Of which calibration: go or no go, and why."""
    if not trials:
        return texts.NOT_TOLD
    return f"{trials.get('calibration', '-')}: {texts.GOES[trials['verdict']]}: {trials['words']}"
