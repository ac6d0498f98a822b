"""Entry point of the parent process: `python -m vgrd.gate RUNTIME_DIR`; `vgrd run` becomes it."""

import asyncio
import gc
import os
import sys
from pathlib import Path

import structlog

from vgrd import logs
from vgrd.clock import SystemClock
from vgrd.errors import VgrdError
from vgrd.gate.gate import Gate, lock
from vgrd.gate.settings import PROCESS_TABLE, load_settings


async def serve(runtime_dir: Path) -> None:
    """Run the gate of the process table in `runtime_dir`. Raises VgrdError."""
    gate = Gate(load_settings(runtime_dir / PROCESS_TABLE), runtime_dir, SystemClock())
    gc.collect()
    gc.freeze()
    await gate.run()


def main(argv: list[str]) -> int:
    """Return the exit code: 0 after a clean stop, 69 port taken or second daemon, 78 bad table."""
    logs.configure("gate", threads=False)
    log = structlog.get_logger()
    if len(argv) != 1:
        log.error("usage", command="python -m vgrd.gate RUNTIME_DIR")
        return os.EX_USAGE
    runtime_dir = Path(argv[0])
    try:
        lock(runtime_dir)
        asyncio.run(serve(runtime_dir))
    except VgrdError as error:
        log.error("not_serving", reason=str(error))  # noqa: TRY400
        return error.exit_code
    except OSError as error:
        log.error("not_serving", reason=f"{runtime_dir}: {error.strerror}")  # noqa: TRY400
        return os.EX_CANTCREAT
    return os.EX_OK


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
