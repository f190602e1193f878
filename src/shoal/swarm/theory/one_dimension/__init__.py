"""The theory of one dimension: m cells in a line, n particles, one command for all, left first and then right.

Paper M, section III.A, with its errata: exact values beside the printed formulas and beside Monte Carlo.
"""

from __future__ import annotations

from shoal.swarm.theory.one_dimension.exact import Distribution, Line, Mean
from shoal.swarm.theory.one_dimension.positions import boundary_moves, coverage_moves
from shoal.swarm.theory.one_dimension.sampling import LineSample, sample

__all__ = [
    "Distribution",
    "Line",
    "LineSample",
    "Mean",
    "boundary_moves",
    "coverage_moves",
    "sample",
]
