"""Windows and measures of many worlds against the planes of all cells, cut and summed by NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from shoal.swarm import SwarmProblem
from shoal.swarm.batch import PLANES, WorldBatch

BEYOND = [0, 0, 1, 0, 0, 0]  # of each plane: cells beyond the map are obstacles


def window_of(planes, center, side):
    """Return the window of one world: the planes, padded and cut."""
    pads = [(side, side)] * len(center)
    padded = [
        np.pad(plane, pads, constant_values=beyond)
        for plane, beyond in zip(planes, BEYOND, strict=True)
    ]
    cut = tuple(slice(c + side - side // 2, c + side + side // 2 + 1) for c in center)
    return np.array([plane[cut] for plane in padded])


def played(fields):
    batch = WorldBatch(SwarmProblem(**fields, max_moves=100), worlds=6)
    rng = np.random.default_rng(1)
    for _ in range(12):
        batch.step(rng.integers(2 * batch.layout.ndim, size=6))
    return batch, rng


CASES = [
    *({"map": f"rectangle:9x{width}", "particles": 40} for width in (61, 62, 63, 127)),
    {"map": "vessels:200", "particles": 60, "rule": "merge"},
    {"map": "vessels3d:100", "particles": 30},
    {"map": "vessels:100", "particles": 20, "task": "coverage", "rule": "tilt"},
]


@pytest.mark.parametrize("fields", CASES, ids=str)
def test_windows_are_cut_from_planes(fields):
    batch, rng = played(fields)
    planes, shape = batch.planes(PLANES), np.array(batch.layout.window)
    for side in (1, 3, 33, 65) if batch.layout.ndim == 2 else (3, 9):
        centers = rng.integers(0, shape, size=(6, len(shape)))
        centers[0], centers[1] = 0, shape - 1
        expected = [window_of(*pair, side) for pair in zip(planes, centers, strict=True)]
        np.testing.assert_array_equal(batch.windows(PLANES, centers, side), expected)
    where = np.arange(6) == 4
    chosen = batch.windows(PLANES[:4], centers[4:5], 5, where=where)
    np.testing.assert_array_equal(chosen[0], window_of(planes[4], centers[4], 5)[:4])


@pytest.mark.parametrize("fields", CASES, ids=str)
def test_measures_are_sums_of_planes(fields):
    batch, _ = played(fields)
    sums, alone = batch.measures(), batch.measures(commands=False)
    ways = [(-1, -1), (-2, -1), (-1, 1), (-2, 1), (-3, -1), (-3, 1)]  # axis and step, by command
    for i, planes in enumerate(batch.planes(PLANES)):
        particles, obstacles, frontier = planes[0].astype(int), planes[2], planes[3]
        room = (obstacles == 0) & (particles == 0)
        for command, (axis, step) in enumerate(ways[: 2 * batch.layout.ndim]):
            entered = np.roll(particles, step, axis=axis)
            assert sums.probing[i, command] == (entered * frontier).sum()
            assert sums.moving[i, command] == (entered * room).sum()
        cells = np.argwhere(particles)
        weights = particles[tuple(cells.T)][:, None]
        np.testing.assert_array_equal(sums.places[i], (weights * cells).sum(axis=0))
        np.testing.assert_array_equal(sums.squares[i], (weights * cells**2).sum(axis=0))
        assert sums.particles[i] == particles.sum()
        assert sums.frontier[i] == frontier.sum()
    assert alone.probing.shape == alone.moving.shape == (6, 0)
    for name in ("places", "squares", "particles", "frontier", "known"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(sums, name))
