"""Which competitive ratio an explorer of regions without holes can keep: a search through all that it may do and may meet.

The explorer of section III.B.1 of paper M: it starts in a cell, sees which neighbours of its cell are free, must visit all cells
and come back. Its tour is compared with the shortest one of somebody who knows the region.
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
    """Return all regions without holes of up to so many cells around each start, with the length of the shortest closed tour."""
    level = {frozenset([START])}
    regions = []
    for size in range(most):
        for region in sorted(level, key=sorted):
            if _is_simple(region):
                best = _shortest(region)  # a closed tour is as long from whichever cell it starts
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
    """Return a region, moved so that a cell of it comes to lie at `START`."""
    return frozenset((row - start[0], column - start[1]) for row, column in region)


def _is_simple(region: Region) -> bool:
    """Tell whether all cells around a region hang together, corners included."""
    rows, columns = zip(*region, strict=True)
    around = {(r, c) for r in range(min(rows) - 1, max(rows) + 2) for c in range(min(columns) - 1, max(columns) + 2)} - region
    queue = [min(around)]
    found = {queue[0]}
    for row, column in queue:
        for there in ((row + r, column + c) for r in (-1, 0, 1) for c in (-1, 0, 1)):
            if there in around and there not in found:
                found.add(there)
                queue.append(there)
    return len(found) == len(around)


def _shortest(region: Region) -> int:
    """Return the length of the shortest closed tour of all cells."""
    states, steps = {(START, frozenset([START]))}, 0
    seen = set(states)
    while (START, region) not in states:
        steps += 1
        states = {(there, visited | {there}) for cell, visited in states for there in _beside(cell) if there in region} - seen
        seen |= states
    return steps


def guaranteed(regions: list[tuple[Region, int]], over: int, under: int) -> bool:
    """Tell whether some way to explore makes at most ``over / under`` of the shortest tour on every region."""
    limits = [best * over // under for _, best in regions]
    game = _Game([region for region, _ in regions], limits)
    return game.kept(tuple(range(len(regions))), frozenset([START]), START, 0)


@dataclass
class _Game:
    """The explorer against all regions that agree with what it has seen.

    Each of its choices is a cell that it has seen and not visited, reached by a shortest way through cells that it knows.
    """

    regions: list[Region]
    limits: list[int]
    known: dict[tuple[tuple[int, ...], frozenset[Cell], Cell], tuple[int, int]] = field(default_factory=dict)

    def kept(self, possible: tuple[int, ...], visited: frozenset[Cell], cell: Cell, steps: int) -> bool:
        """Tell whether the limits can be kept by an explorer that enters a cell, for each thing that it may see there."""
        answers: dict[tuple[bool, ...], list[int]] = {}
        for number in possible:
            answers.setdefault(tuple(there in self.regions[number] for there in _beside(cell)), []).append(number)
        return all(self._kept(tuple(left), visited, cell, steps) for left in answers.values())

    def _kept(self, possible: tuple[int, ...], visited: frozenset[Cell], cell: Cell, steps: int) -> bool:
        most_kept, least_lost = self.known.get((possible, visited, cell), (-1, 1 << 30))
        if steps <= most_kept or steps >= least_lost:
            return steps <= most_kept
        seen = {there for one in visited for there in _beside(one) if there in self.regions[possible[0]]} | visited
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
    """Return how far it is to each cell that has been seen, through such cells."""
    ways, queue = {cell: 0}, [cell]
    for here in queue:
        for there in _beside(here):
            if there in seen and there not in ways:
                ways[there] = ways[here] + 1
                queue.append(there)
    return ways
