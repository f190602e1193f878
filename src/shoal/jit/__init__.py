"""How kernels are compiled: lazily, cached on disk, without the interpreter's lock, dividing as NumPy does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit

from shoal.jit.cache import cached

__all__ = ["inlined_kernel", "kernel"]


def kernel(function: Callable[..., Any]) -> Any:
    """Return the function compiled when it is first called, and kept on disk."""
    return cached(njit(nogil=True, error_model="numpy")(function))


# For what only calls other kernels. A caller is optimized together with all that it calls, again at every level, which takes
# minutes for a planner; these are put into their caller as source, so they are no level of their own.
inlined_kernel = njit(nogil=True, error_model="numpy", inline="always")
