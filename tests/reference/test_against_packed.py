"""The packed kernels do what the plain-array reference does, on random input: every rule, task,
policy and dimension.
"""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference import plain
from tests.soak import often
from tests.swarm_runs import run

from shoal.swarm import Coverage, GridWorkspace, SwarmEpisode, make_policy
from shoal.swarm.grid.board import trial_rng

WIDTHS = (1, 2, 3, 61, 62, 63, 64, 65, 126, 127, 128)


class Targets(Coverage):
    """Coverage of given cells."""

    def __init__(self, targets):
        object.__setattr__(self, "targets", targets)

    def choose_targets(self, workspace, rng):
        return self.targets


def random_case(rng, *, shape=None):
    """Return (free, start, connected): a random map and random start cells."""
    if shape is None:
        shape = (int(rng.integers(1, 9)), int(rng.choice(WIDTHS)))
        if rng.random() < 0.25:
            shape = (
                int(rng.integers(1, 4)),
                int(rng.choice((1, 2, 3, 4, 20))),
                int(rng.choice(WIDTHS[:7])),
            )
    free = rng.random(shape) < rng.choice([0.5, 0.7, 0.9, 1.0])
    free.flat[rng.integers(free.size)] = True
    cells = np.argwhere(free)
    n = (
        int(rng.integers(1, len(cells) + 1))
        if rng.random() < 0.5
        else int(rng.integers(1, min(len(cells), 6) + 1))
    )
    return free, cells[np.sort(rng.choice(len(cells), size=n, replace=False))]


def reachable(free, start):
    """Return the free cells connected to a start cell."""
    labels = GridWorkspace(free).components
    return np.isin(labels, np.unique(labels[tuple(start.T)])) & free


def same(episode: SwarmEpisode, reference: dict) -> None:
    """Assert that an episode and the reference's agree in everything."""
    assert episode.commands == reference["commands"]
    assert episode.status == reference["status"]
    same_log(episode, reference)


def same_log(episode: SwarmEpisode, reference: dict) -> None:
    np.testing.assert_array_equal(episode.trace.classified, reference["classified"])
    np.testing.assert_array_equal(episode.trace.frontier, reference["frontier"])
    np.testing.assert_array_equal(episode.trace.travelled, reference["travelled"])
    state, belief = episode.final()
    counts = np.zeros(episode.workspace.shape, dtype=int)
    np.add.at(counts, tuple(state.cells.T), 1)
    np.testing.assert_array_equal(counts, reference["counts"])
    if episode.task == "mapping":
        window = belief.open.layout.window
        known = np.where(
            belief.open.mask, plain.FREE, np.where(belief.known.mask, plain.OBSTACLE, plain.UNKNOWN)
        )
        np.testing.assert_array_equal(known, reference["state"].reshape(window))


@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
@pytest.mark.parametrize("task", ["mapping", "coverage"])
def test_random_commands(rule, task):
    rng = np.random.default_rng(11)
    for _ in range(often(30, 120)):
        free, start = random_case(rng)
        targets = (
            reachable(free, start) & (rng.random(free.shape) < 0.5) if task == "coverage" else None
        )
        commands = "".join(rng.choice(list("lurdio"[: 2 * free.ndim]), size=60))
        todo = "mapping" if targets is None else Targets(targets)
        episode = run(
            GridWorkspace(free), task=todo, start=start, rule=rule, policy=f"manual:{commands}"
        )
        reference = plain.simulate(free, start, commands, rule=rule, task=task, targets=targets)
        cut = {
            k: v[: episode.moves] if k in {"classified", "frontier", "travelled"} else v
            for k, v in reference.items()
        }
        if episode.moves < len(commands):  # ours stops when the task is complete
            assert episode.status == "complete"
            cut |= plain.simulate(
                free, start, episode.commands, rule=rule, task=task, targets=targets
            )
        same_log(episode, cut)


POLICIES = ("closest-frontier", "closest-frontier:ties=row-major", "elect-particle", "depth-first")
PLAYED = [(policy, rule) for policy in POLICIES for rule in sorted(make_policy(policy).rules)]


@pytest.mark.parametrize(("policy", "rule"), PLAYED)
@pytest.mark.parametrize("task", ["mapping", "coverage"])
def test_policies(policy, rule, task):
    name, _, option = policy.partition(":")
    rng = np.random.default_rng(12)
    for seed in range(often(15, 80)):
        free, start = random_case(rng)
        targets = (
            reachable(free, start) & (rng.random(free.shape) < 0.5) if task == "coverage" else None
        )
        todo = "mapping" if targets is None else Targets(targets)
        episode = run(
            GridWorkspace(free),
            task=todo,
            start=start,
            rule=rule,
            policy=policy,
            seed=seed,
            max_moves=3000,
        )
        reference = plain.run(
            free,
            start,
            policy=name,
            rule=rule,
            task=task,
            targets=targets,
            ties=option.removeprefix("ties=") or "column-major",
            rng=trial_rng(seed),
            max_moves=3000,
        )
        same(episode, reference)


@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
def test_random_moves(rule):
    rng = np.random.default_rng(13)
    for seed in range(40):
        free, start = random_case(rng)
        reference = plain.run(
            free, start, policy="random-moves", rule=rule, rng=trial_rng(seed), max_moves=300
        )
        same(
            run(
                GridWorkspace(free),
                start=start,
                rule=rule,
                policy="random-moves",
                seed=seed,
                max_moves=300,
            ),
            reference,
        )


def test_larger_maps():
    rng = np.random.default_rng(14)
    for seed in range(6):
        free, start = random_case(rng, shape=(40, 131))
        for policy in ("closest-frontier", "elect-particle"):
            reference = plain.run(free, start, policy=policy, rng=trial_rng(seed))
            same(run(GridWorkspace(free), start=start, policy=policy, seed=seed), reference)


@pytest.mark.parametrize(
    ("policy", "rule"), [*PLAYED, *(("random-moves", rule) for rule in ("block", "merge", "tilt"))]
)
@pytest.mark.parametrize("task", ["mapping", "coverage"])
def test_compiled_is_stepwise(policy, rule, task):
    """A built-in policy played whole in a kernel and step by step through the public world gives
    the same episode.
    """
    rng = np.random.default_rng(15)
    for seed in range(often(2, 8)):
        free, start = random_case(rng)
        todo = "mapping" if task == "mapping" else Targets(reachable(free, start))
        whole, steps = (
            run(
                GridWorkspace(free),
                task=todo,
                start=start,
                rule=rule,
                policy=policy,
                seed=seed,
                max_moves=400,
                stepwise=s,
            )
            for s in (False, True)
        )
        assert (whole.commands, whole.status) == (steps.commands, steps.status)
        np.testing.assert_array_equal(whole.trace.classified, steps.trace.classified)
        np.testing.assert_array_equal(whole.trace.frontier, steps.trace.frontier)
        np.testing.assert_array_equal(whole.trace.travelled, steps.trace.travelled)
