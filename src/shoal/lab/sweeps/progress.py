"""How far a sweep is, and what is missing of it."""

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
        Trials.
    failures : int
        Trials that ended with an error; a later run tries them again.
    points : int
    running : bool
        Whether a process on this machine runs it now.
    rate : float
        Trials a second, over the last minute of work; 0 if there was none.
    seconds : float
        Time that all workers together have spent.
    versions : dict
        What wrote the rows -> how many of them; see `shoal.lab.versions`.
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
        """Whether every trial is there."""
        return self.done == self.total

    @property
    def left(self) -> float | None:
        """Seconds until all is done at this rate; None if it is not known."""
        return (self.total - self.done) / self.rate if self.rate else None


@dataclass(frozen=True)
class Gap:
    """Trials of a point that are not there: from ``first`` on, up to but without ``stop``."""

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
        Trials; those done before this run are among them.
    fresh : int
        Trials done by this run.
    failures : int
        Of this run.
    deaths : int
        Workers that died.
    seconds : float
        Since this run began.
    """

    done: int
    total: int
    fresh: int
    failures: int
    deaths: int
    seconds: float

    @property
    def rate(self) -> float:
        """Trials a second in this run."""
        return self.fresh / self.seconds if self.seconds > 0 else 0.0
