"""The interface of policies: a policy sees the belief and returns commands."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board

Decision = tuple[str, Any]
"""Commands, and the memory for the next decision."""


@dataclass(frozen=True)
class View:
    """All information that a policy may use for a decision.

    Parameters
    ----------
    belief : Belief
        The belief of the task. The frontier of the belief contains the cells that must still be classified or covered.
    occupied : Board
        The cells that hold particles now.
    rule : str
        The move rule.
    mapping : bool
        True for mapping, in which frontier cells are unknown. False for coverage, in which frontier cells are known to be free.
    moves : int
        Number of commands sent so far.
    travelled : int
        Distance that all particles together travelled during the last command, in cells.
    classified : int
        Number of frontier cells that the last command classified.
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
    """The interface of policies. `shoal.testing.check_policy` tests it.

    ``decide(view, memory, rng)`` returns ``(commands, memory)``. All commands are sent before the next decision, unless the task is
    complete earlier. If the policy can make no progress, ``commands`` is an empty text. The memory is None at the first decision. A
    policy object never changes. Therefore one object can serve many episodes.
    """

    @property
    def name(self) -> str:
        """Name of the policy with its options, for summaries and files."""

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next commands and the memory for the next decision."""
