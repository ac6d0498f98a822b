"""Logging for all processes: console on a terminal, JSON lines otherwise."""

import logging
import os
import sys

import structlog


def configure(process: str, *, level: str | None = None) -> None:
    """Set up structlog on standard error and bind the name of the process to every line."""
    chosen = level or os.environ.get("VGRD_LOG_LEVEL", "info")
    renderer: structlog.typing.Processor = (
        structlog.dev.ConsoleRenderer()
        if sys.stderr.isatty()
        else structlog.processors.JSONRenderer()
    )
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.getLevelName(chosen.upper())),
        logger_factory=structlog.WriteLoggerFactory(file=sys.stderr),
        cache_logger_on_first_use=True,
    )
    structlog.contextvars.bind_contextvars(process=process)
