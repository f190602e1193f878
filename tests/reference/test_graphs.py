"""Searches of graphs, against relaxing all edges until nothing changes."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from tests.without_compiler import printed

from shoal.search.cells.graphs import Graph


def edges(seed, n=30):
    """Return random pairs of nodes, some of them twice, and lengths of which many are equal."""
    rng = np.random.default_rng(seed)
    one, other = rng.integers(0, n, (2, 40))
    there = one != other
    return one[there], other[there], rng.integers(1, 4, 40)[there] / 2


def relaxed(one, other, lengths, n, here):
    """Return the distances from a node."""
    away = [inf] * n
    away[here] = 0.0
    for _ in range(n):
        for a, b, far in zip(one, other, lengths, strict=True):
            away[a], away[b] = min(away[a], away[b] + far), min(away[b], away[a] + far)
    return away


def plain_way(one, other, lengths, away, node):
    """Return the shortest path that comes, seen from its end, from the lowest node."""
    if away[node] == inf:
        return []
    way = [node]
    while away[way[0]] > 0:
        both = [*zip(one, other, lengths, strict=True), *zip(other, one, lengths, strict=True)]
        way.insert(0, min(a for a, b, far in both if b == way[0] and away[a] + far == away[b]))
    return way


def compare(seed, n=30):
    one, other, lengths = edges(seed, n)
    graph = Graph.from_edges(one, other, lengths, n)
    plain = [relaxed(one, other, lengths, n, here) for here in range(n)]
    steps = [relaxed(one, other, np.ones(len(one)), n, here) for here in range(n)]
    for here in range(n):
        away = graph.distances(here)
        assert away.tolist() == plain[here]
        for node in range(n):
            assert graph.path(away, node).tolist() == plain_way(one, other, lengths, away, node)
        before = graph.predecessors(here).tolist()
        for node, prior in enumerate(before):
            assert (prior < 0) == (node == here or steps[here][node] == inf)
            assert prior < 0 or steps[here][prior] + 1 == steps[here][node]
            assert prior < 0 or steps[prior][node] == 1
    labels = graph.components()
    together = labels[:, None] == labels
    assert together.tolist() == [[away < inf for away in row] for row in plain]


@pytest.mark.parametrize("seed", range(6))
def test_against_relaxing(seed):
    compare(seed)


def test_without_the_compiler():
    script = "from tests.reference.test_graphs import compare; compare(7); print('equal')"
    assert printed(script) == "equal\n"
