"""Tasks: what is known at the start and what counts as done."""

from __future__ import annotations

from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

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
    """The protocol of tasks; `shoal.testing.check_task` tests it.

    ``begin`` returns the belief at the start, ``update`` the belief after one push (see `GridWorld.pushes`). A task is
    complete when the frontier of its belief is empty. Both are pure.
    """

    @property
    def name(self) -> str:
        """Name for summaries and files."""

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Return what the task draws at random from ``rng``, as a mask of the cells of ``workspace``, or None."""

    def begin(self, world: GridWorld, state: SwarmState, targets: NDArray[np.bool_] | None = None) -> Belief:
        """Return the belief before the first command.

        ``world`` moves the particles, ``state`` says where they are, ``targets`` is what `choose_targets` drew.
        """

    def update(self, belief: Belief, command: str, before: Board, after: Board) -> Belief:
        """Return the belief after one push by ``command``, from the positions ``before`` and ``after`` it alone."""


TASKS: Registry[type[Task]] = Registry("task")


@dataclass(frozen=True)
class Mapping:
    """Find every free cell that the particles can reach, and the obstacles around them.

    Only the particles' own cells are known at the start. Source: paper M, section III.B; docs/concepts/belief.md.
    """

    name: ClassVar[str] = "mapping"
    mapping: ClassVar[bool] = True  # how kernels know the built-in tasks

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Return None: a mapping draws nothing."""
        return None

    def begin(self, world: GridWorld, state: SwarmState, targets: NDArray[np.bool_] | None = None) -> Belief:
        """Return the belief in which the occupied cells are free and all others unknown."""
        here = state.occupied
        return Belief(open=here, known=here, frontier=here.dilated() - here)

    def update(self, belief: Belief, command: str, before: Board, after: Board) -> Belief:
        """Classify the cells that particles tried to enter."""
        return belief.observed(command, before, after)


@dataclass(frozen=True)
class Coverage:
    """Let some particle stand in every free cell of a known map.

    Source: paper M, section IV.B; docs/concepts/belief.md.
    """

    name: ClassVar[str] = "coverage"
    mapping: ClassVar[bool] = False

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Return all free cells; nothing is drawn."""
        return workspace.free

    def begin(self, world: GridWorld, state: SwarmState, targets: NDArray[np.bool_] | None = None) -> Belief:
        """Return the belief that knows the map and has each target without a particle as a frontier cell.

        Raises
        ------
        InvalidInputError
            If a target lies where no particle can get to.
        """
        wanted = world.workspace.free if targets is None else targets
        check_reachable(world.workspace, state.occupied.cells, wanted)
        everything = Board.full(world.layout)
        return Belief(open=world.free, known=everything, frontier=Board.of_mask(wanted) - state.occupied)

    def update(self, belief: Belief, command: str, before: Board, after: Board) -> Belief:
        """Take the cells where particles stand now out of the frontier."""
        return belief.covered(after)


@dataclass(frozen=True)
class SubsetCoverage(Coverage):
    """Let some particle stand in every cell of a random subset of the free cells ("foraging" in paper D).

    Parameters
    ----------
    fraction : float
        Share of the free cells, above 0 and at most 1 (at least one cell is drawn). The papers take 0.1.
    """

    name: ClassVar[str] = "subset-coverage"
    fraction: float = 0.1

    def __post_init__(self) -> None:
        if not 0 < self.fraction <= 1:
            raise InvalidInputError(f"subset: expected a share above 0 and at most 1, got {self.fraction:g}")

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Draw the subset without replacement."""
        size = max(1, round(self.fraction * workspace.n_free))
        chosen = workspace.cells[rng.choice(workspace.n_free, size=size, replace=False)]
        targets = np.zeros(workspace.shape, dtype=np.bool_)
        targets[tuple(chosen.T)] = True
        return targets


for _task in (Mapping, Coverage, SubsetCoverage):
    TASKS.add(_task.name, _task)


def check_reachable(workspace: GridWorkspace, start: NDArray[np.int64], targets: NDArray[np.bool_]) -> None:
    """Refuse targets in a part of the free space that holds none of the start cells, shape (n, ndim)."""
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
            "(use more particles or the largest component only)"
        )


def make_task(task: str | Task) -> Task:
    """Return a task by name ("mapping", "subset-coverage:fraction=0.2", "module:attribute") or the given one."""
    made = configured(TASKS, task) if isinstance(task, str) else task
    if not isinstance(made, Task):
        raise InvalidInputError(f"task: expected an object with name, choose_targets, begin and update, got {made!r}")
    return made
