"""The text of a file that a user names, or one line that says why it is none."""

import codecs
import re
from pathlib import Path

from vgrd.errors import InputError
from vgrd.permissions import way_in

MOST_BYTES = 50_000_000  # a guess: ten times the largest table of samples that was seen
SHOWN = 120  # letters of a word in a message; more hide what is said of it
_ENDLESS = re.compile(r"\S{" + str(SHOWN + 1) + r",}")
_MARKS = (  # of byte order; UTF-32 first: its mark begins as that of UTF-16
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),  # as PowerShell writes what it redirects
    (codecs.BOM_UTF16_BE, "utf-16"),
    (codecs.BOM_UTF8, "utf-8-sig"),
)
_BINARY = {
    b"\x89PNG": "a PNG picture",
    b"\xff\xd8\xff": "a JPEG picture",
    b"II*\0": "a TIFF picture",
    b"MM\0*": "a TIFF picture",
    b"BM": "a BMP picture",
    b"%PDF": "a PDF",
    b"PK\x03\x04": "a ZIP archive (also NPZ, XLSX, DOCX)",
    b"\x1f\x8b": "a GZIP archive",
    b"\x93NUMPY": "a NumPy array (NPY)",
    b"\x89HDF": "an HDF5 file (also MATLAB's .mat from 7.3 on)",
    b"MATLAB 5.0": "a MATLAB file (.mat)",
    b"#ROSBAG": "a ROS bag",
    b"\x89MCAP": "an MCAP recording",
    b"SQLite format 3": "an SQLite file (also a ROS 2 bag)",
    b"\x80\x02": "a Python pickle",
    b"\x80\x03": "a Python pickle",
    b"\x80\x04": "a Python pickle",
    b"\x80\x05": "a Python pickle",
    b"\x7fELF": "a program",
}


def read_bytes(path: Path) -> bytes:
    """The bytes of a file; InputError, without its name, for a folder, nothing, or too much."""
    try:
        if path.is_dir():
            raise InputError("cannot be read: it is a folder; name a file in it")
        if not path.exists():
            raise InputError("no such file")
        if not path.is_file():
            raise InputError("cannot be read: it is no regular file; name a file on the disk")
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise InputError(
                f"cannot be read: it has {size / 1e6:.0f} MB, at most {MOST_BYTES / 1e6:.0f} are read: "
                "is it the right file?"
            )
        return path.read_bytes()
    except PermissionError as error:
        raise InputError(f"cannot be read: {error.strerror}; {way_in(path)}") from error
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot be read: {reason}") from error


def brief(message: str) -> str:
    """A message in one line, with the endless words of a broken file cut."""
    return " ".join(_ENDLESS.sub(lambda word: word[0][: SHOWN - 3] + "...", message).split())


def shortened(text: str) -> str:
    """A word of the file as a message may show it: of one line, and not without end."""
    line = " ".join(text.split())
    return line if len(line) <= SHOWN else f"{line[: SHOWN - 3]}..."


def binary_kind(data: bytes) -> str | None:
    """What a file that is no text is, by its first bytes; None for text."""
    for start, kind in _BINARY.items():
        if data.startswith(start):
            return kind
    if any(data.startswith(mark) for mark, _ in _MARKS):
        return None
    return "a binary file" if b"\0" in data[:4096] else None


def read_text(path: Path) -> str:
    """The text of a file; InputError, without its name, says why it is none, where, and the remedy."""
    return decoded(read_bytes(path))


def decoded(data: bytes) -> str:
    """UTF-8, or what the mark of byte order says; InputError for anything else."""
    kind = binary_kind(data)
    if kind is not None:
        raise InputError(f"cannot be read: it is {kind}, no text")
    encoding = next((name for mark, name in _MARKS if data.startswith(mark)), "utf-8")
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"cannot be read: byte 0x{data[error.start]:02x} in line {line} is no "
            f"{error.encoding.upper()}; save the file as UTF-8"
        ) from error
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise InputError(f"cannot be read: line {line} holds a zero byte; save it as UTF-8 text")
    return text
