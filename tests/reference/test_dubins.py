"""Dubins curves from the tangents of turning circles, and headings along paths one by one."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from shoal.search.flight.dubins import WORDS, dubins_parts, dubins_paths
from shoal.search.kernels.dubins import choose_headings, shortest_curves

ROUND = 2 * math.pi
RADIUS = 40.0


def side_center(pose, side):
    """Return the centre of the turning circle on one side of a pose (x, y, heading)."""
    x, y, heading = pose
    return complex(x, y) + side * RADIUS * complex(-math.sin(heading), math.cos(heading))


def driven(pose, side, angle):
    """Return the pose after an arc to the left (1) or the right (-1)."""
    center = side_center(pose, side)
    heading = pose[2] + side * angle
    place = center - side * RADIUS * complex(-math.sin(heading), math.cos(heading))
    return place.real, place.imag, heading


def curves(start, end, word):
    """Return the parts (angle, length divided by the radius or angle, angle) of all curves of a
    type with a straight part or with a long middle arc.
    """
    first, last = (1 if word[k] == "L" else -1 for k in (0, 2))
    begin, goal = side_center(start, first), side_center(end, last)
    way = goal - begin
    if word[1] == "S":
        across = RADIUS * (first - last)  # by which the straight line leads to the left
        if abs(way) < abs(across):
            return []
        straight = math.sqrt(abs(way) ** 2 - across**2)
        heading = math.atan2(way.imag, way.real) + math.atan2(across, straight)
        return [(first * (heading - start[2]), straight / RADIUS, last * (end[2] - heading))]
    if abs(way) > 4 * RADIUS:
        return []
    found = []
    for side in (1, -1):
        # the middle circle touches both others
        middle = begin + 2 * RADIUS * way / abs(way) * complex(
            abs(way) / 4 / RADIUS, side * math.sqrt(1 - (abs(way) / 4 / RADIUS) ** 2)
        )
        touch, leave = (begin + middle) / 2, (goal + middle) / 2
        angles = [math.atan2((p - middle).imag, (p - middle).real) for p in (touch, leave)]
        arc = (-first * (angles[1] - angles[0])) % ROUND
        if arc >= math.pi:
            turned = math.atan2((touch - begin).imag, (touch - begin).real) + first * math.pi / 2
            after = turned - first * arc
            found.append((first * (turned - start[2]), arc, last * (end[2] - after)))
    return found


def shortest(start, end, word):
    """Return the length of the shortest curve of a type, divided by the radius."""
    lengths = []
    for first, middle, last in curves(start, end, word):
        turns = [angle % ROUND for angle in (first, last)]
        turns = [0.0 if angle > ROUND - 1e-7 else angle for angle in turns]
        lengths.append(middle + sum(turns))
        pose = driven(start, 1 if word[0] == "L" else -1, turns[0])
        if word[1] == "S":
            along = RADIUS * middle * complex(math.cos(pose[2]), math.sin(pose[2]))
            pose = pose[0] + along.real, pose[1] + along.imag, pose[2]
        else:
            pose = driven(pose, -1 if word[0] == "L" else 1, middle)
        pose = driven(pose, 1 if word[2] == "L" else -1, turns[1])
        assert abs(complex(*pose[:2]) - complex(*end[:2])) < 1e-4
        assert abs(math.sin((pose[2] - end[2]) / 2)) < 1e-6
    return min(lengths, default=math.inf)


@pytest.mark.parametrize("apart", [5.0, 60.0, 300.0])
def test_curves_are_those_of_tangents(apart):
    rng = np.random.default_rng(17)
    starts, ends = (
        np.column_stack([rng.uniform(-apart, apart, (150, 2)), rng.uniform(-4, 4, 150)])
        for _ in range(2)
    )
    lengths = dubins_parts(starts, ends, RADIUS).sum(axis=-1)
    expected = [
        [shortest(start, end, word) for word in WORDS]
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True)
    ]
    np.testing.assert_allclose(lengths, expected, atol=1e-6)
    assert apart < 100 or np.isinf(lengths).any()


def test_the_shortest_curve_of_each_pair_of_headings():
    rng = np.random.default_rng(18)
    places = rng.uniform(-100, 100, (2, 20, 2))
    headings = rng.uniform(-4, 4, (2, 20, 5))
    headings[rng.random(headings.shape) < 0.2] = np.nan
    lengths, words = np.empty((20, 5, 5)), np.empty((20, 5, 5), dtype=np.int8)
    shortest_curves(*places, *headings, RADIUS, lengths, words)
    for link, i, j in np.ndindex(lengths.shape):
        ends = [[*places[end, link], headings[end, link, k]] for end, k in ((0, i), (1, j))]
        if np.isnan(ends).any():
            assert lengths[link, i, j] == np.inf
            assert words[link, i, j] == 0
            continue
        every = [shortest(*ends, word) for word in WORDS]
        assert lengths[link, i, j] == pytest.approx(min(every), abs=1e-6)
        assert every[words[link, i, j]] == pytest.approx(min(every), abs=1e-6)


def test_of_mirrored_curves_the_first_is_chosen():
    """Rounding chose before: a teardrop to the left here, to the right on another machine."""
    rng = np.random.default_rng(19)
    starts, course = rng.uniform(-100, 100, (50, 2)), rng.uniform(-4, 4, (50, 1))
    ahead = np.column_stack([np.cos(course), np.sin(course)]) * rng.uniform(0, 300, (50, 1))
    lengths, words = np.empty((50, 1, 1)), np.empty((50, 1, 1), dtype=np.int8)
    shortest_curves(starts, starts + ahead, course, course + np.pi, RADIUS, lengths, words)
    assert np.isin(words, [WORDS.index(word) for word in ("LSL", "LSR", "RLR")]).all()
    assert len(np.unique(words)) > 1


@pytest.mark.parametrize("seed", range(20))
def test_headings_are_those_of_the_shortest_of_all_paths(seed):
    rng = np.random.default_rng(seed)
    count, n_legs = 3, 6
    link_of = np.where(rng.random(n_legs) < 0.3, -1, 0)
    link_of[link_of == 0] = rng.permutation(n_legs)[: int((link_of == 0).sum())]
    lengths = rng.integers(1, 5, (n_legs, count, count)).astype(np.float64)
    lengths[rng.random(lengths.shape) < 0.4] = np.inf
    possible = rng.random(count) < 0.7

    def length(headings):
        total = 0.0 if possible[headings[0]] else math.inf
        for leg, (i, j) in enumerate(itertools.pairwise(headings)):
            if link_of[leg] >= 0:
                total += lengths[link_of[leg], i, j]
            elif i or j:
                total = math.inf
        return total

    def shortest_paths(n_points):
        every = {way: length(way) for way in itertools.product(range(count), repeat=n_points)}
        least = min(every.values())
        return least, [way for way, total in every.items() if total == least]

    chosen = np.zeros(n_legs + 1, dtype=np.int64)
    lost = choose_headings(possible, link_of, lengths, chosen)
    reached = [shortest_paths(n_points)[0] < math.inf for n_points in range(2, n_legs + 2)]
    assert lost == (0 if all(reached) else 1 + reached.index(False))
    if not lost:
        least, equal = shortest_paths(n_legs + 1)
        assert length(chosen.tolist()) == least
        # the first headings at the last points
        assert tuple(chosen.tolist()) == min(equal, key=lambda headings: headings[::-1])


def test_paths_fill_no_more_than_their_points():
    rng = np.random.default_rng(20)
    starts, words = rng.uniform(-9, 9, (300, 3)), rng.integers(6, size=300)
    parts = rng.uniform(0, 2 * np.pi, (300, 3)) * rng.integers(2, size=(300, 3))
    points, numbers = dubins_paths(starts, words, parts, RADIUS)
    assert len(points) == len(numbers)
    for wrong in (-1.0, np.inf, np.nan):
        parts[7, 1] = wrong
        with pytest.raises(AssertionError):
            dubins_paths(starts, words, parts, RADIUS)
