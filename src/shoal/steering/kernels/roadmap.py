"""Roadmaps in compiled code: contacts of chains, and sampled states of regions."""

from __future__ import annotations

from collections import namedtuple

import numpy as np

from shoal.jit import kernel
from shoal.steering.kernels import contact, region_contact
from shoal.steering.kernels.contact import copy, dot
from shoal.steering.kernels.cycles import contact_range

HALVINGS = 24
# number of adjustments tried in each direction: the longest adjustment, 1/2 of its length, 1/4, ...
SHARES = 4


@kernel
def linked(before, after, model, step):
    """Return whether one cycle (contact and adjustment) can change the position difference
    ``before`` into ``after``.

    If such a cycle exists, write to ``step`` the index of the toucher (the particle that the wall
    holds), the index of the wall, and the position of the contact along the wall.
    """
    if model.circle[2] > 0:
        return linked_on_circle(before, after, model, step)
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
def linked_on_circle(before, after, model, step):
    """Return whether one cycle on a disk can change the position difference ``before`` into
    ``after``. See `linked`.

    The toucher (the particle that the wall holds) is always the first particle. A cycle exists if
    three arcs of the circle intersect. The first arc contains the contacts at which the other
    particle is inside the disk before its move. The second arc contains the contacts at which the
    other particle is inside the disk after its move. The third arc contains the contacts at which
    the wall holds the toucher.
    """
    radius, inner = model.circle[2], model.circle[2] - model.margin
    x, y = after[0] - before[0], after[1] - before[1]
    way = np.sqrt(x * x + y * y)
    if way <= model.push:
        return False
    middle = np.arctan2(y, x)
    half = min(
        np.arctan(model.friction) if model.friction < np.inf else np.pi / 2,
        np.arccos(model.push / way),
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
def farthest(delta, direction, back, most, model, tried, step):
    """Return the largest change of a position difference that one cycle can make in a direction, or
    0 if no cycle is possible.

    The cycle starts with the position difference ``delta`` or, if ``back`` is true, ends with
    ``delta``.
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
    """Find position differences that cycles can reach from ``delta``, and append the extreme ones
    to ``nodes``.

    ``delta`` is a position difference, too. The result is the new number of nodes. A position
    difference is extreme if it is longer than all earlier nodes in about the same direction. If
    ``back`` is true, the kernel instead adds position differences from which cycles can reach
    ``delta``. In this case, a position difference is extreme if it is shorter than all earlier
    nodes in about the same direction. ``records`` holds the most extreme length in each range of
    directions.
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
            # the search has meanwhile found a more extreme difference in the same range of
            # directions
            continue
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
    """Search breadth-first for the path with the fewest cycles from node 0 to node 1. Return
    whether a path exists.

    Write the parent of each node to ``parents``, and -1 for each node that the search has not
    reached. The array ``order`` is working memory.
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


World = namedtuple("World", "flat edges walls wide_edges wide_walls corners clear lift")
"""The walls for a simulation: the flag ``flat``, ``edges`` (`region_contact.Edges`) and ``walls``
(`contact.Walls`).

The flag ``flat`` is true if all walls are straight and hold particles without slip. If ``flat`` is
true, simulations use ``edges``. Otherwise, simulations use ``walls``. ``wide_edges`` and
``wide_walls`` are the same walls with the largest contact tolerance with which plans must reach the
goals. ``corners``: float64, shape (corners, 2), the corners with more than 180 degrees of free
space, from which particles keep the distance ``clear``. ``lift``: distance by which a lift moves
particles off walls before a translation.
"""

Tree = namedtuple("Tree", "states parents made counts depths keys tries")
"""Arrays with one row for each node of the search tree.

``states``: positions of all particles. ``parents``: parent nodes. ``made``: moves from the parent
to the node. ``counts``: numbers of moves from the parent. ``depths``: numbers of moves from the
root. ``keys``: estimates of the distance from the goals. ``tries``: numbers of attempts to grow the
tree from the node.
"""

STEPS = 8  # maximum number of moves of one manoeuvre
EQUAL = (
    1e-11  # fraction of the workspace size: two offsets with a smaller difference count as equal
)
# fraction of the workspace size: the search discards manoeuvres that move all particles by less
CHANGED = 1e-7
WORSE = 0.3  # probability of keeping a state that is not more promising than its parent
ROUNDS = 6  # number of random nodes, of which the search extends the most promising one


@kernel
def step(state, move, world):
    """Move all particles in place. Return the share of the move that was complete when a wall first
    stopped or braked a particle.

    If no wall stopped or braked a particle, return 1.
    """
    if world.flat:
        return region_contact.advance_all(state, move, world.edges)
    return contact.advance_all(state, move, world.walls, np.empty(2))


@kernel
def step_wide(state, move, world):
    """Move all particles in place, like `step`, with the largest contact tolerance with which plans
    must reach the goals.
    """
    if world.flat:
        return region_contact.advance_all(state, move, world.wide_edges)
    return contact.advance_all(state, move, world.wide_walls, np.empty(2))


@kernel
def passes_corner(x, y, x_after, y_after, world):
    """Return whether a straight path passes one of ``world.corners`` at a distance below
    ``world.clear``.
    """
    along_x, along_y = x_after - x, y_after - y
    square = along_x * along_x + along_y * along_y
    for k in range(world.corners.shape[0]):
        off_x, off_y = world.corners[k, 0] - x, world.corners[k, 1] - y
        share = (
            min(max((off_x * along_x + off_y * along_y) / square, 0.0), 1.0) if square > 0 else 0.0
        )
        if (off_x - share * along_x) ** 2 + (
            off_y - share * along_y
        ) ** 2 < world.clear * world.clear:
            return True
    return False


@kernel
def keeps_clear(state, moves, count, world):
    """Return whether moves from ``state``, which they change, have the same effect with the largest
    contact tolerance.

    The moves must also keep all particles away from ``world.corners``. Sliding particles are not
    tested.
    """
    if world.clear == 0 or (not world.flat and world.walls.friction < np.inf):
        return True
    other = np.empty(state.shape)
    for k in range(count):
        copy(state, other)
        step_wide(other, moves[k], world)
        for p in range(state.shape[0]):
            x, y = state[p, 0], state[p, 1]
            step(state[p : p + 1], moves[k], world)
            if passes_corner(x, y, state[p, 0], state[p, 1], world):
                return False
            if (
                max(abs(state[p, 0] - other[p, 0]), abs(state[p, 1] - other[p, 1]))
                > EQUAL * world.walls.size
            ):
                return False
    return True


@kernel
def add_normals(point, world, total):
    """Add to ``total`` the inward normals of all walls that a particle touches or
    almost touches.
    """
    near = 0.5 * world.lift
    if world.flat:
        edges, x, y = world.edges, point[0], point[1]
        for run in range(edges.boxes.shape[0]):
            first, last = region_contact.run_near(
                run, x, y, x, y, near, edges.boxes, edges.ends.shape[0]
            )
            for edge in range(first, last):
                if region_contact.is_on(x, y, edge, edges.ends, edges.normals, edges.lengths, near):
                    total[0] += edges.normals[edge, 0]
                    total[1] += edges.normals[edge, 1]
        return
    for wall in range(world.walls.normals.shape[0] + 1):
        if contact.touches(point, wall, world.walls, near):
            for i in range(2):
                total[i] += contact.normal_part(point, wall, world.walls, i)


@kernel
def send(state, x, y, world, moves, count):
    """Make the move (x, y) and add it to ``moves``, unless it is zero or the array is full. Return
    the new number of moves.
    """
    if count < moves.shape[0] and (x != 0 or y != 0):
        moves[count, 0], moves[count, 1] = x, y
        step(state, moves[count], world)
        return count + 1
    return count


@kernel
def free_share(state, x, y, world):
    """Return the fraction of the move (x, y) after which a wall would first stop or brake a
    particle, or 1.
    """
    trial, move = np.empty(state.shape), np.empty(2)
    move[0], move[1] = x, y
    copy(state, trial)
    return step(trial, move, world)


@kernel
def is_blocked(state, x, y, world):
    """Return whether a wall may hold a particle at the start of the move (x, y), with any of the
    contact tolerances.
    """
    trial, move = np.empty(state.shape), np.empty(2)
    move[0], move[1] = x, y
    copy(state, trial)
    return free_share(state, x, y, world) == 0.0 or step_wide(trial, move, world) == 0.0


@kernel
def translate(state, x, y, world, size, moves, count):
    """Move all particles by (x, y), after a small move off the walls if a wall would hold a
    particle at the start.

    Return the new number of moves in the array ``moves``.
    """
    if is_blocked(state, x, y, world):
        away = np.zeros(2)
        for p in range(state.shape[0]):
            add_normals(state[p], world, away)
        length = np.sqrt(away[0] ** 2 + away[1] ** 2)
        if length > 0.01:
            up, side = world.lift * away[0] / length, world.lift * away[1] / length
            count = send(state, up, side, world, moves, count)
            return send(state, x - up, y - side, world, moves, count)
    return send(state, x, y, world, moves, count)


@kernel
def spread(state, goal):
    """Return a translation (x, y) that brings all particles near their goals, and a bound for the
    remaining distances.

    After the translation (x, y), no particle is farther from its goal than the bound.
    """
    left, right, low, high = np.inf, -np.inf, np.inf, -np.inf
    for p in range(state.shape[0]):
        x, y = state[p, 0] - goal[p, 0], state[p, 1] - goal[p, 1]
        left, right, low, high = min(left, x), max(right, x), min(low, y), max(high, y)
    return (
        -(left + right) / 2,
        -(low + high) / 2,
        0.5 * np.sqrt((right - left) ** 2 + (high - low) ** 2),
    )


@kernel
def differing(state, goal, size):
    """Return the number of distinct x offsets plus the number of distinct y offsets, minus 2.

    An offset is the position of a particle minus the position of its goal. The result is 0 if all
    offsets are equal.
    """
    count = 0
    for k in range(2):
        for p in range(1, state.shape[0]):
            new = True
            for q in range(p):
                if abs(state[p, k] - goal[p, k] - state[q, k] + goal[q, k]) <= EQUAL * size:
                    new = False
            if new:
                count += 1
    return count


@kernel
def wall_point(point, world, rng, place, normal):
    """Draw a random point of a wall. Write the point to ``place``, and the wall's inward normal at
    the point to ``normal``.

    The argument ``point`` is the position of a particle. On straight edges, a quarter of the draws
    choose a random edge, and give the point of this edge that is nearest to the particle.
    """
    choice, where = rng.random(), rng.random()
    if world.flat:
        edges = world.edges
        edge = min(int(rng.random() * edges.ends.shape[0]), edges.ends.shape[0] - 1)
        along = where * edges.lengths[edge]
        if choice < 0.25:
            along = min(
                max(
                    region_contact.place_along(point[0], point[1], edge, edges.ends, edges.normals),
                    0.0,
                ),
                edges.lengths[edge],
            )
        normal[0], normal[1] = edges.normals[edge, 0], edges.normals[edge, 1]
        place[0] = edges.ends[edge, 0] + along * normal[1]
        place[1] = edges.ends[edge, 1] - along * normal[0]
        return
    normals, offsets, circle = world.walls.normals, world.walls.offsets, world.walls.circle
    if circle[2] > 0:
        angle = 2 * np.pi * where
        normal[0], normal[1] = -np.cos(angle), -np.sin(angle)
        place[0], place[1] = circle[0] - circle[2] * normal[0], circle[1] - circle[2] * normal[1]
        return
    wall = min(int(where * normals.shape[0]), normals.shape[0] - 1)
    normal[0], normal[1] = normals[wall, 0], normals[wall, 1]
    over = contact.dot(normal, point) - offsets[wall]
    sideways = (choice - 0.5) * over
    place[0] = point[0] - over * normal[0] + sideways * normal[1]
    place[1] = point[1] - over * normal[1] - sideways * normal[0]


@kernel
def draw_move(rng, size):
    """Return a random move in any direction, with any length up to 1.5 times the size of the
    workspace.
    """
    angle, length = 2 * np.pi * rng.random(), 1.5 * size * rng.random() ** 2
    return length * np.cos(angle), length * np.sin(angle)


@kernel
def adjustment(state, goal, held, normal, rng, size):
    """Return a move that brings the offset of a random particle closer to the offset of the
    particle ``held``, or a random move.

    An offset is the position of a particle minus the position of its goal. Some moves make the
    offsets of the two particles equal, and others make only one component of the offsets equal.
    """
    n = state.shape[0]
    other = (held + 1 + min(int(rng.random() * (n - 1)), n - 2)) % n
    x = state[held, 0] - goal[held, 0] - state[other, 0] + goal[other, 0]
    y = state[held, 1] - goal[held, 1] - state[other, 1] + goal[other, 1]
    choice = rng.random()
    push = x * normal[0] + y * normal[1]
    if choice < 0.35 and push <= 0:
        return x, y
    if choice < 0.6:
        return x - push * normal[0], y - push * normal[1]
    if choice < 0.7:
        return x, 0.0
    if choice < 0.8:
        return 0.0, y
    x, y = draw_move(rng, size)
    push = x * normal[0] + y * normal[1]
    if choice < 0.9 or push > 0:
        return x - push * normal[0], y - push * normal[1]
    return x, y


@kernel
def manoeuvre(state, goal, world, rng, size, moves):
    """Make a random manoeuvre of one or a few moves, which changes ``state`` in place.

    Return the number of moves in the manoeuvre.
    """
    choice = rng.random()
    if choice < 0.2:  # a move in any direction; half of these moves end before the first contact
        x, y = draw_move(rng, size)
        share = 1.0
        if choice < 0.1:
            share = free_share(state, x, y, world) * rng.random()
        return translate(state, share * x, share * y, world, size, moves, 0)
    count = 0
    held = min(int(rng.random() * state.shape[0]), state.shape[0] - 1)
    place, normal = np.empty(2), np.zeros(2)
    if choice < 0.3:
        add_normals(state[held], world, normal)
    if normal[0] == 0 and normal[1] == 0:
        wall_point(state[held], world, rng, place, normal)
        count = translate(
            state, place[0] - state[held, 0], place[1] - state[held, 1], world, size, moves, count
        )
    legs = 1 if rng.random() < 0.6 else 2
    for _leg in range(legs):
        x, y = adjustment(state, goal, held, normal, rng, size)
        count = send(state, x, y, world, moves, count)
    return count


@kernel
def is_changed(state, before, least):
    for p in range(state.shape[0]):
        if abs(state[p, 0] - before[p, 0]) > least or abs(state[p, 1] - before[p, 1]) > least:
            return True
    return False


@kernel
def promise(node, tree):
    return tree.keys[node] + 0.15 * np.log2(1.0 + tree.tries[node])


@kernel
def pick(total, tree, rng):
    """Return the most promising of a few random nodes of the search tree."""
    best = min(int(rng.random() * total), total - 1)
    for _round in range(ROUNDS - 1):
        node = min(int(rng.random() * total), total - 1)
        if promise(node, tree) < promise(best, tree):
            best = node
    return best


@kernel
def grow(tree, total, rounds, goal, tolerance, most, world, size, rng):
    """Grow a search tree in place by at most ``rounds`` manoeuvres.

    Return the number of nodes, the number of manoeuvres left, and whether one translation from the
    last node completes the task.
    """
    states, depths, keys = tree.states, tree.depths, tree.keys
    moves, state, before = np.zeros((STEPS, 2)), np.zeros(goal.shape), np.zeros(goal.shape)
    while rounds > 0 and total < states.shape[0]:
        rounds -= 1
        node = pick(total, tree, rng)
        tree.tries[node] += 1
        copy(states[node], state)
        count = manoeuvre(state, goal, world, rng, size, moves)
        if (
            count == 0
            or depths[node] + count > most
            or not is_changed(state, states[node], CHANGED * size)
        ):
            continue
        _, _, away = spread(state, goal)
        depth = depths[node] + count
        key = differing(state, goal, size) + away / size + 0.01 * depth
        hit = away <= tolerance
        if not hit and key >= keys[node] and rng.random() > WORSE:
            continue
        copy(states[node], before)
        if not keeps_clear(before, moves, count, world):
            continue
        copy(state, states[total])
        copy(moves, tree.made[total])
        tree.parents[total], tree.counts[total], tree.tries[total] = node, count, 0
        depths[total], keys[total] = depth, key
        total += 1
        if hit:
            return total, rounds, True
    return total, rounds, False
