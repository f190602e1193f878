"""The adaptive scan rule in compiled kernels does what a slow and obvious one does: whole episodes,
and parts on random boards.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from tests.reference import plain
from tests.reference.scouting import (
    FREE,
    WALL,
    Prices,
    Tallies,
    View,
    best_length,
    cells_of,
    expected_gains,
    explore,
    learn_from_run,
    moved,
    scout,
    shifts,
    tried,
)
from tests.soak import often
from tests.swarm_runs import run

from shoal.swarm import GridWorkspace, GridWorld
from shoal.swarm.grid.board import Board
from shoal.swarm.grid.scans import ScanRule
from shoal.swarm.grid.state import Belief, field_of
from shoal.swarm.kernels import moves
from shoal.swarm.kernels.planning import adaptive_scans, prediction
from shoal.swarm.simulation.compiled import policy_state_of, scan_planner_of

RULES = ("block", "merge")
WIDTHS = (1, 2, 3, 8, 20, 61, 62, 63, 64, 65, 70)  # with the rim 62 just fills a word
PRICES = ((10, 1), (1, 1), (0, 1), (1, 0), (3, 7), (100, 1), (2.5, 0.3), (0.1, 0.7), (1000, 0.01))
PAIRS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # as the kernels number them


def random_case(rng, dimensions):
    """Return (free, start, prices) of a random map."""
    flat = (int(rng.integers(1, 9)), int(rng.choice(WIDTHS)))
    shape = (
        flat
        if dimensions == 2
        else (*rng.integers(1, 5, size=2), int(rng.choice([1, 2, 3, 5, 8, 63])))
    )
    free = rng.random(shape) < rng.choice([0.5, 0.7, 0.85, 0.95, 1.0])
    free.flat[rng.integers(free.size)] = True
    cells = np.argwhere(free)
    most = min(len(cells), 100 if rng.random() < 0.25 else 8)
    start = cells[
        np.sort(rng.choice(len(cells), size=int(rng.integers(1, most + 1)), replace=False))
    ]
    return free, start, PRICES[rng.integers(len(PRICES))]


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(("dimensions", "maps"), [(2, often(10, 45)), (3, often(5, 20))])
def test_episodes(dimensions, maps, rule):
    rng = np.random.default_rng(71 + dimensions)
    for _ in range(maps):
        free, start, (scan_cost, move_cost) = random_case(rng, dimensions)
        prices = {"scan_cost": scan_cost, "move_cost": move_cost}
        episode = run(
            GridWorkspace(free),
            start=start,
            rule=rule,
            scan_every="adaptive",
            max_moves=200,
            **prices,
        )
        commands, scanned, end = scout(free, start, rule=rule, max_moves=200, **prices)
        assert episode.commands == commands
        np.testing.assert_array_equal(episode.trace.scanned, scanned)
        assert episode.status == ("limit" if end.world.frontier.any() else "complete")


def test_particles_that_share_cells():
    rng = np.random.default_rng(74)
    for _ in range(15):
        free, start, _ = random_case(rng, 2)
        shared = start[rng.integers(len(start), size=2 * len(start))]
        episode = run(
            GridWorkspace(free), start=shared, rule="merge", scan_every="adaptive", max_moves=200
        )
        commands, scanned, _ = scout(
            free, shared, rule="merge", scan_cost=10, move_cost=1, max_moves=200
        )
        assert (episode.commands, episode.trace.scanned.tolist()) == (commands, scanned)


# ------------------------------------------------------------------------------------------ single
# kernels


class Scene:
    """The same random knowledge in both forms."""

    def __init__(self, rng, dimensions, rule):
        free, start, prices = random_case(rng, dimensions)
        self.rule, self.prices = rule, Prices(*map(float, prices))
        self.world = plain.make_world(free, start, rule=rule)
        reveal = (
            rng.random(self.world.state.shape) < rng.choice([0.2, 0.6, 0.9, 1.0])
        ) & ~on_corner(self.world.state.shape)
        self.world.state[reveal] = np.where(self.world.free, FREE, WALL)[reveal]
        self.view = View.of(self.world)
        world = GridWorld(GridWorkspace(free), rule)
        self.layout, state = world.layout, world.initial(start)
        belief = Belief(
            *(
                self.board(mask)
                for mask in (self.world.state == FREE, self.world.state > 0, self.world.frontier)
            )
        )
        self.field = field_of(world.free.words, state, belief)
        scanning = ScanRule("adaptive", scan_cost=prices[0], move_cost=prices[1])
        self.policy_state = policy_state_of(self.layout, free.size, belief, scanning=scanning)
        self.scout = scan_planner_of(self.layout, scanning)
        self.gain, self.lookahead = self.scout

    def board(self, mask):
        """Return the board of a padded array."""
        return Board(self.layout, self.layout.pack(mask.reshape(self.layout.window)))

    def cells(self, words):
        """Return the cells of a board of the kernels."""
        return cells_of(
            self.layout.unpack(words.reshape(self.layout.words)).reshape(self.view.shape)
        )


def on_corner(shape):
    """Return a mask of the cells on two rims at once, which nobody can try."""
    layer, row, column = np.indices(shape)
    rims = [
        (index == 0) | (index == size - 1)
        for index, size in zip((layer, row, column), shape, strict=True)
    ]
    return sum(rim.astype(int) for rim in (rims if shape[0] > 1 else rims[1:])) > 1


def scenes(seed, count=20):
    """Yield random scenes of all rules and dimensions, and the generator."""
    rng = np.random.default_rng(seed)
    for _, dimensions, rule in product(range(count), (2, 3), RULES):
        yield Scene(rng, dimensions, rule), rng


def keys():
    """Yield (key, number) of all surroundings."""
    for behind, (a, near), (b, sides) in product(range(3), enumerate(PAIRS), enumerate(PAIRS)):
        yield (behind, near, sides), 1 + prediction.COARSE + (behind * 6 + a) * 6 + b
    for behind, (a, near) in product(range(3), enumerate(PAIRS)):
        yield (behind, near), 1 + behind * 6 + a
    yield "all", 0


def random_tallies(rng, words):
    """Fill the tallies of a kernel at random; return the same ones as a dict."""
    tallies = Tallies()
    for key, number in keys():
        cells = int(rng.choice([0, 1, 5, 1000]))
        words[number] = cells, rng.integers(0, cells + 1)
        tallies.cells[key], tallies.free[key] = words[number].tolist()
    return tallies


def test_tried_and_shift():
    for scene, _ in scenes(81):
        view, field = scene.view, scene.field
        for command in view.directions:
            assert adaptive_scans.count_tried(field, field.occupied, command) == tried(
                view, view.particles, command
            )
            once = adaptive_scans.known_field(
                field, scene.lookahead.shifted, scene.lookahead.counts
            )
            once.occupied[:] = field.occupied
            expected = list(shifts(view, view.particles, command, scene.rule, 1))
            assert adaptive_scans.shift(
                field, once, command, moves.MERGE if scene.rule == "merge" else moves.BLOCK
            ) == bool(expected)
            assert scene.cells(once.occupied) == (expected[0] if expected else view.particles)


def test_a_certain_shift_is_what_the_world_does():
    for scene, _ in scenes(82):
        for command in scene.view.directions:
            if tried(scene.view, scene.view.particles, command) == 0:
                counts = scene.world.counts.copy()
                (plain.move_merge if scene.rule == "merge" else plain.move)(
                    counts, scene.world.free, command
                )
                assert moved(scene.view, scene.view.particles, command, scene.rule) == cells_of(
                    counts > 0
                )


def test_expected_gains_and_the_best_length():
    for scene, rng in scenes(83):
        tallies = random_tallies(rng, scene.gain.prior.tallies)
        for command in scene.view.directions:
            adaptive_scans.gains_of_runs(scene.field, scene.gain, command)
            gains = expected_gains(scene.view, tallies, command)
            assert scene.gain.gains[command].tolist() == gains
            for least in (1, 2, 5, len(gains) - 1, len(gains) + 3):
                assert adaptive_scans.best_length(scene.gain, command, least) == best_length(
                    gains, scene.prices, least
                )


def test_what_a_run_teaches():
    for scene, rng in scenes(84):
        command, code = (
            int(rng.choice(scene.view.directions)),
            moves.MERGE if scene.rule == "merge" else moves.BLOCK,
        )
        scene.gain.prior.before[:] = scene.field.known
        for _ in range(int(rng.integers(1, 9))):
            moves.push(scene.field, command, code)
            plain.step(*scene.world, command, code, plain.MAPPING)
        adaptive_scans.learn_from_run(scene.field, scene.gain, command)
        tallies = Tallies()
        learn_from_run(tallies, scene.view, View.of(scene.world), command)
        for key, number in keys():
            assert scene.gain.prior.tallies[number].tolist() == [
                tallies.cells[key],
                tallies.free[key],
            ]


def test_explore():
    found = 0
    for scene, rng in scenes(85, count=often(30, 50)):
        rate = float(rng.choice([0.0, 0.01, 0.05, 0.3]))
        plan, best = explore(scene.view, scene.rule, scene.prices, rate)
        code = moves.MERGE if scene.rule == "merge" else moves.BLOCK
        assert (
            adaptive_scans.explore(scene.field, code, scene.lookahead, scene.gain.prices, rate)
            == best
        )
        if plan:
            length = adaptive_scans.write_plan(scene.lookahead, scene.policy_state.search.plan)
            assert scene.policy_state.search.plan[:length].tolist() == plan
            found += 1
    assert found > often(10, 20)
