"""How kernels are compiled: lazily, cached on disk, without the interpreter's lock, dividing as NumPy does."""

from shoal.jit.compiler import in_place_kernel, kernel
from shoal.jit.watch import COMPILING, Stopwatch, seconds_compiling

__all__ = ["COMPILING", "Stopwatch", "in_place_kernel", "kernel", "seconds_compiling"]
