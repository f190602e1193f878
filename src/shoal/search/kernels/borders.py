"""Lines of sight, in compiled code: which of many segments meet a border, and paths along them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel, kernel

CLEAR, CROSSED, DOUBTFUL = 0, 1, 2
"""A segment does not meet the border, crosses it, or is nearer to it than the rounding error."""

# relative to the terms of a determinant: above this, its sign is certain (Shewchuk 1997, bound A,
# rounded up)
_CERTAIN = 4e-16
_ALONG = 1e-9  # sine of the largest angle between collinear lines
# relative to a bin: lines are entered in all bins that they may touch, whatever the rounding
_WIDER = 1e-6


class BinnedLines(NamedTuple):
    """The lines of a border, in the bins of a grid.

    Parameters
    ----------
    lines : ndarray of float64, shape (n, 4)
        Segments (x, y, x, y) in metres.
    first : ndarray of int64, shape (bins + 1,)
    members : ndarray of int32, shape (m,)
        The lines that touch each bin, as `bins_of` returns them.
    shape : tuple of int
        Numbers of rows and columns of bins.
    corner : ndarray of float64, shape (2,)
        The lower left corner of the grid.
    size : float
        Side of a bin in metres.
    """

    lines: NDArray[Any]
    first: NDArray[Any]
    members: NDArray[Any]
    shape: tuple[int, int]
    corner: NDArray[Any]
    size: float


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
        enter, leave = (row - _WIDER - from_y) / step, (row + 1 + _WIDER - from_y) / step
        if enter > leave:
            enter, leave = leave, enter
        low, high = max(low, enter), min(high, leave)
    enter, leave = from_x + low * (to_x - from_x), from_x + high * (to_x - from_x)
    return np.int64(np.floor(min(enter, leave) - _WIDER)), np.int64(
        np.floor(max(enter, leave) + _WIDER)
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


@in_place_kernel
def _look_along(border, x_0, y_0, x_1, y_1):
    """Return whether a segment from (x_0, y_0) to (x_1, y_1) meets a line; see `look`."""
    height, width = border.shape
    corner, size = border.corner, border.size
    from_x, from_y = (x_0 - corner[0]) / size, (y_0 - corner[1]) / size
    to_x, to_y = (x_1 - corner[0]) / size, (y_1 - corner[1]) / size
    status = CLEAR
    first_row = min(
        max(np.int64(np.floor(from_y - np.sign(to_y - from_y) * _WIDER)), 0), height - 1
    )
    last_row = min(max(np.int64(np.floor(to_y + np.sign(to_y - from_y) * _WIDER)), 0), height - 1)
    if from_y == to_y:
        first_row = min(max(np.int64(np.floor(from_y - _WIDER)), 0), height - 1)
        last_row = min(max(np.int64(np.floor(from_y + _WIDER)), 0), height - 1)
    down = 1 if last_row >= first_row else -1
    for row in range(first_row, last_row + down, down):
        left, right = _columns(from_x, from_y, to_x, to_y, row)
        left, right = max(left, 0), min(right, width - 1)
        begin, end, along = (left, right + 1, 1) if to_x >= from_x else (right, left - 1, -1)
        if left > right:
            continue
        for col in range(begin, end, along):
            place = row * width + col
            for member in border.members[border.first[place] : border.first[place + 1]]:
                x, y, far_x, far_y = border.lines[member]
                before = _side(x_0, y_0, x_1, y_1, x, y)
                after = _side(x_0, y_0, x_1, y_1, far_x, far_y)
                if before * after > 0:
                    continue
                start_side = _side(x, y, far_x, far_y, x_0, y_0)
                end_side = _side(x, y, far_x, far_y, x_1, y_1)
                if start_side * end_side > 0:
                    continue
                if before * after < 0 and start_side * end_side < 0:
                    return CROSSED
                status = DOUBTFUL
    return status


@kernel
def look(border, starts, ends, codes):
    """Write to ``codes`` whether each segment from ``starts`` (m, 2) to ``ends`` meets a line:
    `CLEAR`, `CROSSED` or `DOUBTFUL`.

    The lines are those of ``border``, as `BinnedLines`. No coordinate of a line or of a segment is
    rounded for the test itself.

    Bins are visited from the start of a segment to its end, up to the first line that it crosses:
    most blocked segments are blocked near their starts.
    """
    for k in range(len(starts)):
        codes[k] = _look_along(
            border,
            starts[k, 0],
            starts[k, 1],
            ends[k, 0],
            ends[k, 1],
        )


@in_place_kernel
def _settle(code, answered, met, doubts, doubtful):
    """Return the status of a doubtful segment with a number, and the number of doubtful segments.

    ``answered`` are the numbers of segments, in increasing order, of which ``met`` tells whether
    they meet the border. The number of any other segment, which counts as blocked, is written to
    ``doubts`` if there is room.
    """
    place = np.searchsorted(answered, code)
    if place < len(answered) and answered[place] == code:
        return (CROSSED if met[place] else CLEAR), doubtful
    if doubtful < len(doubts):
        doubts[doubtful] = code
        doubtful += 1
    return DOUBTFUL, doubtful


@in_place_kernel
def pull(border, path, ahead, answered, met, indices, doubts):
    """Return (count, doubtful): the number of points of a path that are kept, so that each leads
    straight to the last visible one of the next ``ahead`` points, and that of doubtful segments.

    The indices of the points are written to ``indices``. The border is given as in `look`, and the
    doubts as in `_settle`, where the segment from point i to point j of n has the number i n + j.
    """
    n = len(path)
    indices[0] = position = doubtful = 0
    count = 1
    while position < n - 1:
        target = min(position + ahead, n - 1)
        while target > position + 1:  # the next leg already exists
            status = _look_along(
                border,
                path[position, 0],
                path[position, 1],
                path[target, 0],
                path[target, 1],
            )
            if status == DOUBTFUL:
                status, doubtful = _settle(position * n + target, answered, met, doubts, doubtful)
            if status == CLEAR:
                break
            target -= 1
        indices[count] = position = target
        count += 1
    return count, doubtful


@kernel
def find_bends(border, path, lengths, price, answered, met, bends, doubts, unclear):
    """Return (count, doubtful): the number of bends of the path that `with_fewer_bends` makes of
    the path ``path`` (n, 2) with legs of ``lengths``, and the number of doubtful segments.

    The bends are written to ``bends``, from the last to the first. The border is given as in `look`,
    and the doubts as in `_settle`. From leg i of m, two segments lead to leg j, with the numbers
    2 (i m + j) and 2 (i m + j) + 1. The ends of doubtful ones are written to ``unclear`` (_, 4).
    """
    count = len(path) - 1
    costs, before = np.empty(count), np.empty(count, dtype=np.int64)
    at, past = np.empty((count, 2)), np.zeros(count + 1)
    for leg in range(count):
        past[leg + 1] = past[leg] + lengths[leg]
    costs[0], doubtful = lengths[0], 0
    for leg in range(1, count):
        costs[leg], before[leg] = costs[leg - 1] + price, leg - 1
        from_x, from_y = path[leg]
        at[leg] = path[leg]
        then_x = (path[leg + 1, 0] - from_x) / lengths[leg]
        then_y = (path[leg + 1, 1] - from_y) / lengths[leg]
        for earlier in range(leg - 1):
            end_x, end_y = path[earlier + 1]
            along_x = (end_x - path[earlier, 0]) / lengths[earlier]
            along_y = (end_y - path[earlier, 1]) / lengths[earlier]
            sine = along_x * then_y - along_y * then_x
            if not abs(sine) > _ALONG:
                continue
            # The point end + a along = from - b then lies ahead on both, with a and b at least 0.
            gap_x, gap_y = from_x - end_x, from_y - end_y
            a = (gap_x * then_y - gap_y * then_x) / sine
            b = (along_x * gap_y - along_y * gap_x) / sine
            longer = a + b - (past[leg] - past[earlier + 1])
            cost = costs[earlier] + price + a + b
            if not (
                a >= 0 and b >= 0 and longer < price * (leg - earlier - 1) and cost < costs[leg]
            ):
                continue
            x, y = end_x + a * along_x, end_y + a * along_y
            clear = True
            for half in range(2):
                x_0, y_0, x_1, y_1 = (x, y, from_x, from_y) if half else (end_x, end_y, x, y)
                status = _look_along(border, x_0, y_0, x_1, y_1)
                if status == DOUBTFUL:
                    unsettled = doubtful
                    code = 2 * (earlier * count + leg) + half
                    status, doubtful = _settle(code, answered, met, doubts, doubtful)
                    if doubtful > unsettled:
                        unclear[unsettled] = x_0, y_0, x_1, y_1
                if status != CLEAR:
                    clear = False
                    break
            if clear:
                costs[leg], before[leg], at[leg, 0], at[leg, 1] = cost, earlier, x, y
        costs[leg] += lengths[leg]
    count_of_bends, leg = 0, count - 1
    while leg > 0:
        bends[count_of_bends] = at[leg]
        count_of_bends += 1
        leg = before[leg]
    return count_of_bends, doubtful


@in_place_kernel
def _bins_within(shape, corner, size, low, high):
    """Return the first and the last row, and the first and the last column, of the bins of a grid
    that a box touches; the last ones are smaller if it touches none, as a box beside the grid does.
    """
    left = max(np.floor((low[0] - corner[0]) / size), 0.0)
    right = min(np.floor((high[0] - corner[0]) / size), shape[1] - 1.0)
    down = max(np.floor((low[1] - corner[1]) / size), 0.0)
    up = min(np.floor((high[1] - corner[1]) / size), shape[0] - 1.0)
    if not (left <= right and down <= up):
        return 0, -1, 0, -1
    return np.int64(down), np.int64(up), np.int64(left), np.int64(right)


@in_place_kernel
def places_within(places, order, first, shape, corner, size, low, high, indices):
    """Write to ``indices`` the indices of the places (n, 2) in the box from ``low`` to ``high``, as
    far as it has room, and return their number.

    The places of bin ``row * shape[1] + col`` of a grid of bins of side ``size``, with the lower
    left corner ``corner``, are ``order[first[bin] : first[bin + 1]]``.
    """
    down, up, left, right = _bins_within(shape, corner, size, low, high)
    count = 0
    for row in range(down, up + 1):
        for k in order[first[row * shape[1] + left] : first[row * shape[1] + right + 1]]:
            x, y = places[k]
            if low[0] <= x <= high[0] and low[1] <= y <= high[1]:
                if count == len(indices):
                    return count
                indices[count] = k
                count += 1
    return count


@in_place_kernel
def places_around(places, order, first, shape, corner, size, points, distance, near):
    """Set to True in ``near`` which places are at most ``distance`` away from one of the ``points``
    (m, 2). The bins are those of `places_within`.
    """
    wide = (1 + 1e-9) * distance  # whatever the rounding
    for x, y in points:
        low, high = (x - wide, y - wide), (x + wide, y + wide)
        down, up, left, right = _bins_within(shape, corner, size, low, high)
        for row in range(down, up + 1):
            for k in order[first[row * shape[1] + left] : first[row * shape[1] + right + 1]]:
                east, north = places[k, 0] - x, places[k, 1] - y
                if np.sqrt(east * east + north * north) <= distance:
                    near[k] = True


@in_place_kernel
def _is_passable(places, sides, k, x, y):
    """Return whether a path in the direction (x, y) can pass corner ``k``: the border near the
    corner lies on one side of the path.
    """
    before = x * sides[k, 1] - y * sides[k, 0]
    after = x * sides[k, 3] - y * sides[k, 2]
    rounding = _ALONG * np.sqrt(x * x + y * y)
    return min(before, after) >= -rounding or max(before, after) <= rounding


@in_place_kernel
def _is_before(keys, nodes, i, j):
    return keys[i, 0] < keys[j, 0] or (keys[i, 0] == keys[j, 0] and nodes[i, 0] < nodes[j, 0])


@in_place_kernel
def _swap(keys, nodes, i, j):
    for c in range(2):
        keys[i, c], keys[j, c] = keys[j, c], keys[i, c]
        nodes[i, c], nodes[j, c] = nodes[j, c], nodes[i, c]


@kernel
def find_path(border, places, sides, ends, most, answered, met, bend_of, doubts):
    """Return (legs, doubtful) of the shortest path from ``ends[0]`` to ``ends[1]`` that bends only
    at given corners: the number of corners at which it bends, or -1 if there is none up to the
    length ``most``, and the number of doubtful lines of sight.

    The corners of the path are written to ``bend_of``. The border is given as in `look`, the
    corners by their ``places`` (K, 2), and the unit vectors to their neighbours on the border by
    ``sides`` (K, 4). The doubts are given as in `_settle`. The segment between the points i and j
    has the number i * (K + 2) + j, with K for the start and K + 1 for the end.

    The algorithm is A*. A line of sight is tested only when a path along it is the most promising
    one, because most of the lines never are.
    """
    count = len(places)
    begin, goal = count, count + 1
    closed = np.zeros(count, dtype=np.bool_)
    previous_of = np.empty(count, dtype=np.int64)
    remaining = np.empty(count, dtype=np.float64)
    for k in range(count):
        x, y = ends[1, 0] - places[k, 0], ends[1, 1] - places[k, 1]
        remaining[k] = np.sqrt(x * x + y * y)
    # a heap: the length of a path through a node, and up to it; the node, and the one before it
    keys, nodes = np.empty((64, 2), dtype=np.float64), np.empty((64, 2), dtype=np.int64)
    waiting, doubtful = 0, 0
    node, length = begin, 0.0
    at_x, at_y = ends[0]
    while True:
        for k in range(count):
            if closed[k]:
                continue
            x, y = places[k, 0] - at_x, places[k, 1] - at_y
            far = length + np.sqrt(x * x + y * y)
            if far + remaining[k] > most or not _is_passable(places, sides, k, x, y):
                continue
            if node != begin and not _is_passable(places, sides, node, x, y):
                continue
            if waiting == len(keys):
                more_keys = np.empty((2 * waiting, 2), dtype=np.float64)
                more_nodes = np.empty((2 * waiting, 2), dtype=np.int64)
                more_keys[:waiting] = keys
                more_nodes[:waiting] = nodes
                keys, nodes = more_keys, more_nodes
            keys[waiting, 0], keys[waiting, 1] = far + remaining[k], far
            nodes[waiting, 0], nodes[waiting, 1] = k, node
            at = waiting
            waiting += 1
            while at and _is_before(keys, nodes, at, (at - 1) // 2):
                _swap(keys, nodes, at, (at - 1) // 2)
                at = (at - 1) // 2
        expanded = False
        while waiting and not expanded:
            node, previous, length = nodes[0, 0], nodes[0, 1], keys[0, 1]
            waiting -= 1
            _swap(keys, nodes, 0, waiting)
            at = 0
            while 2 * at + 1 < waiting:
                least = 2 * at + 1
                if least + 1 < waiting and _is_before(keys, nodes, least + 1, least):
                    least += 1
                if not _is_before(keys, nodes, least, at):
                    break
                _swap(keys, nodes, at, least)
                at = least
            if closed[node]:
                continue
            if previous == begin:
                from_x, from_y = ends[0]
            else:
                from_x, from_y = places[previous]
            at_x, at_y = places[node]
            status = _look_along(border, from_x, from_y, at_x, at_y)
            if status == DOUBTFUL:
                code = previous * (count + 2) + node
                status, doubtful = _settle(code, answered, met, doubts, doubtful)
            if status != CLEAR:
                continue
            closed[node], previous_of[node], expanded = True, previous, True
        if not expanded:
            return -1, doubtful
        # no other path can be shorter, because the heap gives the most promising node first
        x, y = ends[1, 0] - at_x, ends[1, 1] - at_y
        if not _is_passable(places, sides, node, x, y):
            continue
        status = _look_along(border, at_x, at_y, ends[1, 0], ends[1, 1])
        if status == DOUBTFUL:
            code = node * (count + 2) + goal
            status, doubtful = _settle(code, answered, met, doubts, doubtful)
        if status == CLEAR:
            break
    legs = 0
    while node != begin:
        bend_of[legs] = node
        legs += 1
        node = previous_of[node]
    for k in range(legs // 2):
        bend_of[k], bend_of[legs - 1 - k] = bend_of[legs - 1 - k], bend_of[k]
    return legs, doubtful
