"""Answers of the studio beside those of the library: maps with painted cells, copies of episodes,
tiny workspaces.
"""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest

import shoal
from shoal.core.errors import InvalidInputError
from shoal.rigs import PhysicsRig, PlantProperties, drive
from shoal.steering import SteeringProblem
from shoal.studio.answers import files, lab, steering, vessels
from shoal.studio.application import JSONResponse
from shoal.studio.folder import Folder
from shoal.swarm import GridWorkspace, SwarmProblem
from shoal.swarm.maps.files import read_map

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


def test_painted_cells_follow_into_their_own_file_and_into_no_other(folder):
    first = vessels.sketch(folder, cells(CORRIDOR) | {"name": "rectangle:2x4"})
    assert first == {"file": "rectangle-painted.png"}
    again = vessels.sketch(
        folder, cells(~CORRIDOR) | {"name": "rectangle:2x4", "over": first["file"]}
    )
    assert again == first
    assert np.array_equal(read_map(first["file"]).free, ~CORRIDOR)
    for other in ("eye.png", "../x-painted.png", "a/x-painted.png"):
        with pytest.raises(InvalidInputError, match="over: expected the file of a painted map"):
            vessels.sketch(folder, cells(CORRIDOR) | {"over": other})


def test_particles_start_in_the_cells_that_were_painted(folder):
    problem = {"kind": "swarm", "map": "rectangle:2x4", "particles": 5}
    told = vessels.map_(folder, {"problem": problem, "seed": 3, "cells": cells(CORRIDOR)})
    expected = shoal.run(SwarmProblem(CORRIDOR, particles=5), seed=3)
    assert told["start"] == np.ravel_multi_index(tuple(expected.start.T), (2, 4)).tolist()
    assert (told["cells"], told["problem"]) == (5, None)
    told = vessels.map_(folder, {"problem": problem | {"particles": 6}, "cells": cells(CORRIDOR)})
    assert told["start"] is None
    assert told["problem"]["field"] == "particles"


def test_a_map_given_by_its_cells_is_not_shown_in_place_of_another(folder):
    for rows in (["...."], ["..", ".."]):
        problem = {"kind": "swarm", "map": {"name": "own", "rows": rows}, "particles": 1}
        told = vessels.map_(folder, {"problem": problem, "seed": 0})
        assert told["shape"] == [len(rows), len(rows[0])]


def test_the_log_of_a_drive_is_played_with_the_true_positions_of_a_plant(folder):
    pytest.importorskip("pymunk")
    vessel = shoal.open_map("vessels:60")
    about = PlantProperties.of("roll", ghosts=1)
    rig = PhysicsRig(vessel, vessel.cells[::12], about, np.random.default_rng(1))
    told = {"slip": 0.05, "misplace": 0.05, "miss": 0.01}
    drive(rig, log="log.jsonl", policy="closest-frontier", max_moves=15, **told)
    folder.path("other.jsonl").write_text('{"kind":"header","log":"another"}\n')
    names = {file["name"]: file["kind"] for file in folder.files()}
    assert names == {"log.jsonl": "episode"}
    shown = files.page(folder, {"file": "log.jsonl"})["data"]
    points = np.frombuffer(base64.b64decode(shown["points"]), dtype="<i4")
    frame = 1 + 2 * len(vessel.cells[::12])
    assert points[0] == frame // 2
    assert (
        points.reshape(16, frame)[0, 1:].reshape(-1, 2).tolist()
        == (100 * vessel.cells[::12]).tolist()
    )
    last = points.reshape(16, frame)[-1, 1:].reshape(-1, 2) / 100
    np.testing.assert_allclose(last, rig.true_cells, atol=0.006)
    assert (shown["seen"], "points" in shown) == (False, True)
    assert lab.episode_picture(folder, {"file": "log.jsonl"})["part"] == "swarm"
    with pytest.raises(InvalidInputError, match=r"log\.jsonl: expected an episode with a seed"):
        files.copies(folder, {"file": "log.jsonl"})


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
    for other in ({"particle_radius": 0.02 * size}, {"friction": 0.5}, {"gain": 0.1}):
        problem = given | other | {"kind": "steering"}
        assert steering.reach(folder, {"problem": problem, "moves": 2})["sets"] == []


def test_an_answer_may_hold_half_of_a_pair_of_surrogates(folder):
    """A name in a stranger's episode, which UTF-8 cannot hold."""
    place = GridWorkspace(np.ones((6, 7), dtype=bool), name="\ud800")
    shoal.run(SwarmProblem(place, particles=2)).save(folder.root / "named.npz")
    answer = files.settings(folder, {"file": "named.npz"})
    assert json.loads(JSONResponse(answer).body) == answer


def test_cells_of_a_missing_map_are_written_once(folder):
    drawn = folder.root / "drawn.txt"
    drawn.write_text("..#\n...\n")
    episode = shoal.run(SwarmProblem(str(drawn), particles=1))
    episode.save(folder.root / "drawn.npz")
    drawn.unlink()
    answers = [files.settings(folder, {"file": "drawn.npz"}) for _ in range(2)]
    assert answers[0]["written"] == "drawn-map.map"
    assert answers[1] == answers[0]
    written = read_map(folder.root / "drawn-map.map")
    assert np.array_equal(written.free, episode.workspace.free)
