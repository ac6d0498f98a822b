"""Buttons for a person who plays the operator of a fake cell: they move its arm and its table, and nothing else.

A small page of its own beside the operator's page, in plain HTML: a real cell has a pendant there.
"""

import math
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Self
from urllib.parse import unquote

import numpy as np

from fakes.cell.operator import SETTLE_S
from fakes.world.poses import WORK_ROTATION, retracted_pose
from fakes.world.world import World
from vgrd.geometry import Array, Pose, exp_rotation

_TILT_RAD = np.radians(25)  # as the wizard asks for
_TURN_RAD = math.pi / 6  # of one press
_LIFT_MM = 30.0  # clear of the object before the arm goes elsewhere
_STYLE = (
    "body{font:18px sans-serif;background:#dcdfe3;color:#16191d;margin:16px}button{min-height:72px;"
    "min-width:120px;margin:6px;font:700 18px sans-serif}h1{font-size:22px}"
)

Act = Callable[[], float]


class Playground:
    """Serves the buttons at a port of loopback while it is open."""

    def __init__(self, world: World, port: int) -> None:
        self._world = world
        self._side = 0.0
        acts = self._buttons = self._acts()
        page = _page(acts)

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self._send(200, page)

            def do_POST(self) -> None:
                act = acts.get(unquote(self.path.removeprefix("/")))
                if self.headers.get("X-Pressed") != "yes":  # no other page may send it
                    self._send(403, b"press the buttons of this page")
                elif act is None:
                    self._send(404, b"no such button")
                else:
                    _perform(act)
                    self._send(200, b"done")

            def _send(self, code: int, body: bytes) -> None:
                self.send_response(code)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:  # noqa: A002
                """Nothing is logged: presses are seen in the world."""

        self._server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._thread = threading.Thread(target=self._server.serve_forever, name="playground")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def press(self, label: str) -> None:
        """Press a button; returns when the move has ended."""
        _perform(self._buttons[label])

    def _acts(self) -> Mapping[str, Act]:
        """By its label what each button does; returns when the move ends."""
        acts: dict[str, Act] = {
            "arm aside": self._aside,
            "turn the object by 30 degrees": lambda: self._turn(_TURN_RAD),
            "turn the object by 90 degrees": lambda: self._turn(3 * _TURN_RAD),
        }
        for name in self._world.targets:
            acts[f"tip on {name}"] = partial(self._touch, name, lambda: WORK_ROTATION)
            acts[f"tip on {name}, tilted"] = partial(self._touch, name, self._tilted)
        return acts

    def _aside(self) -> float:
        self._lift()
        return self._world.move_flange(retracted_pose(self._world.layout), time.monotonic())

    def _turn(self, angle_rad: float) -> float:
        self._aside()
        now = time.monotonic()
        return self._world.turn_table(self._world.table_angle(now) + angle_rad, now)

    def _touch(self, name: str, wrist: Callable[[], Array]) -> float:
        self._lift()
        return self._world.jog_onto(name, wrist(), time.monotonic())

    def _lift(self) -> None:
        """Off the object first, along the tool."""
        pose = self._world.reported_flange(time.monotonic())
        away = -_LIFT_MM * (pose.rotation @ self._world.layout.tool_axis_in_wrist)
        arrival_s = self._world.move_flange(
            Pose(pose.rotation, pose.translation + away), time.monotonic()
        )
        time.sleep(max(0.0, arrival_s - time.monotonic()))

    def _tilted(self) -> Array:
        """To another side each time."""
        self._side += 2.0
        axis = np.array([math.cos(self._side), math.sin(self._side), 0.0])
        return exp_rotation(_TILT_RAD * axis) @ WORK_ROTATION


def _perform(act: Act) -> None:
    """Do it, and let it come to rest."""
    time.sleep(max(0.0, act() - time.monotonic()) + SETTLE_S)


def _page(acts: Mapping[str, Act]) -> bytes:
    buttons = "".join(f"<button>{escape(label)}</button>" for label in acts)
    script = (
        "onclick=async e=>{const b=e.target;if(b.tagName!='BUTTON')return;b.disabled=true;try{await "
        "fetch('/'+encodeURIComponent(b.textContent),{method:'POST',headers:{'X-Pressed':'yes'}})}"
        "finally{b.disabled=false}}"
    )
    return (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>fake cell</title><style>{_STYLE}</style>"
        f"<h1>The arm and the table of the fake cell</h1>{buttons}<script>{script}</script></html>"
    ).encode()
