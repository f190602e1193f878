"""Scaling of masks: what was connected stays connected, what was far apart stays apart, and nothing
swells.
"""

from __future__ import annotations

from math import ceil

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy import ndimage

from shoal.swarm.maps.resampling import (
    block_shares,
    cells_of_shares,
    diagonal_contacts,
    join_diagonals,
    scale_cells,
)

SCALES = (0.5, 0.25, 0.125, 1 / 3, 0.3, 0.77)


def parts(free):
    return ndimage.label(free)


def tree(seed, side=97, ndim=2):
    """Return random walks from one cell: a connected tree of lines, one cell wide."""
    rng = np.random.default_rng(seed)
    free = np.zeros((side,) * ndim, dtype=bool)
    cells = [np.full(ndim, side // 2)]
    for _ in range(12 * ndim):
        at = cells[rng.integers(len(cells))].copy()
        axis, sign = rng.integers(ndim), rng.choice([-1, 1])
        for _ in range(rng.integers(5, side)):
            at[axis] = np.clip(at[axis] + sign, 0, side - 1)
            free[tuple(at)] = True
            cells.append(at.copy())
            if rng.random() < 0.3:
                axis, sign = rng.integers(ndim), rng.choice([-1, 1])
    free[tuple(cells[0])] = True
    return free


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("seed", range(6))
def test_a_thin_tree_stays_one_tree_and_thin(seed, scale):
    free = tree(seed)
    small = scale_cells(free, scale)
    assert parts(free)[1] == 1
    assert parts(small)[1] == 1
    covered = cells_with_pixels(free, small.shape)
    assert not (small & ~covered).any()
    # each pixel of the tree is near a cell of the small tree: the branches keep their length
    assert (ndimage.distance_transform_cdt(~small) * covered).max() <= 2
    # and where no block is half full, a line is one cell wide: hardly a square of four such cells
    # is free
    thin = small & (block_shares(free, small.shape) < 0.5)
    squares = thin[:-1, :-1] & thin[1:, :-1] & thin[:-1, 1:] & thin[1:, 1:]
    assert squares.sum() <= 0.02 * small.sum()


def cells_with_pixels(free, shape):
    """Return the cells that contain a free pixel."""
    cells = np.zeros(shape, dtype=bool)
    at = np.argwhere(free) * np.array(shape) // np.array(free.shape)
    cells[tuple(at.T)] = True
    return cells


@given(
    free=arrays.arrays(np.bool_, arrays.array_shapes(min_dims=2, max_dims=3, max_side=14)),
    scale=st.sampled_from(SCALES),
)
def test_each_part_gives_one_part_and_distant_parts_stay_apart(free, scale):
    small = scale_cells(free, scale)
    labels, count = parts(free)
    after, _ = parts(small)
    blocks = np.array(small.shape) / np.array(free.shape)
    for part in range(1, count + 1):
        pixels = np.argwhere(labels == part)
        cells = np.unique(
            np.floor(pixels * np.array(small.shape) // np.array(free.shape)).astype(int), axis=0
        )
        reached = after[tuple(cells.T)]
        if len(pixels) * blocks.prod() >= 0.5:
            assert (reached > 0).any()
        assert len(set(reached[reached > 0].tolist())) <= 1
    for one in range(1, count + 1):
        for two in range(1, one):
            gap = np.array(
                [
                    span(labels, one, axis)[0] - span(labels, two, axis)[1]
                    for axis in range(free.ndim)
                ]
            )
            other = np.array(
                [
                    span(labels, two, axis)[0] - span(labels, one, axis)[1]
                    for axis in range(free.ndim)
                ]
            )
            if count == 2 and (np.maximum(gap, other) >= 2 * ceil(1 / scale) + 1).any():
                at = [
                    set(after[small & cells_with_pixels(labels == part, small.shape)].tolist())
                    for part in (one, two)
                ]
                assert not at[0] & at[1]


def span(labels, part, axis):
    places = np.argwhere(labels == part)[:, axis]
    return int(places.min()), int(places.max())


@pytest.mark.parametrize("scale", [0.5, 0.25, 0.125, 1 / 3])
def test_thick_things_neither_swell_nor_merge(scale):
    free = np.zeros((120, 120), dtype=bool)
    for row, column in ((8, 8), (8, 72), (72, 8), (72, 72)):
        free[row : row + 40, column : column + 40] = True
        free[row + 8 : row + 32, column + 8 : column + 32] = False  # a hole in each
    small = scale_cells(free, scale)
    assert parts(small)[1] == 4
    assert parts(~small)[1] == 5
    assert abs(small.mean() - free.mean()) < 0.2 * free.mean() + 0.03


def test_a_vessel_of_three_layers_stays_connected_in_a_stack_scaled_in_its_plane():
    free = tree(3, side=40, ndim=3)
    small = scale_cells(free, (1.0, 0.25, 0.25))
    assert small.shape == (40, 10, 10)
    assert parts(small)[1] == 1
    assert parts(scale_cells(free, 0.25))[1] == 1


def test_dust_vanishes_and_a_short_line_does_not():
    free = np.zeros((64, 64), dtype=bool)
    free[5, 5] = free[40, 9:11] = True
    free[20, 4:40] = True
    small = scale_cells(free, 0.125)
    assert parts(small)[1] == 1
    assert small.sum() == 5


def test_enlarging_repeats_cells():
    free = tree(1, side=9)
    assert np.array_equal(scale_cells(free, 3), np.kron(free, np.ones((3, 3), dtype=bool)))
    assert np.array_equal(scale_cells(scale_cells(free, 3), 1 / 3), free)


BETWEEN_TWO = np.zeros((6, 6), dtype=bool)  # either corner of the contact touches a third part
BETWEEN_TWO[[1, 2, 3, 4], [4, 2, 3, 1]] = True


@given(free=arrays.arrays(np.bool_, arrays.array_shapes(min_dims=2, max_dims=3, max_side=9)))
@example(free=BETWEEN_TWO)
def test_joined_contacts_connect_what_touches_and_nothing_far_apart(free):
    joined = join_diagonals(free)
    assert diagonal_contacts(joined) == 0
    assert not (free & ~joined).any()
    around = np.ones((3,) * free.ndim)
    touching, count = ndimage.label(free, around)
    after, number = parts(joined)
    # cells with at most two cells between them may be connected by the corners of others
    assert ndimage.label(ndimage.binary_dilation(free, around), around)[1] <= number <= count
    assert all(len(set(after[touching == part].tolist())) == 1 for part in range(1, count + 1))


def test_a_circle_of_half_full_cells_does_not_fall_apart():
    share = np.full((5, 5), 0.2, dtype=np.float32)
    share[0, 0] = share[4, 4] = 1
    free = cells_of_shares(share)
    assert parts(free)[1] == 1
    assert free[0, 0]
    assert free[4, 4]
    assert free.sum() == 9
