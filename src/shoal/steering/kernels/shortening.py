"""Plans of two particles made shorter: their steps are changed at random, and what is no longer is kept, as in annealing.

Each plan is a sequence of steps: to a contact, an adjustment while a wall holds one particle, a translation of both. The last
adjustment makes the difference of the goals, and the last step, a translation, leads there: both follow from the others.
"""

from __future__ import annotations

from collections import namedtuple

import numpy as np

from shoal.jit import kernel
from shoal.steering.kernels.contact import copy
from shoal.steering.kernels.sampling import step, wall_point

Steps = namedtuple("Steps", "kinds particles vectors along moves")
"""Steps of a plan: CONTACT, ADJUSTMENT or TRANSLATION; the particle that comes to a wall, or is held; where the contact is, else
the move; of a contact the direction of its wall; and, once it was played, each move."""

CONTACT, ADJUSTMENT, TRANSLATION = 0, 1, 2
EXACT = 1e-9  # of the size: a step that goes elsewhere by more is another one
WIDEST, FINEST = 0.3, 1e-6  # of the size: typical changes of places and moves
WARMTH = 0.05  # of the length: by how much plans may get longer at first
CHANGED = 0.75  # of the trials: other places and moves
LEFT_OUT, GIVEN, PUT_IN = 0.85, 0.92, 0.98  # up to here: a step less, another contact and toucher, a contact more; else a bend


@kernel
def play(steps, count, start, goal, tolerance, world, state, wanted):
    """Return the length of a plan, infinite if a step does not do what it should, or if the plan does not end at the goal."""
    last = count - 2
    while last >= 0 and steps.kinds[last] != ADJUSTMENT:
        if steps.kinds[last] == CONTACT:
            return np.inf
        last -= 1
    if last < 0:
        return np.inf
    copy(start, state)
    near, length = EXACT * world.walls.size, 0.0
    for k in range(count):
        p, kind, move = steps.particles[k], steps.kinds[k], steps.moves[k]
        for i in range(2):
            move[i] = steps.vectors[k, i]
            if kind == CONTACT:
                move[i] -= state[p, i]
            if k == last:
                move[i] = state[p, i] - goal[p, i] - state[1 - p, i] + goal[1 - p, i]
            if k == count - 1:
                move[i] = (goal[0, i] + goal[1, i] - state[0, i] - state[1, i]) / 2
            for q in range(2):
                wanted[q, i] = state[q, i] + (0.0 if kind == ADJUSTMENT and q == p else move[i])
        step(state, move, world)
        for q in range(2):
            for i in range(2):
                if not abs(state[q, i] - wanted[q, i]) <= near:
                    return np.inf
        length += np.sqrt(move[0] ** 2 + move[1] ** 2)
    for q in range(2):
        if np.sqrt((state[q, 0] - goal[q, 0]) ** 2 + (state[q, 1] - goal[q, 1]) ** 2) > tolerance:
            return np.inf
    return length


@kernel
def copy_steps(source, count, target):
    for k in range(count):
        target.kinds[k], target.particles[k] = source.kinds[k], source.particles[k]
        for i in range(2):
            target.vectors[k, i], target.along[k, i] = source.vectors[k, i], source.along[k, i]
            target.moves[k, i] = source.moves[k, i]


@kernel
def shift(steps, first, count, by):
    """Move the steps from a number on by one or two places, back or forth; return how many there are then."""
    for n in range(count - first):
        k = first + n if by < 0 else count - 1 - n
        steps.kinds[k + by], steps.particles[k + by] = steps.kinds[k], steps.particles[k]
        for i in range(2):
            steps.vectors[k + by, i], steps.along[k + by, i] = steps.vectors[k, i], steps.along[k, i]
    return count + by


@kernel
def draw_contact(steps, k, particle, goal, world, rng, place, normal):
    """Make a step a contact of a particle anywhere on the walls."""
    wall_point(goal[particle], world, rng, place, normal)
    steps.kinds[k], steps.particles[k] = CONTACT, particle
    steps.vectors[k, 0], steps.vectors[k, 1] = place[0], place[1]
    steps.along[k, 0], steps.along[k, 1] = -normal[1], normal[0]


@kernel
def vary(steps, k, width, world, rng):
    """Change the place or the move of a step by so much."""
    x, y = width * rng.normal(), width * rng.normal()
    if steps.kinds[k] == CONTACT:
        x, y = x * steps.along[k, 0], x * steps.along[k, 1]
    steps.vectors[k, 0] += x
    steps.vectors[k, 1] += y
    circle = world.walls.circle
    if steps.kinds[k] == CONTACT and circle[2] > 0:
        x, y = steps.vectors[k, 0] - circle[0], steps.vectors[k, 1] - circle[1]
        away = np.sqrt(x * x + y * y)
        steps.along[k, 0], steps.along[k, 1] = -y / away, x / away
        steps.vectors[k, 0], steps.vectors[k, 1] = circle[0] + circle[2] * x / away, circle[1] + circle[2] * y / away


@kernel
def change(steps, count, goal, world, rng, place, normal):
    """Change a plan at random, in place; return how many steps it has then."""
    choice, size = rng.random(), world.walls.size
    k = min(int(rng.random() * (count - 1)), count - 2)
    width = size * WIDEST * (FINEST / WIDEST) ** rng.random()
    if choice < CHANGED:
        vary(steps, k, width, world, rng)
        if rng.random() < 0.5:
            vary(steps, min(int(rng.random() * (count - 1)), count - 2), width, world, rng)
    elif choice < LEFT_OUT:
        if count > 2:
            return shift(steps, k + 1, count, -1)
    elif choice < GIVEN:
        while k > 0 and steps.kinds[k] != CONTACT:
            k -= 1
        particle = steps.particles[k] if rng.random() < 0.5 else 1 - steps.particles[k]
        if steps.kinds[k] == CONTACT:
            turned = particle != steps.particles[k]
            draw_contact(steps, k, particle, goal, world, rng, place, normal)
            while turned and k + 1 < count and steps.kinds[k + 1] != CONTACT:
                k += 1
                if steps.kinds[k] == ADJUSTMENT:
                    steps.particles[k] = particle
                    steps.vectors[k, 0], steps.vectors[k, 1] = -steps.vectors[k, 0], -steps.vectors[k, 1]
    elif choice < PUT_IN:
        if count + 2 <= steps.kinds.shape[0]:
            count = shift(steps, k, count, 2)
            particle = 0 if rng.random() < 0.5 else 1
            draw_contact(steps, k, particle, goal, world, rng, place, normal)
            steps.kinds[k + 1], steps.particles[k + 1] = ADJUSTMENT, particle
            for i in range(2):
                steps.vectors[k + 1, i] = width * rng.normal()
    elif count < steps.kinds.shape[0]:
        count = shift(steps, k, count, 1)
        steps.kinds[k] = TRANSLATION
        for i in range(2):
            steps.vectors[k, i] = width * rng.normal()
    return count


@kernel
def anneal(steps, count, start, goal, tolerance, most, changes, world, rng, trial, best):
    """Change a plan, in place, so many times; write the shortest met to ``best``; return its steps and its length.

    It is infinite if the plan itself does not work. No plan gets more moves than ``most``.
    """
    state, wanted, place, normal = np.empty((2, 2)), np.empty((2, 2)), np.empty(2), np.empty(2)
    length = play(steps, count, start, goal, tolerance, world, state, wanted)
    copy_steps(steps, count, best)
    shortest, few = length, count
    if not length < np.inf:
        return few, length
    for done in range(changes):
        copy_steps(steps, count, trial)
        number = change(trial, count, goal, world, rng, place, normal)
        found = play(trial, number, start, goal, tolerance, world, state, wanted) if number <= most else np.inf
        warmth = WARMTH * length * (1.0 - done / changes) ** 3
        if found < length - warmth * np.log(1.0 - rng.random()):
            length, count = found, number
            copy_steps(trial, count, steps)
            if length < shortest:
                shortest, few = length, count
                copy_steps(steps, count, best)
    return few, shortest
