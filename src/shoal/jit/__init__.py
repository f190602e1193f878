"""Compilation of kernels at their first call, with a cache on disk.

Kernels run without Python's global interpreter lock. In a kernel, a division by zero gives infinity
or NaN, as in NumPy.
"""

from shoal.jit.entry import in_place_kernel, kernel
from shoal.jit.watch import COMPILING, Stopwatch, seconds_compiling, working_time

__all__ = [
    "COMPILING",
    "Stopwatch",
    "in_place_kernel",
    "kernel",
    "seconds_compiling",
    "working_time",
]
