"""Links between position differences of two particles, and the search for the path with the fewest links.

A position difference is the position of the second particle minus the position of the first. In a cycle, one particle moves to a
wall, and then the wall holds this particle while the other particle moves. A link from a position difference D to a position
difference E means that one cycle can change D into E.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel
from shoal.steering.kernels.contact import dot
from shoal.steering.kernels.cycles import contact_range

HALVINGS = 24
SHARES = 4  # number of adjustments tried in each direction: the longest adjustment, 1/2 of its length, 1/4, ...


@kernel
def linked(before, after, model, step):
    """Return whether one cycle (contact and adjustment) can change the position difference ``before`` into ``after``.

    If such a cycle exists, write to ``step`` the index of the toucher (the particle that the wall holds), the index of the wall,
    and the position of the contact along the wall.
    """
    if model.circle[2] > 0:
        return linked_on_circle(before, after, model, step)
    normals, frames, reaches, margin = model.normals, model.frames, model.reaches, model.margin
    change = np.empty(2)
    change[0], change[1] = after[0] - before[0], after[1] - before[1]
    for wall in range(normals.shape[0]):
        pushed, height, end = dot(normals[wall], change), dot(normals[wall], before), dot(normals[wall], after)
        along = abs(dot(frames[wall, 1], change))
        sign = 1.0 if pushed < 0 else -1.0
        if abs(pushed) < model.push or along > model.friction * abs(pushed) or sign * height < margin or sign * end < 0:
            continue
        # The particle that is not held may touch the toucher's wall only at the end of the whole path.
        reach = reaches[wall] - margin
        low, high = contact_range(before, sign, wall, model, -reach, reach, margin)
        if low > high:
            continue
        low, high = contact_range(after, sign, wall, model, low, high, margin)
        if low <= high:
            step[0], step[1], step[2] = 0.0 if sign > 0 else 1.0, float(wall), (low + high) / 2
            return True
    return False


@kernel
def linked_on_circle(before, after, model, step):
    """Return whether one cycle on a disk can change the position difference ``before`` into ``after``. See `linked`.

    The toucher (the particle that the wall holds) is always the first particle. A cycle exists if three arcs of the circle
    intersect. The first arc contains the contacts at which the other particle is inside the disk before its move. The second arc
    contains the contacts at which the other particle is inside the disk after its move. The third arc contains the contacts at
    which the wall holds the toucher.
    """
    radius, inner = model.circle[2], model.circle[2] - model.margin
    x, y = after[0] - before[0], after[1] - before[1]
    way = np.sqrt(x * x + y * y)
    if way <= model.push:
        return False
    middle = np.arctan2(y, x)
    half = min(np.arctan(model.friction) if model.friction < np.inf else np.pi / 2, np.arccos(model.push / way))
    low, high = -half, half
    for end in (before, after):
        size = np.sqrt(dot(end, end))
        cosine = (radius**2 + size**2 - inner**2) / (2 * radius * size) if size > 0 else 2.0
        if cosine > 1:
            return False
        half = np.arccos(cosine)
        turn = np.arctan2(-end[1], -end[0]) - middle
        turn = (turn + np.pi) % (2 * np.pi) - np.pi
        low, high = max(low, turn - half), min(high, turn + half)
    if low > high:
        return False
    step[0], step[1], step[2] = 0.0, 0.0, (middle + (low + high) / 2) * radius
    return True


@kernel
def farthest(delta, direction, back, most, model, tried, step):
    """Return the largest change of a position difference that one cycle can make in a direction, or 0 if no cycle is possible.

    The cycle starts with the position difference ``delta`` or, if ``back`` is true, ends with ``delta``.
    """
    inner, outer = 0.0, most
    for halving in range(HALVINGS):
        middle = outer if halving == 0 else (inner + outer) / 2
        for i in range(2):
            tried[i] = delta[i] + (-middle if back else middle) * direction[i]
        good = linked(tried, delta, model, step) if back else linked(delta, tried, model, step)
        if good:
            inner = middle
        else:
            outer = middle
        if inner == outer:
            break
    return inner


@kernel
def widen(delta, back, directions, most, model, gain, records, nodes, count):
    """Find position differences that cycles can reach from ``delta``, and append the extreme ones to ``nodes``.

    ``delta`` is a position difference, too. The result is the new number of nodes. A position difference is extreme if it is longer
    than all earlier nodes in about the same direction. If ``back`` is true, the kernel instead adds position differences from which
    cycles can reach ``delta``. In this case, a position difference is extreme if it is shorter than all earlier nodes in about the
    same direction. ``records`` holds the most extreme length in each range of directions.
    """
    step, tried, bins = np.empty(3), np.empty(2), records.shape[0]
    size = np.sqrt(dot(delta, delta))
    records[int((np.arctan2(delta[1], delta[0]) / (2 * np.pi) + 1) * bins) % bins] = size
    nodes[count] = delta
    done, count = count, count + 1
    while done < count < nodes.shape[0]:
        here = nodes[done].copy()
        done += 1
        size = np.sqrt(dot(here, here))
        place = int((np.arctan2(here[1], here[0]) / (2 * np.pi) + 1) * bins) % bins
        if done > 1 and size != records[place]:
            continue  # the search has meanwhile found a more extreme difference in the same range of directions
        for d in range(directions.shape[0]):
            length = farthest(here, directions[d], back, most, model, tried, step)
            if length <= 2 * model.push:
                continue
            for share in range(SHARES):
                part = length * 0.5**share * (1 - 1e-6)
                for i in range(2):
                    tried[i] = here[i] + (-part if back else part) * directions[d, i]
                size = np.sqrt(dot(tried, tried))
                place = int((np.arctan2(tried[1], tried[0]) / (2 * np.pi) + 1) * bins) % bins
                better = size * gain < records[place] if back else size > records[place] * gain
                if better and size > 1e-4 and count < nodes.shape[0]:
                    records[place] = size
                    nodes[count] = tried
                    count += 1
    return count


@kernel
def fewest_cycles(nodes, model, parents, order):
    """Search breadth-first for the path with the fewest cycles from node 0 to node 1. Return whether a path exists.

    Write the parent of each node to ``parents``, and -1 for each node that the search has not reached. The array ``order`` is
    working memory.
    """
    count, step = nodes.shape[0], np.empty(3)
    parents[:] = -1
    order[0], parents[0] = 0, 0
    done, found = 0, 1
    while done < found:
        here = order[done]
        done += 1
        for node in range(1, count):
            if parents[node] < 0 and linked(nodes[here], nodes[node], model, step):
                parents[node] = here
                if node == 1:
                    return True
                order[found] = node
                found += 1
    return False
