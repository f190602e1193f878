"""The kernels of planners against slow, obvious loops over cells."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest
from tests.reference import plain
from tests.soak import often

from shoal.swarm import Board, GridWorkspace, GridWorld, make_policy, make_task
from shoal.swarm.grid.state import field_of
from shoal.swarm.kernels import moves as steps
from shoal.swarm.kernels.moves import LEFT, RIGHT, UP, has
from shoal.swarm.kernels.planning import forward_model, learned_prior, plan_search, prediction
from shoal.swarm.kernels.planning.plan_search import prepare
from shoal.swarm.kernels.search import ahead, opposite
from shoal.swarm.policies.planners import learned_weights
from shoal.swarm.policies.planners.state import planner_of

SHAPES = (
    (1, 9),
    (7, 6),
    (5, 62),
    (4, 63),
    (3, 64),
    (3, 65),
    (2, 127),
    (3, 4, 5),
    (2, 3, 65),
    (3, 16, 3),
)


def scene_of(shape, seed, task="mapping", moves=6, rule="block"):
    """A running episode, its planner with the scene filled, and the world as the plain reference
    has it.
    """
    rng = np.random.default_rng(seed)
    free = rng.random(shape) < rng.choice([0.6, 0.8, 1.0])
    free.flat[rng.integers(free.size)] = True
    workspace = GridWorkspace(free).largest_component()
    start = workspace.cells[
        rng.choice(workspace.n_free, size=max(1, workspace.n_free // 4), replace=False)
    ]
    world, todo = GridWorld(workspace, rule), make_task(task)
    state = world.initial(start)
    belief = todo.begin(world, state, workspace.free if task == "coverage" else None)
    commands = rng.integers(0, 2 * len(shape), moves)
    for command in commands:
        after = world.step(state, "lurdio"[command])
        belief = todo.update(belief, "lurdio"[command], state.occupied, after.occupied)
        state = after
    policy = make_policy("best")
    planner = planner_of(
        world.layout,
        belief,
        rule=rule,
        mapping=task == "mapping",
        seed=1,
        options=policy.settings(len(start)),
    )
    tallies = planner.prior.tallies
    tallies[:, 0] = rng.integers(0, 6, len(tallies))
    tallies[:, 1] = rng.integers(0, 1 + tallies[:, 0])
    weights = rng.random(prediction.EXPERTS) * rng.integers(0, 2, prediction.EXPERTS) + 1e-9
    weights[prediction.LEARNED] *= len(shape) == 2  # it has seen maps of two dimensions only
    planner.prior.weights[:] = weights / weights.sum()
    field = field_of(world.free.words, state, belief)
    prepare(field, task == "mapping", planner)
    return world.layout, planner, field, state, belief, rng


def cells_of(layout, board):
    return Board(layout, board.reshape(layout.words))


def plain_copy(layout, planner, task):
    """Return counts, free, state and frontier of the simulated world; the rim is the reference's
    own.
    """

    def grid(board):
        mask = cells_of(layout, board).mask
        return mask if mask.ndim == 3 else mask[None]

    counts = grid(planner.root[forward_model.OCCUPIED]).astype(np.int32)
    ground, frontier = grid(planner.scene.ground), grid(planner.root[forward_model.FRONTIER])
    unseen = grid(planner.root[forward_model.UNSEEN])
    known = ~(frontier | unseen) if task == "mapping" else np.ones_like(frontier)
    state = np.where(known, np.where(ground, plain.FREE, plain.OBSTACLE), plain.UNKNOWN).astype(
        np.uint8
    )
    return counts, ground.copy(), state, frontier.copy()


@pytest.mark.parametrize("rule", ["block", "merge"])
@pytest.mark.parametrize("task", ["mapping", "coverage"])
@pytest.mark.parametrize("shape", SHAPES)
def test_imagined_moves(shape, task, rule):
    for seed in range(4):
        layout, planner, _, _, _, rng = scene_of(shape, seed, task, rule=rule)
        counts, ground, state, frontier = plain_copy(layout, planner, task)
        code = plain.BLOCK if rule == "block" else plain.MERGE
        for command in rng.integers(0, 2 * len(shape), 12):
            forward_model.immediate_gains(planner.scene, planner.root, planner.gains)
            expected = plain.step(
                counts,
                ground,
                state,
                frontier,
                command,
                code,
                plain.MAPPING if task == "mapping" else plain.COVERAGE,
            )
            settled = forward_model.advance(planner.scene, planner.root, np.int64(command))
            assert settled == expected[1] == planner.gains[command]
            occupied = cells_of(layout, planner.root[forward_model.OCCUPIED]).mask.reshape(
                counts.shape
            )
            assert (occupied == (counts > 0)).all()
            assert (
                cells_of(layout, planner.root[forward_model.FRONTIER]).mask.reshape(counts.shape)
                == frontier
            ).all()


def distances_of(layout, planner):
    """Breadth-first search, cell by cell, over ground and frontier; stops at the frontier."""
    ground, frontier = (
        cells_of(layout, planner.scene.ground).mask,
        cells_of(layout, planner.root[forward_model.FRONTIER]).mask,
    )
    occupied = cells_of(layout, planner.root[forward_model.OCCUPIED]).mask
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
def test_way_to_the_frontier(shape):
    for seed in range(6):
        layout, planner, _, _, _, _ = scene_of(shape, seed, moves=seed)
        distances = distances_of(layout, planner)
        length = forward_model.path_to_nearest(
            planner.scene, planner.root, planner.planes, planner.trial, np.int64(0), 500
        )
        nearest = distances[distances > 0].min(initial=10**6)
        assert length == (0 if nearest == 10**6 else nearest)
        settled = 0
        for command in planner.trial[:length]:
            assert settled == 0
            settled = forward_model.advance(planner.scene, planner.root, np.int64(command))
        assert length == 0 or settled > 0 or length > 1


class Plain:
    """What a planner learns, by names instead of numbers: {surroundings: (cells, free ones)}."""

    def __init__(self, layout, weights):
        self.layout, self.tallies, self.weights = layout, {}, list(weights)

    def surroundings(self, state, row, column, command):
        """Return (behind, beside the neighbour, beside the cell), the last two sorted; `state`
        tells that of a cell.
        """
        rows = self.layout.rows
        sides = (LEFT, RIGHT) if command not in (LEFT, RIGHT) else (UP, opposite(UP))
        near = ahead(row, column, opposite(command), rows)
        behind = ahead(*near, opposite(command), rows)
        pairs = [
            tuple(sorted(state(*ahead(*cell, way, rows)) for way in sides))
            for cell in (near, (row, column))
        ]
        return (state(*behind), *pairs)

    def chance(self, around):
        """Return the share of free cells with these surroundings, smoothed towards coarser
        surroundings.
        """
        likely = 0.5
        for name in ("all", around[:2], around):
            cells, free = self.tallies.get(name, (0, 0))
            likely = (free + 2 * likely) / (cells + 2)
        return likely

    def learn(self, around, free, told):
        """Ask both experts, weigh them, then count the cell."""
        chances = [self.chance(around), told]
        weighed = [
            weight * (likely if free else 1 - likely)
            for weight, likely in zip(self.weights, chances, strict=True)
        ]
        having = sum(weight > 0 for weight in weighed)
        share = prediction.DEALT
        self.weights = [
            (1 - share) * weight / sum(weighed) + share / having if weight > 0 else 0.0
            for weight in weighed
        ]
        for name in ("all", around[:2], around):
            cells, opened = self.tallies.get(name, (0, 0))
            self.tallies[name] = (cells + 1, opened + free)


def states(layout, known, opened):
    """Return a function that tells the state of a cell: 0 unknown, as all beyond the board, 1 free,
    2 obstacle.
    """
    width = layout.words[1]

    def state(row, column):
        if not (0 <= row < layout.words[0] and 0 <= column < 64 * width) or not has(
            known, width, row, column
        ):
            return 0
        return 1 if has(opened, width, row, column) else 2

    return state


@pytest.mark.parametrize("shape", SHAPES)
def test_experience(shape):
    """What is learnt from the moves of an episode is what the plain one learns from the
    same cells.
    """
    layout, planner, field, _, _, rng = scene_of(shape, 3, moves=0)
    learnt, network = planner.prior, planner.learned
    learnt.tallies[:], learnt.weights[:] = 0, (0.6, 0.4)
    if len(shape) == 3:
        learnt.weights[:] = 1.0, 0.0  # the network has seen maps of two dimensions only
    plainly = Plain(layout, learnt.weights)
    for command in rng.integers(0, 2 * len(shape), often(6, 12)):
        learnt.before[:] = field.known
        state = states(layout, learnt.before, field.open)
        steps.step(field, command, 0, True)
        bias = network.bias[0]
        prediction.learn_from_command(field, learnt, network, command)
        learnt_bias, network.bias[0] = network.bias[0], bias
        for i, word in enumerate(field.known & ~learnt.before):
            for bit in range(64):
                if int(word) >> bit & 1:
                    row, column = i // field.width, 64 * (i % field.width) + bit
                    around = plainly.surroundings(state, row, column, command)
                    told = 0.5
                    if len(shape) == 2:
                        told = learned_prior.learned_chance(
                            network, field.open, learnt.before, np.int64(64 * i + bit), command
                        )
                    free = bool(has(field.open, field.width, row, column))
                    plainly.learn(around, free, told)
                    network.bias[0] += free - told if len(shape) == 2 else 0
        assert network.bias[0] == learnt_bias
        assert (learnt_bias != 0) == (len(shape) == 2)
    assert learnt.weights == pytest.approx(plainly.weights)
    assert plainly.tallies["all"][0] > 0
    assert learnt.tallies[0].tolist() == list(plainly.tallies["all"])
    assert sorted(map(tuple, learnt.tallies[learnt.tallies[:, 0] > 0].tolist())) == sorted(
        map(tuple, plainly.tallies.values())
    )


def predicted_plainly(layout, field, learnt, network, depth, likely, sure):
    """The rule of `guess`, one cell after the other."""
    known, opened = field.known.copy(), field.open.copy()
    layer = [
        tuple(cell)
        for cell in np.argwhere(cells_of(layout, field.frontier).mask.reshape(layout.words[0], -1))
    ]

    def inside(row, column):
        in_layer, within = divmod(row, layout.rows)
        if not (0 < within < layout.rows - 1 and 0 < column < layout.columns - 1):
            return False
        return layout.ndim == 2 or 0 < in_layer < layout.layers - 1

    def ways_in(row, column):
        """Yield the commands that lead into a cell from one taken to be free."""
        for command in range(2 * layout.ndim):
            r, c = ahead(row, column, opposite(command), layout.rows)
            if (
                0 <= r < layout.words[0]
                and 0 <= c < layout.columns
                and has(opened, field.width, r, c)
            ):
                yield command

    def number_of(row, column):
        return np.int64(64 * layout.words[1] * row + column)

    def told(row, column):
        if learnt.weights[prediction.LEARNED] <= prediction.LEAST:
            return 0.5
        command = next(ways_in(row, column))
        return learned_prior.learned_chance(
            network, opened, known, number_of(row, column), np.int64(command)
        )

    def chances(row, column, told):
        """Yield, for each side from which a cell may be entered, how likely it is free and how
        often the like was seen.
        """
        share = learnt.weights[prediction.LEARNED]
        share = 0 if share <= prediction.LEAST else 1 if share >= 1 - prediction.LEAST else share
        for command in ways_in(row, column):
            cell, steps = (
                number_of(row, column),
                prediction.steps_of(layout.rows, layout.words[1], command),
            )
            number = prediction.around(opened, known, cell, *steps)
            yield (
                share * told + (1 - share) * prediction.chance(learnt, number),
                learnt.tallies[1 + number // 6, 0],
            )

    def put(board, cells):
        for row, column in cells:
            board[row * field.width + (column >> 6)] |= np.uint64(1 << (column & 63))

    for number in range(depth):
        needed = max(likely, sure ** (1 / (number + 1)))
        sure_of_walls = learnt.weights[prediction.LEARNED] > 0.5
        walls = [cell for cell in layer if not inside(*cell)]
        asked = {cell: told(*cell) for cell in layer if inside(*cell)}
        walls += [
            cell
            for cell, first in asked.items()
            if any(
                c < prediction.UNLIKELY and (sure_of_walls or seen >= prediction.FEWEST)
                for c, seen in chances(*cell, first)
            )
        ]
        put(known, walls)
        found = []
        for cell, first in asked.items():
            again = first if first > needed else told(*cell)
            if cell not in walls and all(c > needed for c, _ in chances(*cell, again)):
                found.append(cell)
        if not found:
            break
        put(opened, found)
        put(known, layer)
        near = {
            ahead(row, column, command, layout.rows)
            for row, column in found
            for command in range(2 * layout.ndim)
        }
        layer = [(r, c) for r, c in near if not has(known, field.width, r, c)]
    return opened


@pytest.mark.parametrize("shape", [shape for shape in SHAPES if len(shape) == 2 or shape[-1] < 60])
def test_prediction(shape):
    for seed in range(often(3, 5)):
        layout, planner, field, _, _, _ = scene_of(shape, seed, moves=seed)
        for layers, likely, sure in ((1, 0.75, 0.0), (12, 0.6, 0.0), (30, 0.5, 0.3), (3, 0.6, 0.5)):
            prediction.predict(
                field, planner.prior, planner.learned, planner.prediction, layers, likely, sure
            )
            expected = predicted_plainly(
                layout, field, planner.prior, planner.learned, layers, likely, sure
            )
            assert (planner.prediction.open == expected).all()
    assert {"prediction_layers", "free_threshold", "joint_chance"} < set(
        planner.options.dtype.names
    )


@pytest.mark.parametrize("shape", [shape for shape in SHAPES if len(shape) == 2])
def test_network(shape):
    """What is cut out of words of 64 cells and added up is what the same weights tell of a window
    that NumPy turns.
    """
    stored, span = np.load(learned_weights.WEIGHTS), learned_prior.SPAN
    for seed in range(3):
        layout, planner, field, _, _, _ = scene_of(shape, seed)
        known, opened = (cells_of(layout, board).mask for board in (field.known, field.open))
        inner = np.pad(np.ones(shape, dtype=bool), 1)
        states = np.where(known | ~inner, np.where(opened, 1, 2), 0)
        states = np.pad(states, learned_prior.RADIUS, constant_values=2)
        for row, column in np.argwhere(cells_of(layout, field.frontier).mask)[:20]:
            for command, turns in enumerate(learned_weights.TURNS):
                window = np.rot90(states[row : row + span, column : column + span], turns).ravel()
                seen = np.concatenate([window == 1, window == 2])
                hidden = np.maximum(seen @ stored["first"].astype(int) + stored["first_bias"], 0)
                hidden = (
                    np.maximum(stored["second"].astype(int) @ hidden + stored["second_bias"], 0)
                    >> learned_prior.SHIFT
                )
                odds = (
                    learned_prior.ODDS * int(stored["last"] @ hidden + stored["last_bias"][0])
                ) >> (2 * learned_prior.SHIFT)
                odds = int(np.clip(odds + learned_prior.ODDS * learned_prior.MOST_ODDS, 0, 255))
                cell = np.int64(64 * layout.words[1] * row + column)
                for bias in (0.0, 0.49, -20.6):  # from the second time on, the window is remembered
                    planner.learned.bias[0] = bias
                    likely = stored["chances"][np.clip(odds + round(bias), 0, 255)] / 65536
                    assert (
                        learned_prior.learned_chance(
                            planner.learned, field.open, field.known, cell, np.int64(command)
                        )
                        == likely
                    )


def test_sums_of_the_network_fit_their_types():
    """Whatever a window shows, the first layer fits 16 bits, and the second layer fits 32 bits."""
    stored = np.load(learned_weights.WEIGHTS)
    first = stored["first"].astype(int).reshape(learned_prior.KINDS, learned_prior.SPAN**2, -1)
    high = stored["first_bias"] + np.maximum(first.max(axis=0), 0).sum(axis=0)
    low = stored["first_bias"] + np.minimum(first.min(axis=0), 0).sum(axis=0)
    assert low.min() >= -(2**15)
    assert high.max() < 2**15
    assert (
        abs(stored["second_bias"]) + abs(stored["second"].astype(int)) @ np.maximum(high, 0)
    ).max() < 2**31


@pytest.mark.parametrize("end", [False, True])
def test_a_plan_is_completed_and_valued(end):
    """The moves of a completed plan, one after the other, classify what `complete` counts; the rest
    is the greedy base policy's.
    """
    finished = set()
    for seed in range(8):
        _, planner, _, _, _, _ = scene_of((24, 31), seed, moves=2)
        for first in range(4):
            planner.state[:], planner.trial[0] = planner.root, first
            horizon, discount = 90, 0.99
            time, value, length, moves, total = plan_search.complete(
                planner,
                np.int64(1),
                horizon,
                discount,
                3.0 if end else 0.0,
                1e6 if end else 0.0,
                plan_search.NOTHING,
            )
            state, classified, last, expected = planner.root.copy(), [], 0, 0.0
            plan = planner.trial[:length].copy()
            for move, command in enumerate(plan):
                forward_model.immediate_gains(planner.scene, state, planner.gains)
                # no path is being followed
                if move > 0 and planner.gains.max() > 0 and classified[-1] > 0:
                    assert planner.gains[command] == planner.gains.max()
                classified.append(forward_model.advance(planner.scene, state, np.int64(command)))
                if classified[-1]:
                    expected, last = expected + discount**move * classified[-1], move + 1
            assert value == pytest.approx(expected)
            assert (moves, total) == (length, sum(classified))
            assert time == horizon or (time == last and not state[forward_model.FRONTIER].any())
            finished.add(time < horizon)
            assert (state == planner.state).all()
    assert True in finished


def test_a_plan_that_cannot_become_better_is_dropped():
    """If about 50 cells are left, and each is worth 3 moves, no plan is worth more than 149 after
    its first move.
    """
    shorter = 0
    for seed in range(6):
        _, planner, _, _, _, _ = scene_of((24, 31), seed, moves=2)
        planner.state[:] = planner.root
        reached = plan_search.complete(
            planner, np.int64(0), 90, 0.99, 3.0, 50.0, plan_search.NOTHING
        )[3]
        planner.state[:] = planner.root
        time, value, _, moves, total = plan_search.complete(
            planner, np.int64(0), 90, 0.99, 3.0, 50.0, 149.0
        )
        assert moves <= reached
        if moves < reached:
            assert time == 90
            assert 3.0 * (value + 0.99**moves * max(50 - total, 0)) - moves <= 149.0
            shorter += 1
    assert shorter > 0


def variations_of(plan, directions):
    """Yield all plans that one change makes of a plan."""
    for at in range(len(plan)):
        for command in range(directions):
            yield (*plan[:at], command)
        for many in (1, 2, 4, 8):
            yield (*plan[:at], *plan[at + many :])
            for command in range(directions):
                yield (*plan[:at], *[command] * many)
                yield (*plan[:at], *[command] * many, *plan[at:])


@pytest.mark.parametrize("shape", [(7, 6), (3, 4, 5)])
def test_variations_of_a_plan(shape):
    _, planner, _, _, _, rng = scene_of(shape, 1)
    plan = tuple(rng.integers(0, 2 * len(shape), 13).tolist())
    planner.incumbent[: len(plan)] = plan
    planner.memory.plan_length = len(plan)
    varied = {tuple(planner.trial[: plan_search.vary(planner)].tolist()) for _ in range(2000)}
    assert varied <= set(variations_of(plan, 2 * len(shape)))
    assert len(varied) > 300
    assert tuple(planner.incumbent[: len(plan)].tolist()) == plan
