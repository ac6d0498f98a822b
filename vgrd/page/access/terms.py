"""What [page] of the cell file says of who may come in, checked where the page starts."""

import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path

from vgrd.clock import Clock
from vgrd.errors import InputError, ServingError
from vgrd.page.access.guard import Guard


@dataclass(frozen=True, slots=True)
class Terms:
    """names: other host names that browsers may call; the files are all given or none."""

    names: Sequence[str] = ()
    certificate: str | None = None
    key: str | None = None
    password_file: str | None = None

    @property
    def is_guarded(self) -> bool:
        """Whether TLS and the password are in force."""
        return None not in (self.certificate, self.key, self.password_file)

    def guard(self, host: str, clock: Clock) -> Guard | None:
        """None without a password, which only a loopback address may be; ServingError where a file is not good."""
        if not self.is_guarded:
            if not ip_address(host).is_loopback:
                raise ServingError(
                    f"page at {host}: not without certificate, key and password_file"
                )
            return None
        _check_tls(str(self.certificate), str(self.key))
        try:
            return Guard(Path(str(self.password_file)), clock)
        except InputError as error:
            raise ServingError(str(error)) from error


def _check_tls(certificate: str, key: str) -> None:
    """The files can be used, and others cannot read the key."""
    try:
        mode = Path(key).stat().st_mode
        # No password: a key that has one would be asked for at a terminal that is not there.
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, lambda: "")
    except OSError as error:  # SSLError is one
        raise ServingError(
            f"page: certificate {certificate} and key {key}: {error.strerror or error}; both must be PEM files that"
            " the daemon's user can read, the key without a passphrase (docs/page.md)"
        ) from error
    if mode & 0o007:
        raise ServingError(
            f"page: key {key}: every user may read it (mode {mode & 0o777:04o}): chmod 600"
        )
