"""Plans whose contacts hold for all friction above a bound: the search tree of such plans, and
their simulation in many scenarios of errors.

The input u moves a free particle by its gain times u. The gain is a complex number: its magnitude
is the length of the displacement per unit of input, and its angle is the angle between the input
and the displacement. A wall with the inward normal N and the tangent T holds a particle that is
pushed by w into it, for all friction of at least μ, if ``|T w| <= μ |N w|``.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import kernel
from shoal.steering.kernels import contact, region_contact
from shoal.steering.kernels.contact import Walls, copy
from shoal.steering.kernels.region_contact import Edges
from shoal.steering.kernels.sampling import World, draw_move, wall_point

STEPS = 8  # maximum number of moves of one manoeuvre
ROUNDS = 6  # number of random nodes, of which the search extends the most promising one

STEEPEST = 6.0  # tangent of the largest angle between a random push and the normal of a wall
# in tolerances: missing change of the difference with which the goals may be reached, because each
# particle ends half of it from its goal
WIDE = 1.8
CYCLE = 2.5  # moves of a contact and a press
STEPS_OF_PRESS = 40  # cells: longest press of a table of values
AHEAD = 0.3  # of a move: what the moves of a manoeuvre count, because the next ones may need fewer
MOST_LEFT = 200.0  # moves: more count as none
LEFT = 0.05  # relative to the size: what a move adds to the estimated distance from the goals
HELD = 1e-9  # relative to the size: motion of a particle that counts as held


class Pressing(NamedTuple):
    """How surely a plan presses particles into walls."""

    gains: NDArray[np.float64]  # (2, 2): real and imaginary part of each particle's gain
    friction: float  # least friction with which contacts hold
    over: float  # distance behind a wall at which a contact aims
    over_share: float  # the same, as a share of the length of the move to the wall
    off: float  # distance from walls that other particles keep, and that a lift moves particles off
    near: float  # distance up to which a particle counts as touching a wall
    apart: float  # least distance between the particles
    worse: float = 0.2
    """Probability of keeping a state that is not more promising than its parent."""


class Values(NamedTuple):
    """How many moves are left until the particles differ as their goals do."""

    moves: NDArray[np.float64]  # (cells, cells): by both parts of the difference
    cell: float  # side of a cell; the difference (0, 0) is in the middle of the table


class Nodes(NamedTuple):
    """The nodes of a search tree."""

    states: NDArray[np.float64]  # (nodes, 2, 2)
    parents: NDArray[np.int64]  # (nodes,)
    moves: NDArray[np.float64]  # (nodes, STEPS, 2): moves from the parent to the node
    counts: NDArray[np.int64]  # (nodes,): of these moves
    depths: NDArray[np.int64]  # (nodes,): moves from the root
    keys: NDArray[np.float64]  # (nodes,): estimates of the distance from the goals
    tries: NDArray[np.int64]  # (nodes,): attempts to grow the tree from the node


@kernel
def with_friction(world, friction):
    """Return a world with another coefficient of friction."""
    edges, walls = world.edges, world.walls
    return World(
        world.flat,
        Edges(
            edges.ends,
            edges.normals,
            edges.lengths,
            edges.links,
            edges.reflex,
            edges.size,
            edges.boxes,
            edges.pushed,
            friction,
        ),
        Walls(
            walls.normals,
            walls.offsets,
            walls.circle,
            walls.size,
            friction,
            walls.gain,
            walls.pushed,
        ),
        world.wide_edges,
        world.wide_walls,
        world.corners,
        world.clear,
        world.lift,
        world.over,
        world.push,
    )


@kernel
def send_to(point, x, y, gain, world, move, spare):
    """Move one particle in place by the input (x, y). Return the share of the input after which a
    wall first held or braked it, or 1.
    """
    move[0] = gain[0] * x - gain[1] * y
    move[1] = gain[1] * x + gain[0] * y
    if world.flat:
        return region_contact.advance(point, move, world.edges)
    return contact.advance(point, move, world.walls, spare)


@kernel
def send_both(state, x, y, gains, world, move, spare):
    """Move both particles in place by the input (x, y). Return the share of the input after which a
    wall first held or braked a particle, or 1.
    """
    first_share = send_to(state[0], x, y, gains[0], world, move, spare)
    second_share = send_to(state[1], x, y, gains[1], world, move, spare)
    return min(first_share, second_share)


@kernel
def play_scenarios(start, moves, turns, gains, frictions, world, ends):
    """Write to ``ends`` (scenarios, 2, 2) where both particles end after all moves.

    In scenario s, the walls have the friction ``frictions[s]``, particle p has the gain ``gains[s,
    p]``, and the input of move m is multiplied by the complex number ``turns[s, m]``.
    """
    move, spare = np.empty(2), np.empty(2)
    for s in range(ends.shape[0]):
        own = with_friction(world, frictions[s])
        copy(start[s % start.shape[0]], ends[s])
        for m in range(moves.shape[0]):
            re, im = turns[s, m, 0], turns[s, m, 1]
            x, y = moves[m, 0], moves[m, 1]
            send_both(ends[s], re * x - im * y, im * x + re * y, gains[s], own, move, spare)


@kernel
def largest_error(state, goal):
    """Return the largest distance of a particle from its goal."""
    most = 0.0
    for p in range(2):
        most = max(most, sqrt((state[p, 0] - goal[p, 0]) ** 2 + (state[p, 1] - goal[p, 1]) ** 2))
    return most


@kernel
def mean_cost(ends, goal, scale, most):
    """Return the mean over all scenarios of the squared error, in units of ``scale``, up to
    ``most``.
    """
    total = 0.0
    for s in range(ends.shape[0]):
        total += min((largest_error(ends[s], goal) / scale) ** 2, most)
    return total / ends.shape[0]


@kernel
def refine(start, goal, moves, rounds, widest, finest, scale, most, scenarios, world, ends, rng):
    """Change the moves of a plan in place at random, as long as the mean cost becomes smaller.

    ``scenarios`` holds the turns, gains and frictions of `play_scenarios`. Return the cost.
    """
    turns, gains, frictions = scenarios
    play_scenarios(start, moves, turns, gains, frictions, world, ends)
    cost = mean_cost(ends, goal, scale, most)
    trial = moves.copy()
    for k in range(rounds):
        width = widest * (finest / widest) ** (k / rounds)
        copy(moves, trial)
        m = min(int(rng.random() * moves.shape[0]), moves.shape[0] - 1)
        x, y = width * rng.normal(), width * rng.normal()
        trial[m, 0] += x
        trial[m, 1] += y
        if rng.random() < 0.5:  # another move takes the change back
            another = min(int(rng.random() * moves.shape[0]), moves.shape[0] - 1)
            trial[another, 0] -= x
            trial[another, 1] -= y
        play_scenarios(start, trial, turns, gains, frictions, world, ends)
        changed = mean_cost(ends, goal, scale, most)
        if changed < cost:
            cost = changed
            copy(trial, moves)
    return cost


@kernel
def nearest_wall(point, world, normal):
    """Return the distance of a particle from the nearest wall, and write the inward normal of this
    wall to ``normal``.
    """
    least = np.inf
    if world.flat:
        edges = world.edges
        for edge in range(edges.ends.shape[0]):
            place = region_contact.place_along(point[0], point[1], edge, edges)
            beyond = max(-place, place - edges.lengths[edge], 0.0)
            away = abs(region_contact.signed_distance(point[0], point[1], edge, edges))
            away = sqrt(away * away + beyond * beyond)
            if away < least:
                least = away
                normal[0], normal[1] = edges.normals[edge, 0], edges.normals[edge, 1]
        return least
    walls = world.walls
    for wall in range(walls.normals.shape[0]):
        away = abs(contact.dot(walls.normals[wall], point) - walls.offsets[wall])
        if away < least:
            least = away
            normal[0], normal[1] = walls.normals[wall, 0], walls.normals[wall, 1]
    if walls.circle[2] > 0:
        away = abs(contact.circle_distance(point, walls.circle))
        if away < least:
            least = away
            for i in range(2):
                normal[i] = contact.normal_part(point, walls.normals.shape[0], walls, i)
    return least


@kernel
def too_near(before, state, apart):
    """Return whether the particles come nearer to each other than ``apart`` while both move
    straight from ``before`` to ``state``.
    """
    if apart <= 0:
        return False
    x, y = before[1, 0] - before[0, 0], before[1, 1] - before[0, 1]
    dx = state[1, 0] - state[0, 0] - x
    dy = state[1, 1] - state[0, 1] - y
    square = dx * dx + dy * dy
    share = min(max(-(x * dx + y * dy) / square, 0.0), 1.0) if square > 0 else 0.0
    return (x + share * dx) ** 2 + (y + share * dy) ** 2 < apart * apart


@kernel
def send(state, x, y, pressing, world, moves, count):
    """Make the input (x, y) in place and add it to ``moves``. Return the number of moves, or -1 if
    there is no room or the particles collide.
    """
    if count < 0 or count >= moves.shape[0]:
        return -1
    if x == 0 and y == 0:
        return count
    move, spare, before = np.empty(2), np.empty(2), state.copy()
    send_both(state, x, y, pressing.gains, world, move, spare)
    if too_near(before, state, pressing.apart):
        return -1
    moves[count, 0], moves[count, 1] = x, y
    return count + 1


@kernel
def free_share(state, x, y, pressing, world):
    """Return the share of the input (x, y) that both particles make before a wall holds or brakes
    one of them.
    """
    move, spare, trial = np.empty(2), np.empty(2), state.copy()
    return send_both(trial, x, y, pressing.gains, world, move, spare)


@kernel
def translate(state, x, y, pressing, world, moves, count):
    """Make the input (x, y), after a lift off the walls if a wall would hold a particle."""
    if count < 0:
        return -1
    length = sqrt(x * x + y * y)
    if length == 0:
        return count
    up, side, normal = 0.0, 0.0, np.zeros(2)
    for p in range(2):
        away = nearest_wall(state[p], world, normal)
        if away <= pressing.near and normal[0] * x + normal[1] * y < 0.2 * length:
            up += normal[0]
            side += normal[1]
    size = sqrt(up * up + side * side)
    if size > 0.05:
        up, side = pressing.off * up / size, pressing.off * side / size
        count = send(state, up, side, pressing, world, moves, count)
        x, y = x - up, y - side
    return send(state, x, y, pressing, world, moves, count)


@kernel
def to_goal(state, goal, pressing):
    """Return the input that brings the middle of the particles to the middle of their goals."""
    gains = pressing.gains
    x = (goal[0, 0] + goal[1, 0] - state[0, 0] - state[1, 0]) / 2
    y = (goal[0, 1] + goal[1, 1] - state[0, 1] - state[1, 1]) / 2
    re, im = (gains[0, 0] + gains[1, 0]) / 2, (gains[0, 1] + gains[1, 1]) / 2
    square = re * re + im * im
    return (re * x + im * y) / square, (re * y - im * x) / square


@kernel
def missing_change(state, goal, pressing):
    """Return the change of the difference of the particles that is still missing, if the last
    input is a translation to the goals.
    """
    x, y = to_goal(state, goal, pressing)
    gains = pressing.gains
    re, im = gains[1, 0] - gains[0, 0], gains[1, 1] - gains[0, 1]
    return (
        goal[1, 0] - goal[0, 0] - state[1, 0] + state[0, 0] - (re * x - im * y),
        goal[1, 1] - goal[0, 1] - state[1, 1] + state[0, 1] - (im * x + re * y),
    )


@kernel
def touch(state, held, pressing, world, rng, moves, count, normal):
    """Bring a particle to a random point of a wall. Return the number of moves, or -1.

    Write the normal of the wall to ``normal``. Where the direct move would not hold the particle,
    the move first leads to a point before the wall, and then straight into the wall.
    """
    place = np.empty(2)
    wall_point(state[held], world, rng, place, normal)
    x, y = place[0] - state[held, 0], place[1] - state[held, 1]
    length = sqrt(x * x + y * y)
    over = pressing.over + pressing.over_share * length
    re, im = pressing.gains[held, 0], pressing.gains[held, 1]
    square = re * re + im * im
    into, along = -(x * normal[0] + y * normal[1]), abs(x * normal[1] - y * normal[0])
    if into <= 0:
        return -1
    other = 1 - held
    if along > pressing.friction * into or along > 2 * into:
        x, y = x + pressing.off * normal[0], y + pressing.off * normal[1]
        x, y = (re * x + im * y) / square, (re * y - im * x) / square
        if free_share(state, x, y, pressing, world) < 1:
            return -1
        count = translate(state, x, y, pressing, world, moves, count)
        x, y = -(pressing.off + over) * normal[0], -(pressing.off + over) * normal[1]
    else:
        x, y = x * (1 + over / into), y * (1 + over / into)
    x, y = (re * x + im * y) / square, (re * y - im * x) / square
    if count < 0:
        return -1
    wanted_x = state[other, 0] + pressing.gains[other, 0] * x - pressing.gains[other, 1] * y
    wanted_y = state[other, 1] + pressing.gains[other, 1] * x + pressing.gains[other, 0] * y
    before = count
    count = translate(state, x, y, pressing, world, moves, count)
    if count < 0 or count > before + 2:
        return -1
    most = HELD * world.walls.size
    if abs(state[other, 0] - wanted_x) > most or abs(state[other, 1] - wanted_y) > most:
        return -1  # a wall was in the way of the other particle
    away = sqrt((state[held, 0] - place[0]) ** 2 + (state[held, 1] - place[1]) ** 2)
    return count if away <= 2 * over + most else -1


@kernel
def press(state, goal, held, normal, pressing, world, rng, moves, count):
    """Move the other particle while a wall holds the particle ``held``. Return the number of
    moves, or -1.
    """
    other = 1 - held
    sign = 1.0 - 2.0 * held  # of the change of the difference, if the other particle moves
    choice = rng.random()
    to_wall = choice > 0.7
    if to_wall:
        # in a direction inside the friction cone, often at its edge, until the other particle meets
        # a wall, or less far
        steepest = min(pressing.friction, STEEPEST)
        slope = steepest * min(max(3.0 * rng.random() - 1.5, -1.0), 1.0)
        length = min(1.5 * rng.random(), 1.0) * world.walls.size / sqrt(1 + slope * slope)
        x = length * (-normal[0] + slope * normal[1])
        y = length * (-normal[1] - slope * normal[0])
    else:
        x, y = missing_change(state, goal, pressing)
        x, y = sign * x, sign * y
        if choice > 0.6:
            share = 1.3 * rng.random()
            x, y = share * x, share * y
    # the input, and by how much it pushes the held particle
    re, im = pressing.gains[other, 0], pressing.gains[other, 1]
    square = re * re + im * im
    x, y = (re * x + im * y) / square, (re * y - im * x) / square
    re, im = pressing.gains[held, 0], pressing.gains[held, 1]
    square = re * re + im * im
    push_x, push_y = re * x - im * y, im * x + re * y
    into = -(push_x * normal[0] + push_y * normal[1])
    along = push_x * normal[1] - push_y * normal[0]
    if abs(along) > pressing.friction * into:
        # the nearest push inside the friction cone, whose edge is -N ± friction T
        side = 1.0 if along > 0 else -1.0
        edge_x = -normal[0] + side * pressing.friction * normal[1]
        edge_y = -normal[1] - side * pressing.friction * normal[0]
        scale = (push_x * edge_x + push_y * edge_y) / (edge_x * edge_x + edge_y * edge_y)
        if scale <= 0:
            return -1
        push_x, push_y = scale * edge_x, scale * edge_y
        x, y = (re * push_x + im * push_y) / square, (re * push_y - im * push_x) / square
    wanted_x = state[other, 0] + pressing.gains[other, 0] * x - pressing.gains[other, 1] * y
    wanted_y = state[other, 1] + pressing.gains[other, 1] * x + pressing.gains[other, 0] * y
    held_x, held_y = state[held, 0], state[held, 1]
    count = send(state, x, y, pressing, world, moves, count)
    most = HELD * world.walls.size
    if not to_wall and (
        abs(state[other, 0] - wanted_x) > most or abs(state[other, 1] - wanted_y) > most
    ):
        return -1
    if abs(state[held, 0] - held_x) > most or abs(state[held, 1] - held_y) > most:
        return -1
    return count


@kernel
def manoeuvre(state, goal, pressing, world, rng, moves):
    """Make a random manoeuvre in place: a translation, or a contact and an adjustment. Return the
    number of moves, or -1 if the manoeuvre is impossible.
    """
    if rng.random() < 0.1:
        x, y = draw_move(rng, world.walls.size)
        share = min(free_share(state, x, y, pressing, world), 0.9)
        return translate(state, share * x, share * y, pressing, world, moves, 0)
    held = 0 if rng.random() < 0.5 else 1
    normal, count = np.zeros(2), 0
    in_contact = nearest_wall(state[held], world, normal) <= HELD * world.walls.size
    if not in_contact or rng.random() < 0.7:
        count = touch(state, held, pressing, world, rng, moves, 0, normal)
    if count < 0:
        return -1
    return press(state, goal, held, normal, pressing, world, rng, moves, count)


@kernel
def is_inside(x, y, edges, circle):
    """Return whether a point is inside the workspace, walls included as far as rounding allows."""
    if circle[2] > 0:
        away = sqrt((x - circle[0]) ** 2 + (y - circle[1]) ** 2)
        return away <= circle[2] * (1 + HELD)
    ends, inside = edges.ends, False
    for edge in range(ends.shape[0]):
        a, b, c, d = ends[edge, 0], ends[edge, 1], ends[edge, 2], ends[edge, 3]
        if (b > y) != (d > y) and x < a + (y - b) * (c - a) / (d - b):
            inside = not inside
    if inside:
        return True
    least = HELD * edges.size
    for edge in range(ends.shape[0]):
        a, b, length = ends[edge, 0], ends[edge, 1], edges.lengths[edge]
        along = (x - a) * (ends[edge, 2] - a) + (y - b) * (ends[edge, 3] - b)
        along = min(max(along / (length * length), 0.0), 1.0)
        x_off = x - a - along * (ends[edge, 2] - a)
        y_off = y - b - along * (ends[edge, 3] - b)
        if x_off * x_off + y_off * y_off <= least * least:
            return True
    return False


@kernel
def moves_left(x, y, values):
    """Return the number of moves left at a difference, interpolated between four cells."""
    table, cell = values.moves, values.cell
    n = table.shape[0]
    row, column = x / cell + n // 2, y / cell + n // 2
    i, k = min(max(int(row), 0), n - 2), min(max(int(column), 0), n - 2)
    u, v = min(max(row - i, 0.0), 1.0), min(max(column - k, 0.0), 1.0)
    return (1 - u) * ((1 - v) * table[i, k] + v * table[i, k + 1]) + u * (
        (1 - v) * table[i + 1, k] + v * table[i + 1, k + 1]
    )


@kernel
def moves_left_of(state, values):
    """Return the number of moves until the particles differ as their goals do."""
    return moves_left(state[1, 0] - state[0, 0], state[1, 1] - state[0, 1], values)


@kernel
def free_length(x, y, to_x, to_y, edges, circle):
    """Return how far a particle can move from a point in a unit direction before it meets a wall."""
    if circle[2] > 0:
        away_x, away_y = x - circle[0], y - circle[1]
        half = away_x * to_x + away_y * to_y
        inside = circle[2] ** 2 - away_x * away_x - away_y * away_y
        return sqrt(max(half * half + inside, 0.0)) - half
    least, slack = np.inf, HELD * edges.size
    for edge in range(edges.ends.shape[0]):
        normal_x, normal_y = edges.normals[edge, 0], edges.normals[edge, 1]
        rate = normal_x * to_x + normal_y * to_y
        if rate > -1e-12:
            continue
        off_x, off_y = x - edges.ends[edge, 0], y - edges.ends[edge, 1]
        far = -(normal_x * off_x + normal_y * off_y) / rate
        if far < -slack or far >= least:
            continue
        along = normal_y * (off_x + far * to_x) - normal_x * (off_y + far * to_y)
        if -slack <= along <= edges.lengths[edge] + slack:
            least = max(far, 0.0)
    return least


@kernel
def best_press(x, y, goal, near, friction, places, normals, world, values, to):
    """Return the least value of a difference over all presses from it, and write to ``to`` the
    difference after the best press.
    """
    best, edges, circle = MOST_LEFT, world.edges, world.walls.circle
    cell = values.cell
    far = STEPS_OF_PRESS * cell
    for place in range(places.shape[0]):
        wall_x, wall_y = places[place, 0], places[place, 1]
        normal_x, normal_y = normals[place, 0], normals[place, 1]
        for sign in (-1.0, 1.0):  # of the change of the difference by the particle that moves
            from_x, from_y = wall_x + sign * x, wall_y + sign * y
            if not is_inside(from_x, from_y, edges, circle):
                continue
            change_x, change_y = sign * (goal[0] - x), sign * (goal[1] - y)
            into = -(change_x * normal_x + change_y * normal_y)
            along = abs(change_x * normal_y - change_y * normal_x)
            if along <= friction * into + near and is_inside(
                from_x + change_x, from_y + change_y, edges, circle
            ):
                to[0], to[1] = goal[0], goal[1]
                return CYCLE
            for side in range(-1, 2):
                step_x = -normal_x + side * friction * normal_y
                step_y = -normal_y - side * friction * normal_x
                size = sqrt(1 + (side * friction) ** 2)
                step_x, step_y = step_x / size, step_y / size
                most = min(free_length(from_x, from_y, step_x, step_y, edges, circle), far)
                length = most
                while length > 0.7 * cell:  # to the wall, and less far
                    to_x, to_y = x + sign * length * step_x, y + sign * length * step_y
                    value = CYCLE + moves_left(to_x, to_y, values)
                    if value < best:
                        best, to[0], to[1] = value, to_x, to_y
                    length -= max(cell, 0.2 * length)
    return best


@kernel
def find_values(goal, near, friction, places, normals, world, values):
    """Write to a table how many moves are left from each difference of the particles, by policy
    iteration. Return the number of improvements of the policy.

    A wall with the inward normal N and the tangent T holds a particle at each of ``places`` (float64,
    shape (places, 2)) while the other moves by a (-N + s T) with ``|s| <= μ``, which changes the
    difference by as much, with the sign of the particle that moves.

    The interpolation between the cells blurs the differences about as much as errors of the presses
    do: ways that need exact presses in a row count as longer.
    """
    table, cell = values.moves, values.cell
    n = table.shape[0]
    table[:] = MOST_LEFT
    to = np.empty((n, n, 2))
    for improvement in range(40):
        change = 0.0
        for i in range(n):
            row = i if improvement % 2 == 0 else n - 1 - i
            for k in range(n):
                column = k if improvement % 4 < 2 else n - 1 - k
                before = table[row, column]
                if before <= CYCLE:
                    continue
                x, y = (row - n // 2) * cell, (column - n // 2) * cell
                value = best_press(
                    x, y, goal, near, friction, places, normals, world, values, to[row, column]
                )
                table[row, column] = min(value, before)
                change = max(change, before - value)
        if change < 0.5:
            return improvement + 1
        for sweep in range(30):
            change = 0.0
            for i in range(n):
                row = i if sweep % 2 == 0 else n - 1 - i
                for k in range(n):
                    column = k if sweep % 4 < 2 else n - 1 - k
                    before = table[row, column]
                    if CYCLE < before < MOST_LEFT:
                        x, y = to[row, column, 0], to[row, column, 1]
                        value = min(CYCLE + moves_left(x, y, values), before)
                        table[row, column] = value
                        change = max(change, before - value)
            if change < 0.1:
                break
    return 40


@kernel
def try_manoeuvres(
    start, goal, samples, tolerance, pressing, world, values, rng, manoeuvres, counts
):
    """Write the moves of the most promising of many random manoeuvres to ``manoeuvres`` (float64, shape
    (manoeuvres, STEPS, 2)), and their numbers to ``counts``, which are 0 after the last one.
    """
    moves, state = np.zeros((STEPS, 2)), np.zeros((2, 2))
    costs, worst = np.full(len(counts), np.inf), 0
    sticking, move, spare = with_friction(world, 1e9), np.empty(2), np.empty(2)
    counts[:] = 0
    for _ in range(samples):
        copy(start, state)
        count = manoeuvre(state, goal, pressing, world, rng, moves)
        if count <= 0:
            continue
        cost = moves_left_of(state, values)
        copy(start, state)
        for m in range(count):  # walls that hold better must not spoil it
            send_both(state, moves[m, 0], moves[m, 1], pressing.gains, sticking, move, spare)
        x = state[1, 0] - state[0, 0] - start[1, 0] + start[0, 0]
        y = state[1, 1] - state[0, 1] - start[1, 1] + start[0, 1]
        if x * x + y * y < tolerance * tolerance:
            continue
        cost = AHEAD * count + max(cost, moves_left_of(state, values))
        if cost < min(costs[worst], MOST_LEFT):
            costs[worst], counts[worst] = cost, count
            copy(moves, manoeuvres[worst])
            worst = int(np.argmax(costs))


@kernel
def mean_moves_left(ends, values):
    """Return the mean over all scenarios of the number of moves that are left."""
    total = 0.0
    for s in range(ends.shape[0]):
        total += moves_left_of(ends[s], values)
    return total / ends.shape[0]


@kernel
def promise(node, nodes):
    return nodes.keys[node] + 0.15 * np.log2(1.0 + nodes.tries[node])


@kernel
def finish(state, goal, tolerance, pressing, world, moves, count):
    """Add the translation to the goals to ``moves``. Return the number of moves, or -1 if the
    particles then miss their goals.
    """
    x, y = to_goal(state, goal, pressing)
    count = translate(state, x, y, pressing, world, moves, count)
    return count if count >= 0 and largest_error(state, goal) <= tolerance else -1


@kernel
def grow(nodes, total, rounds, goal, tolerance, most, pressing, world, values, rng, last):
    """Grow a search tree in place by at most ``rounds`` manoeuvres, until a plan is found.

    Return the number of nodes, the number of manoeuvres left, and the number of moves in ``last``
    that lead from the last node to the goals, or -1.
    """
    states, size = nodes.states, world.walls.size
    moves, state = np.zeros((STEPS, 2)), np.zeros((2, 2))
    while rounds > 0 and total < states.shape[0]:
        rounds -= 1
        node = min(int(rng.random() * total), total - 1)
        for _round in range(ROUNDS - 1):
            another = min(int(rng.random() * total), total - 1)
            if promise(another, nodes) < promise(node, nodes):
                node = another
        nodes.tries[node] += 1
        copy(states[node], state)
        count = manoeuvre(state, goal, pressing, world, rng, moves)
        if count <= 0 or nodes.depths[node] + count > most:
            continue
        x, y = missing_change(state, goal, pressing)
        depth = nodes.depths[node] + count
        away = sqrt(x * x + y * y)
        key = away / size + 0.03 * depth + LEFT * moves_left_of(state, values)
        if key >= nodes.keys[node] and rng.random() > pressing.worse and away > WIDE * tolerance:
            continue
        copy(state, states[total])
        copy(moves, nodes.moves[total])
        nodes.parents[total], nodes.counts[total], nodes.tries[total] = node, count, 0
        nodes.depths[total], nodes.keys[total] = depth, key
        total += 1
        if away <= WIDE * tolerance:
            count = finish(state, goal, tolerance, pressing, world, last, 0)
            if count >= 0 and depth + count <= most:
                return total, rounds, count
    return total, rounds, -1
