"""Long episodes: what they will cost is said, Ctrl-C keeps what there is, and auto chooses by size
and noise.
"""

from __future__ import annotations

import json
import signal
import threading

import numpy as np
import pytest

from shoal import cli
from shoal.cli.swarm import exploration
from shoal.core.episode import Status
from shoal.lab import run_trials
from shoal.swarm import GridWorkspace, SwarmEpisode, SwarmProblem
from shoal.swarm.grid.board import GridLayout
from shoal.swarm.policies.planners import beam_rollout
from shoal.swarm.policies.planners.beam_rollout import BeamRollout
from shoal.swarm.run import expected_duration, run


def after(moves):
    """Return a function that stops an episode after at least so many moves, and the list of its
    moves.
    """
    told = [0]

    def count(made, _frontier):
        told[0] = made

    return {"on_moves": count, "stop": lambda: told[0] >= moves}


@pytest.mark.parametrize("stepwise", [False, True])
@pytest.mark.parametrize(
    "fields",
    [
        {"policy": "best", "budget": 20.0},
        {"policy": "closest-frontier"},
        {"policy": "closest-frontier", "scan_every": "adaptive"},
        {"policy": "closest-frontier", "scan_every": 5},
        {"policy": "closest-frontier", "slip": 0.1, "miss": 0.1, "scan_every": 4},
        {"policy": "best", "budget": 20.0, "slip": 0.1},
        {"policy": "random-moves"},
        {"policy": "depth-first"},
    ],
    ids=lambda fields: "-".join(map(str, fields.values())),
)
def test_a_stopped_episode_is_a_valid_part_of_the_whole(tmp_path, fields, stepwise):
    problem = SwarmProblem("vessels:120:1", particles=3, **fields)
    whole = run(problem, seed=3, stepwise=stepwise)
    episode = run(problem, seed=3, stepwise=stepwise, **after(8))
    assert whole.moves > 20
    assert 8 <= episode.moves < whole.moves
    assert episode.status is Status.INTERRUPTED
    assert not episode
    assert whole.commands.startswith(episode.commands)
    episode.save(tmp_path / "episode.npz")
    again = SwarmEpisode.load(tmp_path / "episode.npz")
    assert again.verify(), again.verify().message
    assert "interrupted; " in again.reason


def test_an_episode_may_be_stopped_before_its_first_move(tmp_path):
    for fields in ({"policy": "best"}, {"policy": "closest-frontier", "slip": 0.1}):
        episode = run(SwarmProblem("maze:9x7", particles=3, **fields), stop=lambda: True)
        assert (episode.moves, episode.status) == (0, Status.INTERRUPTED)
        episode.save(tmp_path / "episode.npz")
        assert SwarmEpisode.load(tmp_path / "episode.npz").verify()


def interrupting():
    """Return a function that interrupts the main thread at its first call, as a terminal does."""
    left = [signal.SIGINT]

    def tell(_moves, _frontier):
        if left:
            signal.pthread_kill(threading.main_thread().ident, left.pop())

    return tell


@pytest.mark.parametrize("trials", [1, 4])
def test_trials_keep_what_they_have(trials):
    problem = SwarmProblem("vessels:300", particles=3, policy="best", time_per_move=20.0)
    shown = []
    episodes = run_trials(
        problem,
        trials=trials,
        workers=1,
        on_trial=shown.append,
        on_moves=interrupting(),
        keep=True,
    )
    ended = sum(episode.status is not Status.INTERRUPTED for episode in episodes)
    assert shown == list(range(1, ended + 1))  # no interrupted trial is shown as done
    assert 1 <= len(episodes) <= trials
    assert episodes[-1].status is Status.INTERRUPTED
    with pytest.raises(KeyboardInterrupt):
        run_trials(problem, trials=trials, workers=1, on_moves=interrupting())


def test_ctrl_c_writes_the_episode_and_ends_with_130(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(exploration, "report_moves", lambda _name: interrupting())
    given = [
        "map",
        "vessels:300",
        "-n",
        "3",
        "--policy",
        "best",
        "--time-per-move",
        "20",
        "--out",
        str(tmp_path / "out"),
        "--json",
    ]
    assert cli.run(given) == 130
    output = capsys.readouterr()
    assert json.loads(output.out)["status"] == ["interrupted"]
    assert "moves made" in output.err
    episode = SwarmEpisode.load(tmp_path / "out" / "episode.npz")
    assert episode.status is Status.INTERRUPTED
    assert episode.verify()
    assert cli.run(["replay", str(tmp_path / "out" / "episode.npz"), "--json"]) == 0


def test_the_duration_is_said_before_the_first_move(monkeypatch, capsys):
    monkeypatch.setattr(exploration, "TOLD", 0.0)
    assert (
        cli.run(["map", "vessels:300", "-n", "20", "--policy", "best", "--budget", "20", "--json"])
        == 0
    )
    output = capsys.readouterr()
    said = output.err.splitlines()[0]
    assert "beam-rollout:budget=20.0 takes about" in said
    assert "Ctrl-C ends it and keeps the moves so far if --out is given" in said
    moves = float(said.partition("for about ")[2].partition(" moves")[0])
    assert 0.5 < moves / json.loads(output.out)["moves"][0] < 2


def test_an_expected_duration_counts_a_given_time_per_move():
    problem = SwarmProblem("vessels:500", particles=10, policy="best", time_per_move=30.0)
    expected = expected_duration(problem)
    assert expected is not None
    assert expected.seconds == pytest.approx(0.03 * expected.moves)
    assert (
        expected_duration(problem.replaced(policy="closest-frontier", time_per_move=None)) is None
    )


def test_auto_takes_a_smaller_budget_on_large_maps_and_no_planner_on_huge_ones():
    assert beam_rollout.fit_planner((150, 150), 5000, 1000) == BeamRollout()
    budgets = [
        beam_rollout.fit_planner((700, 700), 100_000, particles)
        for particles in (50_000, 20_000, 5_000)
    ]
    assert budgets == sorted(budgets, key=lambda policy: -policy.budget)
    assert budgets[-1].budget < 1000
    assert all(
        beam_rollout.planning_seconds(policy, (700, 700), 100_000, particles)
        <= 1.01 * beam_rollout.MOST_SECONDS
        for policy, particles in zip(budgets, (50_000, 20_000, 5_000), strict=True)
    )
    assert beam_rollout.fit_planner((3000, 3000), 2_000_000, 10) is None


def test_auto_names_what_it_chose(monkeypatch, capsys):
    monkeypatch.setattr(beam_rollout, "MOST_SECONDS", 0.05)
    assert SwarmProblem("vessels:500", particles=20).setup.policy.name.startswith(
        "beam-rollout:budget="
    )
    assert (
        SwarmProblem("vessels:500", particles=20, policy="best").setup.policy.name == "beam-rollout"
    )
    assert (
        SwarmProblem("vessels:500", particles=20, budget=500.0).setup.policy.name
        == "beam-rollout:budget=500.0"
    )
    rig = SwarmProblem("rig", particles=20).at_place(GridWorkspace([[1, 1]]))
    assert rig.setup.policy.name == "beam-rollout"
    monkeypatch.setattr(beam_rollout, "MOST_SECONDS", 1e-6)
    assert SwarmProblem("vessels:500", particles=20).setup.policy.name == "closest-frontier"
    assert cli.run(["map", "vessels:500", "-n", "20"]) == 0
    assert (
        "the policy auto chose closest-frontier, because best with its usual budget would take"
        " about" in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("fields", "name"),
    [
        ({"slip": 0.05, "misplace": 0.01}, "beam-rollout"),
        ({"slip": 0.2, "misplace": 0.05, "miss": 0.1}, "beam-rollout"),
        ({"slip": 0.4, "misplace": 0.1, "miss": 0.2}, "beam-rollout"),
        ({"slip": 0.05, "scan_every": 2}, "closest-frontier"),
        ({"rule": "tilt"}, "closest-frontier"),
        ({"task": "coverage"}, "closest-frontier"),
        ({}, "beam-rollout"),
    ],
)
def test_auto_chooses_by_noise(fields, name):
    assert SwarmProblem("maze:21x15", particles=20, **fields).setup.policy.name == name


@pytest.mark.parametrize("trial", range(3))
def test_planners_under_noise_learn_only_from_cells_that_particles_entered(monkeypatch, trial):
    """Around other cells, the prior read memory outside the board, and equal seeds gave different
    episodes.
    """
    observe, seen = beam_rollout.episodes.observe_outcome, []

    def observed(field, mapping, planner, command, done):
        layout = rooms
        new = layout.unpack((field.known & ~planner.prior.before).reshape(layout.words))
        opened = layout.unpack(field.open.reshape(layout.words))
        axis, sign = {0: (1, -1), 1: (0, -1), 2: (1, 1), 3: (0, 1)}[int(command)]
        assert not (new & ~np.roll(opened, sign, axis)).any()
        edges = opened.copy()
        edges[1:-1, 1:-1] = False
        assert not edges.any()
        seen.append(int(new.sum()))
        return observe(field, mapping, planner, command, done)

    problem = SwarmProblem(
        "maze:15x11",
        particles=20,
        policy="best",
        budget=20.0,
        slip=0.1,
        misplace=0.05,
        confidence=0.9,
    )
    rooms = GridLayout(problem.place.shape)
    monkeypatch.setattr(beam_rollout.episodes, "observe_outcome", observed)
    first = run(problem, trial=trial)
    assert sum(seen) > 20
    assert run(problem, trial=trial).commands == first.commands
