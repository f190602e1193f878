"""Improvement of chains of wall contacts: insert a cycle, remove a cycle or exchange a touching
particle.

Chains with more than three cycles have too many kinds (sequences of touching particles and walls)
for an exhaustive search. The planner finds long chains by inserting cycles into shorter chains.
Some of the shortest plans are long chains that alternate between the two walls of a corner, or that
follow a wall in small steps.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import field
from math import inf, pi
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.steering.planners.chain_search import chains_of
from shoal.steering.planners.chains import (
    ENOUGH,
    MANY,
    REFINING,
    ROOM,
    Chain,
    ChainQuery,
    feasible_sides,
    refine_chain,
    restore_sides,
    round_query,
    slide_contacts,
)
from shoal.steering.workspaces.convex import Points

_Item = TypeVar("_Item")

CYCLES = (1, 2, 3)  # numbers of cycles of the chains of which all kinds are tried
# flat walls up to which all kinds of one cycle more are tried: the shortest plan may have a chain of
# four that no insertion reaches (in a square 2.6 % shorter, in a pentagon 5 %)
FEW = 6
GROWING = (4, 5)  # numbers of cycles that are tried in a disk without a chain that can be changed
MOST_CYCLES = 8
SLACK = 1.2  # relative to the shortest length: longer chains are dropped
WIDTH = 8  # number of chains that are changed
TRIES = 90  # number of changed chains
# of them before chains of three cycles: with the clearance, a changed chain of two cycles may give a
# plan 12 % shorter (test_the_clearance_does_not_make_plans_needlessly_longer, 5 sides)
EARLY = 30
# a contact that slides along a round wall is a chain of many contacts; a chain of greedy with that
# many can be changed, without 4 s for all kinds of `GROWING`
ROUND_CYCLES = 16
# with more time, for example that of a certificate: on some disks, plans are 2 % shorter
WIDE_WIDTH, WIDE_TRIES = 16, 400
# contacts of a chain to which contacts between others are added: 20 moves of 24 contacts leave room
# for as many between them in the 100 moves of a plan
MOST_SLIDING = 24
# relative to the shortest length: short chains up to this length are also starting points
NEARLY = 1.1
EACH = 30  # number of candidates made from one chain
_WORTH = 1e-4  # relative to the length: gain that justifies one more cycle
# the same for a contact between others, each of which takes some milliseconds to try
_WORTH_SLIDING = 5e-4
_NEAR = 1.05  # relative to the length: first guesses that are longer are dropped
# relative to the length: among chains that differ by less, the one with fewer cycles is kept
_SAME = 2e-4
# relative to the shortest length: a changed chain up to this length is refined before it is
# compared, because a first guess may be 0.5 % too long
_CLOSE = 1.01
_ROUGH, _FINE = REFINING[:3], REFINING[3:6]
_ROUGH_ROUND = REFINING[:4]


@dataclass
class ChainPool:
    """The shortest chains of wall contacts that a search has found so far."""

    query: ChainQuery
    fine: bool = True  # whether changed chains that are nearly the shortest are refined
    width: int = WIDTH
    most: int = MOST_CYCLES
    chains: list[Chain] = field(default_factory=list)
    _tried: set[tuple[object, ...]] = field(default_factory=set)
    # keep a reference, so that the id is not used again
    _expanded: dict[int, Chain] = field(default_factory=dict)

    @property
    def best(self) -> Chain | None:
        """The shortest chain of the pool, or None if the pool is empty.

        Among chains of almost the same length, `best` is the chain with the fewest cycles.
        """
        return self.chains[0] if self.chains else None

    @property
    def bound(self) -> float:
        """The chain length above which the pool accepts no chain."""
        if not self.chains:
            return inf
        return min(
            self.chains[-1].length if len(self.chains) >= self.width else inf,
            SLACK * self.chains[0].length,
        )

    def add(self, chain: Chain) -> bool:
        """Add a chain to the pool, and return whether the pool accepted the chain.

        The pool refuses a chain that is longer than `bound`, and a chain that is about as long as a
        chain of the pool but does not have fewer cycles.
        """
        alike = [
            other
            for other in self.chains
            if abs(chain.length - other.length) < _SAME * other.length
        ]
        if not chain.length < self.bound or any(other.cycles <= chain.cycles for other in alike):
            return False
        self.chains = [
            other for other in self.chains if other not in alike or other.length < chain.length
        ] + [chain]
        self.chains.sort(key=lambda chain: chain.length * (1 + _WORTH * chain.cycles))
        del self.chains[self.width :]
        return True

    def add_seed(self, chain: Chain) -> None:
        """Make ``chain`` feasible and short, and add the resulting chain to the pool."""
        along = chain.unknowns[: chain.cycles * (self.query.walls.dimensions - 1)].reshape(
            chain.cycles, -1
        )
        deltas = list(chain.differences(self.query.before, self.query.after))
        self.try_candidate(
            _Candidate(0.0, chain.touchers.tolist(), chain.walls.tolist(), list(along), deltas)
        )

    def try_candidate(self, candidate: _Candidate) -> int:
        """Make a candidate chain feasible and short, and add the resulting chain to the pool.

        The method returns 0 if it has tried an equal candidate before, and 1 for a new candidate.
        """
        query, guess, round_ = self.query, candidate.guess, self.query.walls.round
        kind = (
            *candidate.touchers,
            *candidate.walls,
            np.round(guess, 2).tobytes() if round_ else b"",
        )
        if kind in self._tried:
            return 0
        self._tried.add(kind)
        touchers, walls = np.array(candidate.touchers), np.array(candidate.walls)
        enough, rounds = (ROOM, _ROUGH_ROUND) if round_ else (ENOUGH, _ROUGH)
        length = query.optimize(
            guess, touchers, walls, enough=enough, rounds=rounds, bound=self.bound
        )
        close = _CLOSE * self.chains[0].length if self.chains else 0.0
        if self.fine and query.walls.sides <= MANY and not round_ and length < close:
            length = query.optimize(
                guess, touchers, walls, enough=enough, rounds=_FINE, bound=self.bound
            )
        if length < inf:
            self.add(slide_contacts(query, Chain(touchers, walls, guess, length)))
        return 1

    def improve(self, tries: int) -> None:
        """Try at most ``tries`` changes of the pool's chains, beginning with the shortest chain."""
        while tries > 0 and not self.query.late:
            parent = next((chain for chain in self.chains if id(chain) not in self._expanded), None)
            if parent is None:
                return
            remaining = min(EACH, tries)
            for candidate, least in bound_candidates(
                self.query, propose_changes(self.query, parent, self.most)
            ):
                if remaining <= 0 or self.query.late:
                    break
                if least < self.chains[0].length:
                    count = self.try_candidate(candidate)
                    tries, remaining = tries - count, remaining - count
            if tries > 0:
                self._expanded[id(parent)] = parent


class _Candidate(NamedTuple):
    """A candidate chain, made from a known chain by adding a cycle, removing a cycle or exchanging
    a touching particle.

    Attributes
    ----------
    distance : float
        Distance from a particle to the wall of its new contact, or at most 0 if the candidate has
        no new contact. The search tries candidates in ascending order of this distance.
    touchers, walls : list of int
    along : list of ndarray of float64, shape (d - 1,)
        Initial positions of the contacts along their walls.
    deltas : list of ndarray of float64, shape (d,)
        Position differences of the particles at the start, between the cycles, and at the end.
    """

    distance: float
    touchers: list[int]
    walls: list[int]
    along: list[Points]
    deltas: list[Points]

    @property
    def guess(self) -> NDArray[np.float64]:
        """The unknowns with which the optimization starts."""
        return np.concatenate([*self.along, *self.deltas[1:-1]])


def bound_candidates(
    query: ChainQuery, candidates: list[_Candidate]
) -> list[tuple[_Candidate, float]]:
    """Return the candidate chains, each with a lower bound on its length."""
    bounds = np.empty(len(candidates))
    for cycles in {len(candidate.walls) for candidate in candidates}:
        same = [k for k, candidate in enumerate(candidates) if len(candidate.walls) == cycles]
        bounds[same] = query.bounds_of(
            np.array([candidates[k].touchers for k in same]),
            np.array([candidates[k].walls for k in same]),
        )
    return list(zip(candidates, bounds.tolist(), strict=True))


def propose_changes(query: ChainQuery, chain: Chain, most: int = MOST_CYCLES) -> list[_Candidate]:
    """Return chains of at most ``most`` cycles that may be shorter than ``chain``, sorted by the
    distance of a particle from the wall of its new contact.
    """
    d, circle, half = query.walls.dimensions, len(query.walls.normals), pi * query.walls.circle[2]
    along = list(chain.unknowns[: chain.cycles * (d - 1)].reshape(-1, d - 1))
    deltas = list(chain.differences(query.before, query.after))
    touchers, walls = chain.touchers.tolist(), chain.walls.tolist()
    # every effect of one particle's contact can also be achieved by the other on the opposite side
    opposite = [contact + half * np.eye(d - 1)[0] for contact in along]
    proposed = []
    for place in range(chain.cycles if chain.cycles > 1 else 0):
        between = min(max(place, 1), chain.cycles - 1)
        proposed.append(
            _Candidate(
                0.0,
                _cut(touchers, place),
                _cut(walls, place),
                _cut(along, place),
                _cut(deltas, between),
            )
        )
    for place in (place for place, wall in enumerate(walls) if wall == circle):
        swapped_touchers = _put(_cut(touchers, place), place, 1 - touchers[place])
        proposed.append(
            _Candidate(
                0.0,
                swapped_touchers,
                walls,
                _put(_cut(along, place), place, opposite[place]),
                deltas,
            )
        )
    if all(wall == circle for wall in walls):
        nearest = _nearest_touchers(query, chain, np.array(deltas))
        places = [
            opposite[k] if toucher != touchers[k] else along[k] for k, toucher in enumerate(nearest)
        ]
        proposed.append(_Candidate(-1.0, nearest, walls, places, deltas))
    states = states_of(query, chain, np.array(deltas))
    for place in range(chain.cycles + 1 if chain.cycles < most else 0):
        aside = deltas[place + 1 if place < chain.cycles else place - 1] - deltas[place]
        after = min(place + 1, chain.cycles)
        for toucher in (0, 1):
            for wall, contact, share, distance in _new_contacts(
                query, chain, along, place, toucher, states[place][toucher]
            ):
                more = (
                    _put(touchers, place, toucher),
                    _put(walls, place, wall),
                    _put(along, place, contact),
                )
                proposed.append(
                    _Candidate(distance, *more, _put(deltas, after, deltas[place] + share * aside))
                )
    proposed.sort(key=lambda candidate: candidate.distance)
    return proposed


def _put(items: list[_Item], place: int, item: _Item) -> list[_Item]:
    return [*items[:place], item, *items[place:]]


def _cut(items: list[_Item], place: int) -> list[_Item]:
    return [*items[:place], *items[place + 1 :]]


def _nearest_touchers(query: ChainQuery, chain: Chain, deltas: Points) -> list[int]:
    """Return, for each cycle of a chain on a round wall, which particle should touch the wall to
    make the whole chain shortest.
    """
    signs = np.array([1.0, -1.0])
    contacts = chain.contacts(query.walls) * np.where(chain.touchers == 0, 1.0, -1.0)[:, None]
    contacts[:, 2:] *= np.where(chain.touchers == 0, 1.0, -1.0)[:, None]  # heights are not mirrored
    positions, total, choices = query.start[None], np.zeros(1), []
    for contact, delta in zip(contacts, deltas[1:], strict=True):
        spots = np.stack([np.concatenate([sign * contact[:2], contact[2:]]) for sign in signs])
        lengths = total[:, None] + np.linalg.norm(positions - spots, axis=2)  # before, toucher
        choices.append(lengths.argmin(axis=0))
        total = lengths.min(axis=0)
        positions = np.stack(
            [np.stack([spots[0], spots[0] + delta]), np.stack([spots[1] - delta, spots[1]])]
        )
    total = total + np.linalg.norm(positions[:, 0] - query.goal[0], axis=1)
    touchers = [int(total.argmin())]
    for choice in choices[:0:-1]:
        touchers.append(int(choice[touchers[-1]]))
    return touchers[::-1]


def states_of(query: ChainQuery, chain: Chain, deltas: Points) -> Points:
    """Return the positions of both particles before each contact and after the last cycle; shape
    (cycles + 1, 2, d).
    """
    states = np.empty((chain.cycles + 1, 2, query.walls.dimensions))
    states[0] = query.start
    for m, (toucher, contact) in enumerate(
        zip(chain.touchers, chain.contacts(query.walls), strict=True)
    ):
        states[m + 1, toucher] = contact
        states[m + 1, 1 - toucher] = contact + (deltas[m + 1] if toucher == 0 else -deltas[m + 1])
    return states


def _new_contacts(
    query: ChainQuery, chain: Chain, along: list[Points], place: int, toucher: int, point: Points
) -> Iterator[tuple[int, Points, float, float]]:
    """Yield the wall, contact, fraction and path length of each possible new cycle of a particle at
    ``point``.

    Let u be the change of the position difference by the next cycle of the chain. The new cycle
    changes the position difference by the fraction times u. The path length is the distance from
    ``point`` to the wall.
    """
    walls = query.walls
    flat = len(walls.normals)
    distances = walls.normals @ point - walls.offsets
    places = np.arange(flat)
    if (
        walls.sides > MANY
    ):  # walls nearest to the point, and walls of the previous and next contacts
        beside = chain.walls[[max(place - 1, 0), min(place, chain.cycles - 1)]]
        places = np.unique([*np.argsort(distances)[:6], *beside, *range(walls.sides, flat)])
    for wall in places.tolist():
        middle, reach = walls.frames[wall, 0], walls.reaches[wall]
        yield (
            wall,
            np.clip(walls.frames[wall, 1:] @ (point - middle), -reach, reach),
            0.0,
            distances[wall],
        )
    if not walls.round:
        return
    for neighbour in {max(place - 1, 0), min(place, chain.cycles - 1)}:
        if chain.walls[neighbour] == flat:
            contact = along[neighbour].copy()
            contact[0] += 0.0 if chain.touchers[neighbour] == toucher else pi * walls.circle[2]
            yield flat, contact, 0.5, 0.0
    contact = np.concatenate([[walls.circle[2] * np.arctan2(point[1], point[0])], point[2:]])
    yield flat, contact, 0.0, walls.circle[2] - float(np.hypot(point[0], point[1]))


def improved_chains(
    query: ChainQuery, seeds: Iterable[Chain] = (), *, thorough: bool = True, wide: bool = False
) -> list[Chain]:
    """Return the shortest chains that the search finds, with any number of cycles, sorted by
    length; the list may be empty.

    Parameters
    ----------
    query : ChainQuery
    seeds : iterable of Chain
        Chains with which the search starts, in addition to the chains of one, two and three cycles
        that it finds itself.
    thorough : bool
        Whether all kinds of four cycles are tried, too, where there are few walls, and whether nearly
        shortest chains are refined before they are compared.
    wide : bool
        Whether more chains are changed, which takes about four times as long.
    """
    disk = query.walls.round and query.walls.dimensions == 2
    seeds = list(seeds)
    many = wide or (disk and any(chain.cycles > MOST_CYCLES for chain in seeds))
    most = ROUND_CYCLES if many else MOST_CYCLES
    pool = ChainPool(query, thorough, WIDE_WIDTH if wide else WIDTH, most)
    for chain in seeds:
        pool.add_seed(chain)
    from_disk = (
        []
        if (around := round_query(query)) is None
        else [
            feasible_sides(query, restore_sides(query, around, chain))
            for chain in improved_chains(around, thorough=thorough, wide=wide)
        ]
    )
    for chain in from_disk:
        pool.add_seed(chain)
    # those of a disk were never longer than those of a few sides
    for cycles in () if from_disk else CYCLES:
        for chain in chains_of(
            query, cycles, inf if pool.best is None else NEARLY * pool.best.length
        ):
            pool.add(chain)
        if cycles == 2:
            pool.improve(EARLY)
    walls = query.walls
    # by the law of growth, a disk may have no chains of so few cycles; there, greedy may have too many
    for cycles in GROWING if disk else ():
        if pool.best is None or pool.best.cycles > most:
            for chain in chains_of(query, cycles, inf):
                pool.add(chain)
    few = thorough and walls.dimensions == 2 and not walls.round and walls.sides <= FEW
    if few and pool.best is not None:
        for chain in chains_of(query, CYCLES[-1] + 1, pool.best.length):
            pool.add(chain)
    pool.improve(WIDE_TRIES if wide else TRIES)
    shortest: dict[int, Chain] = {}  # the shortest chain of each number of cycles
    for chain in sorted(pool.chains, key=lambda chain: chain.length):
        shortest.setdefault(chain.cycles, chain)
    refined = [
        refine_chain(query, chain)
        for chain in shortest.values()
        if chain.length < 1.01 * pool.chains[0].length
    ]
    if disk:
        refined.sort(key=lambda chain: chain.length)
        # a plan that slides may be the shortest one only with many contacts
        sliding = refined if wide else refined[:1]
        refined += [with_sliding_contacts(query, chain, wide=wide) for chain in sliding]
    return sorted(refined, key=lambda chain: chain.length)


def with_sliding_contacts(query: ChainQuery, chain: Chain, *, wide: bool) -> Chain:
    """Return the chain that results if contacts with a round wall are inserted halfway between two
    contacts of one particle, one at a time, where this is worth it; ``wide`` tries each twice.
    """
    shares, worth = ((1 / 2, 1 / 3), _WORTH) if wide else ((1 / 2,), _WORTH_SLIDING)
    shortened = True
    while shortened:
        shortened, place = False, 1
        while place < chain.cycles < MOST_SLIDING and not query.late:
            for candidate in _contacts_between(query, chain, place, shares):
                touchers, walls = np.array(candidate.touchers), np.array(candidate.walls)
                guess, most = candidate.guess, _NEAR * chain.length
                length = query.optimize(
                    guess, touchers, walls, enough=ROOM, rounds=_ROUGH_ROUND, bound=most
                )
                if length < most:
                    length = query.optimize(guess, touchers, walls, bound=most)
                if length < chain.length * (1 - worth):
                    chain, shortened = Chain(touchers, walls, guess, length), True
                    place += 1  # the two parts of this step come in the next round
                    break
            place += 1
    return chain


def _contacts_between(
    query: ChainQuery, chain: Chain, place: int, shares: Iterable[float]
) -> Iterator[_Candidate]:
    """Yield copies of a chain at a round wall with one more contact before a place, if this is
    between two contacts of one particle. The new cycle takes one of some shares of the changes of
    both its neighbours.
    """
    around = 2 * pi * query.walls.circle[2]
    along = list(chain.unknowns[: chain.cycles].reshape(-1, 1))
    deltas = list(chain.differences(query.before, query.after))
    touchers, walls = chain.touchers.tolist(), chain.walls.tolist()
    if touchers[place - 1] != touchers[place]:
        return
    step = (along[place] - along[place - 1] + around / 2) % around - around / 2
    for share in shares:
        before, here, after = deltas[place - 1 : place + 2]
        between = [here + share * (before - here), here + share * (after - here)]
        yield _Candidate(
            0.0,
            _put(touchers, place, touchers[place]),
            _put(walls, place, walls[place]),
            _put(along, place, along[place - 1] + step / 2),
            [*deltas[:place], *between, *deltas[place + 1 :]],
        )
