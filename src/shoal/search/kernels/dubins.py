"""Dubins curves between many pairs of poses, and the headings along a path, in compiled code.

A curve has three parts. Its type is an index in `shoal.search.flight.dubins.WORDS`. The types of odd
index are the mirror images of those before them, with left and right exchanged: the same formula
with -a and -b for a and b.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel, kernel

_ROUND = 2 * np.pi
_CLOSE = 1e-9  # radians, and lengths divided by the radius


@in_place_kernel
def turn_of(angle):
    """Return an angle between 0 and 2 pi."""
    angle %= _ROUND
    return 0.0 if angle > _ROUND - _CLOSE else angle


@in_place_kernel
def parts_of(word, d, a, b, sa, sb, ca, cb, cab):
    """Return the lengths of the parts of one curve, divided by the radius; infinite if the curve
    does not exist.

    The end lies at the distance ``d``, divided by the radius. The headings at start and end are
    ``a`` and ``b`` from the direction to the end, with the sines ``sa`` and ``sb``, the cosines
    ``ca`` and ``cb``, and ``cab`` for the cosine of a - b. The formulas are those of Shkel and
    Lumelsky, "Classification of the Dubins set", 2001.
    """
    if word % 2:
        a, b, sa, sb = -a, -b, -sa, -sb
    if word < 2:
        # LSL: p^2 = 2 + d^2 - 2 cos(a - b) + 2 d (sin a - sin b)
        p = np.sqrt(max(2.0 + d * d - 2.0 * cab + 2.0 * d * (sa - sb), 0.0))
        turn = np.arctan2(cb - ca, d + sa - sb)
        return turn_of(turn - a), p, turn_of(b - turn)
    if word < 4:
        # LSR: p^2 = d^2 - 2 + 2 cos(a - b) + 2 d (sin a + sin b)
        square = d * d - 2.0 + 2.0 * cab + 2.0 * d * (sa + sb)
        if not square >= 0.0:
            return np.inf, np.inf, np.inf
        p = np.sqrt(square)
        turn = np.arctan2(-ca - cb, d + sa + sb) - np.arctan2(-2.0, p)
        return turn_of(turn - a), p, turn_of(turn - b)
    # RLR: cos p = (6 - d^2 + 2 cos(a - b) + 2 d (sin a - sin b)) / 8
    cosine = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sa - sb)) / 8.0
    if not abs(cosine) <= 1.0:
        return np.inf, np.inf, np.inf
    p = _ROUND - np.arccos(cosine)
    t = a - np.arctan2(ca - cb, d - sa + sb) + p / 2.0
    return turn_of(t), p, turn_of(a - b - t + p)


@kernel
def curves_between(starts, ends, radius, parts):
    """Write to ``parts`` (n, 6, 3) the lengths of the parts of all six curves from each start pose
    to the end pose of the same number, divided by the radius.

    The rows of ``starts`` and ``ends`` (n, 3) are x, y, and the heading in radians. The parts of a
    curve that does not exist are infinite, as those of all curves where a number is NaN.
    """
    for k in range(len(starts)):
        x, y = (ends[k, 0] - starts[k, 0]) / radius, (ends[k, 1] - starts[k, 1]) / radius
        d, toward = np.hypot(x, y), np.arctan2(y, x)
        a, b = starts[k, 2] - toward, ends[k, 2] - toward
        if not np.isfinite(d + a + b):
            parts[k] = np.inf
            continue
        sa, sb, ca, cb, cab = np.sin(a), np.sin(b), np.cos(a), np.cos(b), np.cos(a - b)
        for word in range(6):
            t, p, q = parts_of(word, d, a, b, sa, sb, ca, cb, cab)
            parts[k, word, 0], parts[k, word, 1], parts[k, word, 2] = t, p, q


@kernel
def shortest_curves(starts, ends, headings_at_start, headings_at_end, radius, lengths, words):
    """Write to ``lengths`` (n, h, h) the length of the shortest curve of each of n links, for each
    pair of headings at its two ends, divided by the radius, and to ``words`` (n, h, h) its type: of
    curves as long as each other but for rounding, the first, so that all machines choose the same.

    The link k leads from ``starts[k]`` to ``ends[k]``, with x and y in metres; its headings are
    those of ``headings_at_start[k]`` and ``headings_at_end[k]`` (n, h), NaN for those that are not
    possible, to which no curve leads: infinite, of type 0.
    """
    count = headings_at_start.shape[1]
    for k in range(len(starts)):
        x, y = (ends[k, 0] - starts[k, 0]) / radius, (ends[k, 1] - starts[k, 1]) / radius
        d, toward = np.hypot(x, y), np.arctan2(y, x)
        for i in range(count):
            a = headings_at_start[k, i] - toward
            sa, ca = np.sin(a), np.cos(a)
            for j in range(count):
                b = headings_at_end[k, j] - toward
                lengths[k, i, j], words[k, i, j] = np.inf, 0
                if not np.isfinite(a + b):
                    continue
                sb, cb, cab = np.sin(b), np.cos(b), np.cos(a - b)
                for word in range(6):
                    t, p, q = parts_of(word, d, a, b, sa, sb, ca, cb, cab)
                    if t + p + q < lengths[k, i, j] - _CLOSE:
                        lengths[k, i, j], words[k, i, j] = t + p + q, word


@kernel
def choose_headings(possible, link_of, lengths, chosen):
    """Write to ``chosen`` (n,) the number of the heading at each point of the shortest path through
    n points, and return 0; or return the first point that no path reaches.

    ``possible`` (h,) tells which headings the path may have at its first point. The leg k is the
    link ``link_of[k]``, whose curves have the ``lengths[link_of[k]]`` (h, h); or a straight leg, if
    this number is -1: both its ends have heading 0 alone. Of paths that are equal but for rounding,
    the one with the first headings at its last points is chosen.
    """
    count, n_legs = len(possible), len(link_of)
    came = np.zeros((n_legs, count), dtype=np.int64)
    costs, after = np.full(count, np.inf), np.empty(count)
    costs[possible] = 0.0
    for k in range(n_legs):
        after[:] = np.inf
        if link_of[k] < 0:
            after[0] = costs[0]
        else:
            for i in range(count):
                if costs[i] == np.inf:
                    continue
                for j in range(count):
                    total = costs[i] + lengths[link_of[k], i, j]
                    if total < after[j] - _CLOSE:
                        after[j], came[k, j] = total, i
        costs[:] = after
        if costs.min() == np.inf:
            return k + 1
    chosen[n_legs] = 0
    for i in range(1, count):
        if costs[i] < costs[chosen[n_legs]] - _CLOSE:
            chosen[n_legs] = i
    for k in range(n_legs - 1, -1, -1):
        chosen[k] = came[k, chosen[k + 1]]
    return 0


@kernel
def bent_paths(starts, senses, parts, radius, sharpest, slight, points, ends):
    """Write to ``points`` the corners of a path of tangents for each of n curves, path after path,
    and to ``ends`` (n,) the number of points up to the end of each path.

    The part k of a curve turns to the left (``senses[k]`` = 1), to the right (-1), or leads
    straight on (0). A path has its curve's start, the corners of each arc, and the curve's end. Its
    legs turn by at most ``sharpest``; a corner is left out if the leg to it has at most the length
    ``slight``.
    """
    used = 0
    for c in range(len(starts)):
        x, y, heading = starts[c, 0], starts[c, 1], starts[c, 2]
        points[used, 0], points[used, 1] = x, y
        used += 1
        for part in range(3):
            sense, length = senses[c, part], parts[c, part]
            if sense == 0:
                x += radius * length * np.cos(heading)
                y += radius * length * np.sin(heading)
                continue
            count = max(np.ceil(length / sharpest - _CLOSE), 1.0)
            bend = length / count
            center_x = x - sense * radius * np.sin(heading)
            center_y = y + sense * radius * np.cos(heading)
            # The tangents of an arc meet at the angle in the middle between two points of the arc,
            # R / cos(bend / 2) from its centre.
            if radius * np.tan(bend / 2) > slight:
                away = sense * radius / np.cos(bend / 2)
                for number in range(int(count)):
                    angle = heading + sense * bend * (number + 0.5)
                    points[used, 0] = center_x + away * np.sin(angle)
                    points[used, 1] = center_y - away * np.cos(angle)
                    used += 1
            heading += sense * length
            x = center_x + sense * radius * np.sin(heading)
            y = center_y - sense * radius * np.cos(heading)
        points[used, 0], points[used, 1] = x, y
        used += 1
        ends[c] = used
