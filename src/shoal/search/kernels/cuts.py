"""Minimum cuts, in compiled code."""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel


@kernel
def source_side(offsets, ends, back, capacity, supply, drain):
    """Return the nodes on the source's side of the minimum cut that has the fewest nodes there;
    bool, shape (n,).

    The algorithm is that of E. A. Dinic (1970). All capacities are changed.

    ``ends[offsets[k] : offsets[k + 1]]`` are the nodes to which the arcs of node k lead, and
    ``capacity`` their capacities. ``back[a]`` is the arc in the opposite direction of the arc a.
    ``supply`` and ``drain`` (n,) are the capacities from the source to each node, and from each
    node to the sink.
    """
    n = len(supply)
    level, following = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    queue, path = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    while True:
        level[:] = -1
        count, at, reached = 0, 0, False
        for node in range(n):
            if supply[node] > 0:
                level[node] = 0
                queue[count] = node
                count += 1
        while at < count:
            node = queue[at]
            at += 1
            reached = reached or drain[node] > 0
            for arc in range(offsets[node], offsets[node + 1]):
                other = ends[arc]
                if capacity[arc] > 0 and level[other] < 0:
                    level[other] = level[node] + 1
                    queue[count] = other
                    count += 1
        if not reached:
            return level >= 0
        following[:] = offsets[:-1]
        for start in range(n):
            while supply[start] > 0:
                depth, node = 0, start
                while drain[node] <= 0:
                    while following[node] < offsets[node + 1]:
                        arc = following[node]
                        if capacity[arc] > 0 and level[ends[arc]] == level[node] + 1:
                            break
                        following[node] += 1
                    if following[node] < offsets[node + 1]:
                        path[depth] = following[node]
                        node = ends[path[depth]]
                        depth += 1
                    elif depth == 0:
                        break
                    else:
                        depth -= 1
                        node = ends[back[path[depth]]]
                        following[node] += 1
                if drain[node] <= 0:
                    break
                flow = min(supply[start], drain[node])
                for k in range(depth):
                    flow = min(flow, capacity[path[k]])
                supply[start] -= flow
                drain[node] -= flow
                for k in range(depth):
                    capacity[path[k]] -= flow
                    capacity[back[path[k]]] += flow
