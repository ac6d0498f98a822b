"""System-call filters by libseccomp, as systemd makes them of a unit's directives."""

import ctypes
import ctypes.util
import errno
import socket
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from fakes.confinement.unit_file import Directives, SyscallFilter, is_on, last, syscall_filter

_KILL_PROCESS: Final = 0x80000000  # SCMP_ACT_KILL_PROCESS of seccomp.h, libseccomp 2.5
_ALLOW: Final = 0x7FFF0000  # SCMP_ACT_ALLOW, idem
_NE, _LE, _EQ, _GT, _MASKED_EQ = 1, 3, 4, 6, 7  # SCMP_CMP_*, idem
_CTL_NNP: Final = 3  # attribute: libseccomp shall leave no_new_privs to us
_LAST_FAMILY: Final = 63  # far beyond AF_MAX of any kernel
_NEW_NAMESPACES: Final = (  # CLONE_NEW* of sched.h: TIME, NS, CGROUP, UTS, IPC, USER, PID
    0x80,
    0x20000,
    0x2000000,
    0x4000000,
    0x8000000,
    0x10000000,
    0x20000000,
)
_NEW_NAMESPACES_AND_CGROUP: Final = (*_NEW_NAMESPACES, 0x40000000)  # CLONE_NEWNET
_SCHED_OTHER, _SCHED_BATCH, _SCHED_IDLE = 0, 3, 5  # sched.h
_SUID_SGID: Final = (0o4000, 0o2000)  # S_ISUID and S_ISGID of sys/stat.h
_O_CREAT: Final = 0o100  # of fcntl.h (x86_64, aarch64)
_MODES: Final = (  # arguments: of the mode, and of the flags that make it count
    ("chmod", 1, None),
    ("fchmod", 1, None),
    ("fchmodat", 2, None),
    ("mkdir", 1, None),
    ("mkdirat", 2, None),
    ("mknod", 1, None),
    ("mknodat", 2, None),
    ("creat", 1, None),
    ("open", 2, 1),
    ("openat", 3, 2),
)


class _Comparison(ctypes.Structure):
    _fields_ = [
        ("argument", ctypes.c_uint),
        ("op", ctypes.c_int),
        ("a", ctypes.c_uint64),
        ("b", ctypes.c_uint64),
    ]


def _refuse(number: int) -> int:
    return 0x00050000 | number  # SCMP_ACT_ERRNO


def library() -> ctypes.CDLL:
    """Load libseccomp. Raises OSError where it is not installed (Debian: libseccomp2)."""
    seccomp = ctypes.CDLL("libseccomp.so.2", use_errno=True)
    seccomp.seccomp_init.restype = ctypes.c_void_p
    seccomp.seccomp_init.argtypes = [ctypes.c_uint32]
    seccomp.seccomp_attr_set.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_uint32]
    seccomp.seccomp_load.argtypes = [ctypes.c_void_p]
    seccomp.seccomp_rule_add_array.argtypes = [
        ctypes.c_void_p,
        ctypes.c_uint32,
        ctypes.c_int,
        ctypes.c_uint,
        ctypes.POINTER(_Comparison),
    ]
    return seccomp


class Filter:
    """One filter: what happens by default, and rules for single calls; `load` is for ever."""

    def __init__(self, default: int = _ALLOW) -> None:
        self._library = library()
        self._context = self._library.seccomp_init(default)
        self._check(self._library.seccomp_attr_set(self._context, _CTL_NNP, 0), "attribute")

    def add(self, action: int, name: str, *comparisons: tuple[int, int, int, int]) -> None:
        """Add a rule; a call that this architecture does not have needs none."""
        number = self._library.seccomp_syscall_resolve_name(name.encode())
        if number < 0:
            return
        array = (_Comparison * len(comparisons))(
            *(_Comparison(*comparison) for comparison in comparisons)
        )
        answer = self._library.seccomp_rule_add_array(
            self._context, action, number, len(comparisons), array
        )
        self._check(answer, name)

    def load(self) -> None:
        """Put it in force for this process and all that it starts."""
        self._check(self._library.seccomp_load(self._context), "load")

    @staticmethod
    def _check(answer: int, step: str) -> None:
        if answer < 0:
            raise OSError(-answer, f"libseccomp: {step}")


def filters(directives: Directives) -> Sequence[Filter]:
    """All filters of a unit, that of SystemCallFilter= last: it refuses to load another."""
    makers: list[Callable[[], Filter]] = []
    if families := last(directives, "RestrictAddressFamilies"):
        makers.append(lambda: _families(families.split()))
    for name, make in (
        ("RestrictNamespaces", _namespaces),
        ("RestrictRealtime", _realtime),
        ("RestrictSUIDSGID", _suid_sgid),
        ("LockPersonality", _personality),
    ):
        if is_on(directives, name):
            makers.append(make)
    if directives.get("SystemCallFilter"):
        makers.append(lambda: _calls(syscall_filter(directives)))
    return [make() for make in makers]


def _calls(calls: SyscallFilter) -> Filter:
    """Known calls that are not allowed are refused; those that systemd does not know do not exist."""
    program = Filter(_refuse(errno.ENOSYS))
    refusal = _KILL_PROCESS if calls.error is None else _refuse(calls.error)
    for name in calls.allowed:
        program.add(_ALLOW, name)
    for name in calls.refused:
        program.add(refusal, name)
    return program


def _families(names: Iterable[str]) -> Filter:
    allowed = {int(getattr(socket, name)) for name in names}
    program, refusal = Filter(), _refuse(errno.EAFNOSUPPORT)
    for family in range(_LAST_FAMILY + 1):
        if family not in allowed:
            program.add(refusal, "socket", (0, _EQ, family, 0))
    program.add(refusal, "socket", (0, _GT, _LAST_FAMILY, 0))
    return program


def _namespaces() -> Filter:
    program, refusal = Filter(), _refuse(errno.EPERM)
    program.add(_refuse(errno.ENOSYS), "clone3")  # its flags lie in memory; glibc then uses clone
    program.add(refusal, "setns", (1, _EQ, 0, 0))
    for flag in _NEW_NAMESPACES_AND_CGROUP:
        for name, argument in (("clone", 0), ("unshare", 0), ("setns", 1)):
            program.add(refusal, name, (argument, _MASKED_EQ, flag, flag))
    return program


def _realtime() -> Filter:
    program, refusal = Filter(), _refuse(errno.EPERM)
    for policy in set(range(_SCHED_IDLE + 1)) - {_SCHED_OTHER, _SCHED_BATCH, _SCHED_IDLE}:
        program.add(refusal, "sched_setscheduler", (1, _EQ, policy, 0))
    program.add(refusal, "sched_setscheduler", (1, _GT, _SCHED_IDLE, 0))
    return program


def _suid_sgid() -> Filter:
    program, refusal = Filter(), _refuse(errno.EPERM)
    program.add(_refuse(errno.ENOSYS), "openat2")  # its mode lies in memory
    for bit in _SUID_SGID:
        for name, mode, flags in _MODES:
            rules = [(mode, _MASKED_EQ, bit, bit)]
            if flags is not None:
                rules.append((flags, _MASKED_EQ, _O_CREAT, _O_CREAT))
            program.add(refusal, name, *rules)
    return program


def _personality() -> Filter:
    program = Filter()
    program.add(_refuse(errno.EPERM), "personality", (0, _NE, 0, 0))
    return program
