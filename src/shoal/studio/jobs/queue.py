"""The queue of jobs: as many at once as there are processors, with progress, time left and cancel."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any

from shoal.core.checks import check_choice
from shoal.core.errors import OutputError
from shoal.lab.executors import default_workers
from shoal.studio.folder import Folder
from shoal.studio.jobs.processes import Worker
from shoal.studio.jobs.store import ENDED, JobStore

MOST_QUEUED = 5000
PAUSE = 5.0
"""Seconds until a store that could not be written is tried again."""

_JOBS = "shoal.studio.jobs"
KINDS = {
    "play": f"{_JOBS}.work:play",
    "compare": f"{_JOBS}.work:compare_policies",
    "export": f"{_JOBS}.work:export_episode",
    "reproduce": f"{_JOBS}.work:reproduce_figures",
    "sweep": f"{_JOBS}.sweeps:run",
    "table": f"{_JOBS}.sweeps:write",
    "missions": f"{_JOBS}.missions:missions_zip",
}
"""What does a job of each kind: imported by the processes of jobs alone, so that the server begins at once."""

LONG = ("sweep", "reproduce")
"""Kinds of jobs that nobody waits for: while one is at work, a processor stays free for what somebody looks at."""

MOST_PIECES = 50_000_000
"""Characters of an episode that is kept for those who watch it while it is played."""


class _Running:
    """A job that runs: its process, how far it is, and what those have missed who begin to watch."""

    def __init__(self, job: dict[str, Any], processors: int) -> None:
        self.job, self.began, self.processors = job, time.monotonic(), processors
        self.worker: Worker | None = None  # until its process has begun
        self.done, self.note, self.cancelled = 0.0, "", False
        self.done_before: float | None = None  # what was done when it began: a sweep goes on where it was
        self.pieces: list[dict[str, Any]] = []
        self.size = 0

    @property
    def seconds_left(self) -> float | None:
        """How long it will take, going on as until now."""
        fresh = self.done - (self.done_before or 0.0)
        return (time.monotonic() - self.began) * (1 - self.done) / fresh if fresh > 0.01 else None


class JobQueue:
    """The jobs of a folder and the processes that do them; lives in the server's event loop.

    Parameters
    ----------
    folder : Folder
    tell : callable
        Called with what all browsers are told.
    """

    def __init__(self, folder: Folder, tell: Callable[[dict[str, Any]], None]) -> None:
        self.folder, self.tell = folder, tell
        self.store = JobStore(folder.root)
        self._running: dict[int, _Running] = {}
        self._unsaved: dict[int, tuple[str, dict[str, Any]]] = {}  # ends that a full disk did not take
        self._tasks: set[asyncio.Task[None]] = set()
        self._closing = False

    def add(self, kind: Any, spec: dict[str, Any], *, urgent: bool) -> dict[str, Any]:
        """Queue a job and return it.

        Raises
        ------
        InvalidInputError
            If there is no such kind of job.
        OutputError
            If the store cannot be written, or there are too many.
        """
        kind = check_choice(kind, what="kind", choices=KINDS)
        if self.store.counts().get("queued", 0) >= MOST_QUEUED:
            raise OutputError(f"jobs: expected at most {MOST_QUEUED} that wait")
        number = self.store.add(kind, spec, urgent=urgent)
        self.tell({"job": self.told(number)})
        self.go_on()
        return self.told(number)

    def go_on(self) -> None:
        """Begin the jobs for which there is room."""
        try:
            self._begin_those_with_room()
        except OutputError:  # a full disk; what waits is not lost
            if not self._closing:
                asyncio.get_running_loop().call_later(PAUSE, self.go_on)

    def _begin_those_with_room(self) -> None:
        self._save_ends()
        while not self._closing and (free := self._free()) > 0:
            free_for_long = free - (default_workers() > 1)
            job = self.store.begin_next(without=() if free_for_long > 0 else LONG)
            if job is None:
                return
            processors = free_for_long if job["kind"] == "sweep" else 1
            running = self._running[job["id"]] = _Running(job, processors)
            self.tell({"job": self.told(job["id"])})
            task = asyncio.get_running_loop().create_task(self._follow(running))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    def _free(self) -> int:
        """Return how many processors no job has."""
        return default_workers() - sum(running.processors for running in self._running.values())

    async def _follow(self, running: _Running) -> None:
        """Take in what a job says until it ends; a process that ends without a word has crashed."""
        job, number, state = running.job, running.job["id"], "failed"
        result: dict[str, Any] = {"error": "the process of the job ended: it crashed, or took more memory than there is"}
        # The process that others are forked from may still be loading: its answer is waited for in a thread.
        worker = running.worker = await asyncio.to_thread(
            Worker, f"{_JOBS}.work:work", str(self.folder.root), KINDS[job["kind"]], job["spec"], running.processors
        )
        if running.cancelled or self._closing:
            worker.kill()
        while True:
            try:
                word, what = await asyncio.to_thread(worker.connection.recv)
            except (EOFError, OSError):
                break
            if word == "progress":
                running.done, running.note = what
                if running.done_before is None:
                    running.done_before = running.done
                self.tell({"job": self.told(number)})
            elif word == "piece":
                self._piece(running, what)
            else:
                state, result = word, what
                break
        if running.cancelled:
            state, result = "cancelled", {}
        await asyncio.to_thread(worker.end)
        del self._running[number]
        if self._closing and not running.cancelled:
            return  # the store says that it runs: the next server finds it
        self._end(number, state, result)
        self.go_on()

    def _piece(self, running: _Running, what: dict[str, Any]) -> None:
        running.size += sum(len(value) for value in what.values() if isinstance(value, str))
        if running.size < MOST_PIECES:
            running.pieces.append(what)
        self.tell({"piece": what, "of": running.job["id"]})

    def _end(self, number: int, state: str, result: dict[str, Any]) -> None:
        self._unsaved[number] = state, result
        self._save_ends()
        self.tell({"job": self.told(number), "files": True})

    def _save_ends(self) -> None:
        for number, (state, result) in list(self._unsaved.items()):
            try:
                self.store.end(number, state, result)
            except OutputError:
                return  # tried again with the next; if the server ends before, the job is done once more
            del self._unsaved[number]

    def pieces(self, number: int) -> list[dict[str, Any]]:
        """Return what has been played of a job that runs."""
        return list(self._running[number].pieces) if number in self._running else []

    def told(self, number: int) -> dict[str, Any]:
        """Return a job as browsers are told of it; empty if there is none.

        Examples
        --------
        A job has ``id, kind, spec, state, created, began, ended, result``; one that runs ``done`` (0 to 1), ``note``, ``left``.
        """
        job = self.store.job(number)
        return {} if job is None else self._with_progress(job)

    def all_told(self) -> list[dict[str, Any]]:
        """Return the newest jobs."""
        return [self._with_progress(job) for job in self.store.newest()]

    def _with_progress(self, job: dict[str, Any]) -> dict[str, Any]:
        if job["id"] in self._unsaved:
            state, result = self._unsaved[job["id"]]
            return job | {"state": state, "result": result}
        running = self._running.get(job["id"])
        if running is None:
            return job
        return job | {"done": running.done, "note": running.note, "left": running.seconds_left}

    def cancel(self, number: int) -> None:
        """Cancel a job, whether it waits or runs."""
        if self.store.cancel_queued(number):
            self.tell({"job": self.told(number)})
        elif number in self._running:
            self._running[number].cancelled = True
            if (worker := self._running[number].worker) is not None:
                worker.kill()

    async def close(self) -> None:
        """End the processes of all jobs; they are found again by the next server."""
        self._closing = True
        for running in self._running.values():
            if running.worker is not None:
                running.worker.kill()
        await asyncio.gather(*self._tasks)
        self.store.close()

    def has_ended(self, number: int) -> bool:
        """Tell whether a job has ended."""
        return self.told(number).get("state") in ENDED
