"""Runs config/robot_programs/urscript/vgrd.script in a world, frame by frame."""

import re
from pathlib import Path
from typing import Any

from tests.robot_programs.python_run import flat
from tests.robot_programs.urscript.built_ins import BUILT_INS
from tests.robot_programs.urscript.controller import Controller, PoseValue
from tests.robot_programs.urscript.translation import translate
from tests.robot_programs.world import BOX_MM, TAUGHT, Outcome, World

FOLDER = Path(__file__).parents[3] / "config" / "robot_programs" / "urscript"
FILE = FOLDER / "vgrd.script"
_TRANSPORT = re.compile(r"^# --- transport.*?^# --- end of transport\n", re.DOTALL | re.MULTILINE)


def script_for_cb3() -> str:
    """The script with the other transport, as its user puts it together."""
    transport = _TRANSPORT.search((FOLDER / "transport_cb3.script").read_text())
    return _TRANSPORT.sub(lambda _: transport[0], FILE.read_text())


class UrscriptRun:
    """The script in a world. Between `start` and `press_key` its popup stands there."""

    def __init__(self, world: World, source: str):
        self.world = world
        self.controller = Controller(world)
        built_ins = {name: getattr(self.controller, name) for name in BUILT_INS}
        flow = {name: getattr(self.controller, name) for name in ("run_", "kill_", "join_")}
        self.names: dict[str, Any] = {**built_ins, **flow, "pose_": PoseValue}
        exec(compile(translate(source), FILE.name, "exec"), self.names)  # noqa: S102
        low, high = (TAUGHT.translation + way for way in (-BOX_MM, BOX_MM))
        x, y, z, *turn = flat(TAUGHT)
        self.names |= {
            "VGRD_TAUGHT": PoseValue([x / 1e3, y / 1e3, z / 1e3, *turn]),
            "VGRD_BOX_LOW": list(low / 1e3),
            "VGRD_BOX_HIGH": list(high / 1e3),
            "vgrd_trig": world.first_trig,
        }

    def start(self) -> Outcome:
        """Run until it rests."""
        self._main = self.controller.start(self.names["vgrd_cycle"])
        return self._until_rest()

    def wait(self, seconds: float) -> None:
        """Nobody presses the key."""
        end_s = self.world.clock.monotonic() + seconds
        while self.world.clock.monotonic() < end_s:
            self.controller.frame()

    def press_key(self) -> Outcome:
        """The operator's one key: Continue."""
        self.controller.waits_for_key = False
        return self._until_rest()

    def close(self) -> None:
        """The program ends."""
        self.controller.close()

    def _until_rest(self) -> Outcome:
        while self._main.lives and not self.controller.waits_for_key:
            self.controller.frame()
        return self.world.outcome(self.names["vgrd_word"], self.names["vgrd_status"])
