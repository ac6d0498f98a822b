"""The page's one password: a line with its scrypt hash, in a file that only its owner reads."""

import hashlib
import hmac
import os
import re
import secrets
import stat
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

from vgrd.errors import InputError

SHORTEST: Final = (
    12  # characters (NIST SP 800-63B asks for 8 at least); nobody types it twice an hour
)
LONGEST: Final = 256
_COST, _BLOCK, _LANES = 2**15, 8, 1  # RFC 7914: 32 MiB and a tenth of a second for each guess
_MEMORY_BYTES: Final = 64 * 2**20
_BYTES: Final = 32  # of salt and key
_KIND: Final = f"scrypt${_COST}${_BLOCK}${_LANES}"
_LINE: Final = re.compile(re.escape(_KIND) + r"\$([0-9a-f]{64})\$([0-9a-f]{64})")
_NOT_OWNER: Final = 0o077


@dataclass(frozen=True, slots=True, repr=False)
class Password:
    """What is known of a password: salt, and what scrypt makes of both."""

    salt: bytes
    key: bytes

    @classmethod
    def made_of(cls, word: str) -> Self:
        """Of a new password; InputError where it is too short or too long."""
        if not SHORTEST <= len(word) <= LONGEST:
            raise InputError(
                f"the password has {len(word)} characters: take {SHORTEST} to {LONGEST}"
            )
        salt = secrets.token_bytes(_BYTES)
        return cls(salt, _key(word, salt))

    @classmethod
    def read(cls, path: Path) -> Self:
        """From its file; InputError with the remedy where it cannot be read, or others can read it."""
        again = f"make it by: vgrd page-password {path}"
        try:
            with path.open(encoding="ascii") as file:
                mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
                text = file.read(1000)
        except OSError as err:
            raise InputError(
                f"password file {path}: {err.strerror}; {again}, as the daemon's user"
            ) from err
        except ValueError:
            text = ""
        if mode & _NOT_OWNER:
            raise InputError(
                f"password file {path}: others may use it (mode {mode:04o}): chmod 600"
            )
        found = _LINE.fullmatch(text.strip())
        if found is None:
            raise InputError(f"password file {path}: holds no line {_KIND}$SALT$KEY; {again}")
        return cls(*map(bytes.fromhex, found.groups()))

    def save(self, path: Path) -> None:
        """Into a file that only its owner reads, whole or not at all. Raises InputError."""
        draft = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            with open(draft, "x", encoding="ascii", opener=_private) as file:
                file.write(f"{_KIND}${self.salt.hex()}${self.key.hex()}\n")
                file.flush()
                os.fsync(file.fileno())
            draft.replace(path)
        except OSError as err:
            draft.unlink(missing_ok=True)
            raise InputError(f"password file {path}: cannot be written: {err.strerror}") from err

    def fits(self, word: str) -> bool:
        """Whether it is this password; takes a tenth of a second, in whatever case as long."""
        return hmac.compare_digest(_key(word[: LONGEST + 1], self.salt), self.key)


def _private(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_CLOEXEC, 0o600)


def _key(word: str, salt: bytes) -> bytes:
    """One letter may be written as two characters, as tablets and keyboards choose: NFC makes them one."""
    return hashlib.scrypt(
        unicodedata.normalize("NFC", word).encode("utf-8", "surrogatepass"),
        salt=salt,
        n=_COST,
        r=_BLOCK,
        p=_LANES,
        maxmem=_MEMORY_BYTES,
        dklen=_BYTES,
    )
