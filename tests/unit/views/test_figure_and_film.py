"""One verb for a figure and one for a film, whatever part the episode is of."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from shoal import views
from shoal.core.errors import InvalidInputError
from shoal.search import SearchProblem
from shoal.search.run import run as run_search
from shoal.steering import SteeringProblem
from shoal.steering.run import run as run_steering
from shoal.swarm import GridWorkspace, SwarmProblem
from shoal.swarm.run import run as run_swarm
from shoal.views import figure, film

KINDS = {
    "swarm": ["map", "frontier"],
    "steering": ["plan"],
    "search": ["routes", "timeline", "success"],
}


@pytest.fixture(scope="module")
def episodes():
    points = [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)]
    return {
        "swarm": run_swarm(
            SwarmProblem(GridWorkspace(np.ones((4, 6))), particles=3, policy="closest-frontier"),
            seed=1,
        ),
        "steering": run_steering(SteeringProblem("square", *points, planner="greedy")),
        "search": run_search(
            SearchProblem("square:30", robots=2, footprint=10, prior=["ring:5,5:0.5=9"])
        ),
    }


@pytest.mark.parametrize("part", KINDS)
def test_every_kind_of_figure(part, episodes):
    for kind in KINDS[part]:
        assert isinstance(figure(episodes[part], kind=kind), Figure)
    first, named = (
        figure(episodes[part], **options).axes[0].get_title(loc="left")
        for options in ({}, {"kind": KINDS[part][0]})
    )
    assert first == named
    with pytest.raises(
        InvalidInputError, match=f"kind: expected one of {', '.join(KINDS[part])}, got 'portrait'"
    ):
        figure(episodes[part], kind="portrait")


@pytest.mark.parametrize("part", KINDS)
def test_pages(part, episodes, tmp_path):
    film(episodes[part], tmp_path / "film.HTML")
    assert (tmp_path / "film.HTML").read_text(encoding="utf-8").startswith("<!doctype html>")
    assert [path.name for path in tmp_path.iterdir()] == ["film.HTML"]


def test_options_of_a_kind(episodes):
    assert (
        figure(episodes["swarm"], moves=np.int64(1))
        .axes[0]
        .get_title(loc="left")
        .endswith("after 1 moves")
    )
    # each, and the median
    assert len(figure([episodes["swarm"]] * 3, kind="frontier").axes[0].lines) == 4


@pytest.mark.parametrize("wrong", [None, 3, [], "episode.npz"])
def test_anything_else_is_refused(wrong, tmp_path):
    with pytest.raises(
        InvalidInputError, match="episode: expected an episode of swarm, steering or search, got"
    ):
        figure(wrong)
    with pytest.raises(
        InvalidInputError, match="episode: expected an episode of swarm, steering or search, got"
    ):
        film(wrong, tmp_path / "film.gif")
    assert not list(tmp_path.iterdir())


def test_names():
    assert sorted(views.__all__) == ["figure", "film", "notebook_page", "save_figure"]
