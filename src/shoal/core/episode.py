"""The base class of all episodes: problem, status, reason, metrics, replay and verification."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from enum import StrEnum
from importlib import import_module
from typing import Any, ClassVar, Self

from shoal.core.dataclass import dataclass


class Status(StrEnum):
    """How an episode ended. The property `done` is true only for ``complete`` and ``solved``."""

    COMPLETE = "complete"
    """All cells that robots or particles can reach were mapped, covered or searched."""
    SOLVED = "solved"
    """Steering: every particle is within the tolerance of its goal."""
    STALLED = "stalled"
    """The policy could make no more progress."""
    LIMIT = "limit"
    """The episode reached its maximum number of moves."""
    INTERRUPTED = "interrupted"
    """The user or a signal stopped the episode."""
    UNREACHABLE = "unreachable"
    """Steering: no sequence of moves leads to the goals."""
    APPROACHABLE = "approachable"
    """Steering: moves can come arbitrarily close to the goals but not reach them. This plan ends outside the tolerance."""
    INCOMPLETE = "incomplete"
    """Search: some cell was never searched, or a working robot does not know that all cells were searched."""

    @property
    def done(self) -> bool:
        """Return whether the task is done."""
        return self in (Status.COMPLETE, Status.SOLVED)


@dataclass(frozen=True)
class Verification:
    """The result of `Episode.verify`. ``bool(verification)`` is true if the replay gave the same episode.

    Parameters
    ----------
    ok : bool
    message : str
        Summary of the checks, or the first difference between the episode and its replay.
    """

    ok: bool
    message: str

    def __bool__(self) -> bool:
        return self.ok


class Episode(ABC):
    """One run of a problem. ``bool(episode)`` is true if its task was done.

    Each part (swarm, steering, search) adds attributes of its own. Every episode has these attributes:

    - ``problem``: the `Problem` that was run, as the user declared it.
    - ``status``: a `Status`.
    - ``seed``: int; the same problem and seed give the same episode.
    - ``seconds``: float; computing time in seconds, without the time for compiling kernels.
    - ``versions``: the versions of Shoal and its libraries, see `shoal.core.version.versions`.
    """

    part: ClassVar[str]
    """The part's name: "swarm", "steering" or "search"."""

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
        """Return one sentence that explains the status."""

    @property
    @abstractmethod
    def metrics(self) -> dict[str, Any]:
        """Return the metrics by name: all measures that sweeps store, and further numbers about the result.

        Values are numbers, texts or None.
        """

    @abstractmethod
    def report(self) -> dict[str, Any]:
        """Return the JSON object that the command prints with ``--json``."""

    @abstractmethod
    def verify(self) -> Verification:
        """Replay the episode from its problem and its commands, and compare every stored value."""

    @abstractmethod
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the episode to a file, from which `load` reads it again. A failed write leaves no partial file."""

    @classmethod
    @abstractmethod
    def load(cls, path: str | os.PathLike[str], *, trust: bool = False) -> Self:
        """Read an episode that `save` wrote. An episode that needs third-party code is refused unless ``trust`` is true."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.sentence}>"

    def _repr_html_(self) -> str:
        """Return the HTML that a notebook shows. Only this method imports the views, because they are a higher layer."""
        shown: str = import_module("shoal.views").notebook_page(self)
        return shown

    @property
    def sentence(self) -> str:
        """Return one sentence that contains the status and the reason."""
        return f"{self.status}: {self.reason}"
