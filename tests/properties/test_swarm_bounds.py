"""Lower bounds of the swarm are not above the optimum, and both are those of plain searches."""

import numpy as np
import pytest
from tests.reference import bounds as reference
from tests.reference.small import connected_cases, small_cases
from tests.swarm_runs import run

from shoal.core.errors import InvalidInputError
from shoal.swarm import GridWorkspace
from shoal.swarm.theory import optimum as searches
from shoal.swarm.theory.bounds import lower_bound, optimum

RULES = ("block", "merge", "tilt")
KINDS = ("mapping", "coverage", "subset")


def case_of(kind, workspace, seed):
    """Return the task and the targets of a kind of task."""
    if kind != "subset":
        return {"task": kind}
    rng = np.random.default_rng(seed)
    return {"task": "coverage", "targets": workspace.free & (rng.random(workspace.shape) < 0.4)}


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("kind", KINDS)
def test_bounds_are_not_above_the_fewest_moves(kind, rule):
    tried = 0
    for seed, (workspace, start) in enumerate(small_cases(24, 44)):
        if workspace.n_free > (5 if kind == "mapping" else 9):
            continue
        case = case_of(kind, workspace, seed)
        fewest = reference.fewest_moves(workspace.free, start, rule=rule, **case)
        if fewest is None:
            with pytest.raises(InvalidInputError, match="particles can complete"):
                optimum(workspace, start, rule=rule, **case)
            continue
        tried += 1
        assert lower_bound(workspace, start, rule=rule, **case).moves <= fewest
        assert optimum(workspace, start, rule=rule, **case).moves == fewest
    assert tried >= 4


@pytest.mark.parametrize("rule", RULES)
def test_dual_prices_prune_no_optimum(monkeypatch, rule):
    """Searches that begin with dual prices at once find what plain searches find."""
    monkeypatch.setattr(searches, "EASY", 0)
    monkeypatch.setattr(searches, "DUALS", 6)
    calls = []
    duals = searches.dual_prices
    monkeypatch.setattr(searches, "dual_prices", lambda *about: calls.append(1) or duals(*about))
    for workspace, start in connected_cases(8, 5, 3):
        fewest = reference.fewest_moves(workspace.free, start, rule=rule, task="mapping")
        if fewest is not None:
            assert optimum(workspace, start, rule=rule, task="mapping").moves == fewest
    assert len(calls) >= 3


@pytest.mark.parametrize("rule", ["block", "merge"])
def test_mappings_of_twelve_cells_are_solved(rule):
    for workspace, start in connected_cases(1, 12, 49):
        best = optimum(workspace, start, rule=rule, task="mapping")
        policy = f"manual:{best.commands}"
        played = run(workspace, task="mapping", start=start, rule=rule, policy=policy)
        assert played.status == "complete"
        assert lower_bound(workspace, start, rule=rule, task="mapping").moves <= best.moves
        assert played.moves == best.moves == len(best.commands)


def test_prices_do_not_know_what_lies_behind_unexplored_places(monkeypatch):
    workspace = GridWorkspace([[1] * 5] * 5)
    monkeypatch.setattr(searches, "MOST_PLACES", 60)
    far = np.zeros((5, 5), dtype=bool)
    far[3, 2] = True
    assert optimum(workspace, [(0, 0), (4, 4)], targets=far).moves == 3
    with pytest.raises(InvalidInputError, match="at most 60 sets of cells with particles"):
        optimum(workspace, [(0, 0), (4, 4)])


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("kind", KINDS)
def test_bounds_are_those_of_plain_searches(kind, rule):
    for seed, (workspace, start) in enumerate(small_cases(6, 45)):
        case = case_of(kind, workspace, seed)
        bound = lower_bound(workspace, start, rule=rule, **case)
        plain = {"rule": rule, **case}
        assert bound.pairs == reference.fewest_for_pairs(workspace.free, start, **plain)
        assert bound.commands == reference.fewest_commands(workspace.free, start, **plain)


def test_shared_commands_raise_the_bound():
    """Two ends of a corridor need commands of both directions, whose numbers add up."""
    line = GridWorkspace([[1] * 9])
    bound = lower_bound(line, [(0, 3)])
    assert (bound.distance, bound.commands, bound.pairs) == (8, 8, 11)
    assert reference.fewest_moves(line.free, [(0, 3)], rule="block", task="coverage") == 11
    corner = GridWorkspace([[1, 1, 1, 1, 1], [1, 0, 0, 0, 0], [1, 0, 0, 0, 0], [1, 0, 0, 0, 0]])
    two = lower_bound(corner, [(0, 1), (1, 0)])
    assert two.name == "commands" or two.commands == two.moves
    assert two.moves > max(two.count, two.distance)


def test_the_command_bound_stops_early_and_stays_valid():
    from shoal.swarm.theory.bounds import flat_cells, flat_mask
    from shoal.swarm.theory.command_bounds import fewest_commands

    workspace = GridWorkspace([[1] * 7] * 5)
    free, offsets = flat_cells(workspace)
    particles = flat_mask(workspace, np.array([[0, 0]]))
    about = free, offsets, free & ~particles, particles, 1
    assert 0 < fewest_commands(*about, most_sets=50) < fewest_commands(*about)


@pytest.mark.parametrize("rule", ["block", "merge"])
@pytest.mark.parametrize("kind", KINDS)
def test_flow_bounds_are_not_above_the_optimum(kind, rule):
    sharper = 0
    for seed, (workspace, start) in enumerate(small_cases(16, 46)):
        if workspace.n_free > (4 if kind == "mapping" else 7) or len(start) > 3:
            continue
        case = case_of(kind, workspace, seed)
        bound = lower_bound(workspace, start, rule=rule, flow=True, **case)
        fewest = optimum(workspace, start, rule=rule, **case).moves
        assert bound.moves <= fewest
        others = max(bound.count, bound.distance, bound.axes, bound.commands, bound.pairs)
        sharper += bound.flow > others
    assert sharper or kind != "mapping"


def test_flow_bounds_refuse_tilts():
    with pytest.raises(InvalidInputError, match="flow: expected the rule block or merge"):
        lower_bound(GridWorkspace([[1, 1]]), [(0, 0)], rule="tilt", flow=True)
