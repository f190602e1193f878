"""The least number of straight moves that is found."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from shoal.steering.chains import shortest_chain
from shoal.steering.heights import flattened, with_heights
from shoal.steering.kernels import plays
from shoal.steering.outline import Points
from shoal.steering.planners.base import PLANNERS
from shoal.steering.planners.shortest import Shortest, path_length
from shoal.steering.task import Task, never
from shoal.steering.walls import walls_of

SHARES = np.array([0.0, 0.02, 0.06, 0.12, 0.2, 0.3, 0.42, 0.55, 0.7, 0.85, 0.97, 1.0])
DIRECTIONS = {2: 180, 3: 900}
NUDGE = 1e-6  # of the size
DENSE = 4  # times as many directions, where the first ones give no plan of three moves in the plane
TRIED = {2: (240, 96), 3: (24, 32)}  # first moves and directions of the last one, for plans of four moves and of five


@PLANNERS.register("fewest-moves")
class FewestMoves:
    """The plan of the least number of straight moves that a search finds; of those with as many the shortest it meets.

    A chain of m contacts takes 2 m + 1 moves. A straight move that goes on after a contact makes contact and adjustment at once, so
    fewer will often do. Plans of three moves are tried in many directions and lengths, of four and five at random ones; the plans
    of chains are compared with them.
    """

    name = "fewest-moves"
    prefers = "moves"

    def plan(self, task: Task) -> Points | None:
        """Return moves; see `Planner`."""
        best: Points | None = None
        chains = self._chains(task)
        if task.world.room.dimensions == 3:
            chains = _fewer(chains, self._raised(task))
        most = inf if chains is None else len(chains)
        for count in (2, 3, 4, 5):
            if count >= most and not (count == most == 3):
                break
            found = _played(task, count)
            if found is not None:
                best = found
                break
        if best is None and chains is not None:
            best = _finished(task, chains)
        return _fewer(best, chains)

    def _raised(self, task: Task) -> Points | None:
        """Return the plan of the plane with heights."""
        below = flattened(task)
        flat = below.straight() if never(below) is None else None
        if flat is None and never(below) is None:
            flat = self.plan(below)
        return None if flat is None else with_heights(task, flat)

    def _chains(self, task: Task) -> Points | None:
        """Return the plan of the chain with the fewest cycles."""
        best = None
        for first, state in task.departures():
            errand = task.errand(start=state)
            chain = shortest_chain(errand, first_found=True)
            moves = None if chain is None else task.moves_of(chain, errand)
            if moves is not None and (best is None or len(first) + len(moves) < len(best)):
                best = np.array([*first, *moves])
        return Shortest().plan(task) if best is None else best


def _finished(task: Task, plan: Points) -> Points | None:
    """Return the beginning of a plan, as short as can be, with three moves that finish it; None if none do before its own end."""
    states = task.world.play(task.start, plan)
    for begun in range(1, len(plan) - 3):
        last = _played(replace(task, start=states[begun]), 3)
        if last is not None:
            whole = np.concatenate([plan[:begun], last])
            if task.error(task.world.play(task.start, whole)[-1]) <= task.tolerance:
                return whole
    return None


def _fewer(one: Points | None, other: Points | None) -> Points | None:
    """Return the plan of fewer moves, the shorter of two with as many."""
    if one is None or other is None:
        return other if one is None else one
    return min(one, other, key=lambda moves: (len(moves), path_length(moves)))


def _played(task: Task, count: int) -> Points | None:
    """Return a plan of so many moves that was found by playing, None if there was none."""
    walls = walls_of(task.world.room)
    d = walls.dimensions
    start, goal = walls.inward(task.start), walls.inward(task.aim)
    world = (walls.normals, walls.offsets, walls.circle, 1.0, float(task.world.friction), np.eye(d + 1)[0])
    nudges = NUDGE * np.vstack([np.eye(d), -np.eye(d)])
    tried = count - 2
    moves = np.zeros((count, d))
    if tried == 0:
        lengths = []
        for toucher in (0, 1):
            two = np.zeros((2, d))
            if plays.finish(start, goal, toucher, *world, two) <= plays.EXACT:
                lengths.append((path_length(two), two))
        return None if not lengths else min(lengths, key=lambda entry: entry[0])[1] * walls.scale
    rng = np.random.default_rng(0)
    directions = _directions(d, DIRECTIONS[d])
    picks: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
    enough = 1_000_000
    if tried > 1:
        firsts, ways = TRIED[tried]
        directions = directions[rng.permutation(len(directions))[:ways]]
        picks = rng.permutation(len(directions) * len(SHARES))[:firsts]
        enough = 6
    spare = np.zeros((count, d))
    length, found = plays.search(start, goal, tried, directions, SHARES, nudges, enough, picks, *world, spare, moves)
    if not found and tried == 1 and d == 2:
        directions = _directions(d, DENSE * DIRECTIONS[d])
        length, found = plays.search(start, goal, tried, directions, SHARES, nudges, 1, picks, *world, spare, moves)
    if not found:
        return None
    plays.improve(start, goal, tried, 0.05, nudges, *world, moves)
    return moves * walls.scale if length < inf else None


def _directions(d: int, count: int) -> Points:
    """Return unit vectors all around."""
    if d == 2:
        angles = 2 * np.pi * (np.arange(count) + 0.5) / count
        return np.stack([np.cos(angles), np.sin(angles)], axis=1)
    turns, heights = np.arange(count) * np.pi * (3 - np.sqrt(5)), 1 - (2 * np.arange(count) + 1) / count  # a golden spiral
    flat = np.sqrt(1 - heights**2)
    return np.stack([flat * np.cos(turns), flat * np.sin(turns), heights], axis=1)
