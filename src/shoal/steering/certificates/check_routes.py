"""Check certificates for prisms and regions in exact arithmetic, without any code of the search."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise, product
from math import lcm
from typing import Any, NamedTuple

from shoal.steering.certificates.check import (
    STEP,
    _leaves,
    _multiple,
    _numbered,
    _root,
    _WrongError,
    check_unit,
    is_last,
)

# An item of a pattern is a hold (place, particle, cells), or a gap: a list of its holds, or None.
Hold = tuple[int, ...]
Item = Hold | list[Hold] | None
Spot = tuple[int, ...]
Row = dict[int, int]
Place = list[Row]  # one expression for each coordinate
Space = tuple[Spot, int]  # inward normal and offset
_CONSTANT = -1  # key of the constant of an expression
_MOST_CORNERS = 2000  # of a region
_MOST_CELLS = 1000  # of a cover
_ARCS = 8  # into which the round wall of a cylinder is divided first
_ON = Fraction(1, 10**9)  # relative to the unit: how far behind a wall a start may lie


class _Wall(NamedTuple):
    """A flat wall, with its inward normal; or an arc, without axes, and with those at its ends."""

    origin: Spot
    axes: Sequence[Spot]
    normals: list[Spot]
    inside: list[Space]


class _Cells:
    """The workspace of a certificate as convex cells, in whole numbers."""

    def __init__(self, certificate: Mapping[str, Any]) -> None:
        unit = Fraction(certificate["unit"])
        if unit <= 0:
            raise _WrongError("the unit is not positive")
        solid, disk = "height" in certificate, "radius" in certificate
        rings = certificate["rings"] if not solid else [certificate["corners"]] if not disk else []
        tops = [certificate[name] for name in ("height", "radius") if name in certificate]
        around = [
            [Fraction(x) for x in direction]
            for direction in (certificate["directions"] if disk else [])
        ]
        middle = [certificate["center"]] if disk else []
        sizes = [certificate["tolerance"], certificate["limit"], *tops]
        spots = [
            spot
            for ring in [*rings, middle, certificate["start"], certificate["goal"]]
            for spot in ring
        ]
        numbers = [Fraction(x) / unit for x in [*sizes, *(x for spot in spots for x in spot)]]
        origin = [Fraction(x) / unit for x in certificate["start"][0]]
        self.dimensions = len(origin)
        if min(numbers[: len(sizes)]) < 0 or self.dimensions != (3 if solid else 2):
            raise _WrongError("a size or the number of coordinates is wrong")
        along = [x for direction in around for x in direction]
        self.whole = lcm(*(x.denominator for x in [*numbers, *origin, *along]))
        self.unit = unit

        def scaled(spot: Sequence[float]) -> Spot:
            return tuple(
                int((Fraction(x) / unit - least) * self.whole)
                for x, least in zip(spot, origin, strict=False)
            )

        self.start, self.goal = (
            [scaled(spot) for spot in certificate[name]] for name in ("start", "goal")
        )
        self.tolerance, self.limit = (int(x * self.whole) for x in numbers[:2])
        self.rings = [[scaled(spot) for spot in ring] for ring in rings]
        if any(len(spot) != self.dimensions for spot in [*self.start, *self.goal]):
            raise _WrongError("a place has the wrong number of coordinates")
        self.walls: list[_Wall] = []
        self.doors: list[tuple[Spot, Spot]] = []
        self.sides_of: list[list[tuple[Spot, Spot, bool]]] = []  # and whether it is a door
        self.halves: dict[int, tuple[int, int]] = {}
        self.parents: dict[int, int] = {}
        self.axis: Spot = (0, 0)
        self.radius = 0
        if solid:
            open_ends = certificate["open_ends"]
            if not isinstance(open_ends, bool):
                raise _WrongError("whether the ends are open is not stated")
            floor, height = -int(origin[2] * self.whole), int(numbers[2] * self.whole)
            if height <= 0:
                raise _WrongError("the height is not positive")
            if open_ends:  # plans within the limit stay within it of the heights of the starts
                heights = [spot[2] for spot in self.start]
                floor = min(heights) - self.limit
                height = max(heights) + self.limit - floor
            if disk:
                self.axis, self.radius = scaled(middle[0])[:2], int(numbers[3] * self.whole)
                self._cylinder(
                    [tuple(int(x * self.whole) for x in direction) for direction in around],
                    floor,
                    height,
                )
            else:
                self._prism(floor, height)
            self._ends(floor, height, open_ends=open_ends)
        else:
            self._region(certificate["cells"], certificate["hull"])
        check_unit(unit, Fraction(max(self.extent), self.whole))

    def _prism(self, floor: int, height: int) -> None:
        corners = self.rings[0]
        sides = _convex_sides(corners)
        self.outer = [
            ((*normal, 0), offset) for normal, offset in (_half_plane(*side) for side in sides)
        ]
        for (a, b), (normal, _) in zip(sides, self.outer, strict=True):
            axes = [(*_displacement(a, b), 0), (0, 0, height)]
            self.walls.append(_Wall((*a, floor), axes, [normal], []))
        lows, highs = ([f(x) for x in zip(*corners, strict=True)] for f in (min, max))
        self.low: Spot = (*lows, floor)
        self.extent: Spot = (highs[0] - lows[0], highs[1] - lows[1], height)

    def _cylinder(self, directions: list[Spot], floor: int, height: int) -> None:
        """Make the arcs of the round wall, numbered as in a heap: those from 8 to 15 are the whole
        wall, and the arc k has the halves 2 k and 2 k + 1.
        """
        count, radius = len(directions), self.radius
        turns = [_orientation((0, 0), a, b) for a, b in pairwise([*directions, directions[0]])]
        ups = [y > 0 or (y == 0 and x > 0) for x, y in directions]
        if (
            radius <= 0
            or count < _ARCS
            or count & (count - 1)
            or min(turns) <= 0
            or sum(up and not before for before, up in pairwise([ups[-1], *ups])) != 1
        ):
            raise _WrongError("the directions do not go around the cylinder once")
        self.outer = []
        x, y = self.axis
        self.low, self.extent = (x - radius, y - radius, floor), (2 * radius, 2 * radius, height)
        for k in range(_ARCS, 2 * count):
            level = 1 << (k.bit_length() - 1)
            size = count // level
            first = directions[size * (k - level)]
            last = directions[size * (k - level + 1) % count]
            if _orientation((0, 0), first, last) <= 0:
                raise _WrongError("an arc goes around half of the cylinder")
            normals: list[Spot] = [(-first[0], -first[1], 0), (-last[0], -last[1], 0)]
            axis = first[0] + last[0], first[1] + last[1]
            away = min(radius * _dot(axis, end) // _root(_dot(end, end)) for end in (first, last))
            chord = ((*axis, 0), away + _dot(axis, self.axis))
            self.walls.append(_Wall(self.low, [], normals, [chord]))

    def _ends(self, floor: int, height: int, *, open_ends: bool) -> None:
        """Add the end caps, and those of a cylinder before its arcs."""
        sides = list(self.outer)
        up, down = (0, 0, height), (0, 0, -height)
        ceiling = floor + height
        wide = [(self.extent[0], 0, 0), (0, self.extent[1], 0)]
        below, above = self.low, (*self.low[:2], ceiling)
        caps = [_Wall(below, wide, [up], sides), _Wall(above, wide, [down], sides)]
        caps = [] if open_ends else caps
        self.walls = [*caps, *self.walls] if self.radius else [*self.walls, *caps]
        for number in range(len(caps), len(self.walls)) if self.radius else ():
            half = 2 * (number - len(caps)) + _ARCS + len(caps)
            if half < len(self.walls):
                self.halves[number] = half, half + 1
                self.parents |= dict.fromkeys((half, half + 1), number)
        self.outer = [*sides, (up, height * floor), (down, -height * ceiling)]
        self.insides = [self.outer]
        self.walls_of = [list(range(len(self.walls)))]
        self.doors_of: list[list[int]] = [[]]

    def without(self, wall: int, excluded: set[int]) -> list[int]:
        """Return the walls that are together a wall without others: halves of arcs, or the wall."""
        ancestors = [wall]
        while ancestors[-1] in self.parents:
            ancestors.append(self.parents[ancestors[-1]])
        if not excluded.isdisjoint(ancestors):
            return []
        below, level = False, [wall]
        while level and not below:
            level = [half for arc in level for half in self.halves.get(arc, ())]
            below = not excluded.isdisjoint(level)
        if not below:
            return [wall]
        return [arc for half in self.halves[wall] for arc in self.without(half, excluded)]

    def _region(self, cells: Sequence[Sequence[int]], hull: Sequence[Sequence[int]]) -> None:
        spots = [spot for ring in self.rings for spot in ring]
        edges = [
            (a, b) for ring in self.rings for a, b in zip(ring, ring[1:] + ring[:1], strict=True)
        ]
        if len(spots) > _MOST_CORNERS:
            raise _WrongError(f"expected at most {_MOST_CORNERS} corners, got {len(spots)}")
        walls = {edge: k for k, edge in enumerate(edges)}
        if len(set(spots)) < len(spots):
            raise _WrongError("the rings touch each other")
        for a, b in edges:
            for spot in spots:
                if _is_between(a, b, spot) and spot not in (a, b) and _orientation(a, b, spot) == 0:
                    raise _WrongError("the rings touch each other")
        polygons = [[spots[k] for k in cell] for cell in cells]
        sides = [_convex_sides(polygon) for polygon in polygons]
        # The sides of the cells that are not edges cancel each other, so that the sum of the cells
        # has the boundary of the region, and is the region.
        multiplicities = Counter(side for boundary in sides for side in boundary)
        if any(multiplicities[a, b] != 1 for a, b in edges) or any(
            multiplicities[b, a] != count or count != 1
            for (a, b), count in multiplicities.items()
            if (a, b) not in walls
        ):
            raise _WrongError("the cells do not divide the region")
        numbers: dict[frozenset[Spot], int] = {}
        for a, b in edges:
            self.walls.append(_Wall(a, [_displacement(a, b)], [_half_plane(a, b)[0]], []))
        self.walls_of, self.doors_of, self.insides = [], [], []
        for boundary in sides:
            self.walls_of.append([walls[side] for side in boundary if side in walls])
            self.doors_of.append([])
            for a, b in boundary:
                if (a, b) not in walls:
                    # from the corner of the lower index to the other
                    if frozenset((a, b)) not in numbers:
                        numbers[frozenset((a, b))] = len(self.doors)
                        self.doors.append((a, b) if spots.index(a) < spots.index(b) else (b, a))
                    self.doors_of[-1].append(numbers[frozenset((a, b))])
            self.sides_of.append([(a, b, (a, b) not in walls) for a, b in boundary])
            self.insides.append([_half_plane(a, b) for a, b in boundary])
        lows, highs = ([f(x) for x in zip(*self.rings[0], strict=True)] for f in (min, max))
        self.extent = (highs[0] - lows[0], highs[1] - lows[1])
        self.outer = []
        for begin, end in hull:
            a, b = spots[begin], spots[end]
            if any(_orientation(a, b, spot) < 0 for spot in self.rings[0]):
                raise _WrongError("the outline is not inside its hull")
            self.outer.append(_half_plane(a, b))

    def check_start(self, cell: int, spot: Spot) -> None:
        """Refuse a cell that does not contain a start."""
        for a, b, is_door in self.sides_of[cell] if self.sides_of else ():
            slack = 0 if is_door else _ON * self.whole * max(abs(x) for x in _displacement(a, b))
            if _orientation(a, b, spot) < -slack:
                raise _WrongError("a start is not in the cell that is stated")

    def may_end(self, cell: int, goal: Spot) -> bool:
        """Return whether no side of a cell separates it from the box around a goal."""
        if not self.sides_of:
            return True
        far = self.tolerance
        box = [(goal[0] + x, goal[1] + y) for x, y in product((-far, far), repeat=2)]
        return all(
            any(_orientation(a, b, spot) >= 0 for spot in box) for a, b, _ in self.sides_of[cell]
        )

    def behind(self, cell: int, door: int) -> int:
        """Return the cell on the other side of a door."""
        if door not in self.doors_of[cell]:
            raise _WrongError("a cell has no such door")
        return next(k for k, doors in enumerate(self.doors_of) if door in doors and k != cell)


class _Cover:
    """The cells that a particle can reach, once for each route to them."""

    def __init__(self, task: _RouteTask, particle: int, stated: Mapping[str, Any]) -> None:
        cells = task.cells
        self.cells: list[int] = [stated["cell"]]
        self.words: list[list[int]] = [[]]
        if not 0 <= stated["cell"] < len(cells.insides):
            raise _WrongError("a cover begins in no cell")
        cells.check_start(self.cells[0], cells.start[particle])
        if len(stated["nodes"]) > _MOST_CELLS:
            raise _WrongError(f"expected a cover of at most {_MOST_CELLS} cells")
        stated_doors = set()
        for door, parent in stated["nodes"]:
            if not 0 <= parent < len(self.cells):
                raise _WrongError("a cell is reached from none")
            stated_doors.add((parent, door))
            self.cells.append(cells.behind(self.cells[parent], door))
            self.words.append([*self.words[parent], door])
        for leaf in stated["closed"]:
            through = [*self.words[leaf["node"]], leaf["door"]]
            if task.proven_bound([None], leaf, (particle, through)) < task.most:
                raise _WrongError("a door is closed, but plans through it can be short")
            stated_doors.add((leaf["node"], leaf["door"]))
        needed = {
            (node, door)
            for node, cell in enumerate(self.cells)
            for door in cells.doors_of[cell]
            if self.words[node][-1:] != [door]
        }
        if stated_doors != needed or len(stated["nodes"]) + len(stated["closed"]) != len(
            stated_doors
        ):
            raise _WrongError("a cover has other cells than those that a particle can reach")
        self.places = [
            (node, wall) for node, cell in enumerate(self.cells) for wall in cells.walls_of[cell]
        ]

    def between(self, begin: int, end: int) -> list[int]:
        """Return the doors that a particle must pass on its way from a cell to another."""
        to_begin, to_end = self.words[begin], self.words[end]
        same = [a == b for a, b in zip(to_begin, to_end, strict=False)]
        shared = [*same, False].index(False)
        return to_begin[shared:][::-1] + to_end[shared:]


class _RouteTask:
    """One assignment of goals to particles."""

    def __init__(self, cells: _Cells, order: Sequence[int]) -> None:
        self.cells = cells
        self.goals = [cells.goal[k - 1] for k in order]
        self.most = Fraction(cells.limit, cells.whole) * cells.unit
        self.covers: list[_Cover] = []
        self.ends: tuple[int, ...] = (0, 0)

    def explore(self, covers: Sequence[Mapping[str, Any]]) -> None:
        """Check the covers of both particles."""
        stated = [_Cover(self, particle, cover) for particle, cover in enumerate(covers)]
        if len(stated) != 2:
            raise _WrongError(f"expected 2 covers, got {len(stated)}")
        self.covers = stated
        self.every = [
            (place, particle)
            for particle, cover in enumerate(stated)
            for place in range(len(cover.places))
            if place not in self.cells.parents
        ]
        self.allowed = {
            (place, particle)
            for particle, cover in enumerate(stated)
            for place in range(len(cover.places))
        }

    def needed_ends(self) -> list[tuple[int, ...]]:
        """Return the nodes in which the particles can end, in pairs."""
        return list(
            product(
                *(
                    [k for k, cell in enumerate(cover.cells) if self.cells.may_end(cell, goal)]
                    for cover, goal in zip(self.covers, self.goals, strict=True)
                )
            )
        )

    def follows(self, first: Hold, second: Hold) -> bool:
        """Whether the second hold can change the difference directly after the first."""
        if not self.cells.sides_of:
            walls = [self.cells.walls[hold[0]] for hold in (first, second)]
            if not all(wall.axes for wall in walls):
                return True  # arcs
        if tuple(first[:2]) == tuple(second[:2]):
            return False
        if self.cells.sides_of:
            return True
        u, v = (wall.normals[0] for wall in walls)
        sign = 1 if first[1] == second[1] else -1
        parallel = all(u[j] * v[k] == u[k] * v[j] for j in range(len(u)) for k in range(j))
        return not parallel or sign * sum(a * b for a, b in zip(u, v, strict=True)) > 0

    def children(self, pattern: Sequence[Item], node: Mapping[str, Any]) -> list[list[Item]]:
        """Return the patterns into which a node must divide its own."""
        place = node["place"]
        if not (isinstance(place, int) and 0 <= place < len(pattern)):
            raise _WrongError(f"a pattern has no item at {place}")
        item = pattern[place]
        before, after = list(pattern[:place]), list(pattern[place + 1 :])
        if isinstance(item, tuple):
            if self.cells.radius:
                return self._halve(before, item, after)
            return self._site(pattern, place, item, node)
        excluded = [(wall, particle) for wall, particle in node["known"]]
        if not set(excluded) <= self.allowed:
            raise _WrongError("a gap has an unknown hold")
        backwards = is_last(node["side"])
        removed: list[Hold] = list(excluded)
        beside = after[:1] if backwards else before[-1:]
        if not excluded and self.cells.radius and beside and isinstance(beside[0], tuple):
            # the hold beside the gap has all contacts up to the gap that it can have
            removed = [beside[0]]
        near_gap: list[Item] = [list[Hold](excluded)] if excluded else []
        middles: list[list[Item]] = [near_gap]
        middles += [
            [item, hold, *near_gap] if backwards else [*near_gap, hold, item]
            for whole_hold in (self.every if item is None else sorted(item))
            for hold in self._without(whole_hold, removed)
        ]
        return [
            [*before, *middle, *after]
            for middle in middles
            if all(
                not isinstance(earlier, tuple)
                or not isinstance(later, tuple)
                or self.follows(earlier, later)
                for earlier, later in pairwise([*before[-1:], *middle, *after[:1]])
            )
        ]

    def _without(self, hold: Hold, excluded: Sequence[Hold]) -> list[Hold]:
        """Return the holds that are together a hold without others."""
        wall, particle = hold
        walls = {other_hold[0] for other_hold in excluded if other_hold[1] == particle}
        return [(arc, particle) for arc in self.cells.without(wall, walls)]

    def _halve(self, before: list[Item], hold: Hold, after: list[Item]) -> list[list[Item]]:
        """Return the patterns into which a hold by an arc divides: with contacts of one half only,
        or with some of both, of which the first two that differ are known, or the last two.
        """
        if hold[0] not in self.cells.halves:
            raise _WrongError("a hold has no halves")
        begin_half, end_half = ((half, hold[1]) for half in self.cells.halves[hold[0]])
        halves = [begin_half, end_half]
        patterns: list[list[Item]] = [[*before, half, *after] for half in halves]
        for pair in (halves, halves[::-1]):
            if not after or isinstance(after[0], tuple):
                patterns.append([*before, *pair, list[Hold](halves), *after])
            elif not before or isinstance(before[-1], tuple):
                patterns.append([*before, list[Hold](halves), *pair, *after])
            else:
                gap = after[0]
                wider = None if gap is None else sorted({*gap, *halves})
                patterns.append([*before, *pair, wider, *after[1:]])
        return patterns

    def _site(
        self, pattern: Sequence[Item], place: int, hold: Hold, node: Mapping[str, Any]
    ) -> list[list[Item]]:
        wall, particle, *sites = (*hold, -1, -1)[:4]
        which = ("first", "last").index(node["contact"])
        if sites[which] != -1:
            raise _WrongError("a cell is known already")
        patterns: list[list[Item]] = []
        for cell in range(len(self.covers[1 - particle].cells)):
            sites[which] = cell
            patterns.append([*pattern[:place], (wall, particle, *sites), *pattern[place + 1 :]])
        return patterns

    def value(self, pattern: Sequence[Item], leaf: Mapping[str, Any]) -> Fraction:
        """Return the bound that a leaf proves, at most the limit."""
        return min(self.proven_bound(pattern, leaf), self.most)

    def proven_bound(
        self,
        pattern: Sequence[Item],
        leaf: Mapping[str, Any],
        through: tuple[int, list[int]] | None = None,
    ) -> Fraction:
        """Return the bound that the multipliers of a leaf prove for all plans of a pattern."""
        norms, count, rows, legs, bounds, rounds = _program(self, pattern, through)
        vectors, weights = leaf["norms"], [_multiple(weight) for weight in leaf["legs"]]
        if len(vectors) != len(norms) or len(weights) != len(legs):
            raise _WrongError(f"expected {len(norms)} norms and {len(legs)} legs")
        caps = [STEP] * count + [0] * (len(norms) - count)
        for (inputs, steps), weight in zip(legs, weights, strict=True):
            if weight < 0:
                raise _WrongError("the multiplier of a leg is negative")
            for k in inputs:
                caps[k] -= weight
            for k in steps:
                caps[k] += weight
        scale = self.cells.whole
        total: Row = {}
        for vector, norm, cap in zip(vectors, norms, caps, strict=True):
            parts = [_multiple(coordinate) for coordinate in vector]
            if cap < 0 or sum(coordinate * coordinate for coordinate in parts) > cap * cap:
                raise _WrongError("the multiplier of a norm is too long")
            for factor, expression in zip(parts, norm, strict=True):
                for key, number in expression.items():
                    total[key] = total.get(key, 0) + factor * number * scale
        for index, multiplier in leaf["slacks"]:
            slack = _multiple(multiplier)
            if slack < 0:
                raise _WrongError("the multiplier of a constraint is negative")
            for key, number in _numbered(rows, index).items():
                total[key] = total.get(key, 0) - slack * number
        for index, *multipliers in leaf["rounds"]:
            # r >= |v| and n >= |z| mean n r - z . v >= 0
            factors = [_multiple(x) for x in multipliers]
            total[_CONSTANT] = total.get(_CONSTANT, 0) - _root(_dot(factors, factors)) * (
                self.cells.radius * scale
            )
            for factor, expression in zip(factors, _numbered(rounds, index), strict=True):
                for key, number in expression.items():
                    total[key] = total.get(key, 0) + factor * number * scale
        value = total.pop(_CONSTANT, 0)
        for key, number in total.items():
            low, high = bounds[key]
            value += min(number * low, number * high)
        return Fraction(value, STEP * scale * scale) * self.cells.unit


_Legs = list[tuple[list[int], list[int]]]


def _program(
    task: _RouteTask, pattern: Sequence[Item], through: tuple[int, list[int]] | None
) -> tuple[list[Place], int, list[Row], _Legs, list[tuple[int, int]], list[Place]]:
    """Return the norms of a pattern, the number of those whose sum counts, the constraints, the
    legs, the bounds of the variables, and the places, from the axis, inside a round wall.
    """
    cells = task.cells
    scale, size = cells.whole, cells.dimensions
    bounds: list[tuple[int, int]] = []
    norms: list[Place] = []
    rows: list[Row] = []

    def vector(low: Sequence[int], high: Sequence[int]) -> Place:
        bounds.extend(zip(low, high, strict=True))
        return [{len(bounds) - size + axis: 1} for axis in range(size)]

    def around(reach: Sequence[int]) -> Place:
        return vector([-x for x in reach], reach)

    def on(origin: Spot, axes: Sequence[Spot]) -> Place:
        if not axes:
            return vector(origin, [a + b for a, b in zip(origin, cells.extent, strict=True)])
        place = _constant(origin)
        for along in axes:
            bounds.append((0, 1))
            for axis in range(size):
                place[axis][len(bounds) - 1] = along[axis]
        return place

    def equal(pairs: Sequence[tuple[Place, Place]]) -> None:
        for left, right in pairs:
            for u, v in ((left, right), (right, left)):
                rows.extend(
                    {key: number * scale for key, number in expression.items()}
                    for expression in _sum(u, v, -1)
                )

    def within(place: Place, spaces: Sequence[Space]) -> None:
        for normal, offset in spaces:
            row = _along(normal, place, 1)
            row[_CONSTANT] = row.get(_CONSTANT, 0) - offset
            rows.append(row)

    def inside(place: Place) -> None:
        if cells.radius:
            rounds.append(_sum(place[:2], _constant(cells.axis), -1))

    def adjust(change: Place, wall: _Wall, *particles: int) -> None:
        changes = [around(far) for _ in wall.normals[1:]]
        for summand in changes:
            change = _sum(change, summand, -1)
        for summand, normal in zip([change, *changes], wall.normals, strict=True):
            move(summand, *particles)
            rows.append(_along(normal, summand, -1))

    rounds: list[Place] = []
    far = [cells.limit] * size
    goals = [
        vector([x - cells.tolerance for x in goal], [x + cells.tolerance for x in goal])
        for goal in task.goals
    ]
    places = [_constant(spot) for spot in cells.start]
    nodes, last_places = [0, 0], list(places)
    inputs: list[list[int]] = [[], []]
    routes: list[tuple[list[int], list[int], Place, Place]] = []

    def move(norm: Place, *particles: int) -> None:
        for particle in particles:
            inputs[particle].append(len(norms))
        norms.append(norm)

    def arrive(particle: int, place: Place, doors: list[int]) -> None:
        if doors:
            routes.append((list(inputs[particle]), doors, last_places[particle], place))

    def visit(particle: int, place: Place, site: int) -> None:
        if site >= 0:
            cover = task.covers[particle]
            arrive(particle, place, cover.between(nodes[particle], site))
            nodes[particle], last_places[particle], inputs[particle] = site, place, []
            within(place, cells.insides[cover.cells[site]])

    zero: Place = [{} for _ in range(size)]
    if not pattern:
        apart = _sum(_sum(goals[1], goals[0], -1), _sum(places[1], places[0], -1), -1)
        move(_sum(goals[0], places[0], -1), 0, 1)
        equal([(apart, zero)])
    reached: list[Place] | None = None
    before = zero
    for number, item in enumerate(pattern):
        final = number == len(pattern) - 1
        if not isinstance(item, tuple):
            free = around(far)
            if not final:
                before = around(cells.extent)
            move(free, 0, 1)
            reached = [_sum(place, free, 1) for place in places]
            for wall, particle in [(-1, 0), (-1, 1)] if item is None else sorted(item):
                change = around(far)
                reached[1 - particle] = _sum(reached[1 - particle], change, 1)
                if item is None:
                    move(change, 1 - particle)
                else:
                    index = task.covers[particle].places[wall][1]
                    adjust(change, cells.walls[index], 1 - particle)
            continue
        hold, particle, *sites = (*item, -1, -1)[:4]
        node, index = task.covers[particle].places[hold]
        wall_ = cells.walls[index]
        sign = 1 if particle == 0 else -1
        first, last = (on(wall_.origin, wall_.axes) for _ in range(2))
        if reached is None:
            before = _sum(places[1], places[0], -1)
            move(_sum(first, places[particle], -1), 0, 1)
        else:
            partner = _sum(first, before, sign)
            now = [first, partner] if particle == 0 else [partner, first]
            equal(list(zip(reached, now, strict=True)))
            reached = None
        arrive(particle, first, task.covers[particle].between(nodes[particle], node))
        visit(1 - particle, _sum(first, before, sign), sites[0])
        nodes[particle], last_places[particle], inputs[particle] = node, last, []
        after = _sum(goals[1], goals[0], -1) if final else around(cells.extent)
        move(_sum(last, first, -1), 1 - particle)
        adjust(_sum(zero, _sum(after, before, -1), sign), wall_, 1 - particle)
        for contact, apart in ((first, before), (last, after)):
            within(contact, wall_.inside)
            within(_sum(contact, apart, sign), cells.outer)
            inside(contact)
            inside(_sum(contact, apart, sign))
        partner = _sum(last, after, sign)
        places = [last, partner] if particle == 0 else [partner, last]
        visit(1 - particle, partner, sites[1])
        if final:
            move(_sum(goals[particle], last, -1), 0, 1)
    if reached is not None:
        equal(list(zip(reached, goals, strict=True)))
    if through is not None:
        arrive(through[0], goals[through[0]], through[1])
    elif task.covers:
        for particle, cover in enumerate(task.covers):
            doors = cover.between(nodes[particle], task.ends[particle])
            arrive(particle, goals[particle], doors)
    count, legs = len(norms), []
    for moving, doors, origin, target in routes:
        crossed = [on(a, [_displacement(a, b)]) for a, b in (cells.doors[door] for door in doors)]
        steps = [_sum(after, place, -1) for place, after in pairwise([origin, *crossed, target])]
        legs.append((moving, list(range(len(norms), len(norms) + len(steps)))))
        norms += steps
    return norms, count, rows, legs, bounds, rounds


def route_values(certificate: Mapping[str, Any], tree: Mapping[str, Any]) -> Iterator[Fraction]:
    """Yield the bound of each leaf of a proof for cells, and check that no case is missing.

    The first value is the limit: plans that go through closed doors are only known to be as long.
    """
    task = _RouteTask(_Cells(certificate), tree["order"])
    proof = tree["proof"]
    task.explore(proof["covers"])
    yield task.most
    pairs = [tuple(case["ends"]) for case in proof["ways"]]
    if sorted(pairs) != sorted(task.needed_ends()):
        raise _WrongError("expected a proof for each cell in which a particle can end")
    for ends, case in zip(pairs, proof["ways"], strict=True):
        task.ends = ends
        for pattern, leaf in _leaves(task, case["proof"]):
            yield task.value(pattern, leaf)


def _constant(spot: Spot) -> Place:
    return [{_CONSTANT: x} for x in spot]


def _sum(u: Place, v: Place, sign: int) -> Place:
    return [
        {key: a.get(key, 0) + sign * b.get(key, 0) for key in a.keys() | b.keys()}
        for a, b in zip(u, v, strict=True)
    ]


def _along(normal: Spot, place: Place, sign: int) -> Row:
    row: Row = {}
    for factor, expression in zip(normal, place, strict=True):
        for key, number in expression.items():
            row[key] = row.get(key, 0) + sign * factor * number
    return row


def _dot(u: Sequence[int], v: Sequence[int]) -> int:
    return sum(a * b for a, b in zip(u, v, strict=True))


def _displacement(begin: Spot, end: Spot) -> Spot:
    return tuple(b - a for a, b in zip(begin, end, strict=True))


def _orientation(begin: Spot, end: Spot, spot: Spot) -> int:
    return (end[0] - begin[0]) * (spot[1] - begin[1]) - (end[1] - begin[1]) * (spot[0] - begin[0])


def _is_between(begin: Spot, end: Spot, spot: Spot) -> bool:
    return all(min(a, b) <= x <= max(a, b) for a, b, x in zip(begin, end, spot, strict=True))


def _half_plane(begin: Spot, end: Spot) -> Space:
    x, y = _displacement(begin, end)
    return (-y, x), -y * begin[0] + x * begin[1]


def _convex_sides(corners: Sequence[Spot]) -> list[tuple[Spot, Spot]]:
    """Return the sides of a counter-clockwise polygon, and refuse one that is not convex."""
    sides = list(zip(corners, [*corners[1:], corners[0]], strict=True))
    along = [_displacement(a, b) for a, b in sides]
    ups = [y > 0 or (y == 0 and x > 0) for x, y in along]
    turns = sum(up and not before for before, up in pairwise([ups[-1], *ups]))
    bends = [a[0] * b[1] - a[1] * b[0] for a, b in pairwise([along[-1], *along])]
    straight = all(
        bend != 0 or a[0] * b[0] + a[1] * b[1] > 0
        for bend, (a, b) in zip(bends, pairwise([along[-1], *along]), strict=True)
    )
    if len(corners) < 3 or min(bends) < 0 or not straight or turns != 1:
        raise _WrongError("the corners are not those of a convex polygon")
    return sides
