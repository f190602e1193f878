"""Estimate of the gain (displacement of a particle divided by the input) at each point, for closed-loop planners."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.steering.workspaces.convex_geometry import Points

PRIOR = 0.3  # prior standard deviation of the gain's slope, in gains per size


class GainBelief:
    """Estimate of the gain at each point p with the model a + b · (p - c) / s.

    The vector c is the centre of the workspace's base, and s is the size of the workspace. The estimate of the coefficients a and b
    is a normal distribution. Each observed move without wall contact improves the estimate.
    """

    def __init__(self, room: Any, noise: Any) -> None:
        d = room.dimensions
        self.size, self.noise = room.size, noise
        self.center = np.zeros(d)
        self.center[:2] = room.center
        self.estimate: NDArray[np.float64] = np.eye(d + 1)[0]
        self.spread = np.diag(np.r_[PRIOR / 3, np.full(d, PRIOR)]) ** 2 * (1.0 if noise.gain else 1e-12)

    def _features(self, point: Points) -> NDArray[np.float64]:
        return np.asarray(np.r_[1.0, (point - self.center) / self.size])

    def at(self, point: Points) -> float:
        """Return the expected gain (displacement of a particle divided by the input) at a point, but at least 0.2."""
        return max(float(self._features(point) @ self.estimate), 0.2)

    def mean(self, here: Points, there: Points) -> float:
        """Return the expected mean gain on the straight path between two points."""
        return self.at((here + there) / 2)

    def deviation(self, here: Points, there: Points) -> float:
        """Return the standard deviation of the estimated mean gain on the straight path between two points."""
        features = self._features((here + there) / 2)
        return float(np.sqrt(features @ self.spread @ features))

    def ahead(self, point: Points, move: Points) -> Points:
        """Return the expected end point of a particle that starts at ``point``, receives the input ``move`` and touches no wall."""
        middle = point + self.at(point) * move / 2
        return np.asarray(point + self.at(middle) * move)

    def behind(self, point: Points, move: Points) -> Points:
        """Return the expected start point of a particle that the input ``move`` brings to ``point`` without wall contact."""
        middle = point - self.at(point) * move / 2
        return np.asarray(point - self.at(middle) * move)

    def learn(self, here: Points, there: Points, move: Points) -> None:
        """Update the estimate after the input ``move`` has moved a particle without wall contact from ``here`` to ``there``.

        The observed gain is the distance travelled in the direction of the input, divided by the length of the input. The method
        uses the observed gain as the gain at the midpoint of the path. The method ignores inputs that are short compared with the
        noise.
        """
        length = float(np.linalg.norm(move))
        if length < 20 * max(self.noise.measurement, self.noise.execution, 1e-9 * self.size):
            return
        gain = float((there - here) @ move) / length**2
        variance = (2 * self.noise.measurement**2 + self.noise.execution**2) / length**2 + 1e-6
        features = self._features((here + there) / 2)
        along = self.spread @ features
        weight = along / (float(features @ along) + variance)
        self.estimate = self.estimate + weight * (gain - float(features @ self.estimate))
        self.spread = self.spread - np.outer(weight, along)
