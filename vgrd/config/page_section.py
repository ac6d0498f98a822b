"""[page] of the cell file."""

from ipaddress import ip_address
from typing import Annotated

from pydantic import AfterValidator, Field

from vgrd.documents.tables import Table


def _of_this_machine(host: str) -> str:
    """The page has no password yet, so it is for people at this computer."""
    try:
        is_loopback = ip_address(host).is_loopback
    except ValueError:
        is_loopback = False
    if not is_loopback:
        raise ValueError(
            f"{host!r} is not an address of this computer alone, such as 127.0.0.1: the page asks for no "
            "password; from elsewhere reach it through ssh -L or a proxy that does (docs/page.md)"
        )
    return host


class PageSection(Table):
    """The operator's page (docs/page.md); off without a port. Needs the extra `page`."""

    host: Annotated[str, AfterValidator(_of_this_machine)] = Field(
        default="127.0.0.1", description="address to listen at: loopback"
    )
    port: int | None = Field(
        default=None, ge=1024, le=65535, description="such as 8080; none: there is no page"
    )
