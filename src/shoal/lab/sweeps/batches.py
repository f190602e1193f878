"""Batches of trials that workers run, and the answers of workers to the coordinator of a sweep."""

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

_LONGEST_TEXT = 1000  # maximum characters of a text that a trial measures
_OPEN = 8  # number of maps, workspaces and regions that a worker keeps open


@dataclass(frozen=True)
class Piece:
    """A sequence of trials of one point of a sweep: trial ``first`` to trial ``stop`` - 1.

    Parameters
    ----------
    point : int
        Number of the point's row in the store.
    problem : Problem
    seeds : str
        Text from which the seeds of the trials are computed: the problem without the paired axes, which do not influence seeds.
    first, stop : int
    place : object, optional
        The opened map, workspace or region, for workers without the file of the place.
    """

    point: int
    problem: Problem
    seeds: str
    first: int
    stop: int
    place: Any = None


@dataclass(frozen=True)
class Batch:
    """A batch of trials: several sequences of trials (pieces), which one worker runs one after another."""

    sweep_seed: int
    pieces: tuple[Piece, ...]

    @property
    def trials(self) -> int:
        """Number of trials in the batch."""
        return sum(piece.stop - piece.first for piece in self.pieces)


@dataclass(frozen=True)
class Answer:
    """A worker's answer for one batch: the results of the trials.

    Parameters
    ----------
    rows : list of (point, trial, seed, result)
        Point number, trial number, seed and result (as JSON) of each successful trial.
    failures : list of (point, trial, seed, error)
    seconds : float
    paces : list of (point, float)
        Point number and mean time per trial in seconds, for each piece (sequence of trials of one point) of the batch.
    versions : dict
        The versions on which the results of the worker depend.
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
    """Return a copy of a problem with its map, workspace or region opened. Problems with equal places share the opened place."""
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
    """Run a batch in a worker. If a trial raises an error, record the trial as failed and continue with the next trial."""
    began = time.perf_counter()
    rows, failures, paces = [], [], []
    for piece in batch.pieces:
        start = time.perf_counter()
        for trial in range(piece.first, piece.stop):
            seed = trial_seed(batch.sweep_seed, piece.seeds, trial)
            try:
                problem = placed(piece.problem) if piece.place is None else piece.problem.at_place(piece.place)
                rows.append((piece.point, trial, seed, _written(problems.trial(problem, seed))))
            except (Exception, SystemExit) as error:  # third-party code may raise any exception
                what = " ".join(str(error).split())[:500]
                failures.append(
                    (piece.point, trial, seed, what if isinstance(error, ShoalError) else f"{type(error).__name__}: {what}")
                )
        paces.append((piece.point, (time.perf_counter() - start) / (piece.stop - piece.first)))
    seconds = time.perf_counter() - began
    return Answer(rows, failures, seconds, paces, worker_versions(), worker_name())


def worker_name() -> str:
    """Return the worker name of the current process: the name of the machine and the number of the process."""
    return f"{socket.gethostname()}:{os.getpid()}"


def _written(values: list[Any]) -> str:
    """Return the values of a result as JSON, with NumPy numbers converted to Python numbers."""
    plain = [value.item() if isinstance(value, np.generic) else value for value in values]
    for value in plain:
        if not is_storable(value):
            raise InvalidInputError(f"result: expected finite numbers, truth values, short texts or None, got {shortened(value)}")
    return json.dumps(plain, separators=(",", ":"), allow_nan=False)


def is_storable(value: Any) -> bool:
    """Return whether a store accepts a value as the result of a trial."""
    if isinstance(value, str):
        return len(value) <= _LONGEST_TEXT and value.isprintable()
    return value is None or (isinstance(value, int) and abs(value) < 2**63) or (isinstance(value, float) and isfinite(value))


def lost_batch(batch: Batch, why: str) -> Answer:
    """Return the answer for a batch that no worker survived. The answer records all trials of the batch as failed."""
    failures = [
        (piece.point, trial, trial_seed(batch.sweep_seed, piece.seeds, trial), why)
        for piece in batch.pieces
        for trial in range(piece.first, piece.stop)
    ]
    return Answer([], failures, 0.0, [], worker_versions(), "")
