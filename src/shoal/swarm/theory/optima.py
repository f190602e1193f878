"""Minimum numbers of moves for small coverage tasks, proved by an exhaustive search."""

from __future__ import annotations

import heapq
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.commands import letters_of
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.theory.bounds import check_case, flat_cells, flat_mask

MOST_STATES = 2_000_000


@dataclass(frozen=True)
class Optimum:
    """The minimum number of moves for a coverage task, proved by an exhaustive search.

    Parameters
    ----------
    moves : int
    commands : str
        A plan with the minimum number of moves, as command letters.
    states : int
        Number of different states that the search has found, including states that it has not expanded.
    """

    moves: int
    commands: str
    states: int


def optimum(
    workspace: GridWorkspace,
    start: ArrayLike,
    *,
    targets: NDArray[np.bool_] | None = None,
    rule: str = "block",
    most_states: int = MOST_STATES,
) -> Optimum:
    """Return the minimum number of moves that cover all free cells or all target cells, found by an A* search.

    Parameters
    ----------
    workspace : GridWorkspace
        A small workspace, because the number of states grows exponentially with the number of cells.
    start : array_like of int, shape (n, ndim)
        Start cells of the particles.
    targets : ndarray of bool, the shape of the workspace, optional
        The cells that the particles must cover. By default, the particles must cover all free cells.
    rule : str
        The move rule: "block" or "merge".
    most_states : int
        Maximum number of different states that the search may find.

    Raises
    ------
    InvalidInputError
        Raised if particles cannot reach a target cell, or if the search needs more than ``most_states`` states.

    Examples
    --------
    >>> optimum(GridWorkspace([[1, 1, 1], [1, 1, 1]]), [(0, 0)]).moves
    5
    """
    cells = check_case(workspace, start, "coverage", targets, rule)
    free, offsets = flat_cells(workspace)
    world = SmallWorld(free, offsets, rule)
    wanted = free if targets is None else np.pad(np.asarray(targets, dtype=np.bool_), 1).ravel()
    particles = world.number(flat_mask(workspace, cells))
    left = world.number(wanted) & ~particles
    balls = {cell: world.balls(cell) for cell in set_bits(left)}
    if any(not steps[-1] & particles for steps in balls.values()):
        raise InvalidInputError(
            "optimum: expected a particle in every connected part with cells to cover, got a part without a particle"
        )
    n, letters = len(cells), letters_of(workspace.ndim)

    def estimate(particles: int, left: int) -> int:
        farthest = 0
        for cell in set_bits(left):
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
                raise InvalidInputError(f"optimum: expected at most {most_states} states, got more for {workspace.name}")
            seen[state] = moves + 1
            heapq.heappush(queue, (moves + 1 + estimate(*state), -moves - 1, *state, plan + letter))
    raise AssertionError("a reachable cell was not reached")


class SmallWorld:
    """A small world in which each set of cells is an integer with one bit per cell."""

    def __init__(self, free: NDArray[np.bool_], offsets: NDArray[np.int64], rule: str) -> None:
        self.free, self.offsets, self.merge = self.number(free), offsets.tolist(), rule == "merge"

    @staticmethod
    def number(mask: NDArray[np.bool_]) -> int:
        """Return a mask of cells as an integer with one bit per cell."""
        return int.from_bytes(np.packbits(mask, bitorder="little").tobytes(), "little")

    @staticmethod
    def shifted(cells: int, offset: int) -> int:
        """Return a set of cells, shifted by a number of bits."""
        return cells << offset if offset > 0 else cells >> -offset

    def push(self, particles: int, command: int, free: int | None = None) -> int:
        """Return the cells that hold particles after one command."""
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
        """Return a list of sets of cells: set number d contains all cells within d moves of ``cell``."""
        found = [1 << cell]
        while True:
            wider = found[-1]
            for offset in self.offsets:
                wider |= self.shifted(found[-1], offset) & self.free
            if wider == found[-1]:
                return found
            found.append(wider)


def set_bits(number: int) -> Iterator[int]:
    """Yield the index of each 1 bit in an integer."""
    while number:
        low = number & -number
        yield low.bit_length() - 1
        number ^= low
