"""Processes of the studio: one for each job, and permanent ones for the quick answers of pages.

A process for quick answers caches opened files. If it ends, the studio starts a new one.
"""

from __future__ import annotations

import asyncio
import importlib
import multiprocessing
import os
import resource
import signal
import threading
from itertools import count
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from shoal.core.errors import InvalidInputError
from shoal.studio.words import FieldError

MEMORY = 3 * 2**30
"""Maximum size of the data of one studio process, in bytes.

If a process needs more memory than the maximum, the allocation of memory fails.
"""

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
        Name of the function to run, in the form MODULE:FUNCTION. The new process imports the
        function, and calls it with the connection and the arguments.
    *arguments
        Arguments of the function, in addition to the connection.

    Attributes
    ----------
    connection : Connection
    """

    def __init__(self, work: str, *arguments: Any) -> None:
        self.connection, theirs = _CONTEXT.Pipe()
        self._process: BaseProcess = _CONTEXT.Process(
            target=_begin, args=(theirs, work, arguments), daemon=False
        )
        self._process.start()
        theirs.close()

    def kill(self) -> None:
        """Kill the process and all its child processes, which ends the connection."""
        pid = self._process.pid
        if pid is not None and self._process.is_alive():
            try:
                os.killpg(pid, signal.SIGKILL)
            except (
                ProcessLookupError,
                PermissionError,
            ):
                # the process has not created its group yet, or has ended
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


def _begin(connection: Connection, work: str, arguments: tuple[Any, ...]) -> None:
    """Run the function in a process group of its own, which ends when the server ends. Ignore
    Ctrl-C, which the server handles.
    """
    os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_server, daemon=True).start()
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    module, _, name = work.partition(":")  # of Shoal's own code, never from a browser
    getattr(importlib.import_module(module), name)(connection, *arguments)


def _end_with_server() -> None:
    server = multiprocessing.parent_process()
    assert server is not None
    wait([server.sentinel])
    os.killpg(0, signal.SIGKILL)


class StudioError(Exception):
    """Raised if the process for quick answers reports an error of Shoal itself. The error message
    is one sentence.
    """


PATIENCE = 60.0
"""Maximum time for a quick answer, in seconds. The studio ends a process that takes longer than
`PATIENCE` seconds.
"""


class Preview:
    """A process that answers the quick questions of pages, one after another.

    Parameters
    ----------
    root : str
        Path of the studio's folder.
    """

    def __init__(self, root: str) -> None:
        self.root = root
        self._worker: Worker | None = None
        self._turn = asyncio.Lock()
        self._numbers = count()

    async def ask(self, what: str, about: dict[str, Any]) -> Any:
        """Return the answer to a question of a page. `shoal.studio.answers.QUESTIONS` lists the
        questions.

        Raises
        ------
        FieldError
            Raised if the process reports an error.
        InvalidInputError
            Raised if the process ends, or takes longer than `PATIENCE`. The error message is one
            sentence.
        StudioError
            Raised if the process reports an error that no question should cause.
        """
        async with self._turn:
            if self._worker is None:
                self._worker = await asyncio.to_thread(
                    Worker, "shoal.studio.answers:answer_all", self.root
                )
            number = next(self._numbers)
            try:
                return await asyncio.wait_for(
                    asyncio.to_thread(self._exchange, self._worker, number, what, about), PATIENCE
                )
            except TimeoutError:
                await self.close()
                raise InvalidInputError(
                    f"expected an answer within {PATIENCE:g} s, got none: run it as a job instead"
                ) from None
            except (EOFError, OSError):
                await self.close()
                raise InvalidInputError(
                    "the process of the preview ended: it crashed, or needed more memory than the"
                    " machine has"
                ) from None

    def _exchange(self, worker: Worker, number: int, what: str, about: dict[str, Any]) -> Any:
        worker.connection.send((number, what, about))
        answered, word, value = worker.connection.recv()
        if answered != number:
            raise EOFError
        if word == "error":
            raise FieldError(value)
        if word == "broken":
            raise StudioError(value)
        return value

    async def close(self) -> None:
        """End the process for quick answers."""
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.kill()
            await asyncio.to_thread(worker.end)
