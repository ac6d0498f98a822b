"""Runs a unit's ExecStart= the way systemd would confine it, where systemd does not run.

    python -m fakes.confinement.namespaces UNIT FOLDER [VISIBLE ...] [-- COMMAND ...]

FOLDER/run, FOLDER/state and FOLDER/cache become the unit's directories. VISIBLE stays readable though
ProtectHome= or PrivateTmp= would hide it. COMMAND runs instead of ExecStart=. What is enforced is read
from the unit: see `ENFORCED`. As root it takes a user of its own, else it keeps the one it has.
"""

import ctypes
import os
import resource
import stat
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from fakes.confinement.seccomp import filters
from fakes.confinement.unit_file import Directives, is_on, last, read_section
from vgrd.orphans import die_with

SERVICE_USER: Final = 64990  # stands for the unit's User= and Group=; of nobody else
# What of a unit is enforced here. The rest is for the service manager or needs control groups.
ENFORCED: Final = frozenset(
    {
        "CacheDirectory",
        "CacheDirectoryMode",
        "CapabilityBoundingSet",
        "Environment",
        "ExecStart",
        "Group",
        "LimitCORE",
        "LockPersonality",
        "NoNewPrivileges",
        "PrivateDevices",
        "PrivateMounts",
        "PrivateTmp",
        "PrivateUsers",
        "ProtectControlGroups",
        "ProtectHome",
        "ProtectHostname",
        "ProtectKernelTunables",
        "ProtectProc",
        "ProtectSystem",
        "RestrictAddressFamilies",
        "RestrictNamespaces",
        "RestrictRealtime",
        "RestrictSUIDSGID",
        "RuntimeDirectory",
        "RuntimeDirectoryMode",
        "StateDirectory",
        "StateDirectoryMode",
        "SystemCallArchitectures",
        "SystemCallErrorNumber",
        "SystemCallFilter",
        "UMask",
        "User",
    }
)
# Nothing to do: the allow list and the empty set of capabilities refuse these already, or (RemoveIPC)
# it is work of the manager after the end.
IMPLIED: Final = frozenset(
    {"ProtectClock", "ProtectKernelLogs", "ProtectKernelModules", "RemoveIPC"}
)
_PLACES: Final = (
    ("Runtime", "run", "/run"),
    ("State", "state", "/var/lib"),
    ("Cache", "cache", "/var/cache"),
)
_HOMES: Final = ("/home", "/root", "/run/user")
_DEVICES: Final = ("null", "zero", "full", "random", "urandom", "tty")
_NEWNS, _NEWUTS, _NEWUSER = 0x20000, 0x4000000, 0x10000000  # CLONE_* of sched.h
_MS_NOSUID, _MS_NODEV, _MS_BIND = 2, 4, 0x1000  # sys/mount.h
_MS_REC, _MS_PRIVATE = 0x4000, 0x40000  # idem
_AT_FDCWD, _AT_RECURSIVE, _READ_ONLY = -100, 0x8000, 1  # fcntl.h, linux/mount.h
_MOUNT_SETATTR: Final = 442  # the same number on all architectures
_CAPBSET_DROP, _SET_DUMPABLE, _SET_NO_NEW_PRIVS = 24, 4, 38  # PR_* of sys/prctl.h
_libc = ctypes.CDLL(None, use_errno=True)


def _call(answer: int, step: str) -> None:
    if answer < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{step}: {os.strerror(number)}")


def _mount(source: str, target: str, kind: str, flags: int, options: str = "") -> None:
    answer = _libc.mount(
        source.encode(), target.encode(), kind.encode(), ctypes.c_ulong(flags), options.encode()
    )
    _call(answer, f"mount {kind} {target}")


def _cover(target: str, mode: str = "755") -> None:
    """Put an empty file system over a folder."""
    if Path(target).is_dir():
        _mount("tmpfs", target, "tmpfs", _MS_NOSUID | _MS_NODEV, f"mode={mode}")


def _set_read_only(target: str, *, on: bool, below: bool = False) -> None:
    attributes = (ctypes.c_uint64 * 4)(_READ_ONLY if on else 0, 0 if on else _READ_ONLY, 0, 0)
    flags = _AT_RECURSIVE if below else 0
    answer = _libc.syscall(
        _MOUNT_SETATTR, _AT_FDCWD, target.encode(), flags, attributes, ctypes.sizeof(attributes)
    )
    _call(answer, f"mount_setattr {target}")


@dataclass(frozen=True, slots=True)
class _Kept:
    """Something that shall be seen at `path` after what lies there was covered."""

    path: str
    fd: int

    @classmethod
    def of(cls, path: str, source: str = "") -> "_Kept":
        return cls(path, os.open(source or path, os.O_PATH | os.O_CLOEXEC))

    def bind(self) -> None:
        source = f"/proc/self/fd/{self.fd}"
        target = Path(self.path)
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            target.mkdir() if stat.S_ISDIR(os.fstat(self.fd).st_mode) else target.touch()
        _mount(source, self.path, "", _MS_BIND | _MS_REC)


def enter_namespaces() -> None:
    """Mounts and host name of one's own; without root, in a user namespace. Raises OSError."""
    root, user, group = os.geteuid() == 0, os.geteuid(), os.getegid()
    _call(_libc.unshare(_NEWNS | _NEWUTS | (0 if root else _NEWUSER)), "unshare")
    if not root:
        _map_self(user, group)
    _mount("none", "/", "", _MS_REC | _MS_PRIVATE)


def _map_self(user: int, group: int) -> None:
    Path("/proc/self/setgroups").write_text("deny")
    Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
    Path("/proc/self/gid_map").write_text(f"{group} {group} 1")


def arrange_files(unit: Directives, folder: Path, visible: Iterable[str]) -> None:
    """The file system as the unit's directives show it."""
    writable = [_directory(unit, kind, folder / name, base) for kind, name, base in _PLACES]
    mounts = [_Kept.of(path) for path in visible]
    devices = [_Kept.of(f"/dev/{name}") for name in _DEVICES]
    covered = [base for _, _, base in _PLACES]
    if is_on(unit, "ProtectHome"):
        covered += _HOMES
    for target in covered:
        _cover(target)
    if is_on(unit, "PrivateTmp"):
        for target in ("/tmp", "/var/tmp"):  # noqa: S108 (what the directive is about)
            _cover(target, "1777")
    if is_on(unit, "PrivateDevices"):
        _cover("/dev")
        Path("/dev/shm").mkdir()  # noqa: S108 (idem)
        _cover("/dev/shm", "1777")  # noqa: S108
        for device in devices:
            device.bind()
    for mount in (*writable, *mounts):
        mount.bind()
    if os.geteuid() == 0 and last(unit, "ProtectProc") == "invisible":
        _mount("proc", "/proc", "proc", _MS_NOSUID | _MS_NODEV, "hidepid=invisible")
    if last(unit, "ProtectSystem") == "strict":
        _set_read_only("/", on=True, below=True)
        paths = [mount.path for mount in writable]
        for target in ("/tmp", "/var/tmp", "/dev/shm", "/proc", *paths):  # noqa: S108
            _set_read_only(target, on=False)
    if is_on(unit, "ProtectKernelTunables"):
        _mount("/proc/sys", "/proc/sys", "", _MS_BIND)
        _set_read_only("/proc/sys", on=True)


def _directory(unit: Directives, kind: str, source: Path, base: str) -> _Kept:
    """One of the unit's directories, given to its user as systemd does."""
    source.mkdir(exist_ok=True)
    source.chmod(int(last(unit, f"{kind}DirectoryMode", "0755"), 8))
    if os.geteuid() == 0:
        for path in (source, *source.rglob("*")):
            os.chown(path, SERVICE_USER, SERVICE_USER, follow_symlinks=False)
    return _Kept.of(f"{base}/{last(unit, f'{kind}Directory')}", str(source))


def give_up_rights(unit: Directives) -> None:
    """User, capabilities, limits and filters; nothing of it can be had back."""
    if os.geteuid() == 0 and last(unit, "User"):
        os.setgroups([])
        os.setresgid(SERVICE_USER, SERVICE_USER, SERVICE_USER)
        os.setresuid(SERVICE_USER, SERVICE_USER, SERVICE_USER)
        _libc.prctl(_SET_DUMPABLE, 1, 0, 0, 0)  # else /proc/self is root's
        die_with(os.getppid())  # a change of user had made it forget
        if is_on(unit, "PrivateUsers"):
            _call(_libc.unshare(_NEWUSER), "unshare user")
            _map_self(SERVICE_USER, SERVICE_USER)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.umask(int(last(unit, "UMask", "0022"), 8))
    if "CapabilityBoundingSet" in unit and not unit["CapabilityBoundingSet"]:
        for capability in range(64):
            _libc.prctl(_CAPBSET_DROP, capability, 0, 0, 0)
    if is_on(unit, "NoNewPrivileges"):
        _call(_libc.prctl(_SET_NO_NEW_PRIVS, 1, 0, 0, 0), "no_new_privs")
    for program in filters(unit):
        program.load()


def environment(unit: Directives) -> dict[str, str]:
    """What systemd gives the service, and nothing of ours but where to tell that it is ready."""
    variables = {
        "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin",
        "HOME": "/",
        "USER": "vgrd",
    }
    for kind, _, base in _PLACES:
        variables[f"{kind.upper()}_DIRECTORY"] = f"{base}/{last(unit, f'{kind}Directory')}"
    for name in ("NOTIFY_SOCKET", "WATCHDOG_USEC"):
        if name in os.environ:
            variables[name] = os.environ[name]
    variables |= dict(entry.partition("=")[::2] for entry in unit.get("Environment", ()))
    return variables


def main(argv: Sequence[str]) -> None:
    """Confine this process and become the command."""
    words = list(argv)
    command = words[words.index("--") + 1 :] if "--" in words else []
    path, folder, *visible = words[: words.index("--")] if "--" in words else words
    unit = read_section(Path(path), "Service")
    enter_namespaces()
    arrange_files(unit, Path(folder), visible)
    os.chdir("/")
    command = command or last(unit, "ExecStart").split()
    env = environment(unit)
    give_up_rights(unit)
    os.execve(command[0], command, env)  # noqa: S606


if __name__ == "__main__":
    main(sys.argv[1:])
