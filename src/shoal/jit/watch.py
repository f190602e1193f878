"""A stopwatch that does not count the time for loading and compiling kernels, and the text of the
notice about compiling.
"""

from __future__ import annotations

import threading
import time

COMPILING = "compiling kernels: once after an installation, some seconds for each kind of run ..."
_times = threading.local()


class Compiling:
    """A context manager that measures the time for loading or compiling kernels. The time of nested
    blocks counts only once.
    """

    def __enter__(self) -> None:
        _times.depth = getattr(_times, "depth", 0) + 1
        if _times.depth == 1:
            _times.began = time.perf_counter()

    def __exit__(self, *error: object) -> None:
        _times.depth -= 1
        if _times.depth == 0:
            _times.spent = seconds_compiling() + time.perf_counter() - _times.began


def seconds_compiling() -> float:
    """Return how many seconds the current thread has spent on loading and compiling kernels."""
    return float(getattr(_times, "spent", 0.0))


def working_time() -> float:
    """Return seconds on a clock that stands still while the current thread loads or compiles
    kernels; its zero has no meaning.

    Time limits are compared with this clock. On any other clock, a limit of two seconds is over
    before a first use has compiled its kernels.
    """
    return time.perf_counter() - seconds_compiling()


class Stopwatch:
    """Measure the time since the creation of the stopwatch, without the time for loading and
    compiling kernels.

    Examples
    --------
    >>> watch = Stopwatch()
    >>> 0 <= watch.seconds < 1
    True
    """

    def __init__(self) -> None:
        self._began = working_time()

    @property
    def seconds(self) -> float:
        """Return the seconds since the creation of the stopwatch, without the time for loading and
        compiling kernels.
        """
        return working_time() - self._began
