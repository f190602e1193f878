"""Compilation of kernels at their first call, with a cache on disk.

Kernels release the global interpreter lock and divide as NumPy does.
"""

from shoal.jit.entry import in_place_kernel, kernel
from shoal.jit.watch import COMPILING, Stopwatch, seconds_compiling

__all__ = ["COMPILING", "Stopwatch", "in_place_kernel", "kernel", "seconds_compiling"]
