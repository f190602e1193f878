"""What there is to see of many worlds: as boards, as planes of bytes, and one world as the rest of Shoal has it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.checks import shortened
from shoal.errors import InvalidInputError
from shoal.swarm.batch.checks import check_out, check_where
from shoal.swarm.batch.maps import PaddedMaps
from shoal.swarm.batch.threads import share_out
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import GridLayout, Words
from shoal.swarm.grid.commands import letters_of
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.kernels.batches import planes as kernels
from shoal.swarm.kernels.batches.worlds import Worlds

PLANES = ("particles", "free", "obstacles", "frontier", "unknown", "map")
"""What there is to see of a cell: particles (how many, at most 255); known to be free; known to be an obstacle, or beyond the map
where another one is larger; left to do (unknown beside a free one, or not yet covered); not known; truly free, which nobody who
maps may see."""


class Boards(NamedTuple):
    """The boards of all worlds; uint64, shape (worlds, layers x rows, words of a row), to be read only.

    Bits are those of `shoal.swarm.grid.board`; what each board says, those of `shoal.swarm.Belief`.
    """

    occupied: Words
    open: Words
    known: Words
    frontier: Words


class Inspection:
    """The boards of many worlds, and what is seen of them; see `shoal.swarm.batch.WorldBatch`."""

    layout: GridLayout
    maps: NDArray[np.int64]
    threads: int
    _all: NDArray[np.int64]
    _worlds: Worlds
    _padded: PaddedMaps
    _merge: bool
    _noisy: bool

    def __len__(self) -> int:
        return len(self._all)

    def _chosen(self, where: ArrayLike | None) -> NDArray[np.int64]:
        """Return the numbers of the worlds that a mask marks."""
        return self._all if where is None else check_where(where, len(self))

    @property
    def boards(self) -> Boards:
        """The boards themselves; each step writes to them."""
        views = [getattr(self._worlds, name).reshape(len(self), *self.layout.words) for name in Boards._fields]
        for view in views:
            view.flags.writeable = False
        return Boards(*views)

    def state(self, world: int) -> SwarmState:
        """Return where the particles of a world are: a copy."""
        board = self._padded.board(self._worlds.occupied[world], int(self.maps[world]))
        counts = None
        if self._worlds.counts.size:
            whole = self._worlds.counts[world].reshape(self.layout.layers, self.layout.rows, -1)
            counts = whole[: board.layout.layers, : board.layout.rows, : board.layout.columns].reshape(board.layout.window).copy()
        return SwarmState(board, counts)

    def belief(self, world: int) -> Belief:
        """Return what is known of a world: a copy."""
        names, index = ("open", "known", "frontier"), int(self.maps[world])
        return Belief(*(self._padded.board(getattr(self._worlds, name)[world], index) for name in names))

    def planes(
        self, names: Sequence[str] = PLANES[:4], *, where: ArrayLike | None = None, out: NDArray[np.uint8] | None = None
    ) -> NDArray[np.uint8]:
        """Return cells as bytes, one plane after another.

        Parameters
        ----------
        names : sequence of str
            Out of `PLANES`; by default the first four.
        where : array_like of bool, shape (worlds,), optional
            Which worlds; by default all.
        out : ndarray of uint8, C-contiguous, optional
            Is filled and returned; by default a new array.

        Returns
        -------
        ndarray of uint8, shape (worlds, planes, ...)
            The last axes are those of `layout.window`: the rim of one cell is included, as there are cells to classify.

        Raises
        ------
        InvalidInputError
        """
        unknown = [name for name in names if name not in PLANES]
        if unknown or isinstance(names, str):
            raise InvalidInputError(f"planes: expected names out of {', '.join(PLANES)}, got {shortened(names)}")
        chosen = self._chosen(where)
        filled = check_out(out, (len(chosen), len(names), *self.layout.window))
        codes, flat = np.array([PLANES.index(name) for name in names], dtype=np.int64), self.layout.layers * self.layout.rows
        lines = filled.reshape(len(chosen), len(names), flat, self.layout.columns)

        def work(_: int, first: int, last: int) -> None:
            kernels.write_planes(self._worlds, chosen, codes, lines, first, last)

        share_out(work, len(chosen), words=16 * len(names) * self._padded.words, threads=self.threads)
        return filled

    def action_masks(self, *, where: ArrayLike | None = None) -> NDArray[np.int8]:
        """Return which commands can change anything, as far as is known; int8, shape (worlds, commands).

        Under block and tilt that is a command at which some particle's next cell is no known obstacle and holds no particle, under
        merge one at which it is no known obstacle. With noise every command may change something.
        """
        chosen = self._chosen(where)
        masks = np.ones((len(chosen), len(letters_of(self.layout.ndim))), dtype=np.int8)

        def work(_: int, first: int, last: int) -> None:
            kernels.mark_commands(self._worlds, chosen, self._merge, masks, first, last)

        if not self._noisy:
            share_out(work, len(chosen), words=self._padded.words, threads=self.threads)
        return masks
