"""The shortest chain of contacts of a given kind: an interior-point method on contacts and differences.

A chain has cycles m = 0 .. M-1. In cycle m particle ``touchers[m]`` (0 or 1) is brought to the contact c[m] on wall ``walls[m]``,
then the other one moves while the wall holds it, which turns the difference D[m] into D[m+1]; D[0] is the start's and D[M] the
goal's. The unknowns are the contacts, as d-1 coordinates on their wall, and D[1] .. D[M-1]. On flat walls the length is convex in
them and so are the limits; on the circle a contact is an angle, and what is found is the best near the first guess.

A limit is a value that must be positive. The method minimizes ``sharpness * length - sum(log(limits))`` by Newton's method for ever
greater sharpness, so all that it returns lies strictly inside of all limits.
"""

from __future__ import annotations

import numpy as np

from shoal.steering.kernels.compiling import kernel
from shoal.steering.kernels.contact import dot

CONSTANT = 1e-13  # a limit whose gradient is smaller depends on no unknown
FORGIVEN = 1e-12  # such a limit holds if it is above minus this
GROWTH = 12.0
NEWTON = 40
BLUR = 0.03  # over the sharpness: how far a length is blurred where it vanishes


@kernel
def unknowns(cycles, d):
    return cycles * (d - 1) + (cycles - 1) * d


@kernel
def contacts_at(x, walls, frames, circle, d, c, jacobian, curve):
    """Write the contacts, their derivatives by their coordinates, and for the circle the second derivative by the angle."""
    flat = frames.shape[0]
    for m in range(walls.shape[0]):
        y = x[m * (d - 1) : (m + 1) * (d - 1)]
        curve[m, :] = 0.0
        if walls[m] < flat:
            frame = frames[walls[m]]
            for i in range(d):
                c[m, i] = frame[0, i]
                for k in range(d - 1):
                    c[m, i] += y[k] * frame[k + 1, i]
                    jacobian[m, k, i] = frame[k + 1, i]
        else:
            jacobian[m, :, :] = 0.0
            cosine, sine = np.cos(y[0] / circle[2]), np.sin(y[0] / circle[2])  # y is the length of the arc
            c[m, 0], c[m, 1] = circle[0] + circle[2] * cosine, circle[1] + circle[2] * sine
            jacobian[m, 0, 0], jacobian[m, 0, 1] = -sine, cosine
            curve[m, 0], curve[m, 1] = -cosine / circle[2], -sine / circle[2]
            if d == 3:
                c[m, 2] = y[1]
                jacobian[m, 1, 2] = 1.0


@kernel
def differences_at(x, cycles, d, before, after, delta):
    first = cycles * (d - 1)
    delta[0, :] = before
    delta[cycles, :] = after
    for m in range(1, cycles):
        for i in range(d):
            delta[m, i] = x[first + (m - 1) * d + i]


@kernel
def combine(cycles, d, one, a, other, b, left, p, right, q, c, jacobian, delta, vector, index, slope):
    """Add ``a c[one] + b c[other] + p delta[left] + q delta[right]`` to vector; write its derivatives; return of how many unknowns.

    A negative number leaves a term out.
    """
    used = 0
    for term in range(2):
        m, factor = (one, a) if term == 0 else (other, b)
        if m < 0:
            continue
        for i in range(d):
            vector[i] += factor * c[m, i]
        for k in range(d - 1):
            index[used] = m * (d - 1) + k
            for i in range(d):
                slope[used, i] = factor * jacobian[m, k, i]
            used += 1
    for term in range(2):
        m, factor = (left, p) if term == 0 else (right, q)
        if m < 0:
            continue
        for i in range(d):
            vector[i] += factor * delta[m, i]
        if 0 < m < cycles:
            for k in range(d):
                index[used] = cycles * (d - 1) + (m - 1) * d + k
                for i in range(d):
                    slope[used, i] = factor if i == k else 0.0
                used += 1
    return used


@kernel
def add_length(vector, used, index, slope, one, a, other, b, curve, d, blur, weight, order, gradient, hessian):
    """Add ``weight`` times the length of a vector, blurred where it vanishes, and its derivatives; return the value."""
    total = blur * blur
    for i in range(d):
        total += vector[i] * vector[i]
    length = np.sqrt(total)
    if order == 0:
        return weight * length
    for u in range(used):
        along = dot(vector, slope[u]) / length
        gradient[index[u]] += weight * along
        for v in range(used):
            other_along = dot(vector, slope[v]) / length
            hessian[index[u], index[v]] += weight * (dot(slope[u], slope[v]) - along * other_along) / length
    if one >= 0:
        hessian[one * (d - 1), one * (d - 1)] += weight * a * dot(vector, curve[one]) / length
    if other >= 0:
        hessian[other * (d - 1), other * (d - 1)] += weight * b * dot(vector, curve[other]) / length
    return weight * length


@kernel
def add_limit(value, used, index, first, second, curved, forgiven, slack, order, gradient, hessian):
    """Add ``-log(value + slack)``, where the slack is the last unknown unless it is NaN; infinite if that is not positive.

    ``second`` is only looked at if the value is ``curved``; where the value depends on no unknown, ``forgiven`` may be missing.
    """
    steep = 0.0
    for u in range(used):
        steep = max(steep, abs(first[u]))
    if steep <= CONSTANT:
        return 0.0 if value >= -FORGIVEN - forgiven else np.inf
    last = gradient.shape[0] - 1
    phase = not np.isnan(slack)
    total = value + slack if phase else value
    if not total > 0:
        return np.inf
    if order == 0:
        return -np.log(total)
    for u in range(used):
        gradient[index[u]] -= first[u] / total
        for v in range(used):
            bend = first[u] * first[v] / total
            if curved:
                bend -= second[u, v]
            hessian[index[u], index[v]] += bend / total
        if phase:
            hessian[index[u], last] += first[u] / total / total
            hessian[last, index[u]] += first[u] / total / total
    if phase:
        gradient[last] -= 1 / total
        hessian[last, last] += 1 / total / total
    return -np.log(total)


@kernel
def add_inside(
    vector,
    skipped,
    used,
    index,
    slope,
    first,
    second,
    one,
    curve,
    normals,
    offsets,
    circle,
    margin,
    forgiven,
    slack,
    order,
    gradient,
    hessian,
):
    """Add the limits of a point that must lie inside all walls but ``skipped`` by a margin."""
    d = vector.shape[0]
    total = 0.0
    for wall in range(normals.shape[0]):
        if wall == skipped:
            continue
        for u in range(used):
            first[u] = dot(normals[wall], slope[u])
        value = dot(normals[wall], vector) - offsets[wall] - margin
        total += add_limit(value, used, index, first, second, False, forgiven, slack, order, gradient, hessian)
        if total == np.inf:
            return total
    if circle[2] > 0 and skipped != normals.shape[0]:
        x, y = vector[0] - circle[0], vector[1] - circle[1]
        value = (circle[2] * circle[2] - x * x - y * y) / (2 * circle[2]) - margin
        for u in range(used):
            first[u] = -(x * slope[u, 0] + y * slope[u, 1]) / circle[2]
            for v in range(used):
                second[u, v] = -(slope[u, 0] * slope[v, 0] + slope[u, 1] * slope[v, 1]) / circle[2]
        for u in range(used):
            if index[u] == one * (d - 1):  # the contact enters with the factor 1
                second[u, u] -= (x * curve[one, 0] + y * curve[one, 1]) / circle[2]
        total += add_limit(value, used, index, first, second, True, forgiven, slack, order, gradient, hessian)
    return total


@kernel
def add_hold(
    m,
    toucher,
    wall,
    cycles,
    d,
    c,
    jacobian,
    delta,
    normals,
    circle,
    friction,
    push,
    vector,
    index,
    slope,
    first,
    second,
    slack,
    order,
    gradient,
    hessian,
):
    """Add the limits that the wall holds the toucher while D[m] becomes D[m+1]: pushed in, and inside of the friction cone."""
    vector[:] = 0.0
    sign = 1.0 if toucher == 0 else -1.0
    used = combine(cycles, d, -1, 0.0, -1, 0.0, m + 1, sign, m, -sign, c, jacobian, delta, vector, index, slope)
    outward, turned = np.zeros(d), np.zeros(d)
    round_wall = wall == normals.shape[0]
    if round_wall:
        for i in range(2):
            outward[i] = (c[m, i] - circle[i]) / circle[2]
            turned[i] = jacobian[m, 0, i] / circle[2]
    else:
        outward[:] = -normals[wall]
    into = dot(outward, vector)
    for u in range(used):
        first[u] = dot(outward, slope[u])
    if round_wall:
        index[used] = m * (d - 1)
        first[used] = dot(turned, vector)
        second[: used + 1, : used + 1] = 0.0
        for u in range(used):
            second[u, used] = dot(turned, slope[u])
            second[used, u] = second[u, used]
        second[used, used] = -into / circle[2] / circle[2]
        slope[used, :] = 0.0
        used += 1
    total = add_limit(into - push, used, index, first, second, round_wall, push, slack, order, gradient, hessian)
    if friction == np.inf or total == np.inf:
        return total
    # The cone |a|^2 <= (1 + friction^2) into^2, divided by a length to keep units: (1 + friction^2) into - |a|^2 / into.
    whole = 1 + friction * friction
    square, reach = dot(vector, vector), max(into, 1e-12)
    if not round_wall:
        second[:used, :used] = 0.0
    cone_first, cone_second = np.zeros(used), np.zeros((used, used))
    for u in range(used):
        cone_first[u] = whole * first[u] - 2 * dot(vector, slope[u]) / reach + square * first[u] / reach / reach
        for v in range(used):
            cone_second[u, v] = (
                whole * second[u, v]
                - 2 * dot(slope[u], slope[v]) / reach
                + 2 * (dot(vector, slope[u]) * first[v] + dot(vector, slope[v]) * first[u]) / reach / reach
                + square * second[u, v] / reach / reach
                - 2 * square * first[u] * first[v] / reach / reach / reach
            )
    value = whole * reach - square / reach if into > 0 or np.isnan(slack) else -square / reach
    return total + add_limit(value, used, index, cone_first, cone_second, True, 0.0, slack, order, gradient, hessian)


@kernel
def assess(
    x, slack, sharpness, touchers, walls, start, goal, frames, normals, offsets, circle, friction, margins, order, gradient, hessian
):
    """Return the blurred length times sharpness plus the barrier, and with ``order`` 1 the derivatives.

    ``margins`` is (of the other particle inside, of the push into the wall, of the blur). With a slack the length is left out and
    the slack, times sharpness, takes its place.
    """
    cycles, d = walls.shape[0], start.shape[1]
    gradient[:] = 0.0
    hessian[:, :] = 0.0
    c, jacobian, curve = np.empty((cycles, d)), np.empty((cycles, d - 1, d)), np.empty((cycles, d))
    delta = np.empty((cycles + 1, d))
    contacts_at(x, walls, frames, circle, d, c, jacobian, curve)
    differences_at(x, cycles, d, start[1] - start[0], goal[1] - goal[0], delta)
    size = 4 * d
    index, slope, vector = np.zeros(size, dtype=np.int64), np.zeros((size, d)), np.zeros(d)
    first, second = np.zeros(size), np.zeros((size, size))
    total = 0.0
    for m in range(cycles):
        sign = 1.0 if touchers[m] == 0 else -1.0
        for which in range(3):
            vector[:] = 0.0
            left = -1 if which == 0 else m + which - 1
            used = combine(cycles, d, m, 1.0, -1, 0.0, left, sign, -1, 0.0, c, jacobian, delta, vector, index, slope)
            skipped = walls[m] if which == 0 else -1
            # At the goal's difference the other particle may end on the toucher's wall, too: the next move lifts both.
            forgiven = margins[0] if which == 2 and m == cycles - 1 else 0.0
            total += add_inside(
                vector,
                skipped,
                used,
                index,
                slope,
                first,
                second,
                m,
                curve,
                normals,
                offsets,
                circle,
                margins[0],
                forgiven,
                slack,
                order,
                gradient,
                hessian,
            )
            if total == np.inf:
                return total
        total += add_hold(
            m,
            touchers[m],
            walls[m],
            cycles,
            d,
            c,
            jacobian,
            delta,
            normals,
            circle,
            friction,
            margins[1],
            vector,
            index,
            slope,
            first,
            second,
            slack,
            order,
            gradient,
            hessian,
        )
        if total == np.inf:
            return total
    if not np.isnan(slack):
        gradient[gradient.shape[0] - 1] += sharpness
        return total + sharpness * slack
    blur = margins[2]
    for m in range(cycles + 1):
        vector[:] = 0.0
        one, a, other, b, left, p = m, 1.0, m - 1, -1.0, -1, 0.0
        if m == 0:
            vector[:] = -start[touchers[0]]
        elif m == cycles:
            one, a, other, b = m - 1, -1.0, -1, 0.0
            vector[:] = goal[touchers[m - 1]]
        elif touchers[m] != touchers[m - 1]:
            left, p = m, (-1.0 if touchers[m - 1] == 0 else 1.0)
        used = combine(cycles, d, one, a, other, b, left, p, -1, 0.0, c, jacobian, delta, vector, index, slope)
        total += add_length(vector, used, index, slope, one, a, other, b, curve, d, blur, sharpness, order, gradient, hessian)
        if m < cycles:
            vector[:] = 0.0
            used = combine(cycles, d, -1, 0.0, -1, 0.0, m + 1, 1.0, m, -1.0, c, jacobian, delta, vector, index, slope)
            total += add_length(vector, used, index, slope, -1, 0.0, -1, 0.0, curve, d, blur, sharpness, order, gradient, hessian)
    return total


@kernel
def newton_direction(gradient, hessian, direction):
    """Solve ``hessian @ direction = -gradient`` by Cholesky, with the diagonal raised until that works; return the decrement."""
    n = gradient.shape[0]
    lower = np.empty((n, n))
    raised = 0.0
    for _attempt in range(60):
        done = True
        for i in range(n):
            for j in range(i + 1):
                value = hessian[i, j]
                if i == j:
                    value += raised * (1.0 + abs(hessian[i, i]))
                for k in range(j):
                    value -= lower[i, k] * lower[j, k]
                if i == j:
                    if not value > 1e-14 * abs(hessian[i, i]):
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
    for i in range(n):
        value = -gradient[i]
        for k in range(i):
            value -= lower[i, k] * direction[k]
        direction[i] = value / lower[i, i]
    for i in range(n - 1, -1, -1):
        value = direction[i]
        for k in range(i + 1, n):
            value -= lower[k, i] * direction[k]
        direction[i] = value / lower[i, i]
    return -dot(gradient, direction)


@kernel
def descend(x, phase, sharpness, touchers, walls, start, goal, frames, normals, offsets, circle, friction, margins, enough):
    """Newton's method from an allowed x, in place; with ``phase`` its last entry is the slack, and -enough will do."""
    n = x.shape[0]
    gradient, hessian = np.empty(n), np.empty((n, n))
    direction, tried = np.empty(n), np.empty(n)
    nothing = np.nan
    for _iteration in range(NEWTON):
        slack = x[n - 1] if phase else nothing
        value = assess(
            x,
            slack,
            sharpness,
            touchers,
            walls,
            start,
            goal,
            frames,
            normals,
            offsets,
            circle,
            friction,
            margins,
            1,
            gradient,
            hessian,
        )
        if value == np.inf or (phase and slack < -enough):
            return
        decrement = newton_direction(gradient, hessian, direction)
        if not decrement > 1e-7:
            return
        step = 1.0
        while True:
            for i in range(n):
                tried[i] = x[i] + step * direction[i]
            slack = tried[n - 1] if phase else nothing
            found = assess(
                tried,
                slack,
                sharpness,
                touchers,
                walls,
                start,
                goal,
                frames,
                normals,
                offsets,
                circle,
                friction,
                margins,
                0,
                gradient,
                hessian,
            )
            if found <= value - 1e-4 * step * decrement + 1e-13 * abs(value):
                break
            step *= 0.5
            if step < 1e-12:
                return
        x[:] = tried


@kernel
def worst_limit(x, touchers, walls, start, goal, frames, normals, offsets, circle, friction, margins):
    """Return a slack that makes all limits positive at x, -inf if some limit without unknowns fails, 0 if none is needed."""
    n = x.shape[0]
    gradient, hessian = np.empty(n + 1), np.empty((n + 1, n + 1))
    for tenth in range(-8, 5):
        slack = 0.0 if tenth == -8 else 10.0**tenth
        value = assess(
            x, slack, 0.0, touchers, walls, start, goal, frames, normals, offsets, circle, friction, margins, 0, gradient, hessian
        )
        if value < np.inf:
            return slack
    return -np.inf


@kernel
def settle(x, enough, sharpnesses, bound, touchers, walls, start, goal, frames, normals, offsets, circle, friction, margins):
    """Move x, in place, to where all limits hold, by ``enough`` if they can; then shorten the chain; return its length.

    Infinite if the limits cannot all hold, or if on flat walls the length cannot come below ``bound``. Each of ``sharpnesses`` is
    a round of Newton's method: the last one says how near to the limits the chain may go.
    """
    n = x.shape[0]
    limits = 3.0 * walls.shape[0] * (normals.shape[0] + 3)
    slack = worst_limit(x, touchers, walls, start, goal, frames, normals, offsets, circle, friction, margins)
    if slack == -np.inf:
        return np.inf
    phase = slack > 0
    wide = np.empty(n + 1)
    wide[:n] = x
    wide[n] = 1.5 * slack
    own = margins.copy()
    sharpness, done = 1.0 / max(slack, 1e-2), 0
    before = np.inf
    while True:
        if not phase:
            if done == sharpnesses.shape[0]:
                break
            sharpness = sharpnesses[done]
            own[2] = max(BLUR / sharpness, 1e-11)
        state = wide if phase else wide[:n]
        descend(state, phase, sharpness, touchers, walls, start, goal, frames, normals, offsets, circle, friction, own, enough)
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
        if circle[2] == 0:
            length = chain_length(wide, touchers, walls, start, goal, frames, circle)
            if length - (limits + 10 * BLUR) / sharpness > bound:
                return np.inf
    x[:] = wide[:n]
    return chain_length(x, touchers, walls, start, goal, frames, circle)


@kernel
def chain_length(x, touchers, walls, start, goal, frames, circle):
    """Return the length of a chain."""
    cycles, d = walls.shape[0], start.shape[1]
    c, jacobian, curve = np.empty((cycles, d)), np.empty((cycles, d - 1, d)), np.empty((cycles, d))
    delta = np.empty((cycles + 1, d))
    contacts_at(x, walls, frames, circle, d, c, jacobian, curve)
    differences_at(x, cycles, d, start[1] - start[0], goal[1] - goal[0], delta)
    here, total = start[touchers[0]].copy(), 0.0
    for m in range(cycles):
        if m > 0 and touchers[m] != touchers[m - 1]:
            for i in range(d):
                here[i] += delta[m, i] if touchers[m - 1] == 0 else -delta[m, i]
        for i in range(d):
            here[i] = c[m, i] - here[i]
        total += np.sqrt(dot(here, here))
        for i in range(d):
            here[i] = delta[m + 1, i] - delta[m, i]
        total += np.sqrt(dot(here, here))
        here[:] = c[m]
    for i in range(d):
        here[i] = goal[touchers[cycles - 1], i] - here[i]
    return total + np.sqrt(dot(here, here))
