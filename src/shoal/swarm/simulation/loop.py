"""The closed loop in Python (observe, decide, send, record), which simulations, noise and rigs use."""

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
"""Function that is called at intervals with (moves so far, frontier cells left)."""

OnTrace = Callable[[Trace], None]
"""Function that is called with each piece of the trace during the run."""


class Controlled(Protocol):
    """The swarm that the loop controls. The controlled swarm carries out commands, and knows the map and the particles' cells.

    Policies see ``belief`` and ``state``. For a rig and with noise, the map and the particles' cells are estimates.
    """

    @property
    def belief(self) -> Belief:
        """The belief about the map."""

    @property
    def state(self) -> SwarmState:
        """The state of a swarm: the cells of the particles."""

    @property
    def rule(self) -> str:
        """The move rule."""

    @property
    def finished(self) -> bool:
        """Whether no cell is left that the particles can classify or cover."""

    def carry_out(self, command: str, steps: int, *, scan: bool) -> tuple[list[Row], bool]:
        """Send ``steps`` equal commands, observe, and update belief and state.

        Parameters
        ----------
        command : str
        steps : int
        scan : bool
            Whether a scan must follow. If false, the scan may be left out if its outcome is certain.

        Returns
        -------
        list of tuple of int, and bool
            (classified, frontier, travelled) of each command, and whether a scan was made.
        """


def closed_loop(
    swarm: Controlled,
    decider: Decider,
    *,
    max_moves: int,
    mapping: bool = True,
    on_moves: OnMoves | None = None,
    on_trace: OnTrace | None = None,
) -> tuple[Trace, Status]:
    """Run until no frontier cell is left, the policy has no more commands, or the maximum number of moves is reached.

    The policy makes no decision between two scans. The scan at the end of a run of equal commands determines the effect of each
    command.

    Parameters
    ----------
    swarm : Controlled
    decider : Decider
        Converts the policy's commands into runs of equal commands.
    max_moves : int
    mapping : bool
        Whether frontier cells are unknown. Policies receive this value.
    on_moves, on_trace : callable, optional

    Returns
    -------
    The trace of the run, and its status.
    """
    recorder = Recorder()
    while True:
        if swarm.belief.complete and swarm.finished:
            return recorder.trace, Status.COMPLETE
        if recorder.moves >= max_moves:
            return recorder.trace, Status.LIMIT
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
