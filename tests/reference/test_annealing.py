"""The kernels of annealing against plain replays."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference import plain
from tests.reference.test_planner_pieces import plain_copy, scene_of
from tests.soak import often

from shoal.swarm.kernels.planning import anneal, forward_model

EVERY = 4


def course_of(planner, plan):
    room = 2 * len(plan) + 64
    course = anneal.AnnealedPlan(
        *(np.zeros(room, dtype=np.int8) for _ in range(3)),
        checkpoints=np.zeros((room // EVERY + 1, *planner.root.shape), dtype=np.uint64),
        every=EVERY,
    )
    course.plan[: len(plan)] = plan
    return course


def plain_moves(frame, planner, plan, rule):
    """Return after how many commands of a plan all is covered, by a loop over cells; None if it is
    not.
    """
    counts, ground, state, frontier = plain_copy(frame, planner, "coverage")
    code = plain.BLOCK if rule == "block" else plain.MERGE
    for moves, one in enumerate(plan):
        if not frontier.any():
            return moves
        plain.step(counts, ground, state, frontier, one, code, plain.COVERAGE)
    return None if frontier.any() else len(plan)


@pytest.mark.parametrize("rule", ["block", "merge"])
@pytest.mark.parametrize("shape", [(1, 9), (7, 6), (3, 65), (3, 4, 5)])
def test_plans_are_played_to_their_end(shape, rule):
    for seed in range(often(2, 4)):
        frame, planner, _, _, _, rng = scene_of(shape, seed, "coverage", rule=rule)
        given = rng.integers(0, 2 * len(shape), 12).astype(np.int8)
        plan = np.zeros(4000, dtype=np.int8)
        plan[: len(given)] = given
        forward_model.copy_state(planner.root, planner.state)
        moves, _ = anneal.finish(
            planner, planner.state, plan, np.int64(0), np.int64(len(given)), np.int64(3000)
        )
        assert moves == plain_moves(frame, planner, plan[:moves], rule) <= 3000
        assert (plan[: min(moves, len(given))] == given[:moves]).all()
        if moves > 0:
            forward_model.copy_state(planner.root, planner.state)
            assert (
                anneal.finish(
                    planner, planner.state, plan, np.int64(0), np.int64(moves), np.int64(moves - 1)
                )[0]
                == moves
            )


@pytest.mark.parametrize("shape", [(1, 9), (7, 6), (3, 65), (3, 4, 5)])
def test_states_are_kept_on_the_way(shape):
    _, planner, _, _, _, rng = scene_of(shape, 3, "coverage")
    plan = rng.integers(0, 2 * len(shape), 30)
    course = course_of(planner, plan)
    forward_model.copy_state(planner.root, course.checkpoints[0])
    anneal.keep_states(planner, course, np.int64(0), np.int64(len(plan)))
    course.plan[17:30] = plan[17:30] = rng.integers(0, 2 * len(shape), 13)
    anneal.keep_states(planner, course, np.int64(17), np.int64(len(plan)))
    forward_model.copy_state(planner.root, planner.state)
    for move, one in enumerate(plan):
        if move % EVERY == 0:
            assert (course.checkpoints[move // EVERY] == planner.state).all()
        forward_model.advance(planner.scene, planner.state, np.int64(one))


def test_changes_are_of_all_kinds():
    _, planner, _, _, _, rng = scene_of((7, 6), 1, "coverage")
    plan = rng.integers(0, 4, 40).astype(np.int8)
    course = course_of(planner, plan)
    lengths = set()
    for _ in range(2000):
        at, end = anneal.change(planner, course, np.int64(len(plan)))
        assert 0 <= at < len(plan)
        begin = at // EVERY * EVERY
        assert (course.trial[begin:at] == plan[begin:at]).all()
        tail = max(0, min(end, len(plan)) - at - 9)
        assert (course.trial[end - tail : end] == plan[len(plan) - tail :]).all()
        lengths.add(end - len(plan))
    assert lengths <= {*range(-8, 9)}
    assert lengths >= {-8, -4, -3, -2, -1, 0, 1, 2, 4, 8}


def test_the_shortest_plan_is_kept():
    frame, planner, *_ = scene_of((7, 6), 2, "coverage")
    plan = np.zeros(4000, dtype=np.int8)
    forward_model.copy_state(planner.root, planner.state)
    moves, _ = anneal.finish(planner, planner.state, plan, np.int64(0), np.int64(0), np.int64(3000))
    course = course_of(planner, plan[:moves])
    course.shortest[:moves] = plan[:moves]
    length = fewest = moves
    for heat in (3.0, 0.5, 0.1):
        before = fewest
        length, fewest, spent = anneal.anneal(planner, course, length, fewest, heat, 20_000.0)
        assert fewest <= min(before, length)
        assert spent >= 20_000
        assert plain_moves(frame, planner, course.plan[:length], "block") == length
        assert plain_moves(frame, planner, course.shortest[:fewest], "block") == fewest
    assert fewest < moves
