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
    dress_if,
    heading,
    in_words,
    live_picture,
    numbers,
    plain_button,
    redraw,
    show_if,
    tell,
)
from vgrd.page.scene import drawing, move_in_words
from vgrd.page.shown import choice, fact, offer
from vgrd.page.visitor import Seen, Visitor

_PLANS = ("joint", "special", "universal", "conventional", "plane", "sphere")
_FREE = frozenset({"wait", "done"})  # steps at which the person's hands are free
_VIEW_DEG = 45.0  # of one press: eight views all around
_TOUCHES = frozenset({"touch", "verify"})  # kinds of samples that have a target
_LAST = "last"  # what UNDO takes where the step names no sample


class TeachTab:
    """The wizard of the control socket, drawn."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        self._version: object = None  # since when a person's choice of a target stands
        self._followed: object = None  # the target of the step
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
            self._disk = ui.label().mark("disk")
        facts = ("session", "taught", "sample", "name")
        self._session, self._taught, self._sample, self._name = map(fact, facts)
        with ui.element("div").classes("buttons"):
            self._target = choice("target", texts.TARGET)
            acts = {
                "touch": self._touch,
                "verify": self._verify,
                "spin": self._spin,
                "look": self._look,
                "point": self._point,
                "undo": self._undo,
                "retag": self._retag,
                "solve": self._solve,
            }
            self._buttons = {key: button(key, act) for key, act in acts.items()}
        self._unnamed = ui.label(texts.UNNAMED).mark("unnamed")
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
            self._old = ui.label(texts.COMPUTING).mark("old")
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
        await self._visitor.command("touch", seen, target=seen["target"])

    async def _verify(self, seen: Seen) -> None:
        if _is_open(seen):
            where = {"target": seen["target"], "session": seen["session"]}
            await self._visitor.command("verify", seen, **where)

    async def _spin(self, seen: Seen) -> None:
        await self._visitor.command("spin", seen)

    async def _look(self, seen: Seen) -> None:
        await self._visitor.command("look", seen)

    async def _point(self, seen: Seen) -> None:
        """Touch what stands beside the object, in the plans that want it."""
        await self._visitor.command("point", seen, name=seen["name"])

    async def _undo(self, seen: Seen) -> None:
        if _is_open(seen):
            which = {} if seen["sample"] == _LAST else {"sample": seen["sample"]}
            await self._visitor.command("undo", seen, session=seen["session"], **which)

    async def _retag(self, seen: Seen) -> None:
        """Book the touch that the step names under the chosen target."""
        what = {"sample": seen["sample"], "target": seen["target"]}
        await self._visitor.command("retag", seen, **what)

    async def _solve(self, seen: Seen) -> None:
        """End the session, if one is open, and solve it."""
        if seen["session"] and await self._visitor.command("record.stop", seen) is None:
            return
        ui.notify(texts.SOLVING)
        await self._visitor.solve(seen["taught"])

    def refresh(self) -> None:
        """Show what was heard."""
        teaching = self._visitor.link.reply("teaching")
        step = teaching.get("step")
        if step is None:
            return
        self._show_targets(teaching)
        self._show_disk(teaching)
        tell(self._job, _job(teaching))
        self._show_step(step)
        self._follow(str(teaching.get("version", "")), step["target"])
        self._show_buttons(teaching, step)
        self._show_scene(step)
        self._show_advice(teaching)
        self._samples.show(reversed(teaching.get("samples", ())))
        tell(self._minutes, _minutes(teaching.get("clock")))

    def _show_advice(self, teaching: Reply) -> None:
        """What the samples are worth; what is of other samples than there are now is marked so."""
        is_old = bool(teaching.get("computing"))
        show_if(self._old, is_shown=is_old)
        tell(self._unknown, str(_dated(teaching.get("unknown") or texts.NONE, is_old=is_old)))
        odd = [f"{n}: {words}" for n, words in teaching.get("questions", {}).items()]
        odd += [str(_dated(words, is_old=is_old)) for words in teaching.get("odd", ())]
        tell(self._odd, "; ".join(odd) or texts.NONE)
        misfits = ("off_mm", "left_out_mm")
        self._touches.show(
            {**one, **{key: _dated(one.get(key), is_old=is_old) for key in misfits}}
            for one in teaching.get("touches", ())
        )

    def _show_disk(self, teaching: Reply) -> None:
        """What keeps poses and pictures from being recorded, else how much room there is for them."""
        disk = self._visitor.link.reply("status").get("disk", {})
        trouble = _trouble(teaching, disk)
        dress_if(self._disk, "refused", bool(trouble))
        dress_if(self._disk, "quiet", not trouble)
        is_known = None not in (disk.get("free_gb"), disk.get("sessions_gb"))
        tell(self._disk, trouble or (texts.DISK.format(**disk) if is_known else ""))

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
        dress_if(self._step, "mine", is_mine)
        tell(self._turn, f"➤ {texts.YOUR_TURN}" if is_mine else f"… {texts.MACHINE}")
        count = texts.DONE_OF.format(done=step["done"], of=step["of"]) if step["of"] else ""
        tell(self._count, count)
        tell(self._what, texts.STEPS[step["kind"]])
        tell(self._words, step["words"])
        tell(self._pose, _pose(step))

    def _follow(self, version: str, target: str | None) -> None:
        """Choose the target of the step, unless a person chose another one since something was last done."""
        if version != self._version:
            self._version, self._followed = version, self._target.value
        if self._target.value == self._followed and target in self._target.options:
            self._target.set_value(target)
            self._followed = target

    def _show_buttons(self, teaching: Reply, step: Reply) -> None:
        """What each would take, and which one the step means."""
        opened = (teaching.get("session") or {}).get("name") or ""
        tell(self._session, opened)
        tell(self._taught, opened or teaching.get("last") or "")
        number, is_mend = step["sample"], step["kind"] == "mend"
        named = "" if number is None else str(number)
        is_unnamed = is_mend and not named  # the last one need not be the one that is wrong
        tell(self._sample, named or ("" if is_mend else _LAST))
        for key in ("undo", "retag"):
            self._buttons[key].set_text(f"{texts.BUTTONS[key]} {named}".strip())
        self._buttons["undo"].set_enabled(not is_unnamed)
        show_if(self._unnamed, is_shown=is_unnamed)
        show_if(self._buttons["retag"], is_shown=is_mend and _is_touch(teaching, number))
        is_point = step["kind"] == "point"
        tell(self._name, step["target"] if is_point else "")
        show_if(self._buttons["point"], is_shown=is_point)
        remedy = "" if is_unnamed else "undo"
        self._light(remedy if is_mend else step["kind"])

    def _light(self, meant: str) -> None:
        """The button that the step means is blue, and no other."""
        for key, shown in self._buttons.items():
            dress_if(shown, "next", key == meant)

    def _show_targets(self, teaching: Reply) -> None:
        targets, is_old = teaching.get("targets", ()), bool(teaching.get("computing"))
        if names := [one["name"] for one in targets]:
            offer(self._target, names)
        self._targets.show(
            {**one, "target": one["name"], "u95_mm": _dated(one["u95_mm"], is_old=is_old)}
            for one in targets
        )
        options = fall(teaching.get("trend", []), teaching.get("tolerance_mm", 1.0))
        redraw(self._chart, options)


def _is_open(seen: Seen) -> bool:
    """Whether a session was shown, and if not where the calibration in use is verified."""
    if not seen["session"]:
        ui.notify(texts.REFUSED.format(reason=texts.NOT_OPEN), type="warning", multi_line=True)
    return bool(seen["session"])


def _is_touch(teaching: Reply, number: int | None) -> bool:
    """Whether that sample has a target."""
    samples = teaching.get("samples", ())
    return any(one["sample"] == number and one["kind"] in _TOUCHES for one in samples)


def _dated(value: object, *, is_old: bool) -> object:
    """A value, marked where it is of other samples than there are now."""
    is_there = value not in (None, "", texts.NONE)
    return texts.OLD.format(value=in_words(value)) if is_old and is_there else value


def _trouble(teaching: Reply, disk: Reply) -> str:
    """Why not all is recorded, each reason once; "" where all is."""
    said: list[str] = []
    for words in (teaching.get("warning"), teaching.get("trouble"), disk.get("trouble")):
        if words and not any(words in one for one in said):
            said.append(str(words))
    return "; ".join(said)


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
