"""The task gathering: what it asks for, how its policies gather, its bounds and its optima."""

import json
from functools import cache

import numpy as np
import pytest
from tests.reference import gathering as reference
from tests.reference.small import small_cases

import shoal
from shoal.cli import run as run_command
from shoal.core.errors import InvalidInputError
from shoal.swarm import GridWorkspace, SwarmProblem
from shoal.swarm.grid.board import Board, letters_of
from shoal.swarm.grid.pairs import pair_grid
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.kernels import gathering as kernels
from shoal.swarm.run import run
from shoal.swarm.theory.bounds import lower_bound, optimum

RULES = ("block", "merge", "tilt")
POLICIES = (
    "pairwise",
    "pairwise:path=static",
    "pairwise:pair=farthest",
    "gather-beam",
    "gather-beam:width=1",
)


def region_of(workspace, n, rule, seed):
    """Return a random region that has room for n particles, or sometimes None under merge."""
    rng = np.random.default_rng(seed)
    if rule == "merge" and seed % 2:
        return None
    least = 1 if rule == "merge" else n
    size = int(rng.integers(least, workspace.n_free + 1))
    return [tuple(cell) for cell in rng.permutation(workspace.cells)[:size].tolist()]


def mask_of(workspace, region):
    """Return a region as a mask."""
    if region is None:
        return None
    mask = np.zeros(workspace.shape, dtype=bool)
    mask[tuple(np.array(region).T)] = True
    return mask


@pytest.mark.parametrize("rule", RULES)
def test_kernels_move_swarms_by_the_rules(rule):
    rng = np.random.default_rng(3)
    for workspace, _ in small_cases(40, 7):
        n = int(rng.integers(1, workspace.n_free + 1))
        cells = [tuple(cell) for cell in rng.permutation(workspace.cells)[:n].tolist()]
        world = GridWorld(workspace, rule)
        grid = pair_grid(world.free, None, "merge", 1, pairs=False)
        swarm = grid.swarm(world.initial(cells).occupied)
        for code, letter in enumerate(letters_of(2)):
            there, mark = swarm.copy(), np.full(grid.cells.size, -1)
            count = kernels.move_swarm(
                grid.ahead, RULES.index(rule), code, there, n, mark, np.int64(code)
            )
            expected = np.zeros(workspace.shape, dtype=bool)
            expected[tuple(np.array(reference.moved(workspace.free, cells, letter, rule)).T)] = True
            assert sorted(grid.cells[there[:count]]) == np.flatnonzero(np.pad(expected, 1)).tolist()


@pytest.mark.parametrize("rule", RULES)
def test_bounds_and_optima_are_right_on_small_maps(rule):
    solved = exact = 0
    for seed, (workspace, start) in enumerate(small_cases(80, 44)):
        region = region_of(workspace, len(start), rule, seed)
        fewest = reference.fewest_moves(workspace.free, start, region, rule)
        about = {"task": "gathering", "targets": mask_of(workspace, region), "rule": rule}
        if fewest is None:
            with pytest.raises(InvalidInputError, match="particles can complete"):
                optimum(workspace, start, **about)
            continue
        best = optimum(workspace, start, **about)
        bound = lower_bound(workspace, start, **about)
        assert best.moves == fewest == len(best.commands)
        assert bound.moves <= fewest
        problem = SwarmProblem(
            workspace,
            task="gathering",
            region=region,
            start=start.tolist(),
            rule=rule,
            policy=f"manual:{best.commands}" if best.commands else "gather-beam",
        )
        assert run(problem).status == "complete"
        solved, exact = solved + 1, exact + (bound.moves == fewest)
    assert solved >= 50
    assert exact >= solved // 2


place_of = cache(shoal.open_map)


@cache
def bound_of(workspace, start, region):
    """Return the lower bound, which is that of all policies."""
    mask = mask_of(workspace, region)
    return lower_bound(workspace, np.array(start), task="gathering", targets=mask, rule="merge")


@pytest.mark.parametrize("policy", POLICIES)
def test_policies_gather_all_particles_under_merge(policy):
    for seed, name in enumerate(("vessels:200", "maze:15x11", "rectangle:8x9")):
        workspace = place_of(name)
        middle = tuple(workspace.cells[len(workspace.cells) // 3].tolist())
        region = [middle] if seed else None
        problem = SwarmProblem(
            name, task="gathering", region=region, rule="merge", particles=15, policy=policy
        )
        episode = run(problem, seed=seed)
        assert episode.status == "complete"
        assert episode.verify()
        final = {tuple(cell) for cell in episode.final()[0].cells.tolist()}
        assert final == set(region) if region else len(final) == 1
        start = tuple(map(tuple, episode.start.tolist()))
        bound = bound_of(workspace, start, tuple(region) if region else None)
        assert bound.moves <= episode.moves


def test_pairs_meet_within_the_proven_number_of_moves():
    """Two particles whose shortest path is d long meet within L d (d + 1) / 2 moves."""
    for seed, (workspace, _) in enumerate(small_cases(60, 12)):
        if workspace.n_free < 2:
            continue
        rng = np.random.default_rng(seed)
        start = rng.permutation(workspace.cells)[:2].tolist()
        for path in ("dynamic", "static"):
            problem = SwarmProblem(
                workspace, task="gathering", start=start, policy=f"pairwise:path={path}"
            )
            episode = run(problem)
            grid = pair_grid(GridWorld(workspace).free, None, "merge", 1, pairs=False)
            steps, queue = np.zeros(workspace.n_free, int), np.zeros(workspace.n_free, int)
            ends = grid.swarm(GridWorld(workspace).initial(start).occupied)
            kernels.measure_paths_from(grid.ahead, ends[0], -1, steps, queue)
            d, side = int(steps[ends[1]]), max(workspace.shape)
            assert episode.status == "complete"
            assert d > 0
            assert episode.moves <= side * d * (d + 1) // 2


def test_the_beam_is_near_the_optimum():
    moves = fewest = 0
    for seed, (workspace, start) in enumerate(small_cases(60, 5)):
        region = region_of(workspace, len(start), "merge", seed)
        problem = SwarmProblem(
            workspace, task="gathering", region=region, start=start.tolist(), rule="merge"
        )
        episode = run(problem)
        assert episode.status == "complete"
        moves += episode.moves
        about = {"task": "gathering", "targets": mask_of(workspace, region), "rule": "merge"}
        fewest += optimum(workspace, start, **about).moves
    assert fewest <= moves <= 1.02 * fewest


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("policy", ["gather-beam:width=4", "random-moves"])
def test_stepwise_episodes_are_the_same(rule, policy):
    for seed in range(3):
        workspace = GridWorkspace(np.random.default_rng(seed).random((5, 6)) < 0.85)
        workspace = workspace.largest_component()
        problem = SwarmProblem(
            workspace,
            task="gathering",
            region=workspace.cells[:9].tolist(),
            rule=rule,
            particles=6,
            policy=policy,
            max_moves=300,
        )
        whole, stepwise = run(problem, seed=seed), run(problem, seed=seed, stepwise=True)
        assert whole.commands == stepwise.commands
        assert whole.status == stepwise.status
        for one, other in zip(whole.trace, stepwise.trace, strict=True):
            assert np.array_equal(one, other)
        assert whole.verify()


def test_particles_enter_a_region_under_block():
    corner = [(row, column) for row in range(5) for column in range(6)]
    problem = SwarmProblem(
        "rectangle:10x12", task="gathering", region=corner, rule="block", particles=20
    )
    episode = run(problem, seed=1)
    assert episode.status == "complete"
    assert {tuple(cell) for cell in episode.final()[0].cells.tolist()} <= set(corner)


def test_the_table_of_pairs_is_right():
    """Under merge, the table has the optimum of each pair of particles."""
    for seed, (workspace, _) in enumerate(small_cases(6, 31)):
        region = region_of(workspace, 2, "merge", seed)
        layout = GridWorld(workspace).layout
        board = None if region is None else Board.of_cells(layout, region)
        grid = pair_grid(GridWorld(workspace).free, board, "merge", 1, pairs=True)
        table = grid.fewest.reshape(workspace.n_free, workspace.n_free)
        for one, here in enumerate(workspace.cells.tolist()):
            for other, there in enumerate(workspace.cells.tolist()):
                fewest = reference.fewest_moves(workspace.free, [here, there], region, "merge")
                assert table[one, other] == (-1 if fewest is None else fewest)


def test_maps_without_a_table_of_pairs_are_gathered_too():
    problem = SwarmProblem("vessels:6100", task="gathering", particles=20)
    assert problem.setup.policy.name == "pairwise"
    for policy in ("auto", "gather-beam:width=4"):
        assert run(problem.replaced(policy=policy), seed=2).status == "complete"
    block = problem.replaced(rule="block", region=problem.place.cells[:3000].tolist())
    assert block.setup.policy.name == "gather-beam"
    assert run(block, seed=2).status == "complete"


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        (
            {"rule": "block"},
            "region: expected a region of at least 4 cells, the number of particles",
        ),
        ({"region": [(0, 0)], "rule": "block"}, "region: expected at least 4 of its cells"),
        ({"region": [(1, 1)]}, "region: expected free cells of"),
        ({"region": [(9, 9)]}, "region: expected cells inside"),
        ({"policy": "closest-frontier"}, "policy closest-frontier: expected a task other than"),
        ({"policy": "offline"}, "policy offline: expected a task other than gathering"),
        (
            {"region": [(0, 0)], "policy": "pairwise", "rule": "block"},
            "policy pairwise: expected rule merge, got block",
        ),
        ({"policy": "pairwise:pair=nearest"}, "pair: expected one of closest, farthest"),
        ({"policy": "gather-beam:width=0"}, "width: expected"),
        ({"task": "coverage", "region": [(0, 0)]}, "region: expected the task gathering together"),
        (
            {"task": "coverage", "policy": "pairwise"},
            "policy pairwise: expected the task gathering",
        ),
        ({"slip": 0.1}, "noise: expected"),
    ],
)
def test_bad_input_is_refused(fields, text):
    with pytest.raises(InvalidInputError, match=text):
        run(SwarmProblem([[1, 1, 1], [1, 0, 1]], **{"task": "gathering", "particles": 4, **fields}))


def test_particles_in_parts_of_the_map():
    parts = [[1, 1, 0, 1, 1]]
    apart = {"task": "gathering", "start": [(0, 0), (0, 3)]}
    with pytest.raises(InvalidInputError, match="all particles in one connected part of"):
        run(SwarmProblem(parts, **apart))
    # each part has a cell of the region, and commands that bring one particle there move the other
    assert run(SwarmProblem(parts, region=[(0, 1), (0, 4)], rule="merge", **apart)).moves == 1
    never = SwarmProblem(parts, region=[(0, 1), (0, 3)], rule="merge", **apart)
    assert run(never).status == "stalled"
    mask = mask_of(never.place, [(0, 1), (0, 3)])
    with pytest.raises(InvalidInputError, match="got two that no commands bring together"):
        lower_bound(never.place, [(0, 0), (0, 3)], task="gathering", targets=mask, rule="merge")
    with pytest.raises(InvalidInputError, match="flow: expected the task mapping or coverage"):
        lower_bound(never.place, [(0, 0)], task="gathering", rule="merge", flow=True)


def test_the_command_gathers(capsys, tmp_path):
    arguments = ["gather", "vessels:100", "-n", "8", "--seed", "3", "--out", str(tmp_path)]
    assert run_command([*arguments, "--film", str(tmp_path / "film.html"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["task"], result["rule"]) == ("gathering", "merge")
    assert result["status"] == ["complete"]
    episode = shoal.load(tmp_path / "episode.npz")
    assert episode.verify()
    assert episode.reason == "all particles are gathered"
    assert run_command(["replay", str(tmp_path / "episode.npz")]) == 0
    assert "8 particles in 1 cell" in capsys.readouterr().out
    region = tmp_path / "region.txt"
    region.write_text("##...\n##...\n#####\n")
    here = tmp_path / "map.txt"
    here.write_text(".....\n.###.\n.....\n")
    gathers = ["gather", str(here), "-n", "6", "--rule", "block", "--region", str(region)]
    assert run_command(gathers) == 2
    assert "region: expected free cells" in capsys.readouterr().err
    region.write_text("..###\n.####\n...##\n")
    assert run_command(gathers) == 0
    assert "6 of 6 particles, in a region of 6 cells" in capsys.readouterr().out


def test_the_environment_pays_for_cells_that_are_gathered():
    envs = pytest.importorskip("shoal.envs")
    env = envs.SwarmEnv(task="gathering", map="vessels:60", particles=5, max_moves=500)
    first = env.reset(seed=4)[1]
    episode = run(
        SwarmProblem("vessels:60", task="gathering", particles=5, policy="gather-beam"), seed=4
    )
    ended = False
    for command in episode.trace.commands.tolist():
        assert not ended
        _, _, ended, _, info = env.step(command)
    assert ended
    assert info["frontier"] == 0
    assert info["moves"] == episode.moves
    options = {"classified_reward": 0.0, "move_price": 0.0, "final_bonus": 0.0}
    paid = envs.SwarmEnv(
        task="gathering",
        map="vessels:60",
        particles=5,
        **(options | {"classified_reward": 1.0}),
    )
    paid.reset(seed=4)
    assert sum(paid.step(one)[1] for one in episode.trace.commands.tolist()) == first["frontier"]


def test_the_studio_and_sweeps_run_gatherings(tmp_path):
    from shoal.studio.work import play_live

    told = []
    problem = SwarmProblem("vessels:60", task="gathering", particles=5)
    episode = play_live(problem, 2, lambda kind, what: told.append((kind, what)))
    assert episode.status == "complete"
    shares = [what[0] for kind, what in told if kind == "progress"]
    assert shares == sorted(shares)
    assert shares[-1] == 0.99
    file = tmp_path / "sweep.toml"
    file.write_text(
        'name = "gathering"\ntrials = 2\n[problem]\nkind = "swarm"\nmap = "vessels:60"\n'
        'task = "gathering"\nparticles = 5\n[axes]\npolicy = ["pairwise", "gather-beam"]\n'
    )
    store = tmp_path / "store.sqlite"
    assert run_command(["sweep", "run", str(file), "--store", str(store), "--workers", "0"]) == 0
