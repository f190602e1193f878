"""What holds for tours of any region, and for the curves at any order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shoal.search import (
    components,
    hilbert_decode,
    hilbert_encode,
    make_tour,
    moore_decode,
    moore_encode,
)
from shoal.search.tours import TOURS


@st.composite
def masks(draw, *, most=24):
    """Masks with at least one True cell, from sparse to full."""
    shape = draw(st.tuples(st.integers(1, most), st.integers(1, most)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    mask = rng.random(shape) < draw(st.sampled_from([0.2, 0.5, 0.8, 0.95, 1.0]))
    mask.flat[draw(st.integers(0, mask.size - 1))] = True
    return mask


@given(masks(), st.sampled_from(list(TOURS)))
def test_every_cell_once(mask, name):
    tour = make_tour(name, mask)
    assert sorted(map(tuple, tour.cells.tolist())) == sorted(map(tuple, np.argwhere(mask).tolist()))
    labels = components(mask)
    assert np.count_nonzero(np.diff(labels[tuple(tour.cells.T)])) == labels.max() - 1
    metrics = tour.metrics()
    assert metrics.length >= (len(tour) if tour.closed and len(tour) > 1 else len(tour) - 1)


@given(masks())
def test_spanning_tree_costs_at_most_every_cell_twice(mask):
    """In one component no tour need be longer than twice round a spanning tree of cells; ours is
    that short.
    """
    largest = components(mask) == 1
    assert (
        make_tour("spanning-tree", largest).metrics().length
        <= max(2 * (np.count_nonzero(largest) - 1), 0) + 1e-9
    )


@given(masks(most=9))
def test_full_blocks_are_toured_by_steps_to_neighbours(blocks):
    blocks = components(blocks) == 1
    mask = np.kron(blocks, np.ones((2, 2))).astype(bool)
    assert np.all(make_tour("spanning-tree", mask).steps == 1)


@given(
    masks(),
    st.sampled_from(["hilbert", "open-hilbert", "moore", "hilbert-ii", "hilbert-rectangle"]),
)
def test_restricting_commutes(mask, name):
    """In one component of full extent the tour is that of the rectangle without the
    cells left out.
    """
    mask[0, :] = mask[:, 0] = mask[-1, :] = mask[:, -1] = True
    mask = components(mask) == 1
    whole = make_tour(name, mask.shape).cells
    assert np.array_equal(make_tour(name, mask).cells, whole[mask[tuple(whole.T)]])


@given(
    st.tuples(st.integers(1, 4), st.integers(1, 6), st.integers(1, 6)),
    st.integers(0, 2**32),
    st.sampled_from(list(TOURS)),
)
def test_every_cell_of_all_layers_once(shape, seed, name):
    mask = np.random.default_rng(seed).random(shape) < 0.7
    mask.flat[0] = True
    tour = make_tour(name, mask)
    assert sorted(map(tuple, tour.cells.tolist())) == sorted(map(tuple, np.argwhere(mask).tolist()))
    assert tour.closed == (name != "open-hilbert")


@given(st.integers(2, 4), st.integers(1, 5), st.integers(1, 5))
def test_spanning_tree_of_layers_of_full_blocks_is_as_short_as_can_be(layers, rows, columns):
    """Two climbs take the place of two steps a layer: each cell costs one step, to a neighbour."""
    tour = make_tour("spanning-tree", (layers, 2 * rows, 2 * columns))
    assert (tour.steps == 1).all()
    climbs = np.abs(np.diff(np.append(tour.cells[:, 0], tour.cells[0, 0])))
    assert climbs.sum() == 2 * (layers - 1)


@given(st.tuples(st.integers(1, 12), st.integers(1, 12), st.integers(1, 12)), st.integers(0, 2**32))
def test_every_cell_of_a_box_once(shape, seed):
    mask = np.random.default_rng(seed).random(shape) < 0.7
    mask.flat[0] = True
    for name in ("hilbert", "hilbert-rectangle"):
        for region in (mask, np.ones(shape, dtype=bool)):
            assert len(make_tour(name, region)) == region.sum()


@given(st.data(), st.sampled_from([2, 3]))
def test_decode_undoes_encode(data, dimensions):
    order = data.draw(st.integers(0, 31 if dimensions == 2 else 20))
    cells = np.array(
        data.draw(
            st.lists(
                st.tuples(*[st.integers(0, 2**order - 1)] * dimensions), min_size=1, max_size=20
            )
        )
    )
    indices = hilbert_encode(cells, order=order)
    assert np.array_equal(hilbert_decode(indices, order=order, dimensions=dimensions), cells)
    assert indices.min() >= 0
    assert int(indices.max()) < 2 ** (order * dimensions)
    if dimensions == 2:
        assert np.array_equal(moore_decode(moore_encode(cells, order=order), order=order), cells)


@given(st.data(), st.sampled_from([hilbert_decode, moore_decode]), st.sampled_from([2, 3]))
def test_consecutive_indices_are_neighbours(data, decode, dimensions):
    options = {"dimensions": 3} if dimensions == 3 and decode is hilbert_decode else {}
    order = data.draw(st.integers(1, 20))
    index = data.draw(st.integers(0, 2 ** (order * (3 if options else 2)) - 2))
    one, other = decode([index, index + 1], order=order, **options)
    assert np.abs(one - other).sum() == 1


@given(st.integers(0, 12))
def test_the_first_quarter_is_the_curve_of_the_order_below_transposed(order):
    count = min(4**order, 500)
    x_y = [to_places(hilbert_decode(np.arange(count), order=k), k) for k in (order, order + 1)]
    assert np.array_equal(x_y[0], x_y[1][:, ::-1])


def to_places(cells, order):
    return np.stack([cells[:, 1], 2**order - 1 - cells[:, 0]], axis=1)


@pytest.mark.parametrize("name", list(TOURS))
def test_tours_do_not_depend_on_the_margin_round_the_region(name):
    rng = np.random.default_rng(3)
    for _ in range(10):
        mask = rng.random((13, 9)) < 0.8
        mask[[0, -1], :] = mask[:, [0, -1]] = True
        padded = np.pad(mask, ((2, 5), (3, 1)))
        assert np.array_equal(
            make_tour(name, padded).cells, make_tour(name, mask).cells + np.array([2, 3])
        )
