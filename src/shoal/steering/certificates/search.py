"""Branch and bound over patterns of holds: the shortest plan, and the proof of its bound."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.steering.certificates.relaxation import (
    Bound,
    Branching,
    Gap,
    Hold,
    Pattern,
    Relaxation,
    branches,
)

_RISE = 1e-6  # relative: a bound that rises by less has not risen


@dataclass(frozen=False, eq=False)
class Node:
    """A node of the proof: a pattern with its bound, and how it is divided, if it is."""

    pattern: Pattern
    bound: Bound
    how: Branching | None = None
    parts: list[Node] | None = None

    @property
    def open(self) -> bool:
        """Whether the pattern has gaps."""
        return any(isinstance(item, Gap) for item in self.pattern)

    def proof(self) -> list[dict[str, Any]]:
        """Return the nodes of the proof below this node as JSON, each before its parts."""
        found, stack = [], [self]
        while stack:
            node = stack.pop()
            if node.how is None:
                kept = np.flatnonzero(node.bound.slacks)
                slacks = [[int(k), float(node.bound.slacks[k])] for k in kept]
                found.append({"norms": node.bound.norms.tolist(), "slacks": slacks})
            else:
                known = [list(hold) for hold in sorted(node.how.known)]
                side = "last" if node.how.right else "first"
                found.append({"place": node.how.place, "known": known, "side": side})
                stack += (node.parts or [])[::-1]
        return found


class Tree:
    """Branch and bound for one assignment of goals to particles.

    Parameters
    ----------
    relaxation : Relaxation

    Attributes
    ----------
    root : Node
    best : Node or None
        The shortest pattern without gaps so far; its bound is the infimum of its plans.
    """

    def __init__(self, relaxation: Relaxation) -> None:
        self.relaxation = relaxation
        self.root = self._node((Gap(),))
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
        enough = node.bound.value * (1 + _RISE)
        choice: tuple[tuple[float, int], Branching, list[Node]] | None = None
        for how in _branchings(node.pattern, node.bound.loads):
            parts = [self._node(one) for one in branches(self.relaxation, node.pattern, how)]
            low = min((one.bound.value for one in parts), default=np.inf)
            score = (low, -sum(one.bound.value <= enough for one in parts))
            if choice is None or score > choice[0]:
                choice = (score, how, parts)
            if low > enough:
                break
        assert choice is not None
        node.how, node.parts = choice[1], choice[2]
        for one in node.parts:
            self._push(one)

    def _node(self, pattern: Pattern) -> Node:
        return Node(pattern, self.relaxation.bound(pattern))

    def _push(self, node: Node) -> None:
        if node.open:
            self._made += 1
            heapq.heappush(self._heap, (node.bound.value, -len(node.pattern), self._made, node))
        elif self.best is None or node.bound.value < self.best.bound.value:
            self.best = node


def _branchings(pattern: Pattern, loads: dict[int, float]) -> Iterator[Branching]:
    """Yield ways to divide a pattern, the most promising first."""
    for place in sorted(loads, key=lambda place: (-loads[place], place)):
        gap = pattern[place]
        assert isinstance(gap, Gap)
        left, right = pattern[:place][::-1], pattern[place + 1 :]
        sides = [False, True] if len(left) <= len(right) else [True, False]
        if gap.holds is not None and left and right:
            inner = [side[0] in gap.holds for side in (left, right)]
            if inner[0] != inner[1]:
                sides = [inner[0], inner[1]]
        for side in sides:
            near: list[Hold] = []
            for item in right if side else left:
                if isinstance(item, Gap) or len(near) == 2:
                    break
                if item not in near:
                    near.append(item)
            pair = gap.holds is None and len(near) == 2
            yield Branching(place, frozenset(near) if pair else frozenset(), side)
