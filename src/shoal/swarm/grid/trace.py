"""Trace: the effect of each command of an episode, with one row per command."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import one_line
from shoal.swarm.grid.commands import decode, encode

Row = tuple[int, int, int]
"""The entries (classified, frontier, travelled) of one command in a trace."""


COLUMNS: dict[str, type[np.generic]] = {
    "commands": np.int8, "classified": np.int32, "frontier": np.int32, "travelled": np.int64, "scanned": np.bool_,
}  # fmt: skip
"""The names of a trace's arrays, and the dtype of each array."""


class Trace(NamedTuple):
    """The effect of each command of an episode. Every array of a trace has one entry per command.

    Parameters
    ----------
    commands : ndarray of int8
        Commands as codes 0 to 5. The function `shoal.swarm.grid.commands.decode` turns codes into letters.
    classified : ndarray of int32
        Number of cells that each command classified. In a coverage, the number of target cells that each command covered.
    frontier : ndarray of int32
        Number of frontier cells after each command.
    travelled : ndarray of int64
        Distance that all particles together travelled during each command, in cells.
    scanned : ndarray of bool
        Whether a scan followed each command. The array ``scanned`` has no entry for the scan before the first command.
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
        columns: list[Any] = [np.concatenate(column) for column in zip(cls.empty(0), *pieces, strict=True)]
        return cls(*columns)

    def part(self, first: int, stop: int) -> Trace:
        """Return the part of the trace from command number ``first`` up to, but not including, ``stop``.

        The part shares the memory of the trace.
        """
        columns: list[Any] = [column[first:stop] for column in self]
        return Trace(*columns)

    @property
    def moves(self) -> int:
        """Number of commands in the trace."""
        return len(self.commands)

    def difference(self, replayed: Trace) -> str | None:
        """Return one sentence about the first difference between the trace and a replayed trace. For equal traces, return None."""
        for name in self._fields[1:]:
            mine, theirs = getattr(self, name), getattr(replayed, name)
            if (mine != theirs).any():
                move = int(np.argmax(mine != theirs))
                return f"{name} differs at move {move + 1}: {mine[move]} stored, {theirs[move]} replayed"
        return None


class WithTrace:
    """Base class of objects with a trace, which provides the commands, the number of moves and the number of scans."""

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


class Recorder:
    """Recorder of a trace. Each call of `add` appends one run of equal commands to the trace.

    Attributes
    ----------
    moves : int
        Number of commands recorded so far.
    idle : int
        Number of runs since the last run that moved a particle or classified a cell.
    last : tuple of int
        Two numbers about the last run of commands: the distance that all particles together travelled, in cells, and the number
        of classified cells.
    """

    def __init__(self) -> None:
        self._letters: list[str] = []
        self._rows: list[Row] = []
        self._scanned: list[bool] = []
        self.moves, self.idle, self.last = 0, 0, (0, 0)

    def add(self, command: str, rows: list[Row], *, scanned: bool) -> None:
        """Add a run of equal commands to the trace. ``scanned`` tells whether a scan followed the run."""
        self._letters.append(command * len(rows))
        self._rows += rows
        self._scanned += [False] * (len(rows) - 1) + [scanned]
        self.moves += len(rows)
        self.last = sum(row[2] for row in rows), sum(row[0] for row in rows)
        self.idle = 0 if any(self.last) else self.idle + 1

    @property
    def trace(self) -> Trace:
        """The trace of all commands recorded so far."""
        return _recorded("".join(self._letters), self._rows, self._scanned)

    def newest(self, moves: int) -> Trace:
        """Return a trace of the last run, which had ``moves`` commands."""
        return _recorded(self._letters[-1], self._rows[-moves:], self._scanned[-moves:])


def _recorded(letters: str, rows: list[Row], scanned: list[bool]) -> Trace:
    columns = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return Trace(
        commands=encode(letters, ndim=3),
        classified=columns[:, 0].astype(np.int32),
        frontier=columns[:, 1].astype(np.int32),
        travelled=columns[:, 2].copy(),
        scanned=np.array(scanned, dtype=np.bool_),
    )
