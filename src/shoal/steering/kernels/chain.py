"""The shortest chain of contacts of a given kind: an interior-point method on contacts and differences.

On flat walls the length is convex in the unknowns and so are the limits; on the circle a contact is an angle, and what is found is
the best near the first guess. The method minimizes ``sharpness * length - sum(log(limits))`` by Newton's method for ever greater
sharpness, so all that it returns lies strictly inside of all limits. See `limits` for what a chain is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.jit import kernel
from shoal.steering.kernels.chain_limits import add_flat, add_hold, add_length, add_round, begin, combine, new_place, new_work, put
from shoal.steering.kernels.contact import dot

GROWTH = 12.0
NEWTON = 40
NEAR = 1e-2  # over the sharpness: how near to its minimum a round ends
BLUR = 0.03  # over the sharpness: how far a length is blurred where it vanishes


@kernel
def add_limits(kind, place, work, slack, order):
    """Add all limits of a chain; return the sum, infinite if one does not hold."""
    contacts, delta, touchers, walls = place.contacts, place.delta, kind.touchers, kind.walls
    normals, offsets, near, circle = kind.shape.normals, kind.shape.offsets, kind.shape.near, kind.shape.circle
    span, index, first, second = work.span, work.index, work.first, work.second
    sums, derivatives = work.sums, work.derivatives
    cycles, total = contacts.shape[0], 0.0
    for m in range(cycles):
        sign = 1.0 if touchers[m] == 0 else -1.0
        for which in range(3):  # the contact, and the other particle before and after the adjustment
            begin(span, delta, m, 0.0)
            used = combine(contacts, delta, span, index, m, 1.0, -1, 0.0, -1 if which == 0 else m + which - 1, sign, -1, 0.0)
            skipped = walls[m] if which == 0 else -1
            # At the goal's difference the other particle may end on the toucher's wall, too: the next move lifts both.
            forgiven = kind.margin if which == 2 and m == cycles - 1 else 0.0
            total += add_flat(
                normals, offsets, near, span, index, sums, derivatives, used, skipped, kind.margin, forgiven, slack, order
            )  # fmt: skip
            if total < np.inf and circle[2] > 0 and skipped != normals.shape[0]:
                total += add_round(
                    contacts, circle, span, index, first, second, derivatives, used, m, kind.margin, forgiven, slack, order
                )
            if total == np.inf:
                return total
        total += add_hold(
            contacts, delta, normals, circle, span, index, first, second, derivatives,
            m, walls[m], sign, kind.push, kind.friction, slack, order,
        )  # fmt: skip
        if total == np.inf:
            return total
    return total


@kernel
def add_lengths(kind, place, work, sharpness, blur, order):
    """Add the lengths of all moves of a chain, times the sharpness; return the sum."""
    contacts, delta, touchers, start, goal = place.contacts, place.delta, kind.touchers, kind.start, kind.goal
    span, index, first, derivatives = work.span, work.index, work.first, work.derivatives
    cycles, total = contacts.shape[0], 0.0
    for m in range(cycles + 1):
        one, a, other, b, left, p = m, 1.0, m - 1, -1.0, -1, 0.0
        begin(span, start, touchers[0], -1.0 if m == 0 else 0.0)
        if m == cycles:
            one, a, other, b = m - 1, -1.0, -1, 0.0
            begin(span, goal, touchers[m - 1], 1.0)
        elif m > 0 and touchers[m] != touchers[m - 1]:
            left, p = m, (-1.0 if touchers[m - 1] == 0 else 1.0)
        used = combine(contacts, delta, span, index, one, a, other, b, left, p, -1, 0.0)
        total += add_length(contacts, span, index, first, derivatives, used, one, a, other, b, blur, sharpness, order)
        if m < cycles:
            begin(span, delta, m, 0.0)
            used = combine(contacts, delta, span, index, -1, 0.0, -1, 0.0, m + 1, 1.0, m, -1.0)
            total += add_length(contacts, span, index, first, derivatives, used, -1, 0.0, -1, 0.0, blur, sharpness, order)
    return total


@kernel
def assess(x, slack, sharpness, blur, kind, place, work, order):
    """Return the blurred length times sharpness plus the barrier, and with ``order`` 1 the derivatives, in ``work``.

    With a slack the length is left out and the slack, times sharpness, takes its place.
    """
    if order > 0:
        work.derivatives[:, :] = 0.0
    put(x, kind, place)
    total = add_limits(kind, place, work, slack, order)
    if total == np.inf:
        return total
    if np.isnan(slack):
        return total + add_lengths(kind, place, work, sharpness, blur, order)
    if order > 0:
        n = work.derivatives.shape[1]
        work.derivatives[n, n - 1] += sharpness
    return total + sharpness * slack


@kernel
def newton_direction(derivatives, direction):
    """Solve ``hessian @ direction = -gradient`` by Cholesky, with the diagonal raised until that works; return the decrement.

    The gradient is the last row of the derivatives, the others are the Hessian.
    """
    n = derivatives.shape[1]
    lower = np.empty((n, n))
    raised = 0.0
    for _attempt in range(60):
        done = True
        for i in range(n):
            for j in range(i + 1):
                value = derivatives[i, j]
                if i == j:
                    value += raised * (1.0 + abs(derivatives[i, i]))
                for k in range(j):
                    value -= lower[i, k] * lower[j, k]
                if i == j:
                    if not value > 1e-14 * abs(derivatives[i, i]):
                        done = False
                        break
                    lower[i, i] = np.sqrt(value)
                else:
                    lower[i, j] = value / lower[j, j]
            if not done:
                break
        if done:
            break
        raised = 1e-10 if raised == 0.0 else raised * 10
    decrement = 0.0
    for i in range(n):
        value = -derivatives[n, i]
        for k in range(i):
            value -= lower[i, k] * direction[k]
        direction[i] = value / lower[i, i]
    for i in range(n - 1, -1, -1):
        value = direction[i]
        for k in range(i + 1, n):
            value -= lower[k, i] * direction[k]
        direction[i] = value / lower[i, i]
        decrement -= derivatives[n, i] * direction[i]
    return decrement


@kernel
def descend(x, phase, sharpness, blur, kind, enough):
    """Newton's method from an allowed x, in place; with ``phase`` its last entry is the slack, and -enough will do.

    Ends where a step would gain next to nothing; divided by the sharpness, as lengths are.
    """
    n, cycles, d = x.shape[0], kind.walls.shape[0], kind.start.shape[1]
    place, work = new_place(cycles, d), new_work(n, d)
    direction, tried = np.empty(n), np.empty(n)
    nothing = np.nan
    for _iteration in range(NEWTON):
        slack = x[n - 1] if phase else nothing
        value = assess(x, slack, sharpness, blur, kind, place, work, 1)
        if value == np.inf or (phase and slack < -enough):
            return
        decrement = newton_direction(work.derivatives, direction)
        if not decrement > NEAR:
            return
        step = 1.0
        while True:
            for i in range(n):
                tried[i] = x[i] + step * direction[i]
            slack = tried[n - 1] if phase else nothing
            found = assess(tried, slack, sharpness, blur, kind, place, work, 0)
            if found <= value - 1e-4 * step * decrement + 1e-13 * abs(value):
                break
            step *= 0.5
            if step < 1e-12:
                return
        x[:] = tried


@kernel
def worst_limit(x, kind):
    """Return a slack that makes all limits positive at x, -inf if some limit without unknowns fails, 0 if none is needed."""
    cycles, d = kind.walls.shape[0], kind.start.shape[1]
    place, work = new_place(cycles, d), new_work(x.shape[0] + 1, d)
    for tenth in range(-8, 5):
        slack = 0.0 if tenth == -8 else 10.0**tenth
        if assess(x, slack, 0.0, 0.0, kind, place, work, 0) < np.inf:
            return slack
    return -np.inf


@kernel
def count_limits(kind):
    """Return how many limits a chain has, as a float."""
    flat = kind.shape.normals.shape[0]
    walls = flat + (1 if kind.shape.circle[2] > 0 else 0)
    total = 0
    for wall in kind.walls:
        total += 2 * walls + (1 if kind.friction == np.inf else 2)
        if wall < flat:
            total += walls - flat
        for other in range(flat):
            total += 1 if kind.shape.near[wall, other] else 0
    return float(total)


@kernel
def settle(x, enough, sharpnesses, bound, kind):
    """Move x, in place, to where all limits hold, by ``enough`` if they can; then shorten the chain; return its length.

    Infinite if the limits cannot all hold, or if on flat walls the length cannot come below ``bound``. Each of ``sharpnesses`` is
    a round of Newton's method: the last one says how near to the limits the chain may go.
    """
    n = x.shape[0]
    limits = count_limits(kind)
    limits += np.sqrt(limits)  # for rounds that end near the minimum
    slack = worst_limit(x, kind)
    if slack == -np.inf:
        return np.inf
    phase = slack > 0
    wide = np.empty(n + 1)
    wide[:n] = x
    wide[n] = 1.5 * slack
    sharpness, done, blur = 1.0 / max(slack, 1e-2), 0, 0.0
    before = np.inf
    while True:
        if not phase:
            if done == sharpnesses.shape[0]:
                break
            sharpness = sharpnesses[done]
            blur = max(BLUR / sharpness, 1e-11)
        descend(wide if phase else wide[:n], phase, sharpness, blur, kind, enough)
        if phase:
            slack = wide[n]
            if slack < -enough or (slack < 0 and before < 0 and slack > 1.2 * before):
                phase = False
            # At the minimum for this sharpness the least slack is no smaller than that less (limits / sharpness).
            elif slack > limits / sharpness or sharpness > 1e13:
                if slack >= 0:
                    return np.inf
                phase = False
            before = slack
            sharpness *= GROWTH
            continue
        done += 1
        if kind.shape.circle[2] == 0 and chain_length(wide, kind) - (limits + 10 * BLUR) / sharpness > bound:
            return np.inf
    x[:] = wide[:n]
    return chain_length(x, kind)


@kernel
def chain_length(x, kind):
    """Return the length of a chain."""
    cycles, d = kind.walls.shape[0], kind.start.shape[1]
    place, touchers = new_place(cycles, d), kind.touchers
    put(x, kind, place)
    here, total = kind.start[touchers[0]].copy(), 0.0
    for m in range(cycles):
        if m > 0 and touchers[m] != touchers[m - 1]:
            for i in range(d):
                here[i] += place.delta[m, i] if touchers[m - 1] == 0 else -place.delta[m, i]
        for i in range(d):
            here[i] = place.contacts[m, 0, i] - here[i]
        total += np.sqrt(dot(here, here))
        for i in range(d):
            here[i] = place.delta[m + 1, i] - place.delta[m, i]
        total += np.sqrt(dot(here, here))
        here[:] = place.contacts[m, 0]
    for i in range(d):
        here[i] = kind.goal[touchers[cycles - 1], i] - here[i]
    return total + np.sqrt(dot(here, here))


def first_guess(start: NDArray[np.float64], goal: NDArray[np.float64], cycles: int) -> NDArray[np.float64]:
    """Return unknowns to begin with: the middles of walls, and differences on half of the straight way."""
    before, after = start[1] - start[0], goal[1] - goal[0]
    between = (before + (after - before) * np.arange(1, cycles)[:, None] / cycles) / 2
    return np.concatenate((np.zeros(cycles * (len(before) - 1)), between.ravel()))
