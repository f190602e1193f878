"""What a closed loop learns of its rig: the gains of the particles, and the friction of the walls."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.steering.kernels import pressing as kernels
from shoal.steering.workspaces.convex import Points

SHARED, OWN = 0.15, 0.05  # prior standard deviations of the common gain, and of the particles' own
DRIFT = 0.01  # standard deviation by which gains may change with each move
INPUT = 0.02  # relative error of a move, beyond the gains
MODEL = 3e-3  # relative to the size: error of predictions near walls
GAP = 1e-3  # relative to the size: distance of a particle that is taken to touch a wall
FRICTIONS = np.array(
    [
        0,
        0.1,
        0.2,
        0.3,
        0.4,
        0.5,
        0.6,
        0.7,
        0.8,
        0.9,
        1,
        1.15,
        1.3,
        1.5,
        1.75,
        2,
        2.5,
        3,
        4,
        6,
        10,
        1e9,
    ]
)
DOUBT = 3.0  # logarithm of the odds against less friction than stated
OUTLIER = 6.0  # largest loss of logarithmic odds by one move


class GainEstimate:
    """The gains of all particles, complex numbers, as a normal distribution (a Kalman filter).

    Attributes
    ----------
    mean : ndarray of float64, shape (particles, 2)
        Real and imaginary part of the gain of each particle.
    moves : int
        Number of moves from which it was learnt.
    """

    def __init__(self, particles: int = 2) -> None:
        self.mean, self.moves = np.tile([1.0, 0.0], (particles, 1)), 0
        common, alone = np.ones((particles, particles)), np.eye(particles)
        self._common = np.kron(common, np.eye(2))
        self._spread = np.kron(SHARED**2 * common + OWN**2 * alone, np.eye(2))

    @property
    def deviation(self) -> float:
        """Largest standard deviation of a part of a gain."""
        return float(np.sqrt(np.diag(self._spread).max()))

    def learn(self, move: Points, moved: Points, free: NDArray[np.bool_], error: float) -> None:
        """Learn from how far the free particles moved; ``error`` is that of the observations."""
        self._spread = self._spread + DRIFT**2 * self._common
        x, y = float(move[0]), float(move[1])
        if np.hypot(x, y) < 4 * error or not free.any():
            return
        self.moves += 1
        rows = np.flatnonzero(np.repeat(free, 2))
        model = np.kron(np.eye(len(free)), np.array([[x, -y], [y, x]]))[rows]
        # the error of a move is that of all particles
        variance = INPUT**2 * (x * x + y * y) * self._common
        variance = variance + (2 * error**2 + 1e-12) * np.eye(len(variance))
        variance = variance[np.ix_(rows, rows)]
        mean = self.mean.ravel()
        gain = self._spread @ model.T @ np.linalg.inv(model @ self._spread @ model.T + variance)
        self.mean = (mean + gain @ (moved.ravel()[rows] - model @ mean)).reshape(-1, 2)
        self._spread = self._spread - gain @ model @ self._spread


class FrictionEstimate:
    """How likely each of `FRICTIONS` is as the coefficient of friction of the walls.

    Parameters
    ----------
    stated : float
        Least coefficient that the user has stated.
    """

    def __init__(self, stated: float) -> None:
        self.stated, self.contacts = stated, 0
        self._odds = np.where(0.99 * min(stated, 1e9) > FRICTIONS, -DOUBT, 0.0)

    @property
    def shares(self) -> NDArray[np.float64]:
        """Probability of each of `FRICTIONS`."""
        shares = np.exp(self._odds - self._odds.max())
        return np.asarray(shares / shares.sum())

    def quantile(self, share: float) -> float:
        """Return the coefficient below which the given share of the probability lies."""
        at = int(np.searchsorted(np.cumsum(self.shares), share - 1e-12))
        return float(FRICTIONS[min(at, len(FRICTIONS) - 1)])

    @property
    def slips(self) -> bool:
        """Whether the walls surely slip more than stated."""
        less = 0.85 * min(self.stated, FRICTIONS[-1]) > FRICTIONS
        return self.contacts > 0 and float(self.shares[less].sum()) > 0.95

    @property
    def best(self) -> float:
        """Median coefficient."""
        return self.quantile(0.5)

    def learn(
        self,
        before: Points,
        move: Points,
        seen: Points,
        gains: NDArray[np.float64],
        world: Any,
        *,
        error: float,
        deviation: float,
    ) -> None:
        """Compare the observed positions after a move with those that each friction predicts."""
        count = len(FRICTIONS)
        turns = np.tile([1.0, 0.0], (count, 1, 1))
        own = np.ascontiguousarray(np.tile(gains, (count, 1, 1)))
        ends = np.zeros((count, 2, 2))
        kernels.play_scenarios(
            np.ascontiguousarray(before[None]),
            np.ascontiguousarray(move[None]),
            turns,
            own,
            FRICTIONS,
            world,
            ends,
        )
        if float(np.ptp(ends, axis=0).max()) < 1e-9 * world.walls.size:
            return  # friction makes no difference
        self.contacts += 1
        length, normal, slope = float(np.hypot(*move)), np.empty(2), 1.0
        for point in before:
            kernels.nearest_wall(point, world, normal)
            into = max(abs(float(normal @ move)), 0.05 * length)
            slope = max(slope, abs(float(normal[1] * move[0] - normal[0] * move[1])) / into)
        # a particle that is not quite at its wall moves along it by its distance times the slope
        gap = max(error, GAP * world.walls.size) * slope
        variance = (
            (INPUT**2 + deviation**2) * length**2
            + 2 * error**2
            + (MODEL * world.walls.size) ** 2
            + gap**2
        )
        off = ((ends - seen) ** 2).sum(axis=(1, 2)) / (2 * variance)
        self._odds -= np.minimum(off - off.min(), OUTLIER)
