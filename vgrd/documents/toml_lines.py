"""In which line of a TOML file each key stands, which `tomllib` does not tell, and what people call it."""

import re
import tomllib
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vgrd.documents.text import shortened

Location = tuple[int | str, ...]

_SPACE = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_TEXT = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'', re.DOTALL
)
_SCALAR = re.compile(r"[^,\]}\n#]+")  # numbers, words, dates, which may hold a space


@dataclass(frozen=True, slots=True)
class KeyPlaces:
    """Where the keys of a file stand. data: its tables; lines: line (from 1) of each table, key and item."""

    data: Mapping[str, Any]
    lines: Mapping[Location, int]

    def line(self, where: Location) -> int:
        """Line of a key; of the table that lacks it where it is not there, 1 where no table is either."""
        while where and where not in self.lines:
            where = where[:-1]
        return self.lines.get(where, 1)

    def key(self, where: Location) -> str:
        """The key in words: tables of a list by their names ("object.targets.P1.id"), others from #1 on."""
        words: list[str] = []
        value: Any = self.data
        for part in where:
            value = _inner(value, part)
            if isinstance(part, str):
                words.append(shortened(part))
            else:
                name = value.get("name") if isinstance(value, Mapping) else None
                words.append(shortened(name) if isinstance(name, str) else f"#{part + 1}")
        return ".".join(words) or "(file)"

    def told(self, where: Location, message: str) -> str:
        """A message with line and key before it."""
        return f"line {self.line(where)}: {self.key(where)}: {message}"


def key_places(text: str) -> KeyPlaces:
    """Places of the keys of a text that is valid TOML; raises tomllib.TOMLDecodeError where it is not."""
    return KeyPlaces(tomllib.loads(text), _Scanner(text).lines)


def _inner(value: object, part: int | str) -> object:
    if isinstance(value, Mapping):
        return value.get(part)
    if isinstance(value, list) and isinstance(part, int) and part < len(value):
        return value[part]
    return None


class _Scanner:
    """Goes once over a valid text; `lines` has what it saw."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.lines: dict[Location, int] = {}
        self._ends = [found.start() for found in re.finditer("\n", text)]
        self._lengths: dict[Location, int] = {}  # of lists of tables
        table: Location = ()
        while self._skip():
            if self._take("["):
                table = self._header(is_list=self._take("["))
            else:
                self._pair(table)

    def _header(self, *, is_list: bool) -> Location:
        *parents, last = self._keys()
        where: Location = ()
        for key in parents:
            where = self._into((*where, key))
        where = (*where, last)
        if is_list:
            self._lengths[where] = self._lengths.get(where, 0) + 1
        where = self._into(where)
        self._note(where)
        while self._take("]"):
            pass
        return where

    def _into(self, where: Location) -> Location:
        """The last table of a list of tables, or the table itself."""
        length = self._lengths.get(where)
        return where if length is None else (*where, length - 1)

    def _note(self, where: Location) -> None:
        """Tables on the way that have no line of their own yet get this one."""
        line = bisect_right(self._ends, self.at - 1) + 1
        for length in range(1, len(where)):
            self.lines.setdefault(where[:length], line)
        self.lines[where] = line

    def _pair(self, table: Location) -> None:
        where = (*table, *self._keys())
        self._note(where)
        self._take("=")
        self._value(where)

    def _value(self, where: Location) -> None:
        if self._take("["):
            item = 0
            while not self._take("]"):
                self._skip()
                self._note((*where, item))
                self._value((*where, item))
                self._take(",")
                item += 1
        elif self._take("{"):
            while not self._take("}"):
                self._pair(where)
                self._take(",")
        else:
            self._skip()
            self._match(_TEXT if self.text[self.at] in "\"'" else _SCALAR)

    def _keys(self) -> list[str]:
        """The parts of a dotted key."""
        keys = [self._key()]
        while self._take("."):
            keys.append(self._key())
        return keys

    def _key(self) -> str:
        self._skip()
        if self.text[self.at] not in "\"'":
            return self._match(_BARE_KEY)
        quoted: str = tomllib.loads(f"key = {self._match(_TEXT)}")["key"]
        return quoted

    def _take(self, mark: str) -> bool:
        """Whether `mark` comes next; it is passed then."""
        self._skip()
        is_next = self.text.startswith(mark, self.at)
        self.at += len(mark) * is_next
        return is_next

    def _skip(self) -> bool:
        """Pass spaces, ends of lines and comments; whether anything follows."""
        self._match(_SPACE)
        return self.at < len(self.text)

    def _match(self, pattern: re.Pattern[str]) -> str:
        found = pattern.match(self.text, self.at)
        if found is None:
            raise ValueError(f"not TOML: {self.text[self.at : self.at + 20]!r}")
        self.at = found.end()
        return found[0]
