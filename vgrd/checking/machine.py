"""What the computer must allow: folders, the port, addresses. Nothing is written, nothing listens."""

import getpass
import grp
import os
import pwd
import socket
from collections.abc import Iterator, Mapping
from ipaddress import ip_address, ip_network
from pathlib import Path
from typing import Any

from vgrd.checking.remarks import Remark, doubt, fault
from vgrd.config.cell_file import CellSection, RobotSection, ServingSection
from vgrd.config.page_section import PageSection
from vgrd.config.setup import (
    RUNTIME_PARTS,
    SOCKET_FOLDER_BYTES,
    STATE_PARTS,
)
from vgrd.errors import InputError
from vgrd.permissions import check_ours

_FREE_FROM = Path("/proc/sys/net/ipv4/ip_unprivileged_port_start")  # Linux since 4.11
_USUAL_FREE_FROM = 1024


def first_free_port() -> int:
    """The lowest port that a process without privileges may listen at."""
    try:
        return int(_FREE_FROM.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return _USUAL_FREE_FROM


def folder_remarks(cell: CellSection, data: Mapping[str, Any]) -> Iterator[Remark]:
    """On the folders that the file names; those it leaves out are systemd's business."""
    named = data.get("cell", {})
    group, trouble = None, ""
    try:
        group = grp.getgrnam(cell.group).gr_gid if cell.group else None
    except KeyError:
        trouble = f"no group {cell.group!r} here: groupadd --system {cell.group}, or leave it out"
        yield fault(trouble, "cell", "group")
    for key, parts in (("state_dir", STATE_PARTS), ("runtime_dir", RUNTIME_PARTS)):
        path = Path(getattr(cell, key))
        if not named.get(key):
            continue
        if owner := _other_owner(path):
            words = f"{path} is {owner}'s: right if the daemon runs as {owner}, else chown it"
            yield doubt(words, "cell", key)
        elif problem := _folder_trouble(path):
            words = f"{path}: {problem}; name a folder that the daemon's user may write"
            yield fault(words, "cell", key)
        elif path.is_dir() and not trouble:
            try:
                check_ours(path, group, parts)
            except InputError as err:
                yield fault(str(err), "cell", key)
    if len(os.fsencode(cell.runtime_dir)) > SOCKET_FOLDER_BYTES:
        yield fault(
            f"{cell.runtime_dir}: too long for a Unix socket in it (more than {SOCKET_FOLDER_BYTES} "
            "bytes): name a shorter path",
            "cell",
            "runtime_dir",
        )


def _other_owner(path: Path) -> str:
    """Who owns a folder that is there and that we may not use; empty where we may."""
    if not path.is_dir() or os.access(path, os.R_OK | os.W_OK | os.X_OK):
        return ""
    uid = path.stat().st_uid
    try:
        return "" if uid == os.geteuid() else pwd.getpwuid(uid).pw_name
    except KeyError:
        return f"user {uid}"


def _folder_trouble(path: Path) -> str:
    """Why a folder cannot be made or written; empty where it can."""
    above = path
    while not os.path.lexists(above) and above != above.parent:
        above = above.parent
    if not above.is_dir():
        return f"{above} is no folder"
    room = os.statvfs(above)
    if not room.f_blocks:
        return f"{above} is the kernel's own and stores nothing"
    if room.f_flag & os.ST_RDONLY:
        return f"{above} is mounted read-only"
    if not os.access(above, os.W_OK | os.X_OK):
        return f"user {getpass.getuser()} may not write in {above}"
    return ""


def address_remarks(serving: ServingSection, free_from: int) -> Iterator[Remark]:
    """On where the registers are served, and for whom."""
    if not _is_ours(serving.host):
        yield fault(
            f"this machine does not have the address {serving.host}: write the one at which the robot "
            "reaches it (ip -4 addr tells them), or 0.0.0.0 for all of them",
            "serving",
            "host",
        )
    if serving.port < free_from:
        yield doubt(
            f"ports below {free_from} need a privilege that the daemon does not have: take 1502, or let systemd "
            "open it by config/vgrd.socket (docs/service.md)",
            "serving",
            "port",
        )
    if serving.line_port is not None and serving.line_port < free_from:
        words = (
            f"ports below {free_from} need a privilege that the daemon does not have: take 1503"
        )
        yield doubt(words, "serving", "line_port")
    for index, entry in enumerate(serving.allow):
        if entry in serving.allow[:index]:
            yield doubt(f"{entry} stands there twice: drop one", "serving", "allow", index)
        if ip_network(entry).prefixlen == 0:
            words = f"{entry} is everybody: write the robot's address"
            yield doubt(words, "serving", "allow", index)


def page_remarks(page: PageSection) -> Iterator[Remark]:
    """On the files of the page; their paths are resolved. Whether they are good, the page says as it starts."""
    for key, remedy in (
        ("certificate", "docs/page.md tells how to make one"),
        ("key", "docs/page.md tells how to make one"),
        ("password_file", "make it by `vgrd page-password FILE`, as the daemon's user"),
    ):
        path = getattr(page, key)
        if path is not None and not os.path.isfile(path):  # noqa: PTH113  Path raises where a folder is closed
            yield doubt(
                f"{path}: user {getpass.getuser()} sees no such file; {remedy}", "page", key
            )


def robot_reach_remarks(serving: ServingSection, robot: RobotSection) -> Iterator[Remark]:
    """Whether the robot may connect, as far as the file tells its address."""
    away = [entry for entry in serving.allow if not ip_network(entry).is_loopback]
    if _is_loopback(serving.host):
        if away:
            yield doubt(
                f"{serving.host} is reached from this machine only, and allow names {', '.join(away)}: write the "
                "address of this machine at which the robot reaches it",
                "serving",
                "host",
            )
        return
    host = robot.settings.get("host")
    try:
        address = ip_address(host) if isinstance(host, str) else None
    except ValueError:
        return
    if address and not any(address in ip_network(entry) for entry in serving.allow):
        words = f"the robot at {host} is not listed and may not connect: add its address"
        yield doubt(words, "serving", "allow")


def _is_loopback(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _is_ours(host: str) -> bool:
    """Whether a socket can be bound to a host's address; none listens."""
    try:
        found = socket.getaddrinfo(host, 0, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError):
        return False
    family, kind, protocol, _, address = found[0]
    with socket.socket(family, kind, protocol) as probe:
        try:
            probe.bind(address)
        except OSError:
            return False
    return True
