"""Lines of sight: which of many segments meet a border, in compiled code."""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel, kernel

CLEAR, CROSSED, DOUBTFUL = 0, 1, 2
"""A segment does not meet the border, crosses it, or is nearer to it than the rounding error."""

# relative to the terms of a determinant: above this, its sign is certain (Shewchuk 1997, bound A,
# rounded up)
_CERTAIN = 4e-16
# relative to a bin: lines are entered in all bins that they may touch, whatever the rounding
_WIDER = 1e-6


@in_place_kernel
def _side(from_x, from_y, to_x, to_y, x, y):
    """Return on which side of a line a point lies: 1 (left), -1 (right), or 0 if rounding decides."""
    plus = (from_x - x) * (to_y - y)
    minus = (from_y - y) * (to_x - x)
    if abs(plus - minus) <= _CERTAIN * (abs(plus) + abs(minus)):
        return 0
    return 1 if plus > minus else -1


@in_place_kernel
def _columns(from_x, from_y, to_x, to_y, row):
    """Return the first and the last column of bins that a segment touches in a row of bins, where
    the unit of all coordinates is the side of a bin.
    """
    low, high = 0.0, 1.0
    step = to_y - from_y
    if abs(step) > 1e-300:
        one, other = (row - _WIDER - from_y) / step, (row + 1 + _WIDER - from_y) / step
        if one > other:
            one, other = other, one
        low, high = max(low, one), min(high, other)
    one, other = from_x + low * (to_x - from_x), from_x + high * (to_x - from_x)
    return np.int64(np.floor(min(one, other) - _WIDER)), np.int64(
        np.floor(max(one, other) + _WIDER)
    )


@kernel
def bins_of(lines, shape):
    """Return (first, members): the lines that touch each bin of a grid, in compressed rows.

    ``lines`` (n, 4) are segments (x, y, x, y), where the unit is the side of a bin and the origin
    is the corner of the grid. The lines of bin ``row * shape[1] + col`` are ``members[first[bin] :
    first[bin + 1]]``.
    """
    height, width = shape
    first = np.zeros(height * width + 1, dtype=np.int64)
    members = np.empty(0, dtype=np.int32)
    for writes in (False, True):
        for k in range(len(lines)):
            from_x, from_y, to_x, to_y = lines[k]
            low = max(0, np.int64(np.floor(min(from_y, to_y) - _WIDER)))
            high = min(height - 1, np.int64(np.floor(max(from_y, to_y) + _WIDER)))
            for row in range(low, high + 1):
                left, right = _columns(from_x, from_y, to_x, to_y, row)
                for col in range(max(0, left), min(width - 1, right) + 1):
                    if writes:
                        first[row * width + col] -= 1
                        members[first[row * width + col]] = k
                    else:
                        first[row * width + col] += 1
        if not writes:
            for k in range(1, len(first)):
                first[k] += first[k - 1]
            members = np.empty(first[-1], dtype=np.int32)
    return first, members


@kernel
def look(lines, first, members, shape, corner, size, starts, ends, found):
    """Write to ``found`` whether each segment from ``starts`` (m, 2) to ``ends`` meets a line:
    `CLEAR`, `CROSSED` or `DOUBTFUL`.

    The arguments ``first``, ``members`` and ``shape`` are those of `bins_of`, for bins of side
    ``size`` with the lower left corner ``corner`` of the grid. No coordinate of a line or of a
    segment is rounded for the test itself.

    Bins are visited from the start of a segment to its end, up to the first line that it crosses:
    most blocked segments are blocked near their starts.
    """
    height, width = shape
    for k in range(len(starts)):
        x_0, y_0 = starts[k]
        x_1, y_1 = ends[k]
        from_x, from_y = (x_0 - corner[0]) / size, (y_0 - corner[1]) / size
        to_x, to_y = (x_1 - corner[0]) / size, (y_1 - corner[1]) / size
        status = CLEAR
        one = min(max(np.int64(np.floor(from_y - np.sign(to_y - from_y) * _WIDER)), 0), height - 1)
        other = min(max(np.int64(np.floor(to_y + np.sign(to_y - from_y) * _WIDER)), 0), height - 1)
        if from_y == to_y:
            one = min(max(np.int64(np.floor(from_y - _WIDER)), 0), height - 1)
            other = min(max(np.int64(np.floor(from_y + _WIDER)), 0), height - 1)
        down = 1 if other >= one else -1
        for row in range(one, other + down, down):
            left, right = _columns(from_x, from_y, to_x, to_y, row)
            left, right = max(left, 0), min(right, width - 1)
            begin, end, along = (left, right + 1, 1) if to_x >= from_x else (right, left - 1, -1)
            if left > right:
                continue
            for col in range(begin, end, along):
                place = row * width + col
                for member in members[first[place] : first[place + 1]]:
                    x, y, far_x, far_y = lines[member]
                    before = _side(x_0, y_0, x_1, y_1, x, y)
                    after = _side(x_0, y_0, x_1, y_1, far_x, far_y)
                    if before * after > 0:
                        continue
                    here = _side(x, y, far_x, far_y, x_0, y_0)
                    there = _side(x, y, far_x, far_y, x_1, y_1)
                    if here * there > 0:
                        continue
                    if before * after < 0 and here * there < 0:
                        status = CROSSED
                        break
                    status = DOUBTFUL
                if status == CROSSED:
                    break
            if status == CROSSED:
                break
        found[k] = status
