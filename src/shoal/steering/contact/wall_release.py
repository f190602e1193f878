"""Wall release: the small moves off walls without which a translation that starts on a wall would be held."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from shoal.steering.workspaces.convex import TOUCH, ConvexWorkspace
from shoal.steering.workspaces.convex_geometry import Points

RELEASE_LENGTHS = (1e-6, 1e-7, 2e-8)  # of the size: lengths of a lift, the first that takes no particle into another wall
RELEASED = 5e-9  # of a move's length: what it must go away from a wall to be sure of not being held
_STEEP = 0.01  # least slope of a lift


def touched_normals(workspace: ConvexWorkspace, point: Points, *, within: float = 2 * TOUCH) -> Points:
    """Return the inward normals of the walls that a particle is on, or within a part of the size; float64, shape (walls, d)."""
    near = within * workspace.size
    normals = workspace.normals[workspace.wall_distances(point) <= near]
    if workspace.round and float(workspace.circle_distance(point)) <= near:
        inward = np.zeros(len(point))
        inward[:2] = workspace.center - point[:2]
        normals = np.vstack([normals, inward / np.linalg.norm(inward)])
    return normals


def is_released(workspace: ConvexWorkspace, points: Points, move: Points) -> bool:
    """Tell whether no wall holds any particle against a move, with room to spare."""
    length = float(np.linalg.norm(move))
    return all((touched_normals(workspace, point) @ move > RELEASED * length).all() for point in points)


def released_translation(workspace: ConvexWorkspace, points: Points, move: Points) -> list[Points] | None:
    """Return moves that translate all particles as one does: it alone, or a lift off the walls first; None if no move lifts all."""
    if is_released(workspace, points, move):
        return [move]
    for length in RELEASE_LENGTHS:
        away = direction_away_from(np.vstack([touched_normals(workspace, point, within=1.5 * length) for point in points]))
        if away is not None:
            lift = length * workspace.size * away
            return [lift, move - lift]
    return None


def separations(workspace: ConvexWorkspace, points: Points) -> list[tuple[Points, Points]]:
    """Return small moves, each with the state after it, that take one particle off its walls while another one is held.

    For states in which no move lifts both, as on opposite walls.
    """
    found = []
    for held in (0, 1):
        for wall in touched_normals(workspace, points[held]):
            for length in RELEASE_LENGTHS:
                away = direction_away_from(
                    np.vstack([touched_normals(workspace, points[1 - held], within=1.5 * length), -wall[None]])
                )
                if away is not None:
                    after = points.copy()
                    after[1 - held] += length * workspace.size * away
                    found.append((length * workspace.size * away, after))
                    break
    return found


def direction_away_from(rows: Points) -> Points | None:
    """Return the unit vector whose products with all given unit vectors are largest at the least; None if one is hardly positive.

    It has the same product with a few of them, at most one for each dimension, and lies in their span.
    """
    d = rows.shape[1]
    if not len(rows):
        return np.asarray(np.eye(d)[0])
    best, most = None, _STEEP
    for count in range(1, min(d, len(rows)) + 1):
        for some in combinations(rows, count):
            vector = np.linalg.lstsq(np.array(some), np.ones(count), rcond=None)[0]
            length = float(np.linalg.norm(vector))
            least = float((rows @ vector).min()) / length if length > 0 else 0.0
            if least > most * (1 + 1e-12):
                best, most = vector / length, least
    return best
