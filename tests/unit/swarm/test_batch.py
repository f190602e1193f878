"""Batches: each world moves as a world of its own does, whatever the others do."""

from __future__ import annotations

import numpy as np
import pytest
from tests.swarm_runs import run

from shoal.core.errors import InvalidInputError
from shoal.swarm import GridWorkspace, SwarmProblem
from shoal.swarm import batch as threads
from shoal.swarm.batch import PLANES, WorldBatch
from shoal.swarm.grid.board import LETTERS, trial_rng
from shoal.swarm.grid.tasks import Mapping
from shoal.swarm.simulation.swarms import begin_swarm

SHAPES = [(5, 7), (9, 70), (3, 62), (2, 3, 5), (4, 2, 64)]


class Twice(Mapping):
    """A task of somebody's own, which kernels do not know."""

    name = "twice"

    def update(self, belief, command, before, after):
        return super().update(belief, command, before, after)


def space(shape, seed=0, share=0.75):
    free = np.random.default_rng(seed).random(shape) < share
    free.flat[0] = True
    return GridWorkspace(free).largest_component()


def alone(problem, seed):
    """Return the swarm that the closed loop controls."""
    return begin_swarm(problem.setup, *problem.setup.draw_start(trial_rng(seed)), seed)


def check_same(batch, world, swarm):
    belief = batch.belief(world)
    assert batch.state(world) == swarm.state
    assert (belief.open, belief.known, belief.frontier) == (
        swarm.belief.open,
        swarm.belief.known,
        swarm.belief.frontier,
    )
    assert batch.frontier[world] == len(swarm.belief.frontier)
    assert batch.complete[world] == swarm.finished


def play_beside(batch, moves, *, repeat=1, seed=0):
    """Step a batch with random commands, and each of its worlds by itself."""
    swarms = [
        alone(batch.problems[index], int(own))
        for index, own in zip(batch.maps, batch.seeds, strict=True)
    ]
    rng, moved = np.random.default_rng(seed), np.zeros(len(batch), dtype=int)
    for _ in range(moves):
        going = ~(batch.terminated | batch.truncated)
        commands = rng.integers(0, 2 * batch.layout.ndim, len(batch))
        trace = batch.step(commands, where=going, repeat=repeat)
        assert (trace.commands == np.where(going, commands, -1)).all()
        assert (trace.scanned == going).all()
        for world, swarm in enumerate(swarms):
            expected = (0, batch.frontier[world], 0)
            if going[world]:
                limit = batch.problems[batch.maps[world]].max_moves - moved[world]
                rows, _ = swarm.carry_out(LETTERS[commands[world]], min(repeat, limit), scan=True)
                moved[world] += min(repeat, limit)
                expected = (sum(row[0] for row in rows), rows[-1][1], sum(row[2] for row in rows))
            assert (
                trace.classified[world],
                trace.frontier[world],
                trace.travelled[world],
            ) == expected
            check_same(batch, world, swarm)
    assert (batch.moves == moved).all()


@pytest.mark.parametrize("task", ["mapping", "coverage", "subset-coverage:fraction=0.3"])
@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
@pytest.mark.parametrize("shape", SHAPES)
def test_each_world_moves_as_one_alone(shape, rule, task):
    place = space(shape)
    problem = SwarmProblem(
        place, particles=max(1, place.n_free // 3), rule=rule, task=task, policy="closest-frontier"
    )
    play_beside(WorldBatch(problem, 3, seed=4), 25)


@pytest.mark.parametrize("rule", ["block", "merge"])
def test_runs_of_equal_commands(rule):
    problem = SwarmProblem(
        space((6, 9)), particles=5, rule=rule, scan_every=3, max_moves=31, policy="closest-frontier"
    )
    play_beside(WorldBatch(problem, 3), 12, repeat=3)


@pytest.mark.parametrize("repeat", [1, 2])
def test_worlds_with_noise(repeat):
    problem = SwarmProblem(space((6, 9)), particles=9, slip=0.1, misplace=0.05, miss=0.05)
    play_beside(WorldBatch(problem, 3), 15, repeat=repeat)


@pytest.mark.parametrize("rule", ["block", "merge"])
def test_a_task_of_ones_own(rule):
    play_beside(
        WorldBatch(
            SwarmProblem(
                space((4, 6)), particles=4, task=Twice(), rule=rule, policy="closest-frontier"
            ),
            2,
        ),
        10,
    )


@pytest.mark.parametrize(
    "fields", [{}, {"rule": "merge"}, {"task": "coverage"}, {"slip": 0.1}], ids=str
)
@pytest.mark.parametrize("shapes", [SHAPES[:3], SHAPES[3:]])
def test_maps_of_several_sizes(shapes, fields):
    policy = "closest-frontier"
    problems = [
        SwarmProblem(space(shape, seed), particles=4, policy=policy, **fields)
        for seed, shape in enumerate(shapes)
    ]
    batch = WorldBatch(problems, 6, seed=1)
    assert len(set(batch.maps.tolist())) > 1
    for _ in range(3):
        play_beside(batch, 6)
        batch.reset()


def test_worlds_begin_and_play_as_run_does():
    problem = SwarmProblem("vessels:300", particles=30, policy="closest-frontier")
    batch = WorldBatch(problem, 3, seed=5)
    episodes = [run("vessels:300", particles=30, seed=5 + world) for world in range(3)]
    for move in range(max(episode.moves for episode in episodes)):
        going = np.array([move < episode.moves for episode in episodes])
        assert (batch.terminated == ~going).all()
        commands = [
            episode.trace.commands[move] if on else 0
            for episode, on in zip(episodes, going, strict=True)
        ]
        trace = batch.step(commands, where=going)
        for world in np.flatnonzero(going):
            assert [column[world] for column in trace] == [
                column[move] for column in episodes[world].trace
            ]
    assert batch.complete.all()


def test_worlds_depend_neither_on_their_number_nor_on_threads(monkeypatch):
    problems = [
        SwarmProblem(space((5, 9), seed), particles=6, max_moves=9, policy="closest-frontier")
        for seed in range(3)
    ]
    monkeypatch.setattr(threads, "SMALLEST", 1)
    batches = [
        WorldBatch(problems, 12, threads=1),
        WorldBatch(problems, 12, threads=5),
        WorldBatch(problems, 4, threads=2),
    ]
    rng = np.random.default_rng(0)
    for _ in range(40):
        commands = rng.integers(0, 4, 12)
        for batch in batches:
            batch.reset(batch.terminated | batch.truncated)
            batch.step(commands[: len(batch)])
        few = len(batches[2])
        for other in batches[1:]:
            for name in ("seeds", "maps", "moves", "frontier"):
                assert (getattr(other, name)[:few] == getattr(batches[0], name)[:few]).all()
            for mine, theirs in zip(batches[0].boards, other.boards, strict=True):
                assert (mine[:few] == theirs[:few]).all()
    assert len(set(batches[0].seeds.tolist())) == 12


def test_resets():
    problems = [
        SwarmProblem(space((4, 5), seed), particles=3, policy="closest-frontier")
        for seed in range(2)
    ]
    batch = WorldBatch(problems, 4, seed=[7, 7, 8, 9], threads=1)
    assert batch.seeds.tolist() == [7, 7, 8, 9]
    assert batch.state(0) == batch.state(1)
    before = [batch.state(world) for world in range(4)]
    batch.reset([True, False, False, True], seed=[3, 1, 1, None], maps=[1, 0, 0, 0])
    assert (batch.seeds[:3].tolist(), batch.maps[[0, 3]].tolist()) == ([3, 7, 8], [1, 0])
    assert [batch.state(world) == before[world] for world in (1, 2)] == [True, True]
    first = batch.seeds.copy()
    batch.reset(seed=20)
    assert batch.seeds.tolist() == [20, 21, 22, 23]
    batch.reset(seed=20)
    again = batch.seeds.tolist(), batch.maps.tolist()
    batch.reset()
    later = batch.seeds.tolist()
    batch.reset(seed=20)
    assert (batch.seeds.tolist(), batch.maps.tolist()) == again
    batch.reset()
    assert batch.seeds.tolist() == later
    assert first.tolist() != later
    batch.reset(np.zeros(4, dtype=bool))
    assert batch.seeds.tolist() == later
    assert len(set(WorldBatch(problems, 4, seed=None).seeds.tolist())) == 4


@pytest.mark.parametrize("rule", ["block", "merge"])
@pytest.mark.parametrize("shapes", [SHAPES[:3], SHAPES[3:]])
def test_planes_are_the_boards(shapes, rule):
    policy = "closest-frontier"
    batch = WorldBatch(
        [SwarmProblem(space(shape), particles=7, rule=rule, policy=policy) for shape in shapes],
        5,
        seed=2,
    )
    for _ in range(4):
        batch.step(np.zeros(5, dtype=int))
    out = np.full((5, len(PLANES), *batch.layout.window), 9, dtype=np.uint8)
    assert batch.planes(PLANES, out=out) is out
    for world in range(5):
        state, belief = batch.state(world), batch.belief(world)
        place = batch.problems[batch.maps[world]].place
        own = tuple(slice(0, size + 2) for size in place.shape)
        shown = dict(zip(PLANES, out[world], strict=True))
        assert (shown["obstacles"][own] == belief.obstacles.mask).all()
        assert (
            shown["obstacles"].sum() - len(belief.obstacles)
            == shown["obstacles"].size - belief.open.mask.size
        )
        particles = state.occupied.mask if state.counts is None else state.counts
        masks = {
            "particles": particles,
            "free": belief.open.mask,
            "frontier": belief.frontier.mask,
            "unknown": ~belief.known.mask,
            "map": np.pad(place.free, 1),
        }
        for name, mask in masks.items():
            assert (shown[name][own] == mask).all()
            assert shown[name].sum() == mask.sum()
    some = np.array([True, False, True, False, False])
    assert (batch.planes(["frontier"], where=some) == out[some, 3:4]).all()


def test_many_particles_in_a_cell_are_255_in_a_plane():
    batch = WorldBatch(
        SwarmProblem(
            [[1, 1]], particles=300, start=[(0, 0)] * 300, rule="merge", policy="closest-frontier"
        ),
        1,
    )
    assert batch.planes(["particles"]).max() == 255
    assert batch.state(0).n_particles == 300


@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
@pytest.mark.parametrize("shape", SHAPES)
def test_masks_are_of_commands_that_may_change_something(shape, rule):
    batch = WorldBatch(
        SwarmProblem(space(shape), particles=4, rule=rule, policy="closest-frontier"), 3
    )
    rng = np.random.default_rng(0)
    for _ in range(10):
        masks = batch.action_masks()
        for world in range(3):
            state, belief = batch.state(world), batch.belief(world)
            for code, letter in enumerate(LETTERS[: 2 * len(shape)]):
                room = state.occupied.shifted(letter) - belief.obstacles
                assert masks[world, code] == bool(
                    room if rule == "merge" else room - state.occupied
                )
        batch.reset(batch.terminated)
        batch.step(rng.integers(0, 2 * len(shape), 3))
    noisy = WorldBatch(SwarmProblem([[1, 1]], particles=1, slip=0.1), 2)
    assert noisy.action_masks().tolist() == [[1, 1, 1, 1]] * 2


def test_boards_can_be_read_and_not_written():
    batch = WorldBatch(SwarmProblem("line:9", particles=3), 2)
    assert batch.boards.occupied.shape == (2, 3, 1)
    with pytest.raises(ValueError, match="read-only"):
        batch.boards.open[0] = 0
    assert repr(batch) == "<WorldBatch: 2 worlds of (1, 9), 0 ended>"
    more = WorldBatch(SwarmProblem("line:9", particles=3), 102)
    assert (more.memory - batch.memory) / 100 == pytest.approx(4 * 3 * 8 + 64, abs=8)


def ended_batch():
    batch = WorldBatch(SwarmProblem("line:9", particles=9), 3)
    for command in "lurd":
        batch.step(3 * command, where=[False, True, False])
    assert batch.complete.tolist() == [False, True, False]
    return batch


@pytest.mark.parametrize(
    ("does", "says"),
    [
        (
            lambda batch: batch.step([0, 1]),
            r"commands: expected 3 whole numbers, one per world, got int64 \(2,\)",
        ),
        (
            lambda batch: batch.step([0, 1, 0.5]),
            r"commands: expected 3 whole numbers, one per world, got float64 \(3,\)",
        ),
        (
            lambda batch: batch.step(0),
            r"commands: expected 3 whole numbers, one per world, got int64 \(\)",
        ),
        (lambda batch: batch.step([0, 1, 4]), r"commands: expected 0 to 3, got 4 for world 2"),
        (
            lambda batch: batch.step("lux"),
            r"expected commands out of 'lurd' for a 2-D workspace, got 'x' at position 3",
        ),
        (
            lambda batch: batch.step([0, 1, 2], repeat=0),
            "repeat: expected 1 or more, got 0 for world 0",
        ),
        (
            lambda batch: batch.step([0, 0, 0], where=[1, 1, 1]),
            r"where: expected 3 booleans, one per world, got int64 \(3,\)",
        ),
        (
            lambda _: ended_batch().step("rrr"),
            (
                r"step: expected worlds whose episodes are running, got world 1, whose episode has"
                r" ended"
            ),
        ),
        (lambda batch: batch.reset(seed=-1), "seed: expected a whole number from 0 to"),
        (lambda batch: batch.reset(seed=[1, 2]), "seed: expected 3 seeds, one per world, got 2"),
        (lambda batch: batch.reset(maps=1), "maps: expected 0 to 0, got 1 for world 0"),
        (
            lambda batch: batch.planes(["walls"]),
            r"planes: expected names out of particles, .*, got \['walls'\]",
        ),
        (
            lambda batch: batch.planes(out=np.zeros(3, np.uint8)),
            r"out: .* uint8 \(3, 4, 3, 11\), got uint8 \(3,\)",
        ),
        (
            lambda batch: batch.planes(out=np.zeros((3, 4, 3, 22), np.uint8)[..., ::2]),
            "which is not contiguous",
        ),
        (
            lambda _: WorldBatch(SwarmProblem("line:9", particles=3), 0),
            "worlds: expected a whole number, 1 or more, got 0",
        ),
        (lambda _: WorldBatch([], 2), r"problem: expected a SwarmProblem, or several, got \[\]"),
        (
            lambda _: WorldBatch(SwarmProblem("line:9", particles=10), 2),
            r"particles: expected 1 to 9 \(the free cells of line:9\), got 10",
        ),
        (
            lambda _: WorldBatch(
                [SwarmProblem("line:9", particles=3, rule=rule) for rule in ("block", "merge")], 2
            ),
            "problems: expected the same rule in all of them, got 'block' and 'merge'",
        ),
        (
            lambda _: WorldBatch(
                [SwarmProblem(place, particles=1) for place in ("line:9", [[[1, 1]]])], 2
            ),
            "maps: expected all of 2 dimensions or all of 3, got both",
        ),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(does, says):
    batch = WorldBatch(SwarmProblem("line:9", particles=3), 3)
    with pytest.raises(InvalidInputError, match=says):
        does(batch)
    assert batch.moves.tolist() == [0, 0, 0]


def test_coverage_where_nobody_gets_is_refused():
    with pytest.raises(
        InvalidInputError, match="coverage: expected a particle in every connected part"
    ):
        WorldBatch(
            SwarmProblem([[1, 0, 1]], particles=1, task="coverage", policy="closest-frontier"), 4
        )
