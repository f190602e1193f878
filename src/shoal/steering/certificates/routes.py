"""Lower bounds by second-order cones in workspaces of convex cells: prisms, and any region."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from math import frexp
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import import_extra
from shoal.steering.certificates.cells import Cells, Cover, Wall
from shoal.steering.certificates.programs import (
    Expression,
    Variables,
    equality,
    solver_settings,
)
from shoal.steering.certificates.relaxation import STEP

Hold = tuple[int, ...]
"""A wall in the cover of a particle, and this particle, 0 or 1; then, if they are known, the cells
in the cover of the other particle where this is at the first contact and at the last, else -1."""


@dataclass(frozen=True)
class HoldsBetween:
    """A place of a pattern where any number of holds may be: of ``holds``, each without cells, or of
    all holds if it is None.
    """

    holds: frozenset[Hold] | None = None


Item = Hold | HoldsBetween
Pattern = tuple[Item, ...]
"""All plans whose holds, repeats counted once, are those of the pattern, with any in its gaps.
Between two gaps is a hold."""

_SWEEPS = 12
MOST_CELLS = 150  # of a cover; with more, a certificate is for a smaller limit


@dataclass(frozen=True)
class RouteBound:
    """A lower bound of a pattern, with the multipliers that prove it: of norms, float64 (n,
    dimensions), of constraints, float64 (m,), of legs, float64 (l,), and of places inside a round
    wall, float64 (k, 2); the length of the inputs in each gap, and the variables.
    """

    value: float
    norms: NDArray[np.float64]
    slacks: NDArray[np.float64]
    legs: NDArray[np.float64]
    rounds: NDArray[np.float64]
    loads: dict[int, float]
    solution: NDArray[np.float64]

    def proof(self) -> dict[str, Any]:
        """Return the multipliers as JSON."""
        return {
            "norms": self.norms.tolist(),
            "slacks": [[int(k), float(self.slacks[k])] for k in np.flatnonzero(self.slacks)],
            "legs": self.legs.tolist(),
            "rounds": [
                [int(k), *self.rounds[k].tolist()] for k in np.flatnonzero(self.rounds.any(axis=1))
            ],
        }


@dataclass(frozen=True, eq=False)
class RouteLeg:
    """A route of one particle through doors: the norms of the inputs that move the particle, which
    are together at least as long as the norms from door to door.
    """

    inputs: list[int]
    steps: list[int]


@dataclass(frozen=True, eq=False)
class Sight:
    """A contact of the hold at ``place`` where the cell of the other particle is not known, the
    place of this particle, and its known nodes and places before and after, with the norms of the
    inputs between them.
    """

    place: int
    last: bool
    particle: int
    spot: Expression
    nodes: tuple[int, int]
    ends: tuple[Expression, Expression]
    inputs: tuple[list[int], list[int]]


@dataclass(frozen=True, eq=False)
class RouteProgram:
    """Least sum of the first ``size`` norms, float64 (n, dimensions, variables + 1), subject to
    rows (m, variables + 1) that are at least 0, to legs, to the bounds of the variables, and to
    ``rounds`` (k, 2, variables + 1), each at most as long as the radius of a round wall.

    ``arcs`` holds, for each place of the pattern with a hold by an arc, its first and its last
    contact, and the sum of its adjustments.
    """

    norms: NDArray[np.float64]
    size: int
    rows: NDArray[np.float64]
    legs: list[RouteLeg]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    gaps: dict[int, list[int]]
    sights: list[Sight]
    rounds: NDArray[np.float64]
    arcs: dict[int, tuple[Expression, Expression, Expression]]


class RouteRelaxation:
    """The convex programs of all patterns of one task, in which each particle starts in the first
    cell of its cover and ends in a given one.

    The programs are those of docs/concepts/steering/certificates.md.

    Parameters
    ----------
    cells : Cells
    start, goal : ndarray of float64, shape (2, dimensions)
    tolerance : float
        Largest error of each coordinate at the end.
    limit : float
        Plans that are longer than this length are not considered.

    Attributes
    ----------
    covers : tuple of Cover
        For each particle.
    ends : tuple of int
        The nodes of the covers in which the particles end; the first nodes until they are set.

    Raises
    ------
    MissingExtraError
        If Clarabel is not installed.
    """

    def __init__(
        self,
        cells: Cells,
        start: NDArray[np.float64],
        goal: NDArray[np.float64],
        tolerance: float,
        limit: float,
    ) -> None:
        self._clarabel = import_extra("clarabel", "certificates need Clarabel", extra="certify")
        self.cells = cells
        scale = self.scale = 2.0 ** frexp(float((cells.high - cells.low).max()))[1]
        origin = start[0]
        self.start, self.goal = (start - origin) / scale, (goal - origin) / scale
        self.tolerance, self.limit = tolerance / scale, limit / scale
        self.low, self.high = (cells.low - origin) / scale, (cells.high - origin) / scale
        self.extent = self.high - self.low

        def rescale(spaces: NDArray[np.float64]) -> NDArray[np.float64]:
            normals = spaces[:, :-1]
            offsets = (spaces[:, -1] - normals @ origin) / scale**2
            return np.column_stack([normals / scale, offsets])

        # normals of flat walls are as long as these, those of arcs have no unit
        self._walls = [
            Wall(
                (wall.origin - origin) / scale,
                wall.axes / scale,
                wall.normals / (scale if wall.is_flat else 1.0),
                rescale(wall.inside * (1.0 if wall.is_flat else scale)),
            )
            for wall in cells.walls
        ]
        round_ = cells.round
        self._axis = None if round_ is None else (round_.center - origin[:2]) / scale
        self._radius = 0.0 if round_ is None else round_.radius / scale
        self._outer = rescale(cells.outer)
        self._insides = [rescale(inside) for inside in cells.insides]
        self._doors = (cells.doors - origin[: cells.doors.shape[2]]) / scale
        self._settings = solver_settings(self._clarabel)
        self.covers: tuple[Cover, ...] = ()
        self.ends = (0, 0)
        self._places: tuple[list[tuple[int, int]], ...] = ([], [])
        self.holds: list[Hold] = []

    def explore(self, start_cells: Sequence[int]) -> bool:
        """Find all cells that each particle can reach from its first one; False if they are too
        many.
        """
        covers = []
        for particle in (0, 1):
            cover = self._cover(particle, start_cells[particle])
            if cover is None:
                return False
            covers.append(cover)
        self.covers = tuple(covers)
        self._places = tuple(
            [
                (node, wall)
                for node, cell in enumerate(cover.cells)
                for wall in self.cells.walls_of[cell]
            ]
            for cover in covers
        )
        self.holds = [
            (place, particle)
            for particle, places in enumerate(self._places)
            for place in range(len(places))
            if self.cells.round is None or place not in self.cells.round.parents
        ]
        return True

    def without(self, hold: Hold, excluded: Collection[Hold]) -> list[Hold]:
        """Return the holds of a gap that are together one of its holds without others."""
        if self.cells.round is None:
            return [] if hold in excluded else [hold]
        wall, particle = hold
        walls = [index for index, owner in excluded if owner == particle]
        return [(arc, particle) for arc in self.cells.without(wall, walls)]

    def owners(self, holds: Collection[Hold]) -> list[int]:
        """Return the particle of each change in a gap of some holds."""
        return [
            hold[1]
            for hold in sorted(holds)
            for _ in self._walls[self._places[hold[1]][hold[0]][1]].normals
        ]

    def halves(self, hold: Hold) -> tuple[Hold, Hold] | None:
        """Return the holds of both halves of an arc; None if the wall is flat or is not divided."""
        halves = self.cells.round and self.cells.round.halves.get(hold[0])
        return None if not halves else ((halves[0], hold[1]), (halves[1], hold[1]))

    def error(self, program: RouteProgram, solution: NDArray[np.float64], place: int) -> float:
        """Return how far the solution of the hold by an arc at a place of the pattern is from one
        contact, as a length.
        """
        values = np.append(solution, 1.0)
        first, last, change = (expression @ values for expression in program.arcs[place])
        total, against = 0.0, np.inf
        for contact in (first, last):
            out = contact[:2] - self._axis
            far = float(np.hypot(*out))
            total += self._radius - far
            against = min(against, -float(out @ change[:2]) / max(far, 1e-12))
        return total + max(against, 0.0)

    def _cover(self, particle: int, start_cell: int) -> Cover | None:
        cover = Cover([start_cell], [0], [-1], [])
        for node in range(MOST_CELLS):
            if node == len(cover.cells):
                return cover
            cell = cover.cells[node]
            for door in self.cells.doors_of[cell]:
                if door == cover.entries[node]:
                    continue
                through = [*cover.doors_from_start(node), door]
                bound = self._solve(self.program((HoldsBetween(),), (particle, through)))
                if bound.value >= self.limit * self.scale * (1 + 1e-9):
                    cover.closed.append({"node": node, "door": door, **bound.proof()})
                    continue
                cover.cells.append(self.cells.neighbor(cell, door))
                cover.parents.append(node)
                cover.entries.append(door)
        return None

    def ending_at(self, ends: Sequence[int]) -> RouteRelaxation:
        """Return a relaxation of the plans that end in these nodes of the covers."""
        relaxation = copy(self)
        relaxation.ends = ends[0], ends[1]
        return relaxation

    def follows(self, first: Hold, second: Hold) -> bool:
        """Return whether ``second`` can come directly after ``first``, and change the difference
        of the particles.
        """
        if first[:2] == second[:2]:
            return not self.cells.walls[self._places[first[1]][first[0]][1]].is_flat
        if self.cells.corners:
            return True
        walls = self.cells.walls[first[0]], self.cells.walls[second[0]]
        if not all(wall.is_flat for wall in walls):
            return True
        u, v = (wall.normals[0] for wall in walls)
        sign = 1.0 if first[1] == second[1] else -1.0
        # in a convex workspace: with opposite normals times signs, the second finds both particles
        # on its wall, and so holds both
        return not are_opposite(u, sign * v)

    def allows(self, hold: Hold, change: NDArray[np.float64]) -> bool:
        """Return whether a hold can change the difference of the particles in a direction."""
        normals = self._walls[self._places[hold[1]][hold[0]][1]].normals
        return bool(np.any(normals @ change < -1e-6 * np.linalg.norm(normals, axis=1)))

    def bound(self, pattern: Pattern) -> RouteBound:
        """Return the lower bound of all plans of a pattern, at most the limit."""
        bound = self._solve(self.program(pattern))
        return replace(bound, value=min(bound.value, self.limit * self.scale))

    def _solve(self, program: RouteProgram) -> RouteBound:
        from scipy.sparse import csc_matrix

        clarabel = self._clarabel
        norms, size, rows, legs = program.norms, program.size, program.rows, program.legs
        low, high, gaps = program.low, program.high, program.gaps
        count, number, dimensions = len(low), len(norms), norms.shape[1]
        # the variables of the program, then the length of each norm
        rounds = program.rounds
        heights = (
            *(len(rows), len(legs), count, count),
            *((1 + dimensions) * number, 3 * len(rounds)),
        )
        system = np.zeros((sum(heights), count + number + 1))
        parts = np.split(system, np.cumsum(heights)[:-1])
        parts[0][:, :count], parts[0][:, -1] = rows[:, :-1], rows[:, -1]
        for row, leg in zip(parts[1], legs, strict=True):
            row[[count + k for k in leg.inputs]] = 1
            row[[count + k for k in leg.steps]] = -1
        parts[2][:, :count], parts[2][:, -1] = np.eye(count), -low
        parts[3][:, :count], parts[3][:, -1] = -np.eye(count), high
        cones = parts[4].reshape(number, 1 + dimensions, -1)
        cones[:, 0, count:-1] = np.eye(number)
        cones[:, 1:, :count], cones[:, 1:, -1] = norms[:, :, :-1], norms[:, :, -1]
        disks = parts[5].reshape(len(rounds), 3, count + number + 1)
        disks[:, 0, -1] = self._radius
        disks[:, 1:, :count], disks[:, 1:, -1] = rounds[:, :, :-1], rounds[:, :, -1]
        cost = np.zeros(count + number)
        cost[count : count + size] = 1
        solution = clarabel.DefaultSolver(
            csc_matrix((count + number, count + number)),
            cost,
            csc_matrix(-system[:, :-1]),
            system[:, -1],
            [
                clarabel.NonnegativeConeT(sum(heights[:4])),
                *(clarabel.SecondOrderConeT(1 + dimensions) for _ in range(number)),
                *(clarabel.SecondOrderConeT(3) for _ in range(len(rounds))),
            ],
            self._settings,
        ).solve()
        dual = np.array(solution.z)
        slacks = np.maximum(dual[: len(rows)], 0.0)
        weights = np.maximum(dual[len(rows) : len(rows) + len(legs)], 0.0)
        long, round_ = np.split(dual[sum(heights[:4]) :], [heights[4]])
        vectors = -long.reshape(number, 1 + dimensions)[:, 1:]
        turns = -round_.reshape(len(rounds), 3)[:, 1:]
        if not np.isfinite(dual).all():
            multipliers = vectors, slacks, weights, turns
            vectors, slacks, weights, turns = (np.zeros_like(values) for values in multipliers)
        if "Infeasible" in str(solution.status):
            vectors, weights = np.zeros_like(vectors), np.zeros_like(weights)
            proven = self._dual_bound(program, vectors, slacks, turns)
            factor = 2 * self.limit / proven if proven > 0 else 0.0
            slacks, turns = slacks * factor, turns * factor
        # multiples of STEP, which exact arithmetic takes; towards 0, so that no norm exceeds its cap
        weights = np.trunc(weights / STEP) * STEP
        caps = caps_of(size, legs, weights, number)
        if (caps < 0).any():
            weights = np.trunc(weights / (1 - caps.min()) * (1 - 1e-9) / STEP) * STEP
            caps = np.maximum(caps_of(size, legs, weights, number), 0.0)
        lengths = np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)
        vectors = vectors * np.minimum(1.0, caps / lengths)[:, None]
        vectors = np.trunc(vectors * (1 - 1e-15) / STEP) * STEP
        slacks, turns = np.round(slacks / STEP) * STEP, np.round(turns / STEP) * STEP
        value = self._dual_bound(program, vectors, slacks, turns)
        used = np.array(solution.x)[count:]
        loads = {place: float(np.sum(used[inside])) for place, inside in gaps.items()}
        return RouteBound(
            max(value, 0.0) * self.scale,
            vectors,
            slacks,
            weights,
            turns,
            loads,
            np.array(solution.x)[:count],
        )

    def _dual_bound(
        self,
        program: RouteProgram,
        vectors: NDArray[np.float64],
        slacks: NDArray[np.float64],
        turns: NDArray[np.float64],
    ) -> float:
        """Return the lower bound that multipliers prove, or minus infinity."""
        total: Any = np.einsum("ni,nij->j", vectors, program.norms) - slacks @ program.rows
        if len(turns):
            # the checker, too, rounds up
            sizes = np.ceil(np.linalg.norm(turns, axis=1) / STEP) * STEP
            total += np.einsum("ni,nij->j", turns, program.rounds)
            total[-1] -= self._radius * sizes.sum()
        reduced_costs = total[:-1]
        value = float(
            total[-1] + np.minimum(reduced_costs * program.low, reduced_costs * program.high).sum()
        )
        return value if np.isfinite(value) else -np.inf

    def shortfall(
        self, sight: Sight, program: RouteProgram, solution: NDArray[np.float64]
    ) -> float:
        """Return how much longer the inputs before and after a contact must be for the routes of the
        other particle; infinite if this is in no cell.
        """
        values = np.append(solution, 1.0)
        spot, origin, target = (expression @ values for expression in (sight.spot, *sight.ends))
        before, after = (
            float(np.linalg.norm(program.norms[norms] @ values, axis=1).sum())
            for norms in sight.inputs
        )
        cover = self.covers[sight.particle]
        least = np.inf
        for node, cell in enumerate(cover.cells):
            inside = self._insides[cell]
            if np.all(inside[:, :-1] @ spot >= inside[:, -1] - 1e-7):
                first, second = (cover.doors_between(node, end) for end in sight.nodes)
                lack = max(self._route_length(first[::-1], origin, spot) - before, 0.0)
                lack += max(self._route_length(second, spot, target) - after, 0.0)
                least = min(least, lack)
        return least

    def _route_length(self, doors: list[int], origin: Expression, target: Expression) -> float:
        """Return about the length of the shortest route through doors."""
        ends = self._doors[doors]
        spots = np.array([origin, *ends.mean(axis=1), target])
        for _ in range(_SWEEPS):
            for k, (begin, end) in enumerate(ends, start=1):
                away = spots[k + 1] - spots[k - 1]
                along = end - begin
                turn = away[0] * along[1] - away[1] * along[0]
                off = begin - spots[k - 1]
                share = (off[0] * away[1] - off[1] * away[0]) / turn if turn else 0.5
                spots[k] = begin + np.clip(share, 0.0, 1.0) * along
        return float(np.linalg.norm(np.diff(spots, axis=0), axis=1).sum())

    def _most_variables(self, pattern: Pattern, through: tuple[int, Sequence[int]] | None) -> int:
        size = self.start.shape[1]
        count, routes = 2 * size, 2
        parts = 1 if self.cells.round is None else 2  # of the adjustments of a hold
        for item in pattern:
            if isinstance(item, HoldsBetween):
                count += size * (2 + (2 if item.holds is None else parts * len(item.holds)))
            else:
                count, routes = count + 2 * size + parts * size, routes + 3
        deepest = max((len(c.doors_from_start(len(c.cells) - 1)) for c in self.covers), default=0)
        return int(count + (len(through[1]) if through is not None else 2 * routes * deepest))

    def program(
        self, pattern: Pattern, through: tuple[int, Sequence[int]] | None = None
    ) -> RouteProgram:
        """Return the program of a pattern.

        With ``through``, a particle, from 0, and doors, this particle passes the doors on its way to
        its goal, and no particle needs to end in a given cell.
        """
        size = self.start.shape[1]
        variables = Variables(self._most_variables(pattern, through), size)
        vector, constant = variables.vector, variables.constant

        def add_point(origin: NDArray[np.float64], axes: NDArray[np.float64]) -> Expression:
            return variables.point(origin, axes) if len(axes) else vector(self.low, self.high)

        def within(point: Expression, spaces: NDArray[np.float64]) -> None:
            inside = spaces[:, :-1] @ point
            inside[:, -1] -= spaces[:, -1]
            rows.append(inside)

        def inside(point: Expression) -> None:
            if self._axis is not None:
                out = point[:2].copy()
                out[:, -1] -= self._axis
                rounds.append(out)

        def adjust(change: Expression, wall: Wall, *particles: int) -> None:
            """Count adjustments against one of the normals of a wall, as their sums by normal."""
            summands = [vector(-reach, reach) for _ in wall.normals[1:]]
            for summand, normal in zip(
                [change - sum(summands), *summands], wall.normals, strict=True
            ):
                move(summand, *particles)
                rows.append(-(normal[None] @ summand))

        reach = np.full(size, self.limit)
        rounds: list[Expression] = []
        arcs: dict[int, tuple[Expression, Expression, Expression]] = {}
        goals = [vector(point - self.tolerance, point + self.tolerance) for point in self.goal]
        places = [constant(point) for point in self.start]
        norms: list[Expression] = []
        rows: list[NDArray[np.float64]] = []
        gaps: dict[int, list[int]] = {}
        # for each particle: the node and the place that are known last, and the norms since then
        nodes, last_places = [0, 0], list(places)
        inputs: list[list[int]] = [[], []]
        waiting: list[list[tuple[int, bool, Expression, int]]] = [[], []]
        sights: list[Sight] = []
        routes: list[tuple[list[int], list[int], Expression, Expression]] = []

        def move(norm: Expression, *particles: int) -> None:
            for particle in particles:
                inputs[particle].append(len(norms))
            norms.append(norm)

        def arrive(particle: int, place: Expression, node: int) -> None:
            before = last_places[particle]
            for number, last, spot, since in waiting[particle]:
                halves = list(inputs[particle][:since]), list(inputs[particle][since:])
                ends = nodes[particle], node
                sights.append(Sight(number, last, particle, spot, ends, (before, place), halves))
            if doors := self.covers[particle].doors_between(nodes[particle], node):
                routes.append((list(inputs[particle]), doors, before, place))
            nodes[particle], last_places[particle] = node, place
            inputs[particle], waiting[particle] = [], []

        def visit(particle: int, place: Expression, site: int, last: bool) -> None:
            if site >= 0:
                arrive(particle, place, site)
                within(place, self._insides[self.covers[particle].cells[site]])
            else:
                waiting[particle].append((number, last, place, len(inputs[particle])))

        if not pattern:
            apart = (goals[1] - goals[0]) - (places[1] - places[0])
            move(goals[0] - places[0], 0, 1)
            rows = [apart, -apart]
        gap: list[Expression] | None = None
        for number, item in enumerate(pattern):
            if isinstance(item, HoldsBetween):
                begun = len(norms)
                free = vector(-reach, reach)
                if number < len(pattern) - 1:
                    before = vector(-self.extent, self.extent)
                move(free, 0, 1)
                gap = [places[0] + free, places[1] + free]
                for hold in [(-1, 0), (-1, 1)] if item.holds is None else sorted(item.holds):
                    change = vector(-reach, reach)
                    gap[1 - hold[1]] = gap[1 - hold[1]] + change
                    if item.holds is None:
                        move(change, 1 - hold[1])
                    else:
                        wall = self._walls[self._places[hold[1]][hold[0]][1]]
                        adjust(change, wall, 1 - hold[1])
                gaps[number] = list(range(begun, len(norms)))
                continue
            place, particle, *sites = (*item, -1, -1)[:4]
            node, index = self._places[particle][place]
            wall = self._walls[index]
            sign = 1.0 if particle == 0 else -1.0
            first, last = (add_point(wall.origin, wall.axes) for _ in range(2))
            if gap is None:
                before = places[1] - places[0]
                move(first - places[particle], 0, 1)
            else:
                positions = [first, first + before] if particle == 0 else [first - before, first]
                rows += equality(gap, positions)
                gap = None
            arrive(particle, first, node)
            visit(1 - particle, first + sign * before, sites[0], last=False)
            last_places[particle] = last
            after = (
                goals[1] - goals[0]
                if number == len(pattern) - 1
                else vector(-self.extent, self.extent)
            )
            move(last - first, 1 - particle)
            adjust(sign * (after - before), wall, 1 - particle)
            for contact, apart in ((first, before), (last, after)):
                within(contact, wall.inside)
                within(contact + sign * apart, self._outer)
                inside(contact)
                inside(contact + sign * apart)
            if not wall.is_flat:
                arcs[number] = first, last, sign * (after - before)
            places = [last, last + after] if particle == 0 else [last - after, last]
            visit(1 - particle, places[1 - particle], sites[1], last=True)
            if number == len(pattern) - 1:
                move(goals[particle] - last, 0, 1)
        if gap is not None:
            rows += equality(gap, goals)
        if through is None:
            for particle in (0, 1):
                arrive(particle, goals[particle], self.ends[particle])
        else:
            particle, doors = through
            routes.append((inputs[particle], list(doors), places[particle], goals[particle]))
        legs, size = [], len(norms)
        for moving, doors, origin, target in routes:
            crossed = [
                variables.point(begin, (end - begin)[None]) for begin, end in self._doors[doors]
            ]
            steps = [place - before for before, place in pairwise([origin, *crossed, target])]
            legs.append(RouteLeg(moving, list(range(len(norms), len(norms) + len(steps)))))
            norms += steps
        columns, count = variables.columns, variables.count
        constraints = np.concatenate(rows)[:, columns] if rows else np.zeros((0, count + 1))
        return RouteProgram(
            np.stack(norms)[:, :, columns],
            size,
            constraints,
            legs,
            variables.low[:count],
            variables.high[:count],
            gaps,
            [
                replace(
                    sight,
                    spot=sight.spot[:, columns],
                    ends=(sight.ends[0][:, columns], sight.ends[1][:, columns]),
                )
                for sight in sights
            ],
            np.stack(rounds)[:, :, columns] if rounds else np.zeros((0, 2, count + 1)),
            {
                number: (first[:, columns], last[:, columns], change[:, columns])
                for number, (first, last, change) in arcs.items()
            },
        )


def caps_of(
    size: int, legs: Sequence[RouteLeg], weights: NDArray[np.float64], number: int
) -> NDArray[np.float64]:
    """Return how long the multiplier of each norm may be; float64, shape (number,)."""
    caps = np.zeros(number)
    caps[:size] = 1
    for leg, weight in zip(legs, weights, strict=True):
        caps[leg.inputs] -= weight
        caps[leg.steps] += weight
    return caps


def are_opposite(u: NDArray[np.float64], v: NDArray[np.float64]) -> bool:
    """Return whether two vectors have opposite directions, in exact arithmetic."""
    first, second = ([Fraction(x) for x in vector.tolist()] for vector in (u, v))
    count = len(first)
    parallel = all(
        first[j] * second[k] == first[k] * second[j] for j in range(count) for k in range(j)
    )
    return parallel and sum(a * b for a, b in zip(first, second, strict=True)) < 0
