"""Compilation of kernels at their first call, with a cache on disk.

A kernel is a function that Numba compiles. Kernels run without Python's global interpreter lock. In
a kernel, a division by zero gives infinity or NaN, as in NumPy.

The modules, in the order of a call: `entry` (what Python calls), `cache` (where machine code is
stored, and what it was compiled from), `loader` (machine code is called without Numba), `compiler`
(Numba compiles a kernel once, with all kernels that it calls), `lowered` (archives of kernels that
are compiled except for what depends on the processor).
"""

from shoal.jit.entry import (
    COMPILING,
    Stopwatch,
    in_place_kernel,
    kernel,
    seconds_compiling,
    working_time,
)

__all__ = [
    "COMPILING",
    "Stopwatch",
    "in_place_kernel",
    "kernel",
    "seconds_compiling",
    "working_time",
]
