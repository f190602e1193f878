"""Merging of stores: combine several stores, which may contain results of common sweeps, into one store."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from shoal.core.errors import InvalidInputError
from shoal.lab.storage.schema import unfinished_store
from shoal.lab.storage.store import Store
from shoal.lab.sweeps.sweep import differences

Write = Callable[[str, Sequence[Any]], int]


def merge_stores(sources: Sequence[str | os.PathLike[str]], out: str | os.PathLike[str]) -> list[str]:
    """Merge several stores into a new store. Return the names of all sweeps in the new store.

    If several stores contain sweeps with an equal name, these sweeps must be equal. If several stores contain results of the same
    trial, these results must be equal.

    Parameters
    ----------
    sources : sequence of path
    out : path
        Path of the new store.

    Raises
    ------
    InvalidInputError
        Raised if sweeps with equal names differ, if results of the same trial differ, if a store is damaged, or if ``out`` exists.
        After an error, no new store remains.
    OutputError
    """
    target = Path(out)
    if os.path.lexists(target):
        raise InvalidInputError(f"{target}: expected the name of a new file for the merged store, got an existing file")
    with unfinished_store(target) as temporary, Store(temporary, write=True) as merged:
        for source in sources:
            with Store(source) as opened:
                for name in opened.names:
                    _take(merged, opened, name)
        return merged.names


def _take(merged: Store, opened: Store, name: str) -> None:
    """Copy all rows of a sweep into the merged store, except the rows that the merged store already contains."""
    stored, where = opened.stored(name), f"{opened.path}: sweep {name}"
    opened.check_points(name)
    if name in merged.names:
        there = merged.stored(name)
        changed = [*differences(there.spec, stored.spec), *differences(there.inputs, stored.inputs, path="content")]
        if changed:
            raise InvalidInputError(f"{where}: expected the same sweep as in the stores before, got changes: {'; '.join(changed)}")
    with merged.writing() as write:

        def copy(table: str, columns: str, old: int, *new: int) -> int:
            """Copy the row ``old`` of a table to the merged store, and return the number of the new row.

            If ``new`` is given, it contains the number of the sweep in the merged store.
            """
            rows = opened.ask(f"SELECT {columns} FROM {table} WHERE id = ?", old)
            if not rows:
                raise InvalidInputError(f"{where}: expected row {old} of the table {table}, which other rows refer to, got none")
            return _insert(write, table, "sweep, " * len(new) + columns, (*new, *rows[0]))

        copy("sweeps", "name, spec, inputs, measures, trials, points, created, version", stored.id)
        new = merged.stored(name).id
        batches: dict[int, int] = {}
        for point, key in opened.ask("SELECT id, key FROM points WHERE sweep = ?", stored.id):
            copy("points", "number, key, axes", point, new)
            ((place,),) = merged.ask("SELECT id FROM points WHERE sweep = ? AND key = ?", new, key)
            had = {row[0]: row[1:] for row in merged.ask("SELECT trial, seed, result FROM trials WHERE point = ?", place)}
            for table, told in (("trials", "result"), ("failures", "error")):
                for trial, seed, batch, value in opened.ask(
                    f"SELECT trial, seed, batch, {told} FROM {table} WHERE point = ?", point
                ):
                    if table == "trials" and had.get(trial, (seed, value)) != (seed, value):
                        raise InvalidInputError(
                            f"{where}, trial {trial}: expected the same result as in the stores before, got another result"
                        )
                    if trial in had:
                        continue
                    if batch not in batches:
                        told_of = "spec, seed, version, worker, trials, failures, seconds, finished"
                        batches[batch] = copy("batches", told_of, batch, new)
                    _insert(write, table, f"point, trial, seed, batch, {told}", (place, trial, seed, batches[batch], value))
        write("DELETE FROM failures WHERE (point, trial) IN (SELECT point, trial FROM trials)", ())


def _insert(write: Write, table: str, columns: str, values: tuple[Any, ...]) -> int:
    """Insert a row into a table, unless the row exists. Return the number of the row."""
    return write(f"INSERT OR IGNORE INTO {table} ({columns}) VALUES ({', '.join('?' * len(values))})", values)
