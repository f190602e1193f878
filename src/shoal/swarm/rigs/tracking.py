"""What the positions of a rig tell: the belief, and of a rig without fault whether it does what its rule says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError, RigError
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.commands import encode
from shoal.swarm.grid.fields import pushed
from shoal.swarm.grid.scans import states_of_run
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.tasks import Mapping
from shoal.swarm.noise.belief import NoisyBelief
from shoal.swarm.noise.model import Noise
from shoal.swarm.simulation.exact import distance_of_push, newly_classified

NOISY = "if it slips or is seen wrongly, say how often (slip, misplace, miss)"


class ExactTracker:
    """State and belief of a mapping, from positions that are always right.

    Parameters
    ----------
    shape : tuple of int
    rule : str
    cells : ndarray of int64, shape (n, ndim)
        The first positions.

    Raises
    ------
    RigError
        If there are none, or one is where no particle can be.
    """

    def __init__(self, shape: tuple[int, ...], rule: str, cells: NDArray[np.int64]) -> None:
        self.layout, self.rule = GridLayout(shape), rule
        self.start = cells
        self.state = self._state(cells, 0)
        here = self.state.occupied
        self.belief = Belief(open=here, known=here, frontier=here.dilated() - here)
        self.first_frontier = len(self.belief.frontier)

    @property
    def finished(self) -> bool:
        """Whether nothing is left to do."""
        return self.belief.complete

    def blind(self, command: str, steps: int, moves: int) -> list[tuple[int, int, int]] | None:
        """Take in ``steps`` equal commands without a scan, as `update`; return None if that would try an unknown cell."""
        cells = self._foreseen(command, steps)
        return None if cells is None else self.update(command, steps, cells, moves)

    def _foreseen(self, command: str, steps: int) -> NDArray[np.int64] | None:
        """Return where the particles will be after ``steps`` equal commands if no unknown cell is tried, else None."""
        state, code = self.state, int(encode(command, ndim=self.layout.ndim)[0])
        for _ in range(steps if self.rule != "tilt" else max(self.layout.window)):
            if state.occupied.shifted(command) - self.belief.known:
                return None
            before, state = state, pushed(self.layout, self.belief.open.words, state, code, self.rule)
            if state == before:
                break
        return state.cells

    def update(self, command: str, steps: int, cells: NDArray[np.int64], moves: int) -> list[tuple[int, int, int]]:
        """Take in what a scan after ``steps`` equal commands shows; return (done, frontier, travelled) of each command.

        Raises
        ------
        RigError
            If no swarm can have got there by them.
        """
        after = self._state(cells, moves)
        code = int(encode(command, ndim=self.layout.ndim)[0])
        start, rows = self.state, []
        pushes = steps if self.rule != "tilt" else max(self.layout.window)
        try:
            states = list(states_of_run(start, after, command, pushes))
        except InvalidInputError as error:
            raise RigError(f"the rig, move {moves}: {error}; {NOISY}") from None
        for state in states:
            updated = Mapping().update(self.belief, command, self.state.occupied, state.occupied)
            self._check(updated, code, state, moves)
            rows.append(
                (newly_classified(self.belief, updated), len(updated.frontier), distance_of_push(self.state, state, command))
            )
            self.state, self.belief = state, updated
        if self.rule == "tilt":  # one command
            return [(sum(row[0] for row in rows), rows[-1][1], sum(row[2] for row in rows))]
        return rows

    def _state(self, cells: NDArray[np.int64], moves: int) -> SwarmState:
        if len(cells) == 0:
            raise RigError(f"the rig, after {moves} moves: expected the cells of particles, got none")
        outside = ((cells < 0) | (cells >= np.array(self.layout.shape))).any(axis=1)
        twice = (cells[1:] == cells[:-1]).all(axis=1)  # they are sorted
        for wrong, at, what in ((outside, cells, f"inside {self.layout.shape}"), (twice, cells[1:], "of one particle each")):
            if wrong.any() and not (wrong is twice and self.rule == "merge"):
                cell = tuple(int(i) for i in at[wrong][0])
                raise RigError(f"the rig, after {moves} moves: expected cells {what}, got {cell}; {NOISY}")
        return SwarmState.of_cells(self.layout, cells, shared=self.rule == "merge")

    def _check(self, updated: Belief, code: int, after: SwarmState, moves: int) -> None:
        """Refuse positions that do not follow from those before, in a map that has just the cells known to be free."""
        should = pushed(self.layout, updated.open.words, self.state, code, self.rule)
        wrong = should.occupied ^ after.occupied
        if wrong or should != after:
            cell = tuple(int(i) for i in wrong.cells[0]) if wrong else ()
            there = "one there" if not wrong or cell in after.occupied else "none there"
            raise RigError(
                f"the rig, move {moves}: expected every particle to move unless something is in its way, got {there}, "
                f"{cell}, against rule {self.rule}; {NOISY}"
            )


class NoisyTracker:
    """Belief of a mapping, from positions that may be wrong.

    Parameters
    ----------
    shape : tuple of int
    cells : ndarray of int64, shape (n, ndim)
        The first positions; there may be none.
    noise : Noise
    confidence : float

    Attributes
    ----------
    sights : list of ndarray of int64, shape (k, ndim)
        What each scan showed.
    """

    def __init__(self, shape: tuple[int, ...], cells: NDArray[np.int64], noise: Noise, confidence: float) -> None:
        self._layout = GridLayout(shape)
        self._noisy = NoisyBelief(shape, Board.of_cells(self._layout, cells), noise, confidence)
        self._take_over()
        self.start, self.first_frontier, self.sights = self.state.cells, self._noisy.remaining, [cells]

    @property
    def finished(self) -> bool:
        """Whether no frontier cell is left that a particle could get to."""
        return self._noisy.finished

    def blind(self, command: str, steps: int, moves: int) -> list[tuple[int, int, int]]:
        """Take in ``steps`` equal commands without a scan, as `update`: particles may have gone on, and nothing is learnt."""
        for _ in range(steps):
            self._noisy.spread(command)
        self._take_over()
        return [(0, self._noisy.remaining, 0)] * steps

    def update(self, command: str, steps: int, cells: NDArray[np.int64], moves: int) -> list[tuple[int, int, int]]:
        """Take in what a scan after ``steps`` equal commands shows; return (done, frontier, 0) of each.

        How far particles went is not known.
        """
        rows = self.blind(command, steps - 1, moves)
        done = self._noisy.update(command, Board.of_cells(self._layout, cells))
        self.sights.append(cells)
        self._take_over()
        return [*rows, (done, self._noisy.remaining, 0)]

    def _take_over(self) -> None:
        self.belief, self.state = self._noisy.belief, SwarmState(self._noisy.occupied)
