"""Exploration of unknown regions with one particle: the least ratio in a corridor, SmartDFS in
regions without holes, and the reduction of Hamiltonian paths to coverage. Source: paper M, section
III.B.1.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from fractions import Fraction
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_integer
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError

__all__ = [
    "CoverageInstance",
    "coverage_instance",
    "least_corridor_ratio",
    "smart_dfs",
]

Cell = tuple[int, int]
STEPS = {"u": (-1, 0), "r": (0, 1), "d": (1, 0), "l": (0, -1)}  # clockwise
CLOCKWISE = tuple(STEPS.values())
_RING = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))


def least_corridor_ratio(cells: int) -> Fraction:
    """Return the smallest ratio that any policy can guarantee in all corridors of at most ``cells``
    free cells on each side of the start.

    The search is exact: it tries all turning points, with the costs of `shoal.swarm.adversary`. The ratio
    tends to 2 (paper M).

    Parameters
    ----------
    cells : int
        At least 1 and at most 40.
    """
    cells = check_integer(cells, what="cells", least=1, most=40)

    def least(left: int, right: int) -> int:
        return 2 * min(left, right) + max(left, right) + 2

    ratios = sorted(
        {
            Fraction(moves, least(a, b))
            for a in range(cells + 1)
            for b in range(cells + 1)
            for moves in range(least(a, b), 2 * least(a, b) + 1)
        }
    )
    lowest, highest = 0, len(ratios) - 1
    while lowest < highest:
        middle = (lowest + highest) // 2
        if _is_achievable(ratios[middle], cells):
            highest = middle
        else:
            lowest = middle + 1
    return ratios[lowest]


def _is_achievable(ratio: Fraction, cells: int) -> bool:
    """Return whether a policy exists that keeps a ratio in every corridor.

    A state is the explored cells and the side of the particle. The least number of moves to reach
    it, among policies that have kept the ratio so far, is enough to decide what follows.
    """

    def least(left: int, right: int) -> int:
        return 2 * min(left, right) + max(left, right) + 2

    def found_left(a: int, b: int, moves: int) -> bool:
        """Whether the end behind cell a may be found after ``moves``, with b cells explored."""
        # from this end, the best is to go to the other end, wherever it is
        return all(
            moves + a + right + 1 <= ratio * least(a, right) for right in range(b, cells + 1)
        )

    # (explored left, explored right, whether the particle is on the left) -> least moves
    reached = {(0, 0, True): 0}
    for total in range(2 * cells + 3):
        for (a, b, on_left), moves in [*reached.items()]:
            if a + b != total:
                continue
            for to_left in (True, False):
                cross = 0 if to_left == on_left or total == 0 else a + b
                far, near = (a, b) if to_left else (b, a)
                # the next move finds the end or a new cell
                after = moves + cross + 1
                if not found_left(far, near, after):
                    continue
                if far == cells:  # this must be the end
                    return True
                state = (a + 1, b, True) if to_left else (a, b + 1, False)
                reached[state] = min(after, reached.get(state, after))
    return False


def smart_dfs(free: ArrayLike, start: Cell) -> list[Cell]:
    """Return the tour of SmartDFS through an unknown region without holes, from the start through
    all cells and back.

    SmartDFS (Icking, Kamphans, Klein and Langetepe, 2005) is a depth-first search by the left-hand
    rule with two improvements. It returns on shortest paths through visited cells. At a cell that
    splits the unvisited region, it decides by layers (the distance from the walls, as visited)
    which part comes first. From a start beside a wall, its tour of C >= 2 cells with E edges to
    walls has at most C + E/2 - 3 moves, and at most 4/3 of the moves of a shortest tour.

    Parameters
    ----------
    free : array_like of bool, shape (H, W)
        The region. The explorer sees only whether the four neighbours of its cell are free.
    start : tuple of int
        Row and column of the start.

    Returns
    -------
    list of tuple of int
        The visited cells in their order, beginning and ending with the start.

    Raises
    ------
    InvalidInputError
        If the start is not a free cell.

    Examples
    --------
    >>> len(smart_dfs([[1, 1, 1], [1, 1, 1]], (0, 0))) - 1
    6
    """
    region = np.asarray(free, dtype=np.bool_)
    if region.ndim != 2:
        raise InvalidInputError(f"free: expected an array of shape (H, W), got {region.shape}")
    cells = {(int(row), int(column)) for row, column in np.argwhere(region)}
    if tuple(start) not in cells:
        raise InvalidInputError(f"start: expected a free cell, got {tuple(start)}")
    return _SmartDfs(cells, (int(start[0]), int(start[1]))).tour()


class _SmartDfs:
    """One exploration: the layer of each visited cell, the known walls and the tour so far."""

    def __init__(self, cells: set[Cell], start: Cell) -> None:
        self.cells, self.start = cells, start
        self.path, self.layers = [start], {start: 1}
        self.walls: set[Cell] = set()

    def tour(self) -> list[Cell]:
        row, column = self.start
        self._see(self.start)
        ahead = next(
            (
                k
                for k in range(4)
                if (row - CLOCKWISE[k][0], column - CLOCKWISE[k][1]) not in self.cells
            ),
            0,
        )
        stack = [(self.start, self._order(self.start, ahead))]
        while stack:  # no recursion: regions may be large
            base, directions = stack[-1]
            if not directions:
                stack.pop()
                continue
            direction = directions.pop(0)
            neighbour = _beside(base, direction)
            if neighbour in self.walls or neighbour in self.layers:
                continue
            self._walk_to(base)
            self.path.append(neighbour)
            self._see(neighbour)
            stack.append((neighbour, self._order(neighbour, direction)))
        self._walk_to(self.start)
        return self.path

    def _see(self, cell: Cell) -> None:
        """Note the walls beside a cell, and its layer."""
        self.walls |= {
            neighbour for k in range(4) if (neighbour := _beside(cell, k)) not in self.cells
        }
        around = [(cell[0] + r, cell[1] + c) for r, c in _RING]
        marks = [0 if position in self.walls else self.layers.get(position) for position in around]
        self.layers[cell] = 1 + min(
            (position for position in marks if position is not None), default=0
        )

    def _order(self, cell: Cell, ahead: int) -> list[int]:
        """Return the directions in which to go on from a cell, in their order."""
        turns = [(ahead + turn) % 4 for turn in (3, 0, 1, 2)]
        parts = self._parts(cell)
        if len(parts) < 2:
            return turns
        layer = self.layers[cell]
        # whether a part borders on the present layer with one of its sides only
        partly = {
            direction: (left == layer) != (right == layer)
            for directions, left, right in parts
            for direction in directions
        }
        open_ones = [direction for direction in turns if direction in partly]
        if not any(partly.values()):
            first = next(directions for directions, *_ in parts if open_ones[0] in directions)
            others = [direction for direction in open_ones if direction not in first]
            return others + [direction for direction in open_ones if direction in first]
        return sorted(open_ones, key=lambda direction: partly[direction])

    def _parts(self, cell: Cell) -> list[tuple[list[int], int, int]]:
        """Return the unvisited parts around a cell, each with its directions and with the layers of
        the cells at both of its sides; a wall has the layer 0.
        """
        around = [(cell[0] + r, cell[1] + c) for r, c in _RING]
        marks = [0 if position in self.walls else self.layers.get(position) for position in around]
        if all(mark is None for mark in marks):
            return []
        begin = next(k for k in range(8) if marks[k] is not None)
        parts, run, before = [], [], marks[begin]
        for k in range(begin + 1, begin + 9):
            mark = marks[k % 8]
            if mark is None:
                run.append(k % 8)
                continue
            directions = [position // 2 for position in run if position % 2 == 0]
            if directions:
                parts.append((directions, before or 0, mark))
            run, before = [], mark
        return parts

    def _walk_to(self, goal: Cell) -> None:
        """Walk to a cell on a shortest path through visited cells."""
        position = self.path[-1]
        if position == goal:
            return
        before: dict[Cell, Cell] = {goal: goal}
        queue = deque([goal])
        while position not in before:
            cell = queue.popleft()
            for k in range(4):
                neighbour = _beside(cell, k)
                if neighbour in self.layers and neighbour not in before:
                    before[neighbour] = cell
                    queue.append(neighbour)
        while position != goal:
            position = before[position]
            self.path.append(position)


def _beside(cell: Cell, direction: int) -> Cell:
    row, column = CLOCKWISE[direction]
    return cell[0] + row, cell[1] + column


@dataclass(frozen=True, eq=False)
class CoverageInstance:
    """A coverage problem that asks whether a grid graph has a Hamiltonian path from a start.

    Parameters
    ----------
    free : ndarray of bool, shape (H, W)
        The map: one free cell for each vertex of the graph.
    start : tuple of int
        The cell of the only particle.
    moves : int
        The graph has a Hamiltonian path from the start if and only if this number of moves covers
        the map.
    """

    free: NDArray[np.bool_]
    start: Cell
    moves: int

    def commands(self, path: Iterable[Cell]) -> str:
        """Return the commands that lead the particle along a path of neighbouring cells.

        Raises
        ------
        InvalidInputError
            If two successive cells are no neighbours.
        """
        cells = [*path]
        names = {step: letter for letter, step in STEPS.items()}
        letters = []
        for cell, following in pairwise(cells):
            step = (following[0] - cell[0], following[1] - cell[1])
            if step not in names:
                raise InvalidInputError(
                    f"path: expected neighbouring cells, got {cell} and {following}"
                )
            letters.append(names[step])
        return "".join(letters)


def coverage_instance(vertices: Iterable[Cell], start: Cell) -> CoverageInstance:
    """Return the coverage problem to which the question for a Hamiltonian path is reduced.

    A grid graph is a set of points with whole coordinates, with an edge between each two points at
    a distance of 1. Whether a grid graph has a Hamiltonian path from a given vertex is NP-complete
    (Itai, Papadimitriou and Szwarcfiter, 1982). A path of m - 1 moves that covers m cells visits
    each of them once, and every Hamiltonian path is such a path. Hence coverage with one particle
    in the fewest moves is NP-hard, also if the map is known.

    Parameters
    ----------
    vertices : iterable of (int, int)
        Row and column of each vertex.
    start : (int, int)
        The vertex with which the path begins.

    Raises
    ------
    InvalidInputError
        If there are no vertices, or if the start is none of them.

    Examples
    --------
    >>> instance = coverage_instance([(0, 0), (0, 1), (0, 2), (1, 1)], (0, 0))
    >>> instance.free.shape, instance.start, instance.moves
    ((2, 3), (0, 0), 3)
    """
    points = {(int(row), int(column)) for row, column in vertices}
    if tuple(start) not in points:
        raise InvalidInputError(f"start: expected one of the vertices, got {tuple(start)}")
    rows, columns = zip(*points, strict=True)
    free = np.zeros((max(rows) - min(rows) + 1, max(columns) - min(columns) + 1), dtype=np.bool_)
    for row, column in points:
        free[row - min(rows), column - min(columns)] = True
    return CoverageInstance(
        free, (int(start[0]) - min(rows), int(start[1]) - min(columns)), len(points) - 1
    )
