"""A simulated swarm with noise: particles slip, scans show wrong positions, and a Bayes filter estimates the belief."""

from __future__ import annotations

from numpy.random import Generator

from shoal.swarm.grid.commands import encode
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.trace import Row
from shoal.swarm.kernels.noise import noisy_state
from shoal.swarm.noise.belief import NoisyBelief


class NoisySwarm:
    """A simulated swarm with noise, for the closed loop. The arrays of the swarm's belief contain the true state of the particles.

    Parameters
    ----------
    noisy : NoisyBelief
        The belief of the swarm. Commands and scans change the belief object in place.
    rng : Generator
        Generator of the random numbers for the noise.
    """

    rule = "block"

    def __init__(self, noisy: NoisyBelief, rng: Generator) -> None:
        self.noisy, self.rng = noisy, rng
        self._take_over()

    def _take_over(self) -> None:
        self.belief, self.state = self.noisy.belief, SwarmState(self.noisy.occupied)

    @property
    def finished(self) -> bool:
        """Whether no frontier cell is in reach of the particles, and the policy has given up no cell as undecidable."""
        return self.noisy.finished

    def carry_out(self, command: str, steps: int, *, scan: bool) -> tuple[list[Row], bool]:
        """Send the command ``steps`` times. Scan after the last command if ``scan`` is true."""
        code, rows = encode(command, ndim=self.noisy.layout.ndim)[0], []
        for step in range(1, steps + 1):
            travelled, classified = int(noisy_state.move_noisy(self.noisy.state, code, self.rng)), 0
            if scan and step == steps:
                noisy_state.look(self.noisy.state, self.rng)
                classified = self.noisy.learn(code)
            else:
                self.noisy.spread_code(code)
            rows.append((classified, self.noisy.remaining, travelled))
        self._take_over()
        return rows, scan
