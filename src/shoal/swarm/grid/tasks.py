"""Tasks and placements: what a swarm is to do, and where its particles start."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer, check_kind, check_number, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, errors_at
from shoal.core.registry import Registry, configured
from shoal.swarm.grid.board import Board, GridLayout, offsets_of
from shoal.swarm.grid.state import Belief, SwarmState, check_cells
from shoal.swarm.grid.world import GridWorld, check_start
from shoal.swarm.maps.workspace import GridWorkspace

if TYPE_CHECKING:
    from numpy.random import Generator


@runtime_checkable
class Task(Protocol):
    """The interface of tasks. `shoal.testing.check_task` tests whether a task follows the
    interface.

    The method ``begin`` returns the belief at the start of the episode. The method ``update``
    returns the belief after one push, in which all particles try to move by one cell. A task is
    complete when the frontier of its belief is empty. The methods ``begin`` and ``update`` must not
    change their arguments.
    """

    @property
    def name(self) -> str:
        """Name of the task, as written in summaries and files."""

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Return a mask of random target cells, drawn with ``rng``. Return None if the task has no
        target cells.
        """

    def begin(
        self, world: GridWorld, state: SwarmState, targets: NDArray[np.bool_] | None = None
    ) -> Belief:
        """Return the belief before the first command.

        ``world`` defines the motion of the particles, ``state`` holds the particles' cells, and
        ``targets`` is the result of `choose_targets`.
        """

    def update(self, belief: Belief, command: str, before: Board, after: Board) -> Belief:
        """Return the belief after one push of all particles in the direction of ``command``.

        ``belief`` is the belief before the push. ``before`` and ``after`` are the cells that hold
        particles before and after the push.
        """


TASKS: Registry[type[Task]] = Registry("task")


@dataclass(frozen=True)
class Mapping:
    """The task of finding every free cell that particles can reach, and the obstacles beside the
    reachable cells.

    At the start of a mapping, all cells are unknown except the cells that hold particles. Sources:
    paper M, section III.B, and docs/concepts/belief.md.
    """

    name: ClassVar[str] = "mapping"
    mapping: ClassVar[bool] = True  # code of the built-in tasks in kernels

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Return None, because a mapping has no target cells."""
        return None

    def begin(
        self, world: GridWorld, state: SwarmState, targets: NDArray[np.bool_] | None = None
    ) -> Belief:
        """Return the belief at the start of a mapping: cells with particles are free, and all other
        cells are unknown.
        """
        occupied = state.occupied
        return Belief(open=occupied, known=occupied, frontier=occupied.dilated() - occupied)

    def update(self, belief: Belief, command: str, before: Board, after: Board) -> Belief:
        """Return the belief after one push. All cells that particles tried to enter are
        classified.
        """
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

    def begin(
        self, world: GridWorld, state: SwarmState, targets: NDArray[np.bool_] | None = None
    ) -> Belief:
        """Return the belief at the start of a coverage.

        All cells are known. The frontier cells are the target cells without a particle.

        Raises
        ------
        InvalidInputError
            Raised if a target cell is out of reach of all particles.
        """
        required = world.workspace.free if targets is None else targets
        check_reachable(world.workspace, state.occupied.cells, required)
        everything = Board.full(world.layout)
        return Belief(
            open=world.free, known=everything, frontier=Board.of_mask(required) - state.occupied
        )

    def update(self, belief: Belief, command: str, before: Board, after: Board) -> Belief:
        """Return the belief after one push. Cells that hold a particle after the push leave the
        frontier.
        """
        return belief.covered(after)


@dataclass(frozen=True)
class SubsetCoverage(Coverage):
    """The task of visiting every cell of a random subset of the free cells. Paper D calls this task
    "foraging".

    Parameters
    ----------
    fraction : float
        Fraction of the free cells that particles must visit, above 0 and at most 1. The random
        subset contains at least one cell. The papers use the fraction 0.1.
    """

    name: ClassVar[str] = "subset-coverage"
    fraction: float = 0.1

    def __post_init__(self) -> None:
        check_number(self.fraction, what="subset", above=0, most=1)

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Draw a random subset of the free cells without replacement."""
        size = max(1, round(self.fraction * workspace.n_free))
        cells = workspace.cells[rng.choice(workspace.n_free, size=size, replace=False)]
        targets = np.zeros(workspace.shape, dtype=np.bool_)
        targets[tuple(cells.T)] = True
        return targets


@dataclass(frozen=True)
class Target(Coverage):
    """The task of bringing a particle to each of a few given cells of a known map.

    The particles need not be in the cells at the same time: a cell counts from the moment at which
    a particle is in it.

    Parameters
    ----------
    cells : tuple of tuple of int
        The target cells.
    """

    name: ClassVar[str] = "target"
    cells: tuple[tuple[int, ...], ...] = ()

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Return the mask of the target cells, without a random choice.

        Raises
        ------
        InvalidInputError
            Raised if there are no target cells, or if one is not a free cell of the workspace.
        """
        return _mask_of(self.cells, workspace, "target")


@dataclass(frozen=True)
class Gathering:
    """The task of bringing all particles together on a known map: into one cell under the rule
    merge, or into the cells of a region.

    The particles must be together at the same time. The frontier cells are the cells with particles
    that are not gathered yet: those outside the region, or without a region all but one. Sources:
    Becker and others (2020), and docs/concepts/gathering.md.

    Parameters
    ----------
    region : tuple of tuple of int
        The cells of the region. Without cells, the particles may gather in any cell.
    """

    name: ClassVar[str] = "gathering"
    mapping: ClassVar[bool] = False
    region: tuple[tuple[int, ...], ...] = ()

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Return the mask of the region, without a random choice, or None without a region.

        Raises
        ------
        InvalidInputError
            Raised if a cell of the region is not a free cell of the workspace.
        """
        return _mask_of(self.region, workspace, "region") if self.region else None

    def begin(
        self, world: GridWorld, state: SwarmState, targets: NDArray[np.bool_] | None = None
    ) -> Belief:
        """Return the belief at the start of a gathering. All cells are known.

        Raises
        ------
        InvalidInputError
            Raised if the particles cannot be gathered: if they are in several parts of the
            workspace, or if a part has too few cells of the region for the particles in it.
        """
        self.check(world.workspace, state.cells, world.rule)
        everything = Board.full(world.layout)
        return Belief(open=world.free, known=everything, frontier=self._left(state.occupied))

    def check(self, workspace: GridWorkspace, start: NDArray[np.int64], rule: str) -> None:
        """Refuse start cells (int64, shape (n, ndim)) from which particles cannot be gathered."""
        labels = workspace.components
        parts = np.bincount(labels[tuple(start.T)])
        if not self.region:
            if rule != "merge":
                raise InvalidInputError(
                    f"region: expected a region of at least {len(start)} cells, the number of"
                    f" particles, because particles share no cell under rule {rule}, got none"
                )
            if np.count_nonzero(parts) > 1:
                raise InvalidInputError(
                    f"gathering: expected all particles in one connected part of {workspace.name},"
                    f" got particles in {np.count_nonzero(parts)} parts (keep only the largest"
                    " component of the map)"
                )
            return
        region = _mask_of(self.region, workspace, "region")
        capacity = np.bincount(labels[region], minlength=parts.size)[: parts.size]
        needed = np.minimum(parts, 1) if rule == "merge" else parts
        if (capacity < needed).any():
            component = int(np.argmax(capacity < needed))
            cell = tuple(start[labels[tuple(start.T)] == component][0].tolist())
            raise InvalidInputError(
                f"region: expected at least {needed[component]} of its cells in the connected part"
                f" of {workspace.name} with the particle at {cell}, for the {parts[component]}"
                f" particles there under rule {rule}, got {capacity[component]}"
            )

    def update(self, belief: Belief, command: str, before: Board, after: Board) -> Belief:
        """Return the belief after one push."""
        return Belief(belief.open, belief.known, self._left(after))

    def _left(self, occupied: Board) -> Board:
        if self.region:
            return occupied - _board_of(occupied.layout, self.region)
        return Board.of_cells(occupied.layout, occupied.cells[1:])


@lru_cache(maxsize=4)
def _board_of(layout: GridLayout, cells: tuple[tuple[int, ...], ...]) -> Board:
    return Board.of_cells(layout, cells)


def _mask_of(
    cells: tuple[tuple[int, ...], ...], workspace: GridWorkspace, what: str
) -> NDArray[np.bool_]:
    """Return the mask of given cells of a workspace, which must be free."""
    indices = check_cells(cells, workspace.shape, what=what, rim=0)
    if not len(indices):
        raise InvalidInputError(f"{what}: expected at least one cell, got none")
    blocked = ~workspace.free[tuple(indices.T)]
    if blocked.any():
        cell = tuple(indices[blocked][0].tolist())
        raise InvalidInputError(
            f"{what}: expected free cells of {workspace.name}, got the obstacle {cell}"
            " (rows and columns count from 0)"
        )
    mask = np.zeros(workspace.shape, dtype=np.bool_)
    mask[tuple(indices.T)] = True
    return mask


for _task in (Mapping, Coverage, SubsetCoverage, Target, Gathering):
    TASKS.add(_task.name, _task)


def check_reachable(
    workspace: GridWorkspace, start: NDArray[np.int64], targets: NDArray[np.bool_]
) -> None:
    """Refuse target cells that are not connected to any start cell. ``start`` has shape
    (n, ndim).
    """
    if targets.shape != workspace.shape:
        raise InvalidInputError(
            f"targets: expected a mask of shape {workspace.shape}, got {targets.shape}"
        )
    if (targets & ~workspace.free).any():
        cell = tuple(int(i) for i in np.argwhere(targets & ~workspace.free)[0])
        raise InvalidInputError(f"targets: expected free cells, got the obstacle {cell}")
    labels = workspace.components
    reached = np.zeros(int(labels.max()) + 1, dtype=np.bool_)
    reached[labels[tuple(start.T)]] = True
    isolated = targets & ~reached[labels]
    if isolated.any():
        cell = tuple(int(i) for i in np.argwhere(isolated)[0])
        raise InvalidInputError(
            f"coverage: expected a particle in every connected part of {workspace.name} with cells"
            " to cover, got none in a part with"
            f" {np.count_nonzero(isolated & (labels == labels[cell]))} of them, at {cell} (use more"
            " particles, or only the largest component of the map)"
        )


def make_task(task: str | Task) -> Task:
    """Return the task object for a name such as "mapping" or "subset-coverage:fraction=0.2". Return
    a given object unchanged.
    """
    instance = configured(TASKS, task) if isinstance(task, str) else task
    if not isinstance(instance, Task):
        raise InvalidInputError(
            "task: expected an object with name, choose_targets, begin and update, got"
            f" {instance!r}"
        )
    return instance


Placement = Callable[[GridWorkspace, int, "Generator"], NDArray[np.int64]]
PLACEMENTS: Registry[Placement] = Registry("placement", functions=True)


def place(
    workspace: GridWorkspace, n: int, placement: str | Placement, rng: Generator
) -> NDArray[np.int64]:
    """Return the start cells of ``n`` particles.

    Parameters
    ----------
    workspace : GridWorkspace
    n : int
        Number of particles, from 1 to ``workspace.n_free``.
    placement : str or callable
        The placement rule: "uniform", "flood-fill", "region-fill", "left-wall", the name of a
        function in the form "module:attribute", or a function. A placement function is called with
        (workspace, n, rng) and returns the start cells.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray of int64, shape (n, ndim)
        The start cells: distinct free cells in row-major order.

    Raises
    ------
    InvalidInputError
        Raised if the workspace has fewer than ``n`` free cells, or if the placement chooses a part
        of the workspace with fewer than ``n`` free cells.

    Examples
    --------
    >>> workspace = GridWorkspace([[1, 1, 0, 1]])
    >>> place(workspace, 3, "uniform", np.random.default_rng(1)).tolist()
    [[0, 0], [0, 1], [0, 3]]
    """
    check_kind(workspace, GridWorkspace, what="workspace")
    check_integer(n, what="particles")
    check_kind(rng, np.random.Generator, what="rng")
    if not 1 <= n <= workspace.n_free:
        raise InvalidInputError(
            f"particles: expected 1 to {workspace.n_free} (the free cells of {workspace.name}),"
            f" got {n}"
        )
    function = make_placement(placement)
    try:
        cells = function(workspace, n, rng)
    except TypeError:
        if _takes(function, workspace, n, rng):
            raise
        raise _no_placement(function) from None
    with errors_at(f"placement {_name(placement)}"):
        checked = check_start(workspace, cells)
    if len(checked) != n:
        raise InvalidInputError(
            f"placement {_name(placement)}: expected {n} cells, got {len(checked)}"
        )
    return checked


def make_placement(placement: str | Placement) -> Placement:
    """Return the placement function for a name. Return a given function unchanged. Other arguments
    raise InvalidInputError.
    """
    function: Placement = (
        configured(PLACEMENTS, placement) if isinstance(placement, str) else placement
    )
    if not callable(function):
        raise _no_placement(function)
    return function


def _no_placement(value: object) -> InvalidInputError:
    return InvalidInputError(
        "placement: expected a name, or a function (workspace, n, rng) -> cells, got"
        f" {shortened(value)}"
    )


def _takes(function: Placement, *arguments: object) -> bool:
    """Return whether a function accepts the three arguments of a placement.

    For a function without a signature, such as some built-in functions of Python, return true.
    """
    try:
        inspect.signature(function).bind(*arguments)
    except TypeError:
        return False
    except ValueError:
        pass
    return True


def _name(placement: str | Placement) -> str:
    return placement if isinstance(placement, str) else getattr(placement, "__name__", "custom")


@PLACEMENTS.register("uniform")
def uniform(workspace: GridWorkspace, n: int, rng: Generator) -> NDArray[np.int64]:
    """Draw n different free cells at random, all with equal probability."""
    return workspace.cells[rng.choice(workspace.n_free, size=n, replace=False)]


@PLACEMENTS.register("flood-fill")
def flood_fill(workspace: GridWorkspace, n: int, rng: Generator) -> NDArray[np.int64]:
    """Choose a random free cell, and take the n free cells with the shortest paths to the chosen
    cell.
    """
    start = workspace.cells[rng.integers(workspace.n_free)]
    return _nearest(workspace, n, start, what="flood-fill")


def _nearest(
    workspace: GridWorkspace, n: int, start: NDArray[np.int64], *, what: str
) -> NDArray[np.int64]:
    """Return the n free cells with the shortest paths to a free cell."""
    from shoal.swarm.kernels.search import nearest_cells

    padded = np.pad(workspace.free, 1)
    flat = int(np.ravel_multi_index(tuple(start + 1), padded.shape))
    nearest = nearest_cells(padded.ravel(), offsets_of(padded.shape), flat, n)
    if len(nearest) < n:
        raise InvalidInputError(
            f"{what}: expected {n} connected free cells around {tuple(start.tolist())} of"
            f" {workspace.name}, got only {len(nearest)}"
        )
    return np.stack(np.unravel_index(nearest, padded.shape), axis=1) - 1


@dataclass(frozen=True)
class Inlet:
    """The placement of particles that have filled a vessel from an inlet outwards: the n free cells
    with the shortest paths to the inlet.

    Parameters
    ----------
    cell : tuple of int
        The cell of the inlet.

    Examples
    --------
    >>> workspace = GridWorkspace([[1, 1, 0, 1], [1, 1, 1, 1]])
    >>> Inlet((0, 3))(workspace, 3, np.random.default_rng(0)).tolist()
    [[0, 3], [1, 3], [1, 2]]
    """

    cell: tuple[int, ...]

    @classmethod
    def parse(cls, text: str) -> Inlet:
        """Return the inlet of a text such as "inlet:3,4".

        Raises
        ------
        InvalidInputError
            Raised if the text does not name a cell.
        """
        numbers = text.removeprefix("inlet:").split(",")
        if len(numbers) not in (2, 3) or not all(number.strip().isdecimal() for number in numbers):
            raise InvalidInputError(
                f"start: expected inlet:row,column (in three dimensions inlet:layer,row,column), got"
                f" {shortened(text)}"
            )
        return cls(tuple(int(number) for number in numbers))

    def check(self, workspace: GridWorkspace) -> None:
        """Refuse a workspace in which the inlet is not a free cell."""
        with errors_at("inlet"):
            check_start(workspace, [self.cell])

    def __call__(self, workspace: GridWorkspace, n: int, rng: Generator) -> NDArray[np.int64]:
        """Return the start cells (int64, shape (n, ndim)), nearest first."""
        self.check(workspace)
        return _nearest(workspace, n, np.array(self.cell), what="inlet")

    def __str__(self) -> str:
        return f"inlet:{','.join(map(str, self.cell))}"


@PLACEMENTS.register("region-fill")
def region_fill(workspace: GridWorkspace, n: int, rng: Generator) -> NDArray[np.int64]:
    """Take the n free cells with the smallest Manhattan distance, measured through walls, to a
    random cell of the map.
    """
    center = np.array([rng.integers(size) for size in workspace.shape])
    distance = np.abs(workspace.cells - center).sum(axis=1)
    return workspace.cells[np.argsort(distance, kind="stable")[:n]]


@PLACEMENTS.register("left-wall")
def left_wall(workspace: GridWorkspace, n: int, rng: Generator) -> NDArray[np.int64]:
    """Take the n leftmost free cells, column by column from top to bottom, for the policy sweep
    (paper D, section III.B.2).
    """
    cells = workspace.cells
    return cells[np.lexsort((*cells.T[:-1][::-1], cells[:, -1]))[:n]]
