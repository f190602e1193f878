"""The reference against cases worked by hand, closed forms, and its own set-based sister module."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference import plain, reach

DIMENSIONS = [(1, 6), (4, 5), (2, 3, 4)]


class FixedDraws:
    """Stands in for a generator: gives out draws chosen by the test."""

    def __init__(self, *draws: int) -> None:
        self.draws = list(draws)

    def integers(self, low: int, high: int) -> int:
        draw = self.draws.pop(0)
        assert low <= draw < high
        return draw


def line(m: int) -> np.ndarray:
    return np.ones((1, m), bool)


def on_line(*cols: int) -> list[tuple[int, int]]:
    return [(0, col) for col in cols]


def counts_after(free: np.ndarray, start: list, commands: str, rule: str = "block") -> list:
    return plain.simulate(free, start, commands, rule=rule)["counts"].tolist()


def random_case(rng: np.random.Generator, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return a random map and random distinct start cells."""
    free = rng.random(shape) < 0.75
    free[(0,) * len(shape)] = True
    cells = np.argwhere(free)
    return free, cells[rng.choice(len(cells), rng.integers(1, len(cells) + 1), replace=False)]


def random_commands(rng: np.random.Generator, ndim: int, length: int) -> str:
    return "".join(rng.choice(list(plain.LETTERS[: 2 * ndim]), length))


def frontier_from_scratch(state: np.ndarray) -> np.ndarray:
    """Return the frontier by its definition: unknown cells next to a known-free one."""
    frontier = np.zeros(state.shape, bool)
    for cell in np.argwhere(state == plain.FREE):
        for step in reach.STEPS_2D if len(state) == 1 else reach.STEPS_3D:
            there = tuple(cell + ((0, *step) if len(step) == 2 else step))
            frontier[there] = state[there] == plain.UNKNOWN
    return frontier


# ---- block


def test_train_moves_together() -> None:
    result = plain.simulate(line(6), on_line(1, 2, 3), "r")
    assert result["counts"].tolist() == [[0, 0, 1, 1, 1, 0]]
    assert result["travelled"].tolist() == [3]
    assert result["classified"].tolist() == [1]  # only the head of the train enters an unknown cell


def test_queue_against_a_wall_stays_and_the_gap_closes() -> None:
    result = plain.simulate(line(6), on_line(0, 1, 3), "lll")
    assert result["counts"].tolist() == [[1, 1, 1, 0, 0, 0]]
    assert result["travelled"].tolist() == [1, 0, 0]
    assert result["classified"].tolist() == [2, 0, 0]  # the wall and cell 2
    # Around the start cells 0, 1, 3: ten unknown cells. Cell 2 brings in those above and below it.
    assert result["frontier"].tolist() == [9, 9, 9]


@pytest.mark.parametrize("command", "lurdio")
def test_every_direction(command: str) -> None:
    step = dict(zip("lurdio", reach.STEPS_3D, strict=True))[command]
    ahead = tuple(1 + part for part in step)
    centre, tail = (1, 1, 1), tuple(1 - part for part in step)
    counts = plain.simulate(np.ones((3, 3, 3), bool), [centre, tail], command)["counts"]
    assert sorted(map(tuple, np.argwhere(counts).tolist())) == sorted([centre, ahead])


def test_obstacle_holds_back_one_row_only() -> None:
    free = np.array([[1, 1, 1], [1, 1, 0], [1, 1, 1]], bool)
    assert counts_after(free, [(0, 1), (1, 0), (1, 1), (2, 0)], "r") == [
        [0, 0, 1],
        [1, 1, 0],
        [0, 1, 0],
    ]


# ---- merge, tilt


def test_merge() -> None:
    result = plain.simulate(line(3), on_line(0, 1, 2), "llr", rule="merge")
    assert result["counts"].tolist() == [[0, 3, 0]]
    assert result["travelled"].tolist() == [2, 1, 3]
    assert counts_after(line(3), on_line(0, 1, 2), "l", "merge") == [[2, 1, 0]]
    assert counts_after(line(3), on_line(2, 2), "l", "merge") == [[0, 2, 0]]


def test_tilt_slides_and_learns_on_the_way() -> None:
    result = plain.simulate(line(5), on_line(2), "lr", rule="tilt")
    assert result["counts"].tolist() == [[0, 0, 0, 0, 1]]
    assert result["travelled"].tolist() == [2, 4]
    assert result["classified"].tolist() == [3, 3]  # two cells and a wall each way
    pair = plain.simulate(line(5), on_line(1, 3), "r", rule="tilt")
    assert pair["counts"].tolist() == [[0, 0, 0, 1, 1]]
    assert (pair["travelled"].tolist(), pair["classified"].tolist()) == ([3], [3])


def test_idle_tilt_learns_the_wall() -> None:
    assert plain.simulate(line(5), on_line(0), "l", rule="tilt")["classified"].tolist() == [1]


def test_tilt_covers_what_it_passes() -> None:
    result = plain.run(line(5), on_line(2), rule="tilt", task="coverage")
    assert (result["commands"], result["status"]) == ("lr", "complete")
    assert result["classified"].tolist() == [2, 2]


def test_tilt_search_turns_at_stop_cells() -> None:
    free = np.array([[1, 1, 1], [0, 0, 1], [0, 0, 1]], bool)
    result = plain.run(free, [(0, 0)], rule="tilt", task="coverage", targets=[(1, 2)])
    assert result["commands"] == "rd"
    assert result["counts"].tolist() == [[0, 0, 0], [0, 0, 0], [0, 0, 1]]


def test_tilt_may_stall_where_single_steps_do_not() -> None:
    free = np.ones((3, 3), bool)
    by_tilt = plain.run(free, [(0, 0)], rule="tilt", task="coverage", targets=[(1, 1)])
    by_step = plain.run(free, [(0, 0)], task="coverage", targets=[(1, 1)])
    assert (by_tilt["status"], by_tilt["commands"]) == ("stalled", "")
    assert (by_step["status"], by_step["commands"]) == ("complete", "dr")


# ---- all rules against the set-based definitions


@pytest.mark.parametrize("shape", DIMENSIONS)
@pytest.mark.parametrize("rule", plain.RULES)
@pytest.mark.parametrize("seed", range(8))
def test_positions_agree_with_sets(shape: tuple[int, ...], rule: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    free, start = random_case(rng, shape)
    steps = reach.STEPS_2D if len(shape) == 2 else reach.STEPS_3D
    commands = random_commands(rng, len(shape), 12)
    where = tuple(sorted(map(tuple, start.tolist())))
    for command in commands:
        where = reach.RULES[rule](
            reach.free_cells(free), where, steps[plain.LETTERS.index(command)]
        )
    result = plain.simulate(free, start, commands, rule=rule)
    expected = plain.count_cells(where, shape)
    np.testing.assert_array_equal(result["counts"], expected)


@pytest.mark.parametrize("shape", DIMENSIONS)
@pytest.mark.parametrize("rule", plain.RULES)
@pytest.mark.parametrize("seed", range(8))
def test_belief_is_true_and_counts_add_up(shape: tuple[int, ...], rule: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    free, start = random_case(rng, shape)
    result = plain.simulate(free, start, random_commands(rng, len(shape), 30), rule=rule)
    state, truth = result["state"], plain.pad(free)
    assert np.all(truth[state == plain.FREE])
    assert not np.any(truth[state == plain.OBSTACLE])
    assert np.count_nonzero(state) == len(start) + result["classified"].sum()
    np.testing.assert_array_equal(result["frontier_cells"], frontier_from_scratch(state))
    assert result["frontier"][-1] == result["frontier_cells"].sum()


# ---- closest-frontier


def test_lone_cell_needs_each_command_once() -> None:
    result = plain.run(line(1), on_line(0))
    assert (result["commands"], result["status"]) == ("lurd", "complete")
    assert result["frontier"].tolist() == [3, 2, 1, 0]
    assert plain.run(np.ones((1, 1, 1), bool), [(0, 0, 0)])["commands"] == "lurdio"


def test_line_of_three_by_hand() -> None:
    # l to cell 0; wall; above and below 0; then back to cell 1, whose lower and upper neighbours
    # are unknown.
    assert plain.run(line(3), on_line(1))["commands"] == "llud" + "ru" + "r" + "urd" + "ld"


@pytest.mark.parametrize(("shape", "moves"), [((1, 30), 4), ((5, 6), 4), ((3, 4, 5), 6)])
def test_full_map_needs_one_move_a_direction(shape: tuple[int, ...], moves: int) -> None:
    free = np.ones(shape, bool)
    assert len(plain.run(free, np.argwhere(free))["commands"]) == moves
    covering = plain.run(free, np.argwhere(free), task="coverage")
    assert (covering["commands"], covering["status"]) == ("", "complete")


def test_tie_rules() -> None:
    free, start, targets = np.ones((3, 4), bool), [(0, 2), (2, 0)], [(0, 3), (1, 0)]
    by_column = plain.run(free, start, task="coverage", targets=targets)
    by_row = plain.run(free, start, task="coverage", targets=targets, ties="row-major")
    assert by_column["commands"][0] == "u"
    assert by_row["commands"][0] == "r"


def test_each_level_is_sorted_before_it_is_expanded() -> None:
    # From (1, 1) the cells at distance 1 are found in the order l, u, r, d. The target (2, 0) is
    # next to (1, 0) and (2, 1): the leftmost of them comes first. The target (0, 2) is next to (0,
    # 1) and (1, 2).
    free = np.ones((3, 3), bool)
    for target, by_column, by_row in [
        ((2, 0), "ld", "ld"),
        ((0, 2), "ur", "ur"),
        ((2, 2), "dr", "rd"),
    ]:
        for ties, expected in [("column-major", by_column), ("row-major", by_row)]:
            result = plain.run(free, [(1, 1)], task="coverage", targets=[target], ties=ties)
            assert result["commands"] == expected


@pytest.mark.parametrize("shape", DIMENSIONS)
@pytest.mark.parametrize("rule", ["block", "merge"])
@pytest.mark.parametrize("seed", range(5))
def test_mapping_ends_and_can_be_replayed(shape: tuple[int, ...], rule: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    free, start = random_case(rng, shape)
    for policy in ("closest-frontier", "elect-particle", "random-moves", "depth-first"):
        result = plain.run(free, start, policy=policy, rule=rule, rng=rng)
        # Those that follow one particle never see to another connected part of the free space.
        follows_one = policy in ("elect-particle", "depth-first")
        assert result["status"] == "complete" or (follows_one and result["status"] == "stalled")
        assert (result["frontier_cells"].sum() == 0) == (result["status"] == "complete")
        replayed = plain.simulate(free, start, result["commands"], rule=rule)
        for name, value in replayed.items():
            np.testing.assert_array_equal(result[name], value)


@pytest.mark.parametrize("rule", ["block", "merge"])
@pytest.mark.parametrize("seed", range(10))
def test_a_closest_frontier_path_classifies_its_target(rule: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    free, start = random_case(rng, (5, 6))
    world = plain.make_world(free, start)
    while world.frontier.any():
        sources = plain.occupied_cells(world.counts, plain.COLUMN_MAJOR)
        path, _ = plain.find_path(sources, world.state, world.frontier, False, plain.COLUMN_MAJOR)
        distance, targets = nearest_frontier(world)
        assert len(path) == distance
        plain.replay(*world, path, plain.RULES.index(rule), plain.MAPPING)
        assert not all(world.frontier[target] for target in targets)


def nearest_frontier(world: plain.World) -> tuple[int, set]:
    """Return the distance of the nearest frontier cells from all particles, and those cells, by
    sets.
    """
    seen = {tuple(cell) for cell in np.argwhere(world.counts).tolist()}
    ring, distance = set(seen), 1
    while True:
        around = {reach.add(cell, (0, *step)) for cell in ring for step in reach.STEPS_2D}
        targets = {cell for cell in around if world.frontier[cell]}
        if targets:
            return distance, targets
        ring = {cell for cell in around if world.state[cell] == plain.FREE} - seen
        seen |= ring
        distance += 1


def test_coverage_out_of_reach_stalls() -> None:
    free = np.array([[1, 1, 0, 1]], bool)
    result = plain.run(free, on_line(0), task="coverage")
    assert (result["status"], result["commands"]) == ("stalled", "r")
    assert result["frontier"].tolist() == [1]


def test_limit_stops_in_the_middle_of_a_path() -> None:
    result = plain.run(line(9), on_line(0), task="coverage", targets=on_line(8), max_moves=3)
    assert (result["status"], result["commands"]) == ("limit", "rrr")
    assert plain.run(line(9), on_line(0), max_moves=0)["status"] == "limit"
    assert plain.run(line(9), on_line(8), task="coverage", targets=on_line(8), max_moves=0)[
        "status"
    ] == ("complete")


def test_log_grows() -> None:
    assert len(plain.run(line(40), on_line(0))["commands"]) > 100


# ---- the other policies


def test_elected_particle_hands_over_when_blocked() -> None:
    # E at (0, 0) and P at (0, 1), a wall right of P, the target below P. E's path is r d. P blocks
    # E, takes over, and d brings P to the target.
    free = np.array([[1, 1], [0, 1]], bool)
    start, targets = [(0, 0), (0, 1)], [(1, 1)]
    for draw, commands in [(0, "rd"), (1, "d")]:
        result = plain.run(
            free,
            start,
            policy="elect-particle",
            task="coverage",
            targets=targets,
            rng=FixedDraws(draw),
        )
        assert result["commands"] == commands


def test_elected_particle_replans_when_another_covers_its_target() -> None:
    # E at 0 goes for 5, but F, who starts at 3, covers it after two moves. E, by then at the head
    # of a side corridor, turns into it: its end, at distance 6 before, is the only target left.
    free = np.zeros((5, 8), bool)
    free[0, :] = free[:, 2] = True
    result = plain.run(
        free,
        on_line(0, 3),
        policy="elect-particle",
        task="coverage",
        targets=[(0, 5), (4, 2)],
        rng=FixedDraws(0),
    )
    assert result["commands"] == "rrdddd"
    assert result["classified"].tolist() == [0, 1, 0, 0, 0, 1]


def test_lone_elected_particle_is_closest_frontier() -> None:
    free = np.random.default_rng(3).random((6, 6)) < 0.8
    start = np.argwhere(free)[7:8]
    elect = plain.run(free, start, policy="elect-particle", rng=FixedDraws(0))
    assert elect["commands"] == plain.run(free, start)["commands"]


def test_random_moves_follow_the_draws() -> None:
    result = plain.run(
        line(2), on_line(0), policy="random-moves", rng=FixedDraws(2, 0, 3), max_moves=3
    )
    assert (result["commands"], result["status"]) == ("rld", "limit")


def test_depth_first_by_hand() -> None:
    result = plain.run(line(3), on_line(1), policy="depth-first")
    assert (result["commands"], result["status"]) == (
        "l" + "lud" + "r" + "u" + "r" + "urd" + "l" + "d",
        "complete",
    )
    covering = plain.run(line(3), on_line(1), policy="depth-first", task="coverage")
    assert covering["commands"] == "lrr"


def test_depth_first_stalls_at_the_root() -> None:
    free = np.array([[1, 1, 0, 1]], bool)
    result = plain.run(free, on_line(0, 3), policy="depth-first", task="coverage")
    assert (result["commands"], result["status"]) == ("r", "complete")
    lone = plain.run(free, on_line(0), policy="depth-first", task="coverage")
    assert (lone["commands"], lone["status"]) == ("rl", "stalled")


@pytest.mark.parametrize("seed", range(5))
def test_lone_depth_first_maps_within_its_bound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    free, start = random_case(rng, (5, 6))
    result = plain.run(free, start[:1], policy="depth-first")
    m = np.count_nonzero(result["state"] == plain.FREE)
    probes = np.count_nonzero(result["state"] == plain.OBSTACLE)
    assert result["status"] == "complete"
    assert len(result["commands"]) <= 2 * (m - 1) + probes


# ---- one dimension: the closed forms of section 5


def one_dimension(seed: int) -> tuple[int, np.ndarray, int, int]:
    """Return m, sorted positions from 1, and the right moves that touch the wall and that close the
    gaps.
    """
    rng = np.random.default_rng(seed)
    m = int(rng.integers(2, 25))
    n = int(rng.integers(1, m + 1))
    p = 1 + np.sort(rng.choice(m, n, replace=False))
    left = np.minimum(p[0], p - np.arange(1, n + 1))
    to_wall = int(m - (p[-1] - left[-1]) + 1)
    need = int(np.max(np.diff(p) - 1 - np.diff(left), initial=0))
    return m, p, to_wall, need


@pytest.mark.parametrize("seed", range(40))
def test_boundary_moves(seed: int) -> None:
    m, p, to_wall, _ = one_dimension(seed)
    commands = "l" * p[0] + "r" * to_wall
    clump = p[-1] - p[0] == len(p) - 1
    assert len(commands) == 2 * p[0] + m - p[-1] + 1 - clump
    for cut, known in [(len(commands), True), (len(commands) - 1, False)]:
        state = plain.simulate(line(m), on_line(*(p - 1)), commands[:cut])["state"]
        assert state[0, 1, 0] == plain.OBSTACLE
        assert (state[0, 1, m + 1] == plain.OBSTACLE) == known


@pytest.mark.parametrize("seed", range(40))
def test_full_coverage_of_a_line(seed: int) -> None:
    m, p, to_wall, need = one_dimension(seed)
    rights = max(to_wall - 1, need)  # one less than in the closed form: no need to touch the wall
    result = plain.simulate(line(m), on_line(*(p - 1)), "l" * p[0] + "r" * rights, task="coverage")
    left = [m - len(p), *result["frontier"].tolist()]
    assert left[-1] == 0
    if rights > 0 and (need >= to_wall or p[-1] < m):  # else cell m was covered from the start
        assert left[-2] > 0


# ---- reach


def test_reach_counts_by_hand() -> None:
    assert reach.reach_counts([[1, 1]], [(0, 0)], 3, "block") == [1, 2, 2, 2]
    # {0,2} -> {0,1}, {1,2}, {0,2}; then also {0,0} and {2,2}; then also {1,1}.
    assert reach.reach_counts([[1, 1, 1]], [(0, 0), (0, 2)], 3, "merge") == [1, 3, 5, 6]
    assert reach.reach_counts([[1, 1, 1]], [(0, 0), (0, 2)], 3, "block") == [1, 3, 3, 3]
    assert reach.reach_counts([[1, 1], [1, 1]], [(0, 0)], 2, "tilt") == [1, 3, 4]
    assert reach.reach_counts(np.ones((2, 2, 2), bool), [(0, 0, 0)], 3, "block") == [1, 4, 7, 8]


# ---- input


@pytest.mark.parametrize(
    ("start", "options"),
    [
        (on_line(1), {}),
        (on_line(-1), {}),
        (on_line(0, 0), {}),
        (on_line(0, 0), {"rule": "tilt"}),
        (on_line(0), {"targets": on_line(2)}),
        (on_line(0), {"task": "coverage", "targets": on_line(1)}),
        (on_line(0), {"policy": "random-moves"}),
        (on_line(0), {"policy": "depth-first", "rule": "tilt"}),
        (on_line(0), {"policy": "nonsense"}),
        ([], {"policy": "depth-first"}),
    ],
)
def test_wrong_input(start: list, options: dict) -> None:
    with pytest.raises(ValueError, match=r"."):
        plain.run(np.array([[1, 0, 1]], bool), start, **options)


def test_targets_as_cells_or_as_a_mask() -> None:
    mask = np.array([[0, 0, 0, 1]], bool)
    by_mask = plain.run(line(4), on_line(0), task="coverage", targets=mask)
    by_cells = plain.run(line(4), on_line(0), task="coverage", targets=on_line(3))
    assert by_mask["commands"] == by_cells["commands"] == "rrr"
