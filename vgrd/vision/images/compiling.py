"""Machine code for the hot loops: numba with its cache on disk, typed for the checker."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile at the first call or load from the cache; runs without the interpreter's lock."""
    compiler = numba.njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
    return cast(F, compiler(function))


def inlined(function: F) -> F:
    """Compile as a part of whoever calls it: for small functions, whose arrays cost more than their work."""
    compiler = numba.njit(
        cache=True, fastmath=True, nogil=True, error_model="numpy", forceinline=True
    )
    return cast(F, compiler(function))
