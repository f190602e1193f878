"""The shortest chain of contacts of one kind, by an interior-point method in compiled code.

A chain of k cycles has the unknowns

    x = (y_0, ..., y_{k-1}, Δ_1, ..., Δ_{k-1}),

where y_m are the d - 1 coordinates of contact m on its wall, and Δ_m is the position difference
(particle 2 minus particle 1) before cycle m. Δ_0 and Δ_k are those of the starts and of the goals.
The contacts are c_m = c_m(y_m). While the toucher of cycle m is at c_m, the other particle moves
from c_m + σ Δ_m to c_m + σ Δ_{m+1}, with σ = 1 if particle 1 touches, and σ = -1 if particle 2
does.

The chain is the minimum of the sum of the lengths l_i(x) of its moves, with limits g_j(x) >= 0:
both particles stay inside all walls, and each adjustment pushes into the wall, inside the cone of
friction (paper W, section V, one cycle; more cycles and friction are additions by Shoal). Every
round minimizes, by Newton's method,

    F(x) = t sum_i l_i(x) - sum_j log g_j(x)                                    (shortening)
    F(x, s) = t s - sum_j log(g_j(x) + s)                                       (phase I)

for a larger sharpness t than the round before. Phase I finds a first chain inside the limits (Boyd
and Vandenberghe, Convex Optimization, sections 11.2 to 11.4).
"""

from __future__ import annotations

from math import cos, inf, isnan, log, nan, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel

CONSTANT = 1e-13  # a limit with a smaller gradient counts as constant: it depends on no unknown
FORGIVEN = 1e-12  # a constant limit is satisfied if its value is at least minus this number
TINY = 1e-200  # smallest product of limits for which the code delays the logarithm
GROWTH = 12.0  # factor from the sharpness of one round of phase I to that of the next
NEWTON = 40  # maximum number of Newton steps of a round
NEAR = 1e-2  # divided by the sharpness: excess over the minimum length at the end of a round
BLUR = 0.03  # divided by the sharpness: smallest value of a smoothed length


class Shape(NamedTuple):
    """The walls, as in `shoal.steering.workspaces.walls.NormalizedWalls`."""

    frames: NDArray[np.float64]  # (walls, d, d): midpoint and d - 1 unit vectors of each flat wall
    normals: NDArray[np.float64]  # (walls, d): inward
    offsets: NDArray[np.float64]  # (walls,): inside, normals @ p >= offsets
    circle: NDArray[np.float64]  # (3,): x, y, radius; the radius is 0 without a round wall
    near: NDArray[np.bool_]  # (walls + 1, walls): whether a wall may limit contacts of another


class ChainKind(NamedTuple):
    """The constants of a chain. The index of the round wall is the number of flat walls."""

    touchers: NDArray[np.int64]  # (cycles,): 0 or 1
    walls: NDArray[np.int64]  # (cycles,)
    start: NDArray[np.float64]  # (2, d)
    goal: NDArray[np.float64]  # (2, d)
    shape: Shape
    friction: float
    margin: float  # least distance of the other particle (not the toucher) from walls
    push: float  # least component of an adjustment into a wall


class Work(NamedTuple):
    """Working memory, for n unknowns of which a single limit depends on at most 4 d."""

    contacts: NDArray[np.float64]
    """(cycles, d + 1, d): c_m, its derivatives by the d - 1 coordinates y_m, and on the round wall
    its second derivative by the arc."""
    delta: NDArray[np.float64]  # (cycles + 1, d): Δ_m
    span: NDArray[np.float64]
    """(1 + 4 d, d): a vector v, and its derivatives J_u = ∂v/∂x_u by some unknowns x_u."""
    unknowns: NDArray[np.int64]  # (4 d,): indices of these unknowns
    first: NDArray[np.float64]  # (4 d,): derivatives g_u of a limit
    second: NDArray[np.float64]  # (4 d, 4 d): second derivatives g_uw of a limit
    cone_first: NDArray[np.float64]  # the same of the limit of friction
    cone_second: NDArray[np.float64]
    sums: NDArray[np.float64]  # (2 + d, d): sums over walls of N / g, N / g^2 and N N^T / g^2
    derivatives: NDArray[np.float64]  # (n + 2, n + 1): Hessian of F; the last row is its gradient
    lower: NDArray[np.float64]  # (n + 1, n + 1): Cholesky factor of the Hessian
    direction: NDArray[np.float64]  # (n + 1,): Newton step
    trial: NDArray[np.float64]  # (n + 1,): unknowns and slack after a step
    current: NDArray[np.float64]  # (n + 1,): unknowns and slack


class LinearSum(NamedTuple):
    """The vector a c_i + b c_j + p Δ_k + q Δ_l. An index of -1 omits its term."""

    i: int
    a: float
    j: int
    b: float
    k: int
    p: float
    l: int  # noqa: E741
    q: float


def new_work(cycles: int, d: int) -> Work:
    """Return working memory for a chain of ``cycles`` cycles in ``d`` dimensions."""
    few, n = 4 * d, cycles * (2 * d - 1) - d
    return Work(
        contacts=np.zeros((cycles, d + 1, d)),
        delta=np.zeros((cycles + 1, d)),
        span=np.zeros((1 + few, d)),
        unknowns=np.zeros(few, dtype=np.int64),
        first=np.zeros(few),
        second=np.zeros((few, few)),
        cone_first=np.zeros(few),
        cone_second=np.zeros((few, few)),
        sums=np.zeros((2 + d, d)),
        derivatives=np.zeros((n + 2, n + 1)),
        lower=np.zeros((n + 1, n + 1)),
        direction=np.zeros(n + 1),
        trial=np.zeros(n + 1),
        current=np.zeros(n + 1),
    )


@in_place_kernel
def shorten_chain(x, enough, sharpnesses, bound, kind, work):
    """Change the unknowns x of a chain in place until they satisfy all limits, then shorten the
    chain. Return its length.

    Before the kernel shortens the chain, all limits are at least ``enough``, if possible. The
    length is infinite if no chain satisfies all limits, and on flat walls also if no chain is
    shorter than ``bound``. Each entry of ``sharpnesses`` is the sharpness for one round of Newton's
    method. The last entry of ``sharpnesses`` determines how close to its limits the chain may come.
    """
    n, current = x.shape[0], work.current
    # With m limits, the minimum of a round is at most m / t above that of the problem without
    # barrier (Boyd and Vandenberghe, 11.2.2). The root is for a round that ends near its minimum.
    limits = count_limits(kind)
    limits += sqrt(limits)
    slack = worst_limit(x, kind, work)
    if slack == -inf:
        return inf
    phase = slack > 0
    for i in range(n):
        current[i] = x[i]
    current[n] = 1.5 * slack
    sharpness, completed, blur = 1.0 / max(slack, 1e-2), 0, 0.0
    before = inf
    while True:
        if not phase:
            if completed == sharpnesses.shape[0]:
                break
            sharpness = sharpnesses[completed]
            blur = max(BLUR / sharpness, 1e-11)
        minimize(phase, sharpness, blur, kind, work, enough)
        if phase:
            slack = current[n]
            if slack < -enough or (slack < 0 and before < 0 and slack > 1.2 * before):
                phase = False
            elif slack > limits / sharpness or sharpness > 1e13:  # no slack below 0 is possible
                if slack >= 0:
                    return inf
                phase = False
            before = slack
            sharpness *= GROWTH
            continue
        completed += 1
        if (
            kind.shape.circle[2] == 0
            and chain_length(current, kind, work) - (limits + 10 * BLUR) / sharpness > bound
        ):
            return inf
    for i in range(n):
        x[i] = current[i]
    return chain_length(x, kind, work)


@in_place_kernel
def chain_length(x, kind, work):
    """Return the length of the chain with the unknowns x."""
    place_chain(x, kind, work)
    return add_lengths(kind, work, 1.0, 0.0, 0)


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
        for other_wall in range(flat):
            total += 1 if kind.shape.near[wall, other_wall] else 0
    return float(total)


@in_place_kernel
def worst_limit(x, kind, work):
    """Return a slack for the chain with the unknowns x: a number that, added to each limit, makes
    all limits positive.

    The slack is 0 if the chain satisfies all limits, and -inf if the chain violates a limit that
    depends on no unknown.
    """
    for tenth in range(-8, 5):
        slack = 0.0 if tenth == -8 else 10.0**tenth
        if objective(x, slack, 0.0, 0.0, kind, work, 0) < inf:
            return slack
    return -inf


@in_place_kernel
def minimize(phase, sharpness, blur, kind, work, enough):
    """Improve the chain in ``work.current`` in place by Newton's method. At the start, the chain
    must satisfy all limits.

    If ``phase`` is true, the last entry of ``work.current`` is the slack. The method then reduces
    the slack, and ends when the slack is below ``-enough``. If ``phase`` is false, the method
    reduces the length of the chain, and ends when a step would shorten the chain by less than about
    ``NEAR / sharpness``.
    """
    x, trial, direction = work.current, work.trial, work.direction
    last = x.shape[0] - 1
    n = last + 1 if phase else last
    for _iteration in range(NEWTON):
        value = objective(x, x[last] if phase else nan, sharpness, blur, kind, work, 1)
        if value == inf or (phase and x[last] < -enough):
            return
        decrement = newton_direction(work.derivatives, work.lower, direction, n)
        if not decrement > NEAR:
            return
        step = 1.0  # backtracking (Armijo): F(x + step p) <= F(x) - 1e-4 step (-∇F·p)
        while True:
            for i in range(n):
                trial[i] = x[i] + step * direction[i]
            after = objective(trial, trial[last] if phase else nan, sharpness, blur, kind, work, 0)
            if after <= value - 1e-4 * step * decrement + 1e-13 * abs(value):
                break
            step *= 0.5
            if step < 1e-12:
                return
        for i in range(n):
            x[i] = trial[i]


@in_place_kernel
def newton_direction(derivatives, lower, direction, n):
    """Solve H p = -∇F for the Newton step p. Return the decrement -∇F·p = p^T H p.

    The Cholesky factor L of H = L L^T has

        L_ii = sqrt(H_ii - sum_{k<i} L_ik^2),   L_ij = (H_ij - sum_{k<j} L_ik L_jk) / L_jj.

    If H is not positive definite, the function increases its diagonal until the decomposition
    succeeds. The function computes ``direction`` only for the first ``n`` unknowns. The last row of
    ``derivatives`` is the gradient, and the other rows are the Hessian.
    """
    last = derivatives.shape[1]
    raised = 0.0
    for _attempt in range(60):
        succeeded = True
        for i in range(n):
            for j in range(i + 1):
                value = derivatives[i, j]
                if i == j:
                    value += raised * (1.0 + abs(derivatives[i, i]))
                for k in range(j):
                    value -= lower[i, k] * lower[j, k]
                if i == j:
                    if not value > 1e-14 * abs(derivatives[i, i]):
                        succeeded = False
                        break
                    lower[i, i] = sqrt(value)
                else:
                    lower[i, j] = value / lower[j, j]
            if not succeeded:
                break
        if succeeded:
            break
        raised = 1e-10 if raised == 0.0 else raised * 10
    decrement = 0.0
    for i in range(n):  # L q = -∇F
        value = -derivatives[last, i]
        for k in range(i):
            value -= lower[i, k] * direction[k]
        direction[i] = value / lower[i, i]
    for i in range(n - 1, -1, -1):  # L^T p = q
        value = direction[i]
        for k in range(i + 1, n):
            value -= lower[k, i] * direction[k]
        direction[i] = value / lower[i, i]
        decrement -= derivatives[last, i] * direction[i]
    return decrement


@in_place_kernel
def objective(x, slack, sharpness, blur, kind, work, order):
    """Return F(x), or F(x, s) for the slack s if ``slack`` is not NaN. With ``order`` 1, write the
    derivatives of F to ``work.derivatives``.

    A limit that depends on no unknown gets no slack.
    """
    derivatives = work.derivatives
    if order > 0:
        for i in range(derivatives.shape[0]):
            for k in range(derivatives.shape[1]):
                derivatives[i, k] = 0.0
    place_chain(x, kind, work)
    total = add_limits(kind, work, slack, order)
    if total == inf:
        return total
    if isnan(slack):
        return total + add_lengths(kind, work, sharpness, blur, order)
    if order > 0:  # ∂(t s)/∂s = t
        n = derivatives.shape[1]
        derivatives[n, n - 1] += sharpness
    return total + sharpness * slack


@in_place_kernel
def place_chain(x, kind, work):
    """Write to ``work`` the contacts and position differences of the chain that has the
    unknowns x.
    """
    contacts, delta = work.contacts, work.delta
    frames, circle = kind.shape.frames, kind.shape.circle
    cycles, d = contacts.shape[0], contacts.shape[2]
    for m in range(cycles):
        wall, y = kind.walls[m], m * (d - 1)
        if wall < frames.shape[0]:  # c = frame_0 + sum_k y_k frame_k
            for i in range(d):
                contacts[m, 0, i] = frames[wall, 0, i]
                contacts[m, d, i] = 0.0
                for k in range(1, d):
                    contacts[m, 0, i] += x[y + k - 1] * frames[wall, k, i]
                    contacts[m, k, i] = frames[wall, k, i]
        else:  # c = z + r (cos(y/r), sin(y/r)), with the arc y, the centre z and the radius r
            cosine, sine = cos(x[y] / circle[2]), sin(x[y] / circle[2])
            contacts[m, 0, 0] = circle[0] + circle[2] * cosine
            contacts[m, 0, 1] = circle[1] + circle[2] * sine
            contacts[m, 1, 0], contacts[m, 1, 1] = -sine, cosine  # ∂c/∂y
            contacts[m, d, 0], contacts[m, d, 1] = -cosine / circle[2], -sine / circle[2]  # ∂²c/∂y²
            if d == 3:  # the other coordinate is the height
                contacts[m, 0, 2] = x[y + 1]
                contacts[m, 1, 2] = contacts[m, 2, 0] = contacts[m, 2, 1] = contacts[m, d, 2] = 0.0
                contacts[m, 2, 2] = 1.0
    for i in range(d):
        delta[0, i] = kind.start[1, i] - kind.start[0, i]
        delta[cycles, i] = kind.goal[1, i] - kind.goal[0, i]
        for m in range(1, cycles):
            delta[m, i] = x[cycles * (d - 1) + (m - 1) * d + i]


@in_place_kernel
def set_vector(work, points, row, factor):
    """Set the vector ``work.span[0]`` to ``factor`` times a row of ``points``."""
    for i in range(work.span.shape[1]):
        work.span[0, i] = factor * points[row, i]


@in_place_kernel
def add_terms(work, terms):
    """Add a `LinearSum` to the vector v = ``work.span[0]``, and write its derivatives J_u to the
    rows below.

    Return the number of unknowns on which v depends.
    """
    contacts, delta, span, index = work.contacts, work.delta, work.span, work.unknowns
    cycles, d = contacts.shape[0], contacts.shape[2]
    used = 0
    for term in range(2):
        m, factor = (terms.i, terms.a) if term == 0 else (terms.j, terms.b)
        if m < 0:
            continue
        for i in range(d):
            span[0, i] += factor * contacts[m, 0, i]
        for k in range(1, d):  # J = a ∂c/∂y_k
            index[used] = m * (d - 1) + k - 1
            used += 1
            for i in range(d):
                span[used, i] = factor * contacts[m, k, i]
    for term in range(2):
        m, factor = (terms.k, terms.p) if term == 0 else (terms.l, terms.q)
        if m < 0:
            continue
        for i in range(d):
            span[0, i] += factor * delta[m, i]
        if 0 < m < cycles:  # J = p I; Δ_0 and Δ_k are constants
            for k in range(d):
                index[used] = cycles * (d - 1) + (m - 1) * d + k
                used += 1
                for i in range(d):
                    span[used, i] = factor if i == k else 0.0
    return used


@in_place_kernel
def rows_dot(u, i, v, k):
    total = 0.0
    for j in range(u.shape[1]):
        total += u[i, j] * v[k, j]
    return total


@in_place_kernel
def add_lengths(kind, work, sharpness, blur, order):
    """Return the sum of the lengths of all moves of a chain, multiplied by ``sharpness``.

    With ``order`` 1, add the derivatives of the sum to ``work.derivatives``.
    """
    touchers, cycles, total = kind.touchers, kind.walls.shape[0], 0.0
    for m in range(cycles + 1):
        # The move to contact m: c_m - c_{m-1}, minus σ Δ_m if the particles change roles. The first
        # move begins at the start, and the last one ends at the goal of the last toucher.
        set_vector(work, kind.start, touchers[0], -1.0 if m == 0 else 0.0)
        i, a, j, b, k, p = m, 1.0, m - 1, -1.0, -1, 0.0
        if m == cycles:
            i, a, j, b = m - 1, -1.0, -1, 0.0
            set_vector(work, kind.goal, touchers[m - 1], 1.0)
        elif m > 0 and touchers[m] != touchers[m - 1]:
            k, p = m, (-1.0 if touchers[m - 1] == 0 else 1.0)
        total += add_length(work, LinearSum(i, a, j, b, k, p, -1, 0.0), blur, sharpness, order)
        if m < cycles:  # the adjustment: Δ_{m+1} - Δ_m
            set_vector(work, work.delta, m, 0.0)
            adjustment = LinearSum(-1, 0.0, -1, 0.0, m + 1, 1.0, m, -1.0)
            total += add_length(work, adjustment, blur, sharpness, order)
    return total


@in_place_kernel
def add_length(work, terms, blur, weight, order):
    """Add ``terms`` to the vector v = ``work.span[0]``. Return ``weight`` times the smoothed length
    l = sqrt(blur^2 + |v|^2). With ``order`` 1, update ``work.derivatives``.

    l_u = v·J_u / l
    l_uw = (J_u·J_w - l_u l_w + v·∂²v/∂x_u∂x_w) / l

    The last term is not 0 only if u = w is the arc of a contact on the round wall.
    """
    used = add_terms(work, terms)
    span, index, first = work.span, work.unknowns, work.first
    derivatives, contacts = work.derivatives, work.contacts
    length = sqrt(blur * blur + rows_dot(span, 0, span, 0))
    if order == 0:
        return weight * length
    n, d = derivatives.shape[1], span.shape[1]
    for u in range(used):
        first[u] = rows_dot(span, 0, span, 1 + u) / length
    for u in range(used):
        derivatives[n, index[u]] += weight * first[u]
        for w in range(used):
            derivatives[index[u], index[w]] += (
                weight * (rows_dot(span, 1 + u, span, 1 + w) - first[u] * first[w]) / length
            )
    for term in range(2):
        m, factor = (terms.i, terms.a) if term == 0 else (terms.j, terms.b)
        if m >= 0:
            bend = 0.0
            for i in range(d):
                bend += span[0, i] * contacts[m, d, i]
            derivatives[m * (d - 1), m * (d - 1)] += weight * factor * bend / length
    return weight * length


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
        # The toucher at c_m, then the other particle before and after the adjustment, at
        # c_m + σ Δ_m and c_m + σ Δ_{m+1}.
        for which in range(3):
            set_vector(work, work.delta, m, 0.0)
            k = -1 if which == 0 else m + which - 1
            used = add_terms(work, LinearSum(m, 1.0, -1, 0.0, k, sign, -1, 0.0))
            skipped = walls[m] if which == 0 else -1
            # In the last cycle, the other particle may end on the toucher's wall, because the next
            # move lifts both particles off.
            forgiven = kind.margin if which == 2 and m == cycles - 1 else 0.0
            total += add_flat_walls(kind, work, used, skipped, forgiven, slack, order)
            if total < inf and kind.shape.circle[2] > 0 and skipped != flat:
                total += add_round_wall(kind, work, used, m, forgiven, slack, order)
            if total == inf:
                return total
        total += add_adjustment(kind, work, m, sign, slack, order)
        if total == inf:
            return total
    return total


@in_place_kernel
def add_limit(work, first, second, value, used, curved, forgiven, slack, order):
    """Return -log(g + s) for a limit with the value g and the slack s, or infinity if this
    logarithm is undefined. With ``order`` 1, update ``work.derivatives``.

    ∂/∂x_u = -g_u / (g+s)           ∂²/∂x_u∂x_w = g_u g_w / (g+s)² - g_uw / (g+s)
    ∂/∂s = -1 / (g+s)               ∂²/∂x_u∂s = g_u / (g+s)²        ∂²/∂s² = 1 / (g+s)²

    If ``slack`` is NaN, s is 0; otherwise, s is the last unknown. Without ``curved``, g_uw is 0. If
    g depends on no unknown, the result is 0 if g is at least about ``-forgiven``, else infinity.
    """
    index, derivatives = work.unknowns, work.derivatives
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
        for w in range(used):
            bend = first[u] * first[w] / total
            if curved:
                bend -= second[u, w]
            derivatives[i, index[w]] += bend / total
        if phase:
            derivatives[i, last] += first[u] / total / total
            derivatives[last, i] += first[u] / total / total
    if phase:
        derivatives[n, last] -= 1 / total
        derivatives[last, last] += 1 / total / total
    return -log(total)


@in_place_kernel
def add_flat_walls(kind, work, used, skipped, forgiven, slack, order):
    """Return the sum of -log g over the flat walls, with the distances g = N·v - offset - margin of
    the point v = ``work.span[0]`` from the walls, margin apart.

    If ``skipped`` is not negative, the sum contains only the walls near the wall with the index
    ``skipped``. The code collects sum N / g and sum N N^T / g^2 over the walls, because the
    derivatives by x_u follow from them by the chain rule only once; see `add_through`.
    """
    normals, offsets = kind.shape.normals, kind.shape.offsets
    span, sums = work.span, work.sums
    d, phase = span.shape[1], not isnan(slack)
    total, product, ones, squares = 0.0, 1.0, 0.0, 0.0
    for i in range(2 + d):
        for k in range(d):
            sums[i, k] = 0.0
    for wall in range(normals.shape[0]):
        if skipped >= 0 and not kind.shape.near[skipped, wall]:
            continue
        value = rows_dot(normals, wall, span, 0) - offsets[wall] - kind.margin
        # with an unknown difference (used >= d), no limit is constant
        if used < d and is_constant(normals, wall, span, used):
            if value < -FORGIVEN - forgiven:
                return inf
            continue
        if phase:
            value += slack
        if not value > 0:
            return inf
        product *= value  # one logarithm of a product instead of many
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
    """Add the derivatives of -sum log(g + s) over flat walls to ``work.derivatives``, from the sums
    over walls in ``work.sums``.

    ∂/∂x_u = -(sum N / g)·J_u            ∂²/∂x_u∂x_w = J_u·(sum N N^T / g²) J_w
    ∂/∂s = -sum 1 / g  (``ones``)        ∂²/∂x_u∂s = (sum N / g²)·J_u
    ∂²/∂s² = sum 1 / g²  (``squares``)
    """
    span, index, sums, derivatives = work.span, work.unknowns, work.sums, work.derivatives
    n, d = derivatives.shape[1], span.shape[1]
    last = n - 1
    for u in range(used):
        at = index[u]
        derivatives[n, at] -= rows_dot(sums, 0, span, 1 + u)
        for w in range(used):
            value = 0.0
            for i in range(d):
                value += span[1 + u, i] * rows_dot(sums, 2 + i, span, 1 + w)
            derivatives[at, index[w]] += value
        if phase:
            mixed = rows_dot(sums, 1, span, 1 + u)
            derivatives[at, last] += mixed
            derivatives[last, at] += mixed
    if phase:
        derivatives[n, last] -= ones
        derivatives[last, last] += squares


@in_place_kernel
def add_round_wall(kind, work, used, m, forgiven, slack, order):
    """Return -log g for the limit that keeps the point v = ``work.span[0]`` inside the circle with
    the centre z and the radius r, with a margin.

    g = (r² - |v-z|²) / (2 r) - margin, about the distance from the wall
    g_u = -(v-z)·J_u / r
    g_uw = -J_u·J_w / r - (v-z)·∂²v/∂x_u∂x_w / r

    Only x and y count. The last term is not 0 only if u = w is the arc of contact m, which v
    contains with the factor 1.
    """
    contacts, circle, span = work.contacts, kind.shape.circle, work.span
    first, second, d = work.first, work.second, span.shape[1]
    x, y = span[0, 0] - circle[0], span[0, 1] - circle[1]
    value = (circle[2] * circle[2] - x * x - y * y) / (2 * circle[2]) - kind.margin
    for u in range(used):
        first[u] = -(x * span[1 + u, 0] + y * span[1 + u, 1]) / circle[2]
        for w in range(used):
            second[u, w] = (
                -(span[1 + u, 0] * span[1 + w, 0] + span[1 + u, 1] * span[1 + w, 1]) / circle[2]
            )
        if work.unknowns[u] == m * (d - 1):
            second[u, u] -= (x * contacts[m, d, 0] + y * contacts[m, d, 1]) / circle[2]
    return add_limit(work, first, second, value, used, True, forgiven, slack, order)


@in_place_kernel
def add_adjustment(kind, work, m, sign, slack, order):
    """Return the summed negative logarithms of two limits of the adjustment a = σ (Δ_{m+1} - Δ_m)
    of cycle m: the least push into the wall, and the friction cone.

    On a flat wall with the inward normal N, the push is p = -N·a, and p_u = -N·J_u. On the round
    wall, the outward normal (c-z)/r turns with the arc y of the contact:

        p = (c-z)·a / r                 p_u = (c-z)·J_u / r
        p_y = c'·a / r                  p_uy = c'·J_u / r
        p_yy = c''·a / r = -p / r², because c'' = -(c-z) / r²

    The limit of the push is g = p - push.
    """
    contacts, circle, span = work.contacts, kind.shape.circle, work.span
    first, second, index = work.first, work.second, work.unknowns
    d, push, on_circle = span.shape[1], kind.push, kind.walls[m] == kind.shape.normals.shape[0]
    set_vector(work, work.delta, m, 0.0)
    used = add_terms(work, LinearSum(-1, 0.0, -1, 0.0, m + 1, sign, m, -sign))
    into = outward(kind, work, m, 0)
    for u in range(used):
        first[u] = outward(kind, work, m, 1 + u)
        for w in range(used):
            second[u, w] = 0.0
    if on_circle:
        index[used] = m * (d - 1)
        first[used] = span[0, 0] * contacts[m, 1, 0] + span[0, 1] * contacts[m, 1, 1]
        first[used] /= circle[2]
        for u in range(used):
            second[u, used] = (
                span[1 + u, 0] * contacts[m, 1, 0] + span[1 + u, 1] * contacts[m, 1, 1]
            ) / circle[2]
            second[used, u] = second[u, used]
        second[used, used] = -into / circle[2] / circle[2]
        for i in range(d):  # the adjustment itself does not depend on the contact
            span[1 + used, i] = 0.0
        used += 1
    total = add_limit(work, first, second, into - push, used, on_circle, push, slack, order)
    if kind.friction == inf or total == inf:
        return total
    return total + add_cone(kind.friction, work, into, used, slack, order)


@in_place_kernel
def outward(kind, work, m, row):
    """Return the component of a row of ``work.span`` that points out of the workspace through the
    wall of contact m.
    """
    span, normals, circle, wall = work.span, kind.shape.normals, kind.shape.circle, kind.walls[m]
    if wall < normals.shape[0]:
        return -rows_dot(normals, wall, span, row)
    total = 0.0
    for i in range(2):
        total += (work.contacts[m, 0, i] - circle[i]) * span[row, i]
    return total / circle[2]


@in_place_kernel
def add_cone(friction, work, into, used, slack, order):
    """Return -log g for the limit of friction: the wall holds the toucher if the part of the
    adjustment a along the wall is at most μ p, that is |a|² <= (1+μ²) p² for the push p = ``into``.

    Both sides are divided by p, so that they are lengths. With M = 1+μ²:

        g = M p - |a|² / p
        g_u = M p_u - 2 a·J_u / p + |a|² p_u / p²
        g_uw = M p_uw - 2 J_u·J_w / p + 2 (a·J_u p_w + a·J_w p_u) / p²
               + |a|² p_uw / p² - 2 |a|² p_u p_w / p³

    p_u and p_uw are in ``work.first`` and ``work.second``.
    """
    span, first, second = work.span, work.first, work.second
    cone_first, cone_second = work.cone_first, work.cone_second
    factor = 1 + friction * friction
    square, reach = rows_dot(span, 0, span, 0), max(into, 1e-12)
    for u in range(used):
        u_along = rows_dot(span, 0, span, 1 + u)
        cone_first[u] = factor * first[u] - 2 * u_along / reach + square * first[u] / reach / reach
        for w in range(used):
            w_along = rows_dot(span, 0, span, 1 + w)
            cone_second[u, w] = (
                factor * second[u, w]
                - 2 * rows_dot(span, 1 + u, span, 1 + w) / reach
                + 2 * (u_along * first[w] + w_along * first[u]) / reach / reach
                + square * second[u, w] / reach / reach
                - 2 * square * first[u] * first[w] / reach / reach / reach
            )
    # In phase I, the push may still be negative; the limit is then that of a push of 1e-12.
    value = factor * reach - square / reach if into > 0 or isnan(slack) else -square / reach
    return add_limit(work, cone_first, cone_second, value, used, True, 0.0, slack, order)
