"""A notice to the user that kernels are being compiled, and a stopwatch without the time for compilation."""

from __future__ import annotations

import threading
import time
from typing import Any

from numba.core import event

from shoal.core.notices import tell_once

COMPILING = "compiling kernels: once after an installation, some seconds for each kind of run ..."


class _Watch(event.Listener):
    """Print a notice when a kernel is compiled, and measure each thread's time for loading and compiling."""

    def __init__(self) -> None:
        self.times = threading.local()

    def on_start(self, event: Any) -> None:
        if event.kind == "numba:compiler_lock":
            self.times.depth = getattr(self.times, "depth", 0) + 1
            if self.times.depth == 1:
                self.times.began = time.perf_counter()
        else:
            tell_once(COMPILING)

    def on_end(self, event: Any) -> None:
        if event.kind == "numba:compiler_lock":
            self.times.depth -= 1
            if self.times.depth == 0:
                self.times.spent = getattr(self.times, "spent", 0.0) + time.perf_counter() - self.times.began


_watch = _Watch()
for _kind in ("numba:compile", "numba:compiler_lock"):
    event.register(_kind, _watch)


def seconds_compiling() -> float:
    """Return how many seconds this thread has spent on loading and compiling kernels."""
    return float(getattr(_watch.times, "spent", 0.0))


class Stopwatch:
    """Measure time since its creation, excluding the time for loading and compiling kernels.

    Examples
    --------
    >>> watch = Stopwatch()
    >>> 0 <= watch.seconds < 1
    True
    """

    def __init__(self) -> None:
        self._began = time.perf_counter() - seconds_compiling()

    @property
    def seconds(self) -> float:
        """Return the seconds since the stopwatch was created, without the time for compiling and loading kernels."""
        return time.perf_counter() - seconds_compiling() - self._began
