"""Branch and bound over patterns of holds: the shortest plan, and the proof of its bound."""

from __future__ import annotations

import heapq
from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.steering.certificates.relaxation import (
    Bound,
    Branching,
    HoldGap,
    Pattern,
    Programs,
    branches,
)

_OFTEN = 6  # holds of a gap next to it: it has been divided in vain


@dataclass(frozen=False, eq=False)
class Node:
    """A node of the proof: a pattern with its bound, and how it is divided, if it is."""

    pattern: Pattern
    bound: Bound
    how: Any = None
    parts: list[Node] | None = None

    @property
    def open(self) -> bool:
        """Whether the pattern has gaps."""
        return any(isinstance(item, HoldGap) for item in self.pattern)

    def proof(self) -> list[dict[str, Any]]:
        """Return the nodes of the proof below this node as JSON, each before its parts."""
        found, stack = [], [self]
        while stack:
            node = stack.pop()
            if node.how is None:
                found.append(node.bound.proof())
            else:
                found.append(node.how.proof())
                stack += (node.parts or [])[::-1]
        return found


class PatternTree:
    """Branch and bound for one assignment of goals to particles.

    Parameters
    ----------
    relaxation : Programs

    Attributes
    ----------
    root : Node
    best : Node or None
        The shortest pattern without gaps so far; its bound is the infimum of its plans.
    """

    def __init__(self, relaxation: Programs) -> None:
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
        return limit if self.best is None else min(limit, self.best.bound.value)

    @property
    def lower(self) -> float:
        """Lower bound on the length of all plans, at most the limit."""
        return min(self.least_open, self.upper)

    def step(self) -> None:
        """Divide the pattern with the least bound."""
        node = heapq.heappop(self._heap)[-1]
        self._divide(node)
        for one in node.parts or []:
            self._push(one)

    def _divide(self, node: Node) -> None:
        node.how = how = _branching(node.pattern, node.bound.loads)
        node.parts = [self._node(one) for one in branches(self.relaxation, node.pattern, how)]

    def _node(self, pattern: Pattern) -> Node:
        return Node(pattern, self.relaxation.bound(pattern))

    def _push(self, node: Node) -> None:
        if node.open:
            self._made += 1
            heapq.heappush(self._heap, (node.bound.value, -len(node.pattern), self._made, node))
        elif self.best is None or node.bound.value < self.best.bound.value:
            self.best = node


def _branching(pattern: Pattern, loads: dict[int, float]) -> Branching:
    """Return how to divide a pattern: at the gap that holds most of the length.

    A gap of few holds next to many of them has been divided often, which did not help. Another gap
    is then better.
    """
    order = sorted(loads, key=lambda place: (_divided(pattern, place) > _OFTEN, -loads[place]))
    place = order[0]
    gap = pattern[place]
    assert isinstance(gap, HoldGap)
    left, right = pattern[:place][::-1], pattern[place + 1 :]
    last = len(left) > len(right)
    if gap.holds is not None:
        inner = [bool(side) and side[0] in gap.holds for side in (left, right)]
        return Branching(place, right=inner[0] if inner[0] != inner[1] else last)
    near = [item for item in (right if last else left) if not isinstance(item, HoldGap)]
    for count in (4, 3):  # few holds in turn, again and again, become one gap
        if len(near) >= 2 * count and len(set(near[: 2 * count])) <= count:
            return Branching(place, frozenset(near[: 2 * count]), last)
    pair = frozenset(near[:2])
    return Branching(place, pair if len(pair) == 2 else frozenset(), last)


def _divided(pattern: Pattern, place: int) -> int:
    """Return how many neighbours of a gap are holds that may be in the gap."""
    gap = pattern[place]
    assert isinstance(gap, HoldGap)
    found = 0
    for side in (pattern[:place][::-1], pattern[place + 1 :]):
        for item in side:
            if gap.holds is None or item not in gap.holds:
                break
            found += 1
    return found
