"""How kernels are compiled: lazily, cached on disk, without the interpreter's lock, dividing as NumPy does."""

from __future__ import annotations

from numba import njit

kernel = njit(cache=True, nogil=True, error_model="numpy")

# For what only calls other kernels. A caller is optimized together with all that it calls, again at every level, which takes
# minutes for a planner; these are put into their caller as source, so they are no level of their own.
inlined_kernel = njit(cache=True, nogil=True, error_model="numpy", inline="always")
