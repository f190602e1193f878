"""Scans and traces: when the swarm looks, what each command did, and what it cost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer, check_number
from shoal.core.dataclass import dataclass, one_line
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import decode, encode, letters_of
from shoal.swarm.grid.state import SwarmState

Kind = Literal["equal", "doubling", "hyper", "adaptive"]
SCAN_COST, MOVE_COST = 10.0, 1.0
LONGEST = 1_000_000_000
DEAREST = 1e100
# after this number of runs, a run is longer than any map is wide, and grows no further
_LAST_DOUBLING, _LAST_HYPER = 40, 12
AXES = {"l": (-1, -1), "r": (-1, 1), "u": (-2, -1), "d": (-2, 1), "i": (-3, -1), "o": (-3, 1)}
"""Axis and sign of each command's direction. Axis -1 is the last axis of the workspace."""


@dataclass(frozen=True)
class ScanRule:
    """A rule for the number of equal commands before each scan, with the prices of moves and scans.

    Parameters
    ----------
    kind : str
        The kind of the scan rule. "equal": scan after every ``step`` commands. "doubling": scan
        after 1, 2, 4, 8, ... commands in one direction. "hyper": scan after 1, 4, 27, 256, ...
        commands in one direction. "adaptive": scan after the number of commands with the highest
        expected number of classified cells per unit of price. The kind "adaptive" omits scans whose
        outcome is certain.
    step : int
        Number of commands before each scan, for the kind "equal".
    scan_cost, move_cost : float
        Price of one scan and price of one move, in any common unit. Neither price may be negative,
        and at least one price must exceed 0.

    Notes
    -----
    Sources: paper M, section III.A.3, extended to two dimensions, and docs/concepts/scanning.md.

    Examples
    --------
    >>> ScanRule("doubling").cost(moves=100, scans=8)
    180.0
    """

    kind: Kind = "equal"
    step: int = 1
    scan_cost: float = SCAN_COST
    move_cost: float = MOVE_COST

    def __post_init__(self) -> None:
        if self.kind not in {"equal", "doubling", "hyper", "adaptive"}:
            raise InvalidInputError(
                f"scan-every: expected 1 to {LONGEST}, doubling, hyper or adaptive, got"
                f" {str(self.kind)[:80]!r}"
            )
        object.__setattr__(
            self, "step", check_integer(self.step, what="scan_every", least=1, most=LONGEST)
        )
        for name in ("scan_cost", "move_cost"):
            object.__setattr__(
                self, name, check_number(getattr(self, name), what=name, least=0, most=DEAREST)
            )
        if not self.scan_cost + self.move_cost:
            raise InvalidInputError(
                "prices: expected a price above 0 for a scan or a move, got 0 for both"
            )

    @property
    def every(self) -> str:
        """The scan rule as a text: a number of commands, or the kind "doubling", "hyper" or
        "adaptive".
        """
        return str(self.step) if self.kind == "equal" else self.kind

    @property
    def every_move(self) -> bool:
        """Whether the scan rule demands a scan after each command."""
        return self.kind == "equal" and self.step == 1

    def interval(self, streak: int) -> int:
        """Return the number of commands in the next run, after ``streak`` runs in the same
        direction.

        A rule of the kind "adaptive" does not define the number of commands in advance.

        Examples
        --------
        >>> rule = ScanRule("hyper")
        >>> [rule.interval(streak) for streak in range(4)]
        [1, 3, 23, 229]
        """
        if self.kind == "equal":
            return self.step
        if self.kind == "doubling":
            return 1 << max(0, min(streak, _LAST_DOUBLING) - 1)
        i = min(streak, _LAST_HYPER)
        return int((i + 1) ** (i + 1) - (i**i if i else 0))

    def cost(self, *, moves: int, scans: int) -> float:
        """Return the total price of a number of moves and a number of scans."""
        return self.move_cost * moves + self.scan_cost * scans

    @classmethod
    def parse(
        cls, every: str | int, *, scan_cost: float = SCAN_COST, move_cost: float = MOVE_COST
    ) -> ScanRule:
        """Parse the text of a scan rule: a number of commands, "doubling", "hyper" or "adaptive".

        Examples
        --------
        >>> ScanRule.parse("4").step, ScanRule.parse("hyper").kind
        (4, 'hyper')
        """
        kind, step = str(every), 1
        if kind.isascii() and kind.isdigit() and len(kind) <= len(str(LONGEST)):
            kind, step = "equal", int(kind)
        # checked by the class
        return cls(kind, step, scan_cost, move_cost)  # type: ignore[arg-type]


EVERY_MOVE = ScanRule()


def states_of_run(
    before: SwarmState, after: SwarmState, command: str, steps: int
) -> Iterator[SwarmState]:
    """Infer the state after each command of a run of equal commands from the scans before and after
    the run.

    Parameters
    ----------
    before, after : SwarmState
        States that the scans before and after the run show. Under the rule merge, a state includes
        the number of particles per cell.
    command : str
        The command of the run, as a letter.
    steps : int
        Number of commands in the run, at least 1.

    Returns
    -------
    iterator of SwarmState
        The states after command 1, 2, ..., ``steps`` of the run. After the last command that moves
        a particle, each state is ``after`` itself.

    Raises
    ------
    InvalidInputError
        Raised if no run of ``steps`` commands leads from ``before`` to ``after``.

    Notes
    -----
    The function supports the move rules block and merge. The function does not support the rule
    tilt, under which each run has one command.

    Examples
    --------
    >>> from shoal.swarm import GridWorkspace, GridWorld
    >>> world = GridWorld(GridWorkspace([[1, 1, 1, 1, 1]]))
    >>> before, after = world.initial([(0, 0), (0, 2)]), world.initial([(0, 3), (0, 4)])
    >>> [state.cells[:, 1].tolist() for state in states_of_run(before, after, "r", 3)]
    [[1, 3], [2, 4], [3, 4]]
    """
    axis, sign = AXES[command]
    start, end = _by_line(before.cells, axis), _by_line(after.cells, axis)
    distances = (
        sign * (end[:, axis] - start[:, axis]) if start.shape == end.shape else np.array([-1])
    )
    across = np.arange(start.shape[1]) != start.shape[1] + axis
    if start.shape != end.shape or (start[:, across] != end[:, across]).any():
        raise InvalidInputError(
            f"scan: expected every particle in its line after {steps} commands {command!r}, got a"
            " particle in another line"
        )
    if distances.min() < 0 or distances.max() > steps:
        index = int(np.argmax((distances < 0) | (distances > steps)))
        raise InvalidInputError(
            f"scan: expected particles 0 to {steps} cells further after {steps} commands"
            f" {command!r}, got a particle from {tuple(start[index].tolist())} at"
            f" {tuple(end[index].tolist())}"
        )
    return _states(before, after, start, distances * sign, axis, steps)


def _states(
    before: SwarmState,
    after: SwarmState,
    start: NDArray[np.int64],
    displacements: NDArray[np.int64],
    axis: int,
    steps: int,
) -> Iterator[SwarmState]:
    last = int(np.abs(displacements).max())
    for step in range(1, steps + 1):
        if step >= last:
            yield after
            continue
        cells = start.copy()
        cells[:, axis] += np.clip(displacements, -step, step)
        yield SwarmState.of_cells(before.occupied.layout, cells, shared=before.counts is not None)


def _by_line(cells: NDArray[np.int64], axis: int) -> NDArray[np.int64]:
    """Return cells sorted by their line along ``axis``. Cells in the same line are sorted by
    position.
    """
    across = [i for i in range(cells.shape[1]) if i != cells.shape[1] + axis]
    return cells[np.lexsort((cells[:, axis], *(cells[:, i] for i in across)))]


def lengths_and_times(
    trace: Any,
    *,
    scans: int,
    spacing: tuple[float, ...] | None = None,
    move_seconds: float | None = None,
    scan_seconds: float | None = None,
) -> dict[str, Any]:
    """Return the lengths and times of a run, for the results of commands. A quantity that is not
    known is None.

    Parameters
    ----------
    trace : Trace
        Trace of the run.
    scans : int
        Number of scans of the run, including the scan at the start.
    spacing : tuple of float, optional
        Size of a cell along each axis (mm).
    move_seconds, scan_seconds : float, optional
        Time that the apparatus takes for a move and for a scan.

    Returns
    -------
    dict
        ``cell_m`` and ``cell_mm``: size of a cell along each axis (list of float). ``distance_mm``:
        distance that all particles together travelled. ``move_seconds`` and ``scan_seconds``.
        ``apparatus_seconds``: time of all moves and scans.
    """
    distance = None
    if spacing is not None:
        axis_of = np.array([AXES[letter][0] for letter in letters_of(len(spacing))])
        distance = float((trace.travelled * np.array(spacing)[axis_of][trace.commands]).sum())
    timed = move_seconds is not None or scan_seconds is not None
    return {
        "cell_m": None if spacing is None else [size / 1000 for size in spacing],
        "cell_mm": None if spacing is None else list(spacing),
        "distance_mm": distance,
        "move_seconds": move_seconds,
        "scan_seconds": scan_seconds,
        "apparatus_seconds": (
            trace.moves * (move_seconds or 0.0) + scans * (scan_seconds or 0.0) if timed else None
        ),
    }


Row = tuple[int, int, int]
"""The entries (classified, frontier, travelled) of one command in a trace."""


COLUMNS: dict[str, type[np.generic]] = {
    "commands": np.int8,
    "classified": np.int32,
    "frontier": np.int32,
    "travelled": np.int64,
    "scanned": np.bool_,
}
"""The names of a trace's arrays, and the dtype of each array."""


class Trace(NamedTuple):
    """The effect of each command of an episode. Every array of a trace has one entry per command.

    Parameters
    ----------
    commands : ndarray of int8
        Commands as codes 0 to 5. The function `shoal.swarm.grid.board.decode` turns codes into
        letters.
    classified : ndarray of int32
        Number of cells that each command classified. In a coverage, the number of target cells that
        each command covered.
    frontier : ndarray of int32
        Number of frontier cells after each command.
    travelled : ndarray of int64
        Distance that all particles together travelled during each command, in cells.
    scanned : ndarray of bool
        Whether a scan followed each command. The array ``scanned`` has no entry for the scan before
        the first command.
    """

    commands: NDArray[np.int8]
    classified: NDArray[np.int32]
    frontier: NDArray[np.int32]
    travelled: NDArray[np.int64]
    scanned: NDArray[np.bool_]

    def __repr__(self) -> str:
        return one_line(self)

    @classmethod
    def empty(cls, moves: int) -> Trace:
        """Return an empty trace with space for a given number of commands."""
        columns: list[Any] = [np.zeros(moves, kind) for kind in COLUMNS.values()]
        return cls(*columns)

    @classmethod
    def joined(cls, pieces: Iterable[Trace]) -> Trace:
        """Return the concatenation of several traces."""
        columns: list[Any] = [
            np.concatenate(column) for column in zip(cls.empty(0), *pieces, strict=True)
        ]
        return cls(*columns)

    def part(self, first: int, stop: int) -> Trace:
        """Return the part of the trace from command number ``first`` up to, but not including,
        ``stop``.

        The part shares the memory of the trace.
        """
        columns: list[Any] = [column[first:stop] for column in self]
        return Trace(*columns)

    @property
    def moves(self) -> int:
        """Number of commands in the trace."""
        return len(self.commands)

    def difference(self, replayed: Trace) -> str | None:
        """Return one sentence about the first difference between the trace and a replayed trace.
        For equal traces, return None.
        """
        for name in self._fields[1:]:
            mine, theirs = getattr(self, name), getattr(replayed, name)
            if (mine != theirs).any():
                move = int(np.argmax(mine != theirs))
                return (
                    f"{name} differs at move {move + 1}: {mine[move]} stored, {theirs[move]}"
                    " replayed"
                )
        return None


class WithTrace:
    """Base class of objects with a trace, which provides the commands, the number of moves and the
    number of scans.
    """

    trace: Trace

    @cached_property
    def commands(self) -> str:
        """All commands sent, as a text of command letters."""
        return decode(self.trace.commands)

    @property
    def moves(self) -> int:
        """Number of commands sent."""
        return self.trace.moves

    @property
    def scans(self) -> int:
        """Number of scans, including the scan at the start."""
        return 1 + int(np.count_nonzero(self.trace.scanned))


class Placement(NamedTuple):
    """A scan that shows particles elsewhere than the commands would have them, when a drive of a rig
    goes on after an interruption.

    Parameters
    ----------
    move : int
        Number of commands before the scan.
    since : int
        Number of commands whose effect is known. That of the commands after them is not.
    cells : ndarray of int64, shape (n, ndim)
    """

    move: int
    since: int
    cells: NDArray[np.int64]

    def __repr__(self) -> str:
        return one_line(self)


class Recorder:
    """Recorder of a trace. Each call of `add` appends one run of equal commands to the trace.

    Attributes
    ----------
    moves : int
        Number of commands recorded so far.
    idle : int
        Number of runs since the last run that moved a particle or classified a cell.
    last : tuple of int
        Two numbers about the last run of commands: the distance that all particles together
        travelled, in cells, and the number of classified cells.
    """

    def __init__(self) -> None:
        self._letters: list[str] = []
        self._rows: list[Row] = []
        self._scanned: list[bool] = []
        self.moves, self.idle, self.last = 0, 0, (0, 0)

    def add(self, command: str, rows: list[Row], *, scanned: bool) -> None:
        """Add a run of equal commands to the trace. ``scanned`` tells whether a scan followed the
        run.
        """
        self._letters.append(command * len(rows))
        self._rows += rows
        self._scanned += [False] * (len(rows) - 1) + [scanned]
        self.moves += len(rows)
        self.last = sum(row[2] for row in rows), sum(row[0] for row in rows)
        self.idle = 0 if any(self.last) else self.idle + 1

    def extend(self, other: Recorder) -> None:
        """Add all runs of another recorder."""
        self._letters += other._letters
        self._rows += other._rows
        self._scanned += other._scanned
        self.moves += other.moves
        self.idle, self.last = other.idle, other.last

    @property
    def trace(self) -> Trace:
        """The trace of all commands recorded so far."""
        return _trace_of("".join(self._letters), self._rows, self._scanned)

    def newest(self, moves: int) -> Trace:
        """Return a trace of the last run, which had ``moves`` commands."""
        return _trace_of(self._letters[-1], self._rows[-moves:], self._scanned[-moves:])


def _trace_of(letters: str, rows: list[Row], scanned: list[bool]) -> Trace:
    columns = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return Trace(
        commands=encode(letters, ndim=3),
        classified=columns[:, 0].astype(np.int32),
        frontier=columns[:, 1].astype(np.int32),
        travelled=columns[:, 2].copy(),
        scanned=np.array(scanned, dtype=np.bool_),
    )
