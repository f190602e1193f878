"""Tables of presses between differences of two particles, against a plain search over single points."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from tests.soak import often

from shoal.steering import SteeringProblem, region
from shoal.steering.contact.friction import friction_limit
from shoal.steering.contact.world import ContactWorld, RegionWorld
from shoal.steering.kernels.pressing import CYCLE, MOST_LEFT
from shoal.steering.planners.bounds import Bounds
from shoal.steering.planners.pressing import PressingSearch, pressing_of
from shoal.steering.workspaces.region import Region

L_SHAPE = region([(0, 0), (1, 0), (1, 0.5), (0.5, 0.5), (0.5, 1), (0, 1)])
TRIED, PROVED = often(2, 3), often(4, 8)  # differences
RINGS = {
    "square": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "L": [(0, 0), (1, 0), (1, 0.5), (0.5, 0.5), (0.5, 1), (0, 1)],
}


def search_of(place, friction):
    space = SteeringProblem(place).place
    world = (RegionWorld if isinstance(space, Region) else ContactWorld)(space)
    pressing = pressing_of(Bounds(friction), float(space.size))._replace(friction=friction)
    return PressingSearch(world, pressing, np.random.default_rng(0))


def one_press(name, friction, before, rng):
    """Return a difference after one random press, or None if the particles have no room for it."""

    shape, ring = shapely.Polygon(RINGS[name]), np.array(RINGS[name], dtype=float)
    edge = rng.integers(len(ring))
    a, b = ring[edge], ring[(edge + 1) % len(ring)]
    along = (b - a) / np.linalg.norm(b - a)
    inward = np.array([-along[1], along[0]])
    place = a + rng.random() * (b - a)
    push = rng.random() * (-inward + rng.uniform(-friction, friction) * along)
    sign = rng.choice([-1.0, 1.0])  # the other particle is at place + sign * difference
    way = shapely.LineString([place + sign * before, place + sign * before + push])
    return before + sign * push if shape.buffer(1e-9).covers(way) else None


@pytest.mark.parametrize("name", ["square", "L"])
@pytest.mark.parametrize("friction", [0.5, 1.0])
def test_a_press_that_is_possible_is_in_the_table(name, friction):
    """One random press away from the goals' difference, the table says not many more."""
    rng = np.random.default_rng(3)
    search = search_of("square" if name == "square" else L_SHAPE, friction)
    tried = 0
    for _ in range(200):
        before = rng.uniform(-0.7, 0.7, 2)
        after = one_press(name, friction, before, rng)
        if after is None or np.linalg.norm(after - before) < 0.15 or tried == TRIED:
            continue
        tried += 1
        state, goal = (np.array([[0.5, 0.5], 0.5 + change]) for change in (before, after))
        # neighbours, because a table has cells
        near = [
            search.moves_left(state + np.array([[0, 0], shift]), goal)
            for shift in 0.02 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        ]
        assert min(near) <= 2 * CYCLE
    assert tried == TRIED


def test_what_is_proved_impossible_is_not_in_the_table():
    friction, rng = 0.5, np.random.default_rng(1)
    space = SteeringProblem("square").place
    proved = 0
    for _ in range(40):
        before, after = rng.uniform(-0.8, 0.8, (2, 2))
        if proved == PROVED or friction_limit(space, friction, before, after, near=0.06) is None:
            continue
        proved += 1
        state, goal = (np.array([[0.5, 0.5], 0.5 + change]) for change in (before, after))
        assert search_of("square", friction).moves_left(state, goal) > MOST_LEFT / 2
    assert proved == PROVED
