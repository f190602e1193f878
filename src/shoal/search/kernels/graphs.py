"""Graphs in compressed rows, in compiled code: shortest paths, fewest steps, connected parts.

The edges of node k lead to the nodes ``ends[first[k] : first[k + 1]]``.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel
from shoal.search.kernels.protocol.steps import sink


@kernel
def distances_from(first, ends, lengths, source):
    """Return the distance from a node to each node, or infinity; float64, shape (n,).

    The algorithm is that of Dijkstra. The lengths of edges are above 0.
    """
    away = np.full(len(first) - 1, np.inf)
    away[source] = 0.0
    keys, nodes = np.empty(len(ends) + 1), np.empty(len(ends) + 1, dtype=np.int64)
    keys[0], nodes[0], size = 0.0, source, 1
    while size:
        so_far, node = keys[0], nodes[0]
        size -= 1
        sink(keys, nodes, size, keys[size], nodes[size])
        if so_far > away[node]:
            continue
        for edge in range(first[node], first[node + 1]):
            other, far = ends[edge], so_far + lengths[edge]
            if far < away[other]:
                away[other] = far
                at = size
                size += 1
                while at > 0 and keys[(at - 1) >> 1] > far:
                    keys[at], nodes[at] = keys[(at - 1) >> 1], nodes[(at - 1) >> 1]
                    at = (at - 1) >> 1
                keys[at], nodes[at] = far, other
    return away


@kernel
def path_to(first, ends, lengths, away, node):
    """Return the nodes of the shortest path that leads to a node from the one at distance 0, as
    `Graph.path` does; int64, shape (k,).
    """
    path, count = np.empty(len(away), dtype=np.int64), 0
    if away[node] == np.inf:
        return path[:0]
    while True:
        path[count] = node
        count += 1
        if away[node] == 0.0:
            break
        for edge in range(first[node], first[node + 1]):
            if away[ends[edge]] + lengths[edge] == away[node]:
                node = ends[edge]
                break
    return path[:count][::-1].copy()


@kernel
def breadth_first_predecessors(first, ends, source, last):
    """Return the node before each node on a path of the fewest steps from a node, or -1 for this
    node itself and for those that no path reaches; int64, shape (n,). Once the node ``last`` is
    reached, the search ends.
    """
    before = np.full(len(first) - 1, -1, dtype=np.int64)
    queue = np.empty(len(first) - 1, dtype=np.int64)
    queue[0], at, count = source, 0, 1
    while at < count and (last < 0 or before[last] < 0):
        node = queue[at]
        at += 1
        for edge in range(first[node], first[node + 1]):
            other = ends[edge]
            if before[other] < 0 and other != source:
                before[other] = node
                queue[count] = other
                count += 1
    return before


@kernel
def connected_components(first, ends):
    """Return the number of each node's connected part; int64, shape (n,). All edges lead both
    ways.
    """
    labels = np.full(len(first) - 1, -1, dtype=np.int64)
    stack, part = np.empty(len(first) - 1, dtype=np.int64), 0
    for root in range(len(labels)):
        if labels[root] >= 0:
            continue
        labels[root], stack[0], size = part, root, 1
        while size:
            size -= 1
            node = stack[size]
            for edge in range(first[node], first[node + 1]):
                other = ends[edge]
                if labels[other] < 0:
                    labels[other], stack[size] = part, other
                    size += 1
        part += 1
    return labels
