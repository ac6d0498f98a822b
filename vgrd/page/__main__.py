"""The process of the page: `python -m vgrd.page RUNTIME_DIR HOST PORT [TERMS]`, started by the gate.

TERMS: who may come in, as JSON, by the keys of `vgrd.page.access.terms`.
"""

import json
import sys
from importlib.util import find_spec
from pathlib import Path

import structlog

from vgrd import logs
from vgrd.clock import SystemClock
from vgrd.errors import ServingError
from vgrd.ipc.health import HealthReporter
from vgrd.niceness import give_way

log = structlog.get_logger()


def _check_package() -> None:
    if find_spec("nicegui") is None:
        raise ServingError("the page needs another package: pip install 'vgrd[page]'")


def main(runtime_dir: Path, host: str, port: int, terms: str = "{}") -> int:
    """Serve until killed; an exit code where that is not possible."""
    logs.configure("page")
    give_way()
    clock = SystemClock()
    health = HealthReporter(runtime_dir, "page", clock)
    try:
        _check_package()
        from vgrd.page.access.terms import Terms
        from vgrd.page.link import Link
        from vgrd.page.server import serve

        serve(Link(runtime_dir, clock), health, host, port, Terms(**json.loads(terms)), clock)
    except ServingError as error:
        health.report("refused", str(error))
        log.error("no_page", reason=str(error))  # noqa: TRY400  a line, not a trace
    return ServingError.exit_code


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), *sys.argv[4:]))
