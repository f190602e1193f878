"""Two kernels in a file of their own, quick to compile, for the tests of the cache."""

from __future__ import annotations

import sys

import numpy as np

from shoal import notices

if __name__ == "__main__":  # as commands do, before any kernel is imported
    notices.listeners.append(lambda text: print(text, file=sys.stderr))

from shoal.jit import kernel


@kernel
def double(numbers):
    """Return twice each number."""
    out = np.empty_like(numbers)
    for k in range(len(numbers)):
        out[k] = 2 * numbers[k]
    return out


@kernel
def total(numbers):
    """Return the sum of twice each number."""
    found = 0
    for number in double(numbers):
        found += number
    return found


if __name__ == "__main__":
    kinds = {"int": np.int64, "float": np.float64, "short": np.int16}
    print(*(float(total(np.arange(4).astype(kinds[name]))) for name in sys.argv[1:] or ["int"]))
    print("compiled" if sum(total.stats.cache_misses.values()) else "loaded")
