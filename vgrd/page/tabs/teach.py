"""Teaching: one next step, large buttons, and how the predicted error falls."""

from functools import partial

from nicegui import ui

from vgrd.page import texts
from vgrd.page.charts import fall
from vgrd.page.link import Reply
from vgrd.page.parts import (
    Grid,
    button,
    card,
    heading,
    live_picture,
    numbers,
    plain_button,
    redraw,
    tell,
)
from vgrd.page.scene import drawing, move_in_words
from vgrd.page.visitor import Seen, Visitor

_PLANS = ("joint", "special", "universal", "conventional", "plane", "sphere")
_FREE = frozenset({"wait", "done"})  # steps at which the person's hands are free
_VIEW_DEG = 45.0  # of one press: eight views all around
_LEADS_TO = {"mend": "undo"}  # which button a step means, where it is not its own


class TeachTab:
    """The wizard of the control socket, drawn."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        self._drawn: object = None
        self._azimuth_deg = _VIEW_DEG
        self._seen: object = None  # what is drawn
        with card(kind="step") as self._step:
            with ui.row().classes("items-center"):
                self._turn = ui.label().classes("turn")
                self._count = ui.label().classes("quiet")
            self._what = ui.label().classes("what").mark("step")
            self._words = ui.label().mark("step-words")
            self._job = ui.label().classes("quiet").mark("job")
            self._pose = ui.label().classes("quiet").mark("step-pose")
        with ui.element("div").classes("buttons"):
            self._target = ui.select([], label=texts.TARGET).props("outlined").mark("target")
            acts = {
                "touch": self._touch,
                "verify": self._verify,
                "spin": self._spin,
                "look": self._look,
                "undo": self._undo,
                "solve": self._solve,
            }
            self._buttons = {key: button(key, act) for key, act in acts.items()}
        with ui.element("div").classes("columns"):
            with ui.element("div").classes("column"):
                self._look_at_cell()
                with card(texts.PICTURE):
                    live_picture()
            with ui.element("div").classes("column"):
                self._look_at_numbers()
        with ui.element("div").classes("buttons"):
            self._plan = ui.select(list(_PLANS), value=_PLANS[0], label=texts.PLAN)
            self._plan.props("outlined")
            self._buttons["start"] = button("start", self._start)
            self._buttons["stop"] = button("stop", self._stop)

    def _look_at_cell(self) -> None:
        with card(texts.SCENE):
            self._scene = ui.html("", sanitize=False).classes("w-full").mark("scene")
            self._move = ui.label().mark("move")
            with ui.element("div").classes("buttons"):
                for key, turn_deg in (("left", -_VIEW_DEG), ("right", _VIEW_DEG)):
                    plain_button(texts.VIEWS[key], partial(self._turn_view, turn_deg))

    def _look_at_numbers(self) -> None:
        with card(texts.PREDICTED):
            self._chart = ui.echart(fall([], 1.0)).classes("w-full h-64")
            self._targets = Grid(("target", "touches", "u95_mm"))
            self._minutes = ui.label().classes("quiet").mark("minutes")
        with card(texts.UNKNOWN):
            self._unknown = ui.label()
            heading(texts.ODD)
            self._odd = ui.label().mark("odd")
        with card(texts.TOUCHES):
            self._touches = Grid(("name", "off_mm", "left_out_mm", "reason"))
        with card(texts.SAMPLES):
            self._samples = Grid(("sample", "kind", "target", "remark"))

    async def _start(self, seen: Seen) -> None:
        await self._visitor.command("record.start", seen, plan=str(self._plan.value))

    async def _stop(self, seen: Seen) -> None:
        await self._visitor.command("record.stop", seen)

    async def _touch(self, seen: Seen) -> None:
        await self._visitor.command("touch", seen, target=str(self._target.value or ""))

    async def _verify(self, seen: Seen) -> None:
        await self._visitor.command("verify", seen, target=str(self._target.value or ""))

    async def _spin(self, seen: Seen) -> None:
        await self._visitor.command("spin", seen)

    async def _look(self, seen: Seen) -> None:
        await self._visitor.command("look", seen)

    async def _undo(self, seen: Seen) -> None:
        sample = self._visitor.link.reply("teaching").get("step", {}).get("sample")
        which = {} if sample is None else {"sample": sample}
        await self._visitor.command("undo", seen, **which)

    async def _solve(self, seen: Seen) -> None:
        """End the session, if one is open, and solve it."""
        teaching = self._visitor.link.reply("teaching")
        session = (teaching.get("session") or {}).get("name") or teaching.get("last") or ""
        if teaching.get("session") and await self._visitor.command("record.stop", seen) is None:
            return
        ui.notify(texts.SOLVING)
        await self._visitor.solve(session)

    def refresh(self) -> None:
        """Show what was heard."""
        teaching = self._visitor.link.reply("teaching")
        step = teaching.get("step")
        if step is None:
            return
        self._show_targets(teaching)
        tell(self._job, _job(teaching))
        self._show_step(step)
        self._show_scene(step)
        tell(self._unknown, str(teaching.get("unknown") or texts.NONE))
        odd = [f"{n}: {words}" for n, words in teaching.get("questions", {}).items()]
        odd += teaching.get("odd", ())
        tell(self._odd, "; ".join(odd) or texts.NONE)
        self._touches.show(teaching.get("touches", ()))
        self._samples.show(reversed(teaching.get("samples", ())))
        tell(self._minutes, _minutes(teaching.get("clock")))

    async def _turn_view(self, by_deg: float) -> None:
        self._azimuth_deg = (self._azimuth_deg + by_deg) % 360.0

    def _show_scene(self, step: Reply) -> None:
        scene = self._visitor.link.reply("scene")
        seen = (scene, step, self._azimuth_deg)
        if seen == self._seen:
            return
        self._seen = seen
        content = drawing(scene, step, self._azimuth_deg)
        if content != self._scene.content:
            self._scene.set_content(content)
        note = texts.SCENE_NOTE if scene and not scene["known"] else ""
        tell(self._move, move_in_words(scene, step) or note)

    def _show_step(self, step: Reply) -> None:
        is_mine = step["kind"] not in _FREE
        self._step.classes(add="mine" if is_mine else "", remove="" if is_mine else "mine")
        tell(self._turn, f"➤ {texts.YOUR_TURN}" if is_mine else f"… {texts.MACHINE}")
        count = texts.DONE_OF.format(done=step["done"], of=step["of"]) if step["of"] else ""
        tell(self._count, count)
        tell(self._what, texts.STEPS[step["kind"]])
        tell(self._words, step["words"])
        tell(self._pose, _pose(step))
        is_known = step["target"] in self._target.options
        if is_known and step["target"] != self._drawn:
            self._target.set_value(step["target"])
            self._drawn = step["target"]
        next_key = _LEADS_TO.get(step["kind"], step["kind"])
        for key, shown in self._buttons.items():
            shown.classes(
                add="next" if key == next_key else "", remove="" if key == next_key else "next"
            )

    def _show_targets(self, teaching: Reply) -> None:
        targets = teaching.get("targets", ())
        names = [one["name"] for one in targets]
        if names and names != self._target.options:
            self._target.set_options(names, value=None)
            self._drawn = None
        self._targets.show({**one, "target": one["name"]} for one in targets)
        options = fall(teaching.get("trend", []), teaching.get("tolerance_mm", 1.0))
        redraw(self._chart, options)


def _job(teaching: Reply) -> str:
    """What is taught, and how well it has to be."""
    session = teaching.get("session")
    if not session:
        return ""
    return texts.JOB.format(
        count=len(teaching["targets"]), tolerance=teaching["tolerance_mm"], plan=session["plan"]
    )


def _pose(step: Reply) -> str:
    if step.get("flange_mm") is None:
        return str(step.get("no_pose") or "")
    words = texts.POSE.format(
        position=numbers(step["flange_mm"]), rotation=numbers(step["rotvec_deg"], 2)
    )
    if step.get("u95_after_mm") is None:
        return words
    expected = texts.EXPECT.format(
        before=f"{step['u95_before_mm']:.3f}", after=f"{step['u95_after_mm']:.3f}"
    )
    return f"{words}. {expected}"


def _minutes(clock: Reply | None) -> str:
    if not clock:
        return texts.NO_SESSION
    steps = ", ".join(f"{kind} {minutes:.1f}" for kind, minutes in clock["by_step"].items())
    return texts.MINUTES.format(
        minutes=clock["minutes"], steps=steps or texts.NONE, elapsed=clock["elapsed_s"] / 60
    )
