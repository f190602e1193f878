"""Each plan lies in one case of each division of a proof, and no case of a plan is above it."""

from __future__ import annotations

import numpy as np
import pytest

from shoal.steering import disk, polygon, regular_polygon

pytest.importorskip("clarabel")

from shoal.steering.certificates.check import _Task
from shoal.steering.certificates.relaxation import HoldGap, Relaxation, round_directions
from shoal.steering.certificates.search import PatternTree, growth_bound


class Walls:
    """A slow simulation of two points, apart from that of Shoal."""

    def __init__(self, place, count):
        self.place, self.count = place, count

    def room(self, point, move):
        """Return the fraction of a move up to the wall, and the wall."""
        if self.place.round:
            a, b = move @ move, point @ move
            c = point @ point - self.place.radius**2
            share = (-b + np.sqrt(max(b * b - a * c, 0))) / a
            x, y = point + share * move
            return share, int(np.arctan2(y, x) / (2 * np.pi) % 1 * self.count)
        corners = self.place.vertices
        along = np.roll(corners, -1, axis=0) - corners
        normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
        depths = np.maximum(np.sum(normals * (point - corners), axis=1), 0)
        speeds = -normals @ move
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.where(speeds > 0, depths / speeds, np.inf)
        wall = int(np.argmin(shares))
        return shares[wall], wall

    def play(self, start, moves):
        """Return the end, the length of the inputs that move something, and the contacts."""
        points, length, contacts = start.copy(), 0.0, []
        for move in moves:
            rooms = [self.room(point, move) for point in points]
            one = int(np.argmin([share for share, _ in rooms]))
            first = min(rooms[one][0], 1.0)
            second = min(rooms[1 - one][0], 1.0)
            points[one] = points[one] + first * move
            points[1 - one] = points[1 - one] + second * move
            length += second * np.hypot(*move)
            if second > first + 1e-12:
                contacts.append((one, rooms[one][1]))
        return points, length, contacts


def _within(between, wall, count):
    return (wall - between[0]) % count < between[1] - between[0]


def _is_hold(hold, contacts, count):
    """Return whether contacts are some of one hold."""
    if not contacts or any(particle != hold.particle for particle, _ in contacts):
        return False
    low, high = hold.least[0], hold.most[1]
    if any(not _within((low, high), wall, count) for _, wall in contacts):
        return False
    walls = [low + (wall - low) % count for _, wall in contacts]
    least, most = min(walls), max(walls)
    orders = {
        np.sign(j - i) for i, a in enumerate(walls) for j, b in enumerate(walls)
        if (a, b) == (least, most)
    }  # fmt: skip
    return (
        hold.first[0] <= walls[0] < hold.first[1]
        and hold.last[0] <= walls[-1] < hold.last[1]
        and hold.least[0] <= least < hold.least[1]
        and hold.most[0] <= most < hold.most[1]
        and (not hold.order or 0 in orders or hold.order in orders)
    )


def _same(one, other, runs):
    """Return whether two contacts in turn are those of one hold."""
    return one[0] == other[0] if runs else one == other


def is_case(pattern, contacts, count, runs):
    """Return whether contacts divide into those of the items of a pattern, such that a hold beside
    a gap of all contacts has all contacts up to the gap that it may have.
    """
    ends = {0}
    for place, item in enumerate(pattern):
        after, before = (pattern[k] if 0 <= k < len(pattern) else 0 for k in (place + 1, place - 1))
        reached = set()
        for begin in ends:
            for end in range(begin, len(contacts) + 1):
                part = contacts[begin:end]
                if isinstance(item, HoldGap):
                    # beside a run that has all contacts of its particle up to the gap
                    again = part and (
                        (before and before.maximal[1] and part[0][0] == before.particle)
                        or (after and after.maximal[0] and part[-1][0] == after.particle)
                    )
                    reached |= {end} if _is_gap(item, part, count) and not again else set()
                elif _is_hold(item, part, count):
                    whole = not (
                        (after == HoldGap() and _same(part[-1], [*contacts, (2, 2)][end], runs))
                        or (
                            before == HoldGap()
                            and _same(part[0], [*contacts, (2, 2)][begin - 1], runs)
                        )
                    )
                    reached |= {end} if whole else set()
        ends = reached
    return len(contacts) in ends


def _is_gap(gap, contacts, count):
    return gap.holds is None or all(
        any(particle == arc.particle and _within(arc[:2], wall, count) for arc in gap.holds)
        for particle, wall in contacts
    )


PLACES = {
    "square": polygon([(0, 0), (1, 0), (1, 1), (0, 1)]),
    "triangle": polygon([(0, 0), (1, 0), (0.3, 0.2)]),
    "20-gon": regular_polygon(20),
    "disk": disk(0.5),
}


@pytest.mark.parametrize("name", PLACES)
def test_cases_of_plans(name):
    place = PLACES[name]
    rng = np.random.default_rng(list(PLACES).index(name))
    low, high = place.bounds
    tried = 0
    while tried < 8:
        start = rng.uniform(low, high, size=(2, 2))
        if not place.contains(start).all():
            continue
        tried += 1
        walls = Relaxation(place, start, start, 0.0, 1.0).walls
        count = walls.count
        # long moves end at walls, short ones move away
        moves = rng.normal(size=(rng.integers(2, 7), 2)) * rng.choice([0.05, 0.3, 1.0])
        goal, length, contacts = Walls(place, count).play(start, moves)
        relaxation = Relaxation(place, start, goal, 1e-6, length * 1.01)
        tree = PatternTree(relaxation, by_use=tried % 2 == 0 and not walls.runs)
        for _ in range(8):
            if tree.least_open >= tree.upper:
                break
            tree.step()
        assert growth_bound(relaxation) <= length * (1 + 1e-9)
        stack, ends = [tree.root], 0
        while stack:
            node = stack.pop()
            assert node.bound is None or node.bound.value <= length * (1 + 1e-9)
            if node.branching is None:
                ends += 1
                continue
            cases = [
                part for part in node.children if is_case(part.pattern, contacts, count, walls.runs)
            ]
            assert cases, (node.pattern, node.branching, contacts)
            stack += cases
        assert ends
        assert tree.lower <= length * (1 + 1e-9)


def _shares(place, start, moves):
    """Return the ends of a plan in a disk, its translations between its first and last contact, its
    adjustments, and the depth at the first contact.
    """
    walls, points = Walls(place, 1), start.copy()
    translated = since = adjusted = 0.0
    depth = None
    for move in moves:
        shares = [walls.room(point, move)[0] for point in points]
        one = int(np.argmin(shares))
        first, second = min(shares[one], 1.0), min(shares[1 - one], 1.0)
        size = np.hypot(*move)
        points[one] = points[one] + first * move
        since += first * size
        if second > first + 1e-12:
            apart = points[1 - one] + first * move - points[one]
            if depth is None:
                depth, since = -apart @ points[one] / place.radius, 0.0
            translated, since = translated + since, 0.0
            adjusted += (second - first) * size
        points[1 - one] = points[1 - one] + second * move
    return points, translated, adjusted, depth


def _growing(place, start, rng):
    """Return random moves, each the best of some for particles to part."""
    moves = []
    for _ in range(rng.integers(1, 10)):
        tried = rng.normal(size=(rng.integers(1, 24), 2)) * rng.choice([0.03, 0.1, 0.3, 1.0])
        ends = [_shares(place, start, [*moves, move])[0] for move in tried]
        moves.append(tried[np.argmax([np.hypot(*(end[1] - end[0])) for end in ends])])
    return moves


def _sliding(place, around, step, count):
    """Return a start with both particles on the wall of a disk, and moves that part them: the first
    one slides along the wall, and then the other one is pushed to the wall.
    """
    wall = 0.999999 * place.radius
    start = wall * np.array([[1.0, 0.0], [np.cos(around), np.sin(around)]])
    moves: list[np.ndarray] = []
    for angle in -step * np.arange(1, count + 1):
        held = _shares(place, start, moves)[0][0]
        moves.append(1.0001 * place.radius * np.array([np.cos(angle), np.sin(angle)]) - held)
        moves.append(np.array([-np.sin(angle - 0.02), np.cos(angle - 0.02)]))
    return start, np.array(moves)


def test_no_plan_in_a_disk_is_shorter_than_the_laws_of_growth():
    place, rng = disk(0.5), np.random.default_rng(0)
    tightest = {"adjustments": np.inf, "translations": np.inf}
    plans = [_sliding(place, around, 0.02, 50) for around in (0.3, 1.3)]
    for _ in range(150):
        start = rng.uniform(-0.3, 0.3, size=2) + 10 ** rng.uniform(-2, -0.7) * rng.normal(
            size=(2, 2)
        )
        if place.contains(start).all():
            plans.append((start, _growing(place, start, rng)))
    for start, moves in plans:
        goal, translated, adjusted, depth = _shares(place, start, moves)
        if depth is None:
            continue
        task = _Task(
            {
                "radius": 0.5,
                "center": [0.0, 0.0],
                "directions": round_directions().tolist(),
                "start": start.tolist(),
                "goal": goal.tolist(),
                "unit": 2.0,
                "tolerance": 0.0,
                "limit": 9.0,
                "runs": True,
            },
            (1, 2),
        )
        relaxation = Relaxation(place, start, goal, 0.0, 9.0)
        exact, searched = task.growth, relaxation._growth
        for size, (pushes, free, lines), eighth in (
            (task.whole / 2, exact, 8),
            (1 / relaxation.scale, searched, 1),
        ):
            least = max(free, *(offset - slope / eighth * depth * size for slope, offset in lines))
            assert pushes / size <= adjusted + 1e-9
            assert least / size <= translated + 1e-9
            if pushes > 0:
                tightest["adjustments"] = min(tightest["adjustments"], adjusted - pushes / size)
            if least > 0:
                tightest["translations"] = min(tightest["translations"], translated - least / size)
        unit = task.whole  # the certificate has the unit of the search
        np.testing.assert_allclose(exact[:2], np.multiply(searched[:2], unit), atol=1e-9 * unit)
        np.testing.assert_allclose(
            exact[2], np.multiply(searched[2], (8, unit)), atol=1e-9 * task.whole
        )
    assert max(tightest.values()) < 0.05
