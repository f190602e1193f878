"""Tours and their kernels against obvious implementations."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference import tours as reference

from shoal.search import Tour, hilbert_decode, hilbert_encode, make_tour, moore_decode
from shoal.search.kernels import runs


def to_cells(places, order):
    x, y = np.array(places).T
    return np.stack([2**order - 1 - y, x], axis=1)


@pytest.mark.parametrize("order", range(7))
def test_hilbert_is_the_curve_of_its_l_system(order):
    expected = to_cells(reference.hilbert_by_rewriting(order), order)
    assert np.array_equal(hilbert_decode(np.arange(4**order), order=order), expected)
    assert np.array_equal(make_tour("hilbert", (2**order, 2**order)).cells, expected)


@pytest.mark.parametrize("order", range(1, 7))
def test_moore_is_the_curve_of_its_l_system(order):
    expected = to_cells(reference.moore_by_rewriting(order), order)
    assert np.array_equal(moore_decode(np.arange(4**order), order=order), expected)
    assert np.array_equal(make_tour("moore", (2**order, 2**order)).cells, expected)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 7, 11, 20])
def test_hilbert_in_space_is_hamiltons(order):
    rng = np.random.default_rng(order)
    places = rng.integers(0, 2**order, (200, 3))
    cells = np.stack([places[:, 2], 2**order - 1 - places[:, 1], places[:, 0]], axis=1)
    assert hilbert_encode(cells, order=order).tolist() == [
        reference.hilbert_in_space(order, place) for place in places.tolist()
    ]


def test_metrics_are_their_definitions():
    rng = np.random.default_rng(5)
    for shape in ((1, 1), (1, 2), (1, 7), (5, 6), (8, 8), (9, 7), (3, 4, 5)):
        for closed in (True, False):
            cells = rng.permutation(np.argwhere(np.ones(shape)))[
                : rng.integers(1, np.prod(shape) + 1)
            ]
            for way in (cells, np.argwhere(np.ones(shape))):
                measured = Tour(way, shape, closed=closed, name="random").metrics()
                expected = reference.metrics(way, closed=closed)
                found = (
                    measured.length,
                    measured.turns,
                    measured.neighbour_stretch,
                    measured.dilation,
                )
                assert found == pytest.approx(expected), (shape, closed)


def test_round_a_tree_is_as_long_as_the_reference():
    rng = np.random.default_rng(7)
    for _ in range(20):
        full = largest(rng.random((rng.integers(1, 9), rng.integers(1, 9))) < 0.75)
        expected = reference.round_a_tree(full)
        tour = make_tour("spanning-tree", np.kron(full, np.ones((2, 2))).astype(bool))
        assert len(tour) == len(expected) == 4 * full.sum()
        assert tour.metrics().length == len(expected)
        assert sorted(map(tuple, tour.cells.tolist())) == sorted(expected)


def largest(full):
    from scipy.ndimage import label

    full[0, 0] = True
    labels = label(full)[0]
    return labels == np.bincount(labels.ravel())[1:].argmax() + 1


@pytest.mark.parametrize("count", [1, 2, 7, 60])
def test_the_next_strip_is_the_nearest(count):
    ends = np.random.default_rng(count).integers(0, 12, (count, 2, 2))  # often equally far
    order, backwards = np.empty((2, count), dtype=np.int64)
    runs.nearest_next(ends, order, backwards)
    here, left = ends[0, 0], set(range(count))
    for strip in order.tolist():
        ways = [(((ends[k, end] - here) ** 2).sum(), k, end) for k in left for end in (0, 1)]
        assert min(ways)[1:] == (strip, backwards[strip])
        here = ends[strip, 1 - backwards[strip]]
        left.remove(strip)
    assert not left
