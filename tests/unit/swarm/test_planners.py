"""Planners and bounds."""

from __future__ import annotations

import copy
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.properties.strategies import swarms
from tests.reference.mapping_optimum import MappingOptimum, mapping_optimum
from tests.reference.small import small_cases
from tests.soak import often
from tests.swarm_runs import run

from shoal import open_map
from shoal.core.errors import InvalidInputError
from shoal.swarm import GridWorkspace, make_policy
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.scans import Trace
from shoal.swarm.grid.state import Belief, SwarmState, pushed
from shoal.swarm.grid.tasks import make_task
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.kernels import episodes
from shoal.swarm.kernels.moves import new_record
from shoal.swarm.kernels.planning import plan_search
from shoal.swarm.policies import POLICIES, BeamRollout
from shoal.swarm.policies.planners import state
from shoal.swarm.policies.protocol import View
from shoal.swarm.simulation.compiled import PlannerGame
from shoal.swarm.theory.bounds import LowerBound, lower_bound, optimum
from shoal.swarm.theory.small_world import SmallWorld

SMALL: dict[str, float] = {
    "beam_width": 3,
    "beam_depth": 3,
    "beam_leaves": 2,
    "horizon": 14,
    "force_after": 20,
    "prediction_layers": 4,
}


class Quick(BeamRollout):
    """beam-rollout with little work, and horizons that small maps go beyond."""

    tuning = BeamRollout.tuning._replace(**SMALL)


class QuickFirst(BeamRollout):
    """The same, with the end out of sight above five frontier cells."""

    tuning = BeamRollout.tuning._replace(end_frontier=5, run_candidates=0, **SMALL)


class Hasty(BeamRollout):
    """A plan of a few commands now and then, and between them whatever settles most."""

    tuning = BeamRollout.tuning._replace(horizon=3, force_after=20)


def test_best_is_an_alias():
    assert make_policy("best") == BeamRollout()
    assert {"best", "beam-rollout", "greedy-classify"} <= set(POLICIES)
    assert make_policy("best:budget=100").name == "beam-rollout:budget=100.0"


@pytest.mark.parametrize("policy", ["best", Hasty(budget=0.1), "greedy-classify"])
@pytest.mark.parametrize("name", ["cave:14x10", "maze:11x9", "htree:30", "line:20"])
def test_planners_complete(policy, name):
    workspace = open_map(name)
    for task in ("mapping", "coverage", "subset-coverage"):
        for particles in (1, 7, workspace.n_free):
            episode = run(workspace, task=task, particles=particles, policy=policy)
            assert episode.status == "complete", episode.sentence
            assert episode.verify()


def test_fewer_moves_than_closest_frontier():
    workspace = open_map("vessels:500")
    moves = {
        policy: sum(
            run(workspace, particles=60, trial=trial, policy=policy).moves for trial in range(6)
        )
        for policy in ("closest-frontier", "greedy-classify", "best")
    }
    assert moves["best"] < 0.8 * moves["closest-frontier"]
    assert moves["greedy-classify"] < moves["closest-frontier"]


@settings(max_examples=25, deadline=None)
@given(
    swarms(),
    st.sampled_from([Quick(), QuickFirst(), Quick(budget=3.0), make_policy("greedy-classify")]),
    st.booleans(),
    st.integers(1, 9),
)
def test_the_same_step_by_step_and_in_pieces(swarm, policy, merge, cut):
    workspace, start = swarm
    options = {
        "policy": policy,
        "start": start,
        "rule": "merge" if merge else "block",
        "max_moves": 40,
    }
    whole = run(workspace, **options)
    assert whole.verify()
    assert run(workspace, stepwise=True, **options).commands == whole.commands
    assert run(workspace, **options | {"max_moves": cut}).commands == whole.commands[:cut]


@pytest.mark.parametrize("name", ["vessels:300", "maze:15x11", "rectangle:9x12"])
def test_what_is_unknown_reaches_no_decision(name):
    """Other cells are put where nobody has been, and the same commands are chosen."""
    workspace = open_map(name)
    world, rng = GridWorld(workspace), np.random.default_rng(5)
    state = world.initial(run(workspace, particles=8).start)
    belief = make_task("mapping").begin(world, state, None)
    options = {"rule": "block", "mapping": True}
    game = PlannerGame(make_policy("best"), world.free, state, belief, rng=rng, **options)
    for _ in range(12):
        if game.play_on(Trace.empty(1), 1)[1]:
            break
        field, chosen = game.field, set()
        for _ in range(3):
            planner, other = (
                copy.deepcopy(game.planner),
                rng.integers(0, 2**63, game.field.free.size, dtype=np.uint64),
            )
            exchanged = field._replace(free=(field.free & field.known) | (other & ~field.known))
            command = int(episodes.choose(game.code, exchanged, True, planner))
            chosen.add((command, *planner.prediction.open))
        assert len(chosen) == 1


@settings(max_examples=25, deadline=None)
@given(swarms(), st.sampled_from([Quick(), QuickFirst(), make_policy("greedy-classify")]))
def test_planners_end(swarm, policy):
    workspace, start = swarm
    assert (
        run(workspace, policy=policy, start=start, max_moves=30 * 8 * workspace.n_free + 100).status
        == "complete"
    )


def test_what_is_beyond_the_horizon():
    spiral = open_map("maze:25x25:3")
    assert run(spiral, policy=Quick(), particles=1).status == "complete"


def test_same_seed_and_budget_same_commands():
    workspace = open_map("cave:20x15")
    first, again, other = (
        run(workspace, particles=9, policy=policy).commands
        for policy in ("best", "best:budget=1000", "best:budget=40")
    )
    assert first == again
    assert first != other


def test_a_time_for_each_move():
    episode = run(open_map("cave:20x15"), particles=9, policy="best:milliseconds=0.5")
    assert episode.status == "complete"
    assert episode.verify()
    assert (
        run(
            open_map("cave:12x9"), particles=5, policy="best:milliseconds=0.5", stepwise=True
        ).status
        == "complete"
    )


def test_thought_by_the_number_of_particles():
    """Few particles need many moves and gain more by thinking; many need few moves, and their plans
    are short.
    """
    names = ("end_frontier", "frontier_worth", "variations", "beam_width", "beam_depth")
    budget, few, share, variations, width, depth = (
        0,
        *(1 + BeamRollout.tuning._fields.index(name) for name in names),
    )
    usual = make_policy("best").settings(1000)
    for particles, times in ((100, 10), (5, 10), (500, 4), (2000, 2), (10**6, 4)):
        given_more = make_policy("best").settings(particles)
        assert given_more[budget] == times * usual[budget]
        many = times if particles > 1000 else 1
        plans = max(1, min(10, 1000 / particles))
        assert given_more[variations] == plans * usual[variations]
        assert (given_more[few], given_more[share]) == (many * usual[few], usual[share] / many)
        assert (given_more[width], given_more[depth]) == (
            many**2 * usual[width],
            many**0.5 * usual[depth],
        )
    for particles in (100, 4000):
        timed = make_policy("best:milliseconds=1").settings(particles)
        assert (timed[width], timed[depth]) == (usual[width], usual[depth])


def test_a_wide_beam_on_large_boards():
    """Its states take a bounded room; on any board there are at least as many as for
    few particles.
    """
    options = make_policy("best").settings(4000)
    for side, width in ((40, 160), (1000, 65), (2000, 24)):
        layout = GridLayout((side, side))
        planner = state.planner_of(
            layout,
            SimpleNamespace(frontier=()),
            rule="block",
            mapping=True,
            seed=1,
            options=options,
        )
        assert (planner.beam.states.shape[1], planner.options.beam_width) == (width, width)


def test_a_time_is_kept_to_from_the_first_moves_on(monkeypatch):
    """The first ten moves may be overdrawn. What earlier ones took counts once, and the rate of
    simulation tells the rest.
    """
    clock = iter(range(100))
    monkeypatch.setattr(
        state.time, "perf_counter", lambda: next(clock) * 4e-3
    )  # each block takes 4 ms
    planner = SimpleNamespace(
        options=new_record(state.OPTIONS), memory=new_record(plan_search.MEMORY)
    )
    pace = state.Pace(0.5)
    seen = []
    for _ in range(3):
        with pace.timed(planner, 2):
            seen.append((planner.options.budget, int(planner.memory.credit)))
            planner.memory.simulated += 800
    assert state.ADVANCE == 10
    assert seen == [(0.5 * state.FIRST_RATE, 1000), (100.0, 400), (100.0, -200)]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"policy": "best:budget=0"}, "budget: expected simulated moves a move, above 0"),
        ({"policy": "best:budget=nan"}, "budget: expected"),
        ({"policy": "best:milliseconds=-1"}, "milliseconds: expected a time a move"),
        ({"policy": "best", "scan_every": 2}, "scan-every: expected 1 for policy beam-rollout"),
        (
            {"policy": "best", "rule": "tilt"},
            "policy beam-rollout: expected rule block or merge, got tilt",
        ),
    ],
)
def test_what_planners_refuse(options, message):
    with pytest.raises(InvalidInputError, match=message):
        run(open_map("line:9"), particles=2, **options)


def test_small_coverages_are_close_to_the_optimum():
    excess = []
    for workspace, start in small_cases(often(40, 80), 3):
        best = optimum(workspace, start)
        found = run(workspace, task="coverage", start=start, policy="best").moves
        assert found >= best.moves
        if best.moves:
            excess.append(found / best.moves - 1)
    assert len(excess) >= often(30, 60)
    assert np.mean(excess) <= 0.08


@pytest.mark.parametrize("rule", ["block", "merge"])
def test_an_optimum_is_a_plan(rule):
    for workspace, start in small_cases(20, 4):
        best = optimum(workspace, start, rule=rule)
        played = run(
            workspace, task="coverage", start=start, rule=rule, policy=f"manual:{best.commands}"
        )
        assert played.status == "complete"
        assert played.moves == best.moves == len(best.commands)


@settings(max_examples=often(30, 60), deadline=None)
@given(st.integers(0, 2**32), st.booleans())
def test_lower_bounds_are_not_above_the_optimum(seed, merge):
    rule = "merge" if merge else "block"
    for workspace, start in small_cases(1, seed):
        targets = workspace.free & (np.random.default_rng(seed).random(workspace.shape) < 0.5)
        for wanted in (None, targets):
            bound = lower_bound(workspace, start, targets=wanted, rule=rule)
            assert bound.moves <= optimum(workspace, start, targets=wanted, rule=rule).moves


def knowing_the_map(workspace, start):
    """The fewest commands that classify everything, by breadth-first search over particles and
    cells classified.
    """
    from shoal.swarm.theory.bounds import flat_cells, flat_mask

    free, offsets = flat_cells(workspace)
    world = SmallWorld(free, offsets, "block")
    around = free.copy()
    for offset in offsets:
        around |= np.roll(free, offset)
    particles = world.number(flat_mask(workspace, start))
    wave, seen, moves = {(particles, world.number(around) & ~particles)}, set(), 0
    while all(left for _, left in wave):
        seen |= wave
        wave = {
            (world.push(here, command), left & ~world.shifted(here, offset))
            for here, left in wave
            for command, offset in enumerate(offsets.tolist())
        } - seen
        moves += 1
    return moves


def test_lower_bounds_of_mappings_are_not_above_the_optimum():
    tried = 0
    for workspace, start in small_cases(60, 5):
        if workspace.n_free <= 6:
            tried += 1
            assert lower_bound(workspace, start, task="mapping").moves <= knowing_the_map(
                workspace, start
            )
    assert tried >= 8


def test_lower_bound_of_the_line():
    """With the walls, 5000 cells and 1000 particles: 1-D displacement and at least 2 x 5 commands
    across.
    """
    line = open_map("line:5000")
    start = run(line, particles=1000).start
    bound = lower_bound(line, start, task="mapping")
    gaps = np.diff(start[:, 1])
    assert bound.axes >= 10 + gaps.max() - 1
    assert bound.moves <= run(line, start=start, policy="best").moves
    assert isinstance(bound, LowerBound)


def test_optimal_mappings():
    assert mapping_optimum((1, 1), [(0, 0)]) == MappingOptimum(worst=4.0, mean=4.0, states=16)
    assert mapping_optimum((1, 2), [(0, 0)]).worst == 7
    assert mapping_optimum((2, 2), [(0, 0)]) == MappingOptimum(worst=11.0, mean=7.75, states=2240)
    everything = mapping_optimum((1, 3), [(0, 1)], chance_free=1.0)
    assert (
        everything.mean
        == mapping_optimum((1, 3), [(0, 1)], chance_free=1).worst
        == knowing_the_map(GridWorkspace([[1, 1, 1]]), np.array([[0, 1]]))
    )
    for shape, start in (((1, 3), [(0, 0)]), ((2, 2), [(0, 0)]), ((2, 2), [(0, 0), (1, 1)])):
        best = mapping_optimum(shape, start)
        assert best.mean <= best.worst
        maps, chances = [], []
        for code in range(2 ** int(np.prod(shape))):
            free = np.array(
                [code >> k & 1 for k in range(int(np.prod(shape)))], dtype=bool
            ).reshape(shape)
            if all(free[cell] for cell in start):
                maps.append(GridWorkspace(free))
        chances = [run(space, start=start, policy="best").moves for space in maps]
        assert best.worst <= max(chances)
        assert best.mean <= np.mean(chances) + 1e-9


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: lower_bound(open_map("line:4"), [(0, 0)], rule="slide"),
            "rule: expected block, merge or tilt",
        ),
        (
            lambda: lower_bound(open_map("line:4"), [(0, 0)], task="sweep"),
            "task: expected mapping, coverage",
        ),
        (
            lambda: lower_bound(open_map("line:4"), [(0, 0)], targets=np.ones((2, 2), bool)),
            "targets: expected a mask of shape",
        ),
        (
            lambda: optimum(GridWorkspace([[1, 0, 1]]), [(0, 0)]),
            "expected a particle in every connected part",
        ),
        (
            lambda: optimum(open_map("rectangle:4x4"), [(0, 0)], rule="tilt"),
            "expected a task that particles can complete under the rule tilt",
        ),
        (lambda: optimum(open_map("rectangle:5x5"), [(0, 0)], most_states=50), "at most 50 states"),
        (lambda: mapping_optimum((2, 3), [(0, 0)], most_states=50), "at most 50 states"),
        (
            lambda: mapping_optimum((1, 2), [(0, 0)], chance_free=2),
            "chance_free: expected a number from 0 to 1",
        ),
    ],
)
def test_what_bounds_refuse(call, message):
    with pytest.raises(InvalidInputError, match=message):
        call()


@pytest.mark.parametrize(("slips", "expected"), [((), 6), ((2,), 7), ((1, 3), 8)])
@pytest.mark.parametrize("policy", ["best", "greedy-classify"])
def test_a_planner_plans_anew_where_a_particle_slipped(policy, slips, expected):
    """Before, it sent the rest of the plan, which turned upwards too early."""
    free = Board.of_mask(np.array([[0, 0, 0, 0, 0, 1], [1, 1, 1, 1, 1, 1]], dtype=bool))
    unknown = Board.of_cells(free.layout, [(0, 5)])
    belief = Belief(free - unknown, free.dilated() - unknown, unknown)
    here = Board.of_cells(free.layout, [(1, 0)])
    planner, memory, sent = make_policy(policy), None, ""
    while not (sent.endswith("u") and (1, 5) in here) and len(sent) < 20:
        view = View(belief, here, moves=len(sent))
        command, memory = planner.decide(view, memory, np.random.default_rng(1))
        sent += command
        if len(sent) not in slips:
            code = "lurd".index(command)
            here = pushed(free.layout, belief.open.words, SwarmState(here), code, "block").occupied
    assert len(sent) == expected
