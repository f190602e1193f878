"""The kernels of the noisy world against sets, dictionaries and a list of all cases, on random
input.
"""

from __future__ import annotations

import copy

import numpy as np
import pytest
from tests.reference import noise as plain
from tests.soak import often

from shoal.swarm.grid.board import Board, GridLayout, encode, letters_of
from shoal.swarm.kernels import noise as kernels
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise import Noise, NoisyBelief, inner_of, truth_of


def tuples(cells):
    return {tuple(cell) for cell in np.asarray(cells).tolist()}


def random_case(rng):
    shape = tuple(int(side) for side in rng.integers(1, 8, size=2 if rng.random() < 0.7 else 3))
    free = rng.random(shape) < 0.8
    free.flat[rng.integers(free.size)] = True
    workspace = GridWorkspace(free)
    n = int(rng.integers(1, workspace.n_free + 1))
    return workspace, workspace.cells[np.sort(rng.choice(workspace.n_free, size=n, replace=False))]


@pytest.mark.parametrize("seed", range(often(8, 16)))
def test_moves_looks_and_belief(seed):
    rng = np.random.default_rng(seed)
    scanning = 1.0 if seed % 2 else 0.4  # how often a scan follows a command
    workspace, start = random_case(rng)
    about = Noise(*rng.choice([0.0, 0.05, 0.3], size=3))
    shape, layout = workspace.shape, GridLayout(workspace.shape)
    noisy = truth_of(workspace, start, about, 0.99)
    luck, same_luck = np.random.default_rng(seed), np.random.default_rng(seed)
    free, particles = tuples(workspace.cells), tuples(start)

    def scan():
        kernels.look(noisy, luck)
        seen = plain.look(particles, about.misplace, about.miss, same_luck)
        assert tuples(np.argwhere(inner_of(noisy.seen, shape, rim=1)) - 1) == seen
        return seen

    seen = scan()
    window = [tuple(cell) for cell in (np.argwhere(np.ones(layout.window)) - 1).tolist()]
    reference = plain.Belief(window, about.slip, about.misplace, about.miss, seen)
    belief = NoisyBelief(shape, Board.of_cells(layout, sorted(seen)), about, 0.99)
    for _ in range(12 if len(window) < 150 else 4):
        command = letters_of(layout.ndim)[rng.integers(2 * layout.ndim)]
        step = plain.STEPS[command][3 - layout.ndim :]
        before = copy.copy(particles)
        particles = plain.move(free, particles, step, about.slip, same_luck)
        travelled = kernels.move_noisy(noisy, encode(command, ndim=layout.ndim)[0], luck)
        assert tuples(np.argwhere(inner_of(noisy.occupied, shape))) == particles
        assert travelled == sum(sum(cell) for cell in particles) * sum(step) - sum(
            sum(cell) for cell in before
        ) * sum(step)
        if scanning == 1.0 or rng.random() < scanning:
            seen = scan()
            belief.update(command, Board.of_cells(layout, sorted(seen)))
            reference.update(step, seen)
        else:
            belief.spread(command)
            reference.spread(step)
        for cell in window:
            at = tuple(i + 1 for i in cell)
            assert belief.logit[at] == pytest.approx(reference.logit[cell], rel=1e-6, abs=1e-6), (
                command,
                cell,
            )
            inside = inner_of(belief.state.inside, shape, rim=1)[at]
            assert inside == pytest.approx(reference.inside[cell], rel=1e-6, abs=1e-9), (
                command,
                cell,
            )
