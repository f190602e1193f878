"""Tasks. A task defines the belief at the start, the update of the belief after each push, and the criterion for completion."""

from __future__ import annotations

from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.registry import Registry, configured
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.maps.workspace import GridWorkspace


@runtime_checkable
class Task(Protocol):
    """The interface of tasks. `shoal.testing.check_task` tests whether a task follows the interface.

    The method ``begin`` returns the belief at the start of the episode. The method ``update`` returns the belief after one push, in
    which all particles try to move by one cell. A task is complete when the frontier of its belief is empty. The methods ``begin``
    and ``update`` must not change their arguments.
    """

    @property
    def name(self) -> str:
        """Name of the task, as written in summaries and files."""

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Return a mask of random target cells, drawn with ``rng``. Return None if the task has no target cells."""

    def begin(self, world: GridWorld, state: SwarmState, targets: NDArray[np.bool_] | None = None) -> Belief:
        """Return the belief before the first command.

        ``world`` defines the motion of the particles, ``state`` holds the particles' cells, and ``targets`` is the result of
        `choose_targets`.
        """

    def update(self, belief: Belief, command: str, before: Board, after: Board) -> Belief:
        """Return the belief after one push of all particles in the direction of ``command``.

        ``belief`` is the belief before the push. ``before`` and ``after`` are the cells that hold particles before and after the
        push.
        """


TASKS: Registry[type[Task]] = Registry("task")


@dataclass(frozen=True)
class Mapping:
    """The task of finding every free cell that particles can reach, and the obstacles beside the reachable cells.

    At the start of a mapping, all cells are unknown except the cells that hold particles. Sources: paper M, section III.B, and
    docs/concepts/belief.md.
    """

    name: ClassVar[str] = "mapping"
    mapping: ClassVar[bool] = True  # code of the built-in tasks in kernels

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Return None, because a mapping has no target cells."""
        return None

    def begin(self, world: GridWorld, state: SwarmState, targets: NDArray[np.bool_] | None = None) -> Belief:
        """Return the belief at the start of a mapping: cells with particles are free, and all other cells are unknown."""
        here = state.occupied
        return Belief(open=here, known=here, frontier=here.dilated() - here)

    def update(self, belief: Belief, command: str, before: Board, after: Board) -> Belief:
        """Return the belief after one push. All cells that particles tried to enter are classified."""
        return belief.observed(command, before, after)


@dataclass(frozen=True)
class Coverage:
    """The task of visiting every free cell of a known map with at least one particle.

    Sources: paper M, section IV.B, and docs/concepts/belief.md.
    """

    name: ClassVar[str] = "coverage"
    mapping: ClassVar[bool] = False

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Return the mask of all free cells as targets, without a random choice."""
        return workspace.free

    def begin(self, world: GridWorld, state: SwarmState, targets: NDArray[np.bool_] | None = None) -> Belief:
        """Return the belief at the start of a coverage.

        All cells are known. The frontier cells are the target cells without a particle.

        Raises
        ------
        InvalidInputError
            Raised if a target cell is out of reach of all particles.
        """
        wanted = world.workspace.free if targets is None else targets
        check_reachable(world.workspace, state.occupied.cells, wanted)
        everything = Board.full(world.layout)
        return Belief(open=world.free, known=everything, frontier=Board.of_mask(wanted) - state.occupied)

    def update(self, belief: Belief, command: str, before: Board, after: Board) -> Belief:
        """Return the belief after one push. Cells that hold a particle after the push leave the frontier."""
        return belief.covered(after)


@dataclass(frozen=True)
class SubsetCoverage(Coverage):
    """The task of visiting every cell of a random subset of the free cells. Paper D calls this task "foraging".

    Parameters
    ----------
    fraction : float
        Fraction of the free cells that particles must visit, above 0 and at most 1. The random subset contains at least one cell.
        The papers use the fraction 0.1.
    """

    name: ClassVar[str] = "subset-coverage"
    fraction: float = 0.1

    def __post_init__(self) -> None:
        check_number(self.fraction, what="subset", above=0, most=1)

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Draw a random subset of the free cells without replacement."""
        size = max(1, round(self.fraction * workspace.n_free))
        chosen = workspace.cells[rng.choice(workspace.n_free, size=size, replace=False)]
        targets = np.zeros(workspace.shape, dtype=np.bool_)
        targets[tuple(chosen.T)] = True
        return targets


for _task in (Mapping, Coverage, SubsetCoverage):
    TASKS.add(_task.name, _task)


def check_reachable(workspace: GridWorkspace, start: NDArray[np.int64], targets: NDArray[np.bool_]) -> None:
    """Refuse target cells that are not connected to any start cell. ``start`` has shape (n, ndim)."""
    if targets.shape != workspace.shape:
        raise InvalidInputError(f"targets: expected a mask of shape {workspace.shape}, got {targets.shape}")
    if (targets & ~workspace.free).any():
        cell = tuple(int(i) for i in np.argwhere(targets & ~workspace.free)[0])
        raise InvalidInputError(f"targets: expected free cells, got the obstacle {cell}")
    labels = workspace.components
    reached = np.zeros(int(labels.max()) + 1, dtype=np.bool_)
    reached[labels[tuple(start.T)]] = True
    lost = targets & ~reached[labels]
    if lost.any():
        cell = tuple(int(i) for i in np.argwhere(lost)[0])
        raise InvalidInputError(
            f"coverage: expected a particle in every connected part of {workspace.name} with cells to cover, got none in a part "
            f"with {np.count_nonzero(lost & (labels == labels[cell]))} of them, at {cell} "
            "(use more particles, or only the largest component of the map)"
        )


def make_task(task: str | Task) -> Task:
    """Return the task object for a name such as "mapping" or "subset-coverage:fraction=0.2". Return a given object unchanged."""
    made = configured(TASKS, task) if isinstance(task, str) else task
    if not isinstance(made, Task):
        raise InvalidInputError(f"task: expected an object with name, choose_targets, begin and update, got {made!r}")
    return made
