"""The search tree of the planner ``sampling``: random manoeuvres, simulated between walls or in
a region.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import kernel
from shoal.steering.kernels import contact, region_contact
from shoal.steering.kernels.contact import copy


class World(NamedTuple):
    """The walls for a simulation."""

    flat: bool  # whether ``edges`` are the walls, and not ``walls``
    edges: region_contact.Edges
    walls: contact.Walls
    wide_edges: region_contact.Edges  # with the largest contact tolerance that plans must stand
    wide_walls: contact.Walls
    corners: NDArray[np.float64]  # (corners, 2): that bend inward
    clear: float  # distance of particles from these corners
    lift: float  # distance by which a lift moves particles off walls before a translation
    over: float  # distance behind a wall at which a contact with this wall aims
    push: float  # distance by which an adjustment along a wall leads into the wall that holds


class Tree(NamedTuple):
    """The nodes of a search tree of n particles."""

    states: NDArray[np.float64]  # (nodes, n, 2)
    parents: NDArray[np.int64]  # (nodes,)
    moves: NDArray[np.float64]  # (nodes, STEPS, 2): moves from the parent to the node
    counts: NDArray[np.int64]  # (nodes,): of these moves
    depths: NDArray[np.int64]  # (nodes,): moves from the root
    keys: NDArray[np.float64]  # (nodes,): estimates of the distance from the goals
    tries: NDArray[np.int64]  # (nodes,): attempts to grow the tree from the node


STEPS = 8  # maximum number of moves of one manoeuvre
# fraction of the workspace size: two positions with a smaller difference count as equal
EQUAL = 1e-11
PUSHES = 8  # offsets that differ by fewer pushes into walls count as equal
# fraction of the workspace size: the search discards manoeuvres that move all particles by less
CHANGED = 1e-7
EXACT = 0.2  # probability of a contact that aims at the wall itself: goals may lie in corners
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
    if world.clear == 0 or world.walls.friction < np.inf:
        return True
    disturbed = np.empty(state.shape)
    for k in range(count):
        copy(state, disturbed)
        step_wide(disturbed, moves[k], world)
        for p in range(state.shape[0]):
            x, y = state[p, 0], state[p, 1]
            step(state[p : p + 1], moves[k], world)
            if passes_corner(x, y, state[p, 0], state[p, 1], world):
                return False
            if (
                max(abs(state[p, 0] - disturbed[p, 0]), abs(state[p, 1] - disturbed[p, 1]))
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
            first, last = region_contact.edges_near(run, x, y, x, y, near, edges)
            for edge in range(first, last):
                if region_contact.is_on(x, y, edge, edges, near):
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
def translate(state, x, y, world, moves, count, exact):
    """Move all particles by (x, y), after a small move off the walls if a wall would hold a
    particle at the start.

    If ``exact`` is false, the small move comes on top of (x, y), so that a translation along a wall
    keeps its distance from this wall. Where it leads back to the wall at its very end, rounding
    errors decide how far the particle comes. Return the new number of moves in the array ``moves``.
    """
    if is_blocked(state, x, y, world):
        away = np.zeros(2)
        for p in range(state.shape[0]):
            add_normals(state[p], world, away)
        length = np.sqrt(away[0] ** 2 + away[1] ** 2)
        if length > 0.01:
            up, side = world.lift * away[0] / length, world.lift * away[1] / length
            count = send(state, up, side, world, moves, count)
            if exact or world.walls.friction < np.inf:
                x, y = x - up, y - side
    return send(state, x, y, world, moves, count)


@kernel
def common_translation(state, goal):
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
def count_different_offsets(state, goal, equal):
    """Return the number of distinct x offsets plus the number of distinct y offsets, minus 2.

    An offset is the position of a particle minus the position of its goal. Offsets that differ by
    at most ``equal`` count as equal. The result is 0 if all offsets are equal.
    """
    count = 0
    for k in range(2):
        for p in range(1, state.shape[0]):
            new = True
            for q in range(p):
                if abs(state[p, k] - goal[p, k] - state[q, k] + goal[q, k]) <= equal:
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
                    region_contact.place_along(point[0], point[1], edge, edges),
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
def adjustment(state, goal, held, normal, world, rng):
    """Return a move that brings the offset of a random particle closer to the offset of the
    particle ``held``, or a random move.

    An offset is the position of a particle minus the position of its goal. Some moves make the
    offsets of the two particles equal, and others make only one component of the offsets equal.
    Moves along the wall with the inward normal ``normal`` lead into it by ``world.push``, because
    rounding errors would decide whether the wall holds the particle.
    """
    n = state.shape[0]
    other = (held + 1 + min(int(rng.random() * (n - 1)), n - 2)) % n
    x = state[held, 0] - goal[held, 0] - state[other, 0] + goal[other, 0]
    y = state[held, 1] - goal[held, 1] - state[other, 1] + goal[other, 1]
    choice = rng.random()
    push = x * normal[0] + y * normal[1]
    into = push + world.push
    if choice < 0.35 and push <= 0:
        into = max(into, 0.0)
        return x - into * normal[0], y - into * normal[1]
    if choice < 0.6:
        return x - into * normal[0], y - into * normal[1]
    if choice < 0.7:
        return x, 0.0
    if choice < 0.8:
        return 0.0, y
    x, y = draw_move(rng, world.walls.size)
    into = x * normal[0] + y * normal[1] + world.push
    if choice < 0.9 or into > 0:
        return x - into * normal[0], y - into * normal[1]
    return x, y


@kernel
def manoeuvre(state, goal, world, rng, moves):
    """Make a random manoeuvre of one or a few moves, which changes ``state`` in place.

    Return the number of moves in the manoeuvre.
    """
    choice, size = rng.random(), world.walls.size
    if choice < 0.2:  # a move in any direction; half of these moves end before the first contact
        x, y = draw_move(rng, size)
        share = 1.0
        if choice < 0.1:
            share = free_share(state, x, y, world) * rng.random()
        return translate(state, share * x, share * y, world, moves, 0, False)
    count = 0
    held = min(int(rng.random() * state.shape[0]), state.shape[0] - 1)
    place, normal = np.empty(2), np.zeros(2)
    if choice < 0.3:
        add_normals(state[held], world, normal)
        length = np.sqrt(normal[0] ** 2 + normal[1] ** 2)
        for i in range(2):
            normal[i] = normal[i] / length if length > 0.01 else 0.0
    if normal[0] == 0 and normal[1] == 0:
        wall_point(state[held], world, rng, place, normal)
        exact = rng.random() < EXACT
        over = 0.0 if exact else world.over
        x = place[0] - over * normal[0] - state[held, 0]
        y = place[1] - over * normal[1] - state[held, 1]
        count = translate(state, x, y, world, moves, count, exact)
    legs = 1 if rng.random() < 0.6 else 2
    for _leg in range(legs):
        x, y = adjustment(state, goal, held, normal, world, rng)
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
def grow(tree, total, rounds, goal, tolerance, most, world, rng):
    """Grow a search tree in place by at most ``rounds`` manoeuvres.

    Return the number of nodes, the number of manoeuvres left, and whether one translation from the
    last node completes the task.
    """
    states, depths, keys, size = tree.states, tree.depths, tree.keys, world.walls.size
    equal = EQUAL * size + PUSHES * world.push
    moves, state, before = np.zeros((STEPS, 2)), np.zeros(goal.shape), np.zeros(goal.shape)
    while rounds > 0 and total < states.shape[0]:
        rounds -= 1
        node = pick(total, tree, rng)
        tree.tries[node] += 1
        copy(states[node], state)
        count = manoeuvre(state, goal, world, rng, moves)
        if (
            count == 0
            or depths[node] + count > most
            or not is_changed(state, states[node], CHANGED * size)
        ):
            continue
        _, _, away = common_translation(state, goal)
        depth = depths[node] + count
        key = count_different_offsets(state, goal, equal) + away / size + 0.01 * depth
        hit = away <= tolerance
        if not hit and key >= keys[node] and rng.random() > WORSE:
            continue
        copy(states[node], before)
        if not keeps_clear(before, moves, count, world):
            continue
        copy(state, states[total])
        copy(moves, tree.moves[total])
        tree.parents[total], tree.counts[total], tree.tries[total] = node, count, 0
        depths[total], keys[total] = depth, key
        total += 1
        if hit:
            return total, rounds, True
    return total, rounds, False
