"""Check certificates for prisms and regions in exact arithmetic, without any code of the search."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise, product
from math import lcm
from typing import Any, NamedTuple

from shoal.steering.certificates.check import STEP, _leaves, _multiple, _numbered, _WrongError

# An item of a pattern is a hold (place, particle, cells), or a gap: a list of its holds, or None.
Hold = tuple[int, ...]
Item = Hold | list[Hold] | None
Spot = tuple[int, ...]
Row = dict[int, int]
Place = list[Row]  # one expression for each coordinate
Space = tuple[Spot, int]  # inward normal and offset
_ONE = -1  # key of the constant of an expression
_MOST_CORNERS = 2000  # of a region
_MOST_CELLS = 1000  # of a cover
_ON = Fraction(1, 10**9)  # relative to the unit: how far behind a wall a start may lie


class _Wall(NamedTuple):
    origin: Spot
    axes: Sequence[Spot]
    normal: Spot
    inside: list[Space]


class _Cells:
    """The workspace of a certificate as convex cells, in whole numbers."""

    def __init__(self, certificate: Mapping[str, Any]) -> None:
        unit = Fraction(certificate["unit"])
        if unit <= 0:
            raise _WrongError("the unit is not positive")
        solid = "height" in certificate
        rings = [certificate["corners"]] if solid else certificate["rings"]
        tops = [certificate["height"]] if solid else []
        sizes = [certificate["tolerance"], certificate["limit"], *tops]
        spots = [
            spot for ring in [*rings, certificate["start"], certificate["goal"]] for spot in ring
        ]
        numbers = [Fraction(x) / unit for x in [*sizes, *(x for spot in spots for x in spot)]]
        origin = [Fraction(x) / unit for x in certificate["start"][0]]
        self.dimensions = len(origin)
        if min(numbers[: len(sizes)]) < 0 or self.dimensions != (3 if solid else 2):
            raise _WrongError("a size or the number of coordinates is wrong")
        self.whole = lcm(*(x.denominator for x in [*numbers, *origin]))
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
        if solid:
            self._prism(-int(origin[2] * self.whole), int(numbers[2] * self.whole))
        else:
            self._region(certificate["cells"], certificate["hull"])

    def _prism(self, floor: int, height: int) -> None:
        corners = self.rings[0]
        sides = _convex_sides(corners)
        spaces = [_space(a, b) for a, b in sides]
        around = [((*normal, 0), offset) for normal, offset in spaces]
        lows, highs = ([f(x) for x in zip(*corners, strict=True)] for f in (min, max))
        up, down = (0, 0, height), (0, 0, -height)
        ceiling = floor + height
        if height <= 0:
            raise _WrongError("the height is not positive")
        for (a, b), (normal, _) in zip(sides, around, strict=True):
            axes = [(*_from(a, b), 0), up]
            self.walls.append(_Wall((*a, floor), axes, normal, []))
        wide = [(highs[0] - lows[0], 0, 0), (0, highs[1] - lows[1], 0)]
        self.walls.append(_Wall((*lows, floor), wide, up, around))
        self.walls.append(_Wall((*lows, ceiling), wide, down, around))
        self.outer: list[Space] = [*around, (up, height * floor), (down, -height * ceiling)]
        self.insides = [self.outer]
        self.walls_of = [list(range(len(self.walls)))]
        self.doors_of: list[list[int]] = [[]]
        self.extent: Spot = (highs[0] - lows[0], highs[1] - lows[1], height)

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
                if _between(a, b, spot) and spot not in (a, b) and _left(a, b, spot) == 0:
                    raise _WrongError("the rings touch each other")
        polygons = [[spots[k] for k in cell] for cell in cells]
        sides = [_convex_sides(polygon) for polygon in polygons]
        # The sides of the cells that are not edges cancel each other, so that the sum of the cells
        # has the boundary of the region, and is the region.
        once = Counter(side for several in sides for side in several)
        if any(once[a, b] != 1 for a, b in edges) or any(
            once[b, a] != count or count != 1
            for (a, b), count in once.items()
            if (a, b) not in walls
        ):
            raise _WrongError("the cells do not divide the region")
        numbers: dict[frozenset[Spot], int] = {}
        for a, b in edges:
            self.walls.append(_Wall(a, [_from(a, b)], _space(a, b)[0], []))
        self.walls_of, self.doors_of, self.insides = [], [], []
        for several in sides:
            self.walls_of.append([walls[side] for side in several if side in walls])
            self.doors_of.append([])
            for a, b in several:
                if (a, b) not in walls:
                    # from the corner of the lower index to the other
                    if frozenset((a, b)) not in numbers:
                        numbers[frozenset((a, b))] = len(self.doors)
                        self.doors.append((a, b) if spots.index(a) < spots.index(b) else (b, a))
                    self.doors_of[-1].append(numbers[frozenset((a, b))])
            self.sides_of.append([(a, b, (a, b) not in walls) for a, b in several])
            self.insides.append([_space(a, b) for a, b in several])
        lows, highs = ([f(x) for x in zip(*self.rings[0], strict=True)] for f in (min, max))
        self.extent = (highs[0] - lows[0], highs[1] - lows[1])
        self.outer = []
        for one, other in hull:
            a, b = spots[one], spots[other]
            if any(_left(a, b, spot) < 0 for spot in self.rings[0]):
                raise _WrongError("the outline is not inside its hull")
            self.outer.append(_space(a, b))

    def check_start(self, cell: int, spot: Spot) -> None:
        """Refuse a cell that does not contain a start."""
        for a, b, is_door in self.sides_of[cell] if self.sides_of else ():
            slack = 0 if is_door else _ON * self.whole * max(abs(x) for x in _from(a, b))
            if _left(a, b, spot) < -slack:
                raise _WrongError("a start is not in the cell that is stated")

    def may_end(self, cell: int, goal: Spot) -> bool:
        """Return whether no side of a cell separates it from the box around a goal."""
        if not self.sides_of:
            return True
        far = self.tolerance
        box = [(goal[0] + x, goal[1] + y) for x, y in product((-far, far), repeat=2)]
        return all(any(_left(a, b, spot) >= 0 for spot in box) for a, b, _ in self.sides_of[cell])

    def behind(self, cell: int, door: int) -> int:
        """Return the cell on the other side of a door."""
        if door not in self.doors_of[cell]:
            raise _WrongError("a cell has no such door")
        return next(k for k, doors in enumerate(self.doors_of) if door in doors and k != cell)


class _Cover:
    """The cells that a particle can reach, once for each way to reach them."""

    def __init__(self, task: _RouteTask, particle: int, stated: Mapping[str, Any]) -> None:
        cells = task.cells
        self.cells: list[int] = [stated["cell"]]
        self.words: list[list[int]] = [[]]
        if not 0 <= stated["cell"] < len(cells.insides):
            raise _WrongError("a cover begins in no cell")
        cells.check_start(self.cells[0], cells.start[particle])
        if len(stated["nodes"]) > _MOST_CELLS:
            raise _WrongError(f"expected a cover of at most {_MOST_CELLS} cells")
        done = set()
        for door, parent in stated["nodes"]:
            if not 0 <= parent < len(self.cells):
                raise _WrongError("a cell is reached from none")
            done.add((parent, door))
            self.cells.append(cells.behind(self.cells[parent], door))
            self.words.append([*self.words[parent], door])
        for leaf in stated["closed"]:
            through = [*self.words[leaf["node"]], leaf["door"]]
            if task.proven([None], leaf, (particle, through)) < task.most:
                raise _WrongError("a door is closed, but plans through it can be short")
            done.add((leaf["node"], leaf["door"]))
        needed = {
            (node, door)
            for node, cell in enumerate(self.cells)
            for door in cells.doors_of[cell]
            if self.words[node][-1:] != [door]
        }
        if done != needed or len(stated["nodes"]) + len(stated["closed"]) != len(done):
            raise _WrongError("a cover has other cells than those that a particle can reach")
        self.places = [
            (node, wall) for node, cell in enumerate(self.cells) for wall in cells.walls_of[cell]
        ]

    def between(self, one: int, other: int) -> list[int]:
        """Return the doors that a particle must pass on its way from a cell to another."""
        first, second = self.words[one], self.words[other]
        same = [a == b for a, b in zip(first, second, strict=False)]
        shared = [*same, False].index(False)
        return first[shared:][::-1] + second[shared:]


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
        found = [_Cover(self, particle, cover) for particle, cover in enumerate(covers)]
        if len(found) != 2:
            raise _WrongError(f"expected 2 covers, got {len(found)}")
        self.covers = found
        self.every = [
            (place, particle)
            for particle, cover in enumerate(found)
            for place in range(len(cover.places))
        ]

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
        if tuple(first[:2]) == tuple(second[:2]):
            return False
        if self.cells.sides_of:
            return True
        one, other = (self.cells.walls[hold[0]].normal for hold in (first, second))
        sign = 1 if first[1] == second[1] else -1
        parallel = all(
            one[j] * other[k] == one[k] * other[j] for j in range(len(one)) for k in range(j)
        )
        return not parallel or sign * sum(a * b for a, b in zip(one, other, strict=True)) > 0

    def parts(self, pattern: Sequence[Item], node: Mapping[str, Any]) -> list[list[Item]]:
        """Return the patterns into which a node must divide its own."""
        place = node["place"]
        if not (isinstance(place, int) and 0 <= place < len(pattern)):
            raise _WrongError(f"a pattern has no item at {place}")
        item = pattern[place]
        if isinstance(item, tuple):
            return self._sited(pattern, place, item, node)
        known = [(wall, particle) for wall, particle in node["known"]]
        if not set(known) <= set(self.every):
            raise _WrongError("a gap has an unknown hold")
        within: list[Item] = [list[Hold](known)] if known else []
        middles: list[list[Item]] = [within]
        middles += [
            [item, hold, *within] if node["side"] == "last" else [*within, hold, item]
            for hold in (self.every if item is None else sorted(item))
            if hold not in known
        ]
        before, after = list(pattern[:place]), list(pattern[place + 1 :])
        return [
            [*before, *middle, *after]
            for middle in middles
            if all(
                not isinstance(one, tuple)
                or not isinstance(other, tuple)
                or self.follows(one, other)
                for one, other in pairwise([*before[-1:], *middle, *after[:1]])
            )
        ]

    def _sited(
        self, pattern: Sequence[Item], place: int, hold: Hold, node: Mapping[str, Any]
    ) -> list[list[Item]]:
        wall, particle, *sites = (*hold, -1, -1)[:4]
        which = ("first", "last").index(node["contact"])
        if sites[which] != -1:
            raise _WrongError("a cell is known already")
        found: list[list[Item]] = []
        for cell in range(len(self.covers[1 - particle].cells)):
            sites[which] = cell
            found.append([*pattern[:place], (wall, particle, *sites), *pattern[place + 1 :]])
        return found

    def value(self, pattern: Sequence[Item], leaf: Mapping[str, Any]) -> Fraction:
        """Return the bound that a leaf proves, at most the limit."""
        return min(self.proven(pattern, leaf), self.most)

    def proven(
        self,
        pattern: Sequence[Item],
        leaf: Mapping[str, Any],
        through: tuple[int, list[int]] | None = None,
    ) -> Fraction:
        """Return the bound that the multipliers of a leaf prove for all plans of a pattern."""
        norms, count, rows, legs, bounds = _program(self, pattern, through)
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
        whole = self.cells.whole
        total: Row = {}
        for vector, norm, cap in zip(vectors, norms, caps, strict=True):
            parts = [_multiple(part) for part in vector]
            if cap < 0 or sum(part * part for part in parts) > cap * cap:
                raise _WrongError("the multiplier of a norm is too long")
            for factor, part in zip(parts, norm, strict=True):
                for key, number in part.items():
                    total[key] = total.get(key, 0) + factor * number * whole
        for index, given in leaf["slacks"]:
            slack = _multiple(given)
            if slack < 0:
                raise _WrongError("the multiplier of a constraint is negative")
            for key, number in _numbered(rows, index).items():
                total[key] = total.get(key, 0) - slack * number
        value = total.pop(_ONE, 0)
        for key, number in total.items():
            low, high = bounds[key]
            value += min(number * low, number * high)
        return Fraction(value, STEP * whole * whole) * self.cells.unit


_Legs = list[tuple[list[int], list[int]]]


def _program(
    task: _RouteTask, pattern: Sequence[Item], through: tuple[int, list[int]] | None
) -> tuple[list[Place], int, list[Row], _Legs, list[tuple[int, int]]]:
    """Return the norms of a pattern, the number of those whose sum counts, the constraints, the
    legs, and the bounds of the variables.
    """
    cells = task.cells
    whole, size = cells.whole, cells.dimensions
    bounds: list[tuple[int, int]] = []
    norms: list[Place] = []
    rows: list[Row] = []

    def vector(low: Sequence[int], high: Sequence[int]) -> Place:
        bounds.extend(zip(low, high, strict=True))
        return [{len(bounds) - size + axis: 1} for axis in range(size)]

    def around(reach: Sequence[int]) -> Place:
        return vector([-x for x in reach], reach)

    def on(origin: Spot, axes: Sequence[Spot]) -> Place:
        place = _constant(origin)
        for along in axes:
            bounds.append((0, 1))
            for axis in range(size):
                place[axis][len(bounds) - 1] = along[axis]
        return place

    def equal(pairs: Sequence[tuple[Place, Place]]) -> None:
        for one, other in pairs:
            for first, second in ((one, other), (other, one)):
                rows.extend(
                    {key: number * whole for key, number in part.items()}
                    for part in _sum(first, second, -1)
                )

    def within(place: Place, spaces: Sequence[Space]) -> None:
        for normal, offset in spaces:
            row = _along(normal, place, 1)
            row[_ONE] = row.get(_ONE, 0) - offset
            rows.append(row)

    goals = [
        vector([x - cells.tolerance for x in goal], [x + cells.tolerance for x in goal])
        for goal in task.goals
    ]
    places = [_constant(spot) for spot in cells.start]
    nodes, last_places = [0, 0], list(places)
    inputs: list[list[int]] = [[], []]
    ways: list[tuple[list[int], list[int], Place, Place]] = []

    def move(norm: Place, *particles: int) -> None:
        for particle in particles:
            inputs[particle].append(len(norms))
        norms.append(norm)

    def arrive(particle: int, place: Place, doors: list[int]) -> None:
        if doors:
            ways.append((list(inputs[particle]), doors, last_places[particle], place))

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
    far = [cells.limit] * size
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
                move(change, 1 - particle)
                reached[1 - particle] = _sum(reached[1 - particle], change, 1)
                if item is not None:
                    index = task.covers[particle].places[wall][1]
                    rows.append(_along(cells.walls[index].normal, change, -1))
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
            other = _sum(first, before, sign)
            now = [first, other] if particle == 0 else [other, first]
            equal(list(zip(reached, now, strict=True)))
            reached = None
        arrive(particle, first, task.covers[particle].between(nodes[particle], node))
        visit(1 - particle, _sum(first, before, sign), sites[0])
        nodes[particle], last_places[particle], inputs[particle] = node, last, []
        after = _sum(goals[1], goals[0], -1) if final else around(cells.extent)
        move(_sum(last, first, -1), 1 - particle)
        move(_sum(after, before, -1), 1 - particle)
        for contact, apart in ((first, before), (last, after)):
            within(contact, wall_.inside)
            within(_sum(contact, apart, sign), cells.outer)
        rows.append(_along(wall_.normal, _sum(before, after, -1), sign))
        other = _sum(last, after, sign)
        places = [last, other] if particle == 0 else [other, last]
        visit(1 - particle, other, sites[1])
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
    for moving, doors, here, there in ways:
        crossed = [on(a, [_from(a, b)]) for a, b in (cells.doors[door] for door in doors)]
        steps = [_sum(after, place, -1) for place, after in pairwise([here, *crossed, there])]
        legs.append((moving, list(range(len(norms), len(norms) + len(steps)))))
        norms += steps
    return norms, count, rows, legs, bounds


def route_values(certificate: Mapping[str, Any], tree: Mapping[str, Any]) -> Iterator[Fraction]:
    """Yield the bound of each leaf of a proof for cells, and check that no case is missing.

    The first value is the limit: plans that go through closed doors are only known to be as long.
    """
    task = _RouteTask(_Cells(certificate), tree["order"])
    proof = tree["proof"]
    task.explore(proof["covers"])
    yield task.most
    ways = [tuple(way["ends"]) for way in proof["ways"]]
    if sorted(ways) != sorted(task.needed_ends()):
        raise _WrongError("expected a proof for each cell in which a particle can end")
    for ends, way in zip(ways, proof["ways"], strict=True):
        task.ends = ends
        for pattern, leaf in _leaves(task, way["proof"]):
            yield task.value(pattern, leaf)


def _constant(spot: Spot) -> Place:
    return [{_ONE: x} for x in spot]


def _sum(one: Place, other: Place, sign: int) -> Place:
    return [
        {key: a.get(key, 0) + sign * b.get(key, 0) for key in a.keys() | b.keys()}
        for a, b in zip(one, other, strict=True)
    ]


def _along(normal: Spot, place: Place, sign: int) -> Row:
    row: Row = {}
    for factor, part in zip(normal, place, strict=True):
        for key, number in part.items():
            row[key] = row.get(key, 0) + sign * factor * number
    return row


def _from(one: Spot, other: Spot) -> Spot:
    return tuple(b - a for a, b in zip(one, other, strict=True))


def _left(one: Spot, other: Spot, spot: Spot) -> int:
    return (other[0] - one[0]) * (spot[1] - one[1]) - (other[1] - one[1]) * (spot[0] - one[0])


def _between(one: Spot, other: Spot, spot: Spot) -> bool:
    return all(min(a, b) <= x <= max(a, b) for a, b, x in zip(one, other, spot, strict=True))


def _space(one: Spot, other: Spot) -> Space:
    x, y = _from(one, other)
    return (-y, x), -y * one[0] + x * one[1]


def _convex_sides(corners: Sequence[Spot]) -> list[tuple[Spot, Spot]]:
    """Return the sides of a counter-clockwise polygon, and refuse one that is not convex."""
    sides = list(zip(corners, [*corners[1:], corners[0]], strict=True))
    along = [_from(a, b) for a, b in sides]
    ups = [y > 0 or (y == 0 and x > 0) for x, y in along]
    turns = sum(one and not before for before, one in pairwise([ups[-1], *ups]))
    bends = [a[0] * b[1] - a[1] * b[0] for a, b in pairwise([along[-1], *along])]
    straight = all(
        bend != 0 or a[0] * b[0] + a[1] * b[1] > 0
        for bend, (a, b) in zip(bends, pairwise([along[-1], *along]), strict=True)
    )
    if len(corners) < 3 or min(bends) < 0 or not straight or turns != 1:
        raise _WrongError("the corners are not those of a convex polygon")
    return sides
