"""Searches for chains of contacts: branch and bound over kinds of chains, roadmaps of position
differences, the nearest cycle, and chains to antipodal goals planned backwards.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from math import inf, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import one_line
from shoal.core.geometry import angles_of, unit_vectors
from shoal.steering.contact.friction import largest_turn
from shoal.steering.kernels.cycles import (
    CycleModel,
    fewest_cycles,
    find_cycle,
    grow_extreme_nodes,
    nearest_on_circle,
    nearest_on_polygon,
)
from shoal.steering.planners.chains import (
    REFINING,
    ROOM,
    Chain,
    ChainQuery,
    kinds_of,
    reduce_sides,
    restore_sides,
    slide_contacts,
)
from shoal.steering.workspaces.convex import Points
from shoal.steering.workspaces.walls import NormalizedWalls


def shortest_chain(
    query: ChainQuery, *, cycles: tuple[int, ...] = (1, 2, 3), first_found: bool = False
) -> Chain | None:
    """Return the shortest chain of wall contacts with one of the given numbers of cycles, or None
    if no chain is found.

    Parameters
    ----------
    query : ChainQuery
    cycles : tuple of int
        Numbers of cycles to try, in the order of the search.
    first_found : bool
        Whether the search stops at the first number of cycles for which it finds a chain.

    Notes
    -----
    On flat walls, the search is a branch and bound over all sequences of touching particles and
    walls. Each sequence gives a convex optimization problem. On a round wall, the search refines
    the best of many initial guesses.
    """
    best: Chain | None = None
    for number in cycles:
        for chain in chains_of(query, number, inf if best is None else best.length):
            best = chain
        if first_found and best is not None:
            break
    return best


def chains_of(query: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield increasingly short chains with the given number of cycles, all shorter than
    ``bound``.
    """
    if not query.walls.round:
        few = reduce_sides(query)
        yield from (
            _chains_on_flat_walls(query, cycles, bound)
            if few is query
            else _chains_on_many_sides(query, few, cycles, bound)
        )
        return
    for chain in _chains_on_round_wall(query, cycles, bound):
        bound = chain.length
        yield chain
    if len(query.walls.normals) and (cycles <= 2 or bound == inf):  # the end caps of a cylinder
        yield from _chains_on_end_caps(query, cycles, bound)


def _chains_on_many_sides(
    query: ChainQuery, few: ChainQuery, cycles: int, bound: float
) -> Iterator[Chain]:
    """Yield increasingly short chains on the flat walls of a polygon, made from chains on a few of
    these walls.
    """
    for rough in _chains_on_flat_walls(few, cycles, 1.1 * bound):
        guess = restore_sides(query, few, rough)
        length = query.optimize(guess.unknowns, guess.touchers, guess.walls, rounds=REFINING[:3])
        if length < inf:
            chain = slide_contacts(query, replace(guess, length=length))
            if chain.length < bound:
                bound = chain.length
                yield chain


def _chains_on_flat_walls(query: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield increasingly short chains with contacts on flat walls only."""
    touchers, on, bounds = kinds_of(
        query.start, query.goal, query.walls, cycles=cycles, push=query.push, bound=bound
    )
    for kind, least in enumerate(bounds):
        if least >= bound - 1e-9 or query.late:
            break
        guess = query.guess(cycles)
        length = query.optimize(guess, touchers[kind], on[kind], bound=bound)
        if length < bound:
            bound = length
            yield Chain(touchers[kind], on[kind], guess, length)


def _chains_on_round_wall(query: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield the shortest chain that starts from many guesses find, with contacts on a round wall."""
    if query.late:
        return
    guesses = list(_guesses(query, cycles))
    met: set[tuple[float, ...]] = set()
    on = np.full(cycles, len(query.walls.normals))
    d = query.walls.dimensions
    shortest, best = inf, None
    for kind in product((0, 1), repeat=cycles):
        touchers = np.array(kind, dtype=np.int64)
        if query.late or query.bounds_of(touchers[None], on[None])[0] >= bound:
            continue
        for initial in guesses:
            guess = initial.copy()
            # Every effect of a contact of particle 1 can also be achieved by particle 2 on the
            # opposite side.
            guess[: cycles * (d - 1) : d - 1] += pi * query.walls.circle[2] * touchers
            length = query.optimize(guess, touchers, on, enough=ROOM, rounds=REFINING[:1])
            place = (*kind, *np.round(guess, 2).tolist())
            if length < inf and place not in met:
                met.add(place)
                length = query.optimize(guess, touchers, on, enough=ROOM, rounds=REFINING[1:2])
                if length < shortest:
                    shortest, best = length, (touchers, guess)
    if best is not None:
        touchers, guess = best
        length = query.optimize(guess, touchers, on, enough=ROOM)
        if length < bound:
            yield Chain(touchers, on, guess, length)


def _chains_on_end_caps(query: ChainQuery, cycles: int, bound: float) -> Iterator[Chain]:
    """Yield increasingly short chains in a cylinder, each with a contact on at least
    one end cap.
    """
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
                    guess[m * (d - 1)], guess[m * (d - 1) + 1] = (
                        radius * angle,
                        query.walls.height / 2,
                    )
                length = query.optimize(guess, touchers, walls, enough=ROOM, rounds=REFINING[:4])
                if length < bound:
                    bound = length
                    yield Chain(touchers, walls, guess, length)


def _guesses(query: ChainQuery, cycles: int) -> Iterator[NDArray[np.float64]]:
    """Yield the unknowns of feasible chains in which only particle 1 touches a round wall, with
    contacts all around the circle.
    """
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
        if query.optimize(guess, touchers, on, enough=ROOM, rounds=REFINING[:0]) < inf:
            yield guess


MOST_CYCLES = 500
CONTACTS, TILTS = 129, 9  # number of contacts and directions in the search for the next node
LEAST = 1e-3  # relative to the radius: smaller differences are not needed
SAME = 1e-9
BETWEEN = 300  # number of differences on a path around the centre


def backward_nodes(after: Points, *, radius: float, friction: float, margin: float) -> Points:
    """Return the shortest position differences from which 1, 2, 3, ... cycles reach ``after``;
    float64, shape (nodes, 2).

    Each cycle can turn the position difference to the left or to the right by the same angle. The
    nodes belong to chains of two kinds: chains that always turn to the same side, and chains that
    turn left and right alternately.
    """
    cone = float(np.arctan(friction)) * (1 - 1e-6)
    sizes, turns = [float(np.hypot(*after))], list[float]()
    for _cycle in range(MOST_CYCLES):
        size, turn = _smallest_before(sizes[-1], radius, cone, margin)
        if not size < sizes[-1] * (1 - SAME):
            break
        sizes.append(size)
        turns.append(turn)
        if size < LEAST * radius:
            break
    nodes = []
    signs = (-1.0) ** np.arange(len(turns))
    for side in (np.ones(len(turns)), -np.ones(len(turns)), signs, -signs):
        angles = np.arctan2(after[1], after[0]) + np.cumsum(side * turns)
        nodes.append(np.array(sizes[1:])[:, None] * unit_vectors(angles))
    return np.concatenate(nodes)


def _smallest_before(size: float, radius: float, cone: float, margin: float) -> tuple[float, float]:
    """Return length and angle of the shortest position difference that one cycle can change to
    length ``size`` and angle 0.
    """
    inner = radius - margin
    # the contacts from which the difference ends inside: law of cosines for radius, size and inner
    half = np.arccos(min(1.0, (radius**2 + size**2 - inner**2) / (2 * radius * size)))
    contact = np.pi + half * (1 - SAME) * np.linspace(-1, 1, CONTACTS)[:, None]
    tilted = contact + cone * np.linspace(-1, 1, TILTS)
    # depth of the other particle at the end
    x, y = (radius * np.cos(contact) + size, radius * np.sin(contact))
    along = x * np.cos(tilted) + y * np.sin(tilted)
    reach = along + np.sqrt(np.maximum(along**2 - (x**2 + y**2 - inner**2), 0.0))
    back = np.clip(size * np.cos(tilted), 0.0, np.maximum(reach, 0.0))
    before_x, before_y = size - back * np.cos(tilted), -back * np.sin(tilted)
    sizes = np.hypot(before_x, before_y)
    best = np.unravel_index(int(np.argmin(sizes)), sizes.shape)
    return float(sizes[best]), float(np.arctan2(before_y[best], before_x[best]))


def turning_nodes(before: Points, after: Points, *, radius: float, friction: float) -> Points:
    """Return position differences on a path from ``before`` to ``after`` that turns and becomes
    shorter; shape (nodes, 2).

    The result is empty if ``after`` is not shorter than ``before``, if friction prevents a path to
    ``after``, or if the position difference could turn without becoming shorter.
    """
    large, small = float(np.hypot(*before)), float(np.hypot(*after))
    most = float(np.arctan(friction))
    begin = float(np.arctan2(before[1], before[0]))
    turn = (float(np.arctan2(after[1], after[0])) - begin + np.pi) % (2 * np.pi) - np.pi
    if small >= large or not abs(turn) <= largest_turn(large, small, radius, most) < np.inf:
        return np.zeros((0, 2))
    low, cone = 0.0, most
    for _halving in range(60):
        middle = (low + cone) / 2
        low, cone = (
            (middle, cone)
            if largest_turn(large, small, radius, middle) < abs(turn)
            else (low, middle)
        )
    angles = np.linspace(
        np.arccos(large / (2 * radius)), np.arccos(small / (2 * radius)), BETWEEN + 2
    )[1:-1]
    sizes: NDArray[np.float64] = 2 * radius * np.cos(angles)
    total_turn = largest_turn(large, small, radius, cone)
    bends = begin + np.array([largest_turn(large, float(size), radius, cone) for size in sizes]) * (
        turn / total_turn
    )
    return np.asarray(sizes[:, None] * unit_vectors(bends))


MAPS = ((300, 60, 1.02, 200), (1500, 120, 1.01, 400))
"""Settings of the roadmaps that `roadmap_chain` tries one after another. Each setting holds the
maximum number of extreme position differences, the number of ranges of directions, the factor by
which a position difference must be more extreme than earlier ones in the same range, and the number
of random position differences.
"""

# factor for margin and push, so that a chain of links satisfies the limits of `chains`
_INSIDE = 1 + 1e-2
_DIRECTIONS = 48  # on a disk


def roadmap_chain(
    query: ChainQuery, *, maps: tuple[tuple[int, int, float, int], ...] = MAPS, seed: int = 0
) -> Chain | None:
    """Return a plane chain that ends exactly with the goals' position difference, or None if no
    roadmap contains such a chain.

    Notes
    -----
    The method is a probabilistic roadmap in the space of the position differences, and an addition
    by Shoal. A link of the roadmap from one position difference to another means that two moves can
    change the first into the second. Some nodes are random position differences. The other nodes
    are, for each range of directions, the longest position difference that cycles can reach from
    the start, and the shortest position difference from which cycles can reach the goals. With
    friction, every path from the start to the goals may have to follow these extreme position
    differences. In a polygon with many corners, the roadmap uses only a few sides of the polygon.
    """
    few = reduce_sides(query)
    if few is not query:
        rough = roadmap_chain(few, maps=maps, seed=seed)
        if rough is None:
            return None
        guess = restore_sides(query, few, rough)
        length = query.optimize(guess.unknowns, guess.touchers, guess.walls, rounds=REFINING[:3])
        return replace(guess, length=length) if length < inf else None
    model = replace(query, friction=query.friction * (1 - 1e-9)).model(_INSIDE)
    rng = np.random.default_rng(seed)
    for extreme, bins, gain, spread in maps:
        if query.late:
            return None
        nodes = [
            np.stack([query.before, query.after]),
            _extreme_nodes(query, model, extreme, bins, gain),
            _random_nodes(query, rng, spread),
        ]
        chain = _chain_over_nodes(np.concatenate(nodes), model)
        if chain is not None:
            return chain
    return None


def _extreme_nodes(
    query: ChainQuery, model: CycleModel, count: int, bins: int, gain: float
) -> Points:
    """Return extreme position differences as nodes of the roadmap; float64, shape (nodes, 2).

    For each narrow range of directions, the nodes are the longest position difference that cycles
    can reach from the start, and the shortest position difference from which cycles can reach the
    goals.
    """
    walls = query.walls
    if walls.round and query.friction < inf:
        radius, friction = float(walls.circle[2]), model.friction
        return np.concatenate(
            [
                backward_nodes(
                    query.after, radius=radius, friction=friction, margin=2 * model.margin
                ),
                turning_nodes(query.before, query.after, radius=radius, friction=friction),
            ]
        )
    angles = _ray_angles(query)
    rays = unit_vectors(angles)
    extremes = []
    for delta, back in ((query.before, False), (query.after, True)):
        nodes, records = np.empty((count, 2)), np.full(bins, inf if back else 0.0)
        extremes.append(
            nodes[1 : grow_extreme_nodes(delta, back, rays, 2.0, model, gain, records, nodes, 0)]
        )
    return np.concatenate(extremes)


def _ray_angles(query: ChainQuery) -> NDArray[np.float64]:
    """Return the angles of changes of the position difference: along walls' normals, and along the
    edges of friction cones.
    """
    normals = query.walls.normals
    if not len(normals):
        return np.asarray(2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS)
    straight = angles_of(normals)
    straight = np.concatenate([straight, straight + np.pi])
    edge = float(np.arctan(query.friction)) * (1 - 1e-6)
    return np.concatenate([straight, straight - edge, straight + edge])


def _random_nodes(query: ChainQuery, rng: np.random.Generator, count: int) -> Points:
    """Return random position differences with lengths of several orders of magnitude."""
    angles = 2 * np.pi * rng.random(count)
    sizes = np.where(rng.random(count) < 0.6, rng.random(count), 10 ** (-3 * rng.random(count)))
    far = 2 * float(query.walls.circle[2]) if query.walls.round else 2.0
    return np.asarray(far * sizes[:, None] * unit_vectors(angles))


def _chain_over_nodes(nodes: Points, model: CycleModel) -> Chain | None:
    """Return the chain from node 0 (the start) to node 1 (the goals) that takes the fewest cycles
    of moves, or None.
    """
    parents, order = np.empty(len(nodes), dtype=np.int64), np.empty(len(nodes), dtype=np.int64)
    if not fewest_cycles(nodes, model, parents, order):
        return None
    path = [1]
    while path[-1]:
        path.append(int(parents[path[-1]]))
    path.reverse()
    steps = np.empty((len(path) - 1, 3))
    for step, before, after in zip(steps, path, path[1:], strict=False):
        find_cycle(nodes[before], nodes[after], model, step)
    unknowns = np.concatenate([steps[:, 2], nodes[path[1:-1]].ravel()])
    return Chain(steps[:, 0].astype(np.int64), steps[:, 1].astype(np.int64), unknowns, inf)


class Cycle(NamedTuple):
    """One wall contact and one adjustment by the other particle, in the units of `NormalizedWalls`.

    Attributes
    ----------
    distance : float
        Distance from the position difference after the cycle to the target difference.
    toucher : int
        Index, 0 or 1, of the particle that the wall holds.
    wall : int
        Index of the wall that holds the touching particle.
    low, high : float
        Ends of the interval of possible contacts, as positions along the wall.
    after : ndarray of float64, shape (2,)
        The position difference of the particles after the cycle.
    """

    distance: float
    toucher: int
    wall: int
    low: float
    high: float
    after: Points

    def __repr__(self) -> str:
        return one_line(self)

    def contact(self, walls: NormalizedWalls, point: Points) -> tuple[float, Points]:
        """Return the possible contact nearest to ``point``: its position along the wall, and its
        coordinates.
        """
        if self.wall == len(walls.normals):
            angle = self.low / walls.circle[2]
            return self.low, walls.circle[2] * unit_vectors(angle)
        middle, along = walls.frames[self.wall]
        place = float(np.clip((point - middle) @ along, self.low, self.high))
        return place, middle + place * along


def nearest_cycles(query: ChainQuery, delta: Points, target: Points) -> list[Cycle]:
    """Return, for each wall and touching particle, the cycle in the plane that ends nearest to the
    position difference ``target``.

    Notes
    -----
    Source: algorithms 2 and 3 of paper W, corrected and extended to friction. On a disk, a contact
    of particle 2 on the opposite side can replace each contact of particle 1.
    """
    if query.walls.round:
        radius = query.walls.circle[2]
        after = np.zeros(2)
        distance, angle = nearest_on_circle(
            delta, target, query.model(), np.empty((9, 2)), np.empty(2), after
        )
        along = [radius * float(angle + pi * toucher) for toucher in (0, 1)]
        return [
            Cycle(float(distance), k, 0, along[k], along[k], after)
            for k in (0, 1)
            if distance < inf
        ]
    walls = query.walls.sides
    cycles, corners, spare = (
        np.empty((walls, 2, 5)),
        np.empty((2 * walls + 16, 2)),
        np.empty((2 * walls + 16, 2)),
    )
    nearest_on_polygon(delta, target, query.model(), corners, spare, np.empty(2), cycles)
    return [
        Cycle(distance, int(k), int(wall), low, high, cycles[wall, k, 3:])
        for wall, k in np.argwhere(cycles[..., 0] < inf)
        for distance, low, high in [cycles[wall, k, :3].tolist()]
    ]


NEAR = 0.6  # relative to the diameter: longer differences are planned backwards
TURN = 0.9  # fraction of the largest turn that a cycle allows


def antipodal_chain(query: ChainQuery, *, cycles: int) -> Chain | None:
    """Return a chain of wall contacts on a disk to a position difference that is nearly as long as
    the diameter of the disk.

    The result is None if the goals' distance is much shorter than the diameter of the disk, or if
    the chain would need more than ``cycles`` cycles.

    On a disk of radius r, one cycle can increase the distance D of the particles to sqrt(2 r D) at
    most. Such a cycle turns the position difference by acos(sqrt(D / (2 r))) radians to the left or
    to the right. The algorithm plans backwards from the goals. A cycle that ends at the distance E
    and turns by the angle t starts at the distance E cos t. The algorithm adds such cycles until
    the position difference before the earliest cycle is at most 0.6 times as long as the diameter
    of the disk. A chain of at most three other cycles leads from the start to this position
    difference. The backward turns are counter-clockwise and clockwise, by turns.

    Notes
    -----
    Source: figure 15 in section VI of paper W, which shows that particles can approach antipodal
    goals but not reach them. Planning backwards is an addition by Shoal.
    """
    if query.walls.dimensions != 2:
        return None
    radius = query.walls.circle[2]
    far = 2 * radius - 2 * query.margin
    length, angle = float(np.hypot(*query.after)), float(np.arctan2(query.after[1], query.after[0]))
    if length <= NEAR * 2 * radius:
        return None
    steps, contacts = [(min(length, far), angle)], list[float]()
    while steps[-1][0] > NEAR * 2 * radius and len(steps) < cycles - 3:
        length, angle = steps[-1]
        turn = TURN * float(np.arccos(length / (2 * radius)))
        angle += turn if len(contacts) % 2 == 0 else -turn
        contacts.append(angle + pi)
        shorter = length * float(np.cos(turn)) + 2 * query.push
        if shorter >= length:  # with such a push, no cycle reaches the difference
            return None
        steps.append((shorter, angle))
    earliest = steps[-1]
    if earliest[0] > NEAR * 2 * radius:
        return None
    bottom = earliest[0] * np.array([np.cos(earliest[1]), np.sin(earliest[1])])
    approach = ChainQuery(
        query.walls,
        query.start,
        np.stack([-bottom / 2, bottom / 2]),
        friction=query.friction,
        margin=query.margin,
        push=query.push,
    )
    chain = shortest_chain(approach, first_found=True)
    if chain is None:
        return None
    deltas = [
        *chain.differences(query.before, bottom)[1:],
        *(size * unit_vectors(a) for size, a in steps[-2::-1]),
    ]
    along = np.concatenate([chain.unknowns[: chain.cycles], radius * np.array(contacts[::-1])])
    touchers = np.concatenate([chain.touchers, np.zeros(len(contacts), dtype=np.int64)])
    return Chain(
        touchers,
        np.zeros(len(touchers), dtype=np.int64),
        np.concatenate([along, *deltas[:-1]]),
        inf,
        last=deltas[-1],
    )
