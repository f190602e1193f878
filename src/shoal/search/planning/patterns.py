"""Patterns that search crews know by name, as plans to compare with: each robot flies one pattern in
its own part of the region.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from shoal.search.allocation.allocate import Arc
from shoal.search.cells.grid import CellGrid
from shoal.search.planning.orientation import longest_angle
from shoal.search.planning.plan import SearchPlan, plans_along, with_prior_odds, with_work
from shoal.search.problem import SearchProblem

Cells = NDArray[np.int64]
Floats = NDArray[np.float64]

_LEGS = 3  # of a sector search through its middle, before the next three between them
_ROUNDS = 2


def _rows(cells: Cells, start: Floats) -> Cells:
    """Return the order of a parallel track: rows along the longer side, there and back, from the
    corner nearest to the start.
    """
    rows, columns = cells.T
    best: tuple[float, Cells] | None = None
    for down in (1, -1):
        for back in (1, -1):
            # every second row is searched backwards
            _, number = np.unique(down * rows, return_inverse=True)
            order = np.lexsort((back * (1 - 2 * (number % 2)) * columns, number))
            away = float(np.hypot(*(cells[order[0]] - start)))
            if best is None or away < best[0]:
                best = away, order
    assert best is not None
    return best[1]


def _columns(cells: Cells, start: Floats) -> Cells:
    """Return the order of a creeping line: rows along the shorter side."""
    return _rows(cells[:, ::-1], start[::-1])


def _outward(cells: Cells, start: Floats) -> Cells:
    """Return the order of a corridor: along the middle line, and then on both sides of it, farther
    and farther out.
    """
    rows, columns = cells.T
    middle = float(np.median(np.unique(rows)))
    rows_outward = sorted({*rows.tolist()}, key=lambda row: (abs(row - middle), row))
    rank = np.array([rows_outward.index(row) for row in rows.tolist()])
    ends = [cells[(rank == 0)][np.argmin(s * columns[rank == 0])] for s in (1, -1)]
    back = 1 if np.hypot(*(ends[0] - start)) <= np.hypot(*(ends[1] - start)) else -1
    return np.lexsort((back * (1 - 2 * (rank % 2)) * columns, rank))


def _square(cells: Cells, likely: Floats) -> Cells:
    """Return the order of an expanding square around the likeliest cell."""
    position, step = likely.astype(np.int64), np.array([0, 1])
    far = int(np.abs(cells - position).max())
    path = [position.copy()]
    for leg in range(4 * far + 2):
        for _ in range(leg // 2 + 1):
            position += step
            path.append(position.copy())
        step = np.array([-step[1], step[0]])
    return _entered_cells(cells, np.array(path))


def _sectors(cells: Cells, likely: Floats) -> Cells:
    """Return the order of a sector search: three legs through the likeliest cell, each at 60
    degrees to the last, and three more between them. It leaves cells out.
    """
    reach = float(np.hypot(*(cells - likely).T).max())
    corners = []
    for turn in range(_ROUNDS):
        first = np.pi / (_LEGS * _ROUNDS) * turn
        for leg in range(_LEGS):
            # out on the other side, and along the circle to the next leg
            angle = first + 2 * np.pi / _LEGS * leg
            out = np.array([np.sin(angle), np.cos(angle)])
            corners += [likely, likely + reach * out]
            angle += np.pi / _LEGS
            corners += [likely + reach * np.array([np.sin(angle), np.cos(angle)])]
    corners.append(likely)
    path = [likely[None]]
    for start, end in pairwise(corners):
        steps = int(np.ceil(2 * np.hypot(*(end - start)))) + 1
        path.append(np.linspace(start, end, steps))
    return _entered_cells(cells, np.rint(np.concatenate(path)).astype(np.int64))


def _entered_cells(cells: Cells, path: Cells) -> Cells:
    """Return the indices of the cells that a path of rows and columns enters, each once."""
    index = {cell: number for number, cell in enumerate(map(tuple, cells.tolist()))}
    entered = (index.get(cell) for cell in map(tuple, path.tolist()))
    return np.array(list(dict.fromkeys(cell for cell in entered if cell is not None)))


PATTERNS: dict[str, tuple[Callable[[Cells, Floats], Cells], int | None]] = {
    "parallel-track": (_rows, 0),
    "creeping-line": (_columns, 1),
    "corridor": (_outward, 1),
    "expanding-square": (_square, None),
    "sector": (_sectors, None),
}
"""For each pattern, the function that orders the cells of a robot's part, and the axis along which
parts lie beside each other, 0 across rows and 1 along rows: the function's second argument is the cell
in which the robot starts. With None, parts are as compact as they can be, and it is the likeliest
cell."""


def pattern_plans(problem: SearchProblem, seed: int) -> list[tuple[str, SearchPlan]]:
    """Return a plan for each pattern.

    Rows have the distance of the planner's rows and run along the longer side of the region, unless
    the problem gives their angle. Robots divide the region across rows (parallel track), along them
    (creeping line, corridor) or both (expanding square, sector) into parts with numbers of cells in
    proportion to their speeds, in the order in which they start. What lies at the middle of a pattern is the likeliest cell of a part
    or, without a prior, the one nearest to its middle.

    A search of several layers, or of each cell by several robots, has no such patterns.
    """
    if problem.multiplicity > 1 or problem.passes > 1 or len(problem.altitudes) > 1:
        return []
    oriented = problem.replaced(tour="boustrophedon", allocation="stay")
    if problem.along is None and not isinstance(problem.angle, float):
        oriented = oriented.replaced(angle=longest_angle(problem.place.area))
    oriented = oriented.at_place(problem.place)
    plan = plans_along(oriented, seed)[0]
    if not isinstance(plan.grid, CellGrid):
        return []
    plan = with_prior_odds(plan, problem)
    return [(name, with_work(plan, name, _work(plan, name))) for name in PATTERNS]


def _work(plan: SearchPlan, name: str) -> list[tuple[Arc, ...]]:
    """Return the arcs of all robots along the plan's tour that follow a pattern."""
    order_of, axis = PATTERNS[name]
    cells = plan.tour.cells.astype(np.int64)
    work: list[tuple[Arc, ...]] = [()] * len(plan.rates)
    everyone = np.arange(len(plan.rates))
    for robot, own in _parts(cells, cells[plan.starts], plan.rates, everyone, axis):
        if not len(own):
            continue
        if axis is not None:
            place = cells[plan.starts[robot]]
        elif plan.tour_cost.odds is None:
            place = cells[own[np.argmin(np.hypot(*(cells[own] - cells[own].mean(axis=0)).T))]]
        else:
            place = cells[own[np.argmax(plan.tour_cost.odds[own])]]
        order = own[order_of(cells[own], place.astype(np.float64))]
        work[robot] = _arcs(order, len(cells))
    return work


def _parts(
    cells: Cells,
    starts: Cells,
    rates: NDArray[np.float64],
    robots: Cells,
    axis: int | None,
    own: Cells | None = None,
) -> Iterator[tuple[int, Cells]]:
    """Yield each robot with the indices of its cells: whole rows or columns, halved again and again
    in proportion to the speeds. On each side are the robots that start there.
    """
    own = np.arange(len(cells)) if own is None else own
    if len(robots) == 1:
        yield int(robots[0]), own
        return
    along = axis
    if along is None:
        along = int(np.argmax(np.ptp(cells[own], axis=0))) if len(own) else 0
    order = robots[np.lexsort((starts[robots, 1 - along], starts[robots, along]))]
    half = len(order) // 2
    share = float(rates[order[:half]].sum() / rates[order].sum())
    _, line, counts = np.unique(cells[own, along], return_inverse=True, return_counts=True)
    # the middle of each row or column, in cells before it
    first = (np.cumsum(counts) - counts / 2 < share * len(own))[line]
    for side, part in ((order[:half], own[first]), (order[half:], own[~first])):
        yield from _parts(cells, starts, rates, side, axis, part)


def _arcs(numbers: Cells, n: int) -> tuple[Arc, ...]:
    """Return tour indices in the order of a search as arcs."""
    steps = np.diff(numbers)
    steps = np.where(np.abs(steps) == n - 1, -np.sign(steps), steps)
    arcs, first = [], 0
    while first < len(numbers):
        last = first
        step = int(steps[first]) if first < len(steps) else 1
        if abs(step) == 1:
            while last < len(steps) and steps[last] == step:
                last += 1
        else:
            step = 1
        arcs.append(Arc(int(numbers[first]), last - first + 1, step))
        first = last + 1
    return tuple(arcs)
