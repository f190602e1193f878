"""elect-particle cell by cell, as paper M prints it and as it must be: sets of cells, and nothing of the package's own policies."""

from __future__ import annotations

import random
from dataclasses import dataclass

Cell = tuple[int, int]
STEPS = ((0, -1), (-1, 0), (0, 1), (1, 0))  # l, u, r, d


def _next(cell: Cell, step: Cell) -> Cell:
    return cell[0] + step[0], cell[1] + step[1]


@dataclass(frozen=True)
class FreeCells:
    """The free cells of a map, (row, column)."""

    free: frozenset[Cell]

    @classmethod
    def of(cls, name: str) -> FreeCells:
        """Return those of a generated map."""
        from shoal.swarm.maps.open import open_map

        return cls(frozenset((int(row), int(column)) for row, column in open_map(name).cells))

    def moved(self, particles: frozenset[Cell], step: Cell) -> dict[Cell, Cell]:
        """Return where each particle goes: those ahead first, so that a train moves together and a queue stays."""
        stays: set[Cell] = set()
        to: dict[Cell, Cell] = {}
        for cell in sorted(particles, key=lambda c: -(c[0] * step[0] + c[1] * step[1])):
            ahead = _next(cell, step)
            to[cell] = cell if ahead not in self.free or ahead in stays else ahead
            if to[cell] == cell:
                stays.add(cell)
        return to


def _path(sources: list[Cell], opened: frozenset[Cell], frontier: set[Cell]) -> list[Cell]:
    """Return the steps from the nearest source to the nearest frontier cell, through cells known to be free."""
    came: dict[Cell, tuple[Cell, Cell] | None] = dict.fromkeys(sources)
    queue = list(sources)
    for cell in queue:
        for step in STEPS:
            there = _next(cell, step)
            if there in came:
                continue
            came[there] = (cell, step)
            if there in frontier:
                steps: list[Cell] = []
                link = came[there]
                while link is not None:
                    steps.append(link[1])
                    link = came[link[0]]
                return steps[::-1]
            if there in opened:
                queue.append(there)
    return []


def plays(ground: FreeCells, seed: int, *, particles: int = 20, whole: bool = False, handover: bool = False) -> bool:
    """Tell whether an episode of elect-particle ends; if a state comes again it never does, as nothing is random after the start.

    With ``whole`` the elected particle's path is played to its end before another is made, else one is made at every move; with
    ``handover`` a particle that stands where the elected one should be becomes the elected one.
    """
    rng = random.Random(seed)
    places = frozenset(rng.sample(sorted(ground.free), particles))
    elected = rng.choice(sorted(places))
    opened, walls = places, frozenset[Cell]()
    plan: list[Cell] = []
    seen: set[tuple[frozenset[Cell], Cell, tuple[Cell, ...]]] = set()
    while True:
        known = opened | walls
        frontier = {there for cell in opened for step in STEPS if (there := _next(cell, step)) not in known}
        if not frontier:
            return True
        if not plan or not whole:
            plan = _path([elected], opened, frontier)
        if (places, elected, tuple(plan)) in seen:
            return False
        seen.add((places, elected, tuple(plan)))
        step, plan = plan[0], plan[1:]
        to = ground.moved(places, step)
        tried = {_next(cell, step) for cell in places} - known
        places = frozenset(to.values())
        wanted = _next(elected, step)
        elected = wanted if handover and wanted in places else to[elected]
        opened, walls = opened | (tried & places), walls | (tried - places)
        if tried:  # what is known has grown: no state from before can come again
            seen.clear()
