"""Headlands: rows, and one lane along the border that leads back to the first row."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from shoal.search.tours.masks import components
from shoal.search.tours.rows import (
    DISTURBANCES,
    MOST_RUNS,
    BoustrophedonTour,
    join_strips,
)
from shoal.search.tours.strips import cells_of_strip, detours_of, runs_in, straight_strips
from shoal.search.tours.tour import TOURS

Cells = NDArray[np.int64]

_ROUND = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))  # clockwise
_STRAIGHT = 0.75  # cells: a lane whose cells are nearer to a line is flown straight
_SIDES = 8  # number of the longest sides of a border at which lanes begin and end
_LANES = 8  # number of lanes, those with the fewest turns, for which tours are made
_WORK = 64_000  # cells times squared number of such sides: large regions have fewer


@TOURS.register("headland")
class HeadlandTour(BoustrophedonTour):
    """A tour along straight strips, and one lane along a part of the border.

    As on the headland of a field, the other strips end at the lane with room to turn, where they
    would have to follow a slanted border. The lane may also lead back from the last strip to the
    first one. The lane follows one side or several sides of the border. The other strips are rows,
    or few strips along rows and columns (`straight_strips`), whichever gives the best tour by
    its length and its turns. In a rectangle with an even number of rows, the tour is a comb.

    Parameters
    ----------
    turn : float
        Cost of a change of direction between two strips, in cells.
    disturbances : int
        Number of random exchanges of strips, after each of which the order is improved again.
    """

    name = "headland"

    turn: float = 1.0

    def __init__(self, turn: float = 1.0, disturbances: int = DISTURBANCES) -> None:
        super().__init__(turn, disturbances)

    def _in_order(self, region: NDArray[np.bool_]) -> Cells:
        sides = min(_SIDES, int((_WORK / np.count_nonzero(region)) ** 0.5))
        if not sides or components(region).max() > 1:
            return super()._in_order(region)
        columns = bool((np.diff(straight_strips(region), axis=1)[..., 0] != 0).any())
        divisions = (runs_in, straight_strips) if columns else (runs_in,)
        detours = detours_of(region)
        padded, candidates = np.pad(region, 2), list[tuple[float, int, list[Cells]]]()
        for lane, bends, inner in _likely_lanes(region, sides):
            for divide in divisions:
                ends = divide(inner)
                if len(ends) >= MOST_RUNS:
                    return super()._in_order(region)
                strips = [lane, *map(cells_of_strip, ends)]
                turns = 2 * len(strips) + bends + _slanted_ends(padded, ends)
                length = _length(join_strips(strips, detours, self.turn, 0))
                candidates.append((length + self.turn * turns, len(candidates), strips))
        if not candidates:
            return super()._in_order(region)
        return np.concatenate(
            join_strips(min(candidates)[2], detours, self.turn, self.disturbances)
        )


def _length(tour: list[Cells]) -> float:
    cells = np.concatenate(tour)
    return float(np.hypot(*(np.roll(cells, -1, axis=0) - cells).T).sum())


def _slanted_ends(inside: NDArray[np.bool_], ends: NDArray[np.int64]) -> int:
    """Return the number of ends of strips, of shape (n, 2, 2), at a border that is slanted by less
    than 45 degrees to them, where a path without a lane must follow the border.

    The mask ``inside`` has two more rows and columns on each side of the region.
    """
    at, ahead = ends + 2, np.sign(ends - ends[:, ::-1])
    side = ahead[..., ::-1]

    def differs(steps: int) -> NDArray[np.bool_]:
        left_cells, right_cells = at + side + steps * ahead, at - side + steps * ahead
        return np.asarray(
            inside[left_cells[..., 0], left_cells[..., 1]]
            != inside[right_cells[..., 0], right_cells[..., 1]]
        )

    beyond = at + ahead
    open_ends = ahead.any(axis=-1) & ~inside[beyond[..., 0], beyond[..., 1]]
    return int((open_ends & (differs(2) | differs(-1))).sum())


def _likely_lanes(
    region: NDArray[np.bool_], sides: int
) -> list[tuple[Cells, int, NDArray[np.bool_]]]:
    """Return the lanes with the fewest turns of all rows, with the number of their bends and the
    cells beside them.
    """
    padded, ranked = np.pad(region, 2), list[tuple[int, int, Cells, int, NDArray[np.bool_]]]()
    for lane, bends in _lanes(region, sides):
        inner = region.copy()
        inner[tuple(lane.T)] = False
        rows = runs_in(inner)
        turns = 2 * len(rows) + bends + _slanted_ends(padded, rows)
        ranked.append((turns, len(ranked), lane, bends, inner))
    ranked.sort(key=lambda entry: entry[:2])
    return [(lane, bends, inner) for *_, lane, bends, inner in ranked[:_LANES]]


def _lanes(region: NDArray[np.bool_], sides: int) -> list[tuple[Cells, int]]:
    """Return lanes along the outer border of a region: their cells, int64, shape (k, 2), and the
    number of their bends. Each begins and ends with one of the ``sides`` longest sides.
    """
    import shapely

    loop = border_of(region)
    if len(loop) < 4:
        return []
    middle = loop.mean(axis=0)
    loop = np.roll(loop, -int(((loop - middle) ** 2).sum(axis=1).argmax()), axis=0)
    line = shapely.linestrings(np.vstack([loop, loop[:1]]))
    vertices = shapely.get_coordinates(shapely.simplify(line, _STRAIGHT))[:-1].astype(np.int64)
    at, corners = 0, []
    for corner in vertices:
        at += int(np.flatnonzero((loop[at:] == corner).all(axis=1))[0])
        corners.append(at)
    longest = np.sort(np.argsort(-np.diff([*corners, len(loop)]), kind="stable")[:sides])
    lanes = []
    for first, count in product(longest.tolist(), range(1, len(corners))):
        last = (first + count) % len(corners)
        if (last - 1) % len(corners) in longest:
            begin, end = corners[first], corners[last]
            lane = (
                loop[begin : end + 1] if begin < end else np.vstack([loop[begin:], loop[: end + 1]])
            )
            lanes.append((_without_repeats(lane), count - 1))
    return lanes


def _without_repeats(lane: Cells) -> Cells:
    return lane[np.sort(np.unique(lane, axis=0, return_index=True)[1])]


def border_of(region: NDArray[np.bool_]) -> Cells:
    """Return the cells on the outer border of a connected region, clockwise from its first cell;
    int64, shape (k, 2). A cell of a narrow part occurs more than once.
    """
    padded = np.pad(region, 1)
    start = tuple((np.argwhere(padded)[0]).tolist())
    cell, heading, loop = start, 0, [start]
    begun = None
    while True:
        for turn in range(8):  # from the left of the last step, so that the border stays there
            ahead = (heading + 5 + turn) % 8
            neighbour = cell[0] + _ROUND[ahead][0], cell[1] + _ROUND[ahead][1]
            if padded[neighbour]:
                break
        else:
            break  # a single cell
        if begun == (cell, ahead):
            loop.pop()
            break
        begun = (cell, ahead) if begun is None else begun
        cell, heading = neighbour, ahead
        loop.append(cell)
    return np.array(loop, dtype=np.int64) - 1
