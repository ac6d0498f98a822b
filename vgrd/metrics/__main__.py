"""The process that tells Prometheus: `python -m vgrd.metrics RUNTIME_DIR HOST PORT`, started by the gate."""

import asyncio
import sys
from pathlib import Path

import structlog

from vgrd import logs
from vgrd.clock import Clock, SystemClock
from vgrd.errors import ServingError
from vgrd.ipc.health import PERIOD_S, HealthReporter
from vgrd.metrics.exposition import exposition
from vgrd.metrics.facts import Facts, report_of, status_of
from vgrd.metrics.server import Scrapes, listening_at
from vgrd.niceness import give_way

log = structlog.get_logger()


async def _serve(runtime_dir: Path, host: str, port: int, clock: Clock) -> None:
    health = HealthReporter(runtime_dir, "metrics", clock)

    def text(scrapes: Scrapes) -> bytes:
        give_way()  # of the thread that reads; it may be a new one
        status, report = status_of(runtime_dir), report_of(runtime_dir, clock)
        return exposition(Facts(status, report, scrapes.answered, dict(scrapes.dropped)))

    with listening_at(host, port) as listening:
        log.info("telling_metrics", host=host, port=port)
        async with asyncio.TaskGroup() as tasks:
            serving = tasks.create_task(Scrapes(text).serve(listening))
            while not serving.done():
                health.progress("ok")
                await asyncio.sleep(PERIOD_S)


def main(runtime_dir: Path, host: str, port: int) -> int:
    """Serve until killed; an exit code where the address cannot be had."""
    logs.configure("metrics")
    give_way()
    clock = SystemClock()
    try:
        asyncio.run(_serve(runtime_dir, host, port, clock))
    except ServingError as error:
        HealthReporter(runtime_dir, "metrics", clock).report("refused", str(error))
        log.error("no_metrics", reason=str(error))  # noqa: TRY400  a line, not a trace
    return ServingError.exit_code


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])))
