"""Answers of the studio beside those of the library: maps with painted cells, copies of episodes,
tiny workspaces.
"""

from __future__ import annotations

import base64

import numpy as np
import pytest

import shoal
from shoal.core.errors import InvalidInputError
from shoal.steering import SteeringProblem
from shoal.studio.answers import files, steering, vessels
from shoal.studio.folder import Folder
from shoal.swarm import SwarmProblem

CORRIDOR = np.array([[1, 1, 1, 1], [0, 0, 0, 1]], dtype=bool)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Folder(tmp_path)


def cells(free):
    return {
        "shape": list(free.shape),
        "free": base64.b64encode(np.packbits(free.ravel()).tobytes()).decode(),
    }


def test_particles_start_in_the_cells_that_were_painted(folder):
    problem = {"kind": "swarm", "map": "rectangle:2x4", "particles": 5}
    told = vessels.map_(folder, {"problem": problem, "seed": 3, "cells": cells(CORRIDOR)})
    expected = shoal.run(SwarmProblem(CORRIDOR, particles=5), seed=3)
    assert told["start"] == np.ravel_multi_index(tuple(expected.start.T), (2, 4)).tolist()
    assert (told["cells"], told["problem"]) == (5, None)
    told = vessels.map_(folder, {"problem": problem | {"particles": 6}, "cells": cells(CORRIDOR)})
    assert told["start"] is None
    assert "particles" in told["problem"]


def test_a_map_given_by_its_cells_is_not_shown_in_place_of_another(folder):
    for rows in (["...."], ["..", ".."]):
        problem = {"kind": "swarm", "map": {"name": "own", "rows": rows}, "particles": 1}
        told = vessels.map_(folder, {"problem": problem, "seed": 0})
        assert told["shape"] == [len(rows), len(rows[0])]


def test_copies_of_an_episode_are_its_own_problem_and_seed(folder):
    episode = shoal.run(
        SwarmProblem("maze:9x7", particles=3, policy="closest-frontier"), seed=2**60 + 1
    )
    episode.save("a.npz")
    told = files.copies(folder, {"file": "a.npz"})
    assert (
        told["command"]
        == f"shoal map maze:9x7 --particles=3 --policy=closest-frontier --seed={2**60 + 1}"
    )
    assert (told["problem"], told["seed"]) == (episode.problem.to_dict(), str(2**60 + 1))
    names = {}
    exec(told["python"], names)
    assert names["episode"].commands == episode.commands
    for about in ({}, {"file": "a.npz", "problem": episode.problem.to_dict()}):
        with pytest.raises(
            InvalidInputError, match="expected either a problem or the file of an episode"
        ):
            files.copies(folder, about)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_a_workspace_of_any_size_keeps_its_digits(folder, size):
    start, goal = [[0.2, 0.3], [0.5, 0.35]], [[0.8, 0.2], [0.3, 0.75]]
    ring = ", ".join(f"{x * size} {y * size}" for x, y in [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)])
    given = {
        "workspace": f"POLYGON (({ring}))",
        "start": (np.array(start) * size).tolist(),
        "goal": (np.array(goal) * size).tolist(),
        "tolerance": 1e-4 * size,
        "planner": "greedy",
    }
    told = steering.steer(folder, {"problem": given | {"kind": "steering"}})
    expected = shoal.run(SteeringProblem(**given))
    assert told["moves"] == expected.moves > 1
    ends = np.array([way[-1] for way in told["ways"]])
    assert np.abs(ends - expected.states[-1]).max() < 1e-4 * size
    place = steering.workspace(folder, {"problem": given | {"kind": "steering"}})
    assert np.ptp(place["rings"][0], axis=0) == pytest.approx([size, size])
    sets = steering.reach(folder, {"problem": given | {"kind": "steering"}, "moves": 2})["sets"]
    assert np.ptp(sets[0]["rings"][0], axis=0).max() > 0.1 * size
