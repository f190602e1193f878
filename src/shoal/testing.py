"""Conformance tests for third-party worlds, tasks, policies and tours. Shoal's built-in objects
pass all conformance tests.

Each check runs the tested object on small random maps. At the first violation of the object's
contract, a check raises ``AssertionError`` with one sentence. Call the checks from your own tests:

    from shoal.testing import check_policy

    def test_my_policy():
        check_policy(MyPolicy())
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.random import Generator

from shoal.core.errors import InvalidInputError
from shoal.search import TourMaker, components, make_tour
from shoal.search.tours import find_tour_maker
from shoal.swarm import (
    GridWorkspace,
    GridWorld,
    Mapping,
    Policy,
    SwarmProblem,
    Task,
    View,
    make_policy,
    make_task,
)
from shoal.swarm.grid.board import letters_of
from shoal.swarm.run import run
from shoal.swarm.simulation.loop import decided

__all__ = ["check_policy", "check_task", "check_tour_maker", "check_world", "sample_workspaces"]

ALL_RULES = ("block", "merge", "tilt")
ALL_DIMENSIONS = (2, 3)


def sample_workspaces(rng: Generator, *, count: int = 12) -> Iterator[GridWorkspace]:
    """Yield small random workspaces: corridors, rooms, caves, 3-D maps, and maps about as wide as a
    machine word (64 cells).
    """
    shapes: Sequence[tuple[int, ...]] = [
        (1, 9),
        (7, 1),
        (5, 6),
        (9, 12),
        (3, 63),
        (2, 64),
        (3, 65),
        (2, 3, 4),
        (6, 6),
    ]
    for index in range(count):
        shape = shapes[index % len(shapes)]
        free = rng.random(shape) < rng.choice([0.6, 0.85, 1.0])
        free.flat[int(rng.integers(free.size))] = True
        yield GridWorkspace(free, name=f"sample {index}").largest_component()


def _starts(workspace: GridWorkspace, rng: Generator) -> Any:
    n = int(rng.integers(1, workspace.n_free + 1))
    return workspace.cells[rng.choice(workspace.n_free, size=n, replace=False)]


def check_world(
    world_type: Any = GridWorld, *, rules: Sequence[str] = ALL_RULES, seed: int = 0
) -> None:
    """Check a world's methods ``initial`` and ``step`` against the contract of
    `shoal.swarm.GridWorld`.

    The check of a world tests five properties. A step never adds or removes particles, and never
    moves a particle into a wall. A step changes none of its arguments. A repetition of a step gives
    an equal result. Except under the move rule ``tilt``, a step displaces the mean position of the
    particles by at most one cell. Mirrored commands on a mirrored map give mirrored states.

    Parameters
    ----------
    world_type : callable
        A class or function that is called with a workspace and a move rule and returns a world.
    rules : sequence of str
    seed : int

    Raises
    ------
    AssertionError
    """
    rng = np.random.default_rng(seed)
    for workspace in sample_workspaces(rng):
        for rule in rules:
            world, start = world_type(workspace, rule), _starts(workspace, rng)
            flipped = world_type(GridWorkspace(workspace.free[..., ::-1]), rule)
            state, mirror = world.initial(start), flipped.initial(_mirrored(start, workspace))
            for command in rng.choice(list(letters_of(workspace.ndim)), size=25):
                before = state.cells.copy()
                after = world.step(state, command)
                assert np.array_equal(state.cells, before), f"{rule}: step changed its argument"
                assert world.step(state, command) == after, (
                    f"{rule}: the same step gave two results"
                )
                assert after.n_particles == len(start), (
                    f"{rule}: {len(start)} particles became {after.n_particles}"
                )
                assert workspace.free[tuple(after.cells.T)].all(), (
                    f"{rule}: a particle is in a wall"
                )
                if rule != "tilt":
                    moved = np.abs(after.cells.sum(axis=0) - before.sum(axis=0)).sum()
                    assert moved <= len(start), (
                        f"{rule}: {len(start)} particles travelled {moved} cells in one move"
                    )
                mirror = flipped.step(mirror, {"l": "r", "r": "l"}.get(command, command))
                expected = _mirrored(after.cells, workspace)
                assert sorted(map(tuple, mirror.cells.tolist())) == sorted(
                    map(tuple, expected.tolist())
                ), f"{rule}: the mirrored map and command gave another state"
                state = after


def _mirrored(cells: Any, workspace: GridWorkspace) -> Any:
    flipped = np.array(cells)
    flipped[:, -1] = workspace.shape[-1] - 1 - flipped[:, -1]
    return flipped


def check_task(task: str | Task, *, seed: int = 0) -> None:
    """Check a task: known cells agree with the true map, known cells stay known, and ``update``
    changes no argument.

    Parameters
    ----------
    task : str or Task
    seed : int

    Raises
    ------
    AssertionError
    """
    todo = make_task(task)
    rng = np.random.default_rng(seed)
    for workspace in sample_workspaces(rng):
        world = GridWorld(workspace)
        state = world.initial(_starts(workspace, rng))
        belief = todo.begin(world, state, todo.choose_targets(workspace, rng))
        for command in rng.choice(list(letters_of(workspace.ndim)), size=25):
            after = world.step(state, command)
            updated = todo.update(belief, command, state.occupied, after.occupied)
            assert todo.update(belief, command, state.occupied, after.occupied) == updated, (
                "update is not repeatable"
            )
            assert updated.open <= world.free, "a wall is believed to be free"
            assert not (updated.obstacles & world.free), "a free cell is believed to be an obstacle"
            assert belief.open <= updated.open, "a cell known to be free was forgotten"
            assert belief.known <= updated.known, "a known cell was forgotten"
            assert not (updated.frontier & after.occupied), (
                "a cell with a particle still counts as unclassified"
            )
            state, belief = after, updated


def check_policy(
    policy: str | Policy,
    *,
    rules: Sequence[str] | None = None,
    dimensions: Sequence[int] | None = None,
    max_moves: int = 20_000,
    seed: int = 0,
) -> None:
    """Check a policy: it must end every episode, send valid commands, store no data in itself, and
    act equally in equal trials.

    Parameters
    ----------
    policy : str or Policy
    rules : sequence of str, optional
        Move rules to test. The default is ``policy.rules``. For a policy without the attribute
        ``rules``, the default is all move rules.
    dimensions : sequence of int, optional
        Numbers of dimensions of the tested maps. The default is ``policy.dimensions``. For a policy
        without the attribute ``dimensions``, the default is 2 and 3.
    max_moves : int
        Maximum number of moves. An episode with more than ``max_moves`` moves is a violation of the
        contract.
    seed : int

    Raises
    ------
    AssertionError
    """
    chosen = make_policy(policy)
    rng = np.random.default_rng(seed)
    tested_rules: Sequence[str] = rules or sorted(getattr(chosen, "rules", ALL_RULES))
    tested_dimensions: Sequence[int] = dimensions or tuple(
        getattr(chosen, "dimensions", ALL_DIMENSIONS)
    )
    for workspace in sample_workspaces(rng):
        if workspace.ndim not in tested_dimensions:
            continue
        for rule in tested_rules:
            start, trial = _starts(workspace, rng), int(rng.integers(1000))
            problem = SwarmProblem(
                workspace, policy=chosen, start=start, rule=rule, max_moves=max_moves
            )
            try:
                _check_episodes(problem, trial)
            except InvalidInputError as error:
                raise AssertionError(f"{error}, {_place(workspace, rule)}") from None


def _place(workspace: GridWorkspace, rule: str) -> str:
    return f"on a {'two' if workspace.ndim == 2 else 'three'}-dimensional map under rule {rule}"


def _check_episodes(problem: SwarmProblem, trial: int) -> None:
    """Check the first decision of a problem's policy, and check that three runs of one trial end
    and send equal commands.
    """
    policy, place, limit = (
        problem.chosen_policy,
        _place(problem.place, problem.rule),
        problem.max_moves,
    )
    _check_view(policy, problem.place, problem.start, problem.rule)
    changed = problem.replaced(policy=copy.deepcopy(policy))
    first, *others = (
        run(one, trial=trial, stepwise=s)
        for one, s in ((problem, True), (problem, True), (changed, False))
    )
    assert first.status != "limit", (
        f"{policy.name}: no end after {limit} moves {place}:\n{problem.place}"
    )
    for other in others:
        assert other.commands == first.commands, (
            f"{policy.name}: the same trial gave two episodes {place}"
        )
    assert first.verify(), f"{policy.name}: {first.verify().message} {place}"


def _check_view(policy: Policy, workspace: GridWorkspace, start: Any, rule: str) -> None:
    """Check that one decision of a policy changes neither the policy nor the arguments of the
    decision.
    """
    world = GridWorld(workspace, rule)
    state = world.initial(start)
    belief = Mapping().begin(world, state)
    words = [
        board.words.copy() for board in (state.occupied, belief.open, belief.known, belief.frontier)
    ]
    own = copy.deepcopy(vars(policy)) if hasattr(policy, "__dict__") else {}
    commands, _ = decided(
        policy, View(belief, state.occupied, rule), None, np.random.default_rng(0)
    )
    assert (vars(policy) if own else own) == own, (
        f"{policy.name}: a decision changed the policy object itself"
    )
    letters = letters_of(workspace.ndim)
    assert set(commands) <= set(letters), (
        f"{policy.name}: expected commands of the letters {letters} {_place(workspace, rule)}, got"
        f" {commands!r}"
    )
    same = (state.occupied, belief.open, belief.known, belief.frontier)
    for board, before in zip(same, words, strict=True):
        assert np.array_equal(board.words, before), (
            f"{policy.name}: a decision changed its arguments"
        )


def check_tour_maker(maker: str | TourMaker, *, seed: int = 0) -> None:
    """Check a tour maker, which makes a tour of the True cells of a mask.

    Each tour must visit every True cell once, and all cells of one component before the next
    component. Equal masks must give equal tours.

    Parameters
    ----------
    maker : str or TourMaker
    seed : int

    Raises
    ------
    AssertionError, InvalidInputError
        InvalidInputError is raised if a tour leaves out a True cell or visits a False cell, and
        AssertionError for any other violation.
    """
    rng = np.random.default_rng(seed)
    shapes = [(1, 1), (1, 9), (7, 1), (2, 2), (3, 3), (5, 6), (8, 8), (9, 12), (3, 65), (24, 31)]
    flat = [rng.random(shape) < share for shape in shapes for share in (0.3, 0.7, 0.95, 1.0)]
    for mask in flat:
        mask.flat[int(rng.integers(mask.size))] = True
    chosen = find_tour_maker(maker)
    for mask in [*flat, *(workspace.free for workspace in sample_workspaces(rng))]:
        if mask.ndim not in chosen.dimensions:
            continue
        given = mask.copy()
        tour = make_tour(chosen, given)
        assert np.array_equal(given, mask), f"{tour.name}: the mask was changed"
        labels = components(mask)
        changes = np.count_nonzero(np.diff(labels[tuple(tour.cells.T)]))
        assert changes == labels.max() - 1, (
            f"{tour.name}: {labels.max()} components, entered {changes + 1} times"
        )
        assert np.array_equal(make_tour(chosen, mask).cells, tour.cells), (
            f"{tour.name}: the same mask gave two tours"
        )
