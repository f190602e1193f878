"""Boards: sets of cells as bits in rows of 64-bit words, the commands that shift them, and random
numbers of trials.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.registry import Registry
from shoal.swarm.maps.workspace import MOST_LINES, text_rows

if TYPE_CHECKING:
    from numpy.random import Generator

LETTERS = "lurdio"
"""The command letters for left, up, right and down. In 3-D, two more letters mean in (towards layer
0) and out.
"""

RULES: Registry[str] = Registry("move rule", open_to_others=False)
RULES.add(
    "block", "a particle stays if the next cell is an obstacle or holds a particle that stays"
)
RULES.add("merge", "particles may share a cell; only obstacles stop them")
RULES.add("tilt", "one command slides every particle until it is stopped")

_CODES = {letter: code for code, letter in enumerate(LETTERS)}


def letters_of(ndim: int) -> str:
    """Return the command letters of a 2-D ("lurd") or 3-D ("lurdio") workspace."""
    return LETTERS[: 2 * ndim]


def offsets_of(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return how much one step in each direction changes the flat array index of a cell, in the
    order of `letters_of`.

    Examples
    --------
    >>> offsets_of((5, 7)).tolist()
    [-1, -7, 1, 7]
    """
    row = shape[-1]
    layer = row * shape[-2]
    return np.array([-1, -row, 1, row, -layer, layer][: 2 * len(shape)], dtype=np.int64)


def encode(commands: str, *, ndim: int = 2) -> NDArray[np.int8]:
    """Convert a text of command letters into an array of codes 0 to 5.

    Parameters
    ----------
    commands : str
        Command letters from ``lurd`` (2-D) or ``lurdio`` (3-D).
    ndim : int
        Number of dimensions of the workspace: 2 or 3.

    Returns
    -------
    ndarray of int8, shape (len(commands),)

    Raises
    ------
    InvalidInputError
        Raised if a letter is not a command. The error message contains the position of the wrong
        letter.

    Examples
    --------
    >>> encode("llurr").tolist()
    [0, 0, 1, 2, 2]
    """
    letters = letters_of(ndim)
    for position, letter in enumerate(commands):
        if letter not in letters:
            raise InvalidInputError(
                f"expected commands out of {letters!r} for a {ndim}-D workspace, got {letter!r} at"
                f" position {position + 1}"
            )
    return np.array([_CODES[letter] for letter in commands], dtype=np.int8)


def decode(codes: NDArray[np.int8]) -> str:
    """Convert an array of codes 0 to 5 into a text of command letters. The function `encode` is the
    inverse of `decode`.

    Examples
    --------
    >>> decode(encode("llurr"))
    'llurr'
    """
    table = np.frombuffer(LETTERS.encode(), dtype=np.uint8)
    return table[np.asarray(codes, dtype=np.intp)].tobytes().decode()


Words = NDArray[np.uint64]
_ONE, _TOP = np.uint64(1), np.uint64(63)


@dataclass(frozen=True)
class GridLayout:
    """The window of cells that all boards of one workspace share.

    Parameters
    ----------
    shape : tuple of int
        Shape of the workspace in cells: (H, W) in 2-D, or (D, H, W) in 3-D.
    """

    shape: tuple[int, ...]

    @property
    def ndim(self) -> int:
        """Number of dimensions of the workspace: 2 or 3."""
        return len(self.shape)

    @cached_property
    def window(self) -> tuple[int, ...]:
        """The shape of the window with its rim, in cells: (H + 2, W + 2) in 2-D, or (D + 2, H + 2,
        W + 2) in 3-D.
        """
        return tuple(size + 2 for size in self.shape)

    @cached_property
    def layers(self) -> int:
        """Number of layers of the window, including the rim layers. In 2-D, the window
        has 1 layer.
        """
        return self.window[0] if self.ndim == 3 else 1

    @property
    def rows(self) -> int:
        """Number of rows in each layer of the window, including the rim."""
        return self.window[-2]

    @property
    def columns(self) -> int:
        """Number of columns of the window, including the rim."""
        return self.window[-1]

    @cached_property
    def words(self) -> tuple[int, int]:
        """The shape (layers x rows, words per row) of a packed board."""
        return self.layers * self.rows, -(-self.columns // 64)

    def pack(self, mask: NDArray[np.bool_]) -> Words:
        """Pack a boolean array of the window's shape into uint64 words, with one bit per cell."""
        flat = mask.reshape(self.layers * self.rows, self.columns)
        padded = np.zeros((flat.shape[0], self.words[1] * 64), dtype=np.bool_)
        padded[:, : self.columns] = flat
        return (
            np.packbits(padded, axis=1, bitorder="little").view("<u8").astype(np.uint64, copy=False)
        )

    def unpack(self, words: Words) -> NDArray[np.bool_]:
        """Unpack ``words`` into a boolean array of the window's shape."""
        packed = np.ascontiguousarray(words, dtype="<u8").view(np.uint8)
        bits = np.unpackbits(packed, axis=1, count=self.columns, bitorder="little")
        return bits.view(np.bool_).reshape(self.window)


@dataclass(frozen=True, eq=False)
class Board:
    """An immutable set of cells, packed into 64-bit words.

    Parameters
    ----------
    layout : GridLayout
        The window of cells that the board can contain.
    words : ndarray of uint64, shape ``layout.words``
        The cells of the board, packed into words. The board does not copy the array ``words``, so
        do not change this array afterwards.

    Notes
    -----
    Cell coordinates refer to the workspace without the rim. In a workspace of H rows and W columns,
    a rim cell has the row -1 or H, or the column -1 or W.

    Examples
    --------
    >>> layout = GridLayout((2, 3))
    >>> board = Board.of_cells(layout, [(0, 0), (0, 1)])
    >>> len(board), (0, 1) in board, (1, 1) in board
    (2, True, False)
    >>> sorted(board.shifted("d") | board)
    [(0, 0), (0, 1), (1, 0), (1, 1)]
    >>> sorted(board.dilated() - board)
    [(-1, 0), (-1, 1), (0, -1), (0, 2), (1, 0), (1, 1)]
    """

    layout: GridLayout
    words: Words

    @classmethod
    def empty(cls, layout: GridLayout) -> Board:
        """Return an empty board."""
        return cls(layout, np.zeros(layout.words, dtype=np.uint64))

    @classmethod
    def full(cls, layout: GridLayout) -> Board:
        """Return a board with all cells of the window, including the rim."""
        return cls(layout, layout.pack(np.ones(layout.window, dtype=np.bool_)))

    @classmethod
    def of_mask(cls, mask: NDArray[np.bool_]) -> Board:
        """Return a board with the True cells of a boolean array, which has the shape of the
        workspace.
        """
        layout = GridLayout(mask.shape)
        return cls(layout, layout.pack(np.pad(mask, 1)))

    @classmethod
    def of_cells(cls, layout: GridLayout, cells: NDArray[Any] | Iterable[tuple[int, ...]]) -> Board:
        """Return a board with the given cells, which are the rows of an int array of shape (n,
        ndim).

        Raises
        ------
        InvalidInputError
            Raised if a cell lies outside the workspace and its rim.
        """
        array = np.asarray(cells if isinstance(cells, np.ndarray) else list(cells), dtype=np.int64)
        array = array.reshape(-1, layout.ndim) + 1
        outside = ((array < 0) | (array >= np.array(layout.window))).any(axis=1)
        if outside.any():
            cell = tuple(int(i) - 1 for i in array[outside][0])
            raise InvalidInputError(f"expected cells inside {layout.shape}, got {cell}")
        mask = np.zeros(layout.window, dtype=np.bool_)
        mask[tuple(array.T)] = True
        return cls(layout, layout.pack(mask))

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """The board as a boolean array of the workspace and its rim."""
        return self.layout.unpack(self.words)

    @property
    def inner(self) -> NDArray[np.bool_]:
        """The board as a boolean array of the workspace, without the rim."""
        return self.mask[(slice(1, -1),) * self.layout.ndim]

    @cached_property
    def cells(self) -> NDArray[np.int64]:
        """The cells of the board in row-major order (int64, shape (n, ndim))."""
        return np.argwhere(self.mask) - 1

    def __len__(self) -> int:
        return int(np.bitwise_count(self.words).sum())

    def __bool__(self) -> bool:
        return bool(self.words.any())

    def __iter__(self) -> Iterator[tuple[int, ...]]:
        return (tuple(cell) for cell in self.cells.tolist())

    def __contains__(self, cell: object) -> bool:
        if not isinstance(cell, tuple) or len(cell) != self.layout.ndim:
            return False
        at = tuple(int(i) + 1 for i in cell)
        inside = all(0 <= i < size for i, size in zip(at, self.layout.window, strict=True))
        return inside and bool(self.mask[at])

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Board)
            and self.layout == other.layout
            and np.array_equal(self.words, other.words)
        )

    def __hash__(self) -> int:
        return hash((self.layout, self.words.tobytes()))

    def __and__(self, other: Board) -> Board:
        return Board(self.layout, self.words & other.words)

    def __or__(self, other: Board) -> Board:
        return Board(self.layout, self.words | other.words)

    def __sub__(self, other: Board) -> Board:
        return Board(self.layout, self.words & ~other.words)

    def __xor__(self, other: Board) -> Board:
        return Board(self.layout, self.words ^ other.words)

    def __le__(self, other: Board) -> bool:
        return not (self - other)

    def shifted(self, command: str) -> Board:
        """Return a board with all cells shifted by one in the direction of ``command``, without
        cells shifted out of the window.
        """
        return Board(
            self.layout,
            shifted_words(self.layout, self.words, command) & _window_words(self.layout),
        )

    def dilated(self) -> Board:
        """Return a board with all cells of the board and their direct neighbours (4 per cell in
        2-D, 6 per cell in 3-D).
        """
        words = self.words.copy()
        for command in letters_of(self.layout.ndim):
            words |= shifted_words(self.layout, self.words, command)
        return Board(self.layout, words & _window_words(self.layout))

    def __str__(self) -> str:
        few = self.layout.layers * self.layout.rows <= MOST_LINES
        return text_rows(self.mask, "x.") if few else repr(self)

    def __repr__(self) -> str:
        return f"<Board of {len(self)} cells in {self.layout.shape}>"


def _window_words(layout: GridLayout) -> Words:
    words = np.full(layout.words[1], np.uint64(2**64 - 1))
    if layout.columns % 64:
        words[-1] = np.uint64(2 ** (layout.columns % 64) - 1)
    return words


def shifted_words(layout: GridLayout, words: Words, command: str) -> Words:
    """Return packed words shifted by one cell in the direction of ``command``. Unused bits at the
    end of a row may become 1.
    """
    out = np.zeros_like(words)
    if command == "l":
        out[:] = words >> _ONE
        out[:, :-1] |= words[:, 1:] << _TOP
        return out
    if command == "r":
        out[:] = words << _ONE
        out[:, 1:] |= words[:, :-1] >> _TOP
        return out
    source = words.reshape(layout.layers, layout.rows, -1)
    target = out.reshape(source.shape)
    if command == "u":
        target[:, :-1] = source[:, 1:]
    elif command == "d":
        target[:, 1:] = source[:, :-1]
    elif command == "i":
        target[:-1] = source[1:]
    elif command == "o":
        target[1:] = source[:-1]
    else:
        raise InvalidInputError(
            f"expected one command out of {letters_of(layout.ndim)!r}, got {command!r}"
        )
    return out


def trial_rng(seed: int, trial: int = 0) -> Generator:
    """Return the random number generator for the start cells, the targets and the policy of a
    trial.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial,)))


def noise_rng(seed: int, trial: int = 0) -> Generator:
    """Return the random number generator for the noise of a trial."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial, 1)))
