"""From bytes to requests: where the first one ends, in which frame it is, what it asks for.

EC,POINT,TRIG,CMD,OBJECT,OPT,MAXAGE,MAXU95          bare, or the same in ( )
<Ask Point="1" Trig="7" Cmd="2" Opt="32"/>          XML, as EthernetKRL sends it
"""

import re
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple

from vgrd.registers import REQUEST, Command, RotationCode, Status

VERB: Final = "EC"
LONGEST_LINE: Final = 80  # characters with the end: a string of ABB's RAPID holds no more
LONGEST_DOCUMENT: Final = 256  # characters: twice what EthernetKRL makes of all attributes
LARGEST: Final = 0xFFFF  # as a register
FIELDS: Final = ("POINT", "TRIG", "CMD", "OBJECT", "OPT", "MAXAGE", "MAXU95")  # in their order
DEFAULTS: Final = {"CMD": int(Command.EC_FRESH), "OBJECT": 0, "OPT": 0, "MAXAGE": 0, "MAXU95": 0}
KUKA_DEFAULTS: Final = {**DEFAULTS, "OPT": RotationCode.KUKA_ABC << 4}  # OPT b4-7
NEEDED: Final = 2  # POINT and TRIG have no default
BLANKS: Final = b" \t\r\n"  # before a request: no request
_UNPRINTABLE: Final = re.compile(rb"[^\t\r\n -~]")
_END: Final = re.compile(rb"\r\n|\r|\n")
_ROOT: Final = re.compile(rb"<([A-Za-z]\w*)")
_ATTRIBUTES: Final = re.compile(r'\s+(\w+)\s*=\s*"([^"]*)"')
_DOCUMENT: Final = re.compile(r"<Ask((?:\s+\w+\s*=\s*\"[^\"]*\")*)\s*(?:/>|>\s*</Ask>)")


class UnreadableError(Exception):
    """Bytes that are no line, and whose end nobody knows: the connection is of no use."""


class RefusedError(Exception):
    """A whole line that asks for nothing that can be done. trig: of the line, 0 where it has none."""

    def __init__(self, status: Status, trig: int = 0) -> None:
        self.status, self.trig = status, trig


class Frame(Enum):
    """What a request comes in, and its answer."""

    BARE = "bare"
    BRACKETS = "( )"
    XML = "XML"


class Piece(NamedTuple):
    """The first request among received bytes. length: of the bytes that it took, with its end."""

    frame: Frame
    text: str
    end: str
    length: int


@dataclass(frozen=True, slots=True)
class Asked:
    """What a line asks for. trig 0: nothing any more."""

    trig: int
    values: dict[str, int] = field(default_factory=dict)

    @property
    def is_clear(self) -> bool:
        """Whether it drops the request."""
        return not self.trig or self.values["CMD"] == Command.CLEAR

    def registers(self) -> bytes:
        """The same as registers 0-31; TRIG is 0, since it counts on this connection alone."""
        return REQUEST.encode(dict.fromkeys((f.name for f in REQUEST.fields), 0) | self.values)


def cut(received: bytes) -> Piece | None:
    """The first request of bytes that begin with one, None while it is not whole. UnreadableError."""
    if received[:1] == b"<":
        longest, length = LONGEST_DOCUMENT, _document_length(received[:LONGEST_DOCUMENT])
        text, end = received[:length], b""
    else:
        longest, found = LONGEST_LINE, _END.search(received[:LONGEST_LINE])
        length = found.end() if found else 0
        text, end = (received[: found.start()], found[0]) if found else (b"", b"")
    if _UNPRINTABLE.search(received[: length or longest]):
        raise UnreadableError
    if not length:
        if len(received) >= longest:
            raise UnreadableError
        return None
    words = text.decode("ascii").strip()
    frame = Frame.XML if longest == LONGEST_DOCUMENT else _frame(words)
    return Piece(frame, words, end.decode("ascii"), length)


def read(piece: Piece) -> Asked:
    """What it asks for. Raises RefusedError."""
    if piece.frame is Frame.XML:
        return _asked(_attributes(piece.text), KUKA_DEFAULTS)
    words = piece.text
    if words.startswith("(") and words.endswith(")"):
        words = words[1:-1]
    verb, *texts = (word.strip() for word in words.split(","))
    if verb != VERB:
        raise RefusedError(Status.UNKNOWN_COMMAND)
    if not NEEDED <= len(texts) <= len(FIELDS):
        raise RefusedError(Status.BAD_PARAMETER)
    return _asked(dict(zip(FIELDS, texts, strict=False)), DEFAULTS)


def _frame(words: str) -> Frame:
    return Frame.BRACKETS if words.startswith("(") else Frame.BARE


def _document_length(text: bytes) -> int:
    """Bytes of the first XML document, 0 while its end has not come."""
    head = text.find(b">")
    if head < 0:
        return 0
    if text[head - 1 : head] == b"/":
        return head + 1
    root = _ROOT.match(text)
    if root is None:
        raise UnreadableError
    tail = b"</" + root[1] + b">"
    at = text.find(tail)
    return 0 if at < 0 else at + len(tail)


def _attributes(text: str) -> dict[str, str]:
    document = _DOCUMENT.fullmatch(text)
    if document is None:
        raise RefusedError(Status.BAD_PARAMETER)
    pairs = _ATTRIBUTES.findall(document[1])
    named = {name.upper(): number for name, number in pairs}
    if len(named) != len(pairs) or not named.keys() <= set(FIELDS):
        raise RefusedError(Status.BAD_PARAMETER)
    return named


def _asked(texts: dict[str, str], defaults: dict[str, int]) -> Asked:
    """Numbers of the fields. Raises RefusedError, with TRIG where at least that can be read."""
    trig = _number(texts.get("TRIG", ""))
    if trig is None:
        raise RefusedError(Status.BAD_PARAMETER)
    values = dict(defaults)
    for name, text in texts.items():
        number = _number(text)
        if number is None and (text.strip() or name == "POINT"):
            raise RefusedError(Status.BAD_PARAMETER, trig)
        if number is not None and name != "TRIG":
            values[name] = number
    if "POINT" not in values:
        raise RefusedError(Status.BAD_PARAMETER, trig)
    return Asked(trig, values)


def _number(text: str) -> int | None:
    """A whole number that a register holds, else None."""
    digits = text.strip()
    is_number = digits.isdigit() and len(digits.lstrip("0")) <= len(str(LARGEST))
    return int(digits) if is_number and int(digits) <= LARGEST else None
