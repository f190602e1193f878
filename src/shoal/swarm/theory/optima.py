"""The fewest moves of small cases, proved by search: coverage of a known map, mapping of an unknown one."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.checks import check_number
from shoal.errors import InvalidInputError
from shoal.swarm.grid.commands import letters_of
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.theory.bounds import check_case, flat_cells, flat_mask

MOST_STATES = 2_000_000


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
    cells = check_case(workspace, start, "coverage", targets, rule)
    free, offsets = flat_cells(workspace)
    world = _Cells(free, offsets, rule)
    wanted = free if targets is None else np.pad(np.asarray(targets, dtype=np.bool_), 1).ravel()
    particles = world.number(flat_mask(workspace, cells))
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
    check_number(chance_free, what="chance_free", least=0, most=1)
    workspace = GridWorkspace(np.ones(shape, dtype=np.bool_))
    cells = check_case(workspace, start, "mapping", None, rule)
    window, offsets = flat_cells(workspace)
    world = _Cells(window, offsets, rule)
    particles = world.number(flat_mask(workspace, cells))
    states = 0
    answers = []
    for worst in (True, False):
        game = _Game(world, chance_free, worst, most_states)
        answers.append(game.value(particles, particles, particles))
        states = max(states, len(game.values))
    return MappingOptimum(answers[0], answers[1], states)


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
