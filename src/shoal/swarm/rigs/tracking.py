"""The particles of a rig in the closed loop: the positions that the rig observes update the belief."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError, RigError
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.commands import encode
from shoal.swarm.grid.fields import pushed
from shoal.swarm.grid.scans import states_of_run
from shoal.swarm.grid.state import SwarmState, check_cells
from shoal.swarm.grid.tasks import Mapping
from shoal.swarm.grid.trace import Row
from shoal.swarm.noise.belief import NoisyBelief
from shoal.swarm.noise.model import Noise
from shoal.swarm.rigs.log import DriveLog
from shoal.swarm.rigs.protocol import Rig
from shoal.swarm.simulation.exact import distance_of_push, newly_classified

NOISY = "if particles slip or are observed wrongly, give the probabilities slip, misplace and miss"


class RigSwarm(ABC):
    """Base class of the swarms that the closed loop controls on a rig.

    Parameters
    ----------
    rig : Rig
        The rig. The constructor observes the particles of the rig once.

    Attributes
    ----------
    belief : Belief
    state : SwarmState
        Observed or estimated cells of all particles.
    start : ndarray of int64, shape (n, ndim)
        Cells of the particles at the start.
    first_frontier : int
        Number of frontier cells at the start.
    moves : int
        Number of commands sent to the rig.
    log : DriveLog, optional
        Log to which the object writes all commands and scans.
    """

    belief: Belief
    state: SwarmState
    start: NDArray[np.int64]
    first_frontier: int

    def __init__(self, rig: Rig) -> None:
        self.rig, self.rule, self.layout, self.moves = rig, rig.rule, GridLayout(rig.shape), 0
        self.log: DriveLog | None = None

    @property
    @abstractmethod
    def finished(self) -> bool:
        """Whether no frontier cell is left that the particles can classify."""

    @abstractmethod
    def predict(self, command: str, steps: int) -> list[Row] | None:
        """Update the belief after the command was sent ``steps`` times without a scan.

        Return the trace entries of each command, as `update` does. If a scan is necessary, return None and leave the belief
        unchanged.
        """

    @abstractmethod
    def update(self, command: str, steps: int, cells: NDArray[np.int64]) -> list[Row]:
        """Update the belief with ``cells``, the result of a scan after the command was sent ``steps`` times.

        Return the trace entries (classified, frontier, travelled) of each command.
        """

    def observe(self) -> NDArray[np.int64]:
        """Return the cells in which the rig observes particles (int64, shape (n, ndim))."""
        return check_cells(self.rig.observe(), self.rig.shape, what="positions")

    def carry_out(self, command: str, steps: int, *, scan: bool) -> tuple[list[Row], bool]:
        """Send the command ``steps`` times. Observe the particles if ``scan`` is true or the outcome is uncertain.

        Return the trace entries of each command, and whether the rig observed the particles.
        """
        for _ in range(steps):
            self.moves += 1
            if self.log is not None:
                self.log.command(self.moves, command)
            self.rig.send(command)
        rows = None if scan else self.predict(command, steps)
        if rows is not None:
            return rows, False
        cells = self.observe()
        if self.log is not None:
            self.log.scan(self.moves, cells)
        return self.update(command, steps, cells), True


class ExactRigSwarm(RigSwarm):
    """The particles of a rig without noise: all positions that the rig reports are correct.

    Raises
    ------
    RigError
        Raised if the rig observes no particles, or if a position lies outside the field of view. RigError is raised if the commands
        cannot explain the change of the positions between two observations.
    """

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig)
        self.start = self.observe()
        self.state = self._state_at(self.start)
        here = self.state.occupied
        self.belief = Belief(open=here, known=here, frontier=here.dilated() - here)
        self.first_frontier = len(self.belief.frontier)

    @property
    def finished(self) -> bool:
        """Whether the belief has no frontier cells left."""
        return self.belief.complete

    def predict(self, command: str, steps: int) -> list[Row] | None:
        """Update the belief without a scan if no particle tries to enter an unknown cell.

        If a particle tries to enter an unknown cell, a scan is necessary: return None.
        """
        state, code = self.state, self._code(command)
        for _ in range(self._pushes(steps)):
            if state.occupied.shifted(command) - self.belief.known:
                return None
            before, state = state, pushed(self.layout, self.belief.open.words, state, code, self.rule)
            if state == before:
                break
        return self.update(command, steps, state.cells)

    def update(self, command: str, steps: int, cells: NDArray[np.int64]) -> list[Row]:
        """Update the belief with a scan after the command was sent ``steps`` times.

        Raises
        ------
        RigError
            Raised if the commands cannot explain the change of the observed positions.
        """
        after, rows = self._state_at(cells), []
        try:
            states = list(states_of_run(self.state, after, command, self._pushes(steps)))
        except InvalidInputError as error:
            raise RigError(f"the rig, move {self.moves}: {error}; {NOISY}") from None
        for state in states:
            belief = Mapping().update(self.belief, command, self.state.occupied, state.occupied)
            self._check(belief, self._code(command), state)
            rows.append((newly_classified(self.belief, belief), len(belief.frontier), distance_of_push(self.state, state, command)))
            self.state, self.belief = state, belief
        if self.rule == "tilt":  # one command
            return [(sum(row[0] for row in rows), rows[-1][1], sum(row[2] for row in rows))]
        return rows

    def _code(self, command: str) -> int:
        return int(encode(command, ndim=self.layout.ndim)[0])

    def _pushes(self, steps: int) -> int:
        return steps if self.rule != "tilt" else max(self.layout.window)

    def _state_at(self, cells: NDArray[np.int64]) -> SwarmState:
        if len(cells) == 0:
            raise RigError(f"the rig, after {self.moves} moves: expected the cells of particles, got none")
        outside = ((cells < 0) | (cells >= np.array(self.layout.shape))).any(axis=1)
        twice = (cells[1:] == cells[:-1]).all(axis=1) & (self.rule != "merge")  # the cells are sorted
        for wrong, at, what in ((outside, cells, f"inside {self.layout.shape}"), (twice, cells[1:], "of one particle each")):
            if wrong.any():
                cell = tuple(at[wrong][0].tolist())
                raise RigError(f"the rig, after {self.moves} moves: expected cells {what}, got {cell}; {NOISY}")
        return SwarmState.of_cells(self.layout, cells, shared=self.rule == "merge")

    def _check(self, belief: Belief, code: int, after: SwarmState) -> None:
        """Refuse positions that do not follow from the previous positions and the known free cells."""
        should = pushed(self.layout, belief.open.words, self.state, code, self.rule)
        wrong = should.occupied ^ after.occupied
        if wrong or should != after:
            cell = tuple(int(i) for i in wrong.cells[0]) if wrong else ()
            got = (
                f"{'a' if cell in after.occupied else 'no'} particle at {cell}" if wrong else "other numbers of particles in cells"
            )
            raise RigError(
                f"the rig, move {self.moves}: expected every particle to move as rule {self.rule} requires, got {got}; {NOISY}"
            )


class NoisyRigSwarm(RigSwarm):
    """The particles of a rig with noise: positions that the rig reports may be wrong.

    Parameters
    ----------
    rig : Rig
    noise : Noise
    confidence : float

    Attributes
    ----------
    observations : list of ndarray of int64, shape (k, ndim)
        Cells in which each scan showed particles.
    """

    def __init__(self, rig: Rig, noise: Noise, confidence: float) -> None:
        super().__init__(rig)
        cells = self.observe()
        self._noisy = NoisyBelief(rig.shape, Board.of_cells(self.layout, cells), noise, confidence)
        self._take_over()
        self.start, self.first_frontier, self.observations = self.state.cells, self._noisy.remaining, [cells]

    @property
    def finished(self) -> bool:
        """Whether no frontier cell is in reach of the particles."""
        return self._noisy.finished

    def predict(self, command: str, steps: int) -> list[Row]:
        """Update the estimated positions of the particles after ``steps`` commands without a scan. Do not classify any cell."""
        for _ in range(steps):
            self._noisy.spread(command)
        self._take_over()
        return [(0, self._noisy.remaining, 0)] * steps

    def update(self, command: str, steps: int, cells: NDArray[np.int64]) -> list[Row]:
        """Update the belief with a scan after the command was sent ``steps`` times. Report 0 as the unknown travelled distance."""
        rows = self.predict(command, steps - 1)
        classified = self._noisy.update(command, Board.of_cells(self.layout, cells))
        self.observations.append(cells)
        self._take_over()
        return [*rows, (classified, self._noisy.remaining, 0)]

    def _take_over(self) -> None:
        self.belief, self.state = self._noisy.belief, SwarmState(self._noisy.occupied)
