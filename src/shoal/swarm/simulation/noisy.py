"""A simulated swarm with noise: particles slip and are observed wrongly, and a Bayes filter estimates the belief."""

from __future__ import annotations

from numpy.random import Generator

from shoal.swarm.grid.commands import encode
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.trace import Row
from shoal.swarm.kernels.noise import noisy_state
from shoal.swarm.noise.belief import NoisyBelief


class NoisySwarm:
    """Particles with noise, whose true state is stored in the arrays of their belief; see `shoal.swarm.simulation.loop.Controlled`.

    Parameters
    ----------
    noisy : NoisyBelief
        The belief, which changes in place.
    rng : Generator
        Generator of the noise.
    """

    rule = "block"

    def __init__(self, noisy: NoisyBelief, rng: Generator) -> None:
        self.noisy, self.rng = noisy, rng
        self._take_over()

    def _take_over(self) -> None:
        self.belief, self.state = self.noisy.belief, SwarmState(self.noisy.occupied)

    @property
    def finished(self) -> bool:
        """Whether no reachable frontier cell is left, and no cell was given up as undecidable."""
        return self.noisy.finished

    def carry_out(self, command: str, steps: int, *, scan: bool) -> tuple[list[Row], bool]:
        """Send commands, and scan after the last command if ``scan`` is true; see `shoal.swarm.simulation.loop.Controlled`."""
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
