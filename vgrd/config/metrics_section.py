"""[metrics] of the cell file."""

from pydantic import Field

from vgrd.documents.tables import Table


class MetricsSection(Table):
    """What Prometheus may read of the cell (docs/metrics.md); off without a port."""

    host: str = Field(default="127.0.0.1", description="address to listen at, one of this machine")
    port: int | None = Field(
        default=None, ge=1024, le=65535, description="such as 9502; none: nobody is told"
    )
