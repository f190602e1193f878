"""What goes to a worker and comes back: a batch of trials, and its answer."""

from __future__ import annotations

import json
import os
import socket
import time
from dataclasses import dataclass
from math import isfinite
from typing import Any

from shoal.errors import InvalidInputError, ShoalError
from shoal.lab.problems import Problem
from shoal.lab.sweeps.sweep import trial_seed
from shoal.lab.versions import versions

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
    opened : object, optional
        What the problem opens, if a worker may not have the file.
    """

    point: int
    problem: Problem
    seeds: str
    first: int
    stop: int
    opened: Any = None


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


_by_source: dict[tuple[str, str], Any] = {}


def opened_for(problem: Problem) -> Any:
    """Return what a problem opens; the same object for the same source."""
    source = problem.source()
    if source is None:
        return problem.opened()
    key = (problem.kind, source)
    if key not in _by_source:
        if len(_by_source) >= _OPEN:
            del _by_source[next(iter(_by_source))]
        _by_source[key] = problem.opened()
    return _by_source[key]


def play_batch(batch: Batch) -> Answer:
    """Play a batch: what runs in a worker. An error in a trial is its failure, and the others go on."""
    began = time.perf_counter()
    rows, failures, paces = [], [], []
    for piece in batch.pieces:
        start = time.perf_counter()
        for trial in range(piece.first, piece.stop):
            seed = trial_seed(batch.sweep_seed, piece.seeds, trial)
            try:
                opened = piece.opened if piece.opened is not None else opened_for(piece.problem)
                rows.append((piece.point, trial, seed, _written(piece.problem.play(opened, seed))))
            except Exception as error:  # a third party's policy or function: anything may happen in it
                what = " ".join(str(error).split())[:500]
                failures.append(
                    (piece.point, trial, seed, what if isinstance(error, ShoalError) else f"{type(error).__name__}: {what}")
                )
        paces.append((piece.point, (time.perf_counter() - start) / (piece.stop - piece.first)))
    seconds = time.perf_counter() - began
    return Answer(rows, failures, seconds, paces, versions(), f"{socket.gethostname()}:{os.getpid()}")


def _written(values: list[Any]) -> str:
    """Return a result as JSON, NumPy's numbers as Python's."""
    plain = [value.item() if hasattr(value, "item") else value for value in values]
    if any(isinstance(value, float) and not isfinite(value) for value in plain):
        raise InvalidInputError(f"result: expected finite numbers (None where there is none), got {plain}")
    return json.dumps(plain, separators=(",", ":"), allow_nan=False)


def lost_batch(batch: Batch, why: str) -> Answer:
    """Return the answer of a batch that no worker survived: all of its trials have failed."""
    failures = [
        (piece.point, trial, trial_seed(batch.sweep_seed, piece.seeds, trial), why)
        for piece in batch.pieces
        for trial in range(piece.first, piece.stop)
    ]
    return Answer([], failures, 0.0, [], versions(), "")
