"""What goes to a worker and comes back: a batch of trials, and its answer."""

from __future__ import annotations

import json
import os
import socket
import time
from math import isfinite
from typing import Any

import numpy as np

from shoal.core.checks import shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.core.problem import Problem
from shoal.lab import problems
from shoal.lab.sweeps.sweep import trial_seed
from shoal.lab.versions import worker_versions

_LONGEST_TEXT = 1000  # characters of a text that a trial measures
_OPEN = 8  # maps, workspaces and regions that a worker keeps open


@dataclass(frozen=True)
class Piece:
    """Trials of one point, from ``first`` on, up to but without ``stop``.

    Parameters
    ----------
    point : int
        Its number in the store.
    problem : Problem
    seeds : str
        What the seeds of its trials are made of.
    first, stop : int
    place : object, optional
        The opened map, workspace or region, if a worker may not have the file.
    """

    point: int
    problem: Problem
    seeds: str
    first: int
    stop: int
    place: Any = None


@dataclass(frozen=True)
class Batch:
    """Some pieces, played one after another by one worker."""

    sweep_seed: int
    pieces: tuple[Piece, ...]

    @property
    def trials(self) -> int:
        """Number of trials."""
        return sum(piece.stop - piece.first for piece in self.pieces)


@dataclass(frozen=True)
class Answer:
    """What a worker has finished.

    Parameters
    ----------
    rows : list of (point, trial, seed, result)
        The result as JSON.
    failures : list of (point, trial, seed, error)
    seconds : float
    paces : list of (point, float)
        Seconds a trial, by piece.
    versions : dict
        See `shoal.lab.versions`.
    worker : str
    """

    rows: list[tuple[int, int, int, str]]
    failures: list[tuple[int, int, int, str]]
    seconds: float
    paces: list[tuple[int, float]]
    versions: dict[str, str]
    worker: str


_places: dict[tuple[str, str], Any] = {}


def placed(problem: Problem) -> Problem:
    """Return a problem with its place opened; problems about the same place share it."""
    name = problem.place_key()
    if name is None:
        return problem
    key = (problem.part, name)
    if key not in _places:
        if len(_places) >= _OPEN:
            del _places[next(iter(_places))]
        _places[key] = problem.open_place()
    return problem.at_place(_places[key])


def play_batch(batch: Batch) -> Answer:
    """Play a batch: what runs in a worker. An error in a trial is its failure, and the others go on."""
    began = time.perf_counter()
    rows, failures, paces = [], [], []
    for piece in batch.pieces:
        start = time.perf_counter()
        for trial in range(piece.first, piece.stop):
            seed = trial_seed(batch.sweep_seed, piece.seeds, trial)
            try:
                problem = placed(piece.problem) if piece.place is None else piece.problem.at_place(piece.place)
                rows.append((piece.point, trial, seed, _written(problems.trial(problem, seed))))
            except (Exception, SystemExit) as error:  # a third party's policy or function: anything may happen in it
                what = " ".join(str(error).split())[:500]
                failures.append(
                    (piece.point, trial, seed, what if isinstance(error, ShoalError) else f"{type(error).__name__}: {what}")
                )
        paces.append((piece.point, (time.perf_counter() - start) / (piece.stop - piece.first)))
    seconds = time.perf_counter() - began
    return Answer(rows, failures, seconds, paces, worker_versions(), worker_name())


def worker_name() -> str:
    """Return what this process is called among workers: machine and process."""
    return f"{socket.gethostname()}:{os.getpid()}"


def _written(values: list[Any]) -> str:
    """Return a result as JSON, NumPy's numbers as Python's."""
    plain = [value.item() if isinstance(value, np.generic) else value for value in values]
    for value in plain:
        if not is_storable(value):
            raise InvalidInputError(f"result: expected finite numbers, truth values, short texts or None, got {shortened(value)}")
    return json.dumps(plain, separators=(",", ":"), allow_nan=False)


def is_storable(value: Any) -> bool:
    """Tell whether a store takes a value of a result."""
    if isinstance(value, str):
        return len(value) <= _LONGEST_TEXT and value.isprintable()
    return value is None or (isinstance(value, int) and abs(value) < 2**63) or (isinstance(value, float) and isfinite(value))


def lost_batch(batch: Batch, why: str) -> Answer:
    """Return the answer of a batch that no worker survived: all of its trials have failed."""
    failures = [
        (piece.point, trial, trial_seed(batch.sweep_seed, piece.seeds, trial), why)
        for piece in batch.pieces
        for trial in range(piece.first, piece.stop)
    ]
    return Answer([], failures, 0.0, [], worker_versions(), "")
