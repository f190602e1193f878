"""The closed loop in Python: observe, decide, send, record. Simulations, noise and rigs go through it."""

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
"""Called now and then with (moves so far, frontier cells left)."""

OnTrace = Callable[[Trace], None]
"""Called with each piece of the trace as it is played."""


class Controlled(Protocol):
    """What the loop controls: it carries out commands, and says what is believed of the map and of the particles.

    ``belief`` and ``state`` are what policies see; of a rig or under noise they are no more than that.
    """

    @property
    def belief(self) -> Belief:
        """What is known of the map."""

    @property
    def state(self) -> SwarmState:
        """The state of a swarm: the cells of the particles."""

    @property
    def rule(self) -> str:
        """The move rule."""

    @property
    def finished(self) -> bool:
        """Whether the task is done, once the frontier is empty."""

    def carry_out(self, command: str, steps: int, *, scan: bool) -> tuple[list[Row], bool]:
        """Send ``steps`` equal commands, look, and update belief and state.

        Parameters
        ----------
        command : str
        steps : int
        scan : bool
            Whether a scan has to follow; else it may be left out where its outcome is known.

        Returns
        -------
        list of tuple of int, and bool
            (classified, frontier, travelled) of each command, and whether there was a scan.
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
    """Play until nothing is left to do, the policy has no more commands, or the limit of moves is reached.

    Between two scans nothing is decided; what a run of equal commands did is worked out from the scan at its end.

    Parameters
    ----------
    swarm : Controlled
    decider : Decider
        What turns a policy into runs of equal commands.
    max_moves : int
    mapping : bool
        Whether frontier cells are unknown; policies are told.
    on_moves, on_trace : callable, optional

    Returns
    -------
    Trace, Status
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
