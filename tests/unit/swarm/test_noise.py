"""Mapping with particles that slip, are seen beside their cell, or are not seen."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from tests.swarm_runs import run, run_trials

from shoal import GridWorkspace, InvalidInputError, open_map
from shoal.cli import run as shoal
from shoal.rigs import DriveLog, NoisyRig, drive, replay_log
from shoal.swarm import SwarmEpisode
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.state import Belief
from shoal.swarm.kernels import noise as kernels
from shoal.swarm.kernels.noise import UNKNOWN
from shoal.swarm.noise import LOSS, Noise, NoisyBelief, inner_of
from shoal.swarm.policies import View, make_policy

SOME = Noise(slip=0.05, misplace=0.01, miss=0.02)


def test_without_noise_the_map_is_that_of_an_episode_without():
    workspace = open_map("cave:24x16:3")
    exact = run(workspace, particles=12, seed=4)
    noisy = run(workspace, particles=12, seed=4, slip=1e-300)  # noise of which nothing comes
    assert noisy.status == "complete"
    assert noisy.errors.right == 1.0
    assert noisy.final()[1].open == exact.final()[1].open
    assert noisy.final()[1].obstacles == exact.final()[1].obstacles


def test_a_map_with_noise_is_right_at_its_stated_confidence():
    """Of the cells that are settled at least so many are right as the confidence says; so are those
    of each range.
    """
    episodes = run_trials(
        open_map("maze:15x11"),
        trials=30,
        particles=15,
        noise=Noise(0.1, 0.05, 0.05),
        confidence=0.9,
    )
    # the others say that they gave a cell up
    assert sum(episode.status == "complete" for episode in episodes) >= 28
    wrong = sum(episode.errors.false_free + episode.errors.false_obstacles for episode in episodes)
    settled = sum(len(episode.final()[1].known) for episode in episodes)
    assert wrong <= 0.1 * settled
    stated, actual = [], []
    for episode in episodes:
        for i, (_, belief) in enumerate(episode.frames()):
            if i == 40:
                stated.append(len(belief.known))
                truth = np.pad(episode.workspace.free, 1)
                actual.append(int((truth == belief.open.mask)[belief.known.mask].sum()))
    assert sum(actual) >= 0.9 * sum(stated)


@pytest.mark.parametrize(
    "policy",
    [
        "closest-frontier",
        "closest-frontier:ties=row-major",
        "elect-particle",
        "random-moves",
        "depth-first",
    ],
)
def test_every_policy_ends_and_replays(policy, tmp_path):
    episode = run(
        open_map("maze:11x9"),
        particles=1 if policy == "depth-first" else 8,
        policy=policy,
        noise=SOME,
        seed=5,
        max_moves=5000,
    )
    assert episode.noisy
    if policy != "depth-first":
        assert episode.status == "complete"
        assert episode.errors.right > 0.98
    assert episode.verify()
    episode.save(tmp_path / "e.npz")
    loaded = SwarmEpisode.load(tmp_path / "e.npz")
    assert loaded.noisy
    assert (loaded.problem, loaded.status) == (episode.problem, episode.status)
    assert loaded.verify()
    loaded.trace.classified[0] += 1
    assert "classified differs at move 1" in loaded.verify().message
    frames = list(episode.frames())
    assert len(frames) == episode.moves + 1
    assert frames[-1][1].known == episode.final()[1].known


@pytest.mark.parametrize("every", [1, 2, 5])
def test_compiled_and_step_by_step_are_the_same(every):
    for seed in range(4):
        options = {
            "particles": 9,
            "noise": SOME,
            "seed": seed,
            "scan_every": every,
            "max_moves": 40 if seed else 10_000,
        }
        compiled, stepwise = (
            run(open_map("cave:18x14:2"), stepwise=slow, **options) for slow in (False, True)
        )
        assert compiled.commands == stepwise.commands
        assert compiled.trace.difference(stepwise.trace) is None


def test_fewer_scans():
    """Not more than so many commands go without a scan, none is wasted at the end, and the episode
    replays.
    """
    episode = run(open_map("vessels:300"), particles=6, noise=SOME, seed=1, scan_every=4)
    assert episode.status == "complete"
    assert episode.errors.right > 0.98
    between = np.diff(np.flatnonzero(np.concatenate([[True], episode.trace.scanned])))
    assert set(between) == {1, 2, 3, 4}
    assert episode.trace.scanned[-1]
    assert episode.scans < 0.9 * episode.moves
    assert episode.cost == episode.moves + 10 * episode.scans
    assert not episode.trace.classified[
        ~episode.trace.scanned
    ].any()  # what has not been looked at is not known
    assert episode.verify()
    assert [len(belief.known) for _, belief in episode.frames()][-1] == len(
        episode.final()[1].known
    )
    other = episode.trace.scanned.copy()
    other[np.flatnonzero(other)[3]] = False
    assert not replace(episode, trace=episode.trace._replace(scanned=other)).verify()


def test_scans_that_do_not_fit_the_rule_are_noticed():
    episode = run(open_map("maze:11x9"), particles=4, noise=SOME, seed=1)
    unseen = episode.trace._replace(
        scanned=np.zeros(episode.moves, np.bool_), classified=0 * episode.trace.classified
    )
    stored = replace(episode, problem=episode.problem.replaced(scan_every=2), trace=unseen)
    again = replace(stored, trace=stored.replay.end.trace)
    assert again.verify().message == "no scan after move 2, 2 moves after the one before"
    assert (
        replace(again, trace=again.trace.part(0, 1)).verify().message
        == "no scan after the last move, 1"
    )


def test_any_noise_ends():
    rng = np.random.default_rng(1)
    for seed in range(40):
        shape = (5, 6) if seed % 3 else (3, 3, 4)
        free = rng.random(shape) < 0.7
        free.flat[0] = True
        noise = Noise(*rng.uniform(0, 0.5, size=3))
        n, every = 1 + seed % int(free.sum()), (1, 2, 30)[seed % 3]
        episode = run(
            GridWorkspace(free),
            particles=n,
            noise=noise,
            confidence=0.99,
            seed=seed,
            scan_every=every,
        )
        assert episode.status in {"complete", "stalled"}


def test_scans_that_are_often_wrong_are_begun_with_too():
    noise = Noise(slip=0.2, misplace=0.1, miss=0.2)
    for policy in ("closest-frontier", "elect-particle"):
        episode = run(open_map("maze:9x7"), particles=6, noise=noise, policy=policy, seed=1)
        assert episode.first_frontier == 0
        assert episode.status == "complete"
        assert episode.errors.right > 0.9


def test_a_map_is_complete_only_if_no_particle_may_enter_an_unclassified_cell():
    """Two particles and much noise: the belief soon loses sight of a particle, whose cells are then
    looked for.
    """
    place, noise = open_map("maze:11x9"), Noise(slip=0.2, misplace=0.05, miss=0.1)
    for policy, seed in (
        ("closest-frontier", 2),
        ("closest-frontier", 4),
        ("closest-frontier", 7),
        ("elect-particle", 4),
    ):
        compiled, stepwise = (
            run(place, particles=2, noise=noise, policy=policy, seed=seed, stepwise=slow)
            for slow in (False, True)
        )
        assert compiled.commands == stepwise.commands
        assert compiled.status == stepwise.status == "complete"
        # closest-frontier once called 30, 12 and 7 moves complete, with 11, 5 and 3 of 59 free
        # cells
        assert compiled.moves > 300
        assert compiled.errors.right > 0.9
        assert compiled.verify()
        *_, (belief, _) = compiled.replay.beliefs()
        assert belief.finished
        assert belief.closed


def test_a_particle_that_may_stand_anywhere_leaves_the_map_open():
    """No frontier cell is in reach of the particle at the left; the other one may stand in cells
    that nobody has classified.
    """
    layout = GridLayout((1, 9))
    belief = NoisyBelief((1, 9), Board.of_cells(layout, [(0, 0)]), Noise(0.05, 0.01))
    belief.state.logit[belief.state.logit > -700] = -14.0
    cells = inner_of(belief.state.logit, (1, 9))[0]
    inside = inner_of(belief.state.inside, (1, 9))[0]
    cells[0] = 14.0
    inside[:] = [1, 0, 0, 0, 0, 0, 0, 0, 0]
    belief.spread("u")
    assert belief.finished
    cells[5:8], inside[6] = 0.0, 0.3
    belief.spread("u")
    assert belief.remaining == 0
    assert not belief.closed
    assert not belief.finished


@pytest.mark.parametrize("policy", ["elect-particle", "depth-first", "closest-frontier"])
def test_policies_wait_while_no_particle_is_seen(policy):
    belief = Belief(
        *(
            Board.of_cells(GridLayout((1, 5)), cells)
            for cells in ([(0, 2)], [(0, 2)], [(0, 1), (0, 3)])
        )
    )
    view = View(belief, Board.empty(GridLayout((1, 5))), "block", True, 3, 0, 0)
    assert make_policy(policy).decide(view, None, np.random.default_rng(1))[0] == ""


def test_commands_of_the_user_are_not_continued():
    place = open_map("maze:11x9")
    assert run(place, particles=2, noise=SOME, policy="manual:lurd").commands == "lurd"
    driven = drive(
        NoisyRig(place, place.cells[:2], SOME, np.random.default_rng(1)),
        policy="manual:lurdlurd",
        **vars(SOME),
    )
    assert driven.commands == "lurdlurd"
    assert driven.status == "stalled"


def scan_probability(inside, room, seen, noise, letter):
    """Sum over all cases what `kernels.scan_likelihood` computes along a line, without misplaced
    particles. ``letter`` is r, l or empty.
    """
    hit, order = 1 - noise.miss, range(len(inside))
    if letter == "l":
        ahead = dict(zip(order, [None, *order], strict=False))
    else:
        ahead = {i: i + 1 if i + 1 < len(inside) else None for i in order}
    total = 0.0
    for held in itertools.product((0, 1), repeat=len(inside)):
        prior = np.prod([p if h else 1 - p for p, h in zip(inside, held, strict=True)])
        cases = [(prior, set())]
        for i in order if letter == "l" else reversed(order):
            if not held[i]:
                continue
            following = []
            for chance, now in cases:
                to = ahead[i]
                goes = 0.0
                if letter and to is not None and to not in now:
                    goes = (1 - noise.slip) * max(room[to], inside[to])
                following.append((chance * goes, now | {to}))
                following.append((chance * (1 - goes), now | {i}))
            cases = following
        for chance, now in cases:
            unseen = [(1 - hit * (i in now)) * (1 - UNKNOWN) for i in order]
            shown = [1 - p if is_seen else p for p, is_seen in zip(unseen, seen, strict=True)]
            total += chance * np.prod(shown)
    return total


def test_the_probability_of_a_scan_is_the_sum_over_all_cases():
    rng = np.random.default_rng(5)
    for trial in range(60):
        noise = Noise(rng.choice([0.1, 0.4]), 0, rng.choice([0.05, 0.3]))
        size = 4
        inside = rng.random(size) * rng.integers(0, 2, size)
        room = rng.random(size)
        seen = rng.random(size) < 0.4
        layout = GridLayout((1, size))
        belief = NoisyBelief((1, size), Board.empty(layout), noise)
        inner_of(belief.state.inside, (1, size))[...] = inside
        inner_of(belief.state.logit, (1, size))[...] = np.log(room / (1 - room))
        code, letter = [(2, "r"), (0, "l"), (-1, "")][trial % 3]
        inner_of(belief.state.seen, (1, size))[...] = seen
        inner_of(belief.state.logit, (1, size), rim=1)[:, [0, -1]] = -700
        found = kernels.scan_likelihood(belief.state, code)
        expected = np.log(scan_probability(inside, room, seen, noise, letter))
        # each of the cells around the line shows nothing
        assert expected - 100 * UNKNOWN < found < expected + 1e-9, (trial, letter)


def test_a_misplaced_particle_is_counted_once():
    """The likelihoods of all scans add up to 1."""
    layout, noise = GridLayout((1, 3)), Noise(0.2, 0.2, 0.1)
    for code in (-1, 0, 2):
        total = 0.0
        for cells in range(1 << 3):
            belief = NoisyBelief((1, 3), Board.empty(layout), noise)
            inner_of(belief.state.inside, (1, 3))[0, 1] = 1.0
            inner_of(belief.state.seen, (1, 3))[...] = [[bool(cells >> i & 1) for i in range(3)]]
            total += np.exp(kernels.scan_likelihood(belief.state, code))
        # a particle is shown above or below the line with half of the probability of misplacement
        assert total == pytest.approx(1 - 0.9 * 0.2 / 2, abs=0.03), code


def test_wrong_belief_is_corrected():
    """A cell that was taken for free since something was seen there once is found to be a wall."""
    layout = GridLayout((1, 4))
    belief = NoisyBelief((1, 4), Board.of_cells(layout, [(0, 0), (0, 2)]), Noise(0.05, 0.01))
    # the second one was seen beside its cell: it stands at (0, 1)
    assert belief.probability[1, 3] > 0.99
    for command, cells in (("l", [(0, 0), (0, 1)]), ("r", [(0, 0), (0, 1)])) * 3:
        belief.update(command, Board.of_cells(layout, cells))
    assert belief.probability[1, 2] > 0.999
    assert belief.probability[1, 3] < 0.02


def test_a_particle_that_is_lost_is_found_again():
    layout = GridLayout((1, 5))
    belief = NoisyBelief((1, 5), Board.empty(layout), Noise(miss=0.3))
    assert not belief.occupied
    for _ in range(3):
        belief.update("l", Board.of_cells(layout, [(0, 2)]))
    assert list(belief.occupied) == [(0, 2)]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"noise": SOME, "rule": "merge"}, "noise: expected rule block, got merge"),
        ({"noise": SOME, "task": "coverage"}, "noise: expected the task mapping, got coverage"),
        (
            {"noise": SOME, "scan_every": "doubling"},
            "noise: expected scan-every as a number of commands, .* got doubling",
        ),
        (
            {"noise": SOME, "scan_every": "adaptive"},
            "noise: expected scan-every as a number of commands, .* got adaptive",
        ),
        (
            {"noise": SOME, "confidence": 0.75},
            "confidence: expected a number, above 0.75 and at most 0.99999, got 0.75",
        ),
        ({"noise": SOME, "confidence": True}, "got True"),
    ],
)
def test_bad_arguments(options, words):
    with pytest.raises(InvalidInputError, match=words):
        run(open_map("line:5"), particles=1, **options)


@pytest.mark.parametrize("rate", [-0.1, 0.6, float("nan"), "much", True])
def test_bad_rates(rate):
    with pytest.raises(InvalidInputError, match=r"slip: expected a number from 0 to 0\.5, got"):
        Noise(slip=rate)


def test_a_noisy_rig_is_driven(tmp_path):
    workspace = open_map("maze:11x9")
    rng = np.random.default_rng(2)
    for policy, every in (("closest-frontier", 1), ("elect-particle", 1), ("closest-frontier", 3)):
        log = tmp_path / f"{policy}-{every}.jsonl"
        rig = NoisyRig(workspace, workspace.cells[::9], SOME, rng)
        driven = drive(rig, policy=policy, **vars(SOME), scan_every=every, log=DriveLog(log))
        assert driven.status == "complete"
        assert driven.trace.scanned.all() == (every == 1)
        assert sum(driven.compared(workspace).values()) == 0
        result, verified = replay_log(log)
        assert verified, verified.message
        assert result.commands == driven.commands
        np.testing.assert_array_equal(result.trace.scanned, driven.trace.scanned)
    cut = drive(
        NoisyRig(workspace, workspace.cells[::9], SOME, rng),
        **vars(SOME),
        scan_every=50,
        max_moves=9,
    )
    assert cut.status == "limit"
    assert cut.trace.scanned[-1]
    with pytest.raises(InvalidInputError, match="scan-every as a number of commands"):
        drive(rig, **vars(SOME), scan_every="adaptive")


def test_command(tmp_path, capsys):
    noise = ["--slip", "0.05", "--misplace", "0.01", "--miss", "0.02", "--confidence", "0.95"]
    words = ["map", "maze:11x9", "-n", "6", "--policy", "closest-frontier", *noise]
    assert shoal([*words, "--trials", "3", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["noise"] == {"slip": 0.05, "misplace": 0.01, "miss": 0.02}
    assert result["confidence"] == 0.95
    assert min(result["right"]) > 0.95
    assert result["cost"] == [moves + 10 * (moves + 1) for moves in result["moves"]]
    assert {
        "false_free",
        "false_obstacles",
        "undecided",
        "false_free_rate",
        "false_obstacle_rate",
    } < set(result)
    out = tmp_path / "out"
    assert shoal([*words, "--out", str(out), "--film", str(tmp_path / "film.gif")]) == 0
    assert "% of the cells" in capsys.readouterr().out
    assert shoal(["replay", str(out / "episode.npz")]) == 0
    assert "with noise replayed: all the same" in " ".join(capsys.readouterr().out.split())
    assert shoal([*words, "--scan-every", "adaptive"]) == 2
    assert "scan-every as a number of commands" in capsys.readouterr().err
    assert shoal(["map", "line:5", "-n", "1", "--slip", "0.7"]) == 2
    assert "slip: expected a number from 0 to 0.5, got 0.7" in capsys.readouterr().err
    assert shoal(["map", "line:5", "-n", "1", "--confidence", "0.9"]) == 2
    assert "together with noise" in capsys.readouterr().err


def believed(cells, start, *, loss):
    """Return a belief of a corridor, and a function that shows it a command and a scan."""
    layout = GridLayout((1, cells))
    noise = Noise(slip=0.01, misplace=0.01, miss=0.01)
    belief = NoisyBelief((1, cells), Board.of_cells(layout, [(0, start)]), noise, loss=loss)

    def show(command, *columns):
        belief.update(command, Board.of_cells(layout, [(0, column) for column in columns]))

    return belief, show


def test_a_jammed_particle_makes_no_wall_of_a_cell_on_a_rig_that_many_have_passed():
    for loss, stays_free in ((LOSS, True), (0.0, False)):  # of a rig, of a simulation
        belief, show = believed(4, 1, loss=loss)
        for _ in range(12):
            show("r", 2)
            show("l", 1)
        assert belief.belief.open.mask[1, 3]
        for _ in range(6):
            show("r", 1)
        assert belief.belief.open.mask[1, 3] == stays_free
    # many particles that stay make a wall of it all the same, if the map was wrong
    belief, show = believed(4, 1, loss=LOSS)
    for _ in range(12):
        show("r", 2)
        show("l", 1)
    for _ in range(40):
        show("r", 1)
    assert belief.belief.obstacles.mask[1, 3]


def test_a_particle_that_moves_by_two_cells_on_a_rig_is_not_lost():
    belief, show = believed(7, 1, loss=LOSS)
    for column in (2, 3, 4):
        show("r", column)
    for column in (3, 2, 1):
        show("l", column)
    show("r", 3)  # by two cells
    assert belief.occupied.cells.tolist() == [[0, 3]]
    show("r", 4)
    # a ghost two cells ahead of a particle that is seen is none
    show("l", 3)
    show("r", 4, 5)
    assert belief.occupied.cells.tolist() == [[0, 4]]
    show("l", 1, 3)
    assert belief.occupied.cells.tolist() == [[0, 3]]
