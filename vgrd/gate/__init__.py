"""The parent process: serves registers and lines, supervises the others, talks to systemd.

May import registers, lines and ipc: the standard library and structlog, no numpy and no pydantic.
"""
