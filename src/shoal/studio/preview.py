"""Processes for the quick answers of the studio. Each process runs permanently and caches opened
files.

If a process for quick answers ends, the studio starts a new process.
"""

from __future__ import annotations

import asyncio
from itertools import count
from typing import Any

from shoal.core.errors import InvalidInputError, ShoalError
from shoal.studio.jobs import Worker


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
        """Return the answer to a question of a page. `shoal.studio.answers.ANSWERS` lists the
        questions.

        Raises
        ------
        InvalidInputError
            Raised if the process reports an error, ends, or takes longer than `PATIENCE`. The error
            message is one sentence.
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
        told, word, value = worker.connection.recv()
        if told != number:
            raise EOFError
        if word == "error":
            raise ShoalError(value)
        if word == "broken":
            raise StudioError(value)
        return value

    async def close(self) -> None:
        """End the process for quick answers."""
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.kill()
            await asyncio.to_thread(worker.end)
