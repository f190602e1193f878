"""Exchange between stores and files: merge stores, and export results as tables."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from shoal.core.checks import as_path, check_list
from shoal.core.errors import InvalidInputError, import_extra
from shoal.core.files import atomic, check_suffix
from shoal.lab.database import unfinished_store
from shoal.lab.store import Store, StoredSweep
from shoal.lab.sweep import differences

Write = Callable[[str, Sequence[Any]], int]


def merge_stores(
    sources: Sequence[str | os.PathLike[str]], out: str | os.PathLike[str]
) -> list[str]:
    """Merge several stores into a new store. Return the names of all sweeps in the new store.

    If several stores contain sweeps with an equal name, these sweeps must be equal. If several
    stores contain results of the same trial, these results must be equal.

    Parameters
    ----------
    sources : sequence of path
    out : path
        Path of the new store.

    Raises
    ------
    InvalidInputError
        Raised if sweeps with equal names differ, if results of the same trial differ, if a store is
        damaged, or if ``out`` exists. After an error, no new store remains.
    OutputError
    """
    target = as_path(out, what="out")
    sources = check_list(sources, what="sources")
    if os.path.lexists(target):
        raise InvalidInputError(
            f"{target}: expected the name of a new file for the merged store, got an existing file"
        )
    _check_equal(sources)
    with unfinished_store(target) as temporary, Store(temporary, write=True) as merged:
        for source in sources:
            with Store(source) as opened:
                for name in opened.names:
                    _take(merged, opened, name)
        return merged.names


def _check_equal(sources: Sequence[str | os.PathLike[str]]) -> None:
    """Refuse stores that contain different sweeps of an equal name, before any row is copied."""
    before: dict[str, StoredSweep] = {}
    for source in sources:
        with Store(source) as opened:
            for name in opened.names:
                stored = opened.stored(name)
                opened.check_points(name)
                first = before.setdefault(name, stored)
                changed = [
                    *differences(first.spec, stored.spec),
                    *differences(first.inputs, stored.inputs, path="content"),
                ]
                if changed:
                    raise InvalidInputError(
                        f"{opened.path}: sweep {name}: expected the same sweep as in the stores"
                        f" before, got changes: {'; '.join(changed)}"
                    )


def _take(merged: Store, opened: Store, name: str) -> None:
    """Copy all rows of a sweep into the merged store, except the rows that the merged store already
    contains.
    """
    stored, where = opened.stored(name), f"{opened.path}: sweep {name}"
    with merged.writing() as write:

        def copy(table: str, columns: str, old: int, *new: int) -> int:
            """Copy the row ``old`` of a table to the merged store, and return the number of the new
            row.

            If ``new`` is given, it contains the number of the sweep in the merged store.
            """
            rows = opened.ask(f"SELECT {columns} FROM {table} WHERE id = ?", old)
            if not rows:
                raise InvalidInputError(
                    f"{where}: expected row {old} of the table {table}, which other rows refer to,"
                    " got none"
                )
            return _insert(write, table, "sweep, " * len(new) + columns, (*new, *rows[0]))

        copy("sweeps", "name, spec, inputs, measures, trials, points, created, version", stored.id)
        new = merged.stored(name).id
        batches: dict[int, int] = {}
        for point, key in opened.ask("SELECT id, key FROM points WHERE sweep = ?", stored.id):
            copy("points", "number, key, axes", point, new)
            ((place,),) = merged.ask("SELECT id FROM points WHERE sweep = ? AND key = ?", new, key)
            had = {
                row[0]: row[1:]
                for row in merged.ask(
                    "SELECT trial, seed, result FROM trials WHERE point = ?", place
                )
            }
            for table, value_column in (("trials", "result"), ("failures", "error")):
                for trial, seed, batch, value in opened.ask(
                    f"SELECT trial, seed, batch, {value_column} FROM {table} WHERE point = ?", point
                ):
                    if table == "trials" and had.get(trial, (seed, value)) != (seed, value):
                        raise InvalidInputError(
                            f"{where}, trial {trial}: expected the same result as in the stores"
                            " before, got another result"
                        )
                    if trial in had:
                        continue
                    if batch not in batches:
                        told_of = "spec, seed, version, worker, trials, failures, seconds, finished"
                        batches[batch] = copy("batches", told_of, batch, new)
                    _insert(
                        write,
                        table,
                        f"point, trial, seed, batch, {value_column}",
                        (place, trial, seed, batches[batch], value),
                    )
        write("DELETE FROM failures WHERE (point, trial) IN (SELECT point, trial FROM trials)", ())


def _insert(write: Write, table: str, columns: str, values: tuple[Any, ...]) -> int:
    """Insert a row into a table, unless the row exists. Return the number of the row."""
    return write(
        f"INSERT OR IGNORE INTO {table} ({columns}) VALUES ({', '.join('?' * len(values))})", values
    )


SUFFIXES = (".csv", ".parquet")


def export(store: Store, name: str, path: str | os.PathLike[str]) -> int:
    """Write the results of a sweep as a table, sorted by point and trial. Return the number of rows
    in the table.

    The columns of the table are the axes, the trial number, the seed and the measures.

    Parameters
    ----------
    store : Store
    name : str
        Name of the sweep.
    path : path
        Path of the output file, which ends in ``.csv`` or ``.parquet``. The metadata of a Parquet
        file contain the sweep as JSON under the key "shoal".

    Raises
    ------
    InvalidInputError, UnknownNameError, OutputError
    MissingExtraError
        Raised if the output file is a Parquet file and ``shoal[lab]`` is not installed.
    """
    target = check_suffix(path, *SUFFIXES)
    columns = store.columns(name)
    write = _write_csv if target.suffix == ".csv" else _write_parquet
    with atomic(target) as temporary:
        return write(store, name, columns, temporary)


def _write_csv(store: Store, name: str, columns: list[str], path: Path) -> int:
    count = 0
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for chunk in store.chunks(name):
            writer.writerows(zip(*(map(_defused, column) for column in chunk), strict=True))
            count += len(chunk[-1])
    return count


def _defused(value: Any) -> Any:
    """Return a value as the content of a CSV cell. Put an apostrophe before a text that a
    spreadsheet would read as a formula.
    """
    return (
        f"'{value}"
        if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r"))
        else value
    )


def _write_parquet(store: Store, name: str, columns: list[str], path: Path) -> int:
    arrow, parquet = (
        import_extra(name, "Parquet needs pyarrow", extra="lab")
        for name in ("pyarrow", "pyarrow.parquet")
    )
    count, writer, schema = 0, None, None
    try:
        for chunk in store.chunks(name):
            arrays = [
                _array(arrow, column, schema and schema.field(i).type)
                for i, column in enumerate(chunk)
            ]
            table = arrow.Table.from_arrays(arrays, names=columns)
            if writer is None:
                schema = _schema(arrow, store, name, table)
                writer = parquet.ParquetWriter(path, schema)
            writer.write_table(table.cast(schema))
            count += len(chunk[-1])
        if writer is None:  # without finished trials, the columns are the same
            empty = arrow.schema([(column, arrow.null()) for column in columns])
            parquet.write_table(empty.empty_table(), path)
    finally:
        if writer is not None:
            writer.close()
    return count


def _schema(arrow: Any, store: Store, name: str, table: Any) -> Any:
    """Return the types of the columns in the table of a sweep.

    The column of a measure with whole numbers has the type float, because later rows of the column
    may contain fractions.
    """
    fields = []
    sweep = store.sweep(name)
    whole = {
        "trial",
        "seed",
        *(
            axis
            for axis, values in sweep.axes.items()
            if all(isinstance(value, int) for value in values)
        ),
    }
    for entry in table.schema:
        number = arrow.types.is_integer(entry.type) and entry.name not in whole
        fields.append(
            arrow.field(
                entry.name,
                arrow.float64() if number or arrow.types.is_null(entry.type) else entry.type,
            )
        )
    return arrow.schema(fields, metadata={"shoal": json.dumps(sweep.describe())})


def _array(arrow: Any, values: Sequence[Any], kind: Any) -> Any:
    try:
        return arrow.array(values, type=kind)
    except (arrow.ArrowInvalid, arrow.ArrowTypeError):  # texts and numbers in one column
        return arrow.array([None if value is None else str(value) for value in values])


def frame(store: Store, name: str) -> Any:
    """Return the results of a sweep as a pandas data frame.

    Raises
    ------
    UnknownNameError
    MissingExtraError
        Raised if ``shoal[lab]`` is not installed.
    """
    pandas = import_extra("pandas", "a data frame needs pandas", extra="lab")
    columns = store.columns(name)
    parts = [
        pandas.DataFrame(dict(zip(columns, chunk, strict=True))) for chunk in store.chunks(name)
    ]
    return pandas.concat(parts, ignore_index=True) if parts else pandas.DataFrame(columns=columns)
