"""[page] of the cell file."""

import re
from collections.abc import Mapping
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Final, Self

from pydantic import AfterValidator, Field, model_validator

from vgrd.documents.tables import FaultAt, Table

FILES: Final = ("certificate", "key", "password_file")
_NAME: Final = re.compile(r"[a-z0-9_]([a-z0-9_.-]*[a-z0-9])?")


def _address(host: str) -> str:
    """As browsers write it."""
    try:
        return str(ip_address(host))
    except ValueError:
        raise ValueError(
            f"{host!r} is no address, such as 127.0.0.1; names that browsers may call go into names"
        ) from None


def _name(name: str) -> str:
    """A name as browsers send it, without port; or an address."""
    if _NAME.fullmatch(name):
        return name
    try:
        return str(ip_address(name))
    except ValueError:
        raise ValueError(
            f"{name!r} is no host name, such as cell1.plant.lan: small letters, no port, no https://"
        ) from None


class PageSection(Table):
    """The operator's page (docs/page.md); off without a port. Needs the extra `page`."""

    host: Annotated[str, AfterValidator(_address)] = Field(
        default="127.0.0.1",
        description="address to listen at; one that is not loopback needs certificate, key and password_file",
    )
    port: int | None = Field(
        default=None, ge=1024, le=65535, description="such as 8080; none: there is no page"
    )
    names: list[Annotated[str, AfterValidator(_name)]] = Field(
        default=[],
        description="by which browsers may call it, besides host: names, addresses",
    )
    certificate: str | None = Field(
        default=None, min_length=1, description="for TLS: PEM file, with its chain"
    )
    key: str | None = Field(default=None, min_length=1, description="of the certificate: PEM file")
    password_file: str | None = Field(
        default=None, min_length=1, description="for commands; `vgrd page-password FILE` makes it"
    )

    @model_validator(mode="after")
    def _guarded(self) -> Self:
        """TLS and the password belong together, and nobody is let in over the network without them."""
        missing = [name for name in FILES if getattr(self, name) is None]
        given = [name for name in FILES if name not in missing]
        if missing and not ip_address(self.host).is_loopback:
            raise FaultAt(
                f"{self.host!r} is not an address of this computer alone, such as 127.0.0.1: over the network the"
                f" page needs {', '.join(missing)} too (docs/page.md)",
                "host",
            )
        if missing and given:
            raise FaultAt(f"needs {', '.join(missing)} beside it (docs/page.md)", given[0])
        if ip_address(self.host).is_unspecified and not self.names:
            raise FaultAt(
                f"{self.host!r} means every address of this computer: tell in names which of them, or which names,"
                " browsers call",
                "host",
            )
        return self

    def with_files(self, folder: Path) -> Self:
        """Its paths resolved from the folder of the cell file."""
        given: Mapping[str, str] = {
            name: str(folder / path) for name in FILES if (path := getattr(self, name)) is not None
        }
        return self.model_copy(update=given)
