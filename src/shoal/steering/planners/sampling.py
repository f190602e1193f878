"""Planner sampling: random search for regions with obstacles and for more than two particles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.steering.contact.region_world import RegionWorld
from shoal.steering.contact.world import ContactWorld
from shoal.steering.kernels import sampling as kernels
from shoal.steering.kernels.contact import Walls
from shoal.steering.kernels.region_contact import Edges
from shoal.steering.planners.protocol import PLANNERS
from shoal.steering.planners.shortening import Shortening
from shoal.steering.planners.task import SteeringTask, path_length
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.region import Region

NODES = 60_000  # maximum number of nodes of one tree
ROUNDS = 80_000  # maximum number of manoeuvres tried in one tree
STRETCH = 5000  # manoeuvres between two checks of the time
TREES = 10  # maximum number of trees until one reaches the goal
MORE_ROUNDS = 10_000  # nodes of each further tree, which may contain a shorter plan
MORE_TREES, FEW_TREES = 39, 8  # fewer for more particles and with sliding
SLIDING = 0.1  # number of changes with sliding particles
LONG = 16  # moves: a plan of fewer moves loses unnecessary ones when it is changed
HITS = 1000  # per tree: maximum number of attempts to reach the goal by translations
MARGINS = (1e-3, 1e-4, 1e-5, 1e-6)  # relative to the size: distance of translations from walls, if possible
_ROOM = 0.9  # fraction of the tolerance that the search uses; the rest is for rounding errors


@PLANNERS.register("sampling")
class Sampling:
    """A planner that grows a tree of states by random manoeuvres.

    The tree is complete when a translation leads from one of its states to the goal.

    A manoeuvre brings one particle to a wall and then moves another particle. The second move corrects the relative positions of
    the particles completely or partly, or the second move is random. Every manoeuvre is simulated, and its result becomes the next
    node of the tree. Around obstacles, particles with the correct relative positions take the shortest translation path without
    wall contact. With more than two particles, this planner is experimental.

    Notes
    -----
    Source: a method of Shoal; see the outlook of paper W, section VIII. A failure proves nothing: None means only that the planner
    has found no plan.
    """

    name = "sampling"
    general = True

    def plan(self, task: SteeringTask) -> Points | None:
        """Return moves; see `Planner`.

        Raises
        ------
        InvalidInputError
            If the workspace is three-dimensional.
        """
        room = task.world.room
        if room.dimensions != 2:
            raise InvalidInputError(f"planner sampling: expected a plane workspace, got a {room.kind}")
        rng = np.random.default_rng(task.seed)
        # Simulation takes many times as long for sliding particles.
        share = 1.0 if task.world.friction == np.inf else SLIDING
        world, translations = world_of(task.world), Translations(task)
        found: list[Points] = []
        simple = len(task.start) == 2 and task.world.friction == np.inf
        for tree in range(TREES + (MORE_TREES if simple else FEW_TREES)):
            if task.late or (tree >= TREES and not found):
                break
            if tree < TREES and found:
                continue
            moves = Tree(task, world, rng, left=int(share * (MORE_ROUNDS if found else ROUNDS))).search(translations)
            found += [] if moves is None else [moves]
        if simple and found:
            found = [Shortening(task, world, rng).shortest(found)]
        return min((_shortened(task, moves) for moves in found), key=path_length, default=None)


def world_of(world: Any) -> kernels.World:
    """Return a world in the form that the sampling kernels use."""
    room = world.room
    size = float(room.size)
    if room.round:
        none = np.zeros((0, 2))
        ints, bools = none.astype(np.int64), np.zeros(0, dtype=np.bool_)
        edges = Edges(np.zeros((0, 4)), none, np.zeros(0), ints, bools, size, np.zeros((0, 4)))
    else:
        region = room if isinstance(room, Region) else Region(room.vertices, ())
        edges = RegionWorld(region).edges._replace(size=size)
    unused = Walls(np.zeros((0, 2)), np.zeros(0), np.zeros(3), size, np.inf, np.eye(3)[0])
    walls = world.walls._replace(size=size) if isinstance(world, ContactWorld) else unused
    return kernels.World(bool(not room.round and world.friction == np.inf), edges, walls)


@dataclass
class Tree:
    """A search tree: the states of its nodes, the parents of the nodes, and the moves from each parent."""

    task: SteeringTask
    world: kernels.World
    rng: np.random.Generator
    left: int
    total: int = 1
    nodes: kernels.Tree = field(init=False)

    def __post_init__(self) -> None:
        n, steps = len(self.task.start), kernels.STEPS
        ints = [np.zeros(NODES, dtype=np.int64) for _ in range(4)]
        states, made, keys = np.zeros((NODES, n, 2)), np.zeros((NODES, steps, 2)), np.zeros(NODES)
        states[0] = self.task.start
        keys[0] = 2 * n
        self.nodes = kernels.Tree(states, ints[0], made, ints[1], ints[2], keys, ints[3])

    def search(self, translations: Translations) -> Points | None:
        """Return the first plan found, or None. The method removes unnecessary moves from a long plan."""
        for _hit in range(HITS):
            moves = self._direct(translations)
            if moves is not None:
                if len(moves) > min(LONG, self.task.max_moves):
                    moves = _shortened(self.task, moves)
                if len(moves) <= self.task.max_moves:
                    return moves
            if not self.grow():
                break
        return None

    def grow(self) -> bool:
        """Grow the tree to the next state whose relative positions are correct. Return False if the search has ended."""
        task, size = self.task, float(self.task.world.room.size)
        limits = np.ascontiguousarray(task.goal), _ROOM * task.tolerance, task.max_moves - 1
        grow: Any = kernels.grow
        hit, before = False, (0, 0)
        while not hit and before != (self.total, self.left) and not task.late:
            before, rounds = (self.total, self.left), min(self.left, STRETCH)
            self.total, left, hit = grow(self.nodes, self.total, rounds, *limits, self.world, size, self.rng)
            self.left -= rounds - left
        return bool(hit)

    def _direct(self, translations: Translations) -> Points | None:
        """Return all moves to the last node, and from there the translations to the goal, or None if no such translations exist."""
        state = self.nodes.states[self.total - 1]
        x, y, away = kernels.spread(state, np.ascontiguousarray(self.task.goal))
        if away > self.task.tolerance:
            return None
        size, room = float(self.task.world.room.size), np.zeros((kernels.STEPS, 2))
        after = state.copy()
        count = kernels.translate(after, x, y, self.world, size, room, 0)
        ends: Iterable[Points] = [room[:count]]
        if self.task.error(after) > self.task.tolerance:
            ends = translations.around(np.array([-x, -y]))
        for end in ends:
            moves = np.concatenate([self.path(), end])
            if self.task.reaches_goal(moves):
                return np.asarray(moves)
        return None

    def path(self) -> Points:
        """Return the moves from the start to the last node; float64, shape (moves, 2)."""
        parents, made, counts = self.nodes.parents, self.nodes.made, self.nodes.counts
        parts, node = [np.zeros((0, 2))], self.total - 1
        while node:
            parts.append(made[node, : counts[node]])
            node = parents[node]
        return np.concatenate(parts[::-1])


class Translations:
    """Translation paths to the goal for particles whose relative positions are correct.

    An offset is the common displacement of all particles from their goals.
    """

    def __init__(self, task: SteeringTask, margins: tuple[float, ...] = MARGINS) -> None:
        self._task, self._margins = task, margins
        self._offsets: dict[float, FreeOffsets | None] = {}

    def around(self, offset: Points) -> Iterator[Points]:
        """Yield paths from an offset to the goal as moves, one path for each margin from the walls that leaves a path.

        In a convex workspace, there are no paths around obstacles.
        """
        room = self._task.world.room
        for margin in self._margins if isinstance(room, Region) else ():
            if margin not in self._offsets and not self._task.late:
                self._offsets[margin] = free_offsets(room, self._task.goal, margin * float(room.size))
            free = self._offsets.get(margin)
            path = None if free is None else free.path(offset, self._task)
            if path is not None:
                yield np.diff(np.vstack([offset, path, np.zeros(2)]), axis=0)


@dataclass
class FreeOffsets:
    """The offsets (common displacements of all particles from their goals) with a path to the goals without collision.

    Attributes
    ----------
    free, inner : shapely.Polygon
        ``free``: the offsets without collision. ``inner``: the offsets where paths may bend, slightly smaller so that rounding
        errors stay inside ``free``.
    places : ndarray of float64, shape (n, 2)
        The point nearest to the goal, and the reflex corners of ``inner``, where shortest paths bend.
    reach : float
        Maximum distance of an offset outside ``inner`` that can still be connected by a straight move.
    seen : dict of int to ndarray of bool, shape (n,)
        For each place that was needed so far, whether a straight free path connects the place with each of the n places.
    """

    free: Any
    inner: Any
    places: Points
    reach: float
    seen: dict[int, NDArray[np.bool_]] = field(default_factory=dict)

    def path(self, offset: Points, task: SteeringTask) -> Points | None:
        """Return the bends of the shortest path from an offset to the goal; float64, shape (points, 2).

        The method is an A* search from the goal. The result is None if no path exists, or if no time is left.
        """
        first = _nearest(self.inner, offset, self.reach)
        if first is None:
            return None
        left = np.linalg.norm(self.places - first, axis=1)
        joined = _sees(self.free, first, self.places)
        lengths, before = np.where(np.arange(len(left)) == 0, 0.0, np.inf), np.zeros(len(left), dtype=np.int64)
        waiting = lengths + left
        best, end = np.inf, -1
        while waiting.min() < best and not task.late:
            node = int(np.argmin(waiting))
            waiting[node] = np.inf
            if joined[node] and lengths[node] + left[node] < best:
                best, end = lengths[node] + left[node], node
            if node not in self.seen:
                self.seen[node] = _sees(self.free, self.places[node], self.places)
            through = lengths[node] + np.linalg.norm(self.places - self.places[node], axis=1)
            shorter = self.seen[node] & (through < lengths)
            lengths[shorter], before[shorter] = through[shorter], node
            waiting[shorter] = (through + left)[shorter]
        if end < 0:
            return None
        way = [first, self.places[end]]
        while end != 0:
            end = int(before[end])
            way.append(self.places[end])
        return np.array(way)


def free_offsets(room: Region, goal: Points, margin: float) -> FreeOffsets | None:
    """Return the offsets with a path to the goal that keeps all particles away from the walls by a margin, or None."""
    import shapely
    from shapely import affinity

    near = room.shape.buffer(-margin, join_style="mitre")
    free = affinity.translate(near, *(-goal[0]))
    for place in goal[1:]:
        free = free.intersection(affinity.translate(near, *(-place)))
    reach = min(20 * margin, 0.02 * float(room.size))
    for part in getattr(free, "geoms", [free]):
        inner = part.buffer(-0.1 * margin, join_style="mitre")
        last = _nearest(inner, np.zeros(2), reach) if inner.geom_type == "Polygon" else None
        if last is not None:
            shapely.prepare(part)
            turned = shapely.orient_polygons(inner)
            bends = [_reflex_corners(np.asarray(ring.coords)[:-1]) for ring in (turned.exterior, *turned.interiors)]
            return FreeOffsets(part, inner, np.vstack([last, *bends]), reach)
    return None


def _reflex_corners(ring: Points) -> Points:
    """Return the corners of a ring that are wider than 180 degrees, measured on its left side."""
    (x, y), (x_after, y_after) = (ring - np.roll(ring, 1, axis=0)).T, (np.roll(ring, -1, axis=0) - ring).T
    return np.asarray(ring[x * y_after < y * x_after])


def _sees(free: Any, place: Points, others: Points) -> NDArray[np.bool_]:
    """Return which other places a straight free path connects with a place."""
    import shapely

    lines = shapely.linestrings(np.stack([np.broadcast_to(place, others.shape), others], axis=1))
    return np.asarray(shapely.covers(free, lines))


def _nearest(inner: Any, offset: Points, reach: float) -> Points | None:
    """Return the point of an area nearest to an offset, or None if it is farther than ``reach``."""
    import shapely

    line = shapely.shortest_line(inner, shapely.Point(offset))
    if line is None or not line.length <= reach:
        return None
    return np.array(line.coords[0])


def _shortened(task: SteeringTask, moves: Points) -> Points:
    """Return a plan after removing moves and merging pairs of moves, as long as the plan still works."""
    changed = True
    while changed:
        changed = False
        for index in range(len(moves)):
            fewer = [np.delete(moves, index, axis=0)]
            if index:
                fewer.append(
                    np.concatenate([moves[: index - 1], moves[index - 1 : index + 1].sum(axis=0)[None], moves[index + 1 :]])
                )
            for trial in fewer:
                if len(trial) and task.reaches_goal(trial):
                    moves, changed = trial, True
                    break
            if changed:
                break
    return moves
