"""Live search: each robot is a process of its own with a radio of its own. Nobody leads them.

`supervisor` starts the processes (`pool`), kills some, and writes down what they report (`outcome`). In each `process` an `agent`
joins the pure robot (`shoal.search.protocol.robot`) to a `radio`, a `vehicle` and its `cell_locks` on the ground.
"""

from __future__ import annotations

from shoal.search.simulation.live.outcome import LiveEvent, LiveOutcome
from shoal.search.simulation.live.supervisor import run_live

__all__ = ["LiveEvent", "LiveOutcome", "run_live"]
