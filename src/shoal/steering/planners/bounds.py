"""Bounds of errors for which a plan without observations must hold."""

from __future__ import annotations

from math import atan, hypot, inf, pi, radians, tan

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass

CERTAIN = 2.0  # standard deviations that a contact and a pressing angle allow for
STEEPEST = radians(2)  # least angle between a wall and a push into it
OWN = np.array([[1.0, 0.0], [1.0, 0.0]])  # gains of particles without errors


@dataclass(frozen=True)
class Bounds:
    """Errors for which a plan must hold.

    Parameters
    ----------
    friction : float
        Least coefficient of friction of the walls; the plan holds for all higher values.
    angle : float
        Standard deviation of the angle of each move, in radians.
    gain : float
        Standard deviation of the relative length of each move, and of the constant gain of each
        particle.
    """

    friction: float = inf
    angle: float = 0.0
    gain: float = 0.0

    @property
    def spread(self) -> float:
        """Standard deviation of the end of a move, relative to its length."""
        return hypot(self.angle, self.gain)

    def cone(self, certain: float = CERTAIN) -> float:
        """Return the tangent of the largest angle between a push and the normal of a wall with
        which the wall holds a particle in spite of the errors of the angle.
        """
        widest = min(atan(self.friction), pi / 2 - STEEPEST) - certain * self.angle
        return tan(max(widest, 0.0))

    def scenarios(
        self, count: int, moves: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Draw errors of moves (count, moves, 2), of the gains of both particles (count, 2, 2), and
        coefficients of friction (count,), of which half are the least one. The first scenario has
        no errors.
        """
        length = 1 + self.gain * rng.normal(size=(count, moves))
        angle = self.angle * rng.normal(size=(count, moves))
        turns = np.stack([length * np.cos(angle), length * np.sin(angle)], axis=2)
        gains = np.tile(OWN, (count, 1, 1))
        gains[:, :, 0] += self.gain * rng.normal(size=(count, 2))
        higher = self.friction / np.maximum(rng.random(count), 1e-9)
        frictions = np.where(rng.random(count) < 0.5, self.friction, higher)
        turns[0], gains[0] = (1.0, 0.0), OWN
        return turns, gains, frictions
