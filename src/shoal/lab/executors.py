"""Where trials run: all as `concurrent.futures.Executor`."""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor

from shoal.core.errors import InvalidInputError
from shoal.core.registry import load_users_modules, users_modules


def default_workers() -> int:
    """Return the number of processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def make_executor(workers: int, *, compiled: bool) -> Executor:
    """Return an executor of that many workers.

    Compiled episodes hold no lock, so threads serve and start at once; policies written in Python need processes of their own.

    Raises
    ------
    InvalidInputError
        If ``workers`` is not positive.
    """
    if workers < 1:
        raise InvalidInputError(f"workers: expected 1 or more, got {workers}")
    if compiled:
        return ThreadPoolExecutor(workers, thread_name_prefix="shoal")
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=begin_worker, initargs=users_modules())


def begin_worker(folders: list[str], modules: list[str]) -> None:
    """Ignore Ctrl-C in a worker, which a terminal sends to all processes; import the user's own modules, as the starter did."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    load_users_modules(folders, modules)


def give_up(executor: Executor) -> None:
    """End the worker processes of an executor at once, in the middle of what they play."""
    for process in list((getattr(executor, "_processes", None) or {}).values()):
        process.terminate()
