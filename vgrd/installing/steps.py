"""What an installation consists of, as data: each step says what it does before it is done."""

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from vgrd.errors import StepFailed

_FOLDER_MODE = 0o755  # of folders above what is written; what is private says so itself
_POLL_S = 0.2  # little beside the seconds of a start
_SHOWN_LINES = 12  # of what a failed command said: its last words, with the reason


def holds(path: Path, text: str) -> bool:
    """Whether a file is there and has this text; raises OSError."""
    return path.is_file() and path.read_bytes() == text.encode()


@dataclass(frozen=True, slots=True)
class Folder:
    """Make a folder, if it is not there."""

    path: Path
    mode: int = _FOLDER_MODE

    def __str__(self) -> str:
        return f"make folder {self.path}"

    def perform(self) -> None:
        """Do it; raises OSError."""
        self.path.mkdir(mode=self.mode, parents=True, exist_ok=True)


@dataclass(frozen=True, slots=True)
class File:
    """Write a file, whole or not at all; `keep`: not where there is one."""

    path: Path
    text: str
    mode: int = 0o644
    keep: bool = False

    def __str__(self) -> str:
        return f"write {self.path}" + (" if it is not there" if self.keep else "")

    def perform(self) -> None:
        """Do it; raises OSError."""
        if self.keep and self.path.exists():
            return
        self.path.parent.mkdir(mode=_FOLDER_MODE, parents=True, exist_ok=True)
        draft = self.path.with_name(f".{self.path.name}.new")
        draft.write_text(self.text, encoding="utf-8")
        draft.chmod(self.mode)
        draft.replace(self.path)


@dataclass(frozen=True, slots=True)
class Copy:
    """Copy a file or a folder; `but` are names that are left out."""

    source: Path
    path: Path
    but: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"copy {self.source} to {self.path}"

    def perform(self) -> None:
        """Do it; raises OSError."""
        self.path.parent.mkdir(mode=_FOLDER_MODE, parents=True, exist_ok=True)
        if self.source.is_dir():
            shutil.copytree(
                self.source,
                self.path,
                ignore=shutil.ignore_patterns(*self.but),
                copy_function=shutil.copyfile,  # modes by our umask: the service reads it
            )
        else:
            shutil.copyfile(self.source, self.path)


@dataclass(frozen=True, slots=True)
class Link:
    """Let a symbolic link lead to `to`, in one stroke: at any moment it leads to the old or to the new."""

    path: Path
    to: Path

    def __str__(self) -> str:
        return f"link {self.path} to {self.to}"

    def perform(self) -> None:
        """Do it; raises OSError."""
        self.path.parent.mkdir(mode=_FOLDER_MODE, parents=True, exist_ok=True)
        draft = self.path.with_name(f".{self.path.name}.new")
        draft.unlink(missing_ok=True)
        draft.symlink_to(os.path.relpath(self.to, self.path.parent))
        draft.replace(self.path)


@dataclass(frozen=True, slots=True)
class Removal:
    """Remove a file, a link or a folder with all that is in it; `text`: a file only while it holds just that."""

    path: Path
    text: str | None = None

    def __str__(self) -> str:
        return f"remove {self.path}"

    def perform(self) -> None:
        """Do it; raises OSError."""
        if self.text is not None and not holds(self.path, self.text):
            return
        if self.path.is_dir() and not self.path.is_symlink():
            shutil.rmtree(self.path)
        else:
            self.path.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class Flush:
    """Bring all that was written to the disk: a power cut leaves no version in use whose files are empty."""

    def __str__(self) -> str:
        return "bring what was written to the disk"

    def perform(self) -> None:
        """Do it."""
        os.sync()


@dataclass(frozen=True, slots=True)
class Command:
    """Run a program to its end; `env` is added to ours. `remedy`: what to do where it fails."""

    argv: tuple[str, ...]
    env: Mapping[str, str] = field(default_factory=dict)
    remedy: str = ""

    def __str__(self) -> str:
        settings = [f"{name}={value}" for name, value in self.env.items()]
        return "run " + " ".join([*settings, *self.argv])

    def perform(self) -> None:
        """Do it; raises OSError, and StepFailed with its last words where it ends with an error."""
        clean = {
            k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))
        }
        done = subprocess.run(
            self.argv,
            cwd="/",  # and not where Python would find the source before what is installed
            env={**clean, **self.env},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        if done.returncode:
            words = "\n".join(done.stdout.strip().splitlines()[-_SHOWN_LINES:])
            raise StepFailed(f"it ended with {done.returncode}: {words}")


@dataclass(frozen=True, slots=True)
class Answer:
    """Wait until somebody listens at the daemon's control socket, which its cell process opens."""

    path: Path
    within_s: float = 90.0  # the gate allows its processes 60 s to start on a busy machine

    def __str__(self) -> str:
        return f"wait until the daemon answers at {self.path}"

    def perform(self) -> None:
        """Do it; raises StepFailed when it takes too long."""
        end_s = time.monotonic() + self.within_s
        while True:
            with socket.socket(socket.AF_UNIX) as link:
                link.settimeout(1.0)
                try:
                    link.connect(str(self.path))
                except OSError as error:
                    if time.monotonic() > end_s:
                        raise StepFailed(
                            f"no answer within {self.within_s:g} s: {error.strerror or error}"
                        ) from error
                else:
                    return
            time.sleep(_POLL_S)


Step = Answer | Folder | File | Flush | Copy | Link | Removal | Command
