"""Improvement of plans for two particles: simulated annealing changes the steps of a plan at
random.

Each step has a target, and makes the move that leads from the present positions of the particles to
this target. The target of a contact is a point on a wall, or behind a wall, towards which one
particle moves. The target of an adjustment is a position difference, which the particles reach
while a wall holds one of them. The target of a translation is a point, to which the midpoint
between the two particles moves. Without noise, the last adjustment has the position difference of
the goals as its target, and the cost of a plan is its length. With noise, the cost of a plan is the
mean number of moves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import kernel
from shoal.steering.kernels.contact import copy
from shoal.steering.kernels.sampling import passes_corner, step, step_wide, wall_point

CONTACT, ADJUSTMENT, TRANSLATION = 0, 1, 2
# fractions of the workspace size: largest and smallest typical change of a target
WIDEST, FINEST = (0.3, 1e-6)
WARMTH = 0.05  # fraction of the cost: typical increase that annealing accepts at the beginning
# relative increase of ``Noise.cycle`` for a position difference with an error as large as the
# workspace
FAR = 4.0
BLOCKED = 2.0  # number of additional moves after a wall has stopped the last move


class Steps(NamedTuple):
    """The steps of a plan."""

    kinds: NDArray[np.int64]  # (steps,): CONTACT, ADJUSTMENT or TRANSLATION
    particles: NDArray[np.int64]  # (steps,): that moves to a wall, or that a wall holds
    targets: NDArray[np.float64]  # (steps, 2): a point or a position difference
    along: NDArray[np.float64]  # (steps, 2): direction of the wall of a contact
    moves: NDArray[np.float64]  # (steps, 2): made in the last simulation


class Noise(NamedTuple):
    """Scenarios of noise, with which simulations judge a plan."""

    starts: NDArray[np.float64]  # (scenarios, 2, 2): possible start positions
    errors: NDArray[np.float64]  # (scenarios, moves, 2): of the moves
    deviation: float  # standard deviation of the errors
    cycle: float  # estimated moves that correct a wrong difference and then reach the goals


class PlanTask(NamedTuple):
    """What a plan is for."""

    start: NDArray[np.float64]  # (2, 2)
    goal: NDArray[np.float64]  # (2, 2)
    tolerance: float
    most: int  # largest number of steps


@kernel
def make_move(steps, k, state, move):
    """Write to ``move`` the move that leads from the particle positions ``state`` to the target of
    step ``k``.
    """
    p, kind = steps.particles[k], steps.kinds[k]
    for i in range(2):
        if kind == CONTACT:
            move[i] = steps.targets[k, i] - state[p, i]
        elif kind == ADJUSTMENT:
            move[i] = (1 - 2 * p) * (steps.targets[k, i] - state[1, i] + state[0, i])
        else:
            move[i] = steps.targets[k, i] - (state[0, i] + state[1, i]) / 2


@kernel
def is_near(state, goal, tolerance):
    """Return whether the distance of each of the two particles from its goal is at most
    ``tolerance``.
    """
    for q in range(2):
        if np.sqrt((state[q, 0] - goal[q, 0]) ** 2 + (state[q, 1] - goal[q, 1]) ** 2) > tolerance:
            return False
    return True


@kernel
def play(steps, count, task, bound, world, state):
    """Simulate a plan without noise. Return its length, or infinity if it misses the goals or is
    longer than ``bound``.

    The length is also infinite if a particle passes a corner nearer than ``world.clear``, or if the
    same moves miss the goals with the largest contact tolerance.

    If a step misses its target, the next step moves the particles from their actual positions to
    the next target.
    """
    last = count - 2
    while last >= 0 and steps.kinds[last] != ADJUSTMENT:
        if steps.kinds[last] == CONTACT:
            return np.inf
        last -= 1
    goal = task.goal
    copy(task.start, state)
    length = 0.0
    for i in range(2):
        steps.targets[count - 1, i] = (goal[0, i] + goal[1, i]) / 2
        if last >= 0:
            steps.targets[last, i] = goal[1, i] - goal[0, i]
    for k in range(count):
        move = steps.moves[k]
        make_move(steps, k, state, move)
        length += np.sqrt(move[0] ** 2 + move[1] ** 2)
        if not length <= bound:
            return np.inf
        if world.corners.shape[0] == 0:
            step(state, move, world)
            continue
        for q in range(2):
            x, y = state[q, 0], state[q, 1]
            step(state[q : q + 1], move, world)
            if passes_corner(x, y, state[q, 0], state[q, 1], world):
                return np.inf
    if not is_near(state, goal, task.tolerance):
        return np.inf
    if world.clear > 0:
        copy(task.start, state)
        for k in range(count):
            step_wide(state, steps.moves[k], world)
        if not is_near(state, goal, task.tolerance):
            return np.inf
    return length


@kernel
def moves_left(state, task, noise, world, move):
    """Return an estimate of the number of further moves that bring both particles to their goals.
    Overwrite ``state``.
    """
    goal, tolerance = task.goal, task.tolerance
    if is_near(state, goal, tolerance):
        return 0.0
    apart, square = 0.0, 0.0
    for i in range(2):
        apart += (state[1, i] - state[0, i] - goal[1, i] + goal[0, i]) ** 2
        move[i] = (goal[0, i] + goal[1, i] - state[0, i] - state[1, i]) / 2
        square += move[i] ** 2
    # each particle ends half of the wrong difference from its goal; a normal error in the plane is
    # shorter than m with the probability 1 - exp(-m² / (2 deviation²))
    margin = tolerance - np.sqrt(apart) / 2
    arrives = 0.0
    if margin > 0:
        arrives = (
            1.0 if noise.deviation == 0 else 1 - np.exp(-0.5 * (margin / noise.deviation) ** 2)
        )
    if arrives * noise.cycle <= 1:
        return (
            noise.cycle * (1 + FAR * np.sqrt(apart) / world.walls.size)
            + np.sqrt(square) / world.walls.size
        )
    step(state, move, world)
    return 1 / arrives + (
        0.0 if is_near(state, goal, tolerance) else BLOCKED + np.sqrt(square) / world.walls.size
    )


@kernel
def expected_moves(steps, count, task, noise, world, state, move):
    """Return the mean number of moves over all noise scenarios.

    In each scenario, the kernel counts the simulated moves of the plan, and adds an estimate of the
    number of moves that are necessary after the plan.
    """
    total, scenarios = 0.0, noise.starts.shape[0]
    for s in range(scenarios):
        copy(noise.starts[s], state)
        k = 0
        while k < count and not is_near(state, task.goal, task.tolerance):
            make_move(steps, k, state, move)
            for i in range(2):
                move[i] += noise.errors[s, k, i]
            step(state, move, world)
            k += 1
        total += k + moves_left(state, task, noise, world, move)
    return total / scenarios


@kernel
def copy_steps(source, count, target):
    for k in range(count):
        target.kinds[k], target.particles[k] = source.kinds[k], source.particles[k]
        for i in range(2):
            target.targets[k, i], target.along[k, i] = source.targets[k, i], source.along[k, i]
            target.moves[k, i] = source.moves[k, i]


@kernel
def shift(steps, first, count, by):
    """Move the steps with the indices ``first`` to ``count - 1`` by ``by`` places. Return the new
    number of steps.
    """
    for n in range(count - first):
        k = first + n if by < 0 else count - 1 - n
        steps.kinds[k + by], steps.particles[k + by] = steps.kinds[k], steps.particles[k]
        for i in range(2):
            steps.targets[k + by, i], steps.along[k + by, i] = (
                steps.targets[k, i],
                steps.along[k, i],
            )
    return count + by


@kernel
def draw_contact(steps, k, particle, near, world, rng, over, place, normal):
    """Replace step ``k`` by a contact of a particle with a random point of the walls.

    The target of the contact lies at a random distance behind the wall. The mean distance is
    proportional to ``over``, the standard deviation of the noise.
    """
    wall_point(near[particle], world, rng, place, normal)
    steps.kinds[k], steps.particles[k] = CONTACT, particle
    steps.along[k, 0], steps.along[k, 1] = -normal[1], normal[0]
    far = 2 * over * abs(rng.normal())
    for i in range(2):
        steps.targets[k, i] = place[i] - far * normal[i]


@kernel
def vary(steps, k, width, world, rng, over):
    """Change the target of step ``k`` by a random vector, whose length is about ``width``.

    The target of a contact changes by about ``width`` along its wall, but by at most about ``over``
    across its wall.
    """
    x, y = width * rng.normal(), width * rng.normal()
    if steps.kinds[k] == CONTACT:
        off = min(width, over) * rng.normal()
        x, y = (
            x * steps.along[k, 0] + off * steps.along[k, 1],
            x * steps.along[k, 1] - off * steps.along[k, 0],
        )
    steps.targets[k, 0] += x
    steps.targets[k, 1] += y
    circle = world.walls.circle
    if steps.kinds[k] == CONTACT and circle[2] > 0:
        x, y = steps.targets[k, 0] - circle[0], steps.targets[k, 1] - circle[1]
        away = np.sqrt(x * x + y * y)
        steps.along[k, 0], steps.along[k, 1] = -y / away, x / away
        if over == 0:
            steps.targets[k, 0], steps.targets[k, 1] = (
                circle[0] + circle[2] * x / away,
                circle[1] + circle[2] * y / away,
            )


@kernel
def play_before(steps, k, start, world, state, move):
    """Simulate the steps of a plan before step ``k``. Write the resulting positions of the
    particles to ``state``.
    """
    copy(start, state)
    for n in range(k):
        make_move(steps, n, state, move)
        step(state, move, world)


@kernel
def aim_near(steps, k, width, rng, state):
    """Give the new step ``k`` a random target.

    For an adjustment, the target is near the present position difference of the particles; for a
    translation, the target is near their present midpoint.
    """
    for i in range(2):
        present = (
            state[1, i] - state[0, i]
            if steps.kinds[k] == ADJUSTMENT
            else (state[0, i] + state[1, i]) / 2
        )
        steps.targets[k, i] = present + width * rng.normal()


@kernel
def change(steps, count, task, world, rng, odds, over):
    """Change a plan at random, in place. Return the new number of steps.

    The array ``odds`` contains the cumulative probabilities of six kinds of change. Change 1 alters
    one or two targets. Change 2 removes a step. Change 3 replaces a contact, in half of the cases
    by a contact of the other particle. Change 4 inserts a contact before an adjustment, so that the
    wall holds the other particle during the adjustment. Change 5 inserts a contact and an
    adjustment. Change 6 inserts a translation.
    """
    state, move, normal = np.empty((2, 2)), np.empty(2), np.empty(2)
    start, goal = task.start, task.goal
    choice, size = rng.random(), world.walls.size
    k = min(int(rng.random() * (count - 1)), count - 2)
    width = size * WIDEST * (max(FINEST, 0.1 * over / size) / WIDEST) ** rng.random()
    if choice < odds[0] and count > 1:
        if steps.kinds[k] == ADJUSTMENT and rng.random() < 0.1:
            for i in range(2):
                steps.targets[k, i] = goal[1, i] - goal[0, i]
        else:
            vary(steps, k, width, world, rng, over)
        if rng.random() < 0.5:
            vary(steps, min(int(rng.random() * (count - 1)), count - 2), width, world, rng, over)
    elif choice < odds[1] and count > 1:
        return shift(steps, k + 1, count, -1)
    elif choice < odds[2] and count > 1:
        while k > 0 and steps.kinds[k] != CONTACT:
            k -= 1
        particle = steps.particles[k] if rng.random() < 0.5 else 1 - steps.particles[k]
        if steps.kinds[k] == CONTACT:
            exchanged = particle != steps.particles[k]
            draw_contact(steps, k, particle, goal, world, rng, over, move, normal)
            while exchanged and k + 1 < count and steps.kinds[k + 1] != CONTACT:
                k += 1
                if steps.kinds[k] == ADJUSTMENT:
                    steps.particles[k] = particle
    elif choice < odds[3] and count > 1:
        while k > 0 and steps.kinds[k] != ADJUSTMENT:
            k -= 1
        if steps.kinds[k] == ADJUSTMENT and count < steps.kinds.shape[0]:
            particle = 1 - steps.particles[k]
            play_before(steps, k if rng.random() < 0.5 else k + 1, start, world, state, move)
            count = shift(steps, k, count, 1)
            draw_contact(steps, k, particle, state, world, rng, over, move, normal)
            steps.particles[k + 1] = particle
    elif choice < odds[4]:
        if count + 2 <= steps.kinds.shape[0]:
            k = max(k, 0)
            play_before(steps, k, start, world, state, move)
            count = shift(steps, k, count, 2)
            particle = 0 if rng.random() < 0.5 else 1
            draw_contact(
                steps,
                k,
                particle,
                goal if rng.random() < 0.5 else state,
                world,
                rng,
                over,
                move,
                normal,
            )
            steps.kinds[k + 1], steps.particles[k + 1] = ADJUSTMENT, particle
            aim_near(steps, k + 1, width, rng, state)
    elif count < steps.kinds.shape[0]:
        k = max(k, 0)
        count = shift(steps, k, count, 1)
        play_before(steps, k, start, world, state, move)
        steps.kinds[k] = TRANSLATION
        aim_near(steps, k, width, rng, state)
    return count


@kernel
def cost(steps, count, task, bound, noise, world, state, move):
    """Return the length of a plan, or infinity if the plan misses the goals or is longer than
    ``bound``.

    With noise, return the mean number of moves of the plan instead of its length.
    """
    if noise.starts.shape[0] == 0:
        return play(steps, count, task, bound, world, state)
    return expected_moves(steps, count, task, noise, world, state, move)


@kernel
def anneal(steps, count, task, changes, odds, noise, world, rng, trial, best):
    """Try ``changes`` random changes of a plan, in place. Write the best plan to ``best``.

    Return the number of steps and the cost of the best plan. Without noise, the cost is infinite if
    the initial plan does not end at the goals. A changed plan has at most ``task.most`` steps.
    """
    state, move = np.empty((2, 2)), np.empty(2)
    length = cost(steps, count, task, np.inf, noise, world, state, move)
    copy_steps(steps, count, best)
    shortest, steps_of_best = length, count
    if not length < np.inf:
        return steps_of_best, length
    for trials in range(changes):
        copy_steps(steps, count, trial)
        number = change(trial, count, task, world, rng, odds, noise.deviation)
        if number > task.most:
            continue
        bound = length - WARMTH * length * (1.0 - trials / changes) ** 3 * np.log(
            1.0 - rng.random()
        )
        changed = cost(trial, number, task, bound, noise, world, state, move)
        if changed < bound:
            length, count = changed, number
            copy_steps(trial, count, steps)
            if length < shortest:
                shortest, steps_of_best = length, count
                copy_steps(steps, count, best)
    return steps_of_best, shortest


@kernel
def step_all(states, moves, world):
    """Make one move in each of many simulated worlds, in place. ``moves[k]`` is the move of all
    particles of world k.
    """
    for s in range(states.shape[0]):
        step(states[s], moves[s], world)
