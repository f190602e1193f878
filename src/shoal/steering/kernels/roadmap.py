"""Links between differences that one cycle connects, and the shortest sequence of cycles over given differences."""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel
from shoal.steering.kernels.contact import dot
from shoal.steering.kernels.cycles import contact_range

HALVINGS = 24
SHARES = 4  # number of adjustments tried in a direction: the longest one, 1/2 of it, 1/4, ...


@kernel
def linked(before, after, model, step):
    """Return whether one cycle changes a difference into another. Write its toucher, wall and contact as in a chain."""
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
        # The other particle may touch the same wall only at the end of the whole path.
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
    """Do the same as `linked` for a disk with particle 1 touching. Three arcs of contacts must intersect."""
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
    """Return how far one cycle leads in a direction from a difference or, with ``back``, to it; 0 if it does not."""
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
    """Add to ``nodes`` extreme differences that cycles reach from ``delta`` or, with ``back``, from which they lead to ``delta``.

    A difference is extreme if it is larger than all found before in about the same direction or, with ``back``, smaller.
    ``records`` holds the best of each direction. Return the new number of nodes.
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
            continue  # a more extreme difference was found after it
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
    """Breadth-first search from node 0 until node 1 is reached. Write the parent of each node, -1 if it is not reached.

    ``order`` is working memory. Return whether node 1 was reached.
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
