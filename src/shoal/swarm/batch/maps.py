"""Maps of several sizes on boards of one shape: a smaller one lies in the first layers, rows and columns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import Board, GridLayout, Words
from shoal.swarm.maps.workspace import GridWorkspace


class PaddedMaps:
    """The boards of some maps, padded to a common shape.

    Parameters
    ----------
    places : sequence of GridWorkspace
        All of 2 or all of 3 dimensions.

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
        """Words of one board."""
        return self.layout.words[0] * self.layout.words[1]

    def _cut(self, flat: Words, layout: GridLayout) -> Words:
        """Return the part of a padded board, flat, that a smaller layout covers: a view."""
        whole = flat.reshape(self.layout.layers, self.layout.rows, self.layout.words[1])
        return whole[: layout.layers, : layout.rows, : layout.words[1]]

    def padded(self, board: Board, out: Words | None = None) -> Words:
        """Write a board of one of the maps into ``out``, flat, in the common shape."""
        words = np.zeros(self.words, dtype=np.uint64) if out is None else out
        layout = board.layout
        words.fill(0)
        self._cut(words, layout)[...] = board.words.reshape(layout.layers, layout.rows, layout.words[1])
        return words

    def board(self, flat: Words, index: int) -> Board:
        """Return the board of map ``index`` that ``flat`` holds in the common shape: a copy."""
        layout = self.layouts[index]
        return Board(layout, self._cut(flat, layout).reshape(layout.words).copy())

    def lines(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return row and column on the common boards of cells of a map; int64, shape (n, 2)."""
        moved = cells + 1
        if moved.shape[1] == 3:
            return np.stack([moved[:, 0] * self.layout.rows + moved[:, 1], moved[:, 2]], axis=1)
        return moved

    def of_mask(self, mask: NDArray[np.bool_]) -> Words:
        """Return a mask of the cells of a map as a board in the common shape, flat."""
        return self.padded(Board.of_mask(mask))
