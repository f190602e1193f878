"""Bounds on the number of moves, and optima of small maps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import letters_of, offsets_of
from shoal.swarm.grid.tasks import Gathering
from shoal.swarm.grid.world import check_start
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.theory.small_world import SmallWorld

_AXES = ((0, 2), (1, 3), (4, 5))  # commands with opposite directions


@dataclass(frozen=True)
class LowerBound:
    """Lower bounds on the number of moves of any plan. The property ``moves`` is the largest of
    them, and the property ``name`` names it.

    Parameters
    ----------
    count : int
        Counting bound: a lower bound that follows from the fact that each move classifies at most
        one cell per particle.
    distance : int
        Distance bound: if N of the cells to classify are more than d moves away from all particles,
        a plan needs at least d moves plus the counting bound of these N cells. The distance bound
        is the largest of these sums over all d.
    axes : int
        Axis bound: the minimum number of commands along each axis, summed over all axes. The
        minimum number of commands along an axis follows from cells that need many commands along
        the axis, and from walls that particles can probe along this axis only. The axis bound is 0
        under the rule tilt.
    commands : int
        Command bound: the smallest number of commands in a set of commands that allows paths to all
        cells to classify, and that can classify that many cells.
    pairs : int
        Pair bound: the largest number of commands that two particles need to reach two of the cells
        to classify, because each command moves both. The pair bound is 0 for large workspaces.
    flow : int
        Flow bound: a number of commands below which no flow of particles through time enters all
        cells to classify. The flow bound is 0 if `lower_bound` was called without ``flow``.
    """

    count: int
    distance: int
    axes: int
    commands: int
    pairs: int
    flow: int = 0

    @property
    def moves(self) -> int:
        """The largest of the lower bounds."""
        return max(self.count, self.distance, self.axes, self.commands, self.pairs, self.flow)

    @property
    def name(self) -> str:
        """The name of the largest lower bound; the first of the names if several are equal."""
        names = ("count", "distance", "axes", "commands", "pairs", "flow")
        return max(names, key=lambda name: getattr(self, name))


def flat_cells(workspace: GridWorkspace) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Return the mask of free cells as a flat array with a rim of one cell, and the index offset of
    each command.
    """
    padded = np.pad(workspace.free, 1)
    return padded.ravel(), offsets_of(padded.shape)


def flat_mask(workspace: GridWorkspace, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return the mask of a set of cells as a flat array with a rim of one cell, in the layout of
    `flat_cells`.
    """
    mask = np.zeros(workspace.shape, dtype=np.bool_)
    mask[tuple(cells.T)] = True
    return np.pad(mask, 1).ravel()


def check_case(
    workspace: GridWorkspace,
    start: ArrayLike,
    task: str,
    targets: NDArray[np.bool_] | None,
    rule: str,
) -> NDArray[np.int64]:
    """Return the start cells of the particles. Refuse a task, targets or a move rule for which no
    lower bounds are known.
    """
    if rule not in ("block", "merge", "tilt"):
        raise InvalidInputError(f"rule: expected block, merge or tilt, got {rule}")
    if task not in ("mapping", "coverage", "gathering"):
        raise InvalidInputError(
            f"task: expected mapping, coverage (of targets, if given) or gathering, got {task!r}"
        )
    if targets is not None and (task == "mapping" or np.shape(targets) != workspace.shape):
        raise InvalidInputError(
            f"targets: expected a mask of shape {workspace.shape} for coverage or gathering, got"
            f" {np.shape(targets)}"
        )
    cells = check_start(workspace, start, rule=rule)
    if task == "gathering":
        region = () if targets is None else np.argwhere(targets).tolist()
        Gathering(tuple(map(tuple, region))).check(workspace, cells, rule)
    return cells


def lower_bound(
    workspace: GridWorkspace,
    start: ArrayLike,
    *,
    task: str = "coverage",
    targets: NDArray[np.bool_] | None = None,
    rule: str = "block",
    flow: bool = False,
) -> LowerBound:
    """Return lower bounds on the number of moves of any plan, even of a plan made with the complete
    map.

    Parameters
    ----------
    workspace : GridWorkspace
    start : array_like of int, shape (n, ndim)
        Start cells of the particles.
    task : str
        "coverage", "mapping" or "gathering". In a mapping, the particles must classify all free
        cells that they can reach, and all walls beside reachable cells.
    targets : ndarray of bool, the shape of the workspace, optional
        For a coverage: the cells that the particles must cover. By default, the particles must
        cover all free cells. For a gathering: the region; by default any one cell.
    rule : str
        The move rule: "block", "merge" or "tilt". Under the rule tilt, one move is one command, in
        which particles slide until something stops them.
    flow : bool
        Whether to compute the flow bound too, for few particles and a small workspace. It takes
        seconds to minutes.

    Examples
    --------
    >>> line = GridWorkspace([[1, 1, 1, 1, 1, 1]])
    >>> bound = lower_bound(line, [(0, 2)])
    >>> bound
    LowerBound(count=5, distance=5, axes=5, commands=5, pairs=7, flow=0)
    >>> bound.moves, bound.name
    (7, 'pairs')

    Notes
    -----
    The page docs/concepts/bounds.md proves the lower bounds.
    """
    from shoal.swarm.kernels.theory import FAR, fewest_both_ways, fewest_paid
    from shoal.swarm.theory.command_bounds import (
        fewest_by_flow,
        fewest_commands,
        fewest_for_pairs,
        longest_run,
    )

    cells = check_case(workspace, start, task, targets, rule)
    if flow and rule == "tilt":
        raise InvalidInputError("flow: expected the rule block or merge, got tilt")
    if flow and task == "gathering":
        raise InvalidInputError("flow: expected the task mapping or coverage, got gathering")
    free, offsets = flat_cells(workspace)
    particles = flat_mask(workspace, cells)
    if task == "gathering":
        return _gathering_bound(workspace, free, offsets, particles, len(cells), targets, rule)
    distances = np.where(particles, 0, FAR).astype(np.int64)
    stack = np.zeros(free.size, dtype=np.int64)
    fewest_paid(free, offsets, -1, -1, distances, stack)
    if task == "mapping":
        required = (distances > 0) & (distances < FAR)
    else:
        goal = free if targets is None else np.pad(np.asarray(targets, dtype=np.bool_), 1).ravel()
        required = goal & ~particles & (distances < FAR)
    n = len(cells)
    instance = free, offsets, required, particles, n
    commands = fewest_commands(*instance, slides=rule == "tilt")
    pairs = fewest_for_pairs(*instance, rule=rule)
    if rule == "tilt":  # one command classifies up to a whole line of cells a particle
        most = n * longest_run(free, offsets)
        return LowerBound(-(-int(np.count_nonzero(required)) // most), 0, 0, commands, pairs)
    counts = np.bincount(distances[required]) if required.any() else np.zeros(1, dtype=np.int64)
    beyond = counts.sum() - np.cumsum(counts)  # cells farther than d
    farthest = max((d + -(-int(more) // n) for d, more in enumerate(beyond) if more), default=0)
    axes = 0
    for back, forth in _AXES[: workspace.ndim]:
        costs, before = np.zeros(free.size, dtype=np.int64), np.zeros(free.size, dtype=np.int64)
        reach = int(
            fewest_both_ways(free, offsets, required, particles, back, forth, costs, before, stack)
        )
        axes += max(
            reach,
            sum(
                -(-_only_by(free, offsets, required, direction) // n) for direction in (back, forth)
            ),
        )
    least = LowerBound(
        count=-(-int(counts.sum()) // n),
        distance=max(farthest, len(counts) - 1),
        axes=axes,
        commands=commands,
        pairs=pairs,
    )
    if flow:
        return replace(least, flow=fewest_by_flow(*instance, rule=rule, least=least.moves))
    return least


def _gathering_bound(
    workspace: GridWorkspace,
    free: NDArray[np.bool_],
    offsets: NDArray[np.int64],
    particles: NDArray[np.bool_],
    n: int,
    targets: NDArray[np.bool_] | None,
    rule: str,
) -> LowerBound:
    """Return the lower bounds of a gathering.

    A path of a particle into the region, read backwards, is a path from the region with as many
    commands along each axis. The axis bound and the command bound are therefore those of a coverage
    of the particles' cells by any number of particles that start in the region.
    """
    from shoal.swarm.kernels.theory import fewest_both_ways
    from shoal.swarm.theory.command_bounds import fewest_commands
    from shoal.swarm.theory.gathering import count_bound, distance_bound, pair_bound

    region = _region_of(targets)
    instance = free, offsets, region, particles
    count, pairs = count_bound(*instance, rule), pair_bound(*instance, n, rule)
    if rule == "tilt":
        return LowerBound(count, 0, 0, 0, pairs)
    axes = commands = 0
    if region is not None:
        outside = particles & ~region
        commands = fewest_commands(free, offsets, outside, region, free.size)
        for back, forth in _AXES[: workspace.ndim]:
            costs, before, stack = (np.zeros(free.size, dtype=np.int64) for _ in range(3))
            sides = back, forth, costs, before, stack
            axes += int(fewest_both_ways(free, offsets, outside, region, *sides))
    return LowerBound(count, distance_bound(*instance, rule), axes, commands, pairs)


def _region_of(targets: NDArray[np.bool_] | None) -> NDArray[np.bool_] | None:
    return None if targets is None else np.pad(np.asarray(targets, dtype=np.bool_), 1).ravel()


def _only_by(
    free: NDArray[np.bool_], offsets: NDArray[np.int64], required: NDArray[np.bool_], command: int
) -> int:
    """Return the number of required walls with a single free neighbour, from which particles probe
    the wall by ``command``.
    """
    walls = np.flatnonzero(required & ~free)
    inside = [(walls - offset >= 0) & (walls - offset < free.size) for offset in offsets]
    entered = [
        ok & free[np.clip(walls - offset, 0, free.size - 1)]
        for ok, offset in zip(inside, offsets, strict=True)
    ]
    return int(np.count_nonzero(entered[command] & (np.sum(entered, axis=0) == 1)))


MOST_STATES = 2_000_000


@dataclass(frozen=True)
class Optimum:
    """The minimum number of moves for a task on a known map, proved by an exhaustive search.

    Parameters
    ----------
    moves : int
    commands : str
        A plan with the minimum number of moves, as command letters.
    states : int
        Number of different states that the last search has found, including states that it has not
        expanded.
    """

    moves: int
    commands: str
    states: int


def optimum(
    workspace: GridWorkspace,
    start: ArrayLike,
    *,
    task: str = "coverage",
    targets: NDArray[np.bool_] | None = None,
    rule: str = "block",
    most_states: int = MOST_STATES,
) -> Optimum:
    """Return the minimum number of moves that complete a task, found by an A* search with the
    complete map.

    Parameters
    ----------
    workspace : GridWorkspace
        A small workspace, because the number of states grows exponentially with the number of
        cells.
    start : array_like of int, shape (n, ndim)
        Start cells of the particles.
    task : str
        "coverage", "mapping" or "gathering", as in `lower_bound`.
    targets : ndarray of bool, the shape of the workspace, optional
        The cells to cover, or the region, as in `lower_bound`.
    rule : str
        The move rule: "block", "merge" or "tilt".
    most_states : int
        Maximum number of different states that the search may find.

    Raises
    ------
    InvalidInputError
        Raised if particles cannot reach a cell that they must classify, or if the search needs more
        than ``most_states`` states or 20 000 sets of cells with particles.

    Examples
    --------
    >>> optimum(GridWorkspace([[1, 1, 1], [1, 1, 1]]), [(0, 0)]).moves
    5
    """
    from shoal.swarm.theory.optimum import search_optimum

    cells = check_case(workspace, start, task, targets, rule)
    free, offsets = flat_cells(workspace)
    world = SmallWorld(free, offsets, rule)
    particles = world.number(flat_mask(workspace, cells))
    if task == "gathering":
        from shoal.swarm.theory.gathering import search_gathering

        region = _region_of(targets)
        instance = free, offsets, region, particles, len(cells), letters_of(workspace.ndim)
        return Optimum(*search_gathering(world, *instance, most_states))
    if task == "mapping":
        remaining = world.reached_by(particles) & ~particles
    else:
        goal = free if targets is None else np.pad(np.asarray(targets, dtype=np.bool_), 1).ravel()
        remaining = world.number(goal) & ~particles
    if remaining & ~world.reached_by(particles):
        raise InvalidInputError(
            "optimum: expected a particle in every connected part with cells to cover, got a part"
            " without a particle"
        )
    letters = letters_of(workspace.ndim)
    return Optimum(
        *search_optimum(world, particles, remaining, task == "mapping", letters, most_states)
    )
