"""Episodes told piece by piece are the same as those that are not."""

from __future__ import annotations

import numpy as np
import pytest

from shoal.swarm.problem import SwarmProblem
from shoal.swarm.run import run


@pytest.mark.parametrize(
    "fields",
    [
        {"policy": "best"},
        {"policy": "closest-frontier"},
        {"policy": "random-moves", "max_moves": 2000},
        {"policy": "elect-particle"},
        {"policy": "closest-frontier", "scan_every": "doubling"},
        {"policy": "closest-frontier", "slip": 0.05},
        {"policy": "greedy-classify", "rule": "merge"},
    ],
)
@pytest.mark.parametrize("stepwise", [False, True])
def test_pieces_make_the_whole(fields, stepwise):
    problem = SwarmProblem("maze:21x15", particles=6, **fields)
    pieces = []
    told = run(problem, seed=4, on_trace=pieces.append, stepwise=stepwise)
    whole = run(problem, seed=4)
    assert told.commands == whole.commands
    for name in ("commands", "scanned", "classified", "frontier", "travelled"):
        joined = np.concatenate([getattr(piece, name) for piece in pieces])
        assert np.array_equal(joined[: told.moves], getattr(told.trace, name)), name
    assert len(pieces) > 1
