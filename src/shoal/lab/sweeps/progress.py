"""The progress of a sweep, and the missing trials of a sweep."""

from __future__ import annotations

from shoal.core.dataclass import dataclass
from shoal.lab.sweeps.sweep import Point


@dataclass(frozen=True)
class SweepStatus:
    """The progress of a sweep in a store.

    Parameters
    ----------
    name : str
    done, total : int
        ``done`` is the number of finished trials, and ``total`` is the number of all trials.
    failures : int
        Number of failed trials, which ended with an error. The next run of the sweep repeats failed trials.
    points : int
    running : bool
        Whether a process on the local machine currently runs the sweep.
    rate : float
        Number of trials per second over the last minute of work, or 0 if no trial finished in this minute.
    seconds : float
        Total working time of all workers, in seconds.
    versions : dict
        Number of results that each combination of software versions wrote. `shoal.lab.versions` explains the versions.
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
    """A sequence of missing trials of one point of a sweep: trial ``first`` to trial ``stop`` - 1."""

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
        ``done`` is the number of finished trials, including the trials of earlier runs. ``total`` is the number of all trials.
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
