"""The cells of a region, one by one: every cell intersected with the whole outline."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from tests.reference.regions import random_polygon

from shoal.search import cells_of, region_of


def plain_cells(area, grid):
    """Return for every cell the pieces of the region in it, largest first."""
    found = {}
    left, top = grid.corner
    for row in range(grid.shape[0]):
        for col in range(grid.shape[1]):
            x, y = left + col * grid.size, top - row * grid.size
            shape = area.intersection(shapely.box(x, y - grid.size, x + grid.size, y))
            pieces = [
                p
                for p in shapely.get_parts(shape)
                if p.geom_type == "Polygon" and p.area > 1e-9 * grid.size**2
            ]
            found[row, col] = sorted(pieces, key=lambda p: -p.area)
    return found


def plain_doors(plain, grid, down, right):
    """Return which neighbours' largest pieces have a stretch in common."""
    height, width = grid.shape
    doors = np.zeros((height - down, width - right), dtype=bool)
    for row, col in np.ndindex(doors.shape):
        one, other = plain[row, col], plain[row + down, col + right]
        if one and other:
            shared = one[0].buffer(1e-7).intersection(other[0].buffer(1e-7))
            doors[row, col] = (
                max(np.ptp(np.reshape(shared.bounds, (2, 2)), axis=0), default=0) > 1e-5
            )
    return doors


@pytest.mark.parametrize("seed", range(8))
def test_against_every_cell_by_itself(seed):
    region = region_of(random_polygon(np.random.default_rng(100 + seed)))
    grid = cells_of(region, 60.0)
    plain = plain_cells(region.area, grid)
    assert np.array_equal(
        grid.mask,
        [[bool(plain[row, col]) for col in range(grid.shape[1])] for row in range(grid.shape[0])],
    )
    whole = grid.clipped.whole
    for (row, col), pieces in plain.items():
        mine = grid.clipped.pieces[(grid.clipped.rows == row) & (grid.clipped.cols == col)]
        if whole[row, col]:
            assert pieces[0].area == pytest.approx(grid.size**2)
            assert len(mine) == 0
        else:
            assert np.allclose(
                sorted(shapely.area(mine)), sorted(piece.area for piece in pieces), rtol=1e-6
            )
    assert np.array_equal(grid.doors_east, plain_doors(plain, grid, 0, 1))
    assert np.array_equal(grid.doors_south, plain_doors(plain, grid, 1, 0))
