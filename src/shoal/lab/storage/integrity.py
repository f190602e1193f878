"""Integrity checks of a store: check the structure of the SQLite file, the keys of points, the seeds of trials, and all rows."""

from __future__ import annotations

import json
from collections.abc import Iterator

from shoal.core.errors import InvalidInputError
from shoal.lab.storage.store import Store
from shoal.lab.sweeps.batches import is_storable
from shoal.lab.sweeps.sweep import trial_seed


def faults_of(store: Store) -> list[str]:
    """Return the faults of a store as a list of sentences. For an intact store, return an empty list.

    The function checks the structure of the SQLite file and the number of values in each row, and compares the stored keys and
    seeds with the keys and seeds that the sweep defines.
    """
    faults = [text for (text,) in store.ask("PRAGMA integrity_check(10)") if text != "ok"]
    faults += [f"table {table}: a row refers to one that is not there" for table, *_ in store.ask("PRAGMA foreign_key_check")]
    for name in store.names:
        faults += _faults_of(store, name)
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
    width = len(stored.measures)
    rows_of_points = store.ask("SELECT id, key, axes FROM points WHERE sweep = ? ORDER BY number", stored.id)
    told = {key: text for _, key, text in rows_of_points}
    if told != {key: json.dumps([*point.values.values()]) for key, point in points.items()}:
        yield f"sweep {name}: its points are not those of its spec"
        return
    for point, key, _ in rows_of_points:
        rows = store.ask("SELECT trial, seed, result FROM trials WHERE point = ?", point)
        wrong = next((trial for trial, seed, _ in rows if seed != trial_seed(sweep.seed, points[key].seeds, trial)), None)
        if wrong is not None:
            yield f"sweep {name}, point {points[key].number}, trial {wrong}: its seed is not the one that the sweep gives"
        if any(not 0 <= trial < sweep.trials for trial, _, _ in rows):
            yield f"sweep {name}, point {points[key].number}: a trial that is not of the sweep"
        try:
            whole = all(
                len(values) == width and all(map(is_storable, values))
                for values in json.loads(f"[{','.join([row[2] for row in rows])}]")
            )
        except (ValueError, TypeError, RecursionError):
            whole = False
        if not whole:
            yield f"sweep {name}, point {points[key].number}: a row that has not {width} numbers or texts"
