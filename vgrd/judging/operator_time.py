"""What a sample costs the operator: table 4 of the paper, minutes by the samples that it counts."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

MINUTES: Final[Mapping[str, float]] = MappingProxyType(
    {"point": 8 / 10, "look": 2 / 8, "spin": 1.5 / 10, "touch": 5 / 6, "verify": 5 / 6}
)  # its rows over their numbers of samples; a verification, which it does not count, is a touch


def operator_minutes(counts: Mapping[str, int]) -> dict[str, float]:
    """Minutes by kind of sample, for so many of each that were asked for; harvested ones cost nothing."""
    return {kind: MINUTES[kind] * count for kind, count in counts.items() if count}
