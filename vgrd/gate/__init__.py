"""The parent process: serves the registers, supervises the others, talks to systemd.

May import registers and ipc: the standard library and structlog, no numpy and no pydantic.
"""
