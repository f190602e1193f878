"""Wall release: a small move of a particle off a wall, before a translation that the wall would block."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from shoal.steering.workspaces.base import TOUCH
from shoal.steering.workspaces.convex import ConvexWorkspace
from shoal.steering.workspaces.convex_geometry import Points

# relative to the size: lengths of a lift; the first length that takes no particle into another wall is used
RELEASE_LENGTHS = (1e-6, 1e-7, 2e-8)
RELEASED = 5e-9  # relative to a move's length: minimum distance away from a wall for a safe release
_STEEP = 0.01  # minimum slope of a lift


def touched_normals(workspace: ConvexWorkspace, point: Points, *, within: float = 2 * TOUCH) -> Points:
    """Return the inward unit normals of the walls near a particle at ``point``; float64, shape (walls, d).

    A wall is near if its distance from the particle is at most ``within`` times the workspace's size.
    """
    near = within * workspace.size
    normals = workspace.normals[workspace.wall_distances(point) <= near]
    if workspace.round and float(workspace.circle_distance(point)) <= near:
        inward = np.zeros(len(point))
        inward[:2] = workspace.center - point[:2]
        normals = np.vstack([normals, inward / np.linalg.norm(inward)])
    return normals


def is_released(workspace: ConvexWorkspace, points: Points, move: Points) -> bool:
    """Return whether a move leads each particle away from all walls that the particle touches, with a safety margin."""
    length = float(np.linalg.norm(move))
    return all((touched_normals(workspace, point) @ move > RELEASED * length).all() for point in points)


def released_translation(workspace: ConvexWorkspace, points: Points, move: Points) -> list[Points] | None:
    """Return one or two moves that together translate all particles by ``move``, or None if walls prevent the translation.

    If a wall blocks the direct move, the function returns a small move off the walls and the rest of the translation.
    """
    if is_released(workspace, points, move):
        return [move]
    for length in RELEASE_LENGTHS:
        away = direction_away_from(np.vstack([touched_normals(workspace, point, within=1.5 * length) for point in points]))
        if away is not None:
            lift = length * workspace.size * away
            return [lift, move - lift]
    return None


def separations(workspace: ConvexWorkspace, points: Points) -> list[tuple[Points, Points]]:
    """Return pairs (move, later positions): each move takes one particle off its walls while a wall holds the other particle.

    A planner needs a small move of one particle alone if no translation leads both particles off their walls, for example if the
    particles touch opposite walls.
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
    """Return the unit vector whose smallest scalar product with the unit vectors ``rows`` is as large as possible.

    The result is None if no unit vector has a scalar product above 0.01 with every row. In d dimensions, the best vector is a
    linear combination of at most d rows, so the function tries all sets of up to d rows.
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
