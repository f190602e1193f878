"""Chains of contacts in compiled code: their lengths, limits, gradients and Hessians."""

from __future__ import annotations

from collections import namedtuple
from math import cos, inf, isnan, log, nan, sin, sqrt

import numpy as np

from shoal.jit import in_place_kernel

CONSTANT = 1e-13  # a limit with a smaller gradient counts as constant: it depends on no unknown
FORGIVEN = 1e-12  # a constant limit is satisfied if its value is at least minus this number
TINY = 1e-200  # smallest product of limits for which the code delays the logarithm

Shape = namedtuple("Shape", "frames normals offsets circle near")
"""The walls, as in `shoal.steering.workspaces.region.NormalizedWalls`."""

Kind = namedtuple("Kind", "touchers walls start goal shape friction margin push")
"""The constants of a chain: touchers and walls of its cycles, start, goal, all walls (``shape``),
and friction. ``margin`` is the least distance of the other particle (not the toucher) from walls.
``push`` is the least component of an adjustment into a wall.
"""

Work = namedtuple(
    "Work",
    "contacts delta span index first second cone_first cone_second sums derivatives lower direction"
    " tried wide",
)
"""Working memory. ``contacts``, shape (cycles, d + 1, d), holds the position of each contact, its
derivatives by the coordinates on the wall, and on the circle its second derivative by the arc.
``delta``, shape (cycles + 1, d), holds the position differences. ``span``, shape (1 + unknowns, d),
holds a vector, and its derivatives by the unknowns whose indices are in ``index``. ``first`` and
``second`` hold the derivatives of a limit. ``sums`` holds sums over all walls of normal / limit,
normal / limit^2 and normal normal^T / limit^2. ``derivatives`` holds the Hessian and, in the last
row, the gradient. ``lower`` holds the Cholesky factor of the Hessian, ``direction`` the Newton
step. ``tried`` and ``wide`` each hold a chain's unknowns and a slack.
"""


def new_work(cycles: int, d: int) -> Work:
    """Return working memory for a chain of ``cycles`` cycles in ``d`` dimensions."""
    few, all_ = 4 * d, cycles * (2 * d - 1) - d + 1
    return Work(
        np.zeros((cycles, d + 1, d)),
        np.zeros((cycles + 1, d)),
        np.zeros((1 + few, d)),
        np.zeros(few, dtype=np.int64),
        np.zeros(few),
        np.zeros((few, few)),
        np.zeros(few),
        np.zeros((few, few)),
        np.zeros((2 + d, d)),
        np.zeros((all_ + 1, all_)),
        np.zeros((all_, all_)),
        np.zeros(all_),
        np.zeros(all_),
        np.zeros(all_),
    )


@in_place_kernel
def put(x, kind, work):
    """Write to ``work`` the contacts and position differences of the chain that has the
    unknowns x.
    """
    contacts, delta, walls, start, goal = (
        work.contacts,
        work.delta,
        kind.walls,
        kind.start,
        kind.goal,
    )
    frames, circle = kind.shape.frames, kind.shape.circle
    cycles, d = contacts.shape[0], contacts.shape[2]
    for m in range(cycles):
        wall, y = walls[m], m * (d - 1)
        if wall < frames.shape[0]:
            for i in range(d):
                contacts[m, 0, i] = frames[wall, 0, i]
                contacts[m, d, i] = 0.0
                for k in range(1, d):
                    contacts[m, 0, i] += x[y + k - 1] * frames[wall, k, i]
                    contacts[m, k, i] = frames[wall, k, i]
        else:
            cosine, sine = (
                cos(x[y] / circle[2]),
                sin(x[y] / circle[2]),
            )  # x[y] is the length of an arc
            contacts[m, 0, 0], contacts[m, 0, 1] = (
                circle[0] + circle[2] * cosine,
                circle[1] + circle[2] * sine,
            )
            contacts[m, 1, 0], contacts[m, 1, 1] = -sine, cosine
            contacts[m, d, 0], contacts[m, d, 1] = -cosine / circle[2], -sine / circle[2]
            if d == 3:
                contacts[m, 0, 2] = x[y + 1]
                contacts[m, 1, 2] = contacts[m, 2, 0] = contacts[m, 2, 1] = contacts[m, d, 2] = 0.0
                contacts[m, 2, 2] = 1.0
    for i in range(d):
        delta[0, i] = start[1, i] - start[0, i]
        delta[cycles, i] = goal[1, i] - goal[0, i]
        for m in range(1, cycles):
            delta[m, i] = x[cycles * (d - 1) + (m - 1) * d + i]


@in_place_kernel
def begin(work, points, row, factor):
    """Set the vector ``work.span[0]`` to ``factor`` times a row of ``points``."""
    for i in range(work.span.shape[1]):
        work.span[0, i] = factor * points[row, i]


@in_place_kernel
def combine(work, one, a, other, b, left, p, right, q):
    """Add ``a c[one] + b c[other] + p D[left] + q D[right]``, for contacts c and position
    differences D, to ``work.span[0]``.

    Write the derivatives to ``work.span``. Return the number of unknowns on which the sum depends.
    A negative index omits its term.
    """
    contacts, delta, span, index = work.contacts, work.delta, work.span, work.index
    cycles, d = contacts.shape[0], contacts.shape[2]
    used = 0
    for term in range(2):
        m, factor = (one, a) if term == 0 else (other, b)
        if m < 0:
            continue
        for i in range(d):
            span[0, i] += factor * contacts[m, 0, i]
        for k in range(1, d):
            index[used] = m * (d - 1) + k - 1
            used += 1
            for i in range(d):
                span[used, i] = factor * contacts[m, k, i]
    for term in range(2):
        m, factor = (left, p) if term == 0 else (right, q)
        if m < 0:
            continue
        for i in range(d):
            span[0, i] += factor * delta[m, i]
        if 0 < m < cycles:
            for k in range(d):
                index[used] = cycles * (d - 1) + (m - 1) * d + k
                used += 1
                for i in range(d):
                    span[used, i] = factor if i == k else 0.0
    return used


@in_place_kernel
def rows_dot(one, i, other, k):
    total = 0.0
    for j in range(one.shape[1]):
        total += one[i, j] * other[k, j]
    return total


@in_place_kernel
def add_length(work, used, one, a, other, b, blur, weight, order):
    """Return ``weight`` times the smoothed length of ``work.span[0]``. With ``order`` 1, update
    ``work.derivatives``.
    """
    contacts, span, index, first, derivatives = (
        work.contacts,
        work.span,
        work.index,
        work.first,
        work.derivatives,
    )
    length = sqrt(blur * blur + rows_dot(span, 0, span, 0))
    if order == 0:
        return weight * length
    n, d = derivatives.shape[1], span.shape[1]
    for u in range(used):
        first[u] = rows_dot(span, 0, span, 1 + u) / length
    for u in range(used):
        derivatives[n, index[u]] += weight * first[u]
        for v in range(used):
            derivatives[index[u], index[v]] += (
                weight * (rows_dot(span, 1 + u, span, 1 + v) - first[u] * first[v]) / length
            )
    for term in range(2):
        m, factor = (one, a) if term == 0 else (other, b)
        if m >= 0:
            bend = 0.0
            for i in range(d):
                bend += span[0, i] * contacts[m, d, i]
            derivatives[m * (d - 1), m * (d - 1)] += weight * factor * bend / length
    return weight * length


@in_place_kernel
def add_limit(index, first, second, derivatives, value, used, curved, forgiven, slack, order):
    """Return ``-log(value + slack)``, or infinity if this logarithm is undefined. With ``order`` 1,
    update ``derivatives``.

    If ``slack`` is NaN, the kernel uses 0; otherwise, ``slack`` is the last unknown. Without
    ``curved``, the kernel ignores ``second``. If ``value`` depends on no unknown, the result is 0
    if ``value`` is at least about ``-forgiven``, else infinity.
    """
    steep = 0.0
    for u in range(used):
        steep = max(steep, abs(first[u]))
    if steep <= CONSTANT:
        return 0.0 if value >= -FORGIVEN - forgiven else inf
    n = derivatives.shape[1]
    last, phase = n - 1, not isnan(slack)
    total = value + slack if phase else value
    if not total > 0:
        return inf
    if order == 0:
        return -log(total)
    for u in range(used):
        i = index[u]
        derivatives[n, i] -= first[u] / total
        for v in range(used):
            bend = first[u] * first[v] / total
            if curved:
                bend -= second[u, v]
            derivatives[i, index[v]] += bend / total
        if phase:
            derivatives[i, last] += first[u] / total / total
            derivatives[last, i] += first[u] / total / total
    if phase:
        derivatives[n, last] -= 1 / total
        derivatives[last, last] += 1 / total / total
    return -log(total)


@in_place_kernel
def add_flat(kind, work, used, skipped, forgiven, slack, order):
    """Return the sum of -log(distance - margin) over the flat walls, for the distance from each
    wall to the point ``work.span[0]``.

    If ``skipped`` is not negative, the sum contains only the walls near the wall with the index
    ``skipped``.
    """
    normals, offsets, near, margin = (
        kind.shape.normals,
        kind.shape.offsets,
        kind.shape.near,
        kind.margin,
    )
    span, sums = work.span, work.sums
    d, phase = span.shape[1], not isnan(slack)
    total, product, ones, squares = 0.0, 1.0, 0.0, 0.0
    for i in range(2 + d):
        for k in range(d):
            sums[i, k] = 0.0
    for wall in range(normals.shape[0]):
        if skipped >= 0 and not near[skipped, wall]:
            continue
        value = rows_dot(normals, wall, span, 0) - offsets[wall] - margin
        if used < d and is_constant(
            normals, wall, span, used
        ):  # with an unknown difference, no limit is constant
            if value < -FORGIVEN - forgiven:
                return inf
            continue
        if phase:
            value += slack
        if not value > 0:
            return inf
        product *= value
        if product < TINY:
            total -= log(product)
            product = 1.0
        if order > 0:
            inverse = 1.0 / value
            ones += inverse
            squares += inverse * inverse
            for i in range(d):
                share = normals[wall, i] * inverse
                sums[0, i] += share
                share *= inverse
                sums[1, i] += share
                for k in range(d):
                    sums[2 + i, k] += share * normals[wall, k]
    if order > 0:
        add_through(work, used, ones, squares, phase)
    return total - log(product)


@in_place_kernel
def is_constant(normals, wall, span, used):
    """Return whether the distance of a point from a wall depends on no unknown."""
    for u in range(1, used + 1):
        if abs(rows_dot(normals, wall, span, u)) > CONSTANT:
            return False
    return True


@in_place_kernel
def add_through(work, used, ones, squares, phase):
    """Convert the derivatives with respect to a point, in ``work.sums``, to derivatives with
    respect to the unknowns.

    Add the results to ``work.derivatives``. ``ones`` and ``squares`` are the sums of 1 / limit and
    1 / limit^2, which give the derivatives with respect to the slack.
    """
    span, index, sums, derivatives = work.span, work.index, work.sums, work.derivatives
    n, d = derivatives.shape[1], span.shape[1]
    last = n - 1
    for u in range(used):
        at = index[u]
        derivatives[n, at] -= rows_dot(sums, 0, span, 1 + u)
        for v in range(used):
            value = 0.0
            for i in range(d):
                value += span[1 + u, i] * rows_dot(sums, 2 + i, span, 1 + v)
            derivatives[at, index[v]] += value
        if phase:
            both = rows_dot(sums, 1, span, 1 + u)
            derivatives[at, last] += both
            derivatives[last, at] += both
    if phase:
        derivatives[n, last] -= ones
        derivatives[last, last] += squares


@in_place_kernel
def add_round(kind, work, used, one, forgiven, slack, order):
    """Return the negative logarithm of the limit that keeps the point ``work.span[0]`` inside the
    circle, with a margin.
    """
    contacts, circle, margin, span = work.contacts, kind.shape.circle, kind.margin, work.span
    index, first, second, d = work.index, work.first, work.second, work.span.shape[1]
    x, y = span[0, 0] - circle[0], span[0, 1] - circle[1]
    value = (circle[2] * circle[2] - x * x - y * y) / (2 * circle[2]) - margin
    for u in range(used):
        first[u] = -(x * span[1 + u, 0] + y * span[1 + u, 1]) / circle[2]
        for v in range(used):
            second[u, v] = (
                -(span[1 + u, 0] * span[1 + v, 0] + span[1 + u, 1] * span[1 + v, 1]) / circle[2]
            )
        if index[u] == one * (d - 1):  # the point contains c[one] with the factor 1
            second[u, u] -= (x * contacts[one, d, 0] + y * contacts[one, d, 1]) / circle[2]
    return add_limit(
        index, first, second, work.derivatives, value, used, True, forgiven, slack, order
    )


@in_place_kernel
def add_hold(kind, work, m, sign, slack, order):
    """Return the summed negative logarithms of two limits of cycle m: the least push into the wall,
    and the friction cone.
    """
    contacts, circle, span, first, second, index = (
        work.contacts,
        kind.shape.circle,
        work.span,
        work.first,
        work.second,
        work.index,
    )
    d, push, on_circle = span.shape[1], kind.push, kind.walls[m] == kind.shape.normals.shape[0]
    begin(work, work.delta, m, 0.0)
    used = combine(work, -1, 0.0, -1, 0.0, m + 1, sign, m, -sign)
    into = outward(kind, work, m, 0)
    for u in range(used):
        first[u] = outward(kind, work, m, 1 + u)
        for v in range(used):
            second[u, v] = 0.0
    if on_circle:  # on the circle, the normal of the wall also depends on the contact
        index[used] = m * (d - 1)
        first[used] = span[0, 0] * contacts[m, 1, 0] + span[0, 1] * contacts[m, 1, 1]
        first[used] /= circle[2]
        for u in range(used):
            second[u, used] = (
                span[1 + u, 0] * contacts[m, 1, 0] + span[1 + u, 1] * contacts[m, 1, 1]
            ) / circle[2]
            second[used, u] = second[u, used]
        second[used, used] = -into / circle[2] / circle[2]
        for i in range(d):
            span[1 + used, i] = 0.0
        used += 1
    total = add_limit(
        index, first, second, work.derivatives, into - push, used, on_circle, push, slack, order
    )
    if kind.friction == inf or total == inf:
        return total
    return total + add_cone(kind.friction, work, into, used, slack, order)


@in_place_kernel
def outward(kind, work, m, row):
    """Return the component of a row of ``work.span`` that points out of the workspace through the
    wall of contact m.
    """
    contacts, span, normals, circle, wall = (
        work.contacts,
        work.span,
        kind.shape.normals,
        kind.shape.circle,
        kind.walls[m],
    )
    if wall < normals.shape[0]:
        return -rows_dot(normals, wall, span, row)
    total = 0.0
    for i in range(2):
        total += (contacts[m, 0, i] - circle[i]) * span[row, i]
    return total / circle[2]


@in_place_kernel
def add_cone(friction, work, into, used, slack, order):
    """Return the negative logarithm of the friction limit |a|^2 <= (1 + friction^2) p^2 for the
    vector a = ``work.span[0]``.

    ``into`` is p, the component of the vector a into the wall. The code divides both sides by p, so
    that they are lengths.
    """
    span, first, second, cone_first, cone_second = (
        work.span,
        work.first,
        work.second,
        work.cone_first,
        work.cone_second,
    )
    whole = 1 + friction * friction
    square, reach = rows_dot(span, 0, span, 0), max(into, 1e-12)
    for u in range(used):
        u_along = rows_dot(span, 0, span, 1 + u)
        cone_first[u] = whole * first[u] - 2 * u_along / reach + square * first[u] / reach / reach
        for v in range(used):
            cone_second[u, v] = (
                whole * second[u, v]
                - 2 * rows_dot(span, 1 + u, span, 1 + v) / reach
                + 2
                * (u_along * first[v] + rows_dot(span, 0, span, 1 + v) * first[u])
                / reach
                / reach
                + square * second[u, v] / reach / reach
                - 2 * square * first[u] * first[v] / reach / reach / reach
            )
    value = whole * reach - square / reach if into > 0 or isnan(slack) else -square / reach
    return add_limit(
        work.index, cone_first, cone_second, work.derivatives, value, used, True, 0.0, slack, order
    )


GROWTH = 12.0
NEWTON = 40
NEAR = 1e-2  # divided by the sharpness: excess over the minimum length at the end of a round
BLUR = 0.03  # divided by the sharpness: smallest value of a smoothed length


@in_place_kernel
def add_limits(kind, work, slack, order):
    """Return the sum of the negative logarithms of all limits (constraint values) of a chain, or
    infinity if a limit is violated.

    With ``order`` 1, add the derivatives of the sum to ``work.derivatives``.
    """
    walls, flat = kind.walls, kind.shape.normals.shape[0]
    cycles, total = walls.shape[0], 0.0
    for m in range(cycles):
        sign = 1.0 if kind.touchers[m] == 0 else -1.0
        for which in range(
            3
        ):  # the toucher at its contact, then the other particle before and after the adjustment
            begin(work, work.delta, m, 0.0)
            used = combine(
                work, m, 1.0, -1, 0.0, -1 if which == 0 else m + which - 1, sign, -1, 0.0
            )
            skipped = walls[m] if which == 0 else -1
            # In the last cycle, the other particle may end on the toucher's wall, because the next
            # move lifts both particles off.
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
    """Return the objective: the smoothed length of the chain times ``sharpness``, plus the
    logarithmic barrier of the limits.

    If ``slack`` is not NaN, the kernel adds ``slack`` to each limit that depends on an unknown, and
    the objective contains ``slack`` instead of the length of the chain. With ``order`` 1, write the
    derivatives of the objective to ``work.derivatives``.
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
    """Solve ``hessian @ direction = -gradient`` by a Cholesky decomposition. Return the Newton
    decrement.

    If the Hessian is not positive definite, the function increases its diagonal until the
    decomposition succeeds. The function computes ``direction`` only for the first ``n`` unknowns.
    The last row of ``derivatives`` is the gradient, and the other rows are the Hessian.
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
    """Improve the chain in ``work.wide`` in place by Newton's method. At the start, the chain must
    satisfy all limits.

    If ``phase`` is true, the last entry of ``work.wide`` is the slack, a number that is added to
    each limit. The method then reduces the slack, and ends when the slack is below ``-enough``. If
    ``phase`` is false, the method reduces the length of the chain, and ends when a step would
    shorten the chain by less than about ``NEAR / sharpness``.
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
    """Return a slack for the chain with the unknowns x: a number that, added to each limit, makes
    all limits positive.

    The slack is 0 if the chain satisfies all limits, and -inf if the chain violates a limit that
    depends on no unknown.
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
    """Change the unknowns x of a chain in place until they satisfy all limits, then shorten the
    chain. Return its length.

    Before the kernel shortens the chain, all limits are at least ``enough``, if possible. The
    length is infinite if no chain satisfies all limits, and on flat walls also if no chain is
    shorter than ``bound``. Each entry of ``sharpnesses`` is the sharpness for one round of Newton's
    method. The last entry of ``sharpnesses`` determines how close to its limits the chain may come.
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
            # Lower bound of the smallest possible slack: the slack after this round minus (limits /
            # sharpness).
            elif slack > limits / sharpness or sharpness > 1e13:
                if slack >= 0:
                    return inf
                phase = False
            before = slack
            sharpness *= GROWTH
            continue
        done += 1
        if (
            kind.shape.circle[2] == 0
            and chain_length(wide, kind, work) - (limits + 10 * BLUR) / sharpness > bound
        ):
            return inf
    for i in range(n):
        x[i] = wide[i]
    return chain_length(x, kind, work)


@in_place_kernel
def chain_length(x, kind, work):
    """Return the length of the chain with the unknowns x."""
    put(x, kind, work)
    return add_lengths(kind, work, 1.0, 0.0, 0)
