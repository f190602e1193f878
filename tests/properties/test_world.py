"""Laws of the world, belief and episodes."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.properties.strategies import RULES, commands, swarms, workspaces
from tests.swarm_runs import run

from shoal.swarm import Board, GridLayout, GridWorkspace, GridWorld, Mapping, SwarmEpisode

# a quarter turn to the left takes left to down, up to left, ...
TURNED = dict(zip("lurd", "dlur", strict=True))


@given(swarms(), st.sampled_from(RULES), st.data())
def test_particles_are_conserved_and_never_in_a_wall(swarm, rule, data):
    workspace, start = swarm
    world = GridWorld(workspace, rule)
    state = world.initial(start)
    for command in data.draw(commands(workspace.ndim)):
        state = world.step(state, command)
        assert state.n_particles == len(start)
        assert workspace.free[tuple(state.cells.T)].all()
        assert state.occupied <= world.free
        if rule != "merge":
            assert len(state.occupied) == len(start)


@given(swarms(ndim=2), st.sampled_from(RULES), st.data())
def test_turning_the_map_and_the_command_commutes(swarm, rule, data):
    workspace, start = swarm
    turned = GridWorkspace(np.rot90(workspace.free))
    width = workspace.shape[1]
    state = GridWorld(workspace, rule).initial(start)
    other = GridWorld(turned, rule).initial([(width - 1 - c, r) for r, c in start.tolist()])
    for command in data.draw(commands(2)):
        state = GridWorld(workspace, rule).step(state, command)
        other = GridWorld(turned, rule).step(other, TURNED[command])
        expected = sorted((width - 1 - c, r) for r, c in state.cells.tolist())
        assert sorted(map(tuple, other.cells.tolist())) == expected


@given(swarms(), st.sampled_from(RULES), st.data())
def test_belief_never_contradicts_the_truth(swarm, rule, data):
    workspace, start = swarm
    world, task = GridWorld(workspace, rule), Mapping()
    state = world.initial(start)
    belief = task.begin(world, state)
    for command in data.draw(commands(workspace.ndim)):
        for after in world.pushes(state, command):
            belief = task.update(belief, command, state.occupied, after.occupied)
            state = after
        assert belief.open <= world.free
        assert not (belief.obstacles & world.free)
        assert belief.frontier == belief.open.dilated() - belief.known


@given(workspaces(), st.data())
def test_packed_is_unpacked(workspace, data):
    layout = GridLayout(workspace.shape)
    one, other = (
        Board.of_mask(
            workspace.free & (np.arange(workspace.free.size).reshape(workspace.shape) % k > 0)
        )
        for k in (2, 3)
    )
    np.testing.assert_array_equal(np.pad(one.inner, 1), one.mask)
    assert Board(layout, layout.pack(one.mask)) == one
    for packed, plain in (
        (one & other, one.mask & other.mask),
        (one | other, one.mask | other.mask),
        (one - other, one.mask & ~other.mask),
        (one ^ other, one.mask ^ other.mask),
    ):
        np.testing.assert_array_equal(packed.mask, plain)
    assert len(one) == one.mask.sum() == len(list(one))
    command = data.draw(st.sampled_from("lurdio"[: 2 * workspace.ndim]))
    axis, shift = {
        "l": (-1, -1),
        "r": (-1, 1),
        "u": (-2, -1),
        "d": (-2, 1),
        "i": (-3, -1),
        "o": (-3, 1),
    }[command]
    np.testing.assert_array_equal(one.shifted(command).mask, np.roll(one.mask, shift, axis=axis))


@given(swarms(), st.sampled_from(("block", "merge")), st.integers(0, 99))
def test_closest_frontier_finds_all_that_can_be_reached(swarm, rule, seed):
    workspace, start = swarm
    episode = run(workspace, start=start, rule=rule, seed=seed)
    assert episode.status == "complete"
    labels = workspace.components
    reached = np.isin(labels, labels[tuple(start.T)]) & workspace.free
    state, belief = episode.final()
    np.testing.assert_array_equal(belief.open.inner, reached)
    assert episode.moves <= workspace.n_free * (workspace.n_free + 5)
    assert state.n_particles == len(start)
    assert episode.verify()


@given(swarms(), st.data())
def test_a_path_always_settles_its_target(swarm, data):
    """Playing a whole path of closest-frontier classifies the frontier cell at its end, under every
    rule.
    """
    from shoal.swarm.grid.paths import path_to_frontier

    workspace, start = swarm
    rule = data.draw(st.sampled_from(RULES))
    world, task = GridWorld(workspace, rule), Mapping()
    state = world.initial(start)
    belief = task.begin(world, state)
    for _ in range(8):
        path = path_to_frontier(belief, state.occupied, rule=rule)
        if not path:
            break
        known = len(belief.known)
        for command in path:
            for after in world.pushes(state, command):
                belief = task.update(belief, command, state.occupied, after.occupied)
                state = after
        assert len(belief.known) > known


@given(
    swarms(),
    st.sampled_from(("closest-frontier", "elect-particle", "random-moves", "depth-first")),
    st.integers(1, 40),
)
def test_cut_anywhere_is_uninterrupted(swarm, policy, cut):
    """An episode stopped at a limit is the beginning of the one that goes on."""
    workspace, start = swarm
    whole = run(workspace, start=start, policy=policy, seed=3, max_moves=300)
    part = run(workspace, start=start, policy=policy, seed=3, max_moves=cut)
    assert whole.commands[:cut] == part.commands
    np.testing.assert_array_equal(whole.trace.frontier[:cut], part.trace.frontier)


@given(swarms(), st.sampled_from(RULES), st.data())
def test_episode_files_come_back_the_same(swarm, rule, data):
    import tempfile
    from pathlib import Path

    workspace, start = swarm
    policy = f"manual:{data.draw(commands(workspace.ndim))}"
    episode = run(workspace, start=start, rule=rule, policy=policy)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "episode.npz"
        episode.save(path)
        again = SwarmEpisode.load(path)
    assert again.verify()
    assert (again.commands, again.status, again.policy) == (
        episode.commands,
        episode.status,
        episode.policy,
    )
    assert again.workspace == episode.workspace
    np.testing.assert_array_equal(again.start, episode.start)
    np.testing.assert_array_equal(again.trace.travelled, episode.trace.travelled)
