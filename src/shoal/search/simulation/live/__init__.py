"""Live search: each robot is a process with its own radio, and no process coordinates the robots.

The module `supervisor` starts all processes (`process`), kills the processes of robots that are to
crash, and records all reports. In each process, an `agent` connects the state machine of a robot
(`shoal.search.protocol.robot`) to a `radio`, to a simulated vehicle and to the locks of the cells.
"""

from __future__ import annotations

from shoal.search.simulation.live.supervisor import LiveEvent, LiveOutcome, run_live

__all__ = ["LiveEvent", "LiveOutcome", "run_live"]
