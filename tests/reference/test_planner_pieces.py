"""The kernels of planners against slow, obvious loops over cells."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest
from tests.reference import plain

from shoal.swarm import Board, GridWorkspace, GridWorld, make_policy, make_task, planning
from shoal.swarm.engine import field_of
from shoal.swarm.kernels import foresight, guess, survey, ways
from shoal.swarm.kernels.planner import LAYERS, LIKELY, SURE
from shoal.swarm.kernels.rollout import look

SHAPES = ((1, 9), (7, 6), (5, 62), (4, 63), (3, 64), (3, 65), (2, 127), (3, 4, 5), (2, 3, 65))


def scene_of(shape, seed, task="mapping", moves=6, rule="block"):
    """A running episode, its planner with the scene filled, and the world as the plain reference has it."""
    rng = np.random.default_rng(seed)
    free = rng.random(shape) < rng.choice([0.6, 0.8, 1.0])
    free.flat[rng.integers(free.size)] = True
    workspace = GridWorkspace(free).largest_component()
    start = workspace.cells[rng.choice(workspace.n_free, size=max(1, workspace.n_free // 4), replace=False)]
    world, todo = GridWorld(workspace, rule), make_task(task)
    state = world.initial(start)
    belief = todo.begin(world, state, workspace.free if task == "coverage" else None)
    commands = rng.integers(0, 2 * len(shape), moves)
    for command in commands:
        after = world.step(state, "lurdio"[command])
        belief = todo.update(belief, "lurdio"[command], state.occupied, after.occupied)
        state = after
    policy = make_policy("rollout")
    mind = planning.planner_of(
        world.frame, belief, rule=rule, mapping=task == "mapping", seed=1, options=policy.settings(len(start))
    )
    mind.survey.tallies[:, 0] = rng.integers(0, 6, survey.TALLIES)
    mind.survey.tallies[:, 1] = rng.integers(0, 1 + mind.survey.tallies[:, 0])
    field = field_of(belief.open.words, state, belief)
    look(field, task == "mapping", mind)
    return world.frame, mind, field, state, belief, rng


def cells_of(frame, board):
    return Board(frame, board.reshape(frame.words))


def plain_copy(frame, mind, task):
    """Return counts, free, state and frontier of the imagined world; the rim is the reference's own."""

    def grid(board):
        mask = cells_of(frame, board).mask
        return mask if mask.ndim == 3 else mask[None]

    counts = grid(mind.root[foresight.OCCUPIED]).astype(np.int32)
    ground, frontier = grid(mind.scene.ground), grid(mind.root[foresight.FRONTIER])
    unseen = grid(mind.root[foresight.UNSEEN])
    known = ~(frontier | unseen) if task == "mapping" else np.ones_like(frontier)
    state = np.where(known, np.where(ground, plain.FREE, plain.OBSTACLE), plain.UNKNOWN).astype(np.uint8)
    return counts, ground.copy(), state, frontier.copy()


@pytest.mark.parametrize("rule", ["block", "merge"])
@pytest.mark.parametrize("task", ["mapping", "coverage"])
@pytest.mark.parametrize("shape", SHAPES)
def test_imagined_moves(shape, task, rule):
    for seed in range(4):
        frame, mind, _, _, _, rng = scene_of(shape, seed, task, rule=rule)
        counts, ground, state, frontier = plain_copy(frame, mind, task)
        code = plain.BLOCK if rule == "block" else plain.MERGE
        for command in rng.integers(0, 2 * len(shape), 12):
            foresight.prospects(mind.scene, mind.root, mind.gains)
            expected = plain.step(
                counts, ground, state, frontier, command, code, plain.MAPPING if task == "mapping" else plain.COVERAGE
            )
            settled = foresight.advance(mind.scene, mind.root, np.int64(command))
            assert settled == expected[1] == mind.gains[command]
            occupied = cells_of(frame, mind.root[foresight.OCCUPIED]).mask.reshape(counts.shape)
            assert (occupied == (counts > 0)).all()
            assert (cells_of(frame, mind.root[foresight.FRONTIER]).mask.reshape(counts.shape) == frontier).all()


def distances_of(frame, mind):
    """Breadth-first search, cell by cell, over ground and frontier; stops at the frontier."""
    ground, frontier = cells_of(frame, mind.scene.ground).mask, cells_of(frame, mind.root[foresight.FRONTIER]).mask
    occupied = cells_of(frame, mind.root[foresight.OCCUPIED]).mask
    distance = np.full(ground.shape, -1)
    queue = deque(tuple(cell) for cell in np.argwhere(occupied))
    for cell in queue:
        distance[cell] = 0
    while queue:
        cell = queue.popleft()
        if not ground[cell]:  # nobody goes on from a wall
            continue
        for axis in range(ground.ndim):
            for step in (-1, 1):
                near = tuple(c + step * (k == axis) for k, c in enumerate(cell))
                if min(near) < 0 or any(c >= s for c, s in zip(near, ground.shape, strict=True)):
                    continue
                if distance[near] < 0 and (ground[near] or frontier[near]):
                    distance[near] = distance[cell] + 1
                    queue.append(near)
    return distance[frontier]


@pytest.mark.parametrize("shape", SHAPES)
def test_way_and_outlook(shape):
    for seed in range(6):
        frame, mind, _, _, _, _ = scene_of(shape, seed, moves=seed)
        distances = distances_of(frame, mind)
        length = ways.way(mind.scene, mind.root, mind.planes, mind.trial, np.int64(0), 500)
        nearest = distances[distances > 0].min(initial=10**6)
        assert length == (0 if nearest == 10**6 else nearest)
        rate, cap = 0.8, 5
        expected = sum(rate ** (min(d - 1, cap) if d > 0 else cap) for d in distances)
        found = ways.outlook(mind.scene, mind.root, mind.planes, rate, cap)
        if (distances > 0).all():
            assert found == pytest.approx(expected)
        settled = 0
        for command in mind.trial[:length]:
            assert settled == 0
            settled = foresight.advance(mind.scene, mind.root, np.int64(command))
        assert length == 0 or settled > 0 or length > 1


def predicted_plainly(frame, field, tallies, depth, likely, sure):
    """The rule of `guess`, one cell after the other, by the surroundings as `survey` sees them."""
    known, opened = field.known.copy(), field.open.copy()
    layer = [tuple(cell) for cell in np.argwhere(cells_of(frame, field.frontier).mask.reshape(frame.words[0], -1))]

    def state_field():
        return field._replace(open=opened)

    def inside(row, column):
        in_layer, within = divmod(row, frame.rows)
        if not (0 < within < frame.rows - 1 and 0 < column < frame.columns - 1):
            return False
        return frame.ndim == 2 or 0 < in_layer < frame.layers - 1

    def fines(row, column):
        for command in range(2 * frame.ndim):
            r, c = survey.ahead(row, column, survey.opposite(command), frame.rows)
            if 0 <= r < frame.words[0] and 0 <= c < frame.columns and survey.has(opened, field.width, r, c):
                yield safe_surroundings(frame, known, opened, row, column, command)

    for number in range(depth):
        needed = max(likely, sure ** (1 / (number + 1)))
        chances = [survey.chance(tallies, fine, fine // 6) for fine in range(survey.FINE)]
        walls = [
            cell for cell in layer
            if any(chances[f] < guess.UNLIKELY and tallies[survey.FINE + f // 6, 0] >= guess.FEWEST for f in fines(*cell))
        ]  # fmt: skip
        for row, column in walls:
            known[row * field.width + (column >> 6)] |= np.uint64(1 << (column & 63))
        found = []
        for row, column in layer:
            entries = [chances[f] > needed for f in fines(row, column)]
            if (row, column) not in walls and inside(row, column) and entries and all(entries):
                found.append((row, column))
        if not found:
            break
        for board, cells in ((opened, found), (known, layer)):
            for row, column in cells:
                board[row * field.width + (column >> 6)] |= np.uint64(1 << (column & 63))
        around = {survey.ahead(row, column, command, frame.rows) for row, column in found for command in range(2 * frame.ndim)}
        layer = [(r, c) for r, c in around if not survey.has(known, field.width, r, c)]
    return opened


def safe_surroundings(frame, known, opened, row, column, command):
    """`survey.surroundings`, cell by cell; outside of the board is unknown."""

    def state(r, c):
        if not (0 <= r < frame.words[0] and 0 <= c < 64 * frame.words[1]):
            return 0
        if not survey.has(known, frame.words[1], r, c):
            return 0
        return 1 if survey.has(opened, frame.words[1], r, c) else 2

    def pair(r, c):
        first = survey.UP if command in (survey.LEFT, survey.RIGHT) else survey.LEFT
        low, high = sorted(state(*survey.ahead(r, c, way, frame.rows)) for way in (first, survey.opposite(first)))
        return high * (high + 1) // 2 + low

    near = survey.ahead(row, column, survey.opposite(command), frame.rows)
    behind = survey.ahead(*near, survey.opposite(command), frame.rows)
    return (state(*behind) * 6 + pair(*near)) * 6 + pair(row, column)


@pytest.mark.parametrize("shape", [shape for shape in SHAPES if len(shape) == 2 or shape[-1] < 60])
def test_prediction(shape):
    for seed in range(5):
        frame, mind, field, _, _, _ = scene_of(shape, seed, moves=seed)
        for layers, likely, sure in ((1, 0.75, 0.0), (12, 0.6, 0.0), (30, 0.5, 0.3)):
            guess.predict(field, mind.survey.tallies, mind.guess, layers, likely, sure)
            expected = predicted_plainly(frame, field, mind.survey.tallies, layers, likely, sure)
            assert (mind.guess.open == expected).all()
    assert {LAYERS, LIKELY, SURE} < set(range(mind.options.size))
