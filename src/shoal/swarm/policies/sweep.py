"""Policy sweep: a column of particles sweeps across a rectangle and back."""

from __future__ import annotations

from typing import Any, ClassVar

from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.swarm.policies.compiled_policy import Compiled
from shoal.swarm.policies.protocol import Decision, View


@dataclass(frozen=True)
class _Phase:
    phase: int = 0  # phase: 0 towards the left wall, 1 up and right, 2 down and left, 3 one cycle finished
    second: bool = False
    gain: int = 0


@dataclass(frozen=True)
class WallSweep(Compiled):
    """Sweep a column of particles across a rectangle, to the right and back to the left.

    The policy first pushes all particles to the left, against the wall. On the way to the right, the policy alternates the
    commands up and right until no particle moves right. On the way back, the policy alternates the commands down and left. The way
    to the right and the way back form one cycle. The policy repeats the cycle until a whole cycle classifies no cell. The episode
    then ends as stalled.

    Consider a rectangle with m free cells and a height of k cells. If k particles start along the left wall (placement left-wall),
    the policy needs 4m/k moves. The policy sweep is suitable for rectangles only. Source: paper D, section III.B.2.
    """

    kind: ClassVar[str] = "sweep"
    code: ClassVar[int] = 5
    runs: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (2,)

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next command of the sweep's cycle."""
        now = _Phase() if memory is None else self._noticed(memory, view)
        if now.phase == 3:
            if now.gain == 0:
                return "", now
            now = _Phase(phase=1)
        return ("l", "ur", "dl")[now.phase][now.second], now

    @staticmethod
    def _noticed(now: _Phase, view: View) -> _Phase:
        gain = now.gain + view.classified
        if now.phase == 0 or now.second:
            return _Phase(now.phase + (view.travelled == 0), False, gain)
        return _Phase(now.phase, True, gain)
