"""Processes of the studio, forked from a prepared process. Each process has a memory limit, and ends when the server ends."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import resource
import signal
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

MEMORY = 3 * 2**30
"""Maximum size of the data of one studio process, in bytes.

If a process needs more memory than the maximum, the allocation of memory fails.
"""

Say = Callable[[str, Any], None]
"""Function with which a job reports an event. The arguments are the kind and the content of the event."""

_CONTEXT = multiprocessing.get_context("forkserver")


def warm_up(module: str) -> None:
    """Start the fork server: the process from which all processes of the studio are forked.

    In the background, the fork server imports ``module``, which imports all common libraries.
    """
    _CONTEXT.set_forkserver_preload([module])
    from multiprocessing.forkserver import ensure_running

    ensure_running()


class Worker:
    """A process that runs a function of Shoal and communicates over a pipe.

    Parameters
    ----------
    work : str
        Name of the function to run, in the form MODULE:FUNCTION. The new process imports the function, and calls it with the
        connection and the arguments.
    *arguments
        Arguments of the function, in addition to the connection.

    Attributes
    ----------
    connection : Connection
    """

    def __init__(self, work: str, *arguments: Any) -> None:
        self.connection, theirs = _CONTEXT.Pipe()
        self._process: BaseProcess = _CONTEXT.Process(target=_begin, args=(theirs, work, arguments), daemon=False)
        self._process.start()
        theirs.close()

    def kill(self) -> None:
        """Kill the process and all its child processes, which ends the connection."""
        pid = self._process.pid
        if pid is not None and self._process.is_alive():
            try:
                os.killpg(pid, signal.SIGKILL)
            except (ProcessLookupError, PermissionError):  # the process has not created its group yet, or has ended
                self._process.kill()

    def end(self) -> None:
        """Kill the process, and wait until it has ended."""
        self.kill()
        self._process.join()
        self.connection.close()

    @property
    def alive(self) -> bool:
        """Whether the process is running."""
        return self._process.is_alive()


def named(text: str) -> Callable[..., Any]:
    """Import and return the function whose name has the form MODULE:FUNCTION.

    The name of the function must come from Shoal's own code, and never from a browser.
    """
    module, _, name = text.partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return found


def _begin(connection: Connection, work: str, arguments: tuple[Any, ...]) -> None:
    """Run the function in a process group of its own, which ends when the server ends. Ignore Ctrl-C, which the server handles."""
    os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_server, daemon=True).start()
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    named(work)(connection, *arguments)


def _end_with_server() -> None:
    server = multiprocessing.parent_process()
    assert server is not None
    wait([server.sentinel])
    os.killpg(0, signal.SIGKILL)
