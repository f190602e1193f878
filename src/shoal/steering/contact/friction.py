"""Friction: proofs that walls do not allow a change of the particles' difference."""

from __future__ import annotations

from math import inf

import numpy as np

from shoal.core.geometry import angles_of, left_of, unit_vectors
from shoal.steering.kernels.cycles import is_kept_out
from shoal.steering.workspaces.convex import ConvexWorkspace, Points, hull
from shoal.steering.workspaces.walls import normalize_walls

_SLACK = 1e-12
_ROUNDING = 1e-6  # relative to |Δ|, and in radians: rounding error of sums over many steps
_SAME_ANGLE = 1e-9
_ANGLES = 3000  # number of corners of a barrier


def friction_limit(
    workspace: ConvexWorkspace, friction: float, before: Points, after: Points, *, near: float = 0.0
) -> str | None:
    """Return why friction prevents a change of the position difference from ``before`` to
    ``after``, or None if no proof is found.

    A plan is successful if it brings the position difference within the distance ``near`` of
    ``after``.

    On a disk of radius r, the distance of two particles never exceeds the maximum of the initial
    distance and 2 r sin(atan μ). The number μ is the friction coefficient. If two particles are
    farther apart than 2 r sin(atan μ), each rotation of their position difference shortens their
    distance.

    On a polygon, the function tries several gauges, and then a barrier (a closed curve that the
    position difference cannot cross). A gauge is a length whose unit ball is a convex polygon. The
    first gauge of a position difference Δ is the largest |N·Δ| for all unit normals N of the walls.
    The unit ball of the second gauge is the convex hull of all vectors N and -N. For polygons with
    four sides and friction coefficients up to 1, the function uses two more gauges. The function
    ignores each gauge that a wall reaction can increase.
    """
    if friction == inf or workspace.dimensions == 3:
        return None
    size = float(np.hypot(*after))
    if size <= near:
        return None
    least = after * (1 - near / size)
    if workspace.round:
        return _limit_on_disk(workspace, friction, before, least, float(np.arcsin(near / size)))
    return _limit_of_gauges(workspace, friction, before, least) or _limit_of_barrier(
        workspace, friction, before, after, near
    )


def _limit_on_disk(
    workspace: ConvexWorkspace, friction: float, before: Points, after: Points, wide: float
) -> str | None:
    """Return why friction on a disk prevents a change of the position difference from ``before`` to
    ``after``, or None.

    ``wide`` is the allowed error of the direction of ``after``, in radians.
    """
    large, small, cone = (
        float(np.hypot(*before)),
        float(np.hypot(*after)),
        float(np.arctan(friction)),
    )
    most = max(large, 2 * workspace.radius * float(np.sin(cone)))
    if small > most:
        return (
            f"with friction {friction:g} the particles on this disk cannot move farther apart than"
            f" {most:.6g}, and the goals are {small:.6g} apart"
        )
    turn = float(np.arctan2(after[1], after[0]) - np.arctan2(before[1], before[0]))
    turn = abs((turn + np.pi) % (2 * np.pi) - np.pi) - wide
    possible = largest_turn(large, small, workspace.radius, cone)
    if turn > possible + _ROUNDING:
        return (
            f"with friction {friction:g} the difference of the particles on this disk can turn by"
            f" at most {possible:.6g} rad while it shrinks from {large:.6g} to {small:.6g}, and the"
            f" goals need {turn:.6g} rad"
        )
    return None


def largest_turn(large: float, small: float, radius: float, cone: float) -> float:
    """Return the largest turn, in radians, of a position difference while its length shrinks from
    ``large`` to ``small``.

    Both particles are on a disk of radius r (the argument ``radius``). The half-angle of the
    friction cone is ψ (the argument ``cone``), in radians. Wall reactions at the edge of the
    friction cone give the largest turn. Let 2 r cos φ be the length of the position difference.
    While φ grows by dφ, the position difference turns by tan(φ + ψ) tan φ dφ. The function returns
    the integral of this turn in closed form. The result is infinite if ``small`` is at most 2 r sin
    ψ, because a position difference of the length 2 r sin ψ can turn without shrinking.
    """
    first, last = (float(np.arccos(min(1.0, size / (2 * radius)))) for size in (large, small))
    if last + cone >= np.pi / 2:
        return float("inf")
    if cone < 1e-6:
        return float(np.tan(last) - np.tan(first) - last + first)
    rise = np.log(np.cos(last) / np.cos(last + cone)) - np.log(np.cos(first) / np.cos(first + cone))
    return float(rise / np.tan(cone) - last + first)


def _limit_of_gauges(
    workspace: ConvexWorkspace, friction: float, before: Points, after: Points
) -> str | None:
    """Return why a gauge prevents a change from ``before`` to ``after``, or None if no gauge
    prevents it; see `friction_limit`.
    """
    signed_normals = np.vstack([workspace.normals, -workspace.normals])
    balls = [signed_normals, _sides_of_hull(signed_normals)]
    if len(workspace.normals) == 4 and 0 < friction <= 1:
        # Four walls may form a rectangle along the axes. Then all gauges |Δx| + k |Δy| with
        # friction <= k <= 1 / friction are valid, and the two extreme values of k are the
        # strongest. For other walls, the test below rejects invalid gauges.
        balls += [
            _sides_of_hull(signed_normals * np.tile([[weight], [1.0]], (4, 1)))
            for weight in (friction, 1 / friction)
        ]
    for sides in balls:
        if _never_grows(sides, workspace.normals, friction):
            low, high = float((sides @ before).max()), float((sides @ after).max())
            if high > low:
                return (
                    f"with friction {friction:g} no wall of this polygon can increase the"
                    " difference of the particles, in the gauge of its normals, and the goals need"
                    f" a factor of {high / max(low, 1e-300):.6g}"
                )
    return None


def _limit_of_barrier(
    workspace: ConvexWorkspace, friction: float, before: Points, after: Points, near: float
) -> str | None:
    """Return why a barrier around ``before`` excludes all position differences near ``after``, or
    None if it does not.
    """
    walls = normalize_walls(workspace)
    large, size = float(np.hypot(*before)), float(np.hypot(*after))
    directions = np.arctan2(walls.normals[:, 1], walls.normals[:, 0]) + np.pi / 2
    begin = float(np.arctan2(before[1], before[0])) % (2 * np.pi)
    angles = np.concatenate(
        [directions, directions + np.pi, 2 * np.pi * np.arange(_ANGLES) / _ANGLES, [begin]]
    ) % (2 * np.pi)
    angles = np.unique(angles)
    angles = angles[np.append(np.diff(angles) > _SAME_ANGLE, True)]
    rays = unit_vectors(angles)
    corners = workspace.differences.vertices
    edges = np.roll(corners, -1, axis=0) - corners
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    with np.errstate(divide="ignore"):
        rates = 1 / np.maximum(rays @ outward.T, 0.0)
    farthest = (np.sum(outward * corners, axis=1) * rates).min(axis=1) * (1 + _SLACK)
    goal, wide = (
        float(np.arctan2(after[1], after[0])) % (2 * np.pi),
        float(np.arcsin(min(1.0, near / size))),
    )
    outside = is_kept_out(
        int(np.argmin(np.abs(angles - begin))),
        large / walls.scale * (1 + _SLACK),
        angles,
        farthest / walls.scale,
        walls.cycle_model(float(friction), 0.0, 0.0),
        int(np.searchsorted(angles, goal - wide)) - 1,
        int(np.searchsorted(angles, goal + wide)),
        (size - near) / walls.scale * (1 - _ROUNDING),
    )
    if outside:
        return (
            f"with friction {friction:g} the reactions of this polygon's walls cannot change the"
            f" difference of the particles from ({before[0]:.6g}, {before[1]:.6g}) to a value near"
            f" ({after[0]:.6g}, {after[1]:.6g})"
        )
    return None


def _sides_of_hull(points: Points) -> Points:
    """Return vectors n such that the convex hull of ``points`` consists of all points p with n @ p
    <= 1 for every vector n.
    """
    return _duals(hull(points))


def _duals(rows: Points) -> Points:
    """Return, for each row, the vector whose scalar products with this row and with the next row
    are 1; float64, shape (n, 2).
    """
    pairs = np.stack([rows, np.roll(rows, -1, axis=0)], axis=1)
    return np.asarray(np.linalg.solve(pairs, np.ones((len(rows), 2, 1)))[..., 0])


def _never_grows(sides: Points, normals: Points, friction: float) -> bool:
    """Return whether no wall reaction can increase the gauge max(sides @ Δ) of any position
    difference Δ.
    """
    order = np.argsort(angles_of(sides))
    sides = sides[order]
    distinct = np.any(np.abs(sides - np.roll(sides, 1, axis=0)) > _SLACK, axis=1)
    sides = sides[distinct]
    corners = _duals(sides)
    if (corners @ sides.T > 1 + 1e-9).any():
        return False  # a degenerate side, too steep to use
    for k, side in enumerate(sides):
        ends = np.stack([corners[k - 1], corners[k]])
        for normal in np.vstack([normals, -normals]):  # toucher 1, toucher 2
            if (ends @ normal).max() <= _SLACK:
                continue
            along = left_of(normal)
            if any(side @ (-normal + tilt * along) > _SLACK for tilt in (-friction, friction)):
                return False
    return True
