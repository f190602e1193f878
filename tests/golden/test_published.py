"""Closest-frontier means against the published curves of paper M, Fig. 7: within 15 % (spec of the
swarm, section 4).

The data are those of the package, as plotted there: n, mean, standard deviation.
"""

from __future__ import annotations

import numpy as np
import pytest
from tests.swarm_runs import run_trials

from shoal import open_map
from shoal.papers.mapping.curves import MAPS
from shoal.papers.recipe import published_curve

PUBLISHED = {name: file for name, (_, file) in MAPS.items()}


def published_means(file: str) -> dict[int, float]:
    """Return n -> mean moves."""
    curve = published_curve(file)
    return dict(zip(curve.x.astype(int).tolist(), curve.mean.tolist(), strict=True))


@pytest.mark.parametrize("name", PUBLISHED)
def test_closest_frontier_means(name):
    workspace = open_map(name)
    means = published_means(PUBLISHED[name])
    for n in (100, 500, 1000, 2500, 4000):
        published = means[n]
        episodes = run_trials(workspace, trials=100, particles=n, seed=7)
        assert all(episode.status == "complete" for episode in episodes)
        mean = np.mean([episode.moves for episode in episodes])
        assert abs(mean / published - 1) < 0.15, (
            f"{name}, n = {n}: {mean:.1f} moves, published {published}"
        )


@pytest.mark.parametrize("name", [*PUBLISHED, "vessels:500", "maze:21x15", "cave:30x20"])
def test_every_cell_occupied_takes_four_moves_to_map_and_none_to_cover(name):
    workspace = open_map(name)
    assert {e.moves for e in run_trials(workspace, trials=3, particles=workspace.n_free)} == {4}
    assert {
        e.moves
        for e in run_trials(workspace, trials=3, particles=workspace.n_free, task="coverage")
    } == {0}


def test_sweep_takes_four_times_the_width():
    """Paper D, III.B.2: a rectangle k tall, k particles along its left wall: 4m/k moves."""
    for rows, columns in ((5, 8), (50, 100), (1, 6)):
        workspace = open_map(f"rectangle:{rows}x{columns}")
        (episode,) = run_trials(
            workspace, trials=1, policy="sweep", placement="left-wall", particles=rows
        )
        assert (episode.status, episode.moves) == ("complete", 4 * columns)


def test_depth_first_moves():
    """Paper M, III.B.1: at most 2(m - 1) moves on the tree, and one probe for each wall
    cell found.
    """
    for name in ("htree:300", "maze:21x15", "cave:20x14", "vessels:300", "rectangle:6x9"):
        workspace = open_map(name)
        for episode in run_trials(workspace, trials=10, policy="depth-first", particles=1):
            _, belief = episode.final()
            assert episode.status == "complete"
            assert episode.moves <= 2 * (workspace.n_free - 1) + len(belief.obstacles)
