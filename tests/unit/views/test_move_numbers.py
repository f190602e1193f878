"""The numbers of moves in figures of plans stand beside the paths, not on them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import shoal
from shoal.steering.planners import annealing, sampling
from shoal.views.steering.figures import plan_figure

CORNER = {
    "type": "region",
    "outline": [[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3]],
    "obstacles": [],
}
CHANNEL = {"type": "polygon", "vertices": [[0, 0], [3, 0], [3, 1], [2, 1.5], [0, 1]]}
PLANS = {
    "square": ("square", {"start": [(0.2, 0.3), (0.5, 0.35)], "goal": [(0.8, 0.2), (0.3, 0.75)]}),
    "disk": (
        "disk",
        {
            "start": [(0.2, 0.2), (-0.1, -0.1)],
            "goal": [(-0.35, 0.2), (0.35, -0.25)],
            "planner": "greedy",
        },
    ),
    "channel": (CHANNEL, {"start": [(0.4, 0.5), (1.2, 0.6)], "goal": [(2.5, 0.4), (0.6, 0.8)]}),
    "corner": (CORNER, {"start": [(0.4, 2.5), (0.6, 2.0)], "goal": [(3.5, 0.4), (2.6, 0.8)]}),
}


@pytest.mark.parametrize("name", PLANS)
def test_numbers_of_moves_stand_beside_the_paths(name, monkeypatch):
    monkeypatch.setattr(sampling, "MORE_TREES", 3)  # a plan around a corner, not the shortest
    monkeypatch.setattr(annealing, "STAGES", ((4, 500), (2, 2000)))
    workspace, fields = PLANS[name]
    episode = shoal.run(workspace, **fields)
    figure = plan_figure(episode)
    figure.draw_without_rendering()
    axes, numbers = figure.axes[0], [text for text in figure.axes[0].texts if text.get_text()]
    assert {text.get_text() for text in numbers} >= {str(episode.moves)}
    boxes = [text.get_window_extent() for text in numbers]
    shares = np.linspace(0, 1, 400)[:, None]
    for particle in range(episode.problem.n_particles):
        way = axes.transData.transform(episode.states[:, particle])
        points = np.concatenate([here + shares * (there - here) for here, there in pairwise(way)])
        for box, text in zip(boxes, numbers, strict=True):
            assert not box.count_contains(points), (
                f"{text.get_text()} lies on a move of particle {particle + 1}"
            )
    assert not any(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k])
