"""Lateral range curves: how probably one passage detects a target at a distance beside it."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_text, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError

_NUMBER = r"\d+(?:\.\d*)?(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?"
_CURVE = re.compile(
    rf"(?:(?:{_NUMBER})=(?:{_NUMBER}))(?:,(?:{_NUMBER})=(?:{_NUMBER}))*(?:@{_NUMBER})?"
)
_FORM = "METRES=P,METRES=P,...[@SPEED]"


@dataclass(frozen=True, eq=False)
class LateralRange:
    """The probability that one passage on a straight line detects a target, by the target's lateral
    distance from the line.

    Between the given distances, the probability at ``speed`` is a straight line; beyond the last
    one, it is 0. A slower passage looks longer: at a speed v, the probability p of the curve becomes
    1 - (1 - p)^(speed / v), as of independent looks at a constant rate.

    Parameters
    ----------
    distances : ndarray of float64, shape (n,)
        Increasing distances in metres, the first of them 0.
    shares : ndarray of float64, shape (n,)
        Probability at each distance.
    speed : float or None
        Speed in metres per second at which the curve was measured; None if the probability does not
        depend on the speed.

    Notes
    -----
    Source: B. O. Koopman, *Search and Screening*, 1946, chapter 2.
    """

    distances: NDArray[np.float64]
    shares: NDArray[np.float64]
    speed: float | None = None

    def at(self, distances: ArrayLike, speed: float) -> NDArray[np.float64]:
        """Return the probability at lateral distances in metres, for a passage at a speed in metres
        per second.
        """
        away = np.abs(np.asarray(distances, dtype=np.float64))
        missed = 1.0 - np.interp(away, self.distances, self.shares, right=0.0)
        return np.asarray(1.0 - missed ** self._looks(speed))

    def detection(self, spacing: float, speed: float) -> float:
        """Return the probability that a passage along the middle of a strip of the width ``spacing``
        in metres detects a target at a random place of the strip.

        Examples
        --------
        >>> curve = lateral_range("0=1,10=0")
        >>> curve.detection(10, speed=5), curve.detection(20, speed=5), curve.detection(40, speed=5)
        (0.75, 0.5, 0.25)
        """
        half = spacing / 2
        inner = self.distances < half
        ends = np.append(self.distances[inner], half)
        last = np.interp(half, self.distances, self.shares, right=0.0)
        missed = 1.0 - np.append(self.shares[inner], last)
        if half > self.distances[-1]:  # the curve falls to 0 at its end
            ends, missed = np.insert(ends, -1, ends[-2]), np.insert(missed, -1, 1.0)
        # The mean of m^r where m goes from a to b in a straight line is
        # (b^(r + 1) - a^(r + 1)) / ((r + 1) (b - a)).
        power = self._looks(speed)
        miss_begin, miss_end = missed[:-1], missed[1:]
        flat = np.abs(miss_end - miss_begin) < 1e-9
        with np.errstate(divide="ignore", invalid="ignore"):
            sloped = (miss_end ** (power + 1) - miss_begin ** (power + 1)) / (
                (power + 1) * (miss_end - miss_begin)
            )
        means = np.where(flat, ((miss_begin + miss_end) / 2) ** power, sloped)
        return float(1.0 - (np.diff(ends) @ means) / half)

    def sweep_width(self, speed: float) -> float:
        """Return the effective sweep width in metres: the integral of the probability over all
        lateral distances on both sides.

        Examples
        --------
        >>> lateral_range("0=1,10=0").sweep_width(5)
        10.0
        """
        widest = 2 * float(self.distances[-1])
        return widest * self.detection(widest, speed) if widest else 0.0

    def _looks(self, speed: float) -> float:
        """Return how many passages at the curve's own speed see as much as one at ``speed``."""
        return 1.0 if self.speed is None else self.speed / speed


def lateral_range(text: str) -> LateralRange:
    """Parse a curve such as ``0=0.9,10=0.7,25=0@5``: at 5 m/s, 90 % of the targets on the line are
    detected, 70 % of those at 10 m, and none from 25 m on.

    Raises
    ------
    InvalidInputError
        If the text is no curve.
    """
    if not _CURVE.fullmatch(text):
        raise InvalidInputError(
            f"lateral_range: expected {_FORM} with distances in metres, got {shortened(text)}"
        )
    points, _, speed = text.partition("@")
    pairs = np.array([point.split("=") for point in points.split(",")], dtype=np.float64)
    distances, shares = pairs.T
    if (
        len(distances) < 2
        or distances[0] != 0
        or (np.diff(distances) <= 0).any()
        or not np.isfinite(distances).all()
    ):
        raise InvalidInputError(
            "lateral_range: expected two or more increasing distances that begin with 0, got"
            f" {shortened(distances.tolist())}"
        )
    if (shares > 1).any() or not shares.any():
        raise InvalidInputError(
            "lateral_range: expected probabilities from 0 to 1, not all 0, got"
            f" {shortened(shares.tolist())}"
        )
    if speed and not 0 < float(speed) < np.inf:
        raise InvalidInputError(f"lateral_range: expected a speed above 0, got {speed} m/s")
    return LateralRange(distances, shares, float(speed) if speed else None)


def check_lateral_range(value: Any) -> str:
    """Check a curve in the form of `lateral_range`, and return its text."""
    text = check_text(value, what="lateral_range")
    lateral_range(text)
    return text
