"""Names in the order in which people count: 2 before 10."""

import re
from collections.abc import Iterable


def natural_order(names: Iterable[str]) -> list[str]:
    """Sorted with numbers in names as numbers: 1, 2, 10, not 1, 10, 2."""
    return sorted(names, key=_key)


def _key(name: str) -> list[tuple[int, int, str]]:
    return [
        (0, int(part), part) if part.isascii() and part.isdigit() else (1, 0, part.lower())
        for part in re.split(r"([0-9]+)", name)
        if part
    ]
