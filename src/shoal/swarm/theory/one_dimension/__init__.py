"""Theory in one dimension: n particles on a line of m cells obey one shared command.

The particles move to the left until they find the left end of the line, and then to the right.

The package contains exact values, Monte Carlo estimates, and the formulas printed in paper M, section III.A, with errata.
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
