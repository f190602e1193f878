"""Each plan lies in one case of each division of a proof, and no case of a plan is above it."""

from __future__ import annotations

import numpy as np
import pytest

from shoal.steering import disk, polygon, regular_polygon

pytest.importorskip("clarabel")

from shoal.steering.certificates.relaxation import HoldGap, Relaxation
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
