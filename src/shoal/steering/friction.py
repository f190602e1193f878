"""What friction that gives way can never do: gauges of Δ that no wall lets grow.

A wall acts on a particle by a reaction inside of the friction cone around its inward normal N. So whatever both particles touch,
Δ changes by reactions on particle 2 less those on particle 1, and a gauge of Δ that no single reaction can raise never grows.
"""

from __future__ import annotations

from math import inf

import numpy as np

from shoal.steering.outline import Points, hull
from shoal.steering.workspace import ConvexWorkspace

_SLACK = 1e-12


def friction_limit(workspace: ConvexWorkspace, friction: float, before: Points, after: Points) -> str | None:
    """Return why friction keeps one difference from becoming another, None if it may not.

    On a disk of radius r: where |Δ| >= 2 r sin(atan μ), the other particle lies too far around the circle for a reaction at the
    toucher to have a part along Δ; so |Δ| never rises above the larger of that and what it was. On a polygon: the gauges whose
    unit balls have the walls' normals as normals of their sides, or as corners, if no reaction raises them.
    """
    if friction == inf or workspace.dimensions == 3:
        return None
    if workspace.round:
        most = max(float(np.hypot(*before)), 2 * workspace.radius * float(np.sin(np.arctan(friction))))
        if float(np.hypot(*after)) > most:
            return (
                f"with friction {friction:g} the particles on this disk cannot come further apart than {most:.6g}, "
                f"and the goals are {float(np.hypot(*after)):.6g} apart"
            )
        return None
    both = np.vstack([workspace.normals, -workspace.normals])
    balls = [both, _sides_of_hull(both)]
    if len(workspace.normals) == 4 and 0 < friction <= 1:
        # On a rectangle all gauges |Δx| + k |Δy| with friction <= k <= 1 / friction, of which the outer two say most.
        balls += [_sides_of_hull(both * np.tile([[weight], [1.0]], (4, 1))) for weight in (friction, 1 / friction)]
    for sides in balls:
        if _never_grows(sides, workspace.normals, friction):
            low, high = float((sides @ before).max()), float((sides @ after).max())
            if high > low:
                return (
                    f"with friction {friction:g} no wall of this polygon lets the difference of the particles grow, "
                    f"in the gauge of its normals, and it would have to by a factor of {high / max(low, 1e-300):.6g}"
                )
    return None


def _sides_of_hull(points: Points) -> Points:
    """Return vectors n such that the hull of points is where all n @ p <= 1."""
    corners = hull(points)
    following = np.roll(corners, -1, axis=0)
    return np.array([np.linalg.solve(np.stack([one, other]), np.ones(2)) for one, other in zip(corners, following, strict=True)])


def _never_grows(sides: Points, normals: Points, friction: float) -> bool:
    """Tell whether no reaction of any wall raises the gauge max(sides @ Δ), wherever on its unit ball Δ lies."""
    order = np.argsort(np.arctan2(sides[:, 1], sides[:, 0]))
    sides = sides[order]
    kept = np.any(np.abs(sides - np.roll(sides, 1, axis=0)) > _SLACK, axis=1)
    sides = sides[kept]
    corners = np.array(
        [np.linalg.solve(np.stack([one, other]), np.ones(2)) for one, other in zip(sides, np.roll(sides, -1, axis=0), strict=True)]
    )
    if (corners @ sides.T > 1 + 1e-9).any():
        return False  # a side that is none: too steep to use
    for k, side in enumerate(sides):
        ends = np.stack([corners[k - 1], corners[k]])
        for normal in np.vstack([normals, -normals]):  # toucher 1, toucher 2
            if (ends @ normal).max() <= _SLACK:
                continue
            along = np.array([-normal[1], normal[0]])
            if any(side @ (-normal + tilt * along) > _SLACK for tilt in (-friction, friction)):
                return False
    return True
