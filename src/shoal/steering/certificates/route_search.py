"""Branch and bound in workspaces of convex cells: over patterns of holds, and over the cells where
the other particle is at their contacts.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from itertools import pairwise, product
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.steering.certificates.cells import Cells
from shoal.steering.certificates.routes import (
    Hold,
    HoldsBetween,
    Item,
    Pattern,
    RouteBound,
    RouteRelaxation,
)

_LACKING = 1e-5  # relative to the limit: shorter inputs are not short
_FEW = 4  # holds of a gap: with more, it can be without some of them
_USEFUL = 0.01  # relative to the limit: a shorter change in a gap is not divided
_ARCS_FIRST = 4.0  # how much more the error of a hold by an arc counts than that of a gap
_OFTEN = 6  # holds of a gap next to it: it has been divided in vain


class _Siting(NamedTuple):
    """A division by the cell of the other particle at a contact of the hold at ``place``, its first
    or its last one.
    """

    place: int
    last: bool

    def proof(self) -> dict[str, Any]:
        return {"place": self.place, "contact": "last" if self.last else "first"}


class _Halving(NamedTuple):
    """A division of the hold by an arc at ``place`` by the halves of the arc."""

    place: int

    def proof(self) -> dict[str, Any]:
        return {"place": self.place}


class _Branching(NamedTuple):
    """A division by the hold of a gap that is the first (or, from the right, the last) not to be in
    ``excluded``.
    """

    place: int
    excluded: frozenset[Hold]
    right: bool

    def proof(self) -> dict[str, Any]:
        excluded = [list(hold) for hold in sorted(self.excluded)]
        return {"place": self.place, "known": excluded, "side": "last" if self.right else "first"}


@dataclass(frozen=False, eq=False)
class _Node:
    """A node of the proof: a pattern with its bound, and how it is divided, if it is."""

    pattern: Pattern
    bound: RouteBound
    division: _Siting | _Halving | _Branching | None = None
    children: list[_Node] | None = None


class RouteTree:
    """Branch and bound for one assignment of goals to particles, and one pair of cells in which the
    particles end.

    Parameters
    ----------
    routes : RouteRelaxation
    by_use : bool
        Whether to prefer to divide a gap by whether it has one of the holds that its longest change
        needs, rather than by its first hold. For some tasks, this is better, for others worse.
    """

    def __init__(self, routes: RouteRelaxation, *, by_use: bool) -> None:
        self.routes, self._by_use = routes, by_use
        self._heap: list[tuple[float, int, int, _Node]] = []
        self._made = 0
        self._closed: _Node | None = None  # that with the least bound
        self._root = self._node((HoldsBetween(),))
        self._push(self._root)

    @property
    def upper(self) -> float:
        """Least bound of a pattern that cannot be divided, at most the limit."""
        limit = self.routes.limit * self.routes.scale
        return limit if self._closed is None else min(limit, self._closed.bound.value)

    @property
    def shortest(self) -> list[Hold] | None:
        """Walls and particles of the pattern with the bound ``upper``; None if that is the limit."""
        if self._closed is None or self._closed.bound.value > self.upper:
            return None
        return [item[:2] for item in self._closed.pattern if not isinstance(item, HoldsBetween)]

    @property
    def lower(self) -> float:
        """Lower bound on the length of all plans, at most the limit."""
        return min(self._heap[0][0] if self._heap else inf, self.upper)

    def step(self) -> None:
        """Divide the pattern with the least bound."""
        if not self._heap:
            return
        node = heapq.heappop(self._heap)[-1]
        node.division = self._siting(node) or self._halving(node) or self._branching(node)
        if isinstance(node.division, _Siting):
            patterns = self._site(node.pattern, node.division)
        elif isinstance(node.division, _Halving):
            patterns = self._halve(node.pattern, node.division.place)
        else:
            patterns = self._branches(node)
        node.children = [self._node(pattern) for pattern in patterns]
        for child in node.children:
            self._push(child)

    def proof(self, enough: float) -> list[dict[str, Any]]:
        """Return the nodes of the proof as JSON, each before its parts.

        A node whose own multipliers prove ``enough`` needs no parts.
        """
        nodes, stack = [], [self._root]
        while stack:
            node = stack.pop()
            if node.division is None or node.bound.value >= enough:
                nodes.append(node.bound.proof())
            else:
                nodes.append(node.division.proof())
                stack += (node.children or [])[::-1]
        return nodes

    def _node(self, pattern: Pattern) -> _Node:
        return _Node(pattern, self.routes.bound(pattern))

    def _push(self, node: _Node) -> None:
        if self._is_open(node.pattern):
            self._made += 1
            heapq.heappush(self._heap, (node.bound.value, -len(node.pattern), self._made, node))
        elif self._closed is None or node.bound.value < self._closed.bound.value:
            self._closed = node

    def _is_open(self, pattern: Pattern) -> bool:
        """Return whether a pattern has gaps, holds by arcs with halves, or contacts where the cell of
        the other particle is not known. A convex workspace is one cell.
        """
        sited = not self.routes.cells.corners
        return any(
            isinstance(item, HoldsBetween)
            or not (sited or -1 not in (*item, -1, -1)[:4])
            or self.routes.halves(item) is not None
            for item in pattern
        )

    def _halving(self, node: _Node) -> _Halving | None:
        """Return the hold by an arc with the greatest error; None if a gap may lose more."""
        routes = self.routes
        program = routes.program(node.pattern)
        errors = {
            place: _ARCS_FIRST * routes.error(program, node.bound.solution, place)
            for place in program.arcs
            if routes.halves(node.pattern[place]) is not None  # type: ignore[arg-type]
        }
        if not errors:
            return None
        worst = max(errors, key=lambda place: errors[place])
        loads = node.bound.loads
        return _Halving(worst) if errors[worst] >= max(loads.values(), default=-inf) else None

    def _halve(self, pattern: Pattern, place: int) -> list[Pattern]:
        before, item, after = pattern[:place], pattern[place], pattern[place + 1 :]
        assert not isinstance(item, HoldsBetween)
        halves = self.routes.halves(item)
        assert halves is not None
        gap = HoldsBetween(frozenset(halves))
        patterns: list[Pattern] = [(*before, half, *after) for half in halves]
        for pair in (halves, halves[::-1]):
            if not after or not isinstance(after[0], HoldsBetween):
                patterns.append((*before, *pair, gap, *after))
            elif not before or not isinstance(before[-1], HoldsBetween):
                patterns.append((*before, gap, *pair, *after))
            else:
                wider = after[0].holds
                wider = None if wider is None else wider | gap.holds  # type: ignore[operator]
                patterns.append((*before, *pair, HoldsBetween(wider), *after[1:]))
        return patterns

    def _siting(self, node: _Node) -> _Siting | None:
        """Return the contact whose inputs before and after are the most too short for the routes of
        the other particle; None if there is none, and the pattern has gaps.
        """
        routes = self.routes
        if not routes.cells.corners:
            return None
        program = routes.program(node.pattern)
        shortfalls = [
            routes.shortfall(sight, program, node.bound.solution) for sight in program.sights
        ]
        if not shortfalls or (node.bound.loads and max(shortfalls) < _LACKING * routes.limit):
            return None
        sight = program.sights[int(np.argmax(shortfalls))]
        return _Siting(sight.place, sight.last)

    def _site(self, pattern: Pattern, siting: _Siting) -> list[Pattern]:
        item = pattern[siting.place]
        assert not isinstance(item, HoldsBetween)
        wall, particle, *sites = (*item, -1, -1)[:4]
        patterns = []
        for cell in range(len(self.routes.covers[1 - particle].cells)):
            sites[siting.last] = cell
            hold = (wall, particle, *sites)
            patterns.append((*pattern[: siting.place], hold, *pattern[siting.place + 1 :]))
        return patterns

    def _branching(self, node: _Node) -> _Branching:
        """Return how to divide a pattern: at the gap that holds most of the length.

        A gap of few holds next to many of them has been divided often, which did not help. Another
        gap is then better. Few holds in turn, again and again, become one gap.
        """
        loads, pattern = node.bound.loads, node.pattern
        place = min(loads, key=lambda at: (_count_near_holds(pattern, at) > _OFTEN, -loads[at]))
        gap = pattern[place]
        left, right = pattern[:place][::-1], pattern[place + 1 :]
        from_right = len(left) > len(right)
        assert isinstance(gap, HoldsBetween)
        many = gap.holds is None or len(gap.holds) > _FEW
        if self._by_use and many and (needed := self._needed(node, place)):
            holds = self.routes.holds if gap.holds is None else gap.holds
            return _Branching(place, frozenset(holds) - needed, right=from_right)
        if gap.holds is not None and not (self._by_use and many):
            inner = [
                bool(side) and not isinstance(side[0], HoldsBetween) and side[0][:2] in gap.holds
                for side in (left, right)
            ]
            return _Branching(
                place, frozenset(), right=inner[0] if inner[0] != inner[1] else from_right
            )
        near = [x[:2] for x in (right if from_right else left) if not isinstance(x, HoldsBetween)]
        for count in (4, 3):
            if len(near) >= 2 * count and len(set(near[: 2 * count])) <= count:
                return _Branching(place, frozenset(near[: 2 * count]), right=from_right)
        pair = frozenset(near[:2])
        return _Branching(place, pair if len(pair) == 2 else frozenset(), right=from_right)

    def _needed(self, node: _Node, place: int) -> frozenset[Hold]:
        """Return holds of which a gap must have one to be as short as the solution: those that can
        make the longest change in the gap. Those next to the gap are left out.
        """
        routes, gap = self.routes, node.pattern[place]
        assert isinstance(gap, HoldsBetween)
        program = routes.program(node.pattern)
        values = np.append(node.bound.solution, 1.0)
        changes = program.norms[program.gaps[place][1:]] @ values
        lengths = np.linalg.norm(changes, axis=1)
        if not len(lengths) or lengths.max() < _USEFUL * routes.limit:
            return frozenset()
        longest = int(np.argmax(lengths))
        change = changes[longest] / lengths[longest]
        owners = [0, 1] if gap.holds is None else routes.owners(gap.holds)
        particle = owners[longest]
        near = [x[:2] for x in node.pattern[:place][::-1] if not isinstance(x, HoldsBetween)][:3]
        near += [x[:2] for x in node.pattern[place + 1 :] if not isinstance(x, HoldsBetween)][:3]
        return frozenset(
            hold
            for hold in (routes.holds if gap.holds is None else gap.holds)
            if hold[1] == particle and hold not in near and routes.allows(hold, change)
        )

    def _branches(self, node: _Node) -> list[Pattern]:
        branching, pattern = node.division, node.pattern
        assert isinstance(branching, _Branching)
        before, gap, after = (
            pattern[: branching.place],
            pattern[branching.place],
            pattern[branching.place + 1 :],
        )
        assert isinstance(gap, HoldsBetween)
        near_gap: Pattern = (HoldsBetween(branching.excluded),) if branching.excluded else ()
        holds = self.routes.holds if gap.holds is None else sorted(gap.holds)
        middles: list[Pattern] = [near_gap]
        excluded = branching.excluded
        beside = after[:1] if branching.right else before[-1:]
        if self.routes.cells.round is not None and not excluded:
            # the hold beside the gap has all contacts up to the gap that it can have
            excluded = frozenset(item for item in beside if not isinstance(item, HoldsBetween))
        middles += [
            (gap, hold, *near_gap) if branching.right else (*near_gap, hold, gap)
            for whole_hold in holds
            for hold in self.routes.without(whole_hold, excluded)
        ]

        def fits(earlier: Item, later: Item) -> bool:
            if isinstance(earlier, HoldsBetween) or isinstance(later, HoldsBetween):
                return True
            return self.routes.follows(earlier, later)

        return [
            (*before, *middle, *after)
            for middle in middles
            if all(fits(*pair) for pair in pairwise((*before[-1:], *middle, *after[:1])))
        ]


def _count_near_holds(pattern: Pattern, place: int) -> int:
    """Return how many neighbours of a gap are holds that may be in the gap."""
    gap = pattern[place]
    assert isinstance(gap, HoldsBetween)
    count = 0
    for side in (pattern[:place][::-1], pattern[place + 1 :]):
        for item in side:
            if gap.holds is None or isinstance(item, HoldsBetween) or item[:2] not in gap.holds:
                break
            count += 1
    return count


class _Trees:
    """The searches for one pair of cells in which the particles end: two, each with half of the
    time.
    """

    def __init__(self, routes: RouteRelaxation) -> None:
        self.ends = routes.ends
        self._trees = [RouteTree(routes, by_use=by_use) for by_use in (False, True)]
        self._spent = [0.0, 0.0]

    @property
    def lower(self) -> float:
        """Lower bound on the length of all plans, at most the limit."""
        return max(tree.lower for tree in self._trees)

    @property
    def upper(self) -> float:
        """Least bound of a pattern that cannot be divided, at most the limit."""
        return min(tree.upper for tree in self._trees)

    @property
    def shortest(self) -> list[Hold] | None:
        """Walls and particles of the pattern with the bound ``upper``; None if that is the limit."""
        return min(self._trees, key=lambda tree: tree.upper).shortest

    def step(self, clock: Callable[[], float]) -> None:
        """Go on with the tree that had less time."""
        number = self._spent.index(min(self._spent))
        begun = clock()
        self._trees[number].step()
        self._spent[number] += clock() - begun

    def proof(self, enough: float) -> list[dict[str, Any]]:
        """Return the proof of the tree with the better bound."""
        return max(self._trees, key=lambda tree: tree.lower).proof(enough)


class RouteSearch:
    """The search for the bound of one assignment of goals to particles: trees for each pair of
    cells in which the particles can end.

    Parameters
    ----------
    cells : Cells
    start, goal : ndarray of float64, shape (2, dimensions)
    tolerance : float
    limit : float
        Length of a known plan.

    Attributes
    ----------
    trees : list
        None if no plan within the limit ends in a cell of its goal.
    possible : bool
        Whether the search can be made: a start is in a cell, and not too many can be reached.
    """

    def __init__(
        self,
        cells: Cells,
        start: NDArray[np.float64],
        goal: NDArray[np.float64],
        tolerance: float,
        limit: float,
    ) -> None:
        self.trees: list[_Trees] = []
        self._limit = limit
        self.relaxation = RouteRelaxation(cells, start, goal, tolerance, limit)
        start_cells = [cell for spot in start if (cell := cells.cell_of(spot)) is not None]
        self.possible = len(start_cells) == len(start) and self.relaxation.explore(start_cells)
        if not self.possible:
            return
        ends = [
            [k for k, cell in enumerate(cover.cells) if cells.may_end(cell, spot, tolerance)]
            for cover, spot in zip(self.relaxation.covers, goal, strict=True)
        ]
        self.trees = [_Trees(self.relaxation.ending_at(pair)) for pair in product(*ends)]

    @property
    def lower(self) -> float:
        """Lower bound on the length of all plans, at most the limit."""
        return min([self._limit, *(tree.lower for tree in self.trees)])

    @property
    def upper(self) -> float:
        """Least bound of a pattern that cannot be divided, at most the limit."""
        return min([self._limit, *(tree.upper for tree in self.trees)])

    @property
    def shortest(self) -> list[Hold] | None:
        """Walls and particles of the pattern with the bound ``upper``; None if that is the limit."""
        return min(self.trees, key=lambda tree: tree.upper).shortest if self.trees else None

    def step(self, clock: Callable[[], float]) -> None:
        """Divide the pattern with the least bound."""
        min(self.trees, key=lambda tree: tree.lower).step(clock)

    def proof(self, enough: float) -> Any:
        """Return a proof that no plan is shorter than ``enough``, as JSON."""
        return {
            "covers": [cover.statement() for cover in self.relaxation.covers],
            "ways": [{"ends": list(tree.ends), "proof": tree.proof(enough)} for tree in self.trees],
        }
