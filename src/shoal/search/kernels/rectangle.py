"""The generalized Hilbert curve: a path through a box of any size, from a corner to the far end of the first axis.

The scheme of halvings is by Červený ("gilbert", 2018). A box that is much longer than wide is cut into two halves across its
length. A box that is not much longer than wide is cut into three parts (up, along, down) or, in 3-D, into five parts. The kernel
makes halves with an even number of cells where possible, because a path along an even number of cells needs no diagonal step
between corners. Instead of recursion, the kernel uses a stack of boxes.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel

DEPTH = 512
"""Size of the stack of boxes. This size is enough for 2^31 cells along each side of the box, with 4 entries for each halving."""


@kernel
def half(length):
    """Return half of a signed length. If the length is above 2, the half is rounded up to an even number."""
    size = abs(length)
    part = size // 2
    if part % 2 == 1 and size > 2:
        part += 1
    return part if length > 0 else -part


@kernel
def push(stack, top, px, py, pz, a_axis, a, b_axis, b, c_axis, c):
    stack[top, 0], stack[top, 1], stack[top, 2] = px, py, pz
    stack[top, 3], stack[top, 4], stack[top, 5] = a_axis, a, b_axis
    stack[top, 6], stack[top, 7], stack[top, 8] = b, c_axis, c
    return top + 1


@kernel
def moved(place, axis, by):
    """Return a position (x, y, z) moved along an axis by ``by`` cells."""
    x, y, z = place
    if axis == 0:
        return x + by, y, z
    if axis == 1:
        return x, y + by, z
    return x, y, z + by


@kernel
def walk_box(start, axes, lengths, places, at):
    """Write the path through a box to ``places`` (N, 3), beginning with row ``at``. Return the index after the last row written.

    ``start`` is the first position (x, y, z). ``lengths`` (3,) contains the signed lengths of the box along ``axes``. The path ends
    at the far end of the first axis. A box with the length 1 along the first axis must also have the length 1 along another axis.
    """
    stack = np.empty((DEPTH, 9), dtype=np.int64)
    top = push(stack, 0, start[0], start[1], start[2], axes[0], lengths[0], axes[1], lengths[1], axes[2], lengths[2])
    while top > 0:
        top -= 1
        p = (stack[top, 0], stack[top, 1], stack[top, 2])
        i, a, j, b, k, c = stack[top, 3], stack[top, 4], stack[top, 5], stack[top, 6], stack[top, 7], stack[top, 8]
        w, h, d = abs(a), abs(b), abs(c)
        if int(w == 1) + int(h == 1) + int(d == 1) >= 2:
            axis, length = (i, a) if w > 1 else ((j, b) if h > 1 else (k, c))
            at = walk_line(p, axis, length, places, at)
        else:
            top = split(stack, top, p, i, a, j, b, k, c)
    return at


@kernel
def walk_line(place, axis, length, places, at):
    step = 1 if length > 0 else -1
    for _ in range(abs(length)):
        places[at, 0], places[at, 1], places[at, 2] = place
        place = moved(place, axis, step)
        at += 1
    return at


@kernel
def split(stack, top, p, i, a, j, b, k, c):
    """Push the parts of a box onto the stack, in the reverse order of the path's visits."""
    w, h, d = abs(a), abs(b), abs(c)
    a2, b2, c2 = half(a), half(b), half(c)
    if 2 * w > 3 * h and 2 * w > 3 * d:
        q = moved(p, i, a2)
        top = push(stack, top, q[0], q[1], q[2], i, a - a2, j, b, k, c)
        return push(stack, top, p[0], p[1], p[2], i, a2, j, b, k, c)
    da, db, dc = np.sign(a), np.sign(b), np.sign(c)
    end = moved(p, i, a - da)
    if 3 * h > 4 * d:  # up along b, along a, down along b
        q = moved(end, j, b2 - db)
        top = push(stack, top, q[0], q[1], q[2], j, -b2, k, c, i, a2 - a)
        q = moved(p, j, b2)
        top = push(stack, top, q[0], q[1], q[2], i, a, j, b - b2, k, c)
        return push(stack, top, p[0], p[1], p[2], j, b2, k, c, i, a2)
    if 3 * d > 4 * h:  # up along c, along a, down along c
        q = moved(end, k, c2 - dc)
        top = push(stack, top, q[0], q[1], q[2], k, -c2, i, a2 - a, j, b)
        q = moved(p, k, c2)
        top = push(stack, top, q[0], q[1], q[2], i, a, j, b, k, c - c2)
        return push(stack, top, p[0], p[1], p[2], k, c2, i, a2, j, b)
    q = moved(end, j, b2 - db)
    top = push(stack, top, q[0], q[1], q[2], j, -b2, k, c2, i, a2 - a)
    q = moved(moved(end, j, b2), k, c - dc)
    top = push(stack, top, q[0], q[1], q[2], k, -c, i, a2 - a, j, b - b2)
    q = moved(moved(p, j, b2 - db), k, c - dc)
    top = push(stack, top, q[0], q[1], q[2], i, a, j, -b2, k, c2 - c)
    q = moved(p, j, b2)
    top = push(stack, top, q[0], q[1], q[2], k, c, i, a2, j, b - b2)
    return push(stack, top, p[0], p[1], p[2], j, b2, k, c2, i, a2)
