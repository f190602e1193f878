"""The noise model: random failures of motion and of observation."""

from __future__ import annotations

from math import isfinite, log
from typing import Any

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError

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
        Probability, 0 to 0.5, that a particle does not move at a command. Such a particle blocks the particles behind it.
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
            rate = getattr(self, name)
            if isinstance(rate, bool) or not isinstance(rate, int | float) or not (isfinite(rate) and 0 <= rate <= MOST):
                raise InvalidInputError(f"{name}: expected a probability, 0 to {MOST:g}, got {rate!r}")
            object.__setattr__(self, name, float(rate))

    def __bool__(self) -> bool:
        return bool(self.slip or self.misplace or self.miss)


def bound_of(confidence: Any) -> float:
    """Return the log-odds of a confidence.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> round(bound_of(0.99), 2)
    4.6
    """
    number = isinstance(confidence, int | float) and not isinstance(confidence, bool)
    if not number or not 1 - PRIOR < float(confidence) <= SUREST:
        raise InvalidInputError(
            f"confidence: expected a probability above {1 - PRIOR:g} (with which any unknown cell is an obstacle), "
            f"at most {SUREST:g}, got {confidence!r}"
        )
    return log(float(confidence) / (1 - float(confidence)))
