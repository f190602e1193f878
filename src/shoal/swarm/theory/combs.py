"""Combs: maps in two dimensions that need many scans, whatever the number of moves.

In one dimension, schedules exist whose moves and scans are both within O(log D / log log D) of the
optimum (paper M, theorem 1). The paper leaves two dimensions open. The following lower bound holds
there for every policy, and grows almost as fast as the number of cells.

**Theorem.** A *comb* is a corridor with k places in a row, two cells apart, each of which has a
tooth of one cell or none. A policy that maps all combs of k places with n particles makes
at least k / log2 C(c, n) scans after the one at the start, where c <= 4 k + 3 is the number of
cells that a comb may have. One who knows the comb confirms it with 3 scans in all and at most
7 k + 2 moves. For m cells and a fixed number of particles, no policy therefore has a ratio of scans
below a constant times m / log m, and scans after every move have a ratio of O(m).

Proof. A scan shows one of at most C(c, n) sets of cells. A policy decides by what it has seen, so
that s scans end in at most C(c, n)^s ways, and each comb must end in another way. This is still so
if the policy is told that the map is a comb. As a tree with 2^k leaves has a mean depth of at least
k / log2 C(c, n), too, chance does not help against random combs. `confirming_commands` has the
commands of one who knows. On the way to the right, the particle enters every tooth that should not
be there, and then stays in it, because no command d follows: it arrives at the right end only if
all these teeth are absent. On the way back, the particle enters every tooth that should be there,
and tries to go on; where the tooth is absent, it gets ahead by one cell, and never falls behind
again. It stops at the right cell only if all these teeth are present.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import product
from math import comb as binomial
from math import inf

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer
from shoal.swarm.theory.exploration import STEPS

__all__ = ["comb_map", "comb_start", "confirming_commands", "least_comb_moves", "least_comb_scans"]

Place = tuple[int, int]


def comb_start(places: int) -> Place:
    """Return the start in combs of a number of places: the cell below the first place."""
    return 1, places + 2


def comb_map(teeth: Sequence[bool]) -> NDArray[np.bool_]:
    """Return the free cells of a comb, with its corridor as the lower row; bool, shape (2, W).

    The corridor begins some cells before the first place, so that a particle that gets ahead on its
    way back does not meet the end.

    Examples
    --------
    >>> for row in comb_map([True, False]).astype(int): print(*row)
    0 0 0 0 1 0 0 0 0
    1 1 1 1 1 1 1 1 1
    """
    first = comb_start(len(teeth))[1]
    free = np.zeros((2, first + 2 * len(teeth) + 1), dtype=np.bool_)
    free[1] = True
    free[0, first : first + 2 * len(teeth) : 2] = teeth
    return free


def confirming_commands(teeth: Sequence[bool]) -> tuple[str, str]:
    """Return the commands that confirm a comb, from the start to the second scan and from there to
    the third.

    Examples
    --------
    >>> confirming_commands([True, False])
    ('rrurr', 'lllluldll')
    """
    forward = "".join("rr" if tooth else "urr" for tooth in teeth)
    back = "".join("uldll" if tooth else "ll" for tooth in reversed(teeth))
    return forward, f"ll{back}"


def least_comb_scans(places: int, particles: int = 1) -> int:
    """Return a lower bound on the scans after the start for policies that map all combs: the
    smallest s with C(c, n)^s >= 2^k.

    Parameters
    ----------
    places : int
        Number k of places for teeth, at least 1.
    particles : int
        Number n, at least 1 and at most the number of cells of the corridor.

    Examples
    --------
    >>> [least_comb_scans(k) for k in (4, 10, 100, 1000)]
    [1, 2, 12, 84]
    """
    places = check_integer(places, what="places", least=1, most=10**6)
    corridor = 3 * places + 3
    particles = check_integer(particles, what="particles", least=1, most=corridor)
    outcomes, scans, ways = binomial(corridor + places, particles), 0, 1
    while ways < 1 << places:
        ways, scans = ways * outcomes, scans + 1
    return scans


def least_comb_moves(places: int, scans: int) -> int:
    """Return the fewest moves with which some policy with one particle maps all combs of a number
    of places with at most ``scans`` scans after the start.

    The search is exact: it follows the particle in all combs at once. A policy that knows that the
    map is a comb has mapped it when what it has seen fits only one comb.

    Parameters
    ----------
    places : int
        At least 1 and at most 3.
    scans : int
        At least 1, and at least 2 for 3 places, because the search would be too long.

    Examples
    --------
    >>> [least_comb_moves(2, scans) for scans in (1, 2)]
    [9, 5]
    """
    places = check_integer(places, what="places", least=1, most=3)
    scans = check_integer(scans, what="scans", least=1 + (places > 2))
    combs = tuple(
        frozenset((int(row), int(column)) for row, column in np.argwhere(comb_map(teeth)))
        for teeth in product((False, True), repeat=places)
    )
    return _fewest_moves(tuple((cells, comb_start(places)) for cells in combs), scans)


@cache
def _fewest_moves(state: tuple[tuple[frozenset[Place], Place], ...], scans: int) -> int:
    """Return the fewest moves that tell combs apart, each given with the place of the particle."""
    maps = [cells for cells, _ in state]
    level = [tuple(place for _, place in state)]
    visited, moves, best = set(level), 0, inf
    while moves < best:
        for places in level:
            groups: dict[Place, list[tuple[frozenset[Place], Place]]] = {}
            for cells, place in zip(maps, places, strict=True):
                groups.setdefault(place, []).append((cells, place))
            unclear = [tuple(group) for group in groups.values() if len(group) > 1]
            if not unclear:
                return moves
            if scans > 1 and len(groups) > 1:
                remaining = max(_fewest_moves(group, scans - 1) for group in unclear)
                best = min(best, moves + remaining)
        moves += 1
        following = []
        for places in level:
            for row, column in STEPS.values():
                after = tuple(
                    neighbour
                    if (neighbour := (place[0] + row, place[1] + column)) in cells
                    else place
                    for cells, place in zip(maps, places, strict=True)
                )
                if after not in visited:
                    visited.add(after)
                    following.append(after)
        level = following
    return int(best)
