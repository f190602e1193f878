"""What a chain of contacts is made of, and the limits and lengths that its sum adds up, with their derivatives.

A chain has cycles m = 0 .. M-1. In cycle m particle ``touchers[m]`` (0 or 1) is brought to the contact c[m] on wall ``walls[m]``,
then the other one moves while the wall holds it, which turns the difference D[m] into D[m+1]; D[0] is the start's and D[M] the
goal's. The unknowns are the contacts, as d-1 coordinates on their wall, and D[1] .. D[M-1].

A limit is a value that must be positive; what is added up is minus its logarithm.
"""

from __future__ import annotations

from collections import namedtuple

import numpy as np

from shoal.steering.kernels.compiling import inlined, kernel
from shoal.steering.kernels.contact import dot

CONSTANT = 1e-13  # a limit whose gradient is smaller depends on no unknown
FORGIVEN = 1e-12  # such a limit holds if it is above minus this

Shape = namedtuple("Shape", "frames normals offsets circle")
"""The walls: as in `shoal.steering.walls.Walls`."""

Kind = namedtuple("Kind", "touchers walls start goal shape friction margin push")
"""Which chains are meant: between which points, over which walls; how far the other particle keeps off them, and how far each
adjustment goes into its wall."""

Place = namedtuple("Place", "contacts jacobian curve delta")
"""A chain: its contacts, their first derivatives and on the circle the second by the angle, and its differences."""

Work = namedtuple("Work", "vector index slope outward turned first second gradient hessian")
"""A vector, on which unknowns it depends and how; out of a wall, and that turned; derivatives of a value, and those of the sum."""


@kernel
def new_place(cycles, d):
    return Place(np.empty((cycles, d)), np.empty((cycles, d - 1, d)), np.empty((cycles, d)), np.empty((cycles + 1, d)))


@kernel
def new_work(unknowns, d):
    size = 4 * d
    return Work(
        np.zeros(d),
        np.zeros(size, dtype=np.int64),
        np.zeros((size, d)),
        np.zeros(d),
        np.zeros(d),
        np.zeros(size),
        np.zeros((size, size)),
        np.zeros(unknowns),
        np.zeros((unknowns, unknowns)),
    )


@kernel
def put(x, kind, place):
    """Write the contacts and differences that x stands for."""
    cycles, d = place.contacts.shape
    flat, circle = kind.shape.frames.shape[0], kind.shape.circle
    for m in range(cycles):
        y = x[m * (d - 1) : (m + 1) * (d - 1)]
        place.curve[m, :] = 0.0
        if kind.walls[m] < flat:
            frame = kind.shape.frames[kind.walls[m]]
            for i in range(d):
                place.contacts[m, i] = frame[0, i]
                for k in range(d - 1):
                    place.contacts[m, i] += y[k] * frame[k + 1, i]
                    place.jacobian[m, k, i] = frame[k + 1, i]
        else:
            place.jacobian[m, :, :] = 0.0
            cosine, sine = np.cos(y[0] / circle[2]), np.sin(y[0] / circle[2])  # y is the length of the arc
            place.contacts[m, 0], place.contacts[m, 1] = circle[0] + circle[2] * cosine, circle[1] + circle[2] * sine
            place.jacobian[m, 0, 0], place.jacobian[m, 0, 1] = -sine, cosine
            place.curve[m, 0], place.curve[m, 1] = -cosine / circle[2], -sine / circle[2]
            if d == 3:
                place.contacts[m, 2] = y[1]
                place.jacobian[m, 1, 2] = 1.0
    for i in range(d):
        place.delta[0, i] = kind.start[1, i] - kind.start[0, i]
        place.delta[cycles, i] = kind.goal[1, i] - kind.goal[0, i]
        for m in range(1, cycles):
            place.delta[m, i] = x[cycles * (d - 1) + (m - 1) * d + i]


@inlined
def combine(place, work, one, a, other, b, left, p, right, q):
    """Add ``a c[one] + b c[other] + p D[left] + q D[right]`` to the vector; write its derivatives; return of how many unknowns.

    A negative number leaves a term out.
    """
    cycles, d = place.contacts.shape
    used = 0
    for term in range(2):
        m, factor = (one, a) if term == 0 else (other, b)
        if m < 0:
            continue
        for i in range(d):
            work.vector[i] += factor * place.contacts[m, i]
        for k in range(d - 1):
            work.index[used] = m * (d - 1) + k
            for i in range(d):
                work.slope[used, i] = factor * place.jacobian[m, k, i]
            used += 1
    for term in range(2):
        m, factor = (left, p) if term == 0 else (right, q)
        if m < 0:
            continue
        for i in range(d):
            work.vector[i] += factor * place.delta[m, i]
        if 0 < m < cycles:
            for k in range(d):
                work.index[used] = cycles * (d - 1) + (m - 1) * d + k
                for i in range(d):
                    work.slope[used, i] = factor if i == k else 0.0
                used += 1
    return used


@inlined
def add_length(place, work, used, one, a, other, b, blur, weight, order):
    """Add ``weight`` times the length of the vector, blurred where it vanishes, and its derivatives; return the value."""
    vector, slope = work.vector, work.slope
    d = vector.shape[0]
    length = np.sqrt(blur * blur + dot(vector, vector))
    if order == 0:
        return weight * length
    for u in range(used):
        along = dot(vector, slope[u]) / length
        work.gradient[work.index[u]] += weight * along
        for v in range(used):
            other_along = dot(vector, slope[v]) / length
            work.hessian[work.index[u], work.index[v]] += weight * (dot(slope[u], slope[v]) - along * other_along) / length
    for m, factor in ((one, a), (other, b)):
        if m >= 0:
            work.hessian[m * (d - 1), m * (d - 1)] += weight * factor * dot(vector, place.curve[m]) / length
    return weight * length


@inlined
def add_limit(work, value, first, second, used, curved, forgiven, slack, order):
    """Add ``-log(value + slack)``, where the slack is the last unknown unless it is NaN; infinite if that is not positive.

    ``second`` is only looked at if the value is ``curved``; where the value depends on no unknown, ``forgiven`` may be missing.
    """
    steep = 0.0
    for u in range(used):
        steep = max(steep, abs(first[u]))
    if steep <= CONSTANT:
        return 0.0 if value >= -FORGIVEN - forgiven else np.inf
    last = work.gradient.shape[0] - 1
    phase = not np.isnan(slack)
    total = value + slack if phase else value
    if not total > 0:
        return np.inf
    if order == 0:
        return -np.log(total)
    gradient, hessian = work.gradient, work.hessian
    for u in range(used):
        i = work.index[u]
        gradient[i] -= first[u] / total
        for v in range(used):
            bend = first[u] * first[v] / total
            if curved:
                bend -= second[u, v]
            hessian[i, work.index[v]] += bend / total
        if phase:
            hessian[i, last] += first[u] / total / total
            hessian[last, i] += first[u] / total / total
    if phase:
        gradient[last] -= 1 / total
        hessian[last, last] += 1 / total / total
    return -np.log(total)


@inlined
def add_inside(kind, place, work, used, skipped, one, forgiven, slack, order):
    """Add the limits of a point, the vector, that must lie inside all walls but ``skipped`` by the margin; c[one] is part of it."""
    normals, circle = kind.shape.normals, kind.shape.circle
    first, second, slope = work.first, work.second, work.slope
    total = 0.0
    for wall in range(normals.shape[0]):
        if wall == skipped:
            continue
        for u in range(used):
            first[u] = dot(normals[wall], slope[u])
        value = dot(normals[wall], work.vector) - kind.shape.offsets[wall] - kind.margin
        total += add_limit(work, value, first, second, used, False, forgiven, slack, order)
        if total == np.inf:
            return total
    if circle[2] > 0 and skipped != normals.shape[0]:
        x, y = work.vector[0] - circle[0], work.vector[1] - circle[1]
        value = (circle[2] * circle[2] - x * x - y * y) / (2 * circle[2]) - kind.margin
        for u in range(used):
            first[u] = -(x * slope[u, 0] + y * slope[u, 1]) / circle[2]
            for v in range(used):
                second[u, v] = -(slope[u, 0] * slope[v, 0] + slope[u, 1] * slope[v, 1]) / circle[2]
        for u in range(used):
            if work.index[u] == one * (work.vector.shape[0] - 1):  # the contact enters with the factor 1
                second[u, u] -= (x * place.curve[one, 0] + y * place.curve[one, 1]) / circle[2]
        total += add_limit(work, value, first, second, used, True, forgiven, slack, order)
    return total


@inlined
def add_hold(kind, place, work, m, slack, order):
    """Add the limits that the wall holds the toucher while D[m] becomes D[m+1]: pushed in, and inside of the friction cone."""
    d, wall, circle = place.contacts.shape[1], kind.walls[m], kind.shape.circle
    vector, slope, first, second = work.vector, work.slope, work.first, work.second
    vector[:] = 0.0
    sign = 1.0 if kind.touchers[m] == 0 else -1.0
    used = combine(place, work, -1, 0.0, -1, 0.0, m + 1, sign, m, -sign)
    outward, turned = work.outward, work.turned
    on_circle = wall == kind.shape.normals.shape[0]
    if on_circle:
        outward[d - 1] = turned[d - 1] = 0.0
        for i in range(2):
            outward[i] = (place.contacts[m, i] - circle[i]) / circle[2]
            turned[i] = place.jacobian[m, 0, i] / circle[2]
    else:
        for i in range(d):
            outward[i] = -kind.shape.normals[wall, i]
    into = dot(outward, vector)
    for u in range(used):
        first[u] = dot(outward, slope[u])
    if on_circle or kind.friction < np.inf:
        second[: used + 1, : used + 1] = 0.0
    if on_circle:
        work.index[used] = m * (d - 1)
        first[used] = dot(turned, vector)
        for u in range(used):
            second[u, used] = dot(turned, slope[u])
            second[used, u] = second[u, used]
        second[used, used] = -into / circle[2] / circle[2]
        slope[used, :] = 0.0
        used += 1
    total = add_limit(work, into - kind.push, first, second, used, on_circle, kind.push, slack, order)
    if kind.friction == np.inf or total == np.inf:
        return total
    return total + add_cone(kind.friction, into, work, used, slack, order)


@kernel
def add_cone(friction, into, work, used, slack, order):
    """Add the limit that the vector a lies in the cone |a|^2 <= (1 + friction^2) into^2, ``first`` and ``second`` are into's.

    Divided by a length, to keep units: (1 + friction^2) into - |a|^2 / into.
    """
    vector, slope, first, second = work.vector, work.slope, work.first, work.second
    whole = 1 + friction * friction
    square, reach = dot(vector, vector), max(into, 1e-12)
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
    return add_limit(work, value, cone_first, cone_second, used, True, 0.0, slack, order)
