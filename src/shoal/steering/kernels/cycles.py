"""Position differences that cycles of contacts reach, in compiled code: one cycle, roadmaps of cycles,
sets that many cycles reach, and barriers of friction.
"""

from __future__ import annotations

from math import acos, atan2, cos, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel, kernel
from shoal.steering.kernels.contact import dot


class CycleModel(NamedTuple):
    """The walls, as in `NormalizedWalls`, and the constants that define which cycles are
    possible.
    """

    frames: NDArray[np.float64]  # (walls, d, d)
    reaches: NDArray[np.float64]  # (walls,)
    normals: NDArray[np.float64]  # (walls, d)
    offsets: NDArray[np.float64]  # (walls,)
    circle: NDArray[np.float64]  # (3,)
    friction: float
    margin: float  # least distance of the other particle (not the toucher) from walls
    push: float  # least component of an adjustment into the wall that holds the toucher


ANGLES = 96
FLAT = 1e-14


@in_place_kernel
def contact_range(delta, sign, wall, model, low, high, margin):
    """Return the range of the toucher's contacts on a wall for which the other particle keeps
    ``margin`` from all walls.

    The result is the part of the range from ``low`` to ``high`` that satisfies this condition. Its
    two ends are positions along the wall, measured from the wall's midpoint. If no contact
    satisfies the condition, the first end is greater than the second end.
    """
    frames, normals, offsets = model.frames, model.normals, model.offsets
    for other_wall in range(normals.shape[0]):
        rate = dot(normals[other_wall], frames[wall, 1])
        clear = (
            dot(normals[other_wall], frames[wall, 0])
            + sign * dot(normals[other_wall], delta)
            - offsets[other_wall]
            - margin
        )
        if abs(rate) <= FLAT:
            if other_wall != wall and clear < 0:
                return 1.0, 0.0
        elif rate > 0:
            low = max(low, -clear / rate)
        else:
            high = min(high, -clear / rate)
    return low, high


@in_place_kernel
def clip(corners, count, across, up, offset, spare):
    """Cut a convex polygon in place: keep its points p with ``(across, up) @ p >= offset``. Return
    the number of corners left.
    """
    number = 0
    for i in range(count):
        k = i + 1 if i + 1 < count else 0
        depth = across * corners[i, 0] + up * corners[i, 1] - offset
        next_depth = across * corners[k, 0] + up * corners[k, 1] - offset
        if depth >= 0:
            spare[number, 0], spare[number, 1] = corners[i, 0], corners[i, 1]
            number += 1
        if (depth > 0 and next_depth < 0) or (depth < 0 and next_depth > 0):
            share = depth / (depth - next_depth)
            for j in range(2):
                spare[number, j] = corners[i, j] + share * (corners[k, j] - corners[i, j])
            number += 1
    copy_rows(spare, number, corners)
    return number


@in_place_kernel
def copy_rows(source, count, target):
    for i in range(count):
        target[i, 0], target[i, 1] = source[i, 0], source[i, 1]


@in_place_kernel
def nearest_in(corners, count, point, nearest):
    """Write to ``nearest[3:5]`` the point of a convex counter-clockwise polygon that is nearest to
    ``point``.

    Return the distance from ``point`` to the polygon, 0 if ``point`` is inside the polygon.
    """
    inside, best = count > 2, np.inf
    for i in range(count):
        k = i + 1 if i + 1 < count else 0
        ex, ey = corners[k, 0] - corners[i, 0], corners[k, 1] - corners[i, 1]
        px, py = point[0] - corners[i, 0], point[1] - corners[i, 1]
        if ex * py - ey * px < 0:
            inside = False
        square = ex * ex + ey * ey
        share = min(max((ex * px + ey * py) / square, 0.0), 1.0) if square > 0 else 0.0
        away = sqrt((px - share * ex) ** 2 + (py - share * ey) ** 2)
        if away < best:
            best = away
            nearest[3], nearest[4] = corners[i, 0] + share * ex, corners[i, 1] + share * ey
    if inside:
        nearest[3], nearest[4] = point[0], point[1]
        return 0.0
    return best


@in_place_kernel
def cycle_outline(delta, sign, wall, model, corners, spare):
    """Write to ``corners`` the polygon of all vectors from the toucher to the other particle after
    a cycle on one wall.

    Return the number of corners, or 0 if no cycle is possible.
    """
    frames, reaches, normals, offsets = model.frames, model.reaches, model.normals, model.offsets
    friction, margin, push = model.friction, model.margin, model.push
    height = sign * dot(normals[wall], delta)
    if height <= margin + push:
        return 0
    low, high = contact_range(
        delta, sign, wall, model, margin - reaches[wall], reaches[wall] - margin, margin
    )
    if high < low:
        return 0
    wide = 0.0
    for other_wall in range(normals.shape[0]):
        wide = max(wide, 2 * reaches[other_wall])
    wide *= 4 * normals.shape[0]
    for i in range(4):
        corners[i, 0], corners[i, 1] = (
            wide * (-1 if i in (0, 3) else 1),
            wide * (-1 if i < 2 else 1),
        )
    count = 4
    for other_wall in range(normals.shape[0]):
        rate = dot(normals[other_wall], frames[wall, 1])
        base = dot(normals[other_wall], frames[wall, 0])
        least = (
            0.0
            if other_wall == wall
            else offsets[other_wall] - max(base + low * rate, base + high * rate) + margin
        )
        count = clip(corners, count, normals[other_wall, 0], normals[other_wall, 1], least, spare)
    count = clip(corners, count, -normals[wall, 0], -normals[wall, 1], push - height, spare)
    if friction < np.inf:
        for side in (-1.0, 1.0):
            across = side * frames[wall, 1, 0] - friction * normals[wall, 0]
            up = side * frames[wall, 1, 1] - friction * normals[wall, 1]
            count = clip(
                corners, count, across, up, sign * (across * delta[0] + up * delta[1]), spare
            )
    return count


@in_place_kernel
def nearest_on_polygon(delta, goal, model, corners, spare, target, cycles):
    """Write to ``cycles``, for each wall and toucher, the cycle that ends nearest to the position
    difference ``goal``.

    The array ``cycles`` has the shape (walls, 2, 5). The five entries for a wall and a toucher are:
    the distance from ``goal`` (infinite if no cycle is possible), the two ends of the range of
    contacts, and the two coordinates of the position difference after the cycle.
    """
    reaches, margin = model.reaches, model.margin
    for wall in range(model.normals.shape[0]):
        for toucher in range(2):
            sign = 1.0 if toucher == 0 else -1.0
            cycle = cycles[wall, toucher]
            cycle[0] = np.inf
            count = cycle_outline(delta, sign, wall, model, corners, spare)
            if count == 0:
                continue
            for i in range(2):
                target[i] = sign * goal[i]
            cycle[0] = nearest_in(corners, count, target, cycle)
            for i in range(2):
                target[i] = sign * cycle[3 + i]
                cycle[3 + i] = target[i]
            low, high = contact_range(
                delta, sign, wall, model, margin - reaches[wall], reaches[wall] - margin, margin
            )
            low, high = contact_range(target, sign, wall, model, low, high, margin * 0.999)
            if high < low:
                low = high = (low + high) / 2
            cycle[1], cycle[2] = low, high


@in_place_kernel
def nearest_from(angle, delta, goal, model, candidates, nearest):
    """Write to ``nearest`` the position difference nearest to ``goal`` that a cycle with particle 1
    at a given contact can produce.

    ``angle`` is the angle of the contact on the circle, whose centre is the origin. Return the
    distance of the position difference from ``goal``, or infinity if no cycle is possible.
    """
    radius, friction, margin, push = model.circle[2], model.friction, model.margin, model.push
    ex, ey = cos(angle), sin(angle)
    height = -(delta[0] * ex + delta[1] * ey)
    # Coordinates at the contact: a points to the left along the wall, and h is the depth below the
    # wall.
    along, deep = -goal[0] * ey + goal[1] * ex, -(goal[0] * ex + goal[1] * ey)
    start = -delta[0] * ey + delta[1] * ex
    top = height - push
    if top < 0:
        return np.inf
    inner = radius - margin
    best, best_a, best_h = np.inf, 0.0, 0.0
    count = 0
    candidates[count] = along, deep
    count += 1
    candidates[count] = along, min(deep, top)
    count += 1
    away = sqrt(along**2 + (deep - radius) ** 2)
    if away > 0:
        candidates[count] = along / away * inner, radius + (deep - radius) / away * inner
        count += 1
    square = inner**2 - (top - radius) ** 2
    if square >= 0:
        candidates[count] = sqrt(square), top
        candidates[count + 1] = -sqrt(square), top
        count += 2
    if friction < np.inf:
        for side in (-1.0, 1.0):
            # The edge of the friction cone is a ray from (start, height) in the direction (side *
            # friction, -1).
            slope = side * friction
            share = ((along - start) * slope - (deep - height)) / (1 + slope * slope)
            share = max(share, push)
            candidates[count] = start + share * slope, height - share
            count += 1
            a, b = 1 + slope * slope, start * slope - (height - radius)
            c = start**2 + (height - radius) ** 2 - inner**2
            if b * b - a * c >= 0:
                share = (-b + sqrt(b * b - a * c)) / a
                candidates[count] = start + share * slope, height - share
                count += 1
    for k in range(count):
        a, h = candidates[k, 0], candidates[k, 1]
        if h > top + 1e-15 or a * a + (h - radius) ** 2 > inner * inner * (1 + 1e-14):
            continue
        if friction < np.inf and abs(a - start) > friction * (height - h) * (1 + 1e-12):
            continue
        away = sqrt((a - along) ** 2 + (h - deep) ** 2)
        if away < best:
            best, best_a, best_h = away, a, h
    nearest[0], nearest[1] = -best_a * ey - best_h * ex, best_a * ex - best_h * ey
    return best


@in_place_kernel
def nearest_on_circle(delta, goal, model, candidates, candidate, nearest):
    """Write to ``nearest`` the position difference nearest to ``goal`` that any cycle with a
    contact of particle 1 can produce.

    Return the distance of this position difference from ``goal`` (infinite if no cycle is
    possible), and the angle of the contact.
    """
    radius, margin = model.circle[2], model.margin
    best, at = np.inf, 0.0
    size = sqrt(dot(delta, delta))
    inner = radius - margin
    # The contacts c with |c + delta| <= inner form an arc around the direction of -delta.
    cosine = (radius**2 + size**2 - inner**2) / (2 * radius * size) if size > 0 else 2.0
    if cosine > 1:
        return best, at
    middle, half = atan2(-delta[1], -delta[0]), acos(cosine)
    step = 2 * half / ANGLES
    for k in range(ANGLES + 1):
        angle = middle - half + k * step
        away = nearest_from(angle, delta, goal, model, candidates, candidate)
        if away < best:
            best, at = away, angle
            nearest[0], nearest[1] = candidate[0], candidate[1]
    if not 0 < best < np.inf:
        return best, at
    while step > 1e-11:  # near the best angle, the distance is a smooth function of the angle
        moved = False
        for side in range(-1, 2, 2):
            angle = min(max(at + side * step, middle - half), middle + half)
            away = nearest_from(angle, delta, goal, model, candidates, candidate)
            if away < best:
                best, at, moved = away, angle, True
                nearest[0], nearest[1] = candidate[0], candidate[1]
        if not moved:
            step *= 0.5
    return best, at


# number of adjustments tried in each direction: the longest adjustment, 1/2 of its length, 1/4, ...
SHARES = 4


@kernel
def find_cycle(before, after, model, step):
    """Return whether one cycle (contact and adjustment) can change the position difference
    ``before`` into ``after``.

    If such a cycle exists, write to ``step`` the index of the toucher (the particle that the wall
    holds), the index of the wall, and the position of the contact along the wall.
    """
    if model.circle[2] > 0:
        return find_cycle_on_circle(before, after, model, step)
    normals, frames, reaches, margin = model.normals, model.frames, model.reaches, model.margin
    change = np.empty(2)
    change[0], change[1] = after[0] - before[0], after[1] - before[1]
    for wall in range(normals.shape[0]):
        pushed, height, end = (
            dot(normals[wall], change),
            dot(normals[wall], before),
            dot(normals[wall], after),
        )
        along = abs(dot(frames[wall, 1], change))
        sign = 1.0 if pushed < 0 else -1.0
        if (
            abs(pushed) < model.push
            or along > model.friction * abs(pushed)
            or sign * height < margin
            or sign * end < 0
        ):
            continue
        # The particle that is not held may touch the toucher's wall only at the end of the whole
        # path.
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
def find_cycle_on_circle(before, after, model, step):
    """Return whether one cycle on a disk can change the position difference ``before`` into
    ``after``. See `find_cycle`.

    The toucher (the particle that the wall holds) is always the first particle. A cycle exists if
    three arcs of the circle intersect. The first arc contains the contacts at which the other
    particle is inside the disk before its move. The second arc contains the contacts at which the
    other particle is inside the disk after its move. The third arc contains the contacts at which
    the wall holds the toucher.
    """
    radius, inner = model.circle[2], model.circle[2] - model.margin
    x, y = after[0] - before[0], after[1] - before[1]
    length = np.sqrt(x * x + y * y)
    if length <= model.push:
        return False
    middle = np.arctan2(y, x)
    half = min(
        np.arctan(model.friction) if model.friction < np.inf else np.pi / 2,
        np.arccos(model.push / length),
    )
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
def longest_change(delta, direction, back, most, model, trial, step):
    """Return the largest change of a position difference that one cycle can make in a direction, or
    0 if no cycle is possible.

    The cycle starts with the position difference ``delta`` or, if ``back`` is true, ends with
    ``delta``.
    """
    inner, outer = 0.0, most
    for halving in range(HALVINGS):
        middle = outer if halving == 0 else (inner + outer) / 2
        for i in range(2):
            trial[i] = delta[i] + (-middle if back else middle) * direction[i]
        good = (
            find_cycle(trial, delta, model, step) if back else find_cycle(delta, trial, model, step)
        )
        if good:
            inner = middle
        else:
            outer = middle
        if inner == outer:
            break
    return inner


@kernel
def grow_extreme_nodes(delta, back, directions, most, model, gain, records, nodes, count):
    """Find position differences that cycles can reach from ``delta``, and append the extreme ones
    to ``nodes``.

    ``delta`` is a position difference, too. The result is the new number of nodes. A position
    difference is extreme if it is longer than all earlier nodes in about the same direction. If
    ``back`` is true, the kernel instead adds position differences from which cycles can reach
    ``delta``. In this case, a position difference is extreme if it is shorter than all earlier
    nodes in about the same direction. ``records`` holds the most extreme length in each range of
    directions.
    """
    step, trial, bins = np.empty(3), np.empty(2), records.shape[0]
    size = np.sqrt(dot(delta, delta))
    records[int((np.arctan2(delta[1], delta[0]) / (2 * np.pi) + 1) * bins) % bins] = size
    nodes[count] = delta
    expanded, count = count, count + 1
    while expanded < count < nodes.shape[0]:
        node = nodes[expanded].copy()
        expanded += 1
        size = np.sqrt(dot(node, node))
        place = int((np.arctan2(node[1], node[0]) / (2 * np.pi) + 1) * bins) % bins
        if expanded > 1 and size != records[place]:
            # the search has meanwhile found a more extreme difference in the same range of
            # directions
            continue
        for d in range(directions.shape[0]):
            length = longest_change(node, directions[d], back, most, model, trial, step)
            if length <= 2 * model.push:
                continue
            for share in range(SHARES):
                reach = length * 0.5**share * (1 - 1e-6)
                for i in range(2):
                    trial[i] = node[i] + (-reach if back else reach) * directions[d, i]
                size = np.sqrt(dot(trial, trial))
                place = int((np.arctan2(trial[1], trial[0]) / (2 * np.pi) + 1) * bins) % bins
                better = size * gain < records[place] if back else size > records[place] * gain
                if better and size > 1e-4 and count < nodes.shape[0]:
                    records[place] = size
                    nodes[count] = trial
                    count += 1
    return count


@kernel
def fewest_cycles(nodes, model, parents, order):
    """Search breadth-first for the path with the fewest cycles from node 0 to node 1. Return
    whether a path exists.

    Write the parent of each node to ``parents``, and -1 for each node that the search has not
    reached. The array ``order`` is working memory.
    """
    count, step = nodes.shape[0], np.empty(3)
    parents[:] = -1
    order[0], parents[0] = 0, 0
    expanded, reached = 0, 1
    while expanded < reached:
        parent = order[expanded]
        expanded += 1
        for node in range(1, count):
            if parents[node] < 0 and find_cycle(nodes[parent], nodes[node], model, step):
                parents[node] = parent
                if node == 1:
                    return True
                order[reached] = node
                reached += 1
    return False


ROUNDS = 12  # of the propagation around the circle, before it counts as not converging
HALVINGS = 24
SAME = 1e-9
FLAT_BARRIER = 1e-9  # in radians: wall reactions that leave a half-plane by less count as inside


@kernel
def touching_lengths(angle, step, most, model, ends, turns):
    """Compute, for each wall and particle, up to which length of the position difference Δ the
    particle can touch the wall.

    ``ends`` receives the greatest length of Δ at which the particle can touch the wall. The length
    is at most ``most``, and 0 if the particle can never touch the wall. The kernel allows all
    directions of Δ that differ from ``angle`` by at most half of ``step``. ``turns`` receives the
    angles of the wall reactions without friction, for the direction ``angle``.
    """
    normals, reaches, walls = model.normals, model.reaches, model.normals.shape[0]
    ray = np.array([np.cos(angle), np.sin(angle)])
    delta = np.empty(2)
    for wall in range(walls):
        height = dot(normals[wall], ray)
        across = ray[0] * normals[wall, 1] - ray[1] * normals[wall, 0]
        for toucher in range(2):
            sign = 1.0 if toucher == 0 else -1.0
            row = 2 * wall + toucher
            ends[row] = 0.0
            if sign * height <= 0:
                continue
            # angle from -Δ to -sign N, or from Δ to sign N
            turns[row] = np.arctan2(sign * across, sign * height)
            inner, outer = 0.0, most
            for halving in range(HALVINGS):
                middle = outer if halving == 0 else (inner + outer) / 2
                delta[:] = middle * ray
                near = step * middle
                low, high = contact_range(
                    delta, sign, wall, model, -near - reaches[wall], reaches[wall] + near, -near
                )
                if low <= high:
                    inner = middle
                else:
                    outer = middle
                if inner == outer:
                    break
            ends[row] = outer


@kernel
def radius_after_turn(radius, side, step, most, ends, turns, cone):
    """Return the largest length of the position difference Δ after wall reactions turn Δ by one
    step, and before this turn.

    At first, the length of Δ is at most ``radius``. Before the turn, wall reactions may already
    increase this length, but not if all possible wall reactions point into one half-plane.
    """
    rows = ends.shape[0]
    before = radius
    for row in range(rows):
        if ends[row] > before:
            low, high = reaction_angles(ends[row], ends, turns, cone)
            if high - low > np.pi + FLAT_BARRIER:
                before = min(ends[row], most)
    after = 0.0
    # at the lengths on the ray where a particle loses touch with a wall, and at ``before``
    for row in range(rows + 1):
        place = before if row == rows else ends[row]
        if not 0 < place <= before:
            continue
        low, high = reaction_angles(place, ends, turns, cone)
        tilt = -low if side > 0 else high  # a reaction on one side of -Δ turns Δ to the other side
        if tilt > 0:
            # law of sines in the triangle of 0, Δ and Δ after the turn
            after = max(
                after, most if tilt + step >= np.pi else place * np.sin(tilt) / np.sin(tilt + step)
            )
    return after, before


@kernel
def reaction_angles(place, ends, turns, cone):
    """Return the smallest and the largest angle of the wall reactions on a position difference of
    length ``place``.
    """
    low, high = np.inf, -np.inf
    for row in range(ends.shape[0]):
        if ends[row] >= place:
            low, high = min(low, turns[row] - cone), max(high, turns[row] + cone)
    return low, high


@kernel
def is_kept_out(start, radius, angles, farthest, model, first, last, goal):
    """Return whether wall reactions can never bring the position difference to the length ``goal``
    at any of the given angles.

    The array ``angles`` ascends over the full circle. The given angles have the indices from
    ``first`` to ``last`` in this array. At the start, the position difference has the angle with
    the index ``start`` and the length ``radius``. Between two neighbouring angles in ``angles``,
    the position difference is never parallel to a wall. The array ``farthest`` contains the largest
    possible length of the position difference at each angle. The result is also False if the
    computation does not converge.
    """
    count, rows, cone = angles.shape[0], 2 * model.normals.shape[0], np.arctan(model.friction)
    ends, turns, steps = np.empty((count, rows)), np.empty((count, rows)), np.empty(count)
    for k in range(count):
        steps[k] = (angles[(k + 1) % count] - angles[k]) % (2 * np.pi)
        most = max(farthest[k], farthest[(k + 1) % count])
        touching_lengths(angles[k] + steps[k] / 2, steps[k], most, model, ends[k], turns[k])
    radii = np.zeros(count)
    radii[start] = radius
    for _round in range(ROUNDS):
        settled = True
        for side in (1, -1):
            for turn in range(count):
                k = (start + side * turn) % count
                if radii[k] <= 0:
                    continue
                following = (k + side) % count
                cell = k if side > 0 else following
                after, before = radius_after_turn(
                    radii[k], side, steps[cell], farthest[k], ends[cell], turns[cell], cone
                )
                after = min(after, farthest[following])
                if before > radii[k] * (1 + SAME) or after > radii[following] * (1 + SAME):
                    settled = False
                radii[k], radii[following] = max(before, radii[k]), max(after, radii[following])
            for k in range(first, last + 1):
                if radii[k % count] >= goal:
                    return False
        if settled:
            return True
    return False
