"""One move and one whole episode on vessels:5000 with 1000 particles: packed kernels against plain
arrays.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from tests.reference import plain
from tests.swarm_runs import run

from benchmarks.timing import best_seconds, row
from shoal import open_map
from shoal.swarm import Belief, Board, GridWorld, make_policy, make_task, place
from shoal.swarm.grid.board import trial_rng
from shoal.swarm.grid.scans import Trace
from shoal.swarm.grid.state import field_of
from shoal.swarm.kernels import episodes, moves
from shoal.swarm.simulation.compiled import policy_state_of

MAP, PARTICLES = "vessels:5000", 1000


@njit
def packed_moves(field, commands):
    """Play many commands with the packed kernel."""
    for command in commands:
        moves.push(field, command, moves.BLOCK)


@njit
def plain_moves(counts, free, commands):
    """Play many commands with the plain reference."""
    for command in commands:
        plain.move(counts, free, command)


def bench_move() -> None:
    workspace = open_map(MAP)
    start = place(workspace, PARTICLES, "uniform", trial_rng(0))
    commands = np.random.default_rng(0).integers(0, 4, 4000)
    world = GridWorld(workspace)
    state = world.initial(start)
    known = Belief(world.free, Board.full(world.layout), Board.empty(world.layout))
    field = field_of(world.free.words, state, known)
    reference = plain.make_world(workspace.free, start, rule="block", task="mapping", targets=None)
    packed_moves(field, commands)
    plain_moves(reference.counts, reference.free, commands)
    ours = best_seconds(lambda: packed_moves(field, commands)) / len(commands)
    theirs = best_seconds(lambda: plain_moves(reference.counts, reference.free, commands)) / len(
        commands
    )
    figure = f"{ours * 1e6:.2f} µs, {theirs / ours:.1f} times"
    row(
        f"one move, {PARTICLES} particles on {MAP}",
        figure,
        "10 times faster than plain",
        theirs >= 10 * ours,
    )


def bench_episode() -> None:
    workspace = open_map(MAP)
    world = GridWorld(workspace)
    starts = [place(workspace, PARTICLES, "uniform", trial_rng(0, trial)) for trial in range(10)]
    ours = theirs = 0.0
    for start in starts:
        assert run(workspace, start=start).commands == plain.run(workspace.free, start)["commands"]
        ours += best_seconds(lambda start=start: play_packed(world, start), repeat=5)
        theirs += best_seconds(lambda start=start: play_plain(workspace.free, start), repeat=3)
    figure = f"{ours / len(starts) * 1e3:.2f} ms, {theirs / ours:.1f} times"
    row(
        f"closest-frontier mapping, {PARTICLES} particles on {MAP}",
        figure,
        "6 times faster than plain",
        theirs >= 6 * ours,
    )


def play_packed(world: GridWorld, start: np.ndarray) -> None:
    """Play one episode in the kernel, setting up its boards included."""
    policy = make_policy("closest-frontier")
    state = world.initial(start)
    belief = make_task("mapping").begin(world, state)
    field = field_of(world.free.words, state, belief)
    policy_state = policy_state_of(world.layout, world.workspace.n_free, belief)
    episodes.play(policy.code, field, moves.BLOCK, True, policy_state, None, Trace.empty(4096))


def play_plain(free: np.ndarray, start: np.ndarray) -> None:
    """Play the same episode with the reference, setting up its arrays included."""
    reference = plain.make_world(free, start, rule="block", task="mapping", targets=None)
    plain.closest_frontier_episode(
        *reference, plain.BLOCK, plain.MAPPING, plain.COLUMN_MAJOR, 10**6
    )
