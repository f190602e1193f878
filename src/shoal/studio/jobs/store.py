"""The store of jobs: an SQLite file in the folder. After a crash, the next server of the studio finds all jobs in the store."""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from shoal.core.checks import check_choice, check_number, check_text, parse_json, shortened
from shoal.core.errors import InvalidInputError
from shoal.lab.storage.schema import told, transaction

FILE = ".studio.sqlite"
APPLICATION = 0x53484A42  # "SHJB"
MOST_TRIES = 2
"""Maximum number of starts of a job. If the server ends during the last allowed run of a job, the job is marked as interrupted."""

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
        Folder of the studio. A job that was running when the last server ended returns to the queue, or is marked as interrupted
        after `MOST_TRIES` attempts.

    Raises
    ------
    InvalidInputError, OutputError
        Raised if the file is not a store of jobs, or if Shoal cannot write the file.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE
        with told(self.path):
            self._connection = sqlite3.connect(self.path, timeout=5, isolation_level=None, check_same_thread=False)
            self._prepare()

    def _prepare(self) -> None:
        connection = self._connection
        connection.execute("PRAGMA trusted_schema = OFF")
        application = connection.execute("PRAGMA application_id").fetchone()[0]
        tables = connection.execute("SELECT name, type FROM sqlite_master WHERE name NOT LIKE 'sqlite_%'").fetchall()
        if application != APPLICATION and (application or tables):
            raise InvalidInputError(f"{self.path}: expected a store of jobs, got another SQLite database")
        for name, kind in tables:
            if (name, kind) != ("jobs", "table"):
                raise InvalidInputError(f"{self.path}: expected a store of jobs and nothing else, got the {kind} {shortened(name)}")
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = NORMAL")
        with transaction(connection):
            connection.execute(_TABLE)
            connection.execute(f"PRAGMA application_id = {APPLICATION}")
            connection.execute(
                "UPDATE jobs SET state = CASE WHEN tries < ? THEN 'queued' ELSE 'interrupted' END WHERE state = 'running'",
                (MOST_TRIES,),
            )
        for row in connection.execute(f"SELECT {_COLUMNS} FROM jobs"):
            self._job(row)

    def _ask(self, statement: str, *values: Any) -> list[tuple[Any, ...]]:
        """Run an SQL statement, and return the rows of the result."""
        with told(self.path):
            return self._connection.execute(statement, values).fetchall()

    def add(self, kind: str, spec: dict[str, Any], *, urgent: bool = False) -> int:
        """Add a job to the queue, and return the number of the job.

        Urgent jobs start before other jobs, because a user waits for the result of an urgent job.
        """
        ((number,),) = self._ask(
            "INSERT INTO jobs (kind, spec, state, urgent, tries, created, result) VALUES (?, ?, 'queued', ?, 0, ?, '{}') "
            "RETURNING id",
            kind, json.dumps(spec, allow_nan=False), urgent, time.time(),
        )  # fmt: skip
        return int(number)

    def begin_next(self, *, without: Sequence[str] = ()) -> dict[str, Any] | None:
        """Mark the next waiting job as running, and return the job. Skip jobs of the kinds in ``without``.

        If no job is waiting, return None.
        """
        rows = self._ask(
            "UPDATE jobs SET state = 'running', began = ?, tries = tries + 1 WHERE id = "
            f"(SELECT id FROM jobs WHERE state = 'queued' AND kind NOT IN ({', '.join('?' * len(without))}) "
            f"ORDER BY urgent DESC, id LIMIT 1) RETURNING {_COLUMNS}",
            time.time(), *without,
        )  # fmt: skip
        return self._job(rows[0]) if rows else None

    def end(self, number: int, state: str, result: dict[str, Any]) -> None:
        """Record the end of a job, with the job's final state and result."""
        text = json.dumps(result, allow_nan=False)
        self._ask("UPDATE jobs SET state = ?, ended = ?, result = ? WHERE id = ?", state, time.time(), text, number)

    def cancel_queued(self, number: int) -> bool:
        """Cancel a job that has not yet started. Return false if no such job exists."""
        cancelled = "UPDATE jobs SET state = 'cancelled', ended = ? WHERE id = ? AND state = 'queued' RETURNING id"
        return bool(self._ask(cancelled, time.time(), number))

    def job(self, number: int) -> dict[str, Any] | None:
        """Return the job with the given number, or None if the job does not exist."""
        rows = self._ask(f"SELECT {_COLUMNS} FROM jobs WHERE id = ?", number)
        return self._job(rows[0]) if rows else None

    def newest(self, most: int = 100) -> list[dict[str, Any]]:
        """Return up to ``most`` jobs: first all running and waiting jobs, and then the newest ended jobs."""
        order = "state NOT IN ('running', 'queued'), id DESC"
        return [self._job(row) for row in self._ask(f"SELECT {_COLUMNS} FROM jobs ORDER BY {order} LIMIT ?", most)]

    def counts(self) -> dict[str, int]:
        """Return the number of jobs in each state."""
        return dict(self._ask("SELECT state, count(*) FROM jobs GROUP BY state"))

    def close(self) -> None:
        """Close the store file."""
        self._connection.close()

    def _job(self, row: tuple[Any, ...]) -> dict[str, Any]:
        """Return the job in a row of the store. Validate the row, because the store file may come from another person."""
        job = dict(zip(_COLUMNS.split(", "), row, strict=True))
        where = f"{self.path}: job {shortened(job['id'])}"
        check_choice(job["state"], what=f"{where}: state", choices=_STATES)
        for name in ("created", "began", "ended"):
            if job[name] is not None:
                check_number(job[name], what=f"{where}: {name}")
        for name in ("spec", "result"):
            job[name] = parse_json(check_text(job[name], what=f"{where}: {name}"), where=f"{where}: {name}")
            if not isinstance(job[name], dict):
                raise InvalidInputError(f"{where}: {name}: expected an object, got {shortened(job[name])}")
        return job
