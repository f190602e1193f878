"""Branch and bound over patterns of holds: the shortest plan, and the proof of its bound."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from concurrent.futures import Executor
from math import inf
from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.steering.certificates.contacts import ContactSearch
from shoal.steering.certificates.relaxation import (
    Bound,
    Branching,
    GapBranching,
    Hold,
    HoldBranching,
    HoldGap,
    Pattern,
    Relaxation,
    branches,
    gap_branching,
    use_branchings,
)

_USEFUL = 0.01  # least rise of a division by use, relative to the gap
_HOLDS_FIRST = 4.0  # how much more the error of a hold counts than that of a gap
_PIECES = 256  # of the least distance in the law of growth
_EASY = 250  # divisions that are enough for easy problems; a potential takes the time of as many
_BETTER = 0.9  # gap of a potential that is much smaller than that of the patterns, relative
_DOUBLED = (
    250  # divisions after which, and after twice as many again and again, the gap is compared
)
_FAIR = 36  # programs of potentials between contacts that show whether these are of use
_WORSE = 1.25  # gap of those with which they are of none, relative to that of the patterns
_STALLED = 0.88, 0.93  # a gap above 5 %, and a smaller one, after twice as many divisions, relative
_TARGETS = 1.0499, 1.0099, 1.00099  # lengths of plans, in units of those that potentials exclude
_OFTEN = 6  # holds of a gap next to it: it has been divided in vain


@dataclass(frozen=False, eq=False)
class Node:
    """A node of the proof: a pattern with its bound, and how it is divided, if it is."""

    pattern: Pattern
    bound: Bound
    least: float = 0.0
    branching: Branching | None = None
    children: list[Node] | None = None

    @property
    def open(self) -> bool:
        """Whether the pattern has gaps, or holds by several walls."""
        return bool(self.bound.errors)

    def proof(self, enough: float) -> list[dict[str, Any]]:
        """Return the nodes of the proof below this node as JSON, each before its parts.

        A node whose own multipliers prove ``enough`` needs no parts.
        """
        nodes, stack = [], [self]
        while stack:
            node = stack.pop()
            bound = node.bound
            if node.branching is None or bound.value >= enough:
                nodes.append(
                    {"norms": bound.norms.tolist()}
                    | {
                        name: [
                            [int(k), *np.atleast_1d(values[k]).tolist()]
                            for k in np.unique(np.nonzero(values)[0])
                        ]
                        for name, values in (("slacks", bound.slacks), ("cones", bound.cones))
                    }
                )
                continue
            branching = node.branching
            if isinstance(branching, HoldBranching):
                nodes.append(
                    {"place": branching.place, "name": branching.name, "wall": branching.wall}
                )
            else:
                nodes.append(
                    {
                        "place": branching.place,
                        "known": [list(arc) for arc in sorted(branching.excluded)],
                        "side": "last" if branching.right else "first",
                        "choices": [
                            [hold.particle, *(hold.last if branching.right else hold.first)]
                            for hold in branching.choices
                        ],
                    }
                )
            stack += (node.children or [])[::-1]
        return nodes


class PatternTree:
    """Branch and bound for one assignment of goals to particles.

    Parameters
    ----------
    relaxation : Relaxation
    by_use : bool
        Whether to prefer to divide a gap by whether it has a hold somewhere, rather than by its
        first hold. For some tasks, this is much better, for others much worse.

    Attributes
    ----------
    root : Node
    best : Node or None
        The shortest pattern without gaps so far; its bound is the infimum of its plans.
    """

    def __init__(self, relaxation: Relaxation, *, by_use: bool = False) -> None:
        self.by_use = by_use
        self.relaxation = relaxation
        self.root = self._node((HoldGap(),))
        self.best: Node | None = None
        self._heap: list[tuple[float, int, int, Node]] = []
        self._made = 0
        self._push(self.root)

    @property
    def least_open(self) -> float:
        """Least bound of a pattern that can be divided."""
        return self._heap[0][0] if self._heap else np.inf

    @property
    def upper(self) -> float:
        """Least infimum of a pattern without gaps, at most the limit."""
        limit = self.relaxation.limit * self.relaxation.scale
        return limit if self.best is None else min(limit, self.best.least)

    @property
    def lower(self) -> float:
        """Lower bound on the length of all plans, at most the limit."""
        return min(self.least_open, self.upper)

    def step(self) -> None:
        """Divide the pattern with the least bound."""
        node = heapq.heappop(self._heap)[-1]
        errors, pattern = node.bound.errors, node.pattern
        node.branching = _branching(self.relaxation, pattern, errors)
        by_use = None
        if self.by_use and isinstance(node.branching, GapBranching):
            by_use = self._by_use(node, node.branching.place, right=node.branching.right)
        if by_use is not None:
            node.branching, node.children = by_use
        else:
            node.children = [
                self._node(child_pattern)
                for child_pattern in branches(self.relaxation, pattern, node.branching)
            ]
        for child in node.children:
            self._push(child, node.least)

    def _by_use(
        self, node: Node, place: int, *, right: bool
    ) -> tuple[GapBranching, list[Node]] | None:
        """Return the best division of a gap by whether it has contacts outside some arcs, with the
        nodes of its parts; None if no such division raises the bound enough.
        """
        best: tuple[float, GapBranching, list[Node]] | None = None
        most = _USEFUL * (self.upper - node.least)
        for branching in use_branchings(self.relaxation, node.pattern, place, right=right):
            children: list[Node] = []
            least, greatest = inf, 0.0
            for pattern in branches(self.relaxation, node.pattern, branching):
                child = self._node(pattern)
                rise = max(child.bound.value - node.least, 0.0)
                least, greatest = min(least, rise), max(greatest, rise)
                children.append(child)
                if least + 0.1 * (self.upper - node.least) < most:
                    break
            else:
                if least + 0.1 * greatest > most:
                    most, best = least + 0.1 * greatest, (least, branching, children)
        return None if best is None else best[1:]

    def _node(self, pattern: Pattern) -> Node:
        return Node(pattern, self.relaxation.bound(pattern))

    def _push(self, node: Node, least: float = 0.0) -> None:
        """Add a node whose plans are at least as long as ``least``, as those of its parent."""
        node.least = max(node.bound.value, least)
        if node.open:
            self._made += 1
            heapq.heappush(self._heap, (node.least, -len(node.pattern), self._made, node))
        elif self.best is None or node.least < self.best.least:
            self.best = node


def _branching(
    relaxation: Relaxation, pattern: Pattern, errors: dict[int, tuple[float, str, int]]
) -> Branching:
    """Return how to divide a pattern: at the item with the greatest error.

    A gap of few holds next to many of them has been divided often, which did not help. Another gap
    is then better.
    """

    def rank(place: int) -> tuple[bool, float]:
        if isinstance(pattern[place], HoldGap):
            return _count_near_holds(pattern, place) > _OFTEN, -errors[place][0]
        return False, -errors[place][0] * _HOLDS_FIRST

    place = min(errors, key=rank)
    item = pattern[place]
    if isinstance(item, Hold):
        return HoldBranching(place, *errors[place][1:])
    left, right = pattern[:place][::-1], pattern[place + 1 :]
    from_right = len(left) > len(right)
    if relaxation.walls.runs:
        # runs that may be anywhere can take turns again and again without any length
        beside = (place + 1, place + 2) if from_right else (place - 1, place - 2)
        runs = [pattern[k] for k in beside if 0 <= k < len(pattern)]
        for k, run in zip(beside, runs, strict=False) if len(runs) == len(beside) else ():
            narrow = relaxation.narrowing(run) if isinstance(run, Hold) else None
            if narrow is not None:
                return HoldBranching(k, *narrow)
    if item.holds is not None:
        inner = [
            bool(side) and isinstance(side[0], Hold) and side[0].arc in item.holds
            for side in (left, right)
        ]
        from_right = inner[0] if inner[0] != inner[1] else from_right
        return gap_branching(relaxation, pattern, place, frozenset(), right=from_right)
    near = [item.arc for item in (right if from_right else left) if isinstance(item, Hold)]
    excluded = frozenset(near[:2])
    widest = max((arc.end - arc.first for arc in excluded), default=0)
    if len(excluded) < 2 or (relaxation.walls.runs and widest > 4 * relaxation.margin):
        excluded = frozenset()
    # few holds in turn, again and again, become one gap
    for count in () if relaxation.walls.runs else (4, 3):
        if len(near) >= 2 * count and len(set(near[: 2 * count])) <= count:
            excluded = frozenset(near[: 2 * count])
            break
    return gap_branching(relaxation, pattern, place, excluded, right=from_right)


def _count_near_holds(pattern: Pattern, place: int) -> int:
    """Return how many neighbours of a gap are holds that may be in the gap."""
    gap = pattern[place]
    assert isinstance(gap, HoldGap)
    count = 0
    for side in (pattern[:place][::-1], pattern[place + 1 :]):
        for item in side:
            if gap.holds is None or isinstance(item, HoldGap) or item.arc not in gap.holds:
                break
            count += 1
    return count


class Search:
    """The searches for the bound of one assignment of goals to particles.

    With few flat walls, these are two, each with half of the time. Otherwise there is one, and a
    potential comes in between, if the first patterns were not enough. When more patterns
    are of little use, potentials between the first and the last contact take their place; with
    several processors, all but one begin with these at once.

    Parameters
    ----------
    relaxation : Relaxation
    pool : Executor
        Threads for potentials between contacts.
    workers : int
        Number of these threads.
    """

    def __init__(self, relaxation: Relaxation, pool: Executor, workers: int) -> None:
        self.relaxation, self._pool, self._workers = relaxation, pool, workers
        variants = (False,) if relaxation.walls.runs else (False, True)
        self._trees = [PatternTree(relaxation, by_use=by_use) for by_use in variants]
        self._spent = [0.0] * len(variants)
        self.growth = growth_bound(relaxation)
        self._potentials: list[tuple[float, Any]] = []
        self._contacts: ContactSearch | None = None
        self._steps = 0
        self._before = inf  # the gap after half of the steps
        self._stalled = self._compared = False

    @property
    def lower(self) -> float:
        """Lower bound on the length of all plans, at most the limit."""
        contacts = self._length(self._contacts.lower) if self._contacts else 0.0
        potentials = [bound for bound, _ in self._potentials]
        return max(self.growth, contacts, *potentials, *(tree.lower for tree in self._trees))

    def proof(self, enough: float) -> Any:
        """Return a proof that no plan is shorter than ``enough``, as JSON."""
        if self.growth and self.growth >= enough:
            return "growth"
        for bound, proof in self._potentials:
            if bound and bound >= enough:
                return proof
        if self._contacts and self._length(self._contacts.lower) >= enough:
            return self._contacts.proof(self._contacts.lower)
        return max(self._trees, key=lambda tree: tree.lower).root.proof(enough)

    @property
    def upper(self) -> float:
        """Least bound of a pattern without gaps, at most the limit."""
        return self.shortest.upper

    @property
    def shortest(self) -> PatternTree:
        """The tree with the shortest plan."""
        return min(self._trees, key=lambda tree: tree.upper)

    def step(self, clock: Callable[[], float]) -> None:
        """Go on with the tree that had less time, or with potentials."""
        if self._contacts is not None:
            self._step_contacts(self._contacts)
        if self._stalled:
            return
        self._steps += 1
        if self.relaxation.walls.runs and self._steps == _EASY:
            began = self._workers > 1 and self._next_contacts()
            self._potentials.append(potential_bound(self.relaxation))
            if self._gap(self._potentials[0][0]) < _BETTER * self._gap_of_patterns:
                self._stalled = began or self._next_contacts()
        number = min(range(len(self._trees)), key=lambda k: self._spent[k])
        begun = clock()
        self._trees[number].step()
        self._spent[number] += clock() - begun
        times, rest = divmod(self._steps, _DOUBLED)
        if self.relaxation.walls.runs and not rest and times.bit_count() == 1:
            gap = self._gap_of_patterns
            stalled = gap > _STALLED[gap < _TARGETS[0] - 1] * self._before
            self._stalled = stalled and (self._contacts is not None or self._next_contacts())
            self._before = gap

    def _gap(self, bound: float) -> float:
        return self.upper / max(bound, 1e-9) - 1

    @property
    def _gap_of_patterns(self) -> float:
        return self._gap(max(self.growth, self._trees[0].lower))

    def _length(self, bound: float) -> float:
        """Return a length in units of the radius as one of the programs."""
        unit, _ = self.relaxation.walls.rings or (0.0, 0.0)
        return min(bound * unit * (1 - 1e-12), self.relaxation.limit) * self.relaxation.scale

    def _step_contacts(self, contacts: ContactSearch) -> None:
        contacts.step(self._workers - (not self._stalled), patient=self._stalled)
        if contacts.lower >= contacts.limit:
            self._potentials.append((self._length(contacts.limit), contacts.proof(contacts.limit)))
            self._stalled = self._next_contacts() and self._stalled
        elif self._stalled and contacts.tried >= _FAIR and not self._compared:
            self._compared = True
            gap = self._gap(self._length(contacts.lower))
            self._stalled = gap < _WORSE * self._gap_of_patterns

    def _next_contacts(self) -> bool:
        """Begin to exclude plans longer than those excluded so far; return whether there are any."""
        walls, relaxation = self.relaxation.walls, self.relaxation
        unit, ring = walls.rings or (0.0, 0.0)
        self._contacts = None
        for shorter in _TARGETS:
            target = self.upper / shorter
            if target > self.lower * (1 + 1e-9):
                contacts = ContactSearch(
                    self._pool,
                    (relaxation.start - walls.middle) / unit,
                    (relaxation.goal - walls.middle) / unit,
                    relaxation.tolerance / unit,
                    target / relaxation.scale / unit,
                    ring / unit**2,
                )
                if contacts.possible:
                    self._contacts = contacts
                    contacts.step(self._workers - 1, patient=False)
                break
        return self._contacts is not None


def potential_bound(relaxation: Relaxation) -> tuple[float, Any]:
    """Return the bound of a potential at round walls, at most the limit, with its proof."""
    from shoal.steering.certificates.potential import find_potential

    walls = relaxation.walls
    unit, ring = walls.rings or (0.0, 0.0)
    bound, proof = find_potential(
        (relaxation.start - walls.middle) / unit,
        (relaxation.goal - walls.middle) / unit,
        relaxation.tolerance / unit,
        relaxation.limit / unit,
        ring / unit**2,
    )
    return min(bound * unit * (1 - 1e-12), relaxation.limit) * relaxation.scale, proof


def growth_bound(relaxation: Relaxation) -> float:
    """Return the bound of a disk from the law of growth, as the checker computes it; 0 if there is
    none.
    """
    radius = relaxation.walls.radius
    start, goal = (points[1] - points[0] for points in (relaxation.start, relaxation.goal))
    slack = 3 * relaxation.tolerance
    straight = float(np.hypot(*(goal - start))) - slack
    if not radius or straight <= 0:
        return 0.0
    far = [float(np.hypot(*end)) for end in (start, goal)]
    most = min(far[0], far[1] + slack)
    outer = most * np.arange(1, _PIECES + 1) / _PIECES
    inner = most * np.arange(_PIECES) / _PIECES - slack
    path = np.full(_PIECES, straight)
    around = (inner > 0) & (inner < min(far))
    if around.any():
        least = inner[around]
        turn = np.arccos(np.clip(start @ goal / (far[0] * far[1]), -1, 1))
        between = turn - sum(np.arccos(least / end) for end in far)
        tangent_path = sum(np.sqrt(end**2 - least**2) for end in far) + least * between - slack
        path[around] = np.where(between > 0, np.maximum(tangent_path, straight), straight)
    grown = 2 * radius * np.arcsin(min(max(far[1] - slack, 0.0) / (2 * radius), 1.0))
    path += np.maximum(grown - radius * np.arccos(np.maximum(1 - outer / radius, -1.0)), 0)
    # the checker rounds down
    return float(
        min(path.min() * (1 - 1e-12) * relaxation.scale, relaxation.limit * relaxation.scale)
    )
