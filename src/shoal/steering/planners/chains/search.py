"""The shortest chains of up to three cycles, by branch and bound (flat walls) or from many initial guesses (round wall)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from math import inf, pi

import numpy as np
from numpy.typing import NDArray

from shoal.steering.planners.chains.chain import REFINING, ROOM, Chain, ChainQuery
from shoal.steering.planners.chains.kinds import kinds_of
from shoal.steering.planners.chains.sides import between_few_sides, on_all_sides, slid

_POLISHED = 8  # number of rough chains over a circle that are refined


def shortest_chain(query: ChainQuery, *, cycles: tuple[int, ...] = (1, 2, 3), first_found: bool = False) -> Chain | None:
    """Return the shortest chain of wall contacts with one of the given numbers of cycles, or None if no chain is found.

    Parameters
    ----------
    query : ChainQuery
    cycles : tuple of int
        Numbers of cycles to try, in the order of the search.
    first_found : bool
        Whether the search stops at the first number of cycles for which it finds a chain.

    Notes
    -----
    On flat walls, the search is a branch and bound over all sequences of touching particles and walls. Each sequence gives a convex
    optimization problem. On a round wall, the search refines the best of many initial guesses.
    """
    best: Chain | None = None
    for number in cycles:
        for found in chains_of(query, number, inf if best is None else best.length):
            best = found
        if first_found and best is not None:
            break
    return best


def chains_of(query: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield increasingly short chains with the given number of cycles, all shorter than ``bound``."""
    if not query.walls.round:
        few = between_few_sides(query)
        yield from _flat(query, cycles, bound) if few is query else _many_sided(query, few, cycles, bound)
        return
    for found in _round(query, cycles, bound):
        bound = found.length
        yield found
    if len(query.walls.normals) and (cycles <= 2 or bound == inf):  # the end caps of a cylinder
        yield from _capped(query, cycles, bound)


def _many_sided(query: ChainQuery, few: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield increasingly short chains on the flat walls of a polygon, made from chains on a few of these walls."""
    for rough in _flat(few, cycles, 1.1 * bound):
        guess = on_all_sides(query, few, rough)
        length = query.settle(guess.unknowns, guess.touchers, guess.walls, rounds=REFINING[:3])
        if length < inf:
            found = slid(query, replace(guess, length=length))
            if found.length < bound:
                bound = found.length
                yield found


def _flat(query: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield increasingly short chains with contacts on flat walls only."""
    touchers, on, bounds = kinds_of(query.start, query.goal, query.walls, cycles=cycles, push=query.push, bound=bound)
    for kind, least in enumerate(bounds):
        if least >= bound - 1e-9 or query.late:
            break
        guess = query.guess(cycles)
        length = query.settle(guess, touchers[kind], on[kind], bound=bound)
        if length < bound:
            bound = length
            yield Chain(touchers[kind], on[kind], guess, length)


def _round(query: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield increasingly short chains with contacts on a round wall."""
    firsts = list(_guesses(query, cycles))
    rough: list[tuple[float, int, NDArray[np.int64], NDArray[np.float64]]] = []
    met: set[tuple[float, ...]] = set()
    on = np.full(cycles, len(query.walls.normals))
    d = query.walls.dimensions
    for kind in product((0, 1), repeat=cycles):
        touchers = np.array(kind, dtype=np.int64)
        if query.late or query.bounds_of(touchers[None], on[None])[0] >= bound:
            continue
        for first in firsts:
            guess = first.copy()
            # Every effect of a contact of particle 1 can also be achieved by particle 2 on the opposite side.
            guess[: cycles * (d - 1) : d - 1] += pi * query.walls.circle[2] * touchers
            length = query.settle(guess, touchers, on, enough=ROOM, rounds=REFINING[:1])
            place = (*kind, *np.round(guess, 2).tolist())
            if length < inf and place not in met:
                met.add(place)
                length = query.settle(guess, touchers, on, enough=ROOM, rounds=REFINING[1:2])
                rough.append((length, len(rough), touchers, guess))
    last, polished = -1.0, 0
    for length, _, touchers, guess in sorted(rough, key=lambda entry: entry[:2]):
        if length == inf or polished == _POLISHED:
            break
        if length - last < 1e-5:  # the same chain again
            continue
        last, polished = length, polished + 1
        found = query.settle(guess, touchers, on, enough=ROOM)
        if found < bound:
            bound = found
            yield Chain(touchers, on, guess, found)


def _capped(query: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield increasingly short chains in a cylinder, each with a contact on at least one end cap."""
    caps = len(query.walls.normals)
    radius, d = query.walls.circle[2], query.walls.dimensions
    for on in product(range(caps + 1), repeat=cycles):
        if all(wall == caps for wall in on):
            continue
        rounds = [m for m, wall in enumerate(on) if wall == caps]
        for kind in product((0, 1), repeat=cycles):
            touchers, walls = np.array(kind, dtype=np.int64), np.array(on, dtype=np.int64)
            if query.late or query.bounds_of(touchers[None], walls[None])[0] >= bound:
                continue
            for angles in product(np.arange(5) * 2 * pi / 5, repeat=len(rounds)):
                guess = query.guess(cycles)
                for m, angle in zip(rounds, angles, strict=True):
                    guess[m * (d - 1)], guess[m * (d - 1) + 1] = radius * angle, query.walls.height / 2
                length = query.settle(guess, touchers, walls, enough=ROOM, rounds=REFINING[:4])
                if length < bound:
                    bound = length
                    yield Chain(touchers, walls, guess, length)


def _guesses(query: ChainQuery, cycles: int) -> Iterator[NDArray[np.float64]]:
    """Yield the unknowns of feasible chains in which only particle 1 touches a round wall, with contacts all around the circle."""
    walls, d = query.walls, query.walls.dimensions
    radius = walls.circle[2]
    ends = {1: 9, 2: 7, 3: 3}.get(cycles, 2)
    arcs = []
    for delta in (query.before, query.after):
        half = np.arccos(min(1.0, float(np.hypot(*delta[:2])) / (2 * radius)))
        arcs.append(np.arctan2(-delta[1], -delta[0]) + 0.96 * half * np.linspace(-1, 1, ends))
    between = [np.arange(6) * pi / 3] * (cycles - 2)
    touchers, on = np.zeros(cycles, dtype=np.int64), np.full(cycles, len(walls.normals))
    for angles in product(arcs[0], *between, *([arcs[1]] if cycles > 1 else [])):
        guess = query.guess(cycles)
        guess[: cycles * (d - 1) : d - 1] = radius * np.array(angles)
        if d == 3:
            guess[1 : cycles * (d - 1) : d - 1] = walls.height / 2
        if query.settle(guess, touchers, on, enough=ROOM, rounds=REFINING[:0]) < inf:
            yield guess
