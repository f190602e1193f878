"""The progress of a sweep, and its missing trials."""

from __future__ import annotations

from shoal.core.dataclass import dataclass
from shoal.lab.sweeps.sweep import Point


@dataclass(frozen=True)
class SweepStatus:
    """Progress of a sweep in a store.

    Parameters
    ----------
    name : str
    done, total : int
        Number of finished trials, and of all trials.
    failures : int
        Number of trials that ended with an error. A later run tries them again.
    points : int
    running : bool
        Whether a process on this machine currently runs the sweep.
    rate : float
        Trials per second over the last minute of work, or 0 without work.
    seconds : float
        Total time in seconds that all workers spent.
    versions : dict
        Number of rows for each combination of versions; see `shoal.lab.versions`.
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
        """Whether all trials are finished."""
        return self.done == self.total

    @property
    def left(self) -> float | None:
        """Estimated remaining time in seconds, or None if unknown."""
        return (self.total - self.done) / self.rate if self.rate else None


@dataclass(frozen=True)
class Gap:
    """A sequence of missing trials of one point, from ``first`` up to but not including ``stop``."""

    point: Point
    id: int
    first: int
    stop: int


@dataclass(frozen=True)
class SweepProgress:
    """Progress of a running sweep.

    Parameters
    ----------
    done, total : int
        Number of finished trials, including those of earlier runs, and number of all trials.
    fresh : int
        Number of trials finished by this run.
    failures : int
        Number of failed trials in this run.
    deaths : int
        Number of workers that died.
    seconds : float
        Seconds since the start of this run.
    """

    done: int
    total: int
    fresh: int
    failures: int
    deaths: int
    seconds: float

    @property
    def rate(self) -> float:
        """Number of trials that this run finishes per second."""
        return self.fresh / self.seconds if self.seconds > 0 else 0.0
