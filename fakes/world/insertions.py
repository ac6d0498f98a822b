"""How often what the tool holds goes into its hole, counted by true misses."""

import numpy as np

from vgrd.geometry import Array


def count_insertions(misses: Array, clearance_mm: float) -> tuple[int, int, int]:
    """How many of the misses (n, 3) mm go in clean, touch the rim and go in, fail; the tool points along z."""
    off_mm = np.linalg.norm(misses[:, :2], axis=1)
    clean = int((off_mm <= clearance_mm / 2).sum())  # the gap on each side (the paper, VI-B 3)
    enters = int((off_mm <= clearance_mm).sum())
    return clean, enters - clean, len(off_mm) - enters
