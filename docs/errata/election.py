"""The algorithm elect-particle as printed in paper M and as corrected, on plain sets of cells,
without Shoal's own policies.
"""

from __future__ import annotations

import random
from dataclasses import dataclass

Cell = tuple[int, int]
STEPS = ((0, -1), (-1, 0), (0, 1), (1, 0))  # l, u, r, d


def _next(cell: Cell, step: Cell) -> Cell:
    return cell[0] + step[0], cell[1] + step[1]


@dataclass(frozen=True)
class FreeCells:
    """The free cells of a map, each as (row, column)."""

    free: frozenset[Cell]

    @classmethod
    def of(cls, name: str) -> FreeCells:
        """Return the free cells of the generated map with a given name."""
        from shoal.swarm.maps.files import open_map

        return cls(frozenset((int(row), int(column)) for row, column in open_map(name).cells))

    def moved(self, particles: frozenset[Cell], step: Cell) -> dict[Cell, Cell]:
        """Return a dictionary that maps each particle's cell to its cell after one step under the
        move rule block.
        """
        stays: set[Cell] = set()
        to: dict[Cell, Cell] = {}
        for cell in sorted(particles, key=lambda c: -(c[0] * step[0] + c[1] * step[1])):
            ahead = _next(cell, step)
            to[cell] = cell if ahead not in self.free or ahead in stays else ahead
            if to[cell] == cell:
                stays.add(cell)
        return to


def _path(sources: list[Cell], opened: frozenset[Cell], frontier: set[Cell]) -> list[Cell]:
    """Return the steps of a shortest path from any source cell to a frontier cell, through cells
    that are known to be free.
    """
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


def plays(
    ground: FreeCells,
    seed: int,
    *,
    particles: int = 20,
    whole: bool = False,
    handover: bool = False,
) -> bool:
    """Return whether an episode of elect-particle ends. If a state repeats, the episode never ends.

    Only the start is random, so an episode with a repeated state repeats its moves for ever. With
    ``whole``, the elected particle follows each path to the end of the path. Without ``whole``, the
    algorithm makes a new path at every move. With ``handover``, a particle that blocks the elected
    particle becomes the elected particle.
    """
    rng = random.Random(seed)
    places = frozenset(rng.sample(sorted(ground.free), particles))
    elected = rng.choice(sorted(places))
    opened, walls = places, frozenset[Cell]()
    plan: list[Cell] = []
    seen: set[tuple[frozenset[Cell], Cell, tuple[Cell, ...]]] = set()
    while True:
        known = opened | walls
        frontier = {
            there for cell in opened for step in STEPS if (there := _next(cell, step)) not in known
        }
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
        if tried:  # the set of known cells has grown, so no earlier state can repeat
            seen.clear()
