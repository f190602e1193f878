"""Wall release: a small move of a particle off a wall, before a translation that the wall would block."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from shoal.steering.contact.clearance import PLANNED
from shoal.steering.workspaces.base import TOUCH
from shoal.steering.workspaces.convex import ConvexWorkspace
from shoal.steering.workspaces.convex_geometry import Points

# relative to the size: lengths of a lift if there is no room for the clearance; the first length that takes no particle into
# another wall is used
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


def is_released(workspace: ConvexWorkspace, points: Points, move: Points, *, clearance: float = 0.0) -> bool:
    """Return whether a move leads each particle away from all walls that the particle touches, with a safety margin.

    Walls within ``clearance`` times the size count as touched, so that the move does not depend on the contact tolerance.
    """
    length, within = float(np.linalg.norm(move)), max(2 * TOUCH, 1.25 * clearance)
    slope = max(RELEASED, 2 * clearance)
    return all((touched_normals(workspace, point, within=within) @ move > slope * length).all() for point in points)


def released_translation(
    workspace: ConvexWorkspace, points: Points, move: Points, *, clearance: float = 0.0, least: float = 0.0
) -> list[Points] | None:
    """Return one or two moves that together translate all particles by ``move``, or None if walls prevent the translation.

    If a wall blocks the direct move, the function returns a small move off the walls and the rest of the translation. After the
    small move, all particles are farther from the walls than ``clearance`` times the size, where there is room for that. If
    there is room, the small move has a length of at least ``least`` times the size.
    """
    if is_released(workspace, points, move, clearance=clearance):
        return [move]
    lift = _lift_off(workspace, points, clearance=clearance, least=least)
    return None if lift is None else [lift, move - lift]


def _lift_off(
    workspace: ConvexWorkspace,
    points: Points,
    others: Points | None = None,
    *,
    clearance: float = 0.0,
    least: float = 0.0,
) -> Points | None:
    """Return a small move off all walls that the particles at ``points`` touch, or None if no direction leads off all of them.

    The move also has a positive component along each row of ``others``.
    """
    if least > PLANNED * clearance > 0:
        rows = np.vstack([touched_normals(workspace, point, within=1.5 * least) for point in points])
        away = direction_away_from(rows if others is None else np.vstack([rows, others]))
        if away is not None and (not len(rows) or least * float((rows @ away).min()) >= PLANNED * clearance):
            return np.asarray(least * workspace.size * away)
    length = PLANNED * clearance
    for _longer in range(4 if clearance else 0):
        rows = np.vstack([touched_normals(workspace, point, within=1.5 * length) for point in points])
        away = direction_away_from(rows if others is None else np.vstack([rows, others]))
        if away is None:
            break
        needed = PLANNED * clearance / float((rows @ away).min()) if len(rows) else length
        if length >= needed * (1 - 1e-9):
            return np.asarray(length * workspace.size * away)
        length = needed
    for length in RELEASE_LENGTHS:
        rows = np.vstack([touched_normals(workspace, point, within=1.5 * length) for point in points])
        away = direction_away_from(rows if others is None else np.vstack([rows, others]))
        if away is not None:
            return np.asarray(length * workspace.size * away)
    return None


def separations(workspace: ConvexWorkspace, points: Points, *, clearance: float = 0.0) -> list[tuple[Points, Points]]:
    """Return pairs (move, later positions): each move takes one particle off its walls while a wall holds the other particle.

    A planner needs a small move of one particle alone if no translation leads both particles off their walls, for example if the
    particles touch opposite walls.
    """
    found = []
    for held in (0, 1):
        for wall in touched_normals(workspace, points[held]):
            away = _lift_off(workspace, points[1 - held : 2 - held], -wall[None], clearance=clearance)
            if away is not None:
                after = points.copy()
                after[1 - held] += away
                found.append((away, after))
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
