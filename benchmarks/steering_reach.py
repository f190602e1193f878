"""Which steering problems can be solved at all: python -m benchmarks.steering_reach [--instances N]

An exhaustive search that shares no planning with Shoal, only the motion of one particle. A
translation changes no difference of two particles, so that the search goes over differences: the
difference and the component of free translations are one place, of which the search keeps the
first state and the one nearest to the goals. From every state it tries many contacts of either
particle with all walls, pushes of all directions and lengths, with the edges of the friction cone
among them, and further pushes without a translation in between, until nothing new is found.

`reached` is a fact: the exact walls allow the moves that the search has made. `exhausted` is none,
but the search then has found nothing in all places that it came to; finer cells tell how far this
can be trusted. Proofs (`why_unreachable`) judge the judge: a proof of a reached goal is an error.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import kernel
from shoal.steering.kernels import contact
from shoal.steering.kernels.pressing import send_both, with_friction
from shoal.steering.planners.sampling import world_of
from shoal.steering.problem import SteeringProblem

CELL = 0.03  # relative to the size: width of a cell of differences
RASTER = 48  # squares along a side, in which free translations are found
TRIES = 600  # pushes from each state in one round
ROUNDS = 2  # rounds without anything new that end the search
MOST = 12_000  # states
BETWEEN = 6  # points of a short free translation that are looked at


@kernel
def is_inside(x, y, world):
    """Return whether a point is in the free space."""
    if not world.flat:
        walls = world.walls
        for wall in range(walls.normals.shape[0]):
            if walls.normals[wall, 0] * x + walls.normals[wall, 1] * y < walls.offsets[wall]:
                return False
        circle = walls.circle
        return circle[2] <= 0 or (x - circle[0]) ** 2 + (y - circle[1]) ** 2 <= circle[2] ** 2
    inside, ends = False, world.edges.ends
    for edge in range(ends.shape[0]):
        x0, y0, x1, y1 = ends[edge, 0], ends[edge, 1], ends[edge, 2], ends[edge, 3]
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) / (y1 - y0) * (x1 - x0):
            inside = not inside
    return inside


@kernel
def is_free(x, y, x_after, y_after, dx, dy, world):
    """Return whether both particles, of which the second is at (dx, dy) from the first, can move
    straight on, as far as a few points between tell.
    """
    for k in range(1, BETWEEN + 1):
        share = k / BETWEEN
        u, v = x + share * (x_after - x), y + share * (y_after - y)
        if not is_inside(u, v, world) or not is_inside(u + dx, v + dy, world):
            return False
    return True


@kernel
def flood(state, box, world, mask, stack):
    """Write to ``mask`` (RASTER, RASTER) in which squares the first particle can be after a free
    translation of both.
    """
    count = mask.shape[0]
    wide, high = (box[2] - box[0]) / count, (box[3] - box[1]) / count
    dx, dy = state[1, 0] - state[0, 0], state[1, 1] - state[0, 1]
    mask[:] = False
    total = 0
    i0 = min(max(int((state[0, 0] - box[0]) / wide), 0), count - 1)
    j0 = min(max(int((state[0, 1] - box[1]) / high), 0), count - 1)
    for i in range(max(i0 - 1, 0), min(i0 + 2, count)):  # the state may be on walls
        for j in range(max(j0 - 1, 0), min(j0 + 2, count)):
            x, y = box[0] + (i + 0.5) * wide, box[1] + (j + 0.5) * high
            if is_free(state[0, 0], state[0, 1], x, y, dx, dy, world):
                mask[i, j] = True
                stack[total] = i * count + j
                total += 1
    while total:
        total -= 1
        at = stack[total]
        for k in range(4):
            i, j = at // count, at % count
            here_x, here_y = box[0] + (i + 0.5) * wide, box[1] + (j + 0.5) * high
            i += (k == 0) - (k == 1)
            j += (k == 2) - (k == 3)
            if i < 0 or j < 0 or i >= count or j >= count or mask[i, j]:
                continue
            x, y = box[0] + (i + 0.5) * wide, box[1] + (j + 0.5) * high
            if is_free(here_x, here_y, x, y, dx, dy, world):
                mask[i, j] = True
                stack[total] = i * count + j
                total += 1


@kernel
def is_in(state, box, world, mask):
    """Return whether a free translation leads the first particle to a square of a mask that it is in
    or beside.
    """
    count = mask.shape[0]
    x, y = state[0, 0], state[0, 1]
    dx, dy = state[1, 0] - x, state[1, 1] - y
    wide, high = (box[2] - box[0]) / count, (box[3] - box[1]) / count
    i0 = min(max(int((x - box[0]) / (box[2] - box[0]) * count), 0), count - 1)
    j0 = min(max(int((y - box[1]) / (box[3] - box[1]) * count), 0), count - 1)
    for i in range(max(i0 - 1, 0), min(i0 + 2, count)):
        for j in range(max(j0 - 1, 0), min(j0 + 2, count)):
            to_x, to_y = box[0] + (i + 0.5) * wide, box[1] + (j + 0.5) * high
            if mask[i, j] and is_free(x, y, to_x, to_y, dx, dy, world):
                return True
    return False


@kernel
def random_contact(state, held, world, rng, normal):
    """Move both particles in place so that one is at a random point of a wall."""
    if world.flat:
        edges = world.edges
        edge = min(int(rng.random() * edges.ends.shape[0]), edges.ends.shape[0] - 1)
        share = rng.random()
        x = edges.ends[edge, 0] + share * (edges.ends[edge, 2] - edges.ends[edge, 0])
        y = edges.ends[edge, 1] + share * (edges.ends[edge, 3] - edges.ends[edge, 1])
        normal[0], normal[1] = edges.normals[edge, 0], edges.normals[edge, 1]
    else:
        circle, angle = world.walls.circle, 2 * np.pi * rng.random()
        normal[0], normal[1] = -np.cos(angle), -np.sin(angle)
        x, y = circle[0] - circle[2] * normal[0], circle[1] - circle[2] * normal[1]
    x, y = x - state[held, 0], y - state[held, 1]
    for p in range(2):
        state[p, 0] += x
        state[p, 1] += y


@kernel
def search(
    start, goal, near, tries, rounds, cell, box, world, states, masks, states_of, made, parents, rng
):
    """Search until the goals' difference is reached in the goals' component. Return whether it is,
    the number of states, and how many contacts lead there (or to the farthest state).
    """
    size, friction = world.walls.size, world.walls.friction
    if world.flat:
        friction = world.edges.friction
    cone = np.arctan(friction)
    state, normal, spare, vector = np.zeros((2, 2)), np.zeros(2), np.zeros(2), np.zeros(2)
    gains, trial = np.array([[1.0, 0.0], [1.0, 0.0]]), np.zeros((3, 2, 2))
    goal_mask = np.zeros((masks.shape[1], masks.shape[2]), dtype=np.bool_)
    stack = np.zeros(masks.shape[1] * masks.shape[2] + 9, dtype=np.int64)
    flood(goal, box, world, goal_mask, stack)
    across = states_of.shape[0]
    total, done, without = 1, 0, 0
    contact.copy(start, states[0])
    flood(start, box, world, masks[0], stack)
    wanted_x, wanted_y = goal[1, 0] - goal[0, 0], goal[1, 1] - goal[0, 1]
    if np.sqrt(
        (start[1, 0] - start[0, 0] - wanted_x) ** 2 + (start[1, 1] - start[0, 1] - wanted_y) ** 2
    ) <= near and is_in(start, box, world, goal_mask):
        return True, 0
    before = total
    while without < rounds:
        if done == total:
            without = 0 if total > before else without + 1
            before, done = total, 0
            continue
        at = done
        done += 1
        for _ in range(tries):
            contact.copy(states[at], state)
            held = 0 if rng.random() < 0.5 else 1
            anywhere = rng.random() < 0.08
            if not anywhere:
                random_contact(state, held, world, rng, normal)
                if not is_inside(state[1 - held, 0], state[1 - held, 1], world):
                    continue
                if not is_in(state, box, world, masks[at]):
                    continue
            contact.copy(state, trial[0])
            trial[1:] = 0.0
            for push in range(4):
                angle = np.pi * (2 * rng.random() - 1)
                if not anywhere and push == 0:
                    angle = np.arctan2(-normal[1], -normal[0])
                    choice = rng.random()
                    if choice < 0.2:
                        angle += cone * (1 - 1e-9)
                    elif choice < 0.4:
                        angle -= cone * (1 - 1e-9)
                    elif choice < 0.9:
                        angle += cone * (2 * rng.random() - 1)
                    else:
                        angle += np.pi * (rng.random() - 0.5)
                length = size * min(1.5 * rng.random(), 1.2)
                x, y = length * np.cos(angle), length * np.sin(angle)
                if push == 0 and rng.random() < 0.15:  # straight to the difference of the goals
                    sign = 1.0 - 2.0 * held
                    x = sign * (wanted_x - state[1, 0] + state[0, 0])
                    y = sign * (wanted_y - state[1, 1] + state[0, 1])
                trial[1 + push // 2, push % 2, 0], trial[1 + push // 2, push % 2, 1] = x, y
                send_both(state, x, y, gains, world, vector, spare)
                dx, dy = state[1, 0] - state[0, 0], state[1, 1] - state[0, 1]
                away = np.sqrt((dx - wanted_x) ** 2 + (dy - wanted_y) ** 2)
                if away <= near and is_in(state, box, world, goal_mask):
                    made[total % made.shape[0]] = trial
                    parents[total % made.shape[0]] = at
                    return True, total
                i = min(max(int((dx + size) / cell), 0), across - 1)
                j = min(max(int((dy + size) / cell), 0), across - 1)
                known, nearest = 0, np.inf
                for k in range(states_of.shape[2]):
                    one = states_of[i, j, k]
                    if one < 0:
                        break
                    if is_in(state, box, world, masks[one]):
                        known += 1
                        nearest = min(
                            nearest,
                            np.sqrt(
                                (states[one, 1, 0] - states[one, 0, 0] - wanted_x) ** 2
                                + (states[one, 1, 1] - states[one, 0, 1] - wanted_y) ** 2
                            ),
                        )
                if known == 0 or away < nearest - 0.1 * cell:
                    for k in range(states_of.shape[2]):
                        if states_of[i, j, k] < 0 and total < states.shape[0]:
                            states_of[i, j, k] = total
                            contact.copy(state, states[total])
                            made[total] = trial
                            parents[total] = at
                            flood(state, box, world, masks[total], stack)
                            total += 1
                            break
                if rng.random() < 0.5:
                    break
    return False, total


class Reach(NamedTuple):
    """What the search has found.

    ``manoeuvres`` holds, if the goals are reached, float64 arrays of shape (3, 2, 2): both particles
    at a contact, to which a free translation leads, and up to four inputs that follow.
    """

    reached: bool
    states: int
    manoeuvres: list[NDArray[np.float64]]


def reach_of(
    problem: SteeringProblem, friction: float, *, cell: float = CELL, seed: int = 0
) -> Reach:
    """Return whether the search reaches the goals of a problem on walls with a friction."""
    world = problem.replaced(friction=friction).world()
    kernel_world = world_of(world)._replace(flat=not world.free_space.round)
    kernel_world = with_friction(kernel_world, float(friction))
    size, (low, high) = float(problem.place.size), problem.place.bounds
    across = int(2 / cell) + 2
    start, goal = problem.endpoints(0)
    made, parents = np.zeros((MOST + 1, 3, 2, 2)), np.zeros(MOST + 1, dtype=np.int64)
    reached, total = search(
        np.ascontiguousarray(start),
        np.ascontiguousarray(goal),
        2 * problem.tolerance,
        TRIES,
        ROUNDS,
        cell * size,
        np.array([*low, *high], dtype=np.float64),
        kernel_world,
        np.zeros((MOST, 2, 2)),
        np.zeros((MOST, RASTER, RASTER), dtype=np.bool_),
        np.full((across, across, 4), -1),
        made,
        parents,
        np.random.default_rng([seed, 7]),
    )
    chain, at = [], total if reached else 0
    while at:
        chain.append(made[at])
        at = int(parents[at])
    return Reach(bool(reached), int(total), chain[::-1])
