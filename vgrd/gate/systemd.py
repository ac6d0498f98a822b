"""What systemd and the daemon say to each other: readiness, watchdog, a socket handed over."""

import os
import socket
from typing import Final

import structlog

from vgrd.errors import ServingError

_FIRST_FD: Final = 3  # SD_LISTEN_FDS_START of sd_listen_fds(3)

log = structlog.get_logger()


class ServiceManager:
    """The service manager that started the daemon; a message that it does not take is sent again.

    Its queue may be full for a while, or it may be restarting. A gate that serves does not end for
    that. A service manager that hears nothing for too long ends the gate.
    """

    def __init__(self) -> None:
        self._unsent: dict[str, str] = {}

    def tell(self, **variables: str) -> bool:
        """Send READY="1", STATUS="...", WATCHDOG="1" or STOPPING="1"; False: not taken yet."""
        self._unsent |= variables
        return self.catch_up()

    def catch_up(self) -> bool:
        """Send what was not taken before."""
        if not self._unsent:
            return True
        try:
            notify(*(f"{name}={value}" for name, value in self._unsent.items()))
        except OSError as error:
            log.warning("service_manager_unreachable", reason=error.strerror)
            return False
        self._unsent = {}
        return True


def notify(*lines: str) -> bool:
    """Send READY=1, STATUS=..., WATCHDOG=1 or STOPPING=1; False when nobody listens.

    Raises OSError when the service manager named a socket that does not take the message.
    """
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return False
    if address.startswith("@"):
        address = "\0" + address[1:]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as link:
        link.setblocking(False)
        link.sendto("\n".join(lines).encode(), address)
    return True


def watchdog_period_s() -> float | None:
    """How often to send WATCHDOG=1: half of what systemd allows, None when it does not watch."""
    allowed_us = os.environ.get("WATCHDOG_USEC", "")
    watched = os.environ.get("WATCHDOG_PID", str(os.getpid()))
    if not allowed_us.isdigit() or watched != str(os.getpid()):
        return None
    return int(allowed_us) / 2e6  # s, half of it: as sd_watchdog_enabled(3) recommends


def inherited_socket() -> socket.socket | None:
    """The listening socket that a socket unit handed to this very process, None without one.

    Raises ServingError when it is more than one, or not a listening TCP socket.
    """
    count = os.environ.get("LISTEN_FDS", "")
    if os.environ.get("LISTEN_PID") != str(os.getpid()) or not count.isdigit() or count == "0":
        return None
    if count != "1":
        raise ServingError(
            f"{count} sockets were handed over and the registers are served at one address:"
            " keep one ListenStream= in the socket unit"
        )
    os.set_inheritable(_FIRST_FD, False)  # the children's business ends at the rings
    inherited = socket.socket(fileno=_FIRST_FD)
    listens = inherited.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
    if inherited.family not in (socket.AF_INET, socket.AF_INET6) or not listens:
        inherited.close()
        raise ServingError(
            "the socket handed over is not a listening TCP socket: the socket unit needs"
            " ListenStream=ADDRESS:PORT and Accept=no"
        )
    return inherited
