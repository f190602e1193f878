"""What a policy is: it sees what is known and answers with commands."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board

Decision = tuple[str, Any]
"""Commands, and the memory to hand to the next decision."""


@dataclass(frozen=True)
class View:
    """The view of a policy: everything that it may see.

    Parameters
    ----------
    belief : Belief
        What is known; its frontier is what is left to do.
    occupied : Board
        The cells that hold particles now.
    rule : str
        The move rule.
    mapping : bool
        Whether frontier cells are unknown (mapping) or known to be free (coverage).
    moves : int
        Commands sent so far.
    travelled : int
        Cells travelled by all particles at the last command.
    classified : int
        Frontier cells that the last command classified.
    """

    belief: Belief
    occupied: Board
    rule: str = "block"
    mapping: bool = True
    moves: int = 0
    travelled: int = 0
    classified: int = 0


@runtime_checkable
class Policy(Protocol):
    """The protocol of policies; `shoal.testing.check_policy` tests it.

    ``decide(view, memory, rng)`` returns ``(commands, memory)``: the commands are all sent before it is asked again (fewer if the
    task is complete before); "" says that the policy can make no progress. Memory is None at the first decision; a policy
    object itself never changes, so that one object can play many episodes.
    """

    @property
    def name(self) -> str:
        """Name for summaries and files, with its options."""

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next commands and the memory for the next decision."""
