"""Planner sampling: a random tree search, for regions with obstacles and for more than two
particles.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.steering.contact.clearance import PLANNED, STRICT
from shoal.steering.contact.world import ContactWorld, RegionWorld
from shoal.steering.kernels import sampling as kernels
from shoal.steering.kernels.contact import Walls
from shoal.steering.kernels.region_contact import Edges
from shoal.steering.planners.annealing import Annealing
from shoal.steering.planners.rearrangement import rearrange
from shoal.steering.planners.task import (
    SteeringTask,
    choose,
    path_length,
    remove_moves,
)
from shoal.steering.workspaces.convex import TOUCH, Points
from shoal.steering.workspaces.region import Region

NODES = 60_000  # maximum number of nodes of one tree
ROUNDS = 80_000  # maximum number of manoeuvres tried in one tree
STRETCH = 5000  # manoeuvres between two checks of the time
TREES = 60  # maximum number of trees until one reaches the goal
ALL_ROUNDS = 10 * ROUNDS  # maximum number of manoeuvres in all these trees
MORE_ROUNDS = 10_000  # nodes of each further tree, which may contain a shorter plan
MORE_TREES, FEW_TREES = 39, 8  # fewer for more particles and with sliding
SLIDING = 0.1  # number of changes with sliding particles
BEST = 6  # number of the shortest plans that lose unnecessary moves at the end
LONG = 16  # moves: a plan of fewer moves loses unnecessary ones when it is changed
# per tree: maximum number of plans without the clearance, until the search ends with the first of
# them
NARROW = 10
# per tree: maximum number of attempts to reach the goal by translations; another tree is worth more
# than many attempts
HITS = 200
# added to the key of a state from which no translation leads to the goals, so that other states
# grow, too
USELESS = 2.0
# relative to the size: distance of translations from walls, if possible
MARGINS = (1e-3, 1e-4, 1e-5, 1e-6)
# relative to the size: distance by which a lift without a clearance moves particles off walls
LIFT = 1e-6
# component of an adjustment along a wall into this wall: relative to the size, and at most this
# share of the tolerance
PUSH, PUSH_SHARE = 2e-9, 0.02
_ROOM = 0.9  # fraction of the tolerance that the search uses; the rest is for rounding errors


class Sampling:
    """A planner that grows a search tree of particle positions by random manoeuvres.

    The search tree is complete when a translation leads from one of its states to the goals.

    A manoeuvre brings one particle to a wall and then moves another particle. The second move of a
    manoeuvre corrects the relative positions of the particles completely or partly, or is random.
    The planner simulates each manoeuvre and adds the resulting state to the search tree. When the
    particles have the relative positions of their goals, the planner translates all particles
    around obstacles on the shortest path without wall contact. With more than two particles, the
    planner ``sampling`` is experimental.

    Notes
    -----
    Source: an addition by Shoal, after the outlook of paper W, section VIII. If the planner finds
    no plan, a plan may still exist.
    """

    name = "sampling"
    general = True

    def plan(self, task: SteeringTask) -> Points | None:
        """Return the moves of a plan for ``task``; see the class `Planner`.

        Raises
        ------
        InvalidInputError
            If the workspace is three-dimensional.
        """
        workspace = task.world.free_space
        if workspace.dimensions != 2:
            raise InvalidInputError(
                f"planner sampling: expected a plane workspace, got a {workspace.kind}"
            )
        world, rng = world_of(task.world, task), np.random.default_rng(task.seed)
        simple = len(task.start) == 2 and task.world.friction == np.inf
        # Between places on walls, plans may stand all disturbances although a move depends a little
        # on the contact tolerance.
        close = (
            world if task.margin else world._replace(wide_edges=world.edges, wide_walls=world.walls)
        )
        plans, sensitive = _grow_trees(task, close, rng, simple=simple)
        if (
            task.world.friction < np.inf and task.clearance
        ):  # nearer to walls, sliding particles often find much shorter plans
            more_plans, more_sensitive = _grow_trees(
                task, world_of(task.world), np.random.default_rng(task.seed), simple=simple
            )
            plans, sensitive = plans + more_plans, sensitive + more_sensitive
        plans = plans + sensitive if simple else plans or sensitive or _plan_by_rearrangement(task)
        if simple and plans:
            plans = Annealing(task, world, rng).shorten(plans)
            plans = sorted(plans, key=lambda moves: (not task.is_sure(moves), path_length(moves)))[
                :BEST
            ]
        return choose(task, [remove_moves(task, moves) for moves in plans])


def _plan_by_rearrangement(task: SteeringTask) -> list[Points]:
    """Return the long plan of `rearrange` for any number of particles, if it applies."""
    world = task.world
    plain = isinstance(world, ContactWorld) and world.friction == np.inf and not world.radius
    if not plain or world.gradient is not None or world.workspace.round or task.bounds:
        return []
    for push in (PUSH, 0.0):  # the end of plans without a push depends on the contact tolerance
        try:
            moves = rearrange(world.workspace, task.start, task.goal, push=push)
        except InvalidInputError:  # positions on walls, or without room
            continue
        if task.reaches_goal(moves):
            return [moves]
    return []


def _grow_trees(
    task: SteeringTask, world: Any, rng: np.random.Generator, *, simple: bool
) -> tuple[list[Points], list[Points]]:
    """Return the plans of several search trees: plans that stand all disturbances, and
    other plans.
    """
    # Simulation takes many times as long for sliding particles.
    share = 1.0 if task.world.friction == np.inf else SLIDING
    translations = Translations(task)
    plans: list[Points] = []
    sensitive: list[Points] = []
    rounds_left = int(share * ALL_ROUNDS)
    for _tree in range(TREES):
        if plans or rounds_left <= 0 or task.late:
            break
        rounds = min(int(share * ROUNDS), rounds_left)
        tree = Tree(task, world, rng, rounds=rounds)
        moves = tree.search(translations)
        rounds_left -= rounds - tree.rounds
        if moves is not None:
            (plans if task.is_sure(moves) else sensitive).append(moves)
        elif tree.total == 1:
            break  # no manoeuvre leads away from the start
    for _tree in range(
        (MORE_TREES if simple else FEW_TREES) if plans else 0
    ):  # these trees are smaller
        if task.late:
            break
        moves = Tree(task, world, rng, rounds=int(share * MORE_ROUNDS)).search(translations)
        if moves is not None:
            (plans if task.is_sure(moves) else sensitive).append(moves)
    return plans, sensitive


def world_of(world: Any, task: SteeringTask | None = None) -> kernels.World:
    """Return the walls and the friction of a world, as arrays for the compiled functions of the
    planner ``sampling``.

    With ``task``, simulated plans keep the clearance of this task.
    """
    workspace = world.free_space
    size = float(workspace.size)
    if workspace.round:
        none = np.zeros((0, 2))
        ints, bools = none.astype(np.int64), np.zeros(0, dtype=np.bool_)
        edges = Edges(np.zeros((0, 4)), none, np.zeros(0), ints, bools, size, np.zeros((0, 4)))
    else:
        region = workspace if isinstance(workspace, Region) else Region(workspace.vertices, ())
        edges = RegionWorld(region, friction=world.friction).edges._replace(size=size)
    unused = Walls(np.zeros((0, 2)), np.zeros(0), np.zeros(3), size, world.friction, np.eye(3)[0])
    walls = world.walls._replace(size=size) if isinstance(world, ContactWorld) else unused
    clearance = task.clearance if task is not None else 0.0
    # the kernels multiply the size by the contact tolerance
    wide = max(1.25 * clearance / TOUCH, 1.0) * size
    wide_edges, wide_walls = edges._replace(size=wide), walls._replace(size=wide)
    if clearance and world.friction == np.inf:
        # What is the same where walls hold least and where they hold most is the same in between.
        edges, walls = edges._replace(pushed=STRICT), walls._replace(pushed=STRICT)
    corners = np.zeros((0, 2))
    if clearance and task is not None and isinstance(workspace, Region):
        corners = edges.ends[edges.reflex, :2]
        ends = np.concatenate([task.start, task.goal])
        far = np.linalg.norm(corners[:, None] - ends[None], axis=2) > clearance * size
        corners = np.ascontiguousarray(corners[far.all(axis=1)])
    lift = size * (PLANNED * clearance or LIFT)
    # A push into a wall moves sliding particles along it.
    push = PUSH * size if world.friction == np.inf else 0.0
    push = push if task is None else min(push, PUSH_SHARE * task.tolerance)
    return kernels.World(
        bool(isinstance(world, RegionWorld) or (not workspace.round and world.friction == np.inf)),
        edges,
        walls,
        wide_edges,
        wide_walls,
        corners,
        1.5 * clearance * size,
        lift,
        max(clearance * size, push) if push else 0.0,
        push,
    )


@dataclass
class Tree:
    """A search tree of particle positions: the state and the parent of each node, and the moves
    from the parent to the node.
    """

    task: SteeringTask
    world: kernels.World
    rng: np.random.Generator
    rounds: int
    total: int = 1
    nodes: kernels.Tree = field(init=False)

    def __post_init__(self) -> None:
        n, steps = len(self.task.start), kernels.STEPS
        ints = [np.zeros(NODES, dtype=np.int64) for _ in range(4)]
        states, moves, keys = np.zeros((NODES, n, 2)), np.zeros((NODES, steps, 2)), np.zeros(NODES)
        states[0] = self.task.start
        keys[0] = 2 * n
        self.nodes = kernels.Tree(states, ints[0], moves, ints[1], ints[2], keys, ints[3])

    def search(self, translations: Translations) -> Points | None:
        """Grow the tree until it contains a plan; return this plan, or None if the search ends
        without a plan.

        The method removes unnecessary moves from a long plan. If no plan keeps the clearance of the
        task, the method returns the first plan that reaches the goals.
        """
        sensitive: list[Points] = []
        for _hit in range(HITS):
            moves = self._direct(translations)
            if moves is not None:
                if len(moves) > min(LONG, self.task.max_moves):
                    moves = remove_moves(self.task, moves)
                if len(moves) <= self.task.max_moves:
                    if self.task.is_sure(moves):
                        return moves
                    sensitive.append(moves)
            elif self.total > 1:
                self.nodes.keys[self.total - 1] += USELESS
            if len(sensitive) == NARROW or not self.grow():
                break
        return sensitive[0] if sensitive else None

    def grow(self) -> bool:
        """Grow the tree until a new state has the relative positions of the goals; return whether
        the search finds such a state.
        """
        task = self.task
        limits = np.ascontiguousarray(task.goal), _ROOM * task.tolerance, task.max_moves - 1
        grow: Any = kernels.grow
        hit, before = False, (0, 0)
        while not hit and before != (self.total, self.rounds) and not task.late:
            before, rounds = (self.total, self.rounds), min(self.rounds, STRETCH)
            self.total, rounds_left, hit = grow(
                self.nodes, self.total, rounds, *limits, self.world, self.rng
            )
            self.rounds -= rounds - rounds_left
        return bool(hit)

    def _direct(self, translations: Translations) -> Points | None:
        """Return the moves to the last node, followed by translations to the goals, or None if no
        such translations exist.
        """
        state = self.nodes.states[self.total - 1]
        x, y, away = kernels.common_translation(state, np.ascontiguousarray(self.task.goal))
        if away > self.task.tolerance:
            return None
        path = np.zeros((kernels.STEPS, 2))
        after = state.copy()
        count = kernels.translate(after, x, y, self.world, path, 0, True)
        ends: Iterable[Points] = [path[:count]]
        if self.task.error(after) > self.task.tolerance:
            ends = translations.around(np.array([-x, -y]))
        for end in ends:
            moves = np.concatenate([self.path(), end])
            if self.task.reaches_goal(moves):
                return np.asarray(moves)
        return None

    def path(self) -> Points:
        """Return the moves from the start to the last node of the tree; float64, shape
        (moves, 2).
        """
        parents, moves, counts = self.nodes.parents, self.nodes.moves, self.nodes.counts
        parts, node = [np.zeros((0, 2))], self.total - 1
        while node:
            parts.append(moves[node, : counts[node]])
            node = parents[node]
        return np.concatenate(parts[::-1])


class Translations:
    """Translation paths to the goals for particles that already have the relative positions of
    their goals.

    An offset is the common displacement of all particles from their goals.
    """

    def __init__(self, task: SteeringTask, margins: tuple[float, ...] = MARGINS) -> None:
        self._task, self._margins = task, margins
        self._offsets: dict[float, FreeOffsets | None] = {}

    def around(self, offset: Points) -> Iterator[Points]:
        """Yield the moves of paths around obstacles from ``offset`` to the goals, one path for each
        possible margin from the walls.

        In a convex workspace, the method yields no paths.
        """
        workspace = self._task.world.free_space
        least = PLANNED * self._task.margin
        for margin in self._margins if isinstance(workspace, Region) else ():
            if margin < least:
                break
            if margin not in self._offsets and not self._task.late:
                self._offsets[margin] = free_offsets(
                    workspace, self._task.goal, margin * float(workspace.size)
                )
            free = self._offsets.get(margin)
            path = None if free is None else free.path(offset, self._task)
            if path is not None:
                yield np.diff(np.vstack([offset, path, np.zeros(2)]), axis=0)


@dataclass
class FreeOffsets:
    """The offsets (common displacements of all particles from their goals) from which a
    collision-free path leads to the goals.

    Attributes
    ----------
    free, inner : shapely.Polygon
        ``free``: the area of the offsets without collision. ``inner``: the slightly smaller area in
        which paths may bend, so that paths stay inside ``free`` despite rounding errors.
    places : ndarray of float64, shape (n, 2)
        The point of ``inner`` nearest to the goals, followed by the reflex corners of ``inner``, at
        which shortest paths bend.
    reach : float
        Maximum distance of an offset from ``inner``. If an offset is farther away, the search does
        not connect it with ``inner``.
    visible : dict of int to ndarray of bool, shape (n,)
        Stored results, by the index of a place that the search has visited: whether a straight
        collision-free path leads from this place to each of the n places.
    """

    free: Any
    inner: Any
    places: Points
    reach: float
    visible: dict[int, NDArray[np.bool_]] = field(default_factory=dict)

    def path(self, offset: Points, task: SteeringTask) -> Points | None:
        """Return the corners of the shortest path from ``offset`` to the goals; float64, shape
        (points, 2).

        The method is an A* search that starts at the goals. The result is None if no path exists,
        or if the planning time ends.
        """
        entry = _nearest(self.inner, offset, self.reach)
        if entry is None:
            return None
        heuristic = np.linalg.norm(self.places - entry, axis=1)
        connected = _are_visible(self.free, entry, self.places)
        lengths, before = (
            np.where(np.arange(len(heuristic)) == 0, 0.0, np.inf),
            np.zeros(len(heuristic), dtype=np.int64),
        )
        estimates = lengths + heuristic
        best, end = np.inf, -1
        while estimates.min() < best and not task.late:
            node = int(np.argmin(estimates))
            estimates[node] = np.inf
            if connected[node] and lengths[node] + heuristic[node] < best:
                best, end = lengths[node] + heuristic[node], node
            if node not in self.visible:
                self.visible[node] = _are_visible(self.free, self.places[node], self.places)
            reached = lengths[node] + np.linalg.norm(self.places - self.places[node], axis=1)
            shorter = self.visible[node] & (reached < lengths)
            lengths[shorter], before[shorter] = reached[shorter], node
            estimates[shorter] = (reached + heuristic)[shorter]
        if end < 0:
            return None
        corners = [entry, self.places[end]]
        while end != 0:
            end = int(before[end])
            corners.append(self.places[end])
        return np.array(corners)


def free_offsets(workspace: Region, goal: Points, margin: float) -> FreeOffsets | None:
    """Return the offsets from which a path leads to the goals at least ``margin`` from all walls,
    or None if none exist.
    """
    import shapely
    from shapely import affinity

    near = workspace.shape.buffer(-margin, join_style="mitre")
    free = affinity.translate(near, *(-goal[0]))
    for place in goal[1:]:
        free = free.intersection(affinity.translate(near, *(-place)))
    reach = min(20 * margin, 0.02 * float(workspace.size))
    for component in getattr(free, "geoms", [free]):
        inner = component.buffer(-0.1 * margin, join_style="mitre")
        target = _nearest(inner, np.zeros(2), reach) if inner.geom_type == "Polygon" else None
        if target is not None:
            shapely.prepare(component)
            oriented = shapely.orient_polygons(inner)
            bends = [
                _reflex_corners(np.asarray(ring.coords)[:-1])
                for ring in (oriented.exterior, *oriented.interiors)
            ]
            return FreeOffsets(component, inner, np.vstack([target, *bends]), reach)
    return None


def _reflex_corners(ring: Points) -> Points:
    """Return the corners of a closed line at which the angle on its left side exceeds
    180 degrees.
    """
    (x, y), (x_after, y_after) = (
        (ring - np.roll(ring, 1, axis=0)).T,
        (np.roll(ring, -1, axis=0) - ring).T,
    )
    return np.asarray(ring[x * y_after < y * x_after])


def _are_visible(free: Any, place: Points, targets: Points) -> NDArray[np.bool_]:
    """Return, for each point of ``targets``, whether a straight path inside the area ``free``
    connects it with ``place``.
    """
    import shapely

    lines = shapely.linestrings(np.stack([np.broadcast_to(place, targets.shape), targets], axis=1))
    return np.asarray(shapely.covers(free, lines))


def _nearest(inner: Any, offset: Points, reach: float) -> Points | None:
    """Return the point of the area ``inner`` nearest to ``offset``, or None if this point is
    farther away than ``reach``.
    """
    import shapely

    line = shapely.shortest_line(inner, shapely.Point(offset))
    if line is None or not line.length <= reach:
        return None
    return np.array(line.coords[0])
