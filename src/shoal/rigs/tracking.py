"""The particles of a rig in the closed loop: the positions that the rig observes update
the belief.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from functools import reduce
from operator import or_
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import count_text
from shoal.core.errors import InvalidInputError
from shoal.rigs.checks import NOISY, Alarm, AlarmRaised, explain_contradiction
from shoal.rigs.log import DriveLog
from shoal.rigs.monitor import (
    FEW_GHOSTS,
    IMPOSSIBLE,
    NoiseMonitor,
    Rate,
    change_text,
    find_change,
    find_misdeed,
    numbers_in_question,
    weigh_counts,
    with_number,
)
from shoal.rigs.rig import PositionError, Rig
from shoal.swarm.goals import Goal, NoisyVisits
from shoal.swarm.grid.board import Board, GridLayout, encode, letters_of
from shoal.swarm.grid.scans import AXES, Placement, Row, states_of_run
from shoal.swarm.grid.state import Belief, SwarmState, check_cells, pushed
from shoal.swarm.grid.tasks import Mapping
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise import LOSS, Noise, NoisyBelief, padded_shape
from shoal.swarm.simulation.swarms import distance_of_push, newly_classified

Sent = tuple[str, int, NDArray[np.int64] | None]
"""A command, how many times it was sent in a row, and the cells that the scan after it showed, or
None if no scan followed.
"""

QUICK = 2**23  # scans times cells that can be gone through again in about a second


class RigSwarm(ABC):
    """Base class of the swarms that the closed loop controls on a rig.

    Parameters
    ----------
    rig : Rig
    goal : Goal
    first_scan : ndarray of int64, shape (k, ndim)
        The cells in which the first scan shows particles (`observe`).
    inlet : tuple of int, optional
        A cell at which particles may come in.

    Attributes
    ----------
    belief : Belief
        What policies see. Its frontier contains the cells that the particles must still classify or
        visit.
    observed_map : Belief
        What scans have shown of the map. For a task on a known map, the known map where scans have
        shown nothing else.
    sent : list of Sent
        All commands and scans so far.
    state : SwarmState
        Observed or estimated cells of all particles.
    start : ndarray of int64, shape (n, ndim)
        Cells of the particles at the start.
    first_frontier : int
        Number of frontier cells at the start.
    observations : list of ndarray of int64, shape (k, ndim), or None
        For a rig with noise: the cells in which each scan showed particles.
    moves : int
        Number of commands sent to the rig.
    log : DriveLog, optional
        Log to which the object writes all commands and scans.
    moved : bool
        Whether particles were seen to move since the start.
    unproven : int
        Number of cells classified since particles were surely seen to move. If the rig has failed
        meanwhile, these walls are wrong.
    sending, scanning : float
        Time that the rig spent on commands and on scans, in seconds.
    scans : int
        Number of scans, including the scan at the start.
    """

    belief: Belief
    state: SwarmState
    start: NDArray[np.int64]
    first_frontier: int
    observations: list[NDArray[np.int64]] | None = None
    moved: bool = False
    unproven: int = 0
    noisy: NoisyBelief | None = None

    def __init__(
        self,
        rig: Rig,
        goal: Goal,
        first_scan: NDArray[np.int64],
        *,
        inlet: tuple[int, ...] | None = None,
    ) -> None:
        self.inlet = inlet
        self.rig, self.rule, self.layout, self.moves = rig, rig.rule, GridLayout(rig.shape), 0
        self.goal, self.first_scan, self.sent = goal, first_scan, list[Sent]()
        self.log: DriveLog | None = None
        self.sending = self.scanning = 0.0
        self.scans = self.most_seen = 0  # scans, and particles in one of them
        self.placed: list[Placement] = []

    @property
    def observed_map(self) -> Belief:
        """What the scans show of the map."""
        return self.belief

    @property
    @abstractmethod
    def finished(self) -> bool:
        """Whether no frontier cell is left that the particles can classify or visit."""

    @property
    def doubtful(self) -> bool:
        """Whether more cells than the confidence allows were classified while nothing was
        established to move.
        """
        return False

    @property
    @abstractmethod
    def still(self) -> bool | None:
        """Whether it is clear that commands move nothing. None if more commands are
        needed to tell.
        """

    @property
    def needs_proof(self) -> bool:
        """Whether walls rest on commands at which nothing was seen to move."""
        return self.unproven > 0

    @abstractmethod
    def doubts(self) -> list[str]:
        """Return why the evidence for the walls is not enough, in sentences."""

    def check(self) -> None:  # noqa: B027 - without noise, each scan is checked by `update`
        """Raise an alarm if the scans so far contradict the commands."""

    def command_that_moves(self) -> str | None:
        """Return the command that must move most particles, because the cells ahead of them are
        known to be free, or None.
        """
        letters = letters_of(self.layout.ndim)
        best = max(letters, key=self.count_free_ahead)
        return best if self.count_free_ahead(best) else None

    def count_free_ahead(self, letter: str) -> int:
        """Return the number of particles that have a free cell without a particle ahead."""
        occupied = self.state.occupied
        return len((occupied.shifted(letter) & self.belief.open) - occupied)

    @abstractmethod
    def predict(self, command: str, steps: int) -> list[Row] | None:
        """Update the belief after the command was sent ``steps`` times without a scan.

        Return the trace entries of each command, as `update` does. If a scan is necessary, return
        None and leave the belief unchanged.
        """

    @abstractmethod
    def update(self, command: str, steps: int, cells: NDArray[np.int64]) -> list[Row]:
        """Update the belief with ``cells``, the result of a scan after the command was sent
        ``steps`` times.

        Return the trace entries (classified, frontier, travelled) of each command.
        """

    @abstractmethod
    def skip(self, command: str, steps: int) -> list[Row]:
        """Take over that the command was sent ``steps`` times with unknown effect. `place` follows.

        Return the trace entries of each command, as `update` does.
        """

    @abstractmethod
    def place(self, cells: NDArray[np.int64], *, since: int) -> None:
        """Take over a scan that the commands do not explain, as the drive was interrupted: the
        particles are in ``cells`` now. ``since`` is the number of commands whose effect is known.
        """

    def marks(self, *, quick: bool = False) -> list[Alarm]:
        """Return the alarms that mark the result without stopping the drive.

        If ``quick`` is true, as after Ctrl-C, leave out what takes long, and say so in `doubts`.
        """
        return []

    def rates(self) -> dict[str, Rate]:
        """Return the stated and the observed error rates, by name."""
        return {}

    def observe(self) -> NDArray[np.int64]:
        """Return the cells in which the rig observes particles, as the function `observe` does."""
        began = time.perf_counter()
        seen = observe(self.rig, self.moves)
        self.scanning += time.perf_counter() - began
        self.scans += 1
        self.most_seen = max(self.most_seen, len(seen))
        return seen

    def wrong_map(self) -> list[Alarm]:
        """Return the alarm for cells that scans show to be other than in the known map."""
        if self.goal.known is None:
            return []
        free = Board.of_mask(self.goal.known.free)
        walls, opened = self.observed_map.obstacles & free, self.observed_map.open - free
        if not walls and not opened:
            return []
        cells = [
            f"{label} {count_text(len(board), kind)}, such as {tuple(board.cells[0].tolist())}"
            for board, label, kind in (
                (walls, "walls at", "free cell"),
                (opened, "open at", "wall"),
            )
            if board
        ]
        text = f"scans contradict the known map: {'; '.join(cells)}"
        if self.unvisited:
            text += f"; {len(self.unvisited)} of the cells to visit are among them"
        return [Alarm("map", self.moves, text)]

    @property
    def unvisited(self) -> Board:
        """Target cells that were not visited because they turned out to be walls."""
        return Board.empty(self.layout)

    def carry_out(self, command: str, steps: int, *, scan: bool) -> tuple[list[Row], bool]:
        """Send the command ``steps`` times. Observe the particles if ``scan`` is true or the
        outcome is uncertain.

        Return the trace entries of each command, and whether the rig observed the particles.
        """
        for _ in range(steps):
            self.moves += 1
            if self.log is not None:
                self.log.command(self.moves, command)
            began = time.perf_counter()
            self.rig.send(command)
            self.sending += time.perf_counter() - began
        rows = None if scan else self.predict(command, steps)
        if rows is not None:
            self.sent.append((command, steps, None))
            return rows, False
        cells = self.observe()
        if self.log is not None:
            self.log.scan(self.moves, cells)
        self.sent.append((command, steps, cells))
        return self.update(command, steps, cells), True

    def repeat(self, sent: Sent) -> tuple[list[Row], bool]:
        """Take over a command and its scan of which another swarm of the same drive knows."""
        command, steps, cells = sent
        self.moves += steps
        self.sent.append(sent)
        if cells is not None:
            return self.update(command, steps, cells), True
        rows = self.predict(command, steps)
        assert rows is not None
        return rows, False


def observe(rig: Rig, moves: int) -> NDArray[np.int64]:
    """Return the cells in which the rig observes particles after some moves (int64, shape (n,
    ndim)).

    Raises
    ------
    PositionError
        Raised if a position is not a cell of the field of view or of the rim around it.
    """
    seen = rig.observe()
    try:
        return check_cells(seen, rig.shape, what="positions")
    except InvalidInputError as error:
        raise PositionError(f"the rig, after {moves} moves: {error}") from None


class OnRimError(PositionError):
    """Raised if a rig without noise shows a particle in the rim around the field of view."""


class ModelBroken(AlarmRaised):
    """Raised if scans show what no rig without noise can show, such as two particles in one cell
    under the rule block.
    """


class ExactRigSwarm(RigSwarm):
    """The particles of a rig without noise: all positions that the rig reports are correct.

    Raises
    ------
    PositionError
        Raised if the rig observes no particles at the start, or if a position lies outside the
        field of view.
    AlarmRaised
        Raised if the commands cannot explain the change of the positions between two observations.
    """

    def __init__(
        self,
        rig: Rig,
        goal: Goal,
        first_scan: NDArray[np.int64],
        *,
        inlet: tuple[int, ...] | None = None,
    ) -> None:
        super().__init__(rig, goal, first_scan, inlet=inlet)
        self.start = first_scan
        self.state = self._state_at(self.start)
        occupied = self.state.occupied
        self.shown = Belief(open=occupied, known=occupied, frontier=occupied.dilated() - occupied)
        # a task asks where the particles are in the known map: a particle in a wall of it is not
        world = GridWorld(goal.known or GridWorkspace(np.ones(rig.shape, np.bool_)), self.rule)
        inside = SwarmState(occupied & world.free, self.state.counts)
        self._goal = goal.task.begin(world, inside, goal.targets)
        self.belief = self._task_belief()
        self.first_frontier = len(self.belief.frontier)
        self._commands_tried: set[str] = set()
        self.trials = 0

    def _task_belief(self) -> Belief:
        """Return the belief of the task, corrected by what scans have shown."""
        if isinstance(self.goal.task, Mapping):
            return self.shown
        goal, shown = self._goal, self.shown
        if self.goal.mapping:
            return goal
        walls = shown.obstacles
        return Belief(
            (goal.open | shown.open) - walls, goal.known | shown.known, goal.frontier - walls
        )

    @property
    def observed_map(self) -> Belief:
        """What the scans show of the map, or the known map as scans have changed it."""
        return self.shown if self.goal.mapping else self.belief

    @property
    def unvisited(self) -> Board:
        """Target cells that were not visited because they turned out to be walls."""
        if self.goal.mapping:
            return Board.empty(self.layout)
        return self._goal.frontier & self.shown.obstacles

    @property
    def finished(self) -> bool:
        """Whether the belief has no frontier cells left."""
        return self.belief.complete and not self.unvisited

    @property
    def still(self) -> bool | None:
        """Whether all directions were tried and nothing moved."""
        return (
            False
            if self.moved
            else True
            if len(self._commands_tried) == 2 * self.layout.ndim
            else None
        )

    def doubts(self) -> list[str]:
        """Return which walls rest on commands at which nothing was seen to move."""
        text = (
            f"{cells_classified(self.unproven)} by the last commands, at which nothing was seen to"
            " move"
        )
        return [text] if self.needs_proof else []

    def predict(self, command: str, steps: int) -> list[Row] | None:
        """Update the belief without a scan if no particle tries to enter an unknown cell.

        If a particle tries to enter an unknown cell, a scan is necessary: return None.
        """
        state, code = self.state, self._code(command)
        for _ in range(self._pushes(steps)):
            if state.occupied.shifted(command) - self.shown.known:
                return None
            before, state = (
                state,
                pushed(self.layout, self.shown.open.words, state, code, self.rule),
            )
            if state == before:
                break
        return self._take_over(command, steps, state)

    def update(self, command: str, steps: int, cells: NDArray[np.int64]) -> list[Row]:
        """Update the belief with a scan after the command was sent ``steps`` times.

        Raises
        ------
        AlarmRaised
            Raised if the commands cannot explain the change of the observed positions.
        """
        inlet = np.array(self.inlet if self.inlet else (-9,) * self.layout.ndim)
        if len(cells) == self.state.n_particles + 1 and (cells == inlet).all(axis=1).any():
            # the particle in the cell of the inlet came in after the commands
            came_in = int(np.flatnonzero((cells == inlet).all(axis=1))[0])
            rows = self.update(command, steps, np.delete(cells, came_in, axis=0))
            self.place(cells, since=self.moves)
            return rows
        after = self._state_at(cells)
        moved, n_known = after != self.state, len(self.shown.known)
        able = self._count_free_ahead(self.shown.open, command) > 0
        rows = self._take_over(command, steps, after)
        self._commands_tried.add(command)
        self.trials += able
        if moved:
            self.moved, self.unproven = True, 0
        else:
            self.unproven += len(self.shown.known) - n_known
        return rows

    def skip(self, command: str, steps: int) -> list[Row]:
        """Take over that the command was sent ``steps`` times with unknown effect: learn nothing."""
        self.moves += steps
        self.sent.append((command, steps, None))
        return [(0, len(self.belief.frontier), 0)] * steps

    def place(self, cells: NDArray[np.int64], *, since: int) -> None:
        """Take over a scan that the commands do not explain: particles are in ``cells`` now."""
        self.placed.append(Placement(self.moves, since, cells))
        self.state = self._state_at(cells)
        occupied = self.state.occupied
        self.shown = self.shown.with_particles(occupied)
        if not isinstance(self.goal.task, Mapping):
            self._goal = self._goal.with_particles(occupied & self._goal.open)
        self.belief = self._task_belief()

    @property
    def needs_proof(self) -> bool:
        """Whether a mapping rests on walls from commands at which nothing was seen to move."""
        return self.unproven > 0 and self.goal.mapping

    def _take_over(self, command: str, steps: int, after: SwarmState) -> list[Row]:
        """Update state and belief, both or neither, and return the trace entries."""
        try:
            states = list(states_of_run(self.state, after, command, self._pushes(steps)))
        except InvalidInputError as error:
            raise self._contradiction(after, command, steps, str(error)) from None
        before, snapshot, rows = self.state, (self.state, self.shown, self._goal), []
        for state in states:
            believed = self._task_belief()
            learnt = self.shown.observed(command, before.occupied, state.occupied)
            wrong = self._wrong(learnt, self._code(command), before, state)
            if wrong is not None:
                self.state, self.shown, self._goal = snapshot
                raise self._contradiction(after, command, steps, wrong)
            self.shown = learnt
            if not isinstance(self.goal.task, Mapping):
                self._goal = self.goal.task.update(
                    self._goal, command, before.occupied, state.occupied
                )
            now = self._task_belief()
            classified = (
                newly_classified(believed, now)
                if self.goal.mapping
                else len(believed.frontier - now.frontier)
            )
            rows.append((classified, len(now.frontier), distance_of_push(before, state, command)))
            before = state
        self.state, self.belief = before, self._task_belief()
        if self.rule == "tilt":  # one command
            return [(sum(row[0] for row in rows), rows[-1][1], sum(row[2] for row in rows))]
        return rows

    def _contradiction(
        self, after: SwarmState, command: str, steps: int, otherwise: str
    ) -> AlarmRaised:
        details: dict[str, Any] = {
            "free": self.shown.open,
            "move": self.moves,
            "otherwise": otherwise,
        }
        return AlarmRaised(
            explain_contradiction(self.state, after, command, self._pushes(steps), **details)
        )

    def _code(self, command: str) -> int:
        return int(encode(command, ndim=self.layout.ndim)[0])

    def _pushes(self, steps: int) -> int:
        return steps if self.rule != "tilt" else max(self.layout.window)

    def _state_at(self, cells: NDArray[np.int64]) -> SwarmState:
        where = f"the rig, after {self.moves} moves"
        if len(cells) == 0:
            if self.moves:
                text = (
                    f"move {self.moves}: {self.state.n_particles} particles before, none now: the"
                    " particles were lost or not seen"
                )
                raise AlarmRaised(Alarm("number", self.moves, f"{text}; {NOISY}"))
            raise PositionError(f"{where}: expected the cells of particles, got none")
        outside = ((cells < 0) | (cells >= np.array(self.layout.shape))).any(axis=1)
        if outside.any():
            cell = tuple(cells[outside][0].tolist())
            raise OnRimError(
                f"{where}: expected cells inside {self.layout.shape}, got {cell}; {NOISY}"
            )
        # the cells are sorted
        twice = (cells[1:] == cells[:-1]).all(axis=1) & (self.rule != "merge")
        if twice.any():
            cell = tuple(cells[1:][twice][0].tolist())
            text = (
                f"move {self.moves}: rule {self.rule} has one particle in a cell, but two are seen"
                f" in {cell}, as of particles smaller than half a cell"
            )
            raise ModelBroken(Alarm("rule", self.moves, text))
        return SwarmState.of_cells(self.layout, cells, shared=self.rule == "merge")

    def count_free_ahead(self, letter: str) -> int:
        """Return the number of particles that have a free cell without a particle ahead, of the
        cells that scans have shown to be free.
        """
        return self._count_free_ahead(self.shown.open, letter)

    def _count_free_ahead(self, free: Board, letter: str) -> int:
        occupied = self.state.occupied
        return len((occupied.shifted(letter) & free) - occupied)

    def _wrong(
        self, belief: Belief, code: int, before: SwarmState, after: SwarmState
    ) -> str | None:
        """Return why a state does not follow from the state before it and the known free cells, or
        None if it follows.
        """
        should = pushed(self.layout, belief.open.words, before, code, self.rule)
        wrong = should.occupied ^ after.occupied
        if not wrong and should == after:
            return None
        cell = tuple(int(i) for i in wrong.cells[0]) if wrong else ()
        got = (
            f"{'a' if cell in after.occupied else 'no'} particle at {cell}"
            if wrong
            else "other numbers of particles in cells"
        )
        return f"expected every particle to move as rule {self.rule} requires, got {got}"


class NoisyRigSwarm(RigSwarm):
    """The particles of a rig with noise: positions that the rig reports may be wrong.

    Parameters
    ----------
    rig : Rig
    goal : Goal
    first_scan : ndarray of int64, shape (k, ndim)
    noise : Noise
    confidence : float

    Attributes
    ----------
    monitor : NoiseMonitor
        What the scans say about the stated noise.

    Raises
    ------
    AlarmRaised
        Raised if the scans contradict the commands beyond what the stated noise explains.
    """

    noisy: NoisyBelief
    observations: list[NDArray[np.int64]]

    def __init__(
        self,
        rig: Rig,
        goal: Goal,
        first_scan: NDArray[np.int64],
        noise: Noise,
        confidence: float,
        *,
        inlet: tuple[int, ...] | None = None,
    ) -> None:
        super().__init__(rig, goal, first_scan, inlet=inlet)
        cells = first_scan
        seen = Board.of_cells(self.layout, cells)
        self.noisy = goal.noisy(seen, noise, confidence, rule=self.rule)
        self.monitor = NoiseMonitor(rig.shape, noise)
        self.monitor.count(cells)
        self._confidence, self._shown, self.counted = confidence, False, True
        self._classified = dict.fromkeys(letters_of(self.layout.ndim), 0)  # cells, by command
        self._recent = 0  # cells classified since motion was last established
        self._once_free = Board.empty(self.layout)
        self._sent: list[tuple[str, bool]] = []  # all commands, and whether a scan followed
        self._newest: NDArray[np.int64] | None = cells  # a scan since the last command
        self._take_over()
        self.observations = [cells]
        self.usual = False  # whether nobody has stated the error rates
        self.start, self.first_frontier = self.state.cells, self.noisy.remaining

    @property
    def finished(self) -> bool:
        """Whether every cell that a particle may still enter is classified, or every target cell
        visited.
        """
        return self.noisy.finished

    @property
    def unvisited(self) -> Board:
        """Target cells that were not visited because they turned out to be walls."""
        if not isinstance(self.noisy, NoisyVisits):
            return Board.empty(self.layout)
        return self.noisy.unvisited & self.noisy.belief.obstacles

    @property
    def doubtful(self) -> bool:
        """Whether more cells than the confidence allows were classified while nothing was
        established to move.

        Or by a command that was never seen to move a particle, although the map has room for it.
        """
        if self.unproven > self._allowed:
            return True
        unshown, once = self.unshown, self._once_free
        # room that has been seen once counts: particles that stay make a wall of a free cell
        return any(once.shifted(letter) & once for letter in unshown)

    @property
    def _allowed(self) -> float:
        """Number of cells that may be wrong according to the confidence."""
        return (1 - self._confidence) * len(self.belief.known)

    @property
    def unshown(self) -> list[str]:
        """Commands that classified more cells than the confidence allows, but were never seen to
        move a particle.
        """
        return [
            letter
            for letter, cells in self._classified.items()
            if cells > self._allowed and not self.monitor.shows_motion(letter)
        ]

    @property
    def needs_proof(self) -> bool:
        """Whether the evidence for the walls is not enough."""
        return self.doubtful

    def doubts(self) -> list[str]:
        """Return why the evidence for the walls is not enough."""
        doubts = []
        if not self.counted:
            doubts.append(
                "Ctrl-C left no time to see whether the number of particles changed, and whether"
                " all commands were carried out"
            )
        if not self.moved:
            return doubts
        if unshown := self.unshown:
            text = (
                f"no particle was surely seen to move at command {' or '.join(map(repr, unshown))},"
                " from which walls were inferred"
            )
            return [text, *doubts]
        if self.doubtful:
            text = (
                f"{cells_classified(self.unproven)} while nothing was seen to move, more than the"
                " confidence allows: the magnets do nothing any more, the camera shows an old"
                " picture, or no particle has room to move"
            )
            return [text, *doubts]
        return doubts

    @property
    def still(self) -> bool | None:
        """Whether commands move nothing: false once scans show motion, true if enough commands
        should have shown it.
        """
        if self.moved or self.monitor.along:
            return False
        noise, rounds = self.noisy.noise, self.moves // (2 * self.layout.ndim)
        expected = (
            rounds
            * (1 - noise.slip)
            * ((1 - noise.miss) * (1 - noise.misplace)) ** 2
            * self._singles
        )
        doubt = float(np.sqrt(np.trace(self.monitor.variance)))
        enough = rounds >= 3 and expected > 8 * doubt + 2
        return True if enough and np.trace(self.monitor.advance) < expected / 4 else None

    @property
    def _singles(self) -> int:
        """Number of detections in the first scan without a detection beside it. In a round of all
        directions, each must move.
        """
        seen = Board.of_cells(self.layout, self.first_scan)
        beside = (seen.shifted(letter) for letter in letters_of(self.layout.ndim))
        crowded = reduce(or_, beside)
        return max(1, len(seen - crowded))

    def command_that_moves(self) -> str | None:
        """Return the command that must move most particles, because the cells ahead of them are
        known to be free, or None.

        A command that was not seen to move particles comes first. If no particle has room for it,
        other commands make room.
        """
        letters = letters_of(self.layout.ndim)
        for letter in self.unshown:
            back = next(
                other for other in letters if AXES[other] == (AXES[letter][0], -AXES[letter][1])
            )
            for choice in (letter, back, letters[self.moves % len(letters)]):
                if self.count_free_ahead(choice):
                    return choice
        return super().command_that_moves()

    def predict(self, command: str, steps: int) -> list[Row]:
        """Update the estimated positions of the particles after ``steps`` commands without a scan.
        Do not classify any cell.
        """
        for _ in range(steps):
            self.noisy.spread(command)
            self._newest = None
        self._sent += [(command, False)] * steps
        self._take_over()
        return [(0, self.noisy.remaining, 0)] * steps

    def update(self, command: str, steps: int, cells: NDArray[np.int64]) -> list[Row]:
        """Update the belief with a scan after the command was sent ``steps`` times. Report 0 as the
        unknown travelled distance.
        """
        rows = self.predict(command, steps - 1)
        self._sent.append((command, True))
        if self._newest is not None:
            inside = self.noisy.state.inside.reshape(padded_shape(self.layout.shape))
            self.monitor.compare(command, self._newest, cells, inside, self._once_free.mask)
        classified = self.noisy.update(command, Board.of_cells(self.layout, cells))
        self.observations.append(cells)
        self._newest = cells
        self._take_over()
        shown = self.monitor.count(cells)
        self._shown = self._shown or shown
        self.moved = self.moved or (self._shown and self.monitor.along)
        # a motion somewhere in a series of scans proves the cells classified before the series, but
        # not those after the motion
        self._classified[command] += classified
        self._recent += classified
        self.unproven = self._recent if shown else self.unproven + classified
        self._recent = 0 if shown else self._recent
        if not self.goal.mapping:  # cells in which particles were seen rest on no motion
            self._classified[command] = self._recent = self.unproven = 0
        return [*rows, (classified, self.noisy.remaining, 0)]

    def skip(self, command: str, steps: int) -> list[Row]:
        """Take over that the command was sent ``steps`` times with unknown effect."""
        self.moves += steps
        self.sent.append((command, steps, None))
        return self.predict(command, steps)

    def place(self, cells: NDArray[np.int64], *, since: int) -> None:
        """Take over a scan that the commands do not explain: particles are about ``cells`` now."""
        self.noisy.place(Board.of_cells(self.layout, cells))
        self._newest = cells
        self._take_over()
        self.placed.append(Placement(self.moves, since, cells))

    def check(self) -> None:
        """Raise an alarm if the scans so far contradict the commands."""
        alarm = self.monitor.contradiction(self.moves)
        if alarm is not None:
            raise AlarmRaised(alarm)

    def marks(self, *, quick: bool = False) -> list[Alarm]:
        """Return the alarms that mark the result: rates far from the stated ones, drift, another
        number of particles.
        """
        rates = self.rates()
        marks = [
            mark
            for mark in self.monitor.marks(self.moves)
            # that a rig makes fewer errors than any rig might make is no reason to doubt the map
            if not (self.usual and mark.kind == "rates" and not any_too_low(rates, mark.text))
        ]
        if not self.state.occupied:
            text = (
                "no particle is left that scans show: every cell that is still unclassified"
                " stays so"
            )
            return [Alarm("number", self.moves, text), *marks]
        work = len(self.observations) * int(np.prod(padded_shape(self.layout.shape)))
        self.counted = not quick or work <= QUICK
        if self.counted and self.monitor.contradiction(self.moves) is None:
            marks += self._review()
        return marks

    def _review(self) -> list[Alarm]:
        """Return the alarm for what all scans together say about the number of particles, or about
        the commands. Each of the two may look like the other, so that the stronger evidence counts.

        If an alarm has stopped the drive, it explains more than the review, which assumes that most
        commands were carried out.
        """
        counts = np.array([len(cells) for cells in self.observations])
        if any((cells[1:] == cells[:-1]).all(axis=1).any() for cells in self.observations):
            change = find_change(weigh_counts(counts), counts, ghosts=True)  # several in one cell
        else:
            numbers = numbers_in_question(counts, self.noisy.noise.miss)
            change = find_change(
                {n: self._weigh_number(n) for n in numbers},
                counts,
                ghosts=self.monitor.ghosts > FEW_GHOSTS,
            )
        deeds = self._weigh_deeds()
        if self.monitor.leap_alone:  # a command twice, also as one that came late
            deeds[:, 4] = np.where(deeds[:, 4] == deeds[:, 2], IMPOSSIBLE, deeds[:, 4])
            deeds[:, 2] = IMPOSSIBLE
        misdeed = find_misdeed(deeds)
        if change is not None and change[1] > change[0] and self.inlet is not None:
            change = None  # particles came in
        if change is not None and (misdeed is None or misdeed.evidence < change[2]):
            return [Alarm("number", self.moves, change_text(*change[:2]))]
        return [] if misdeed is None else [Alarm(misdeed.kind, self.moves, misdeed.text)]

    def _weigh_deeds(self) -> NDArray[np.float64]:
        """Go through all scans once more, as if the map had been known from the start. Return for
        each scan after the first what `NoisyBelief.weigh_deeds` returns.
        """
        deeds: list[NDArray[np.float64]] = []
        for belief, command, before, seen in self._replay_scans(LOSS):
            deeds.append(belief.weigh_deeds(command, before, seen))
            belief.update(command, seen)
        return np.array(deeds).reshape(-1, 5)

    def _weigh_number(self, number: int) -> NDArray[np.float64]:
        """Go through all scans once more, as if the map had been known from the start, and the
        number of particles, too. Return the log-likelihood of each scan after the first.
        """
        likelihoods = []
        for belief, command, _, seen in self._replay_scans(0.0, number):
            likelihoods.append(belief.weigh_scan(command, seen))
            belief.update(command, seen)
            with_number(belief.state.inside, number)
        return np.array(likelihoods)

    def _replay_scans(
        self, loss: float, number: int | None = None
    ) -> Iterator[tuple[NoisyBelief, str, str, Board]]:
        """Yield for each scan after the first: the belief before its command, in which the map is
        that of the end; the command; the command before it; and what the scan shows.
        """
        seen = Board.of_cells(self.layout, self.first_scan)
        options: dict[str, Any] = {"loss": loss, "rule": self.rule}
        belief = NoisyBelief(self.layout.shape, seen, self.noisy.noise, self._confidence, **options)
        belief.state.logit[:] = self.noisy.state.logit
        if number is not None:
            belief.assume_number(number)
            with_number(belief.state.inside, number)
        scans, before = iter(self.observations[1:]), ""
        for move, (command, scanned) in enumerate(self._sent):
            for _, _, cells in (placement for placement in self.placed if placement.move == move):
                belief.place(Board.of_cells(self.layout, cells))
                belief.state.logit[:] = self.noisy.state.logit
                before = ""
            if scanned:
                yield belief, command, before, Board.of_cells(self.layout, next(scans))
                belief.state.logit[:] = self.noisy.state.logit
            else:
                belief.spread(command)
            before = command

    def rates(self) -> dict[str, Rate]:
        """Return the stated and the observed error rates, by name."""
        return self.monitor.rates()

    def _take_over(self) -> None:
        self.belief, self.state = self.noisy.belief, SwarmState(self.noisy.occupied)
        self._once_free = self._once_free | self.noisy.confirmed


def any_too_low(rates: dict[str, Rate], text: str) -> bool:
    """Return whether the rate that an alarm is about was stated too low."""
    return any(text.startswith(f"{name}:") and rate.too_low for name, rate in rates.items())


def cells_classified(number: int) -> str:
    """Return "1 cell was classified" or "7 cells were classified"."""
    return f"{number} {'cell was' if number == 1 else 'cells were'} classified"
