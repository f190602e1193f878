"""Jobs: long work of the studio in processes of their own, with a queue that survives a restart."""

from __future__ import annotations

import asyncio
import json
import sqlite3
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from shoal.core.checks import check_choice, check_number, check_text, parse_json, shortened
from shoal.core.errors import InvalidInputError, OutputError
from shoal.core.version import count_processors
from shoal.lab.database import sqlite_errors_at, transaction
from shoal.studio.folder import Folder
from shoal.studio.processes import Worker
from shoal.studio.work import JOBS

FILE = ".studio.sqlite"
APPLICATION = 0x53484A42  # "SHJB"
MOST_TRIES = 2
"""Maximum number of starts of a job. If the server ends during the last allowed run of a job, the
job is marked as interrupted.
"""

_TABLE = """CREATE TABLE IF NOT EXISTS jobs (
  id INTEGER PRIMARY KEY, kind TEXT NOT NULL, spec TEXT NOT NULL, state TEXT NOT NULL, urgent INTEGER NOT NULL,
  tries INTEGER NOT NULL, created REAL NOT NULL, began REAL, ended REAL, result TEXT NOT NULL
)"""
_COLUMNS = "id, kind, spec, state, urgent, tries, created, began, ended, result"

ENDED = ("done", "failed", "cancelled", "interrupted")
_STATES = ("queued", "running", *ENDED)


class JobStore:
    """The store of the jobs in a folder.

    Parameters
    ----------
    folder : Path
        Folder of the studio. A job that was running when the last server ended returns to the
        queue, or is marked as interrupted after `MOST_TRIES` attempts.

    Raises
    ------
    InvalidInputError, OutputError
        Raised if the file is not a store of jobs, or if Shoal cannot write the file.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE
        with sqlite_errors_at(self.path):
            self._connection = sqlite3.connect(
                self.path, timeout=5, isolation_level=None, check_same_thread=False
            )
            self._prepare()

    def _prepare(self) -> None:
        connection = self._connection
        connection.execute("PRAGMA trusted_schema = OFF")
        application = connection.execute("PRAGMA application_id").fetchone()[0]
        tables = connection.execute(
            "SELECT name, type FROM sqlite_master WHERE name NOT LIKE 'sqlite_%'"
        ).fetchall()
        if application != APPLICATION and (application or tables):
            raise InvalidInputError(
                f"{self.path}: expected a store of jobs, got another SQLite database"
            )
        for name, kind in tables:
            if (name, kind) != ("jobs", "table"):
                raise InvalidInputError(
                    f"{self.path}: expected a store of jobs and nothing else, got the {kind}"
                    f" {shortened(name)}"
                )
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = NORMAL")
        with transaction(connection):
            connection.execute(_TABLE)
            connection.execute(f"PRAGMA application_id = {APPLICATION}")
            connection.execute(
                "UPDATE jobs SET state = CASE WHEN tries < ? THEN 'queued' ELSE 'interrupted' END"
                " WHERE state = 'running'",
                (MOST_TRIES,),
            )
        for row in connection.execute(f"SELECT {_COLUMNS} FROM jobs"):
            self._job(row)

    def _ask(self, statement: str, *values: Any) -> list[tuple[Any, ...]]:
        """Run an SQL statement, and return the rows of the result."""
        with sqlite_errors_at(self.path):
            return self._connection.execute(statement, values).fetchall()

    def add(self, kind: str, spec: dict[str, Any], *, urgent: bool = False) -> int:
        """Add a job to the queue, and return the number of the job.

        Urgent jobs start before other jobs, because a user waits for the result of an urgent job.
        """
        ((number,),) = self._ask(
            "INSERT INTO jobs (kind, spec, state, urgent, tries, created, result) VALUES (?, ?,"
            " 'queued', ?, 0, ?, '{}') RETURNING id",
            kind,
            json.dumps(spec, allow_nan=False),
            urgent,
            time.time(),
        )
        return int(number)

    def begin_next(self, *, without: Sequence[str] = ()) -> dict[str, Any] | None:
        """Mark the next waiting job as running, and return the job. Skip jobs of the kinds in
        ``without``.

        If no job is waiting, return None.
        """
        rows = self._ask(
            "UPDATE jobs SET state = 'running', began = ?, tries = tries + 1 WHERE id = (SELECT id"
            f" FROM jobs WHERE state = 'queued' AND kind NOT IN ({', '.join('?' * len(without))})"
            f" ORDER BY urgent DESC, id LIMIT 1) RETURNING {_COLUMNS}",
            time.time(),
            *without,
        )
        return self._job(rows[0]) if rows else None

    def end(self, number: int, state: str, result: dict[str, Any]) -> None:
        """Record the end of a job, with the job's final state and result."""
        text = json.dumps(result, allow_nan=False)
        self._ask(
            "UPDATE jobs SET state = ?, ended = ?, result = ? WHERE id = ?",
            state,
            time.time(),
            text,
            number,
        )

    def cancel_queued(self, number: int) -> bool:
        """Cancel a job that has not yet started. Return false if no such job exists."""
        cancelled = (
            "UPDATE jobs SET state = 'cancelled', ended = ? WHERE id = ? AND state = 'queued'"
            " RETURNING id"
        )
        return bool(self._ask(cancelled, time.time(), number))

    def job(self, number: int) -> dict[str, Any] | None:
        """Return the job with the given number, or None if the job does not exist."""
        rows = self._ask(f"SELECT {_COLUMNS} FROM jobs WHERE id = ?", number)
        return self._job(rows[0]) if rows else None

    def newest(self, most: int = 100) -> list[dict[str, Any]]:
        """Return up to ``most`` jobs: first all running and waiting jobs, and then the newest ended
        jobs.
        """
        order = "state NOT IN ('running', 'queued'), id DESC"
        return [
            self._job(row)
            for row in self._ask(f"SELECT {_COLUMNS} FROM jobs ORDER BY {order} LIMIT ?", most)
        ]

    def counts(self) -> dict[str, int]:
        """Return the number of jobs in each state."""
        return dict(self._ask("SELECT state, count(*) FROM jobs GROUP BY state"))

    def close(self) -> None:
        """Close the store file."""
        self._connection.close()

    def _job(self, row: tuple[Any, ...]) -> dict[str, Any]:
        """Return the job in a row of the store. Validate the row, because the store file may come
        from another person.
        """
        job = dict(zip(_COLUMNS.split(", "), row, strict=True))
        where = f"{self.path}: job {shortened(job['id'])}"
        check_choice(job["state"], what=f"{where}: state", choices=_STATES)
        for name in ("created", "began", "ended"):
            if job[name] is not None:
                check_number(job[name], what=f"{where}: {name}")
        for name in ("spec", "result"):
            job[name] = parse_json(
                check_text(job[name], what=f"{where}: {name}"), where=f"{where}: {name}"
            )
            if not isinstance(job[name], dict):
                raise InvalidInputError(
                    f"{where}: {name}: expected an object, got {shortened(job[name])}"
                )
        return job


MOST_QUEUED = 5000
PAUSE = 5.0
"""Time after which a failed write to the store of jobs is repeated, in seconds."""

MOST_PIECES = 50_000_000
"""Maximum total size, in characters, of the episode pieces that a job keeps for browsers that begin
to watch later.
"""

MOST_ENDED = 4
"""Number of ended jobs that keep their pieces, for browsers whose request to watch comes after the
end.
"""


class _Running:
    """A running job: its process, its progress, and the reported pieces of its episode, for
    browsers that begin to watch later.
    """

    def __init__(self, job: dict[str, Any], processors: int) -> None:
        self.job, self.began, self.processors = job, time.monotonic(), processors
        self.worker: Worker | None = None  # before its process has started
        self.done, self.note, self.cancelled = 0.0, "", False
        self.done_before: float | None = (
            None  # amount done at the start: a sweep continues where it was
        )
        self.pieces: list[dict[str, Any]] = []
        self.size = self.n_pieces = 0  # characters and number of pieces

    @property
    def seconds_left(self) -> float | None:
        """Return the estimated remaining time of the job in seconds, or None if the time is
        unknown.
        """
        fresh = self.done - (self.done_before or 0.0)
        return (time.monotonic() - self.began) * (1 - self.done) / fresh if fresh > 0.01 else None


class JobQueue:
    """The jobs of a folder, and the processes of running jobs. The server's event loop manages the
    queue.

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
        self._ended: dict[int, list[dict[str, Any]]] = {}  # pieces of the last ended jobs
        self._unsaved: dict[
            int, tuple[str, dict[str, Any]]
        ] = {}  # ends of jobs that a full disk could not store
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
        kind = check_choice(kind, what="kind", choices=JOBS)
        if self.store.counts().get("queued", 0) >= MOST_QUEUED:
            raise OutputError(f"jobs: expected at most {MOST_QUEUED} waiting jobs, got one more")
        number = self.store.add(kind, spec, urgent=urgent)
        self.tell({"job": self.describe(number)})
        self.go_on()
        return self.describe(number)

    def go_on(self) -> None:
        """Start waiting jobs while processors are free."""
        try:
            self._begin_those_with_room()
        except OutputError:  # a full disk; waiting jobs are not lost
            if not self._closing:
                asyncio.get_running_loop().call_later(PAUSE, self.go_on)

    def _begin_those_with_room(self) -> None:
        self._save_ends()
        long = [kind for kind, job in JOBS.items() if job.long]
        while not self._closing and (free := self._free()) > 0:
            free_for_long = free - (count_processors() > 1)
            job = self.store.begin_next(without=() if free_for_long > 0 else long)
            if job is None:
                return
            processors = free_for_long if job["kind"] == "sweep" else 1
            running = self._running[job["id"]] = _Running(job, processors)
            self.tell({"job": self.describe(job["id"])})
            task = asyncio.get_running_loop().create_task(self._follow(running))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    def _free(self) -> int:
        """Return the number of processors on which no job is running."""
        return count_processors() - sum(running.processors for running in self._running.values())

    async def _follow(self, running: _Running) -> None:
        """Handle the messages of a job's process until it ends. A process that ends without a final
        message has crashed.
        """
        job, number, state = running.job, running.job["id"], "failed"
        result: dict[str, Any] = {
            "error": (
                "the process of the job ended: it crashed, or needed more memory than the"
                " machine has"
            )
        }
        # The process for forking may still be loading, so its answer is awaited in a thread.
        worker = running.worker = await asyncio.to_thread(
            Worker,
            "shoal.studio.work:do_job",
            str(self.folder.root),
            job["kind"],
            job["spec"],
            running.processors,
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
                self.tell({"job": self.describe(number)})
            elif word == "piece":
                self._piece(running, what)
            else:
                state, result = word, what
                break
        if running.cancelled:
            state, result = "cancelled", {}
        await asyncio.to_thread(worker.end)
        del self._running[number]
        self._ended[number] = running.pieces
        if len(self._ended) > MOST_ENDED:
            del self._ended[next(iter(self._ended))]
        if self._closing and not running.cancelled:
            return  # the store says that the job is running: the next server finds it
        self._end(number, state, result)
        self.go_on()

    def _piece(self, running: _Running, what: dict[str, Any]) -> None:
        running.size += sum(len(value) for value in what.values() if isinstance(value, str))
        if running.size < MOST_PIECES:
            running.pieces.append(what)
        self.tell({"piece": what, "nth": running.n_pieces, "of": running.job["id"]})
        running.n_pieces += 1

    def _end(self, number: int, state: str, result: dict[str, Any]) -> None:
        self._unsaved[number] = state, result
        self._save_ends()
        self.tell({"job": self.describe(number), "files": True})

    def _save_ends(self) -> None:
        for number, (state, result) in list(self._unsaved.items()):
            try:
                self.store.end(number, state, result)
            except OutputError:
                # repeated with the next write; if the server ends before, the job runs again
                return
            del self._unsaved[number]

    def pieces(self, number: int) -> list[dict[str, Any]]:
        """Return all pieces of the episode that a job has computed, if the job runs or is one of
        the last that ended.
        """
        if number in self._running:
            return list(self._running[number].pieces)
        return self._ended.get(number, [])

    def describe(self, number: int) -> dict[str, Any]:
        """Return a job as data for browsers. If the job does not exist, return empty data.

        The keys of the data are ``id, kind, spec, state, created, began, ended, result``. For a
        running job, the data have the additional keys ``done`` (progress from 0 to 1), ``note``,
        and ``left`` (remaining seconds).
        """
        job = self.store.job(number)
        return {} if job is None else self._with_progress(job)

    def list_jobs(self) -> list[dict[str, Any]]:
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
            self.tell({"job": self.describe(number)})
        elif number in self._running:
            self._running[number].cancelled = True
            if (worker := self._running[number].worker) is not None:
                worker.kill()

    async def close(self) -> None:
        """End the processes of all jobs. The next server of the folder finds the unfinished jobs in
        the store.
        """
        self._closing = True
        for running in self._running.values():
            if running.worker is not None:
                running.worker.kill()
        await asyncio.gather(*self._tasks)
        self.store.close()
