"""The shortest chain of contacts of a given kind: an interior-point method on contacts and differences.

On flat walls the length is convex in the unknowns and so are the limits; on the circle a contact is an angle, and what is found is
the best near the first guess. The method minimizes ``sharpness * length - sum(log(limits))`` by Newton's method for ever greater
sharpness, so all that it returns lies strictly inside of all limits. See `limits` for what a chain is.
"""

from __future__ import annotations

from math import inf, isnan, nan, sqrt

from shoal.jit import in_place_kernel
from shoal.steering.kernels.chain_limits import add_flat, add_hold, add_length, add_round, begin, combine, put

GROWTH = 12.0
NEWTON = 40
NEAR = 1e-2  # over the sharpness: how near to its minimum a round ends
BLUR = 0.03  # over the sharpness: how far a length is blurred where it vanishes


@in_place_kernel
def add_limits(kind, work, slack, order):
    """Add all limits of a chain; return the sum, infinite if one does not hold."""
    walls, flat = kind.walls, kind.shape.normals.shape[0]
    cycles, total = walls.shape[0], 0.0
    for m in range(cycles):
        sign = 1.0 if kind.touchers[m] == 0 else -1.0
        for which in range(3):  # the contact, and the other particle before and after the adjustment
            begin(work, work.delta, m, 0.0)
            used = combine(work, m, 1.0, -1, 0.0, -1 if which == 0 else m + which - 1, sign, -1, 0.0)
            skipped = walls[m] if which == 0 else -1
            # At the goal's difference the other particle may end on the toucher's wall, too: the next move lifts both.
            forgiven = kind.margin if which == 2 and m == cycles - 1 else 0.0
            total += add_flat(kind, work, used, skipped, forgiven, slack, order)
            if total < inf and kind.shape.circle[2] > 0 and skipped != flat:
                total += add_round(kind, work, used, m, forgiven, slack, order)
            if total == inf:
                return total
        total += add_hold(kind, work, m, sign, slack, order)
        if total == inf:
            return total
    return total


@in_place_kernel
def add_lengths(kind, work, sharpness, blur, order):
    """Add the lengths of all moves of a chain, times the sharpness; return the sum."""
    touchers, cycles, total = kind.touchers, kind.walls.shape[0], 0.0
    for m in range(cycles + 1):
        one, a, other, b, left, p = m, 1.0, m - 1, -1.0, -1, 0.0
        begin(work, kind.start, touchers[0], -1.0 if m == 0 else 0.0)
        if m == cycles:
            one, a, other, b = m - 1, -1.0, -1, 0.0
            begin(work, kind.goal, touchers[m - 1], 1.0)
        elif m > 0 and touchers[m] != touchers[m - 1]:
            left, p = m, (-1.0 if touchers[m - 1] == 0 else 1.0)
        used = combine(work, one, a, other, b, left, p, -1, 0.0)
        total += add_length(work, used, one, a, other, b, blur, sharpness, order)
        if m < cycles:
            begin(work, work.delta, m, 0.0)
            used = combine(work, -1, 0.0, -1, 0.0, m + 1, 1.0, m, -1.0)
            total += add_length(work, used, -1, 0.0, -1, 0.0, blur, sharpness, order)
    return total


@in_place_kernel
def assess(x, slack, sharpness, blur, kind, work, order):
    """Return the blurred length times sharpness plus the barrier, and with ``order`` 1 the derivatives, in ``work``.

    With a slack the length is left out and the slack, times sharpness, takes its place.
    """
    derivatives = work.derivatives
    if order > 0:
        for i in range(derivatives.shape[0]):
            for k in range(derivatives.shape[1]):
                derivatives[i, k] = 0.0
    put(x, kind, work)
    total = add_limits(kind, work, slack, order)
    if total == inf:
        return total
    if isnan(slack):
        return total + add_lengths(kind, work, sharpness, blur, order)
    if order > 0:
        n = derivatives.shape[1]
        derivatives[n, n - 1] += sharpness
    return total + sharpness * slack


@in_place_kernel
def newton_direction(derivatives, lower, direction, n):
    """Solve ``hessian @ direction = -gradient`` by Cholesky, with the diagonal raised until that works; return the decrement.

    For the first n unknowns. The gradient is the last row of the derivatives, the others are the Hessian.
    """
    last = derivatives.shape[1]
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
                    lower[i, i] = sqrt(value)
                else:
                    lower[i, j] = value / lower[j, j]
            if not done:
                break
        if done:
            break
        raised = 1e-10 if raised == 0.0 else raised * 10
    decrement = 0.0
    for i in range(n):
        value = -derivatives[last, i]
        for k in range(i):
            value -= lower[i, k] * direction[k]
        direction[i] = value / lower[i, i]
    for i in range(n - 1, -1, -1):
        value = direction[i]
        for k in range(i + 1, n):
            value -= lower[k, i] * direction[k]
        direction[i] = value / lower[i, i]
        decrement -= derivatives[last, i] * direction[i]
    return decrement


@in_place_kernel
def descend(phase, sharpness, blur, kind, work, enough):
    """Newton's method from the allowed chain ``wide``, in place; with ``phase`` its last entry is the slack, and -enough will do.

    Ends where a step would gain next to nothing; divided by the sharpness, as lengths are.
    """
    x, tried, direction = work.wide, work.tried, work.direction
    last = x.shape[0] - 1
    n = last + 1 if phase else last
    for _iteration in range(NEWTON):
        value = assess(x, x[last] if phase else nan, sharpness, blur, kind, work, 1)
        if value == inf or (phase and x[last] < -enough):
            return
        decrement = newton_direction(work.derivatives, work.lower, direction, n)
        if not decrement > NEAR:
            return
        step = 1.0
        while True:
            for i in range(n):
                tried[i] = x[i] + step * direction[i]
            found = assess(tried, tried[last] if phase else nan, sharpness, blur, kind, work, 0)
            if found <= value - 1e-4 * step * decrement + 1e-13 * abs(value):
                break
            step *= 0.5
            if step < 1e-12:
                return
        for i in range(n):
            x[i] = tried[i]


@in_place_kernel
def worst_limit(x, kind, work):
    """Return a slack that makes all limits positive at x, -inf if some limit without unknowns fails, 0 if none is needed."""
    for tenth in range(-8, 5):
        slack = 0.0 if tenth == -8 else 10.0**tenth
        if assess(x, slack, 0.0, 0.0, kind, work, 0) < inf:
            return slack
    return -inf


@in_place_kernel
def count_limits(kind):
    """Return how many limits a chain has, as a float."""
    flat = kind.shape.normals.shape[0]
    walls = flat + (1 if kind.shape.circle[2] > 0 else 0)
    total = 0
    for wall in kind.walls:
        total += 2 * walls + (1 if kind.friction == inf else 2)
        if wall < flat:
            total += walls - flat
        for other in range(flat):
            total += 1 if kind.shape.near[wall, other] else 0
    return float(total)


@in_place_kernel
def settle(x, enough, sharpnesses, bound, kind, work):
    """Move x, in place, to where all limits hold, by ``enough`` if they can; then shorten the chain; return its length.

    Infinite if the limits cannot all hold, or if on flat walls the length cannot come below ``bound``. Each of ``sharpnesses`` is
    a round of Newton's method: the last one says how near to the limits the chain may go.
    """
    n, wide = x.shape[0], work.wide
    limits = count_limits(kind)
    limits += sqrt(limits)  # for rounds that end near the minimum
    slack = worst_limit(x, kind, work)
    if slack == -inf:
        return inf
    phase = slack > 0
    for i in range(n):
        wide[i] = x[i]
    wide[n] = 1.5 * slack
    sharpness, done, blur = 1.0 / max(slack, 1e-2), 0, 0.0
    before = inf
    while True:
        if not phase:
            if done == sharpnesses.shape[0]:
                break
            sharpness = sharpnesses[done]
            blur = max(BLUR / sharpness, 1e-11)
        descend(phase, sharpness, blur, kind, work, enough)
        if phase:
            slack = wide[n]
            if slack < -enough or (slack < 0 and before < 0 and slack > 1.2 * before):
                phase = False
            # At the minimum for this sharpness the least slack is no smaller than that less (limits / sharpness).
            elif slack > limits / sharpness or sharpness > 1e13:
                if slack >= 0:
                    return inf
                phase = False
            before = slack
            sharpness *= GROWTH
            continue
        done += 1
        if kind.shape.circle[2] == 0 and chain_length(wide, kind, work) - (limits + 10 * BLUR) / sharpness > bound:
            return inf
    for i in range(n):
        x[i] = wide[i]
    return chain_length(x, kind, work)


@in_place_kernel
def chain_length(x, kind, work):
    """Return the length of a chain."""
    put(x, kind, work)
    return add_lengths(kind, work, 1.0, 0.0, 0)
