"""Processes of the studio: forked from a prepared process, with a memory limit. They end with the server."""

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
"""Maximum data size in bytes of a process of the studio. If a process needs more memory, the allocation fails."""

Say = Callable[[str, Any], None]
"""Function with which a job reports events: a kind and its content."""

_CONTEXT = multiprocessing.get_context("forkserver")


def warm_up(module: str) -> None:
    """Start the process from which the other processes are forked.

    This process imports a module with the common libraries in the background.
    """
    _CONTEXT.set_forkserver_preload([module])
    from multiprocessing.forkserver import ensure_running

    ensure_running()


class Worker:
    """A process that runs a function and communicates over a pipe.

    Parameters
    ----------
    work : str
        MODULE:FUNCTION, which is imported only in the process. The function takes the connection and the arguments.
    *arguments
        Further arguments of the function.

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
        """Kill the process and its children. The connection then ends."""
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
    """Return the function that the text MODULE:FUNCTION names. The function must be a part of Shoal."""
    module, _, name = text.partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return found


def _begin(connection: Connection, work: str, arguments: tuple[Any, ...]) -> None:
    """Run the function in its own process group, which ends with the server. Ctrl-C in the terminal is handled by the server."""
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
