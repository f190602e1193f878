"""Chains of contacts: the shortest of up to so many cycles."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import product
from math import inf, pi

import numpy as np
from numpy.typing import NDArray

from shoal.steering.kernels.chain import first_guess, settle
from shoal.steering.kernels.chain_kinds import bound_of, kinds_of, reflected_lengths
from shoal.steering.kernels.chain_limits import Kind, new_place, put
from shoal.steering.kernels.cycles import CycleModel
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.normalized_walls import NormalizedWalls

MARGIN = 1e-8  # of the size: how far the other particle stays off the walls
ENOUGH = 1e-7  # how far inside of all limits a first guess is sought on flat walls
ROOM = 1e-4  # and on a circle
REFINING = np.array([20.0 * 12.0**k for k in range(8)])
_POLISHED = 8  # rough chains over a circle that are worth it
_DEEPEST = 12  # cycles of a chain that is only refined


@dataclass(frozen=True, eq=False)
class Chain:
    """Cycles of contact and adjustment, in the units of `NormalizedWalls`.

    Parameters
    ----------
    touchers : ndarray of int64, shape (cycles,)
        0 or 1: which particle each cycle holds.
    walls : ndarray of int64, shape (cycles,)
        Which wall holds it.
    unknowns : ndarray of float64, shape (cycles (d - 1) + (cycles - 1) d,)
        Contacts along their walls, and the differences between cycles.
    length : float
    last : ndarray of float64, shape (d,), optional
        Δ at the end, if it is not the goal's.
    """

    touchers: NDArray[np.int64]
    walls: NDArray[np.int64]
    unknowns: NDArray[np.float64]
    length: float
    last: Points | None = None

    @property
    def cycles(self) -> int:
        """How many contacts there are."""
        return len(self.walls)

    def contacts(self, walls: NormalizedWalls) -> Points:
        """Return where the contacts lie; float64, shape (cycles, d)."""
        nowhere = np.zeros((2, walls.dimensions))
        place = new_place(self.cycles, walls.dimensions)
        put(self.unknowns, Kind(self.touchers, self.walls, nowhere, nowhere, walls.shape, inf, 0.0, 0.0), place)
        return np.asarray(place.contacts[:, 0])

    def differences(self, before: Points, after: Points) -> Points:
        """Return Δ at the start and after each cycle; float64, shape (cycles + 1, d)."""
        d = len(before)
        between = self.unknowns[self.cycles * (d - 1) :].reshape(-1, d)
        return np.concatenate([before[None], between, (after if self.last is None else self.last)[None]])


@dataclass(frozen=True, eq=False)
class ChainQuery:
    """From where to where, between which walls, and how slippery they are; in the units of `NormalizedWalls`.

    Parameters
    ----------
    walls : NormalizedWalls
    start, goal : ndarray of float64, shape (2, d)
    friction : float
        Coefficient of friction; infinite where nothing that is pushed into a wall slides.
    margin : float
        How far the other particle stays off the walls.
    push : float
        How much each adjustment goes into the wall.
    rounds : ndarray of float64
        Sharpness of the rounds by which a chain is made short; few and low ones leave it far from all limits.
    deadline : float
        When to stop the search, by `time.monotonic`.
    """

    walls: NormalizedWalls
    start: Points
    goal: Points
    friction: float = inf
    margin: float = MARGIN
    push: float = 1e-9
    rounds: NDArray[np.float64] = field(default_factory=lambda: REFINING)
    deadline: float = inf

    @property
    def late(self) -> bool:
        """Whether the time is used up."""
        return time.monotonic() > self.deadline

    @property
    def before(self) -> Points:
        """Δ at the start."""
        return np.asarray(self.start[1] - self.start[0])

    @property
    def after(self) -> Points:
        """Δ at the goal."""
        return np.asarray(self.goal[1] - self.goal[0])

    def model(self, inside: float = 1.0) -> CycleModel:
        """Return what the kernels of cycles take, margin and push times a number."""
        walls = self.walls
        return CycleModel(
            walls.frames, walls.reaches, walls.normals, walls.offsets, walls.circle, self.friction, self.margin * inside,
            self.push * inside,
        )  # fmt: skip

    def flat(self) -> ChainQuery:
        """Return the same in the plane, without heights."""
        assert self.walls.base is not None
        return replace(self, walls=self.walls.base, start=self.start[:, :2].copy(), goal=self.goal[:, :2].copy())

    def settle(
        self,
        guess: NDArray[np.float64],
        touchers: NDArray[np.int64],
        on: NDArray[np.int64],
        *,
        enough: float = ENOUGH,
        rounds: NDArray[np.float64] | None = None,
        bound: float = inf,
    ) -> float:
        """Make a guess allowed and short, in place; return its length, infinite if that cannot be."""
        kind = Kind(touchers, on, self.start, self.goal, self.walls.shape, self.friction, self.margin, self.push)
        return float(settle(guess, enough, self.rounds if rounds is None else rounds, bound, kind))

    @property
    def lengths_over_walls(self) -> NDArray[np.float64]:
        """Each particle's shortest way to its goal over each wall; shape (2, walls + 1)."""
        return np.asarray(reflected_lengths(self.start, self.goal, self.walls.shape))

    def guess(self, cycles: int) -> NDArray[np.float64]:
        """Return the middles of walls and differences on half of the straight way."""
        return first_guess(self.start, self.goal, cycles)


def shortest_chain(query: ChainQuery, *, cycles: tuple[int, ...] = (1, 2, 3), first_found: bool = False) -> Chain | None:
    """Return the shortest chain of one of the given numbers of cycles, None if there is none.

    Parameters
    ----------
    query : ChainQuery
    cycles : tuple of int
        Numbers of cycles, in the order in which they are tried.
    first_found : bool
        Stop with the first number of cycles that has a chain.

    Notes
    -----
    On flat walls branch and bound over all kinds of chains, each of which is a convex problem. On a round wall the best of many
    first guesses, refined.
    """
    best: Chain | None = None
    for number in cycles:
        for found in chains_of(query, number, inf if best is None else best.length):
            best = found
        if first_found and best is not None:
            break
    return best


def chains_of(query: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield ever shorter chains of so many cycles, all shorter than the bound."""
    if not query.walls.round:
        yield from _flat(query, cycles, bound)
        return
    for found in _round(query, cycles, bound):
        bound = found.length
        yield found
    if len(query.walls.normals) and (cycles <= 2 or bound == inf):  # the caps of a cylinder
        yield from _capped(query, cycles, bound)


def _flat(query: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield ever shorter chains over flat walls only."""
    walls = query.walls
    touchers, on, bounds = kinds_of(
        cycles, query.start, query.goal, walls.reaches, walls.shape, query.push, bound, query.lengths_over_walls
    )
    for kind, least in enumerate(bounds):
        if least >= bound - 1e-9 or query.late:
            break
        guess = query.guess(cycles)
        length = query.settle(guess, touchers[kind], on[kind], bound=bound)
        if length < bound:
            bound = length
            yield Chain(touchers[kind], on[kind], guess, length)


def _round(query: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield ever shorter chains with a round wall."""
    firsts = list(_guesses(query, cycles))
    lengths = query.lengths_over_walls
    rough: list[tuple[float, int, NDArray[np.int64], NDArray[np.float64]]] = []
    met: set[tuple[float, ...]] = set()
    on = np.full(cycles, len(query.walls.normals))
    d = query.walls.dimensions
    for kind in product((0, 1), repeat=cycles):
        touchers = np.array(kind, dtype=np.int64)
        if query.late or bound_of(touchers, on, query.start, query.goal, lengths, query.walls.shape) >= bound:
            continue
        for first in firsts:
            guess = first.copy()
            # What particle 1 does by touching, particle 2 does by touching opposite.
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
        if length - last < 1e-5:  # the same again
            continue
        last, polished = length, polished + 1
        found = query.settle(guess, touchers, on, enough=ROOM)
        if found < bound:
            bound = found
            yield Chain(touchers, on, guess, found)


def _capped(query: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield ever shorter chains in a cylinder with an end cap among the walls."""
    caps, lengths = len(query.walls.normals), query.lengths_over_walls
    radius, d = query.walls.circle[2], query.walls.dimensions
    for on in product(range(caps + 1), repeat=cycles):
        if all(wall == caps for wall in on):
            continue
        rounds = [m for m, wall in enumerate(on) if wall == caps]
        for kind in product((0, 1), repeat=cycles):
            touchers, walls = np.array(kind, dtype=np.int64), np.array(on, dtype=np.int64)
            if bound_of(touchers, walls, query.start, query.goal, lengths, query.walls.shape) >= bound or query.late:
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
    """Yield chains of contacts of particle 1 over a round wall, from angles all around, that hold all limits."""
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


def refined(query: ChainQuery, chain: Chain) -> Chain:
    """Return a chain of the same kind made as short as can be; the same one if that fails or it is very long."""
    if chain.cycles > _DEEPEST:
        return chain
    if chain.last is not None:  # aim at what it reaches
        off = (chain.last - query.after) / 2
        query = replace(query, goal=query.goal + np.stack([-off, off]))
    guess = chain.unknowns.copy()
    length = query.settle(guess, chain.touchers, chain.walls)
    return replace(chain, unknowns=guess, length=length) if length < inf else chain
