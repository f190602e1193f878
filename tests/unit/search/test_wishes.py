"""Markers in place of messages, and a region from energy, each against an own small computation."""

from __future__ import annotations

import itertools
from math import ceil, hypot, inf

import numpy as np
import pytest

from shoal.core.errors import InvalidInputError
from shoal.papers.search.wishes import SIDE, without_messages
from shoal.search import affordable_rectangle


def test_markers_make_the_longest_arc_the_time():
    rng = np.random.default_rng(2)
    for m in (1, 2, 7):
        starts = rng.choice(SIDE * SIDE, m, replace=False)
        arcs = [
            min((int(other) - int(start) - 1) % SIDE**2 + 1 for other in starts) for start in starts
        ]
        searched, last, share = without_messages(starts, stop=True)
        assert (searched, last) == (max(arcs) / SIDE**2, max(arcs) / SIDE**2)
        assert share == 1
    _, last, share = without_messages(np.array([3, 90]), stop=False)
    assert (last, share) == (1, 1)


def test_a_dead_robots_marker_leaves_its_arc_and_ignoring_it_does_not():
    starts = np.array([200, 10, 80])
    searched, _, share = without_messages(starts, stop=True, dead=1)
    assert searched == inf
    # from 200 round to 10
    assert share == pytest.approx(1 - (10 - 200) % SIDE**2 / SIDE**2)
    searched, last, share = without_messages(starts, stop=False, dead=1)
    assert searched < inf
    assert (last, share) == (1, 1)


def test_affordable_rectangle_by_trying_all_margins():
    rng = np.random.default_rng(4)
    for _ in range(20):
        starts, ranges = rng.uniform(0, 60, (3, 2)), rng.uniform(1500, 3000, 3)
        low, high = affordable_rectangle(starts, ranges, footprint=7, losses=1)
        left = sum(sorted(ranges)[:2])
        best = -1
        for half in itertools.count():
            width, height = np.ptp(starts, axis=0) + 7 * half
            cells = ceil(width / 7) * ceil(height / 7)
            if (cells + 1) * 7 > left - 4 * hypot(width, height):
                break
            best = half
        assert np.allclose(low, starts.min(axis=0) - 3.5 * best)
        assert np.allclose(high, starts.max(axis=0) + 3.5 * best)
    with pytest.raises(InvalidInputError, match="m too little"):
        affordable_rectangle([(0, 0), (100, 100)], [100, 100], footprint=10)
    with pytest.raises(InvalidInputError, match="as many ranges"):
        affordable_rectangle([(0, 0)], [100, 100], footprint=10)
