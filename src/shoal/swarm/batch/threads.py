"""Work on many worlds, in as many threads as there are processors: kernels hold no lock."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache

SMALLEST = 1 << 14
"""Words of boards (64 cells each) that are worth a thread of their own: about 10 µs of work."""


def processors() -> int:
    """Return the number of processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="shoal-batch")


def share_out(work: Callable[[int, int, int], None], count: int, *, words: int, threads: int) -> None:
    """Call ``work(thread, first, last)`` for parts of ``range(count)``, this thread takes the last one.

    Parameters
    ----------
    work : callable
        What it does for one world must not depend on the part that the world is in.
    count : int
        Number of worlds.
    words : int
        Of one world: few of them are not worth a thread.
    threads : int
        At most so many.
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
