"""The store of a sweep: one SQLite file with the results of all trials, which only one process at a
time may write.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import socket
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property
from itertools import chain, product
from math import prod
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import as_path, parse_json, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, OutputError, UnknownNameError, errors_at
from shoal.core.interruption import half_written
from shoal.core.version import __version__
from shoal.lab.batches import Answer, Gap, SweepStatus, is_storable, versions_text
from shoal.lab.database import (
    connect,
    remove_empty_log,
    row_faults,
    sqlite_errors_at,
    transaction,
)
from shoal.lab.kernels.rows import find_values, join_values, mark_equal, read_whole_numbers
from shoal.lab.sweep import (
    MAX_POINTS,
    Sweep,
    SweepForm,
    axis_values,
    check_sweep_name,
    differences,
    digest_of,
    form_of,
    is_extended,
    sweep_of,
    trial_seed,
)

_RECENT = 60.0  # seconds over which the rate is measured
_AT_ONCE = 10_000  # rows read at once
_NAMED = 5  # trials that a fault names

Column = NDArray[np.int64] | list[Any]
"""Values of a measure: an array of whole numbers, or a list of anything."""


class Store:
    """A store of sweeps. The store commits each batch of trials as soon as the batch is finished.

    Parameters
    ----------
    path : path
    write : bool
        Whether to open the store for writing, and to create a missing store.
    damaged : bool
        Whether to open also a store with damaged rows, for `faults_of`.

    Raises
    ------
    InvalidInputError
        Raised if the file is not a store, is damaged, or comes from a newer version of Shoal.
    OutputError
        Raised if Shoal cannot write the file.

    Notes
    -----
    SQLite runs in WAL mode, in which other processes may read the store while one process writes.
    The store must be on a local disk of the machine that runs the sweep, not on a network share.
    Workers on other machines never access the store.
    """

    def __init__(
        self, path: str | os.PathLike[str], *, write: bool = False, damaged: bool = False
    ) -> None:
        self.path = as_path(path, what="store")
        self.write = write
        self._connection = connect(self.path, write=write, damaged=damaged)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the store file.

        If the store was opened for writing, SQLite first copies the data in the write-ahead log to
        the store file, except the data that other processes are still reading. The last process
        that closes the file leaves no other file beside it.
        """
        if self.write:
            # data that others still read stays in the log beside the file
            with suppress(sqlite3.Error):
                self._connection.execute("PRAGMA wal_checkpoint(PASSIVE)")
        self._connection.close()
        if not self.write:
            remove_empty_log(self.path)

    def ask(self, query: str, *values: Any) -> list[tuple[Any, ...]]:
        """Return the rows that a read-only SQL query finds."""
        with sqlite_errors_at(self.path):
            return self._connection.execute(query, values).fetchall()

    def row_faults(self) -> list[str]:
        """Return one sentence for each damaged row of the tables of sweeps, points and batches."""
        with sqlite_errors_at(self.path):
            return [*row_faults(self._connection)]

    @contextmanager
    def writing(self) -> Iterator[Callable[[str, Sequence[Any]], int]]:
        """Yield a function that runs one SQL statement and returns the number of the row that was
        written last.

        All statements in the ``with`` block form one transaction.
        """
        with sqlite_errors_at(self.path), transaction(self._connection):
            yield (
                lambda statement, values: self._connection.execute(statement, values).lastrowid or 0
            )

    @property
    def names(self) -> list[str]:
        """The names of all sweeps in the store, in the order of their first runs."""
        rows = self.ask("SELECT name FROM sweeps ORDER BY id")
        return [check_sweep_name(name, what=f"{self.path}: name of a sweep") for (name,) in rows]

    def stored(self, name: str) -> StoredSweep:
        """Return the description of a sweep in the store. Do not create the sweep's problem, and
        import no third-party code.

        Raises
        ------
        InvalidInputError
            Raised if the stored sweep is damaged.
        UnknownNameError
        """
        rows = self.ask(
            "SELECT id, spec, inputs, measures, trials, points FROM sweeps WHERE name = ?", name
        )
        if not rows:
            raise UnknownNameError(
                f"{self.path}: no sweep {name!r} (sweeps of this store:"
                f" {', '.join(self.names) or 'none'})"
            )
        return stored_sweep(rows[0], where=f"{self.path}: sweep {name}")

    def only(self, name: str | None) -> str:
        """Check that the store has a sweep with the given name, and return the name.

        If ``name`` is None, return the name of the only sweep in the store.
        """
        if name is not None:
            self.stored(name)
            return name
        names = self.names
        if len(names) != 1:
            raise InvalidInputError(
                f"{self.path}: expected the name of a sweep, one of {', '.join(names) or 'none'},"
                " got none"
            )
        return names[0]

    def sweep(self, name: str) -> Sweep:
        """Return a sweep as the user declared it for the run."""
        return self.stored(name).sweep()

    def points(self, name: str) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield the row number and the axis values of each point of a sweep, in the order of the
        points.

        Raises
        ------
        InvalidInputError
            Raised if the stored points are not the points of the sweep.
        """
        stored = self.stored(name)
        rows = self.ask("SELECT id, axes FROM points WHERE sweep = ? ORDER BY number", stored.id)
        stored.check_points([text for _, text in rows])
        for number, text in rows:
            yield number, stored.values(text)

    def check_points(self, name: str) -> None:
        """Refuse a sweep whose stored points are not the points of its axes."""
        stored = self.stored(name)
        stored.check_points(
            [
                text
                for (text,) in self.ask(
                    "SELECT axes FROM points WHERE sweep = ? ORDER BY number", stored.id
                )
            ]
        )

    def add(self, sweep: Sweep, inputs: Mapping[str, str], *, extend: bool = False) -> None:
        """Add a sweep to the store. If the store has a sweep with an equal name, check that the two
        sweeps are equal.

        Parameters
        ----------
        sweep : Sweep
        inputs : mapping of str to str
            Digests of the maps, workspaces and regions that the sweep opens.
        extend : bool
            Whether the sweep may extend the stored sweep by additional trials or points.

        Raises
        ------
        InvalidInputError
            Raised if the store has a different sweep with an equal name. The error message lists
            the differences between the two sweeps.
        """
        description = sweep.describe()
        self._forget_untouched(sweep.name, description)
        if sweep.name not in self.names:
            with sqlite_errors_at(self.path), transaction(self._connection):
                self._connection.execute(
                    "INSERT INTO sweeps (name, spec, inputs, measures, trials, points, created,"
                    " version) VALUES (?,?,?,?,?,?,?,?)",
                    (
                        sweep.name,
                        json.dumps(description),
                        json.dumps(dict(inputs)),
                        json.dumps(sweep.measures),
                        sweep.trials,
                        sweep.n_points,
                        time.time(),
                        __version__,
                    ),
                )
                self._enter_points(sweep)
            return
        stored = self.stored(sweep.name)
        self.check_points(sweep.name)
        then = stored.inputs
        changed = [*differences(stored.spec, json.loads(json.dumps(description)))]
        changed += (
            differences(
                {k: v for k, v in then.items() if k in inputs}, dict(inputs), path="content"
            )
            if then
            else []
        )
        if not changed:
            return
        kept = all(inputs.get(key, digest) == digest for key, digest in then.items())
        if extend and kept and is_extended(stored.sweep(), sweep):
            with sqlite_errors_at(self.path), transaction(self._connection):
                self._connection.execute(
                    "UPDATE sweeps SET spec = ?, inputs = ?, trials = ?, points = ? WHERE name = ?",
                    (
                        json.dumps(description),
                        json.dumps({**then, **inputs}),
                        sweep.trials,
                        sweep.n_points,
                        sweep.name,
                    ),
                )
                self._enter_points(sweep)
            return
        hint = "give the new sweep another name" + (
            "" if extend else ", or use --extend if the new sweep only adds trials or points"
        )
        raise InvalidInputError(
            f"{self.path}: expected the sweep {sweep.name} as the store contains it, got changes:"
            f" {'; '.join(changed)} ({hint})"
        )

    def _forget_untouched(self, name: str, description: Mapping[str, Any]) -> None:
        """Delete a stored sweep that differs from the new sweep, if no trial of the stored sweep
        ever ran.
        """
        if name not in self.names:
            return
        stored = self.stored(name)
        begun = self.ask("SELECT 1 FROM batches WHERE sweep = ? LIMIT 1", stored.id)
        if not begun and stored.spec != json.loads(json.dumps(description)):
            with sqlite_errors_at(self.path), transaction(self._connection):
                self._connection.execute("DELETE FROM points WHERE sweep = ?", (stored.id,))
                self._connection.execute("DELETE FROM sweeps WHERE id = ?", (stored.id,))

    def _enter_points(self, sweep: Sweep) -> None:
        self._connection.executemany(
            "INSERT INTO points (sweep, number, key, axes) VALUES ((SELECT id FROM sweeps WHERE"
            " name = ?), ?, ?, ?) ON CONFLICT (sweep, key) DO UPDATE SET number = excluded.number,"
            " axes = excluded.axes",
            (
                (sweep.name, point.number, point.key, json.dumps([*point.values.values()]))
                for point in sweep.points
            ),
        )

    def missing(self, sweep: Sweep) -> list[Gap]:
        """Return the missing trials of a sweep, in the order of the points."""
        points = {point.key: point for point in sweep.points}
        rows = self.ask(
            "SELECT p.id, p.key, (SELECT count(*) FROM trials t WHERE t.point = p.id) FROM points p"
            " JOIN sweeps s ON s.id = p.sweep WHERE s.name = ? ORDER BY p.number",
            sweep.name,
        )
        gaps: list[Gap] = []
        for number, key, count in rows:
            if count == sweep.trials or key not in points:
                continue
            there = (
                [
                    trial
                    for (trial,) in self.ask(
                        "SELECT trial FROM trials WHERE point = ? ORDER BY trial", number
                    )
                ]
                if count
                else []
            )
            begin = 0
            for trial in [*there, sweep.trials]:
                if trial > begin:
                    gaps.append(Gap(points[key], number, begin, trial))
                begin = trial + 1
        return gaps

    def commit(self, sweep: Sweep, answer: Answer) -> None:
        """Write the results of one batch of trials to the store, in one transaction."""
        with sqlite_errors_at(self.path), transaction(self._connection):
            batch = self._connection.execute(
                "INSERT INTO batches (sweep, spec, seed, version, worker, trials, failures,"
                " seconds, finished) VALUES ((SELECT id FROM sweeps WHERE name ="
                " ?),?,?,?,?,?,?,?,?)",
                (
                    sweep.name,
                    digest_of(json.dumps(sweep.describe())),
                    sweep.seed,
                    versions_text(answer.versions),
                    answer.worker,
                    len(answer.rows),
                    len(answer.failures),
                    answer.seconds,
                    time.time(),
                ),
            ).lastrowid
            self._connection.executemany(
                "INSERT OR IGNORE INTO trials (point, trial, seed, batch, result) VALUES"
                " (?,?,?,?,?)",
                ((point, trial, seed, batch, result) for point, trial, seed, result in answer.rows),
            )
            self._connection.executemany(
                "INSERT OR REPLACE INTO failures (point, trial, seed, batch, error) VALUES"
                " (?,?,?,?,?)",
                (
                    (point, trial, seed, batch, error)
                    for point, trial, seed, error in answer.failures
                ),
            )
            if self._any_failures(sweep.name):
                self._connection.execute(
                    "DELETE FROM failures WHERE (point, trial) IN (SELECT point, trial FROM trials)"
                )

    def _any_failures(self, name: str) -> bool:
        cursor = self._connection.execute(
            "SELECT 1 FROM failures JOIN points p ON p.id = point JOIN sweeps s ON s.id = p.sweep"
            " WHERE s.name = ? LIMIT 1",
            (name,),
        )
        return cursor.fetchone() is not None

    def status(self, name: str) -> SweepStatus:
        """Return the progress of a sweep, which another process may be running."""
        stored = self.stored(name)
        self.check_points(name)
        number, total = stored.id, stored.trials * stored.n_points
        versions = self.versions(name)
        ((failed,),) = self.ask(
            "SELECT count(*) FROM failures WHERE point IN (SELECT id FROM points WHERE sweep = ?)",
            number,
        )
        ((last, seconds),) = self.ask(
            "SELECT max(finished), coalesce(sum(seconds), 0) FROM batches WHERE sweep = ?", number
        )
        running = is_locked(self.path, name)
        rate = self._rate(number, time.time() if running else last or 0.0)
        return SweepStatus(
            name,
            sum(versions.values()),
            total,
            failed,
            stored.n_points,
            running,
            rate,
            seconds,
            versions,
        )

    def versions(self, name: str) -> dict[str, int]:
        """Return the number of rows that each combination of software versions wrote, with the
        oldest combination first.
        """
        number = self.stored(name).id
        statuses = [
            text
            for (text,) in self.ask(
                "SELECT version FROM batches WHERE sweep = ? GROUP BY version ORDER BY min(id)",
                number,
            )
        ]
        if len(statuses) == 1:  # the usual case: no need to read every row
            query = (
                "SELECT count(*) FROM trials WHERE point IN (SELECT id FROM points WHERE sweep = ?)"
            )
            counts = {statuses[0]: self.ask(query, number)[0][0]}
        else:
            counts = dict(
                self.ask(
                    "SELECT b.version, count(*) FROM trials t JOIN batches b ON b.id = t.batch"
                    " WHERE b.sweep = ? GROUP BY 1",
                    number,
                )
            )
        return {text: counts[text] for text in statuses if counts.get(text)}

    def _rate(self, number: int, now: float) -> float:
        ((count, first),) = self.ask(
            "SELECT coalesce(sum(trials), 0), min(finished - seconds) FROM batches WHERE sweep = ?"
            " AND finished > ?",
            number,
            now - _RECENT,
        )
        return count / max(1e-3, now - max(first, now - _RECENT)) if count else 0.0

    def failures(
        self, name: str, *, limit: int = 1_000_000
    ) -> list[tuple[dict[str, Any], int, int, str]]:
        """Return the axis values, the trial number, the seed and the error message of each failed
        trial.
        """
        stored = self.stored(name)
        rows = self.ask(
            "SELECT p.axes, f.trial, f.seed, f.error FROM failures f JOIN points p ON p.id ="
            " f.point WHERE p.sweep = ? ORDER BY p.number, f.trial LIMIT ?",
            stored.id,
            limit,
        )
        return [(stored.values(text), trial, seed, error) for text, trial, seed, error in rows]

    def columns(self, name: str) -> list[str]:
        """Return the column names in the table of a sweep: axes, trial, seed and measures."""
        stored = self.stored(name)
        taken = ["trial", "seed", *stored.measures]
        return [f"axis_{axis}" if axis in taken else axis for axis in stored.axes] + taken

    def chunks(self, name: str) -> Iterator[list[Sequence[Any]]]:
        """Yield the table of a sweep in parts of about ten thousand rows, sorted by point and
        trial.

        Each part of the table is a list of columns.

        Raises
        ------
        InvalidInputError
            Raised if a row of the table is damaged.
        """
        stored = self.stored(name)
        axes: list[tuple[list[Any], int]] = []
        waiting = 0
        parts: tuple[list[str], ...] = ([], [], [])
        for point, values in self.points(name):
            last = -1
            while True:
                # Joined by SQLite, which is two and a half times as fast as one tuple per row.
                ((count, newest, *texts),) = self.ask(
                    "SELECT count(*), max(trial), group_concat(trial), group_concat(seed),"
                    " group_concat(result) FROM (SELECT * FROM trials WHERE point = ? AND trial > ?"
                    " ORDER BY trial LIMIT ?)",
                    point,
                    last,
                    _AT_ONCE,
                )
                if not count:
                    break
                last = newest
                axes.append(([*values.values()], count))
                waiting += count
                for part, text in zip(parts, texts, strict=True):
                    part.append(text)
                if waiting >= _AT_ONCE:
                    yield columns_of(axes, parts, stored)
                    axes, parts, waiting = [], ([], [], []), 0
                if count < _AT_ONCE:
                    break
        if axes:
            yield columns_of(axes, parts, stored)

    def values(
        self, name: str, measure: str, *, done: Sequence[str] = ()
    ) -> Iterator[tuple[dict[str, Any], NDArray[np.int64], Column, NDArray[np.bool_]]]:
        """Yield one measure at each point of a sweep, in the order of the points: the axis values,
        the trial numbers, the values of the trials and, if ``done`` is not empty, whether the
        measure "status" of each trial is not one of ``done``. The values are an array of int64 if
        all are whole numbers, and a list otherwise.

        Raises
        ------
        InvalidInputError
            Raised if the sweep has no such measure, or if a row is damaged.
        """
        stored = self.stored(name)
        if measure not in stored.measures:
            raise InvalidInputError(
                f"measure: expected one of {', '.join(stored.measures)}, got {measure!r}"
            )
        width, where = len(stored.measures), f"{stored.where}: results"
        column = stored.measures.index(measure)
        status = stored.measures.index("status") if done else column
        columns = sorted({column, status})
        for point, axes in self.points(name):
            trials: list[NDArray[np.int64]] = [np.empty(0, dtype=np.int64)]
            unfinished: list[NDArray[np.bool_]] = [np.empty(0, dtype=np.bool_)]
            values: list[Column] = []
            last, count = -1, _AT_ONCE
            while count == _AT_ONCE:
                ((numbers, text),) = self.ask(
                    "SELECT group_concat(trial), group_concat(result) FROM (SELECT trial, result"
                    " FROM trials WHERE point = ? AND trial > ? ORDER BY trial LIMIT ?)",
                    point,
                    last,
                    _AT_ONCE,
                )
                if numbers is None:
                    break
                trials.append(trial_numbers(numbers, where=stored.where))
                count, last = len(trials[-1]), int(trials[-1][-1])
                results = ResultTexts(text, columns, count, width, where=where)
                values.append(results.column(column))
                unfinished.append(
                    ~results.is_any(status, done) if done else np.zeros(count, dtype=np.bool_)
                )
            plain = all(isinstance(part, np.ndarray) for part in values) and values
            joined_values = np.concatenate(values) if plain else [*chain.from_iterable(values)]
            yield axes, np.concatenate(trials), joined_values, np.concatenate(unfinished)

    def rows(self, name: str) -> Iterator[tuple[Any, ...]]:
        """Yield the rows in the table of a sweep, sorted by point and trial."""
        for chunk in self.chunks(name):
            yield from zip(*chunk, strict=True)


@dataclass(frozen=True)
class StoredSweep:
    """The description of a sweep in a store. The method `sweep` creates the sweep and its problem.

    Parameters
    ----------
    id : int
        Number of the sweep's row in the store.
    where : str
        First words of error messages: the names of the store file and the sweep.
    spec : dict
        The sweep as JSON data, as returned by `shoal.lab.Sweep.describe`.
    inputs : mapping of str to str
        Digests of the maps, workspaces and regions that the sweep opens.
    measures : tuple of str
    trials, n_points : int
        ``trials`` is the number of trials per point, and ``n_points`` is the number of points.
    """

    id: int
    where: str
    spec: Mapping[str, Any]
    inputs: Mapping[str, str]
    measures: tuple[str, ...]
    trials: int
    n_points: int

    @cached_property
    def form(self) -> SweepForm:
        """The fields of the sweep, each converted to the type of the field."""
        return form_of(self.spec, where=self.where)

    @property
    def axes(self) -> tuple[str, ...]:
        """The names of the sweep's axes."""
        return tuple(self.form.axes)

    def sweep(self) -> Sweep:
        """Return the sweep as the user declared it for the run."""
        return sweep_of(self.spec, where=self.where)

    def values(self, text: str) -> dict[str, Any]:
        """Return the value of each axis by its name, from the text in the stored row of a point."""
        values = parse_json(text, where=f"{self.where}: point")
        if not isinstance(values, list) or len(values) != len(self.axes):
            raise InvalidInputError(
                f"{self.where}: expected {len(self.axes)} values at a point, one per axis, got"
                f" {shortened(values)}"
            )
        return dict(zip(self.axes, values, strict=True))

    def check_points(self, texts: Sequence[str]) -> None:
        """Refuse stored points that are not the points of the sweep, in the order of the sweep.

        Two points with the same axis values would otherwise share one mean in a summary. The check
        compares the axis values only, so that it runs no third-party code; `shoal.lab.store` also
        compares the digests of the problems.
        """
        with errors_at(f"{self.where}: spec"):
            axes = [axis_values(name, values) for name, values in self.form.axes.items()]
        count = prod(len(values) for values in axes)
        expected = [json.dumps(values) for values in product(*axes)] if count <= MAX_POINTS else []
        if [*texts] == expected and len(set(texts)) == count:
            return
        hint = "restore a copy, or start a new store"
        seen: set[str] = set()
        for text in texts:
            if text in seen:
                raise InvalidInputError(
                    f"{self.where}: expected points that differ, got two points with the axis"
                    f" values {shortened(text)}; {hint}"
                )
            seen.add(text)
        raise InvalidInputError(
            f"{self.where}: expected the {count} points of the sweep's axes, got {len(texts)}"
            f" points, not all of which are equal to these; {hint}"
        )


def stored_sweep(row: tuple[Any, ...], *, where: str) -> StoredSweep:
    """Return the sweep that a row with the columns (id, spec, inputs, measures, trials, points)
    describes.

    Raises
    ------
    InvalidInputError
        Raised if the row of the sweep is damaged.
    """
    number, *texts, trials, points = row
    spec, inputs, measures = (
        parse_json(text if isinstance(text, str) else "", where=f"{where}: {column}")
        for column, text in zip(("spec", "inputs", "measures"), texts, strict=True)
    )
    if not isinstance(spec, dict) or not isinstance(inputs, dict):
        raise InvalidInputError(
            f"{where}: expected JSON objects as spec and inputs, got {shortened(spec)} and"
            f" {shortened(inputs)}"
        )
    if not isinstance(measures, list) or not all(isinstance(name, str) for name in measures):
        raise InvalidInputError(
            f"{where}: measures: expected a list of names, got {shortened(measures)}"
        )
    if not isinstance(trials, int) or not isinstance(points, int):
        raise InvalidInputError(
            f"{where}: expected whole numbers of trials and of points, got {shortened(trials)} and"
            f" {shortened(points)}"
        )
    return StoredSweep(number, where, spec, inputs, tuple(measures), trials, points)


def columns_of(
    axes: list[tuple[list[Any], int]], parts: tuple[list[str], ...], stored: StoredSweep
) -> list[Sequence[Any]]:
    """Return rows of results as columns: the axes, the trial numbers, the seeds and the measures.

    Each entry of ``axes`` is (axis values of a point, number of rows of the point). ``parts``
    contains JSON texts of the trial numbers, the seeds and the results.

    Raises
    ------
    InvalidInputError
        Raised if a row of results is damaged.
    """
    first: list[list[Any]] = [[] for _ in axes[0][0]]
    for values, count in axes:
        for column, value in zip(first, values, strict=True):
            column.extend([value] * count)
    trials, seeds, results = (
        parse_json(f"[{','.join(part)}]", where=f"{stored.where}: results") for part in parts
    )
    width = len(stored.measures)
    bad = next((one for one in results if not isinstance(one, list) or len(one) != width), None)
    if not all(type(one) is int for one in (*trials, *seeds)):
        raise InvalidInputError(
            f"{stored.where}: trials: expected whole numbers of trials and seeds, got something"
            " else"
        )
    if bad is not None or not len(trials) == len(seeds) == len(results):
        got = f"{len(results)} rows for {len(trials)} trials" if bad is None else shortened(bad)
        raise InvalidInputError(
            f"{stored.where}: results: expected rows of {width} values, got {got}"
        )
    return [*first, trials, seeds, *(zip(*results, strict=True) if width else ())]


class ResultTexts:
    """The results of so many trials: JSON lists of ``width`` values, joined by commas. The columns
    are numbers of the values that will be asked for, ascending.

    Columns of plain rows (`find_values`) are read without parsing the others, and whole numbers
    without JSON, which is several times as fast.

    Raises
    ------
    InvalidInputError
        Raised if a row has not ``width`` values, here or by a method.
    """

    def __init__(
        self, text: str, columns: Sequence[int], count: int, width: int, *, where: str
    ) -> None:
        self._where = where
        self._text = np.frombuffer(text.encode(), dtype=np.uint8)
        begins, ends = np.empty((2, len(columns), count), dtype=np.int64)
        if find_values(self._text, width, np.array(columns, dtype=np.int64), begins, ends):
            self._spans = dict(zip(columns, zip(begins, ends, strict=True), strict=True))
            return
        rows = parse_json(f"[{text}]", where=where)
        bad = next((row for row in rows if not isinstance(row, list) or len(row) != width), None)
        if bad is not None or len(rows) != count:
            got = f"{len(rows)} rows for {count} trials" if bad is None else shortened(bad)
            raise InvalidInputError(f"{where}: expected rows of {width} values, got {got}")
        self._spans = {}
        self._values = {column: [row[column] for row in rows] for column in columns}

    def column(self, column: int) -> Column:
        """Return the values of a column: an array if all are whole numbers."""
        if not self._spans:
            return self._values[column]
        begins, ends = self._spans[column]
        numbers = np.empty(len(begins), dtype=np.int64)
        if read_whole_numbers(self._text, begins, ends, numbers):
            return numbers
        joined = np.empty(int((ends - begins + 1).sum()), dtype=np.uint8)
        size = join_values(self._text, begins, ends, joined)
        values: list[Any] = parse_json(
            f"[{joined[: size - 1].tobytes().decode()}]", where=self._where
        )
        return values

    def is_any(self, column: int, words: Sequence[str]) -> NDArray[np.bool_]:
        """Return which values of a column are one of some texts."""
        if not self._spans:
            return np.array([value in words for value in self._values[column]], dtype=np.bool_)
        begins, ends = self._spans[column]
        equal = np.zeros(len(begins), dtype=np.bool_)
        for word in words:
            quoted = np.frombuffer(json.dumps(word).encode(), dtype=np.uint8)
            mark_equal(self._text, begins, ends, quoted, equal)
        return equal


def trial_numbers(text: str, *, where: str) -> NDArray[np.int64]:
    """Return the numbers of trials, which a text has joined by commas.

    Raises
    ------
    InvalidInputError
        Raised if something of the text is no whole number.
    """
    data = np.frombuffer(text.encode(), dtype=np.uint8)
    commas = np.flatnonzero(data == ord(","))
    begins, ends = np.append(0, commas + 1), np.append(commas, len(data))
    numbers = np.empty(len(begins), dtype=np.int64)
    if not read_whole_numbers(data, begins, ends, numbers):
        raise InvalidInputError(
            f"{where}: trials: expected whole numbers of trials, got something else"
        )
    return numbers


_TRIES = 5
# a link or a pipe may be an attack: nothing is written to it
_PLAIN = os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK


def _lock_file(store: Path, name: str) -> Path:
    return store.with_name(f".{store.name}.{name}.lock")


@contextmanager
def locked(store: Path, name: str) -> Iterator[None]:
    """Hold the lock of a sweep inside the ``with`` block.

    Raises
    ------
    InvalidInputError
        Raised if another process holds the lock. The error message contains the process number of
        the lock's holder.
    OutputError
        Raised if the folder of the store is not writable.
    """
    path, tries = _lock_file(store, name), 0
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | _PLAIN, 0o666)
        except OSError as error:
            why = "it is a symbolic link" if error.errno == errno.ELOOP else error.strerror or error
            raise OutputError(f"cannot write {path}: {why}") from None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder = os.read(descriptor, 200).decode(errors="replace").strip() or "another process"
            os.close(descriptor)
            tries += 1
            if tries < _TRIES:  # the holder may be a process that only tests the lock
                time.sleep(0.02)
                continue
            raise InvalidInputError(
                f"{store}: expected a sweep that no process is running, got {name}, which {holder}"
                f" is running; wait for its end, or watch it with 'shoal sweep status {store}"
                " --watch'"
            ) from None
        if _is_still(descriptor, path):
            break
        os.close(descriptor)  # its last holder removed the file between our two calls
    half_written.add(path)
    try:
        # on a full disk the lock still works, but it does not name its holder
        with suppress(OSError):
            # fails for anything but a plain file, and nothing is written
            os.ftruncate(descriptor, 0)
            os.write(
                descriptor,
                f"process {os.getpid()} on {socket.gethostname()} since {time.strftime('%F %T')}".encode(),
            )
        yield
    finally:
        path.unlink(missing_ok=True)
        half_written.discard(path)
        os.close(descriptor)


def _is_still(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.lstat())
    except FileNotFoundError:
        return False


def is_locked(store: Path, name: str) -> bool:
    """Return whether some process currently runs the sweep ``name`` of a store."""
    try:
        descriptor = os.open(_lock_file(store, name), os.O_RDONLY | _PLAIN)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False


def faults_of(store: Store) -> list[str]:
    """Return the faults of a store as a list of sentences. For an intact store, return an empty
    list.

    The function checks the structure of the SQLite file and the values in each row, and compares
    the stored keys and seeds with the keys and seeds that the sweep defines. Open a store that may
    have damaged rows with ``damaged=True``.
    """
    faults: list[str] = []
    try:
        faults += [text for (text,) in store.ask("PRAGMA integrity_check(10)") if text != "ok"]
        faults += [
            f"table {table}: a row refers to one that is not there"
            for table, *_ in store.ask("PRAGMA foreign_key_check")
        ]
        damaged = store.row_faults()
        faults += damaged
        if not damaged:  # else the sweeps cannot be read
            for name in store.names:
                faults += _faults_of(store, name)
    except InvalidInputError as error:
        faults.append(str(error))
    return faults


def _faults_of(store: Store, name: str) -> Iterator[str]:
    try:
        stored = store.stored(name)
        store.check_points(name)
        sweep = stored.sweep()
    except InvalidInputError as error:
        yield str(error)
        return
    points = {point.key: point for point in sweep.points}
    rows_of_points = store.ask(
        "SELECT id, key, axes FROM points WHERE sweep = ? ORDER BY number", stored.id
    )
    stored_axes = {key: text for _, key, text in rows_of_points}
    if stored_axes != {key: json.dumps([*point.values.values()]) for key, point in points.items()}:
        yield f"sweep {name}: its points are not those of its spec"
        return
    for point, key, _ in rows_of_points:
        seeds = points[key].seeds
        rows = store.ask("SELECT trial, seed, result FROM trials WHERE point = ?", point)
        failed = store.ask(
            "SELECT t.trial FROM trials t JOIN failures f ON f.point = t.point AND f.trial = t.trial"
            " WHERE t.point = ?",
            point,
        )
        numbered = [row for row in rows if isinstance(row[0], int) and 0 <= row[0] < sweep.trials]
        damaged = _damaged_results(rows, len(stored.measures))
        found = {
            "a trial that is not of the sweep": {row[0] for row in rows} - {r[0] for r in numbered},
            "its seed is not the one that the sweep gives": [
                trial for trial, seed, _ in numbered if seed != trial_seed(sweep.seed, seeds, trial)
            ],
            "it has a result and has failed": [trial for (trial,) in failed],
            f"its result has not {len(stored.measures)} numbers or texts": damaged,
        }
        for fault, trials in found.items():
            if trials:
                ordered = sorted(trials, key=lambda trial: (type(trial).__name__, trial))
                some = [shortened(trial) for trial in ordered[:_NAMED]]
                more = f" and {len(trials) - _NAMED} more" if len(trials) > _NAMED else ""
                number = points[key].number
                word = "trial" if len(trials) == 1 else "trials"
                yield f"sweep {name}, point {number}, {word} {', '.join(some)}{more}: {fault}"


def _damaged_results(rows: Sequence[tuple[Any, ...]], width: int) -> list[Any]:
    """Return the trials whose result is not a JSON list of ``width`` values that can be stored."""

    def whole(texts: list[str]) -> bool:
        try:
            found = json.loads(f"[{','.join(texts)}]")
            return len(found) == len(texts) and all(
                len(values) == width and all(map(is_storable, values)) for values in found
            )
        except (ValueError, TypeError, RecursionError):
            return False

    texts = [row[2] if isinstance(row[2], str) else "" for row in rows]
    if whole(texts):
        return []
    return [row[0] for row, text in zip(rows, texts, strict=True) if not whole([text])]
