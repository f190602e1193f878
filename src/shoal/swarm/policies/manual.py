"""Policy manual: send a fixed sequence of commands."""

from __future__ import annotations

from typing import Any, ClassVar

from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.board import GridLayout
from shoal.swarm.grid.commands import encode
from shoal.swarm.policies.compiled_policy import Compiled
from shoal.swarm.policies.protocol import Decision, View


@dataclass(frozen=True)
class Manual(Compiled):
    """Send the given commands. If the commands end before the task is complete, the episode is stalled.

    Parameters
    ----------
    commands : str
        Command letters, for example "llurr".
    """

    kind: ClassVar[str] = "manual"
    code: ClassVar[int] = 0
    commands: str = ""

    def check(self, layout: GridLayout, rule: str) -> None:
        """Refuse a text with letters that are not commands."""
        super().check(layout, rule)
        encode(self.commands, ndim=layout.ndim)

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return all commands at the first decision, and no commands at later decisions."""
        return (self.commands if memory is None else ""), "sent"
