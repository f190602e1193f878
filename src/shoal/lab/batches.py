"""Batches of trials: what workers run and answer, the progress of a sweep, and the versions on
which results may depend.
"""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any

import numpy as np

from shoal.core.checks import shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, describe_error
from shoal.core.problem import Problem
from shoal.core.version import code_digest, versions
from shoal.lab import problems
from shoal.lab.sweep import Point, trial_seed

_LONGEST_TEXT = 1000  # maximum characters of a text that a trial measures


@dataclass(frozen=True)
class Piece:
    """A sequence of trials of one point of a sweep: trial ``first`` to trial ``stop`` - 1.

    Parameters
    ----------
    point : int
        Number of the point's row in the store.
    problem : Problem
    seeds : str
        Text from which the seeds of the trials are computed: the problem without the paired axes,
        which do not influence seeds.
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
    """A batch of trials: several sequences of trials (pieces), which one worker runs one after
    another.
    """

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
        Point number and mean time per trial in seconds, for each piece (sequence of trials of one
        point) of the batch.
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


def play_batch(batch: Batch) -> Answer:
    """Run a batch in a worker. If a trial raises an error, record the trial as failed and continue
    with the next trial.
    """
    began = time.perf_counter()
    rows, failures, paces = [], [], []
    for piece in batch.pieces:
        start = time.perf_counter()
        for trial in range(piece.first, piece.stop):
            seed = trial_seed(batch.sweep_seed, piece.seeds, trial)
            try:
                problem = (
                    piece.problem.opened()
                    if piece.place is None
                    else piece.problem.at_place(piece.place)
                )
                rows.append((piece.point, trial, seed, _as_json(problems.trial(problem, seed))))
            except (Exception, SystemExit) as error:  # third-party code may raise any exception
                failures.append((piece.point, trial, seed, describe_error(error)))
        paces.append((piece.point, (time.perf_counter() - start) / (piece.stop - piece.first)))
    seconds = time.perf_counter() - began
    return Answer(rows, failures, seconds, paces, worker_versions(), worker_name())


def worker_name() -> str:
    """Return the worker name of the current process: the name of the machine and the number of the
    process.
    """
    return f"{socket.gethostname()}:{os.getpid()}"


def _as_json(values: list[Any]) -> str:
    """Return the values of a result as JSON, with NumPy numbers converted to Python numbers."""
    plain = [value.item() if isinstance(value, np.generic) else value for value in values]
    for value in plain:
        if not is_storable(value):
            raise InvalidInputError(
                "result: expected finite numbers, truth values, short texts or None, got"
                f" {shortened(value)}"
            )
    return json.dumps(plain, separators=(",", ":"), allow_nan=False)


def is_storable(value: Any) -> bool:
    """Return whether a store accepts a value as the result of a trial."""
    if isinstance(value, str):
        return len(value) <= _LONGEST_TEXT and value.isprintable()
    return (
        value is None
        or (isinstance(value, int) and abs(value) < 2**63)
        or (isinstance(value, float) and isfinite(value))
    )


def lost_batch(batch: Batch, why: str) -> Answer:
    """Return the answer for a batch that no worker survived. The answer records all trials of the
    batch as failed.
    """
    failures = [
        (piece.point, trial, trial_seed(batch.sweep_seed, piece.seeds, trial), why)
        for piece in batch.pieces
        for trial in range(piece.first, piece.stop)
    ]
    return Answer([], failures, 0.0, [], worker_versions(), "")


@dataclass(frozen=True)
class SweepStatus:
    """The progress of a sweep in a store.

    Parameters
    ----------
    name : str
    done, total : int
        ``done`` is the number of finished trials, and ``total`` is the number of all trials.
    failures : int
        Number of failed trials, which ended with an error. The next run of the sweep repeats failed
        trials.
    points : int
    running : bool
        Whether a process on the local machine currently runs the sweep.
    rate : float
        Number of trials per second over the last minute of work, or 0 if no trial finished in this
        minute.
    seconds : float
        Total working time of all workers, in seconds.
    versions : dict
        Number of results that each combination of software versions wrote. `worker_versions`
        explains the versions.
    """

    name: str
    done: int
    total: int
    failures: int
    points: int
    running: bool
    rate: float
    seconds: float
    versions: dict[str, int]

    @property
    def complete(self) -> bool:
        """Whether all trials of the sweep are finished."""
        return self.done == self.total

    @property
    def left(self) -> float | None:
        """Estimated remaining time of the sweep in seconds, or None if the time is unknown."""
        return (self.total - self.done) / self.rate if self.rate else None


@dataclass(frozen=True)
class Gap:
    """A sequence of missing trials of one point of a sweep: trial ``first`` to trial
    ``stop`` - 1.
    """

    point: Point
    id: int
    first: int
    stop: int


@dataclass(frozen=True)
class SweepProgress:
    """The progress of a running sweep.

    Parameters
    ----------
    done, total : int
        ``done`` is the number of finished trials, including the trials of earlier runs. ``total``
        is the number of all trials.
    fresh : int
        Number of trials that the current run has finished.
    failures : int
        Number of trials that failed in the current run.
    deaths : int
        Number of deaths of workers in the current run.
    seconds : float
        Time since the start of the current run, in seconds.
    """

    done: int
    total: int
    fresh: int
    failures: int
    deaths: int
    seconds: float

    @property
    def rate(self) -> float:
        """Mean number of trials per second in the current run."""
        return self.fresh / self.seconds if self.seconds > 0 else 0.0


class MixedVersionsWarning(UserWarning):
    """Warning that other versions of Shoal or its libraries wrote the existing rows of a sweep."""


def worker_versions() -> dict[str, str]:
    """Return the versions on which results of the current process depend, and a digest of Shoal's
    code.
    """
    return versions() | {"code": code_digest()}


def check_versions(theirs: Mapping[str, str], *, worker: str) -> None:
    """Refuse a worker whose versions differ from the versions of the current process."""
    ours = worker_versions()
    wrong = [
        f"{name} {theirs.get(name, 'none')} instead of {ours[name]}"
        for name in ours
        if theirs.get(name) != ours[name]
    ]
    if wrong:
        raise InvalidInputError(
            f"worker {worker}: expected the versions of this process, got {', '.join(wrong)}"
        )


def versions_text(found: Mapping[str, str]) -> str:
    """Return a set of versions as the text that a store contains.

    Examples
    --------
    >>> versions_text({"shoal": "0.1.0", "code": "5f0c"})
    'shoal 0.1.0, code 5f0c'
    """
    return ", ".join(f"{name} {value}" for name, value in found.items())


def parse_versions(text: str) -> dict[str, str]:
    """Return the set of versions that a text in a store describes.

    Examples
    --------
    >>> parse_versions("shoal 0.1.0, code 5f0c")
    {'shoal': '0.1.0', 'code': '5f0c'}
    """
    pairs = [part.partition(" ") for part in text.split(", ")]
    return (
        {name: value for name, _, value in pairs}
        if all(value for _, _, value in pairs)
        else {"shoal": text}
    )


def short_names(texts: Iterable[str]) -> dict[str, str]:
    """Return a short name for each of several sets of versions.

    Each name contains Shoal's version, and the versions of all libraries that differ between the
    sets.

    Examples
    --------
    >>> list(short_names(["shoal 1, code a, numpy 2.1", "shoal 1, code a, numpy 2.2"]).values())
    ['shoal 1, numpy 2.1', 'shoal 1, numpy 2.2']
    """
    all_of = {text: parse_versions(text) for text in texts}
    names = dict.fromkeys(name for found in all_of.values() for name in found)
    kept = [
        name
        for name in names
        if name == "shoal" or len({found.get(name) for found in all_of.values()}) > 1
    ]
    return {
        text: versions_text({name: found.get(name, "unknown") for name in kept})
        for text, found in all_of.items()
    }


def describe_mixture(rows: Mapping[str, int]) -> str:
    """Return a text with the number of rows per set of versions, or an empty text if the current
    versions wrote all rows.

    Examples
    --------
    >>> describe_mixture({versions_text(worker_versions()): 5})
    ''
    >>> describe_mixture({"shoal 0.0.9, code 5f0c": 5, versions_text(worker_versions()): 2}).startswith("5 rows by shoal 0.0.9, code 5f0c")
    True
    """
    ours = versions_text(worker_versions())
    names = short_names([*rows, ours])
    if not any(text != ours for text in rows):
        return ""
    counted = ", ".join(f"{count} rows by {names[text]}" for text, count in rows.items())
    return f"{counted}; this is {names[ours]}"
