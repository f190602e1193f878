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
FRICTIONS = np.array([0, *np.geomspace(0.1, 10, 40).round(3), 1e9])
STEP = 1.125  # ratio of two of them
LOWER, HIGHER = 0.85, 1.25  # of the stated friction: less and more than this is named
NAMING = 0.95  # probability with which it is
LESS = 0.05  # probability of less friction than stated
NEARBY = 1.5  # power with which more friction than stated becomes unlikely
UNKNOWN = 0.5  # probability that the walls slip, if nothing is stated of them
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

    def draw(self, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw gains as likely as they are, float64 of shape (count, particles, 2)."""
        drawn = rng.multivariate_normal(self.mean.ravel(), self._spread, count, method="cholesky")
        return np.ascontiguousarray(drawn.reshape(count, -1, 2))

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
    """How likely each coefficient of friction of the walls is.

    Parameters
    ----------
    stated : float
        Least coefficient that the user has stated; infinite if nothing slips, or none was stated.
    less : float
        Probability, before any contact, that the coefficient is lower than that.

    Attributes
    ----------
    values : ndarray of float64, shape (n,)
        The coefficients that are compared, ascending: `FRICTIONS` and the stated one.
    contacts : int
        Number of moves from which it was learnt.
    """

    def __init__(self, stated: float, less: float = LESS) -> None:
        self.stated, self.contacts = stated, 0
        least = min(stated, FRICTIONS[-1])
        apart = np.abs(FRICTIONS - least) > 0.02 * least
        self.values = np.sort(np.append(FRICTIONS[apart], least))
        lower = self.values < least
        # who states a least friction mostly states one that is near
        higher = np.where(lower, 0.0, (max(least, 1e-3) / np.maximum(self.values, 1e-3)) ** NEARBY)
        shares = np.where(lower, less / max(lower.sum(), 1), (1 - less) * higher / higher.sum())
        self._odds = np.log(np.maximum(shares, 1e-6))

    @property
    def shares(self) -> NDArray[np.float64]:
        """Probability of each of the values."""
        shares = np.exp(self._odds - self._odds.max())
        return np.asarray(shares / shares.sum())

    def quantile(self, share: float) -> float:
        """Return the coefficient below which the given share of the probability lies."""
        at = int(np.searchsorted(np.cumsum(self.shares), share - 1e-12))
        return float(self.values[min(at, len(self.values) - 1)])

    def least(self, friction: float) -> float:
        """Return the probability that the coefficient is at least ``friction``."""
        return float(self.shares[self.values >= friction].sum())

    @property
    def slips(self) -> bool:
        """Whether the walls surely slip more than stated."""
        less = LOWER * min(self.stated, FRICTIONS[-1]) > self.values
        return self.contacts > 0 and float(self.shares[less].sum()) > NAMING

    @property
    def holds(self) -> bool:
        """Whether the walls surely hold more than stated."""
        more = self.values > HIGHER * self.stated
        return self.contacts > 0 and float(self.shares[more].sum()) > NAMING

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
        count = len(self.values)
        turns = np.tile([1.0, 0.0], (count, 1, 1))
        own = np.ascontiguousarray(np.tile(gains, (count, 1, 1)))
        ends = np.zeros((count, 2, 2))
        kernels.play_scenarios(
            np.ascontiguousarray(before[None]),
            np.ascontiguousarray(move[None]),
            turns,
            own,
            self.values,
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


def _faults() -> list[tuple[str, NDArray[np.float64]]]:
    """Return what may be wrong with a rig: a text, and how it changes the positive and the negative
    parts of an input, float64, shape (2, 2, 2).
    """
    mirrored = "the picture or the field is mirrored: {} are exchanged"
    rotated = "the picture or the field is turned by 90 degrees: the axes are swapped, one inverted"
    changes = [
        (mirrored.format("left and right"), [[-1, 0], [0, 1]]),
        (mirrored.format("up and down"), [[1, 0], [0, -1]]),
        ("the picture or the field is turned by 180 degrees", [[-1, 0], [0, -1]]),
        ("the axes are swapped (x and y exchanged)", [[0, 1], [1, 0]]),
        ("the axes are swapped (x and y exchanged) and mirrored", [[0, -1], [-1, 0]]),
        (rotated, [[0, -1], [1, 0]]),
        (rotated, [[0, 1], [-1, 0]]),
    ]
    faults = [(text, np.array([matrix, matrix], dtype=np.float64)) for text, matrix in changes]
    identity = np.tile(np.eye(2), (2, 1, 1))
    for axis in range(2):
        for sides, which in (((0,), "+"), ((1,), "-"), ((0, 1), "±")):
            dead = identity.copy()
            dead[list(sides), axis, axis] = 0.0
            text = f"no particle follows inputs along {which}{'xy'[axis]}: a coil does nothing"
            faults.append((text, dead))
    return faults


FAULTS = _faults()
WALLS = (0.0, 0.5, 1.0, 2.0, 1e9)  # coefficients of friction, of which the best explains a move
GUESS = 0.1  # relative error of a move that a fault must not explain
USUAL = 0.5  # largest change of a gain that is none of the faults
CLIP = 6.0  # largest loss of logarithmic odds by one particle and move
NAMED, APART = 14.0, 2.0  # logarithm of the odds of a fault that is named, and before the next one
CERTAIN = 40.0  # the same, from which on the first of like faults is named
RAISED = 4.0  # the same, from which on no conclusion is drawn from the motion


class FaultEstimate:
    """Whether a mirrored picture, swapped axes or a dead coil explain the motion better than the
    inputs do.

    For each of `FAULTS`, the score is the sum of the logarithms of the odds, which never falls
    below 0 (a test by cumulative sums): a fault may also begin during a drive.
    """

    def __init__(self) -> None:
        self._scores = np.zeros(len(FAULTS))

    @property
    def raised(self) -> bool:
        """Whether a fault is likely enough that the motion proves nothing else."""
        return float(self._scores.max()) > RAISED

    @property
    def named(self) -> str | None:
        """The text of the fault that is sure, or None."""
        like = np.flatnonzero(self._scores >= self._scores.max() - APART)
        sure = self._scores.max() > (NAMED if len(like) == 1 else CERTAIN)
        return FAULTS[int(like[0])][0] if sure else None  # of like ones, that which claims least

    def learn(
        self,
        before: Points,
        move: Points,
        seen: Points,
        gains: NDArray[np.float64],
        world: Any,
        *,
        error: float,
    ) -> None:
        """Compare the observed positions after a move with those that each fault predicts."""
        length = float(np.hypot(*move))
        variance = (GUESS * length) ** 2 + 2 * error**2 + (2 * MODEL * world.walls.size) ** 2
        unit = np.tile([1.0, 0.0], (len(before), 1))

        def off(sent: Points, gains: NDArray[np.float64]) -> float:
            return _off(before, sent, seen, gains, world, variance)

        # that all move more slowly is no fault, because the loop learns it; that all move in another
        # direction is one, although the loop would learn that, too
        straight = float(np.hypot(*(gains - unit).T).max()) < USUAL
        usual = min(off(move, gains if straight else unit), off(0.5 * move, unit))
        parts = np.stack([np.maximum(move, 0.0), np.minimum(move, 0.0)])
        for k, (_, change) in enumerate(FAULTS):
            sent = np.einsum("sij,sj->i", change, parts)
            self._scores[k] = max(self._scores[k] + usual - off(sent, unit), 0.0)


def _off(
    before: Points,
    sent: Points,
    seen: Points,
    gains: NDArray[np.float64],
    world: Any,
    variance: float,
) -> float:
    """Return the negative logarithm of the likelihood of what is seen, with the best friction."""
    spare, vector = np.empty(2), np.empty(2)
    least = np.inf
    for friction in WALLS:
        walls, total = kernels.with_friction(world, friction), 0.0
        for point, gain, observed in zip(before, gains, seen, strict=True):
            end = point.copy()
            kernels.send_to(end, float(sent[0]), float(sent[1]), gain, walls, vector, spare)
            total += min(float(((end - observed) ** 2).sum()) / (2 * variance), CLIP)
        least = min(least, total)
    return least
