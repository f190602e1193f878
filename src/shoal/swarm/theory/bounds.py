"""How few moves are possible: lower bounds for any map, exact optima of small cases."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.errors import InvalidInputError
from shoal.swarm.grid.commands import letters_of
from shoal.swarm.grid.world import check_start
from shoal.swarm.maps.workspace import GridWorkspace

MOST_STATES = 2_000_000
_AXES = ((0, 2), (1, 3), (4, 5))  # commands that undo each other


@dataclass(frozen=True)
class LowerBound:
    """Numbers of moves that no plan can stay below; ``moves`` is the largest.

    Parameters
    ----------
    count : int
        Each move settles at most one cell a particle.
    distance : int
        The farthest cell from any particle; and if N cells are farther than d, d moves and then those for N cells.
    axes : int
        The sum over the axes of the commands needed along each: those without which some cell cannot be reached, whatever the
        commands of the other axes are, or those for the walls that can be probed along this axis only.
    """

    count: int
    distance: int
    axes: int

    @property
    def moves(self) -> int:
        """The largest of the bounds."""
        return max(self.count, self.distance, self.axes)


@dataclass(frozen=True)
class Optimum:
    """The fewest moves, proved by search.

    Parameters
    ----------
    moves : int
    commands : str
        A plan with so many.
    states : int
        States that the search has looked at.
    """

    moves: int
    commands: str
    states: int


@dataclass(frozen=True)
class MappingOptimum:
    """What the best strategy of mapping needs when it does not know the map.

    Parameters
    ----------
    worst : float
        Moves in the worst case, of the strategy that is best in this respect.
    mean : float
        Expected moves under the prior, of the strategy that is best in that respect.
    states : int
        States of knowledge and particles that were looked at.
    """

    worst: float
    mean: float
    states: int


def _flat(workspace: GridWorkspace) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Return the free cells with a rim of one, flat, and the offset of each command."""
    padded = np.pad(workspace.free, 1)
    row = padded.shape[-1]
    layer = row * padded.shape[-2]
    offsets = np.array([-1, -row, 1, row, -layer, layer][: len(letters_of(workspace.ndim))], dtype=np.int64)
    return padded.ravel(), offsets


def _mask_of(workspace: GridWorkspace, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
    mask = np.zeros(workspace.shape, dtype=np.bool_)
    mask[tuple(cells.T)] = True
    return np.pad(mask, 1).ravel()


def _check(
    workspace: GridWorkspace, start: ArrayLike, task: str, targets: NDArray[np.bool_] | None, rule: str
) -> NDArray[np.int64]:
    if rule not in ("block", "merge"):
        raise InvalidInputError(f"rule: expected block or merge, where a particle moves at most one cell a command, got {rule}")
    if task not in ("mapping", "coverage"):
        raise InvalidInputError(f"task: expected mapping or coverage (of targets, if given), got {task!r}")
    if targets is not None and (task == "mapping" or np.shape(targets) != workspace.shape):
        raise InvalidInputError(f"targets: expected a mask of shape {workspace.shape} for coverage, got {np.shape(targets)}")
    return check_start(workspace, start, rule=rule)


def lower_bound(
    workspace: GridWorkspace,
    start: ArrayLike,
    *,
    task: str = "coverage",
    targets: NDArray[np.bool_] | None = None,
    rule: str = "block",
) -> LowerBound:
    """Return numbers of moves that no plan can stay below, even one that knows the map.

    Parameters
    ----------
    workspace : GridWorkspace
    start : array_like of int, shape (n, ndim)
        Cells of the particles.
    task : str
        "coverage" or "mapping". Of a mapping all free cells and walls that the particles can get to are to be classified.
    targets : ndarray of bool, the shape of the workspace, optional
        Coverage: the cells to cover, if not all.
    rule : str
        "block" or "merge".

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> line = GridWorkspace([[1, 1, 1, 1, 1, 1]])
    >>> lower_bound(line, [(0, 2)])
    LowerBound(count=5, distance=5, axes=5)

    Notes
    -----
    Proofs: docs/concepts/planners.md.
    """
    from shoal.swarm.kernels.reach import FAR, fewest_both_ways, fewest_paid

    cells = _check(workspace, start, task, targets, rule)
    free, offsets = _flat(workspace)
    particles = _mask_of(workspace, cells)
    distances = np.where(particles, 0, FAR).astype(np.int64)
    stack = np.zeros(free.size, dtype=np.int64)
    fewest_paid(free, offsets, -1, -1, distances, stack)
    if task == "mapping":
        wanted = (distances > 0) & (distances < FAR)
    else:
        chosen = free if targets is None else np.pad(np.asarray(targets, dtype=np.bool_), 1).ravel()
        wanted = chosen & ~particles & (distances < FAR)
    n, left = len(cells), np.bincount(distances[wanted]) if wanted.any() else np.zeros(1, dtype=np.int64)
    beyond = left.sum() - np.cumsum(left)  # cells farther than d
    farthest = max((d + -(-int(more) // n) for d, more in enumerate(beyond) if more), default=0)
    axes = 0
    for back, forth in _AXES[: workspace.ndim]:
        costs, before = np.zeros(free.size, dtype=np.int64), np.zeros(free.size, dtype=np.int64)
        reach = int(fewest_both_ways(free, offsets, wanted, particles, back, forth, costs, before, stack))
        axes += max(reach, sum(-(-_only_by(free, offsets, wanted, way) // n) for way in (back, forth)))
    return LowerBound(count=-(-int(left.sum()) // n), distance=max(farthest, len(left) - 1), axes=axes)


def _only_by(free: NDArray[np.bool_], offsets: NDArray[np.int64], wanted: NDArray[np.bool_], command: int) -> int:
    """Return how many walls can be probed by one command only: they have one free neighbour."""
    walls = np.flatnonzero(wanted & ~free)
    inside = [(walls - offset >= 0) & (walls - offset < free.size) for offset in offsets]
    entered = [ok & free[np.clip(walls - offset, 0, free.size - 1)] for ok, offset in zip(inside, offsets, strict=True)]
    return int(np.count_nonzero(entered[command] & (np.sum(entered, axis=0) == 1)))


class _Cells:
    """A small world whose sets of cells are whole numbers."""

    def __init__(self, free: NDArray[np.bool_], offsets: NDArray[np.int64], rule: str) -> None:
        self.free, self.offsets, self.merge = self.number(free), offsets.tolist(), rule == "merge"

    @staticmethod
    def number(mask: NDArray[np.bool_]) -> int:
        """Return a set of cells as a number."""
        return int.from_bytes(np.packbits(mask, bitorder="little").tobytes(), "little")

    @staticmethod
    def shifted(cells: int, offset: int) -> int:
        """Return the cells moved by an offset."""
        return cells << offset if offset > 0 else cells >> -offset

    def push(self, particles: int, command: int, free: int | None = None) -> int:
        """Return where particles are after one command."""
        offset = self.offsets[command]
        moving = particles & self.shifted(self.free if free is None else free, -offset)
        staying = particles & ~moving
        while not self.merge:
            held = moving & self.shifted(staying, -offset)
            if not held:
                break
            staying |= held
            moving &= ~held
        return staying | self.shifted(moving, offset)

    def balls(self, cell: int) -> list[int]:
        """Return the cells within 0, 1, 2, ... moves of a cell."""
        found = [1 << cell]
        while True:
            wider = found[-1]
            for offset in self.offsets:
                wider |= self.shifted(found[-1], offset) & self.free
            if wider == found[-1]:
                return found
            found.append(wider)


def _bits(number: int) -> Iterator[int]:
    while number:
        low = number & -number
        yield low.bit_length() - 1
        number ^= low


def optimum(
    workspace: GridWorkspace,
    start: ArrayLike,
    *,
    targets: NDArray[np.bool_] | None = None,
    rule: str = "block",
    most_states: int = MOST_STATES,
) -> Optimum:
    """Return the fewest moves that cover all free cells, or the targets: A* over particles and cells left.

    Parameters
    ----------
    workspace : GridWorkspace
        A small one: the number of states grows exponentially.
    start : array_like of int, shape (n, ndim)
    targets : ndarray of bool, the shape of the workspace, optional
    rule : str
        "block" or "merge".
    most_states : int
        Give up after so many.

    Raises
    ------
    InvalidInputError
        If some cell cannot be reached, or more states would have to be looked at.

    Examples
    --------
    >>> optimum(GridWorkspace([[1, 1, 1], [1, 1, 1]]), [(0, 0)]).moves
    5
    """
    cells = _check(workspace, start, "coverage", targets, rule)
    free, offsets = _flat(workspace)
    world = _Cells(free, offsets, rule)
    wanted = free if targets is None else np.pad(np.asarray(targets, dtype=np.bool_), 1).ravel()
    particles = world.number(_mask_of(workspace, cells))
    left = world.number(wanted) & ~particles
    balls = {cell: world.balls(cell) for cell in _bits(left)}
    if any(not steps[-1] & particles for steps in balls.values()):
        raise InvalidInputError("optimum: expected a particle in every connected part with cells to cover")
    n, letters = len(cells), letters_of(workspace.ndim)

    def estimate(particles: int, left: int) -> int:
        farthest = 0
        for cell in _bits(left):
            steps = balls[cell]
            while not steps[farthest] & particles if farthest < len(steps) else False:
                farthest += 1
        return max(farthest, -(-left.bit_count() // n))

    seen = {(particles, left): 0}
    queue = [(estimate(particles, left), 0, particles, left, "")]
    while queue:
        _, negative, here, todo, plan = heapq.heappop(queue)
        moves = -negative
        if not todo:
            return Optimum(moves, plan, len(seen))
        if seen[here, todo] < moves:
            continue
        for command, letter in enumerate(letters):
            there = world.push(here, command)
            state = there, todo & ~there
            if there == here or seen.get(state, MOST_STATES) <= moves + 1:
                continue
            if len(seen) >= most_states:
                raise InvalidInputError(f"optimum: expected a case with at most {most_states} states, {workspace.name} has more")
            seen[state] = moves + 1
            heapq.heappush(queue, (moves + 1 + estimate(*state), -moves - 1, *state, plan + letter))
    raise AssertionError("a reachable cell was not reached")


def mapping_optimum(
    shape: tuple[int, ...], start: ArrayLike, *, chance_free: float = 0.5, rule: str = "block", most_states: int = MOST_STATES
) -> MappingOptimum:
    """Return what the best strategies of mapping need, in the worst case and on average, by search over states of knowledge.

    The prior: in a window of the given shape each cell without a particle is free with ``chance_free``, independently; outside are
    walls, and those beside free cells have to be probed as all others.

    Parameters
    ----------
    shape : tuple of int
        Of the window; a very small one: 1 x 6, 2 x 2 or 2 x 3.
    start : array_like of int, shape (n, ndim)
    chance_free : float
        Between 0 and 1.
    rule : str
        "block" or "merge".
    most_states : int
        Give up after so many.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    One particle in a window of one cell probes its four walls; with a second cell, that may be free, there are three more.

    >>> mapping_optimum((1, 1), [(0, 0)])
    MappingOptimum(worst=4.0, mean=4.0, states=16)
    >>> mapping_optimum((1, 2), [(0, 0)]).worst
    7.0
    """
    if not 0 <= chance_free <= 1:
        raise InvalidInputError(f"chance_free: expected a number from 0 to 1, got {chance_free}")
    workspace = GridWorkspace(np.ones(shape, dtype=np.bool_))
    cells = _check(workspace, start, "mapping", None, rule)
    window, offsets = _flat(workspace)
    world = _Cells(window, offsets, rule)
    particles = world.number(_mask_of(workspace, cells))
    states = 0
    answers = []
    for worst in (True, False):
        game = _Game(world, chance_free, worst, most_states)
        answers.append(game.value(particles, particles, particles))
        states = max(states, len(game.values))
    return MappingOptimum(answers[0], answers[1], states)


class _Game:
    """Mapping against chance or against an adversary."""

    def __init__(self, world: _Cells, chance_free: float, worst: bool, most_states: int) -> None:
        self.world, self.chance, self.worst, self.most_states = world, chance_free, worst, most_states
        self.values: dict[tuple[int, int, int], float] = {}

    def value(self, opened: int, known: int, particles: int) -> float:
        """Return the moves still needed when ``opened`` cells are known to be free and ``known`` ones are known."""
        key = opened, known, particles
        if key not in self.values:
            if len(self.values) >= self.most_states:
                raise InvalidInputError(f"mapping_optimum: expected a case with at most {self.most_states} states, this has more")
            self.values[key] = self._best(opened, known, particles)
        return self.values[key]

    def _frontier(self, opened: int, known: int) -> int:
        around = 0
        for offset in self.world.offsets:
            around |= self.world.shifted(opened, offset)
        return around & ~known

    def _best(self, opened: int, known: int, particles: int) -> float:
        """Walk where the outcome is known, to each place from which something can be learnt."""
        if not self._frontier(opened, known):
            return 0.0
        best, moves, wave, seen = float("inf"), 0, {particles}, {particles}
        while wave and moves + 1 < best:
            following = set()
            for here in wave:
                for command, offset in enumerate(self.world.offsets):
                    tried = self.world.shifted(here, offset) & ~known
                    if tried:
                        best = min(best, moves + 1 + self._learn(opened, known, here, command, tried, best - moves - 1))
                    else:
                        following.add(self.world.push(here, command, opened))
            wave = following - seen
            seen |= wave
            moves += 1
        return best

    def _learn(self, opened: int, known: int, here: int, command: int, tried: int, bound: float) -> float:
        """Return the moves needed after a command that settles the cells ``tried``: the worst outcome, or the mean."""
        uncertain = [1 << bit for bit in _bits(tried & self.world.free)]
        mean = most = 0.0
        for outcome in product((False, True), repeat=len(uncertain)):
            found = sum(bit for bit, is_free in zip(uncertain, outcome, strict=True) if is_free)
            share = self.chance ** sum(outcome) * (1 - self.chance) ** (len(outcome) - sum(outcome))
            if share == 0:
                continue
            after = self.world.push(here, command, opened | found)
            value = self.value(opened | found, known | tried, after)
            most, mean = max(most, value), mean + share * value
            if (most if self.worst else mean) >= bound:
                break
        return most if self.worst else mean
