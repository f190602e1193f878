"""Plans with a given number of straight moves: simulated trials give the first moves, and formulas give the last two moves."""

from __future__ import annotations

from math import inf

import numpy as np

from shoal.steering.contact.clearance import PLANNED
from shoal.steering.kernels import shooting
from shoal.steering.kernels.contact import Walls
from shoal.steering.planners.task import SteeringTask, path_length
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.normalized_walls import normalize_walls

SHARES = np.array([0.0, 0.02, 0.06, 0.12, 0.2, 0.3, 0.42, 0.55, 0.7, 0.85, 0.97, 1.0])
DIRECTIONS = {2: 180, 3: 900}
DENSE = 4  # factor for the number of directions, if the first directions give no plan of three moves in the plane
NUDGE = 1e-6  # of the size, at least
NARROW = 1e-8  # of the size: distance of the other particle from walls without a clearance
REPAIRS = {4: (400, 10), 5: (400, 10), 6: (250, 10)}  # for plans of each number of moves: attempts, and random plans per attempt
PARTS = 20  # order of the attempts if time is limited
ENOUGH = 4  # number of plans of which the shortest is used
_ALL = 1_000_000


def shooting_plan(task: SteeringTask, count: int) -> Points | None:
    """Return a plan of ``count`` moves (2 to 6), float64 of shape (count, d), or None if the simulations find no plan."""
    walls = normalize_walls(task.world.room)
    d = walls.dimensions
    start, goal = walls.normalized(task.start), walls.normalized(task.aim)
    between = Walls(walls.normals, walls.offsets, walls.circle, 1.0, float(task.world.friction), np.eye(d + 1)[0])
    clear = max(PLANNED * task.margin, NARROW)
    if count == 2:
        two = _of_two(start, goal, between, clear)
        return None if two is None else two * walls.scale
    nudges = max(NUDGE, clear) * np.vstack([np.eye(d), -np.eye(d)])
    moves = np.zeros((count, d))
    if count == 3:
        found = shooting.search(start, goal, directions(d, DIRECTIONS[d]), SHARES, nudges, _ALL, between, clear, moves)
        if not found and d == 2:
            found = shooting.search(start, goal, directions(d, DENSE * DIRECTIONS[d]), SHARES, nudges, 1, between, clear, moves)
    else:
        picks = np.random.default_rng(0).integers(0, 2**31, (*REPAIRS[count], count - 2, 2))
        dense = directions(d, DENSE * DIRECTIONS[d])
        found = 0
        for some in [picks] if task.deadline == inf else np.array_split(picks, PARTS):
            if found == 0 and not task.late:
                found = shooting.search_guided(start, goal, dense, SHARES, some, nudges, ENOUGH, between, clear, moves)
    if not found:
        return None
    shooting.improve(start, goal, count - 2, 0.05, nudges, between, clear, moves)
    return moves * walls.scale


def _of_two(start: Points, goal: Points, between: Walls, clear: float) -> Points | None:
    """Return the shorter of the two possible plans with two moves (one plan for each touching particle), or None."""
    found = []
    for toucher in (0, 1):
        two = np.zeros_like(start)
        error = shooting.finish(start, goal, toucher, between, clear, two)
        if error <= shooting.EXACT:
            found.append(two)
    return min(found, key=path_length, default=None)


def directions(d: int, count: int) -> Points:
    """Return ``count`` unit vectors with evenly distributed directions in ``d`` dimensions."""
    if d == 2:
        angles = 2 * np.pi * (np.arange(count) + 0.5) / count
        return np.stack([np.cos(angles), np.sin(angles)], axis=1)
    turns, heights = np.arange(count) * np.pi * (3 - np.sqrt(5)), 1 - (2 * np.arange(count) + 1) / count  # a golden spiral
    flat = np.sqrt(1 - heights**2)
    return np.stack([flat * np.cos(turns), flat * np.sin(turns), heights], axis=1)
