"""Processes of the studio: forked from one that has loaded everything, with a limit of memory, and none outlives the server."""

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
"""Bytes of data that a process of the studio may have; one that asks for more is told that there are none."""

Say = Callable[[str, Any], None]
"""What a job is given to tell of itself: a word, and what there is to it."""

_CONTEXT = multiprocessing.get_context("forkserver")


def warm_up(module: str) -> None:
    """Start the process that others are forked from; it imports a module, in the background, with what they all need."""
    _CONTEXT.set_forkserver_preload([module])
    from multiprocessing.forkserver import ensure_running

    ensure_running()


class Worker:
    """A process that runs a function and talks over a pipe.

    Parameters
    ----------
    work : str
        MODULE:FUNCTION, imported in the process only; takes the connection and the arguments.
    *arguments
        Of the work.

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
        """Kill the process and those that it started; the connection then ends."""
        pid = self._process.pid
        if pid is not None and self._process.is_alive():
            try:
                os.killpg(pid, signal.SIGKILL)
            except (ProcessLookupError, PermissionError):  # it has not made its group yet, or is gone
                self._process.kill()

    def end(self) -> None:
        """Kill the process, and wait until it is gone."""
        self.kill()
        self._process.join()
        self.connection.close()

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self._process.is_alive()


def named(text: str) -> Callable[..., Any]:
    """Return the function that MODULE:FUNCTION names, one of ours."""
    module, _, name = text.partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return found


def _begin(connection: Connection, work: str, arguments: tuple[Any, ...]) -> None:
    """Do the work in a group of its own, which ends with the server; Ctrl-C in the terminal is the server's affair."""
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
