"""Whether a store is whole: SQLite's own structure, every key, every seed, every row."""

from __future__ import annotations

import json
from collections.abc import Iterator

from shoal.lab.storage.store import Store
from shoal.lab.sweeps.sweep import trial_seed


def faults_of(store: Store) -> list[str]:
    """Return what is wrong with a store, one sentence each; nothing if all is well.

    Looked at are SQLite's own structure, that every key and seed is the one that its sweep gives, and that every row has as many
    values as there are measures.
    """
    faults = [text for (text,) in store.ask("PRAGMA integrity_check(10)") if text != "ok"]
    faults += [f"table {table}: a row refers to one that is not there" for table, *_ in store.ask("PRAGMA foreign_key_check")]
    for name in store.names:
        faults += _faults_of(store, name)
    return faults


def _faults_of(store: Store, name: str) -> Iterator[str]:
    sweep, (number, _, _, measures, *_) = store.sweep(name), store.row(name)
    points = {point.key: point for point in sweep.points}
    width = len(json.loads(measures))
    stored = store.ask("SELECT id, key FROM points WHERE sweep = ? ORDER BY number", number)
    if {key for _, key in stored} != {*points}:
        yield f"sweep {name}: its points are not those of its spec"
        return
    for point, key in stored:
        rows = store.ask("SELECT trial, seed, result FROM trials WHERE point = ?", point)
        wrong = next((trial for trial, seed, _ in rows if seed != trial_seed(sweep.seed, points[key].seeds, trial)), None)
        if wrong is not None:
            yield f"sweep {name}, point {points[key].number}, trial {wrong}: its seed is not the one that the sweep gives"
        if any(not 0 <= trial < sweep.trials for trial, _, _ in rows):
            yield f"sweep {name}, point {points[key].number}: a trial that is not of the sweep"
        try:
            short = any(len(values) != width for values in json.loads(f"[{','.join([row[2] for row in rows])}]"))
        except (ValueError, TypeError):
            short = True
        if short:
            yield f"sweep {name}, point {points[key].number}: a row that has not {width} values"
