"""The shortest chain with a given sequence of wall contacts, by an interior-point method on contacts and position differences.

The module `chain_limits` defines the unknowns of a chain, and its limits: numbers that must be positive. On flat walls, the
optimization is a convex problem. On a round wall, the problem is not convex, and the result is a local optimum near the initial
guess. The method minimizes ``sharpness * length - sum(log(limits))`` by Newton's method, for increasing values of the weight
``sharpness``. The logarithms of the limits keep every result of the method strictly inside all limits.
"""

from __future__ import annotations

from math import inf, isnan, nan, sqrt

from shoal.jit import in_place_kernel
from shoal.steering.kernels.chain_limits import add_flat, add_hold, add_length, add_round, begin, combine, put

GROWTH = 12.0
NEWTON = 40
NEAR = 1e-2  # divided by the sharpness: excess over the minimum length at the end of a round
BLUR = 0.03  # divided by the sharpness: smallest value of a smoothed length


@in_place_kernel
def add_limits(kind, work, slack, order):
    """Return the sum of the negative logarithms of all limits (constraint values) of a chain, or infinity if a limit is violated.

    With ``order`` 1, add the derivatives of the sum to ``work.derivatives``.
    """
    walls, flat = kind.walls, kind.shape.normals.shape[0]
    cycles, total = walls.shape[0], 0.0
    for m in range(cycles):
        sign = 1.0 if kind.touchers[m] == 0 else -1.0
        for which in range(3):  # the toucher at its contact, then the other particle before and after the adjustment
            begin(work, work.delta, m, 0.0)
            used = combine(work, m, 1.0, -1, 0.0, -1 if which == 0 else m + which - 1, sign, -1, 0.0)
            skipped = walls[m] if which == 0 else -1
            # In the last cycle, the other particle may end on the toucher's wall, because the next move lifts both particles off.
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
    """Return the sum of the lengths of all moves of a chain, multiplied by ``sharpness``.

    With ``order`` 1, add the derivatives of the sum to ``work.derivatives``.
    """
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
    """Return the objective: the smoothed length of the chain times ``sharpness``, plus the logarithmic barrier of the limits.

    If ``slack`` is not NaN, the kernel adds ``slack`` to each limit that depends on an unknown, and the objective contains
    ``slack`` instead of the length of the chain. With ``order`` 1, write the derivatives of the objective to ``work.derivatives``.
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
    """Solve ``hessian @ direction = -gradient`` by a Cholesky decomposition. Return the Newton decrement.

    If the Hessian is not positive definite, the function increases its diagonal until the decomposition succeeds. The function
    computes ``direction`` only for the first ``n`` unknowns. The last row of ``derivatives`` is the gradient, and the other rows
    are the Hessian.
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
    """Improve the chain in ``work.wide`` in place by Newton's method. At the start, the chain must satisfy all limits.

    If ``phase`` is true, the last entry of ``work.wide`` is the slack, a number that is added to each limit. The method then
    reduces the slack, and ends when the slack is below ``-enough``. If ``phase`` is false, the method reduces the length of the
    chain, and ends when a step would shorten the chain by less than about ``NEAR / sharpness``.
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
    """Return a slack for the chain with the unknowns x: a number that, added to each limit, makes all limits positive.

    The slack is 0 if the chain satisfies all limits, and -inf if the chain violates a limit that depends on no unknown.
    """
    for tenth in range(-8, 5):
        slack = 0.0 if tenth == -8 else 10.0**tenth
        if assess(x, slack, 0.0, 0.0, kind, work, 0) < inf:
            return slack
    return -inf


@in_place_kernel
def count_limits(kind):
    """Return the number of limits (constraints) of a chain, as a float."""
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
    """Change the unknowns x of a chain in place until they satisfy all limits, then shorten the chain. Return its length.

    Before the kernel shortens the chain, all limits are at least ``enough``, if possible. The length is infinite if no chain
    satisfies all limits, and on flat walls also if no chain is shorter than ``bound``. Each entry of ``sharpnesses`` is the
    sharpness for one round of Newton's method. The last entry of ``sharpnesses`` determines how close to its limits the chain may
    come.
    """
    n, wide = x.shape[0], work.wide
    limits = count_limits(kind)
    limits += sqrt(limits)  # because a round ends near the minimum, not exactly at the minimum
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
            # Lower bound of the smallest possible slack: the slack after this round minus (limits / sharpness).
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
    """Return the length of the chain with the unknowns x."""
    put(x, kind, work)
    return add_lengths(kind, work, 1.0, 0.0, 0)
