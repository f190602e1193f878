"""The best competitive ratio for the exploration of regions without holes, by a search over all
strategies and regions.

The explorer (paper M, section III.B.1) starts in a cell of an unknown region. The explorer sees
which neighbours of its cell are free. The explorer must visit all cells of the region and return to
the start. The competitive ratio is the length of the explorer's tour, divided by the length of a
shortest closed tour through all cells of the region.
"""

from __future__ import annotations

from dataclasses import dataclass, field

Cell = tuple[int, int]
Region = frozenset[Cell]
START = (0, 0)


def _beside(cell: Cell) -> list[Cell]:
    row, column = cell
    return [(row, column - 1), (row - 1, column), (row, column + 1), (row + 1, column)]


def family(most: int) -> list[tuple[Region, int]]:
    """Return all regions without holes of at most ``most`` cells, each with the length of a
    shortest closed tour.

    The list contains each region once for each start cell, shifted so that the start cell lies at
    `START`.
    """
    level = {frozenset([START])}
    regions = []
    for size in range(most):
        for region in sorted(level, key=sorted):
            if _is_simple(region):
                best = _shortest(region)  # the length of a closed tour does not depend on its start
                regions += [(_from(region, start), best) for start in sorted(region)]
        if size + 1 < most:
            level = {
                _from(grown := region | {there}, min(grown))
                for region in level
                for cell in region
                for there in _beside(cell)
                if there not in region
            }
    return regions


def _from(region: Region, start: Cell) -> Region:
    """Return a region, shifted so that the cell ``start`` lies at `START`."""
    return frozenset((row - start[0], column - start[1]) for row, column in region)


def _is_simple(region: Region) -> bool:
    """Return whether a region has no holes: all cells around the region are connected by sides or
    corners.
    """
    rows, columns = zip(*region, strict=True)
    around = {
        (r, c)
        for r in range(min(rows) - 1, max(rows) + 2)
        for c in range(min(columns) - 1, max(columns) + 2)
    } - region
    queue = [min(around)]
    found = {queue[0]}
    for row, column in queue:
        for there in ((row + r, column + c) for r in (-1, 0, 1) for c in (-1, 0, 1)):
            if there in around and there not in found:
                found.add(there)
                queue.append(there)
    return len(found) == len(around)


def _shortest(region: Region) -> int:
    """Return the length of a shortest closed tour through all cells of a region, in moves."""
    states, steps = {(START, frozenset([START]))}, 0
    seen = set(states)
    while (START, region) not in states:
        steps += 1
        states = {
            (there, visited | {there})
            for cell, visited in states
            for there in _beside(cell)
            if there in region
        } - seen
        seen |= states
    return steps


def guaranteed(regions: list[tuple[Region, int]], over: int, under: int) -> bool:
    """Return whether one strategy explores every region with at most ``over / under`` times the
    length of a shortest tour.
    """
    limits = [best * over // under for _, best in regions]
    game = _Game([region for region, _ in regions], limits)
    return game.kept(tuple(range(len(regions))), frozenset([START]), START, 0)


@dataclass
class _Game:
    """A game between an explorer and an opponent.

    In each turn, the explorer chooses a cell that it has seen but not visited, and moves to this
    cell on a shortest path through seen cells. The opponent chooses the region, among all regions
    that agree with the cells seen so far.
    """

    regions: list[Region]
    limits: list[int]
    known: dict[tuple[tuple[int, ...], frozenset[Cell], Cell], tuple[int, int]] = field(
        default_factory=dict
    )

    def kept(
        self, possible: tuple[int, ...], visited: frozenset[Cell], cell: Cell, steps: int
    ) -> bool:
        """Return whether an explorer that enters a cell can keep the limits on moves, whichever
        neighbours of the cell are free.
        """
        answers: dict[tuple[bool, ...], list[int]] = {}
        for number in possible:
            answers.setdefault(
                tuple(there in self.regions[number] for there in _beside(cell)), []
            ).append(number)
        return all(self._kept(tuple(left), visited, cell, steps) for left in answers.values())

    def _kept(
        self, possible: tuple[int, ...], visited: frozenset[Cell], cell: Cell, steps: int
    ) -> bool:
        most_kept, least_lost = self.known.get((possible, visited, cell), (-1, 1 << 30))
        if steps <= most_kept or steps >= least_lost:
            return steps <= most_kept
        seen = {
            there for one in visited for there in _beside(one) if there in self.regions[possible[0]]
        } | visited
        ways = _ways(cell, seen)
        targets = sorted(seen - visited, key=lambda there: (ways[there], there))
        if targets:
            most = max(self.limits[number] for number in possible)
            found = any(
                steps + ways[there] + abs(there[0]) + abs(there[1]) <= most
                and self.kept(possible, visited | {there}, there, steps + ways[there])
                for there in targets
            )
        else:
            found = all(steps + ways[START] <= self.limits[number] for number in possible)
        self.known[possible, visited, cell] = (steps, least_lost) if found else (most_kept, steps)
        return found


def _ways(cell: Cell, seen: set[Cell]) -> dict[Cell, int]:
    """Return the distance in moves from a cell to each seen cell, along paths through
    seen cells.
    """
    ways, queue = {cell: 0}, [cell]
    for here in queue:
        for there in _beside(here):
            if there in seen and there not in ways:
                ways[there] = ways[here] + 1
                queue.append(there)
    return ways
