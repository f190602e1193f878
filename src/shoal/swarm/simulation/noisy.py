"""A swarm that is simulated with noise: particles slip and are seen wrongly, and belief is what a filter makes of that."""

from __future__ import annotations

from numpy.random import Generator

from shoal.swarm.grid.commands import encode
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.trace import Row
from shoal.swarm.kernels.noise import noisy_state
from shoal.swarm.noise.belief import NoisyBelief


class NoisySwarm:
    """Particles whose truth lies in the arrays of their belief; see `shoal.swarm.simulation.loop.Controlled`.

    Parameters
    ----------
    noisy : NoisyBelief
        Changed in place.
    rng : Generator
        Of the noise.
    """

    rule = "block"

    def __init__(self, noisy: NoisyBelief, rng: Generator) -> None:
        self.noisy, self.rng = noisy, rng
        self._take_over()

    def _take_over(self) -> None:
        self.belief, self.state = self.noisy.belief, SwarmState(self.noisy.occupied)

    @property
    def finished(self) -> bool:
        """Whether no frontier cell is left that a particle could get to, and none was given up."""
        return self.noisy.finished

    def carry_out(self, command: str, steps: int, *, scan: bool) -> tuple[list[Row], bool]:
        """Send commands, and scan after the last one if ``scan`` says so; see `shoal.swarm.simulation.loop.Controlled`."""
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
