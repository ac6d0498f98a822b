"""How the cell is: picture, devices, robot, calibration, last answers."""

import time

from nicegui import ui

from vgrd.page import texts
from vgrd.page.link import Reply
from vgrd.page.parts import (
    Grid,
    ago,
    button,
    card,
    dress_if,
    in_words,
    live_picture,
    numbers,
    tell,
)
from vgrd.page.visitor import Seen, Visitor

_CONFIRMED = ("CALIBRATION_DRIFT", "TCP_OFFSET_CHANGED")  # stand until a person confirms
_DAY_S = 86400.0
_SHOWN = 8  # answers: a screen's worth


class CellTab:
    """The tab of the whole cell."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        with ui.element("div").classes("columns"):
            with card(texts.PICTURE):
                live_picture()
            with ui.column().classes("w-full"):
                with card(texts.ROBOT_PROGRAM):
                    self._asked = ui.label()
                    self._beat = ui.label().classes("quiet").mark("beat")
                    self._coordinate = ui.label().mark("coordinate")
                with card(texts.CALIBRATION_IN_USE):
                    self._calibration = ui.label().mark("calibration")
                with card(texts.DEVICES):
                    self._devices = ui.label()
                    self._processes = Grid(("process", "state"))
                with ui.element("div").classes("buttons"):
                    self._confirming = button("confirm", self._confirm)
        with card(texts.LAST_ANSWERS):
            self._answers = Grid(
                ("unix_s", "target", "answer", "u95_mm", "age_ms", "latency_ms", "words")
            )

    async def _confirm(self, seen: Seen) -> None:
        await self._visitor.command("confirm", seen, by=self._visitor.who)

    def refresh(self) -> None:
        """Show what was heard."""
        link = self._visitor.link
        registers, status = link.reply("registers"), link.reply("status")
        words = texts.ASKED.format(
            ago=ago(registers.get("asked_s_ago")), read=ago(registers.get("read_s_ago"))
        )
        tell(self._asked, words)
        tell(self._beat, texts.BEAT.format(beat=registers.get("beat", "-")))
        is_mine = registers.get("cause") in _CONFIRMED
        dress_if(self._confirming, "next", is_mine)
        tell(self._coordinate, coordinate_in_words(registers))
        tell(self._calibration, link.trouble("calibrations") or in_use(link.reply("calibrations")))
        devices = f"robot {status.get('robot', '-')}; camera {status.get('camera', '-')}"
        tell(self._devices, devices)
        processes = status.get("processes", {})
        self._processes.show({"process": n, "state": words} for n, words in processes.items())
        answers = link.reply("answers").get("answers", ())[:_SHOWN]
        self._answers.show({**one, "answer": one["name"]} for one in answers)


def coordinate_in_words(registers: Reply) -> str:
    """What the registers hold."""
    if not registers.get("valid"):
        return f"registers: {registers.get('status', '-')} {registers.get('name', '')}"
    return (
        f"registers: point {registers['point']}, flange {numbers(registers['position_mm'], 2)} mm, "
        f"{numbers(registers['rotvec_deg'], 2)} deg, 95 % error {in_words(registers['u95_mm'])} mm, "
        f"{in_words(registers['age_ms'])} ms old"
    )


def in_use(calibrations: Reply) -> str:
    """Which calibration serves."""
    for row in calibrations.get("calibrations", ()):
        if row["active"]:
            u95 = in_words(row.get("u95_mm"))
            days = (time.time() - row["made_unix_s"]) / _DAY_S if "made_unix_s" in row else 0.0
            return texts.IN_USE.format(
                id=row["id"], made=row.get("made", "-"), days=days, u95=f"{u95} mm"
            )
    return texts.NOT_IN_USE
