"""Erratum of paper W about algorithm 2: the algorithm as printed, with one error corrected, and
with both errors corrected.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .checking import Check, into

CHECKS: list[Check] = []
erratum = into(CHECKS)

Vector = NDArray[np.float64]


def _across(a: Vector, b: Vector) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _inside(corners: Vector, point: Vector) -> bool:
    """Return whether a point lies in a convex polygon with corners in counter-clockwise order."""
    following = np.roll(corners, -1, axis=0)
    return all(
        _across(end - start, point - start) >= -1e-12
        for start, end in zip(corners, following, strict=True)
    )


def _cut(corners: Vector, heights: Vector, level: float) -> list[Vector]:
    """Return the points of a polygon's outline whose height above an edge is ``level``.

    ``heights`` contains the height of each corner above the edge.
    """
    points, count = [], len(corners)
    for k in range(count):
        u, v = heights[k] - level, heights[(k + 1) % count] - level
        if u * v < 0 or (u == 0) != (v == 0):
            points.append(corners[k] + u / (u - v) * (corners[(k + 1) % count] - corners[k]))
    return points


def _below(heights: Vector, level: float, first: int, step: int, last: int) -> list[int]:
    """Return the indices of consecutive corners below the height ``level``, from the corner
    ``first`` in steps of ``step``.

    The function stops at the first corner that is not below ``level``, or at the corner ``last``.
    """
    found, k = [], first % len(heights)
    while heights[k] < level and k != last:
        found.append(k)
        k = (k + step) % len(heights)
    return found


def _piece(corners: Vector, i: int, s: Vector, *, line3: bool, line11: bool) -> Vector | None:
    """Return the polygon D of one edge (lines 3 to 11 of algorithm 2), or None if the edge gives no
    polygon D.

    With ``line3``, the function corrects line 3: p'_i is p_i + s_a - s_b, where b is the particle
    nearer to the edge and a is the other particle. With ``line11``, the function corrects line 11:
    it subtracts p'_i+1 from the first chain of corners, and p'_i from the second chain. The result
    is None if the line through p'_i and p'_i+1 misses the workspace. With ``line3``, the result is
    also None if the particle nearer to the edge cannot touch the edge.
    """
    following = (i + 1) % len(corners)
    a, b = corners[i], corners[following]
    along = (b - a) / np.hypot(*(b - a))
    heights = (corners - a) @ np.array([-along[1], along[0]])
    heights[[i, following]] = 0.0
    sign, ends = 1.0, [s[0] + s[1] - a, s[0] + s[1] - b]
    if line3:
        # 1: particle 2 is nearer, as the printed signs have it
        near = int(_across(along, s[1] - a) < _across(along, s[0] - a))
        sign, shift = (1.0, s[0] - s[1]) if near else (-1.0, s[1] - s[0])
        ends = [a + shift, b + shift]
    level = _across(along, ends[0] - a)
    cuts = sorted(_cut(corners, heights, level), key=lambda point: float((point - a) @ along))
    if len(cuts) < 2:
        return None
    reach = [
        sorted(float((point - a) @ along) for point in pair) for pair in ((cuts[0], cuts[-1]), ends)
    ]
    if line3 and max(reach[0][0], reach[1][0]) > min(reach[0][1], reach[1][1]):
        return None  # the toucher cannot be on this edge
    ends = [
        end if _inside(corners, end) else cut
        for end, cut in zip(ends, (cuts[0], cuts[-1]), strict=True)
    ]
    left = [cuts[0], *corners[_below(heights, level, i - 1, -1, following)[::-1]], a]
    right = [b, *corners[_below(heights, level, i + 2, 1, i)], cuts[-1]]
    if line11:
        ends = ends[::-1]
    outline: Vector = (s[1] - s[0]) - sign * np.concatenate([left - ends[0], right - ends[1]])
    return outline


def _within(outline: Vector, points: Vector) -> NDArray[np.bool_]:
    """Return whether an outline encloses each point an odd number of times; bool, shape (n,)."""
    x, y = points.T
    found = np.zeros(len(points), dtype=np.bool_)
    for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        if y0 != y1:
            found ^= ((y0 > y) != (y1 > y)) & (x < (x1 - x0) * (y - y0) / (y1 - y0) + x0)
    return found


@erratum(
    "paper W, algorithm 2",
    "line 3 sets p'_i = s1 + s2 - p_i, where s1 and s2 are the positions of the particles and p_i"
    " is a corner of the polygon. Line 11 subtracts p'_i from the chain of corners [l_i ... p_i],"
    " and p'_i+1 from the chain of corners [p_i+1 ... l_i+1]",
    "line 3 must set p'_i = p_i + s_a - s_b, where s_b is the position of the particle nearer to"
    " the edge, and s_a is the position of the other particle. Line 11 must subtract p'_i+1 from"
    " the chain [l_i ... p_i], and p'_i from the chain [p_i+1 ... l_i+1]. Algorithm 2 must skip"
    " edges that the particle nearer to the edge cannot touch",
    "a program computes the overlap (intersection over union) of the set of differences from"
    " algorithm 2 and the exact set, in 4 polygons with 6 random starts each",
)
def _algorithm() -> tuple[str, bool]:
    from shoal.steering import open_workspace, polygon, polygon_reach, regular_polygon

    rng, ways = (
        np.random.default_rng(1),
        ((False, False), (True, False), (False, True), (True, True)),
    )
    shares: dict[tuple[bool, bool], list[float]] = {way: [] for way in ways}
    irregular = polygon([(0, 0), (1, 0), (1.2, 0.7), (0.3, 1)])
    for workspace in (open_workspace("square"), regular_polygon(3), regular_polygon(5), irregular):
        corners = workspace.vertices  # type: ignore[union-attr]  # polygons all
        space = workspace.differences  # type: ignore[union-attr]  # as above
        low, high = space.vertices.min(axis=0), space.vertices.max(axis=0)
        grid = np.stack(
            np.meshgrid(*(low + (np.arange(70)[:, None] + 0.5) / 70 * (high - low)).T), axis=-1
        ).reshape(-1, 2)
        grid = grid[space.depth(grid) > 0]
        for s in rng.dirichlet(np.ones(len(corners)), (6, 2)) @ corners:
            # a polygon
            exact = polygon_reach(workspace, s[1] - s[0], moves=2)[0].contains(grid)  # type: ignore[arg-type]
            for line3, line11 in ways:
                pieces = [
                    _piece(corners, i, s, line3=line3, line11=line11) for i in range(len(corners))
                ]
                told = np.any(
                    [_within(piece, grid) for piece in pieces if piece is not None]
                    or [np.zeros_like(exact)],
                    axis=0,
                )
                shares[line3, line11].append(float(np.sum(told & exact) / np.sum(told | exact)))
    names = (
        "as printed",
        "with line 3 corrected",
        "with line 11 corrected",
        "with both lines corrected",
    )
    words = [
        f"{100 * min(shares[w]):.0f} to {100 * max(shares[w]):.0f} % {name}"
        for name, w in zip(names, ways, strict=True)
    ]
    return "the overlap of the set from algorithm 2 with the exact set is " + ", ".join(words), min(
        shares[ways[3]]
    ) > 0.99 and all(np.mean(shares[way]) < 0.5 for way in ways[:3])
