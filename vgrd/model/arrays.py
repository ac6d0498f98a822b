"""Read-only arrays, as the frozen values of the model hold them."""

import numpy as np

from vgrd.geometry import Array


def frozen_array(values: object, *shape: int) -> Array:
    """Read-only float64 copy of `values`, checked to be finite-or-inf (no NaN) and of `shape`."""
    array = np.array(values, dtype=np.float64)
    if array.shape != shape or np.isnan(array).any():
        msg = f"expected shape {shape} without NaN, got {array.shape}"
        raise ValueError(msg)
    array.setflags(write=False)
    return array


def frozen_copy(array: Array) -> Array:
    """Read-only copy of an array that has its shape already, checked as by `frozen_array`."""
    return frozen_array(array, *array.shape)
