"""Executors that run trials on several workers. All executors have the interface `concurrent.futures.Executor`."""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor

from shoal.core.registry import load_users_modules, users_modules


def default_workers() -> int:
    """Return the number of processors that the current process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def make_executor(workers: int, *, compiled: bool) -> Executor:
    """Return an executor with ``workers`` threads or processes.

    If ``compiled`` is true, the executor has threads, because compiled code releases Python's interpreter lock, and threads start
    faster than processes. If ``compiled`` is false, as for policies written in Python, the executor has processes.
    """
    if compiled:
        return ThreadPoolExecutor(workers, thread_name_prefix="shoal")
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=begin_worker, initargs=users_modules())


def begin_worker(folders: list[str], modules: list[str]) -> None:
    """Initialize a worker process: ignore Ctrl-C, which a terminal sends to all processes, and import the user's modules."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    load_users_modules(folders, modules)


def give_up(executor: Executor) -> None:
    """End the worker processes of an executor immediately, even in the middle of a trial."""
    for process in list((getattr(executor, "_processes", None) or {}).values()):
        process.terminate()
