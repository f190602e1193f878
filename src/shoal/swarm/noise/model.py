"""The noise model: random failures of motion and of observation."""

from __future__ import annotations

from math import log
from typing import Any

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass

CONFIDENCE = 0.99
PRIOR = 0.25  # prior probability that an unknown cell is free: about the fraction in vascular maps
MOST = 0.5  # upper limit of each probability
SUREST = 0.99999
LOSS = 0.02
"""On a rig: prior probability that a particle disappears for good at a move, because it sticks, dissolves or leaves the field.

Without it, a particle that no scan shows any more stays in the belief for ever. Of the values 0.0005, 0.005 and 0.02, the largest
gives the fewest wrong cells if particles disappear, and as few as the others if none does (`python -m benchmarks.rigs`).
"""


@dataclass(frozen=True)
class Noise:
    """Probabilities of failed motions and observations. Failures of different particles or at different moves are independent.

    Parameters
    ----------
    slip : float
        Probability, from 0 to 0.5, that a command does not move a particle (the particle slips). A slipping particle blocks the
        particles behind it.
    misplace : float
        Probability that a scan shows a particle in a neighbouring cell instead of its true cell. All neighbouring cells (4 in 2-D,
        6 in 3-D) are equally likely.
    miss : float
        Probability that a scan does not show a particle.

    Raises
    ------
    InvalidInputError

    Notes
    -----
    The page docs/concepts/noise.md explains the noise model.
    """

    slip: float = 0.0
    misplace: float = 0.0
    miss: float = 0.0

    def __post_init__(self) -> None:
        for name in ("slip", "misplace", "miss"):
            object.__setattr__(self, name, check_number(getattr(self, name), what=name, least=0, most=MOST))

    def __bool__(self) -> bool:
        return bool(self.slip or self.misplace or self.miss)


def bound_of(confidence: Any) -> float:
    """Return the log-odds of a confidence. The confidence must exceed the prior probability that an unknown cell is an obstacle.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> round(bound_of(0.99), 2)
    4.6
    """
    sure = check_number(confidence, what="confidence", above=1 - PRIOR, most=SUREST)
    return log(sure / (1 - sure))
