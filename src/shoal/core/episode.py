"""The base class of all episodes: problem, status, reason, metrics, replay and verification."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, ClassVar, Self

from shoal.core.dataclass import dataclass
from shoal.core.display import displayed


class Status(StrEnum):
    """The way in which an episode ended. The property `done` is true only for the statuses
    ``complete``, ``solved`` and ``arrived``.
    """

    COMPLETE = "complete"
    """Swarm and search: the particles or robots mapped, covered or searched all cells that they can
    reach.
    """
    SOLVED = "solved"
    """Steering: every particle is within the tolerance of its goal."""
    ARRIVED = "arrived"
    """Steering of a rig: a look has shown every particle within the tolerance of its goal."""
    SLIPPING = "slipping"
    """Steering of a rig: the walls slip more than was stated, and the particles did not arrive."""
    STALLED = "stalled"
    """The policy could make no more progress."""
    LIMIT = "limit"
    """The episode reached its maximum number of moves."""
    INTERRUPTED = "interrupted"
    """The user, or a signal to the process, stopped the episode."""
    ALARM = "alarm"
    """Swarm on a rig: the rig contradicted the commands, or no particle was ever seen to move."""
    UNREACHABLE = "unreachable"
    """Steering: no sequence of moves leads to the goals."""
    APPROACHABLE = "approachable"
    """Steering: moves can bring the particles arbitrarily close to their goals, but the plan ends
    outside the tolerance.
    """
    SENSITIVE = "sensitive"
    """Steering: the plan reaches the goals, but only in exact arithmetic; a slightly larger contact
    tolerance makes it miss.
    """
    INCOMPLETE = "incomplete"
    """Search: at least one cell was not searched, or a working robot does not know that the search
    is complete.
    """

    @property
    def done(self) -> bool:
        """Return whether the status means that the task is done."""
        return self in (Status.COMPLETE, Status.SOLVED, Status.ARRIVED)


@dataclass(frozen=True)
class Verification:
    """The result of `Episode.verify`. ``bool(verification)`` is true if the replay agrees with the
    episode.

    Parameters
    ----------
    ok : bool
    message : str
        Summary of the comparison, or the first difference between the episode and its replay.
    """

    ok: bool
    message: str

    def __bool__(self) -> bool:
        return self.ok


class Episode(ABC):
    """One run of a problem. ``bool(episode)`` is true if the task of the episode was done.

    Each part (swarm, steering, search) adds attributes of its own. Episodes of all parts have the
    following attributes:

    - ``problem``: the `Problem` of the run, as the user declared it.
    - ``status``: a `Status`.
    - ``seed``: int; equal problems with equal seeds give equal episodes.
    - ``seconds``: float; computing time of the run in seconds, without the time for compiling
      kernels.
    - ``versions``: the versions of Shoal and its libraries, as `shoal.core.version.versions`
      returned them.
    """

    part: ClassVar[str]
    """The name of the episode's part: "swarm", "steering" or "search"."""

    problem: Any
    status: Status
    seed: int
    seconds: float
    versions: Mapping[str, str]

    def __bool__(self) -> bool:
        return self.status.done

    @property
    @abstractmethod
    def reason(self) -> str:
        """Return one sentence that explains the status of the episode."""

    @property
    @abstractmethod
    def metrics(self) -> dict[str, Any]:
        """Return the metrics of the episode by name: all measures that sweeps store, and other
        numbers about the result.

        The value of a metric is a number, a text or None.
        """

    @abstractmethod
    def report(self) -> dict[str, Any]:
        """Return the JSON object that Shoal's commands print for an episode with the option
        ``--json``.
        """

    @abstractmethod
    def verify(self) -> Verification:
        """Replay the episode from its problem and commands, and compare the replay with every
        stored value of the episode.
        """

    @abstractmethod
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the episode to a file that `load` can read. A failed write leaves no
        partial file.
        """

    @classmethod
    @abstractmethod
    def load(cls, path: str | os.PathLike[str], *, trust: bool = False) -> Self:
        """Read an episode that `save` wrote. If ``trust`` is false, refuse an episode that needs
        third-party code.
        """

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.sentence}>"

    def _repr_html_(self) -> object:
        """Return the HTML code that a notebook shows for the episode."""
        return displayed("html", self)

    @property
    def sentence(self) -> str:
        """Return one sentence with the status of the episode and the reason for the status."""
        return f"{self.status}: {self.reason}"
