"""What every episode has, whatever the part: a problem, a status with its reason, numbers, and a proof that it holds."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from enum import StrEnum
from importlib import import_module
from typing import Any, ClassVar, Self

from shoal.core.dataclass import dataclass


class Status(StrEnum):
    """How an episode ended. An episode is true as a bool only if its task is done: ``complete`` or ``solved``."""

    COMPLETE = "complete"
    """All that can be reached was mapped, covered or searched."""
    SOLVED = "solved"
    """Steering: every particle is within the tolerance of its goal."""
    STALLED = "stalled"
    """The policy could make no more progress."""
    LIMIT = "limit"
    """The limit of moves was reached first."""
    INTERRUPTED = "interrupted"
    """Somebody stopped it."""
    UNREACHABLE = "unreachable"
    """Steering: no sequence of moves leads to the goals."""
    APPROACHABLE = "approachable"
    """Steering: moves come as near to the goals as one likes, and never there; this plan is not within the tolerance."""
    INCOMPLETE = "incomplete"
    """Search: some cell was never searched, or a robot that lives does not know that all were."""

    @property
    def done(self) -> bool:
        """Whether the task is done."""
        return self in (Status.COMPLETE, Status.SOLVED)


@dataclass(frozen=True)
class Verification:
    """The answer of `Episode.verify`; true as a bool if the episode holds.

    Parameters
    ----------
    ok : bool
    message : str
        What was checked, or the first difference.
    """

    ok: bool
    message: str

    def __bool__(self) -> bool:
        return self.ok


class Episode(ABC):
    """One run of a problem. True as a bool if its task is done.

    Every episode has these attributes, besides those of its part:

    - ``problem``: the `Problem` that was run, as it was asked for.
    - ``status``: a `Status`.
    - ``seed``: int; the same problem and seed give the same episode.
    - ``seconds``: float; the time that it took, without compilation.
    - ``versions``: what it was computed with, as `shoal.core.version.versions` says.
    """

    part: ClassVar[str]
    """"swarm", "steering" or "search"."""

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
        """Why the episode has its status, in one sentence."""

    @property
    @abstractmethod
    def metrics(self) -> dict[str, Any]:
        """The numbers by name: those that sweeps store, and more. Numbers, texts or None."""

    @abstractmethod
    def report(self) -> dict[str, Any]:
        """Return the JSON object that the command prints."""

    @abstractmethod
    def verify(self) -> Verification:
        """Play the episode again from its problem and its commands; compare everything."""

    @abstractmethod
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the episode to a file, whole or not at all."""

    @classmethod
    @abstractmethod
    def load(cls, path: str | os.PathLike[str], *, trust: bool = False) -> Self:
        """Read an episode that `save` wrote; refuse one whose replay runs somebody's code, unless ``trust`` is true."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.sentence}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows; views lie above episodes and are loaded only here."""
        shown: str = import_module("shoal.views").notebook_page(self)
        return shown

    @property
    def sentence(self) -> str:
        """Status and reason for people."""
        return f"{self.status}: {self.reason}"
