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


@dataclass(frozen=True)
class Noise:
    """Noise probabilities. The failures of different particles and different moves are independent.

    Parameters
    ----------
    slip : float
        Probability, 0 to 0.5, that a particle does not move at a command. A particle that slips blocks the particles behind it.
    misplace : float
        Probability that an observed particle appears in a neighbouring cell instead of its own. All neighbours (4, in 3-D 6) are
        equally likely.
    miss : float
        Probability that a scan does not show a particle.

    Raises
    ------
    InvalidInputError

    Notes
    -----
    Docs: docs/concepts/noise.md.
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
    """Return the log-odds of a confidence. The confidence must be above the prior probability that an unknown cell is an obstacle.

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
