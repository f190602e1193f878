"""The closed loop in Python: observe, decide, send, record.

Simulations with or without noise, and runs on rigs, use the closed loop.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from shoal.core.episode import Status
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.trace import Recorder, Row, Trace
from shoal.swarm.policies.protocol import View
from shoal.swarm.simulation.deciders import Decider

OnMoves = Callable[[int, int], None]
"""Function that the closed loop calls after each run of commands, with the numbers of moves made and frontier cells left."""

OnTrace = Callable[[Trace], None]
"""Function that the closed loop calls with each new piece of the trace."""


Stop = Callable[[], bool]
"""Function that tells whether the run must end after the moves made so far, with the status ``interrupted``."""


class Controlled(Protocol):
    """The swarm that the closed loop controls.

    The swarm carries out commands, and provides the belief and the cells of the particles, which policies read. With noise, the
    belief and the cells of the particles are estimates.
    """

    @property
    def belief(self) -> Belief:
        """The belief of the task: the known state of each cell."""

    @property
    def state(self) -> SwarmState:
        """The state of the controlled swarm: the cells of all particles."""

    @property
    def rule(self) -> str:
        """Name of the move rule: "block", "merge" or "tilt"."""

    @property
    def finished(self) -> bool:
        """Whether no cells are left that particles can still classify or cover."""

    def carry_out(self, command: str, steps: int, *, scan: bool) -> tuple[list[Row], bool]:
        """Send the command ``steps`` times, scan if necessary, and update the belief and the state.

        Parameters
        ----------
        command : str
        steps : int
        scan : bool
            Whether a scan must follow the commands. If ``scan`` is false, the swarm may omit a scan whose outcome is certain.

        Returns
        -------
        list of tuple of int, and bool
            The trace entries (classified, frontier, travelled) of each command, and whether the swarm made a scan.
        """


def closed_loop(
    swarm: Controlled,
    decider: Decider,
    *,
    max_moves: int,
    mapping: bool = True,
    on_moves: OnMoves | None = None,
    on_trace: OnTrace | None = None,
    recorder: Recorder | None = None,
    stop: Stop | None = None,
) -> tuple[Trace, Status]:
    """Run a swarm until no frontier cells are left, the policy has no more commands, or the maximum number of moves is reached.

    The policy makes no decision between two scans. The scan at the end of a run of equal commands determines the effect of each
    command in the run.

    Parameters
    ----------
    swarm : Controlled
    decider : Decider
        Object that converts the policy's commands into runs of equal commands.
    max_moves : int
    mapping : bool
        True for a mapping, whose frontier cells are unknown. False for a coverage, whose frontier cells are known to be free.
        Policies receive ``mapping`` in their `View`.
    on_moves, on_trace, stop : callable, optional
    recorder : Recorder, optional
        Recorder to continue. It keeps the trace if the swarm raises an exception.

    Returns
    -------
    The trace and the status of the run.
    """
    recorder = Recorder() if recorder is None else recorder
    while True:
        if swarm.belief.complete and swarm.finished:
            return recorder.trace, Status.COMPLETE
        if recorder.moves >= max_moves:
            return recorder.trace, Status.LIMIT
        if stop is not None and stop():
            return recorder.trace, Status.INTERRUPTED
        view = View(swarm.belief, swarm.state.occupied, swarm.rule, mapping, recorder.moves, *recorder.last)
        run = decider.next(view, swarm.state, recorder.idle)
        if run is None:
            return recorder.trace, Status.COMPLETE if swarm.finished else Status.STALLED
        command, planned = run
        known = len(swarm.belief.known)
        rows, scanned = swarm.carry_out(command, min(planned, max_moves - recorder.moves), scan=decider.due)
        wanted = decider.scan_after(swarm.belief, swarm.state, len(swarm.belief.known) - known)
        recorder.add(command, rows, scanned=scanned and wanted)
        if on_trace is not None:
            on_trace(recorder.newest(len(rows)))
        if on_moves is not None:
            on_moves(recorder.moves, len(swarm.belief.frontier))
