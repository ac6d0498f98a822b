"""Advice on the session being recorded, from a process of its own that no sample waits for.

python -m vgrd.solving.advisor answers requests, one JSON line each, until its input ends.
"""

import asyncio
import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import structlog

from vgrd import logs
from vgrd.errors import CalibrationError, ControlError, InputError, InternalError, VgrdError
from vgrd.model import Policy
from vgrd.niceness import give_way
from vgrd.solving.sample_numbers import SampleNumbers, samples_named
from vgrd.store.sessions import load_session

BRIEF_S = 0.25  # an operator does not notice it after a touch
FULL_S = 60.0  # beyond it something hangs
WAIT_S = 2.0  # of `vgrd advise`: an operator waits as long without wondering
PENDING: Mapping[str, Any] = {"pending": "still computing; ask with: vgrd advise --wait 60"}

log = structlog.get_logger()


class Advisor:
    """Asks the advising process; latest wins, and a process that hangs or dies is started anew."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy
        self._process: asyncio.subprocess.Process | None = None
        self._turn = asyncio.Lock()
        self._newest = 0
        self._tasks: set[asyncio.Task[Mapping[str, Any]]] = set()
        self._group: asyncio.TaskGroup | None = None
        self._latest: tuple[tuple[str, int], asyncio.Task[Mapping[str, Any]]] | None = None

    async def run(self) -> None:
        """Own what is being computed, until cancelled: a fault of ours in it is raised here."""
        async with asyncio.TaskGroup() as self._group:
            await asyncio.Event().wait()

    async def start(self) -> None:
        """Let the process load what it needs before the first sample comes."""
        async with self._turn:
            await self._living()

    async def brief(self, folder: Path, version: int) -> Mapping[str, Any]:
        """Advice on a session if it comes quickly, else word that it is pending.

        version: another one with every change of the session.
        """
        task = self._asked({"folder": str(folder), "policy": self.policy.value}, version)
        await asyncio.wait({task}, timeout=BRIEF_S)
        return PENDING if not task.done() or task.cancelled() else task.result()

    async def full(
        self, folder: Path, version: int, wait_s: float, **limits: str | float
    ) -> Mapping[str, Any]:
        """The same after a longer wait; limits: policy, tilt_deg, yaw_deg. Raises CalibrationError.

        What is still computed goes on, and is there when the same is asked again.
        """
        request = {"folder": str(folder), "policy": self.policy.value, **limits}
        task = self._asked(request, version)
        await asyncio.wait({task}, timeout=wait_s)
        if not task.done():
            return PENDING
        if task.cancelled() or "pending" in task.result():
            raise CalibrationError("a newer sample came in between, or advising failed: ask again")
        return task.result()

    async def close(self) -> None:
        """End the process."""
        self._newest += 1
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._end()

    def _asked(self, request: Mapping[str, Any], version: int) -> asyncio.Task[Mapping[str, Any]]:
        """What is computed for this state of the session; already, or from now on."""
        if self._group is None:
            raise ControlError("advice is not being given: the cell is only starting")
        key = (json.dumps(request, sort_keys=True), version)
        if self._latest is not None and self._latest[0] == key and _is_of_use(self._latest[1]):
            return self._latest[1]
        self._newest += 1
        task = self._group.create_task(self._answer(request, self._newest))
        self._latest = (key, task)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def _answer(self, request: Mapping[str, Any], number: int) -> Mapping[str, Any]:
        async with self._turn:
            if number < self._newest:
                return PENDING
            try:
                async with asyncio.timeout(FULL_S):
                    return await self._exchanged(request)
            except (OSError, EOFError, TimeoutError, ValueError) as err:
                log.warning("advice_failed", reason=repr(err))
                await self._end()
                return PENDING

    async def _exchanged(self, request: Mapping[str, Any]) -> Mapping[str, Any]:
        process = await self._living()
        if process.stdin is None or process.stdout is None:
            raise EOFError
        process.stdin.write(json.dumps(request).encode() + b"\n")
        await process.stdin.drain()
        line = await process.stdout.readline()
        if not line:
            raise EOFError
        return dict(json.loads(line))

    async def _living(self) -> asyncio.subprocess.Process:
        if self._process is None or self._process.returncode is not None:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "vgrd.solving.advisor",
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
            )
        return self._process

    async def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            if process.returncode is None:
                process.kill()
            await process.communicate()


def _is_of_use(task: asyncio.Task[Mapping[str, Any]]) -> bool:
    """Whether an answer came or may come still."""
    if not task.done():
        return True
    return not task.cancelled() and task.exception() is None and "pending" not in task.result()


def advise_folder(
    folder: Path, policy: Policy, tilt_deg: float | None = None, yaw_deg: float | None = None
) -> dict[str, object]:
    """Advice on a session folder, open or closed; JSON-able. Limits None: as the session suggests."""
    from vgrd.calibration.planning import (
        Reach,  # of the advising process: the cell starts without
        advise_session,
    )

    session = load_session(folder)
    recording, numbers = session.recording, SampleNumbers(session)
    reach = Reach.of(recording)
    if tilt_deg is not None:
        reach = replace(reach, max_tilt_rad=float(np.radians(tilt_deg)))
    if yaw_deg is not None:
        reach = replace(reach, max_yaw_rad=float(np.radians(yaw_deg)))
    return _numbered(advise_session(recording, policy, reach).to_json(), numbers)


def _numbered(advice: dict[str, Any], numbers: SampleNumbers) -> dict[str, Any]:
    """With the numbers by which samples are undone."""
    words = [numbers.told(one["message"]) for one in advice["findings"]]
    findings = [
        {**one, "message": told, "samples": samples_named(told)}
        for one, told in zip(advice["findings"], words, strict=True)
    ]
    touches = [{**one, "name": numbers.told(one["name"])} for one in advice["touches"]]
    trouble = numbers.told(advice["trouble"])
    return {**advice, "findings": findings, "trouble": trouble, "touches": touches}


def policy_called(name: str) -> Policy:
    """Policy of that name; InputError with the known names."""
    if name not in list(Policy):
        raise InputError(f"policy {name!r}: choose one of {', '.join(Policy)}")
    return Policy(name)


def answer_line(line: str) -> str:
    """One request of the advising process answered."""
    request = json.loads(line)
    limits = {key: request.get(key) for key in ("tilt_deg", "yaw_deg")}
    policy = Policy(request["policy"])
    try:
        advice = advise_folder(Path(request["folder"]), policy, **limits)
    except VgrdError as err:
        advice = {"policy": policy.value, "trouble": str(err), "next": None}
    except Exception as err:
        log.exception("advice_failed")
        fault = InternalError.of("advise", err)
        advice = {"policy": policy.value, "trouble": str(fault), "next": None}
    return json.dumps(advice, allow_nan=False)


def main() -> int:
    """Entry point of the advising process."""
    logs.configure("advisor")
    give_way()
    for line in sys.stdin:
        sys.stdout.write(answer_line(line) + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
