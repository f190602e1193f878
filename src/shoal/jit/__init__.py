"""Compilation of kernels: lazy, cached on disk, without the global interpreter lock, with NumPy's division rules."""

from shoal.jit.compiler import in_place_kernel, kernel
from shoal.jit.watch import COMPILING, Stopwatch, seconds_compiling

__all__ = ["COMPILING", "Stopwatch", "in_place_kernel", "kernel", "seconds_compiling"]
