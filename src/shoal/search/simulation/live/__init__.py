"""Live search: each robot is a process with its own radio, and no process coordinates the robots.

The module `supervisor` starts all processes in a `process_pool`, kills the processes of robots that
are to crash, and records all reports as an `outcome`. In each `process`, an `agent` connects the
state machine of a robot (`shoal.search.protocol.robot`) to a `radio`, to a simulated vehicle
(`moving_point`) and to the `cell_locks`.
"""

from __future__ import annotations

from shoal.search.simulation.live.supervisor import LiveEvent, LiveOutcome, run_live

__all__ = ["LiveEvent", "LiveOutcome", "run_live"]
