"""Parallel work on many worlds, with one thread per processor. Kernels release Python's interpreter lock."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache

SMALLEST = 1 << 14
"""Minimum number of board words, of 64 cells each, for which an additional thread saves time: about 10 µs of work."""


def processors() -> int:
    """Return the number of processors that the current process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="shoal-batch")


def share_out(work: Callable[[int, int, int], None], count: int, *, words: int, threads: int) -> None:
    """Divide ``range(count)`` into parts, and call ``work(thread, first, last)`` for each part, in several threads.

    Parameters
    ----------
    work : callable
        Function that processes the worlds from ``first`` to ``last`` - 1. The result for a world must not depend on the division of
        the worlds into parts.
    count : int
        Number of worlds.
    words : int
        Number of board words per world. For worlds of few words, the function uses fewer threads than for worlds of many words.
    threads : int
        Maximum number of threads.
    """
    parts = max(1, min(threads, count, count * words // SMALLEST))
    if parts == 1:
        work(0, 0, count)
        return
    ends = [count * part // parts for part in range(parts + 1)]
    others = [_pool(threads).submit(work, part, ends[part], ends[part + 1]) for part in range(parts - 1)]
    try:
        work(parts - 1, ends[parts - 1], count)
    finally:
        wait(others)
    for other in others:
        other.result()
