"""What a systemd unit file says, read as systemd reads it; sets of system calls as this machine's systemd has them."""

import errno
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

Directives = Mapping[str, tuple[str, ...]]


def read_section(path: Path, section: str) -> Directives:
    """Values of each directive in order; an empty assignment empties it, as in systemd.syntax(7)."""
    values: dict[str, list[str]] = defaultdict(list)
    heading = ""
    for line in path.read_text(encoding="utf-8").splitlines():
        text = line.strip()
        if text.startswith("["):
            heading = text.strip("[]")
        elif heading == section and text and text[0] not in "#;":
            name, _, value = text.partition("=")
            if value.strip():
                values[name.strip()].append(value.strip())
            else:
                values[name.strip()] = []
    return {name: tuple(words) for name, words in values.items()}


def last(directives: Directives, name: str, default: str = "") -> str:
    """The value in force of a directive that holds one."""
    return directives[name][-1] if directives.get(name) else default


def is_on(directives: Directives, name: str) -> bool:
    """Whether a switch is on."""
    return last(directives, name, "no") in ("yes", "true", "on", "1")


@dataclass(frozen=True, slots=True)
class SyscallFilter:
    """allowed: names. refused: known names that are not. error: errno of a refusal, None: the process is killed."""

    allowed: frozenset[str]
    refused: frozenset[str]
    error: int | None


def syscall_filter(directives: Directives) -> SyscallFilter:
    """The allow list that SystemCallFilter= builds up. Raises ValueError for a deny list."""
    allowed: set[str] = set()
    for number, value in enumerate(directives["SystemCallFilter"]):
        names = _expand(value.removeprefix("~").split())
        if number == 0 and value.startswith("~"):
            raise ValueError("SystemCallFilter= begins with ~: a deny list, not an allow list")
        allowed = allowed - names if value.startswith("~") else allowed | names
    allowed |= members("@default")  # systemd.exec(5): implied by an allow list
    name = last(directives, "SystemCallErrorNumber")
    error = getattr(errno, name) if name else None
    return SyscallFilter(frozenset(allowed), members("@known") - allowed, error)


def _expand(words: Iterable[str]) -> set[str]:
    return {name for word in words for name in (members(word) if word.startswith("@") else {word})}


@cache
def members(group: str) -> frozenset[str]:
    """System calls of a set such as @resources, the sets in it expanded, as systemd-analyze prints it."""
    tool = shutil.which("systemd-analyze")
    if tool is None:
        raise FileNotFoundError("systemd-analyze is not installed (Debian: package systemd)")
    said = subprocess.run(
        [tool, "syscall-filter", "--no-pager", group], capture_output=True, text=True, check=True
    ).stdout
    words = [line.strip() for line in said.splitlines() if line.startswith("    ")]
    return frozenset(_expand(word for word in words if not word.startswith("#")))
