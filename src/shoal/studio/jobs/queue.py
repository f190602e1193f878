"""The queue of jobs: at most one running job per processor. The queue reports progress and remaining time, and can cancel jobs."""

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
from shoal.studio.jobs.store import JobStore

MOST_QUEUED = 5000
PAUSE = 5.0
"""Time after which a failed write to the store of jobs is repeated, in seconds."""

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
"""The name MODULE:FUNCTION of the function for each kind of job. The process of a job imports the function of the job."""

LONG = ("sweep", "reproduce")
"""Kinds of long jobs. While a long job is running, the queue keeps one processor free for interactive jobs."""

MOST_PIECES = 50_000_000
"""Maximum total size, in characters, of the episode pieces that a job keeps for browsers that begin to watch later."""


class _Running:
    """A running job: its process, its progress, and the reported pieces of its episode, for browsers that begin to watch later."""

    def __init__(self, job: dict[str, Any], processors: int) -> None:
        self.job, self.began, self.processors = job, time.monotonic(), processors
        self.worker: Worker | None = None  # before its process has started
        self.done, self.note, self.cancelled = 0.0, "", False
        self.done_before: float | None = None  # amount done at the start: a sweep continues where it was
        self.pieces: list[dict[str, Any]] = []
        self.size = 0

    @property
    def seconds_left(self) -> float | None:
        """Return the estimated remaining time of the job in seconds, or None if the time is unknown."""
        fresh = self.done - (self.done_before or 0.0)
        return (time.monotonic() - self.began) * (1 - self.done) / fresh if fresh > 0.01 else None


class JobQueue:
    """The jobs of a folder, and the processes of running jobs. The server's event loop manages the queue.

    Parameters
    ----------
    folder : Folder
    tell : callable
        Function that the queue calls to send a message to all browsers.
    """

    def __init__(self, folder: Folder, tell: Callable[[dict[str, Any]], None]) -> None:
        self.folder, self.tell = folder, tell
        self.store = JobStore(folder.root)
        self._running: dict[int, _Running] = {}
        self._unsaved: dict[int, tuple[str, dict[str, Any]]] = {}  # ends of jobs that a full disk could not store
        self._tasks: set[asyncio.Task[None]] = set()
        self._closing = False

    def add(self, kind: Any, spec: dict[str, Any], *, urgent: bool) -> dict[str, Any]:
        """Add a job to the queue, and return the job.

        Raises
        ------
        InvalidInputError
            Raised if no kind of job has the name ``kind``.
        OutputError
            Raised if Shoal cannot write the store of jobs, or if too many jobs are waiting.
        """
        kind = check_choice(kind, what="kind", choices=KINDS)
        if self.store.counts().get("queued", 0) >= MOST_QUEUED:
            raise OutputError(f"jobs: expected at most {MOST_QUEUED} waiting jobs, got one more")
        number = self.store.add(kind, spec, urgent=urgent)
        self.tell({"job": self.told(number)})
        self.go_on()
        return self.told(number)

    def go_on(self) -> None:
        """Start waiting jobs while processors are free."""
        try:
            self._begin_those_with_room()
        except OutputError:  # a full disk; waiting jobs are not lost
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
        """Return the number of processors on which no job is running."""
        return default_workers() - sum(running.processors for running in self._running.values())

    async def _follow(self, running: _Running) -> None:
        """Handle the messages of a job's process until it ends. A process that ends without a final message has crashed."""
        job, number, state = running.job, running.job["id"], "failed"
        result: dict[str, Any] = {"error": "the process of the job ended: it crashed, or needed more memory than the machine has"}
        # The process for forking may still be loading, so its answer is awaited in a thread.
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
            return  # the store says that the job is running: the next server finds it
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
                return  # repeated with the next write; if the server ends before, the job runs again
            del self._unsaved[number]

    def pieces(self, number: int) -> list[dict[str, Any]]:
        """Return all pieces of the episode that a running job has computed so far."""
        return list(self._running[number].pieces) if number in self._running else []

    def told(self, number: int) -> dict[str, Any]:
        """Return a job as data for browsers. If the job does not exist, return empty data.

        The keys of the data are ``id, kind, spec, state, created, began, ended, result``. For a running job, the data have the
        additional keys ``done`` (progress from 0 to 1), ``note``, and ``left`` (remaining seconds).
        """
        job = self.store.job(number)
        return {} if job is None else self._with_progress(job)

    def all_told(self) -> list[dict[str, Any]]:
        """Return the newest jobs as data for browsers."""
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
        """Cancel a waiting or running job."""
        if self.store.cancel_queued(number):
            self.tell({"job": self.told(number)})
        elif number in self._running:
            self._running[number].cancelled = True
            if (worker := self._running[number].worker) is not None:
                worker.kill()

    async def close(self) -> None:
        """End the processes of all jobs. The next server of the folder finds the unfinished jobs in the store."""
        self._closing = True
        for running in self._running.values():
            if running.worker is not None:
                running.worker.kill()
        await asyncio.gather(*self._tasks)
        self.store.close()
