"""sweep: a column of particles goes over a rectangle and back."""

from __future__ import annotations

from typing import Any, ClassVar

from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.swarm.policies.compiled_policy import Compiled
from shoal.swarm.policies.protocol import Decision, View


@dataclass(frozen=True)
class _Phase:
    phase: int = 0  # 0 to the left wall, 1 up and right, 2 down and left, 3 a whole turn made
    second: bool = False
    gain: int = 0


@dataclass(frozen=True)
class WallSweep(Compiled):
    """Left to the wall; up and right by turns until nothing goes right; down and left by turns back; again while it helps.

    For a rectangle k cells tall with k particles along its left wall (placement left-wall) this takes 4m/k moves. It is no strategy
    for other shapes: where a whole turn classifies nothing it stops and the episode is reported as stalled.
    Source: paper D, section III.B.2.
    """

    kind: ClassVar[str] = "sweep"
    code: ClassVar[int] = 5
    runs: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (2,)

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next command of the turn."""
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
