"""The cell process; started by the gate: `python -m vgrd.cell RESOLVED_FILE`."""

import asyncio
import contextlib
import gc
import os
import socket
import sys
from pathlib import Path

import structlog

from vgrd import logs
from vgrd.cell.control.operations import Operations
from vgrd.cell.control.server import ControlServer
from vgrd.cell.detector import Detector
from vgrd.cell.measuring import Measuring
from vgrd.cell.recording.housekeeping import Housekeeping
from vgrd.cell.recording.pedal import FootTouches
from vgrd.cell.recording.questions import OpenQuestions
from vgrd.cell.recording.recorder import Recorder
from vgrd.cell.recording.teaching import Teaching
from vgrd.cell.serving.activation import Activation
from vgrd.cell.serving.answering import Limits
from vgrd.cell.serving.diary import Diary
from vgrd.cell.serving.latches import LatchBook
from vgrd.cell.serving.service import Serving
from vgrd.cell.serving.vouching import Hold
from vgrd.clock import Clock, SystemClock
from vgrd.config.resolved import Resolved, load_resolved
from vgrd.config.setup import CONTROL_SOCKET, camera_stability, cell_bounds, cell_facts
from vgrd.errors import StoreError, VgrdError
from vgrd.ipc.health import HealthReporter
from vgrd.ipc.messages import decode_line, encode_line
from vgrd.ipc.ring import RingWriter
from vgrd.model import CellFacts, Policy
from vgrd.registers import PACKED_BYTES, REGISTER_KIND, REGISTER_RING, parse_message
from vgrd.solving.advisor import Advisor
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.sessions import list_sessions, recover_session, session_directory
from vgrd.vision.tags.tag_finder import TagDetector

HEALTH_S = 0.02  # five in each look of the gate (0.1 s), so that a late one is no silence

log = structlog.get_logger()


class GateGone(Exception):
    """The gate has hung up: nobody shows any more what this process publishes."""


class Cell:
    """Everything the process is made of, put together once.

    detector: finds the tags in pictures; None: in their pixels.
    """

    def __init__(self, resolved: Resolved, clock: Clock, detector: Detector | None = None) -> None:
        config = resolved.config
        runtime, state = Path(config.cell.runtime_dir), Path(config.cell.state_dir)
        self.state = state
        facts = cell_facts(config)
        serving = config.serving
        self.health = HealthReporter(runtime, "cell", clock)
        camera = config.camera
        self.measuring = Measuring(
            runtime,
            detector or _tag_detector(facts),
            facts,
            clock,
            camera.rate_hz,
            camera.watch_rate_hz,
            1e-3 * camera.delay_ms,
        )
        self.recorder = Recorder(state, clock)
        recording = config.recording
        self.housekeeping = Housekeeping(
            state, self.recorder, recording.quota_gb, recording.keep_free_gb
        )
        ring = RingWriter.create(runtime / REGISTER_RING, 4, PACKED_BYTES, REGISTER_KIND)
        limits = Limits(
            Policy(serving.policy),
            serving.max_age_s,
            serving.max_u95_mm,
            serving.warn_u95_mm,
            serving.moved_mm,
            serving.timeout_s,
            Hold(serving.hold_s if serving.hidden_tag == "hold" else 0.0, serving.approach_mm),
            cell_bounds(config),
        )
        self.serving = Serving(
            self.measuring,
            ring,
            limits,
            camera_stability(config),
            clock,
            simulation=config.cell.simulation,
        )
        self.latches = LatchBook(runtime, state)
        self.serving.faults.latched = self.latches.latched
        self.serving.faults.on_latch.append(self.latches.note)
        self.advisor = Advisor(Policy(serving.policy))
        questions = OpenQuestions(lambda: self.serving.calibration, camera_stability(config))
        teaching = Teaching(
            self.measuring,
            self.recorder,
            facts,
            config.touch,
            self.advisor,
            questions=questions,
        )
        most_adopted = (camera.stability_mm, 1e-3 * camera.stability_mrad)
        store = CalibrationStore(state, clock)
        self.activation = Activation(self.serving, store, facts, most_adopted)
        self.operations = Operations(
            self.latches,
            self.measuring,
            self.serving,
            teaching,
            self.activation,
            runtime,
            state,
            clock,
            resolved,
        )
        self.diary = Diary(state, self.serving.faults, clock)
        self.operations.views.diary = self.diary.to_json
        self.operations.disk = self.housekeeping.status
        self.pedal = FootTouches(teaching, runtime, clock, config.pedal.robot_input)
        self.operations.pedal = self.pedal.status
        self.control = ControlServer(runtime / CONTROL_SOCKET, self.operations.table())
        self.measuring.on_readings.append(self.recorder.on_readings)
        self.measuring.on_readings.append(self.pedal.on_readings)
        self.measuring.on_sight.append(self.recorder.on_sight)
        self.measuring.on_sight.append(teaching.on_sight)

    async def run(self, gate: socket.socket) -> None:
        """Work until cancelled. Raises GateGone, alone or with other reasons, in a group."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self.activation.load_current())
            tasks.create_task(asyncio.to_thread(self._recover))
            tasks.create_task(self.measuring.run())
            tasks.create_task(self.serving.run())
            tasks.create_task(self.latches.run())
            tasks.create_task(self.advisor.run())
            tasks.create_task(self.pedal.run())
            tasks.create_task(self.control.serve())
            tasks.create_task(self.housekeeping.run())
            tasks.create_task(self.diary.run())
            tasks.create_task(self._tell_health())
            tasks.create_task(self._obey(gate))

    def _recover(self) -> None:
        """Make sessions whole that a kill left open, and go on with the newest; what cannot be read is told."""
        for name in list_sessions(self.state):
            try:
                recovered = recover_session(session_directory(self.state, name))
            except StoreError as err:
                log.warning("session_not_recovered", session=name, reason=str(err))
            else:
                if recovered:
                    log.info("session_recovered", session=name, segments=len(recovered))
        try:
            self.operations.wizard.take_up(self.state)
        except StoreError as err:
            log.warning("session_not_taken_up", reason=str(err))

    async def _tell_health(self) -> None:
        while True:
            fault = self.serving.fault()
            self.health.count = self.measuring.beat
            self.health.progress("ok", fault[1] if fault else "")
            self.recorder.tick()
            await asyncio.sleep(HEALTH_S)

    async def _obey(self, gate: socket.socket) -> None:
        """Requests of the robot, passed on by the gate; the end of the link is the end of the process."""
        reader, writer = await asyncio.open_unix_connection(sock=gate)
        writer.write(encode_line({"op": "ready"}))
        with contextlib.suppress(ConnectionError):
            while line := await reader.readline():
                self._obey_line(line)
        raise GateGone

    def _obey_line(self, line: bytes) -> None:
        message = decode_line(line)
        if message["op"] == "request":
            self.serving.request(parse_message(message))
        elif message["op"] == "abort":
            self.serving.abort()


def _tag_detector(facts: CellFacts) -> TagDetector:
    return TagDetector(
        facts.camera_matrix,
        facts.distortion,
        facts.tags,
        facts.image_size_px,
        facts.tag_sigmas_mm,
    )


def main() -> int:
    """Entry point; VGRD_GATE_FD is the inherited link to the gate."""
    logs.configure("cell")
    try:
        cell = Cell(load_resolved(Path(sys.argv[1])), SystemClock())
    except VgrdError as err:
        log.warning("cell_not_started", reason=str(err))
        return err.exit_code
    gate = socket.socket(fileno=int(os.environ["VGRD_GATE_FD"]))
    gc.freeze()  # what was loaded stays: a full collection need not walk it and hold up an answer
    asyncio.run(_live(cell, gate))
    return 0


async def _live(cell: Cell, gate: socket.socket) -> None:
    try:
        await cell.run(gate)
    except* GateGone:
        log.warning("gate_gone")
    # At once: asyncio and the interpreter would wait for threads, which may wait for a disk or a lock.
    os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
