"""Maps of different sizes, stored on boards (sets of cells) of a common shape.

A map that is smaller than the common shape occupies the first layers, rows and columns of a board.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import Board, GridLayout, Words
from shoal.swarm.maps.workspace import GridWorkspace


class PaddedMaps:
    """Boards of several maps, padded to a common shape.

    Parameters
    ----------
    places : sequence of GridWorkspace
        The maps. Either all maps must be 2-D, or all maps must be 3-D.

    Raises
    ------
    InvalidInputError
    """

    def __init__(self, places: Sequence[GridWorkspace]) -> None:
        if len({place.ndim for place in places}) != 1:
            raise InvalidInputError("maps: expected all of 2 dimensions or all of 3, got both")
        self.layouts = [GridLayout(place.shape) for place in places]
        shape = tuple(max(sizes) for sizes in zip(*(place.shape for place in places), strict=True))
        self.layout = GridLayout(shape)
        self.free = np.stack([self.of_mask(place.free) for place in places])
        self.inside = np.stack([self.padded(Board.full(layout)) for layout in self.layouts])

    @property
    def words(self) -> int:
        """Number of uint64 words in one board of the common shape."""
        return self.layout.words[0] * self.layout.words[1]

    def _cut(self, flat: Words, layout: GridLayout) -> Words:
        """Return a view of the part of a flat padded board that the window of a smaller map covers."""
        whole = flat.reshape(self.layout.layers, self.layout.rows, self.layout.words[1])
        return whole[: layout.layers, : layout.rows, : layout.words[1]]

    def padded(self, board: Board, out: Words | None = None) -> Words:
        """Copy the board of one map into ``out``, a flat board of the common shape."""
        words = np.zeros(self.words, dtype=np.uint64) if out is None else out
        layout = board.layout
        words.fill(0)
        self._cut(words, layout)[...] = board.words.reshape(layout.layers, layout.rows, layout.words[1])
        return words

    def board(self, flat: Words, index: int) -> Board:
        """Return a copy of the board of map number ``index``, cut out of the padded flat board ``flat``."""
        layout = self.layouts[index]
        return Board(layout, self._cut(flat, layout).reshape(layout.words).copy())

    def lines(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the rows and the columns of a map's cells on boards of the common shape (int64, shape (n, 2)).

        The rows of a 3-D board are numbered over all layers.
        """
        moved = cells + 1
        if moved.shape[1] == 3:
            return np.stack([moved[:, 0] * self.layout.rows + moved[:, 1], moved[:, 2]], axis=1)
        return moved

    def of_mask(self, mask: NDArray[np.bool_]) -> Words:
        """Convert a mask of a map's cells to a flat board of the common shape."""
        return self.padded(Board.of_mask(mask))
