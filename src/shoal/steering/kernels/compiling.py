"""How kernels are compiled: lazily, cached on disk, without the interpreter's lock, dividing as NumPy does."""

from __future__ import annotations

from numba import njit

kernel = njit(cache=True, nogil=True, error_model="numpy")
