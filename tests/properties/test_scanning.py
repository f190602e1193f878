"""Laws of scanning: runs tell what single steps tell, schedules are exact, and the optimal one is
never worse.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.properties.strategies import swarms
from tests.swarm_runs import run

from shoal.swarm import Coverage, GridWorld, Mapping, SwarmEpisode
from shoal.swarm.grid.scans import states_of_run
from shoal.swarm.theory.scan_schedules import (
    Custom,
    EqualSteps,
    EveryStep,
    Hyperexponential,
    OneJump,
    Powers,
    least_simultaneous_ratio,
    optimal_schedule,
    worst_of_both,
)

RULES = ("block", "merge")  # a tilt is a run by itself
SCANS = ("1", "2", "3", "7", "doubling", "hyper", "adaptive")
TASKS = ("mapping", "coverage")
LIMITS = (2, 7, 20, 150)  # of moves: some cut a run
prices = st.one_of(
    st.sampled_from([0, 1, 10]),
    st.fractions(min_value=Fraction(1, 50), max_value=200, max_denominator=50),
)


@st.composite
def runs(draw, ndim):
    letters = st.sampled_from("lurdio"[: 2 * ndim])
    return draw(st.lists(st.tuples(letters, st.integers(1, 9)), max_size=8))


@given(swarms(), st.sampled_from(RULES), st.data())
def test_a_scan_after_a_run_tells_what_scans_after_each_move_tell(swarm, rule, data):
    """... and so never contradicts the truth."""
    workspace, start = swarm
    world = GridWorld(workspace, rule)
    state = world.initial(start)
    belief = stepwise = Mapping().begin(world, state)
    for command, steps in data.draw(runs(workspace.ndim)):
        truth = [state]
        for _ in range(steps):
            truth.append(world.step(truth[-1], command))
        found = list(states_of_run(state, truth[-1], command, steps))
        assert found == truth[1:]
        for before, after, seen_before, seen in zip(
            truth, truth[1:], [state, *found], found, strict=False
        ):
            stepwise = Mapping().update(stepwise, command, before.occupied, after.occupied)
            belief = Mapping().update(belief, command, seen_before.occupied, seen.occupied)
        state = truth[-1]
        assert belief == stepwise
        assert belief.open <= world.free
        assert not (belief.obstacles & world.free)
        assert belief.frontier == belief.open.dilated() - belief.known


@given(
    swarms(),
    st.sampled_from(RULES),
    st.sampled_from(SCANS),
    st.integers(0, 9),
    st.sampled_from(TASKS),
    st.sampled_from(LIMITS),
)
def test_whole_episodes_are_the_same_compiled_and_step_by_step(
    swarm, rule, every, seed, task, limit
):
    workspace, start = swarm
    if task == "coverage":
        labels = workspace.components
        start = workspace.cells[labels[tuple(workspace.cells.T)] == labels[tuple(start[0])]][
            : len(start)
        ]
        workspace = type(workspace)(labels == labels[tuple(start[0])])
    problem = {
        "task": task,
        "start": start,
        "rule": rule,
        "seed": seed,
        "scan_every": every,
        "max_moves": limit,
    }
    fast, slow = run(workspace, **problem), run(workspace, **problem, stepwise=True)
    assert (fast.commands, fast.status) == (slow.commands, slow.status)
    assert fast.trace.difference(slow.trace) is None
    assert fast.verify()


@given(swarms(), st.sampled_from(RULES), st.sampled_from(SCANS))
def test_every_scan_rule_finds_the_same_map(swarm, rule, every):
    workspace, start = swarm
    one, other = (
        run(workspace, start=start, rule=rule, scan_every=rule_) for rule_ in ("1", every)
    )
    assert one.status == other.status == "complete"
    assert one.final()[1] == other.final()[1]
    assert other.scans <= other.moves + 1
    assert other.cost == 10 * other.scans + other.moves


@given(swarms(ndim=2), st.sampled_from(SCANS))
def test_belief_shown_between_scans_is_that_of_the_last_scan(swarm, every):
    workspace, start = swarm
    episode = run(workspace, start=start, scan_every=every, max_moves=60)
    frames = list(episode.frames())
    for (_, before), (_, after), scanned in zip(
        frames, frames[1:], episode.trace.scanned, strict=False
    ):
        assert scanned or before == after
    if episode:
        assert frames[-1][1] == episode.final()[1]


@given(swarms(), st.sampled_from(SCANS))
def test_scans_survive_the_file(tmp_path_factory, swarm, every):
    workspace, start = swarm
    path = tmp_path_factory.mktemp("episode") / "episode.npz"
    episode = run(workspace, start=start, scan_every=every, scan_cost=2.5, max_moves=50)
    episode.save(path)
    again = SwarmEpisode.load(path)
    np.testing.assert_array_equal(again.trace.scanned, episode.trace.scanned)
    assert (again.problem.scanning, again.cost) == (episode.problem.scanning, episode.cost)
    assert again.verify()


@given(swarms(ndim=2), st.integers(0, 20))
def test_a_known_map_needs_no_scan_but_the_first(swarm, seed):
    workspace, start = swarm
    labels = workspace.components
    part = type(workspace)(labels == labels[tuple(start[0])])
    start = part.cells[: len(start)]
    every, adaptive = (
        run(part, task=Coverage(), start=start, seed=seed, scan_every=rule)
        for rule in ("1", "adaptive")
    )
    assert adaptive.commands == every.commands
    assert adaptive.scans == 1


def simulated_cost(positions, distance):
    """Walk one move at a time; scan where the schedule says."""
    at, moves, scans = 0, 0, 1
    pending = iter(positions)
    following = next(pending)
    while True:
        moves += 1
        at = min(at + 1, distance)
        if moves == following:
            scans += 1
            if at < moves:
                return moves, scans
            following = next(pending)


SCHEDULES = (
    EveryStep(),
    EqualSteps(3),
    Powers(2),
    Powers(3),
    Hyperexponential(),
    OneJump(200),
    Custom([1, 5, 6, 40, 199]),
)


@given(st.sampled_from(SCHEDULES), st.integers(0, 198))
def test_costs_are_those_of_a_walk(schedule, distance):
    cost = schedule.cost(distance)
    assert (cost.moves, cost.scans) == simulated_cost(schedule.positions(), distance)


@given(st.sampled_from(SCHEDULES), prices, prices, st.integers(0, 198))
def test_worst_is_the_largest_over_all_distances(schedule, scan, move, limit):
    if not scan and not move:
        return
    ratios = [
        schedule.cost(d).weighted_ratio(scan_cost=scan, move_cost=move) for d in range(limit + 1)
    ]
    worst = schedule.worst(scan_cost=scan, move_cost=move, max_distance=limit)
    assert worst.ratio == max(ratios)
    assert ratios[worst.distance] == worst.ratio


@given(prices, prices, st.integers(0, 400), st.data())
def test_the_optimal_schedule_is_never_worse_than_any_other(scan, move, limit, data):
    if not scan and not move:
        return
    best = optimal_schedule(scan_cost=scan, move_cost=move, max_distance=limit)
    steps = data.draw(st.lists(st.integers(1, 60), min_size=1, max_size=12))
    own = np.cumsum([*steps, limit + 1]).tolist()
    # The best one with a position moved is the hardest rival.
    near = [*best.positions()]
    moved = sorted(
        {max(1, x + data.draw(st.integers(-2, 2))) for x in near[:12]} | {*near[12:], limit + 3}
    )
    others = [
        EveryStep(),
        EqualSteps(7),
        Powers(2),
        Powers(5),
        Hyperexponential(),
        OneJump(limit + 1),
        Custom(own),
        Custom(moved),
    ]
    for other in others:
        assert (
            best.guarantee.ratio
            <= other.worst(scan_cost=scan, move_cost=move, max_distance=limit).ratio
        ), other


@given(st.integers(0, 7), prices, prices)
def test_the_optimal_schedule_is_the_best_of_all_on_short_distances(limit, scan, move):
    if not scan and not move:
        return
    end, inner = limit + 1, range(1, limit + 1)
    subsets = [[p for i, p in enumerate(inner) if chosen >> i & 1] for chosen in range(2**limit)]
    every = [
        Custom([*subset, end]).worst(scan_cost=scan, move_cost=move, max_distance=limit).ratio
        for subset in subsets
    ]
    assert optimal_schedule(
        scan_cost=scan, move_cost=move, max_distance=limit
    ).guarantee.ratio == min(every)


@given(st.integers(0, 7))
def test_the_bound_of_theorem_1_is_the_best_of_all_on_short_distances(limit):
    end, inner = limit + 1, range(1, limit + 1)
    subsets = [[p for i, p in enumerate(inner) if chosen >> i & 1] for chosen in range(2**limit)]
    best = least_simultaneous_ratio(limit)
    assert best.ratio == min(worst_of_both(Custom([*subset, end]), limit) for subset in subsets)
    assert worst_of_both(best.schedule, limit) == best.ratio
