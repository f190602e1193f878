"""What a policy is: its view of the swarm, and its decision."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.board import Board
from shoal.swarm.grid.state import Belief

if TYPE_CHECKING:
    from numpy.random import Generator

Decision = tuple[str, Any]
"""The result of one decision of a policy: commands, and the policy's memory for its
next decision.
"""


@dataclass(frozen=True)
class View:
    """All information that a policy may use for a decision.

    Each cell is a tuple of indices: (row, column) in two dimensions, and (layer, row, column) in
    three dimensions. Row 0 is on top.

    Parameters
    ----------
    belief : Belief
        The belief of the task. The belief's frontier contains the cells that the particles must
        still classify or cover.
    occupied : Board
        The cells that hold particles at the time of the decision.
    rule : str
        The move rule: "block", "merge" or "tilt".
    mapping : bool
        True for a mapping, whose frontier cells are unknown. False for a coverage, whose frontier
        cells are known to be free.
    moves : int
        Number of commands sent since the start of the episode.
    travelled : int
        Distance that all particles together travelled during the last command or the last run of
        equal commands, in cells.
    classified : int
        Number of frontier cells that the last command or the last run of equal commands classified.
    targets : Board or None
        The target cells of the task, such as the region of a gathering, if it has any.
    """

    belief: Belief
    occupied: Board
    rule: str = "block"
    mapping: bool = True
    moves: int = 0
    travelled: int = 0
    classified: int = 0
    targets: Board | None = None


@runtime_checkable
class Policy(Protocol):
    """The interface of policies. `shoal.testing.check_policy` tests whether a policy follows the
    interface.

    ``decide(view, memory, rng)`` returns ``(commands, memory)``. Shoal sends all returned commands
    before the next decision, unless the task is complete earlier. If the policy can make no
    progress, ``commands`` is an empty text. ``memory`` is None at the first decision of an episode.
    A policy object never changes, so that one policy object can serve many episodes.

    A policy of the task gathering has the attribute ``gathers = True``, and a policy that cannot
    gather has ``gathers = False``; policies without the attribute may serve all tasks.

    A policy may have the attributes ``rules`` and ``dimensions``, such as ``rules = ("block",)``
    and ``dimensions = (2,)``. They state the move rules and the numbers of dimensions that the
    policy supports. Shoal refuses a problem with another move rule or another number of dimensions.
    A policy without these attributes supports all move rules, and two and three dimensions.
    """

    @property
    def name(self) -> str:
        """Name of the policy with its options, as written in summaries and files."""

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next commands, and the policy's memory for its next decision."""
