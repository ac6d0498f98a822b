"""A systemd of one's own as PID 1 of a few namespaces, for units that shall run under the real one.

It sees a copy-on-write view of the whole file system in which nothing reaches the machine: not /tmp,
not /etc, not /dev, no kernel setting. Only its own units exist for it. The network is the machine's.
Needs root, cgroup2, overlayfs and a systemd.
"""

import contextlib
import ctypes
import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from vgrd.orphans import dying_with_us

# Units that every unit of a service or a socket wants to exist; empty ones will do.
_TARGETS: Final = (
    "basic",
    "default",
    "multi-user",
    "network-online",
    "shutdown",
    "sockets",
    "sysinit",
)
_UNITS: Final = (
    "etc/systemd/system"  # where an installation writes its own; the machine's are hidden
)
_DEVICES: Final = ("null", "zero", "full", "random", "urandom", "tty")
_INIT: Final = "/lib/systemd/systemd"
_START_S: Final = 120.0  # a second, on a machine that is not busy
_libc = ctypes.CDLL(None, use_errno=True)
_NEWNS, _NEWCGROUP, _NEWUTS, _NEWIPC, _NEWPID = (  # CLONE_* of sched.h
    0x20000,
    0x2000000,
    0x4000000,
    0x8000000,
    0x20000000,
)
_MS_READ_ONLY, _MS_REMOUNT, _MS_BIND = 1, 32, 0x1000  # sys/mount.h
_MS_REC, _MS_PRIVATE = 0x4000, 0x40000  # idem
_PIVOT_ROOT: Final = {"x86_64": 155, "aarch64": 41}  # asm/unistd.h
_DETACH: Final = 2  # MNT_DETACH of sys/mount.h
_SET_PDEATHSIG: Final = 1  # PR_SET_PDEATHSIG of sys/prctl.h
_NOT_ALLOWED: Final = (errno.EPERM, errno.EACCES, errno.EROFS, errno.ENODEV, errno.ENOSYS)


def _call(answer: int, step: str) -> None:
    if answer < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{step}: {os.strerror(number)}")


def _mount(
    source: str, target: Path | str, kind: str = "", flags: int = 0, options: str = ""
) -> None:
    answer = _libc.mount(
        source.encode(),
        str(target).encode(),
        kind.encode(),
        ctypes.c_ulong(flags),
        options.encode(),
    )
    _call(answer, f"mount {kind} {target}")


def cgroup_root() -> Path:
    """Where cgroup2 is mounted. Raises FileNotFoundError."""
    for line in Path("/proc/self/mounts").read_text().splitlines():
        _, place, kind, *_ = line.split()
        if kind == "cgroup2":
            return Path(place)
    raise FileNotFoundError("no cgroup2 is mounted")


def main(scratch: Path, cgroup: Path, units: Path, *shared: Path) -> None:
    """Become systemd in a world of its own; units and `shared` are folders of the machine itself."""
    try:
        (cgroup / "cgroup.procs").write_text(str(os.getpid()))
        _call(_libc.unshare(_NEWNS | _NEWCGROUP | _NEWUTS | _NEWIPC | _NEWPID), "unshare")
        child = os.fork()
        if child:
            os._exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) & 0xFF)
        _libc.prctl(_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)  # its parent is not in its namespace
        _build_root(scratch, units, shared)
    except OSError as error:
        if error.errno not in _NOT_ALLOWED:
            raise
        sys.stderr.write(f"{error}\n")
        sys.exit(os.EX_NOPERM)
    env = {
        "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
        "container": "other",
        "SYSTEMD_UNIT_PATH": f"/{_UNITS}",
        "SYSTEMD_GENERATOR_PATH": "/nowhere",
        "SYSTEMD_ENVIRONMENT_GENERATOR_PATH": "/nowhere",
    }
    words = ["--system", "--unit=default.target", "--log-target=console", "--show-status=no"]
    os.execve(_INIT, [_INIT, *words], env)  # noqa: S606


def _build_root(scratch: Path, units: Path, shared: Iterable[Path]) -> None:
    """Everything as it is here, but each write goes into a tmpfs that ends with the namespace."""
    _mount("none", "/", "", _MS_REC | _MS_PRIVATE)
    _mount("tmpfs", scratch, "tmpfs", 0, "mode=755")
    upper, work, root = (scratch / name for name in ("upper", "work", "root"))
    for folder in (upper, work, root):
        folder.mkdir()
    _mount("overlay", root, "overlay", 0, f"lowerdir=/,upperdir={upper},workdir={work}")
    for name in ("tmp", "var/tmp", "run"):
        _mount("tmpfs", root / name, "tmpfs", 0, "mode=1777" if name != "run" else "mode=755")
    _mount("proc", root / "proc", "proc")
    _mount("/proc/sys", root / "proc/sys", "", _MS_BIND)
    _mount("", root / "proc/sys", "", _MS_BIND | _MS_REMOUNT | _MS_READ_ONLY)
    _mount("sysfs", root / "sys", "sysfs", _MS_READ_ONLY)
    _mount("cgroup2", root / "sys/fs/cgroup", "cgroup2")
    _make_devices(root / "dev")
    places = {folder: folder.relative_to("/") for folder in shared} | {units: Path(_UNITS)}
    for folder, place in places.items():
        (root / place).mkdir(parents=True, exist_ok=True)
        _mount(str(folder), root / place, "", _MS_BIND | _MS_REC)
    os.chdir(root)
    old = root / "mnt"
    number = _PIVOT_ROOT[os.uname().machine]
    _call(_libc.syscall(number, str(root).encode(), str(old).encode()), "pivot_root")
    os.chdir("/")
    _call(_libc.umount2(b"/mnt", _DETACH), "umount of the old root")


def _make_devices(folder: Path) -> None:
    _mount("tmpfs", folder, "tmpfs", 0, "mode=755")
    for name in _DEVICES:
        (folder / name).touch()
        _mount(f"/dev/{name}", folder / name, "", _MS_BIND)
    (folder / "ptmx").symlink_to("pts/ptmx")  # PrivateDevices= copies it
    for name, kind, options in (
        ("shm", "tmpfs", "mode=1777"),
        ("pts", "devpts", "newinstance,ptmxmode=0666"),
    ):
        (folder / name).mkdir()
        _mount(kind, folder / name, kind, 0, options)


class Unbootable(OSError):
    """The machine does not let us have namespaces, an overlay or a control group of our own."""


class Booted:
    """A systemd with `units` (name -> text) and nothing else, once booted; it ends with the `with`.

    What is installed in it lies in memory. shared: folders of the machine that are seen there too.
    """

    def __init__(
        self, folder: Path, units: Mapping[str, str], shared: Iterable[Path] = ()
    ) -> None:
        self.folder = folder
        self.units = folder / "units"
        self.units.mkdir()
        for name in _TARGETS:
            text = "[Unit]\nDefaultDependencies=no\n"
            (self.units / f"{name}.target").write_text(text)
        for name, text in units.items():
            path = self.units / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)
        self.shared = [*shared]
        self.log = folder / "systemd.log"
        self.cgroup = cgroup_root() / f"vgrd-test-{os.getpid()}"

    def __enter__(self) -> "Booted":
        return self

    def boot(self) -> None:
        """Start it. Raises Unbootable where this machine does not allow that, OSError else."""
        try:
            self.cgroup.mkdir()
        except OSError as error:
            raise Unbootable(f"{self.cgroup}: {error.strerror}") from error
        scratch = self.folder / "scratch"
        scratch.mkdir()
        words = [str(scratch), str(self.cgroup), str(self.units), *map(str, self.shared)]
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                dying_with_us([sys.executable, "-m", "fakes.confinement.booted", *words]),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                cwd=Path(__file__).parents[2],
            )
        try:
            self._wait()
        except BaseException:
            self.__exit__()
            raise

    def _wait(self) -> None:
        end = time.monotonic() + _START_S
        while self.ask("is-system-running").strip() not in ("running", "degraded"):
            if self.process.poll() == os.EX_NOPERM:
                raise Unbootable(self.log.read_text().strip())
            if self.process.poll() is not None or time.monotonic() > end:
                raise OSError(f"systemd does not run: {self.log.read_text()[-500:]}")
            time.sleep(0.1)

    @property
    def pid(self) -> int:
        """PID 1 of the namespace, as it is called out here; 0 while there is none."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            return int((children.read_text().split() or ["0"])[0])
        return 0

    def pid_out_here(self, inside: int) -> int:
        """What a process is called out here; LookupError when there is none."""
        world = Path(f"/proc/{self.pid}/ns/pid").readlink()
        for place in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(FileNotFoundError, ProcessLookupError, PermissionError):
                if (place / "ns" / "pid").readlink() == world:
                    status = (place / "status").read_text()
                    if status.split("NSpid:")[1].splitlines()[0].split()[-1] == str(inside):
                        return int(place.name)
        raise LookupError(f"no process {inside} in the namespace")

    def path(self, inside: str) -> Path:
        """Where a file of the namespace is to be found out here."""
        return Path(f"/proc/{self.pid}/root") / inside.lstrip("/")

    def ask(self, *words: str) -> str:
        """What `systemctl WORDS` in the namespace prints; "" while it does not run."""
        if not self.pid:
            return ""
        process = self.run("systemctl", *words)
        return process.stdout or process.stderr

    def run(self, *command: str, timeout_s: float = _START_S) -> subprocess.CompletedProcess[str]:
        """Run a command in the namespace, as root."""
        return subprocess.run(
            dying_with_us(["nsenter", "--all", "--target", str(self.pid), "--", *command]),
            capture_output=True,
            text=True,
            check=False,
            timeout=timeout_s,
        )

    def do(self, *command: str) -> str:
        """Run a command in the namespace; what it says. Raises OSError where it ends with an error."""
        done = self.run(*command)
        if done.returncode:
            raise OSError(f"{' '.join(command)}: {done.stdout}{done.stderr}")
        return done.stdout

    def __exit__(self, *_: object) -> None:
        if pid := self.pid:
            os.kill(pid, signal.SIGKILL)
        self.process.kill()
        self.process.wait()
        end = time.monotonic() + _START_S
        while self.cgroup.exists() and time.monotonic() < end:
            for place in sorted(self.cgroup.rglob("*/"), reverse=True):
                with contextlib.suppress(OSError):
                    place.rmdir()
            with contextlib.suppress(OSError):
                self.cgroup.rmdir()
            time.sleep(0.05)


if __name__ == "__main__":
    main(*(Path(word) for word in sys.argv[1:]))
