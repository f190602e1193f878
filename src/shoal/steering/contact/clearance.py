"""Clearance: whether a plan reaches its goals in a world that differs slightly from the world in
which it was planned.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache
from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.steering.workspaces.convex import EXACT_TOUCH, TOUCH, ConvexWorkspace, Points
from shoal.steering.workspaces.region import Region

CLEARANCE = 1e-6  # relative to the size: default of the option ``clearance``
PLANNED = 2.5  # in clearances: distance that planners keep from all that must not be touched
# in clearances: contact tolerances with which a plan is replayed
STEPS = 0.003, 0.01, 0.03, 0.1, 0.3, 1.0
# relative to the size: errors of starts and moves, and number of patterns of such errors
ROUNDING, PATTERNS = (1e-12, 16)
# relative to the size: effect of such errors on the end of a plan that amplifies nothing
FORGIVEN = 1e-10
# relative to a move: slope below which a particle hardly leaves a wall; on a round wall, it meets
# the wall again
GRAZING = 1e-7
HELD = 1e-9  # relative to a move: slope up to which a wall holds a particle
# relative to a move: the same in one of the replays, in which a move along a wall does not hold
STRICT = -1e-12
_TURN, _SCALE = 0.7, 3.0  # angle and scale of the turned copy of a world
_SLACK = 1e-9  # relative to the tolerance: rounding in the turned copy


@dataclass(frozen=True, eq=False)
class _Copy:
    """A world in which a plan is replayed, and the matrix that turns and scales points and moves
    into this world.
    """

    world: Any
    matrix: NDArray[np.float64]

    @cached_property
    def scale(self) -> float:
        return float(np.linalg.norm(self.matrix[:, 0]))


@lru_cache(maxsize=64)
def _disturbed_worlds(world: Any, clearance: float) -> tuple[_Copy, ...]:
    """Return copies of a world with other contact tolerances, and two copies that are turned and
    scaled.

    The contact tolerances lie between 1e-12 of the workspace's size and ``clearance``. In one of
    the turned copies, a wall holds only particles that a move pushes into it: whether it holds a
    particle during a move along the wall, rounding errors decide.
    """
    d = world.workspace.dimensions
    touches = sorted(
        {EXACT_TOUCH, TOUCH} | {share * clearance for share in STEPS if share * clearance > TOUCH}
    )
    matrix = _SCALE * np.eye(d)
    matrix[:2, :2] = _SCALE * np.array([[cos(_TURN), -sin(_TURN)], [sin(_TURN), cos(_TURN)]])
    workspace = _transform(world.workspace, matrix)
    fields: dict[str, Any] = {"workspace": workspace}
    if getattr(world, "gradient", None) is not None:
        fields["gradient"] = matrix @ world.gradient / _SCALE**2
    if getattr(world, "radius", 0.0):
        fields["radius"] = _SCALE * world.radius
    rounded = replace(world, **fields)
    return (
        *(_Copy(replace(world, touch=touch), np.eye(d)) for touch in touches),
        _Copy(replace(rounded, pushed=STRICT), matrix),
        _Copy(replace(rounded, touch=touches[-1]), matrix),
    )


def _transform(workspace: Any, matrix: NDArray[np.float64]) -> Any:
    """Return a workspace whose corners are the products of ``matrix`` and the corners of
    ``workspace``.

    ``matrix`` is a rotation about the z axis, multiplied by a scale.
    """
    flat, scale = matrix[:2, :2], float(np.linalg.norm(matrix[:2, 0]))
    if isinstance(workspace, Region):
        return Region(
            workspace.outline @ flat.T, tuple(ring @ flat.T for ring in workspace.obstacles)
        )
    return ConvexWorkspace(
        workspace.kind,
        workspace.vertices @ flat.T,
        workspace.radius * scale,
        flat @ workspace.center,
        workspace.height * scale,
        workspace.open_ends,
    )


def why_sensitive(
    world: Any, start: Points, goal: Points, moves: Points, tolerance: float, clearance: float
) -> str | None:
    """Return why a plan reaches its goals only in exact arithmetic, or None if it also reaches them
    with every disturbance.

    The function replays the plan with several contact tolerances up to ``clearance`` times the size
    of the workspace, in a turned and scaled copy of the workspace, and with small errors of the
    starts and of all moves. In convex workspaces without friction, it also measures the slopes at
    which particles leave walls. Around obstacles, it measures how near the particles come to
    corners with more than 180 degrees of free space, which a slightly different path would not
    pass.
    """
    if not clearance:
        return None
    size = float(world.workspace.size)
    for copy in _disturbed_worlds(world, clearance):
        scale = copy.scale
        end = copy.world.final(start @ copy.matrix.T, moves @ copy.matrix.T) / scale
        error = float(_distances(end, goal @ copy.matrix.T / scale).max())
        if error > tolerance * (1 + _SLACK) + 1e-15 * size:
            how = (
                "in turned coordinates"
                + (", where a move along a wall leaves it," if copy.world.pushed < 0 else "")
                if scale != 1
                else f"with a contact tolerance of {copy.world.touch:.2g} of the size"
            )
            return f"{how} it ends {error:.3g} from the goals"
    shifts = _roundings(len(moves) + len(start), start.shape[1]) * size
    ends = world.finals(start + shifts[:, : len(start)], moves + shifts[:, len(start) :])
    errors = _distances(ends, goal).max(axis=1)
    for error in errors[errors > tolerance + FORGIVEN * size][:1]:
        return (
            f"with moves that differ by {ROUNDING:.0e} of the size it ends {error:.3g} from the"
            " goals"
        )
    if isinstance(world.workspace, ConvexWorkspace) and world.friction == np.inf:
        slope = _least_slope(world, start, moves)
        if slope < GRAZING:
            return f"a particle leaves a wall with a slope of only {slope:.2g}"
    if isinstance(world.workspace, Region):
        near = _least_passage(world, start, goal, moves, clearance * size)
        if near < clearance * size:
            return (
                f"a particle passes a corner at {near:.2g}, nearer than the clearance of"
                f" {clearance * size:.2g}"
            )
    return None


@lru_cache(maxsize=64)
def _roundings(rows: int, d: int) -> NDArray[np.float64]:
    """Return patterns of random errors, float64, shape (PATTERNS, rows, d), relative to the size of
    the workspace.
    """
    rng = np.random.default_rng(rows)
    return np.array([ROUNDING * rng.choice([-1.0, 1.0], size=(rows, d)) for _ in range(PATTERNS)])


def _distances(points: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distances of points, as `numpy.linalg.norm` does, but in half its time."""
    apart = points - targets
    distances: NDArray[np.float64] = np.sqrt((apart * apart).sum(axis=-1))
    return distances


def _least_slope(world: Any, start: Points, moves: Points) -> float:
    """Return the smallest slope at which a move leads a particle off a wall that it touches.

    The slope is the component of the move along the inward normal of the wall, divided by the
    length of the move. The result is infinite if no particle leaves a wall.
    """
    workspace = world.free_space
    state, least = np.array(start, dtype=np.float64, order="C"), float("inf")
    for move in np.ascontiguousarray(moves, dtype=np.float64):
        slopes = np.tile(workspace.normals @ move, (len(state), 1))
        near = workspace.wall_distances(state) <= TOUCH * workspace.size
        if workspace.round:
            flat = workspace.center - state[:, :2]
            slopes = np.column_stack(
                [slopes, flat @ move[:2] / np.maximum(np.hypot(*flat.T), 1e-300)]
            )
            near = np.column_stack(
                [near, workspace.circle_distance(state) <= TOUCH * workspace.size]
            )
        slopes = slopes / max(float(np.linalg.norm(move)), 1e-300)
        if near.any():
            lowest = np.where(near, slopes, np.inf).min(axis=1)
            leaving = lowest[lowest > HELD]
            least = min(least, float(leaving.min())) if len(leaving) else least
        state = world.advance(state, move)
    return least


def _least_passage(world: Any, start: Points, goal: Points, moves: Points, near: float) -> float:
    """Return the smallest distance between a particle's path and a corner with more than 180
    degrees of free space.

    Corners within ``near`` of the start or the goal of a particle do not count for this particle.
    The result is infinite if the region has no such corner.
    """
    edges = world.edges
    corners = edges.ends[edges.reflex, :2]
    if not len(corners) or not len(moves):
        return float("inf")
    states = [np.array(start, dtype=np.float64, order="C")]
    for move in np.ascontiguousarray(moves):
        states.append(world.advance(states[-1].copy(), move))
    path = np.array(states)
    least = float("inf")
    for particle in range(path.shape[1]):
        ends = np.stack([start[particle], goal[particle]])
        far = (np.linalg.norm(corners[:, None] - ends[None], axis=2) > near).all(axis=1)
        if not far.any():
            continue
        before, along = path[:-1, None, particle], np.diff(path[:, particle], axis=0)[:, None]
        square = np.maximum((along * along).sum(axis=2), 1e-300)
        share = np.clip(((corners[far] - before) * along).sum(axis=2) / square, 0, 1)
        away = np.linalg.norm(before + share[..., None] * along - corners[far], axis=2)
        least = min(least, float(away.min()))
    return least
