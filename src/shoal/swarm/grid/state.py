"""The state of a swarm, what it has found out about the map, and distances between cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_array
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import Board, GridLayout, Words
from shoal.swarm.kernels import moves
from shoal.swarm.maps.workspace import FREE, FRONTIER, OBSTACLE, PARTICLE, UNKNOWN, raster_of


def check_cells(
    cells: ArrayLike, shape: tuple[int, ...], *, what: str, rim: int = 1
) -> NDArray[np.int64]:
    """Check cell coordinates and return them as an int64 array of shape (n, ndim), in row-major
    order.

    Parameters
    ----------
    cells : array_like of int, shape (n, ndim)
        Cells to check. The array of cells may be empty.
    shape : tuple of int
        Shape of the workspace.
    what : str
        Name of the argument in error messages, such as "start".
    rim : int
        Width of the rim around the workspace, in cells. Rim cells are valid.

    Raises
    ------
    InvalidInputError
        Raised if a coordinate is not a whole number, or if a cell lies outside the workspace and
        its rim.
    """
    expected = f"{what}: expected integer cells of shape (n, {len(shape)})"
    array = check_array(cells, expected=expected)
    if array.size == 0 and array.ndim < 3:
        return np.zeros((0, len(shape)), dtype=np.int64)
    if (
        array.ndim != 2
        or array.shape[1] != len(shape)
        or not np.issubdtype(array.dtype, np.integer)
    ):
        raise InvalidInputError(f"{expected}, got {array.dtype} {array.shape}")
    outside = (array < -rim) | (array >= np.array(shape) + rim)
    if outside.any():
        raise InvalidInputError(
            f"{what}: expected cells inside {shape}, got"
            f" {tuple(array[outside.any(axis=1)][0].tolist())}"
        )
    sizes = [size + 2 * rim for size in shape]
    flat = np.sort(np.ravel_multi_index(tuple(array.T.astype(np.int64) + rim), sizes))
    return np.stack(np.unravel_index(flat, sizes), axis=1) - rim


@dataclass(frozen=True, eq=False)
class SwarmState:
    """The state of a swarm: the cells of all particles.

    Parameters
    ----------
    occupied : Board
        Cells that hold at least one particle.
    counts : ndarray of int32, shape ``layout.window``, or None
        Number of particles in each cell under the rule merge, which lets particles share a cell.
        Under the rules block and tilt, ``counts`` is None.
    """

    occupied: Board
    counts: NDArray[np.int32] | None = None

    @classmethod
    def of_cells(cls, layout: GridLayout, cells: NDArray[np.int64], *, shared: bool) -> SwarmState:
        """Return the state of a swarm with particles at ``cells``, an int array of shape (n, ndim).

        Set ``shared`` to true if a cell may hold several particles.
        """
        counts = None
        if shared:
            counts = np.zeros(layout.window, dtype=np.int32)
            np.add.at(counts, tuple(cells.T + 1), 1)
        return cls(Board.of_cells(layout, cells), counts)

    @property
    def n_particles(self) -> int:
        """Number of particles in the swarm."""
        return len(self.occupied) if self.counts is None else int(self.counts.sum())

    @property
    def cells(self) -> NDArray[np.int64]:
        """Cell of each particle in row-major order (int64, shape (n, ndim)). A cell of k particles
        appears k times.
        """
        if self.counts is None:
            return self.occupied.cells
        return np.repeat(np.argwhere(self.counts > 0) - 1, self.counts[self.counts > 0], axis=0)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SwarmState) or self.occupied != other.occupied:
            return False
        if self.counts is None or other.counts is None:
            return self.counts is other.counts
        return np.array_equal(self.counts, other.counts)

    def __hash__(self) -> int:
        return hash((self.occupied, None if self.counts is None else self.counts.tobytes()))


@dataclass(frozen=True)
class Belief:
    """The belief of a task: the known state of each cell.

    Parameters
    ----------
    open : Board
        Cells that are known to be free. In a mapping, these are the cells in which a particle has
        been. In a coverage, these are all free cells.
    known : Board
        All classified cells: cells that are known to be free, and cells that are known to be
        obstacles.
    frontier : Board
        In a mapping, the unknown cells beside known free cells. In a coverage, the target cells
        that no particle has visited; in a gathering, the cells with particles that are not gathered
        yet. A task is complete when its belief has no frontier cells left.

    Notes
    -----
    At the start of a mapping, the rim cells around the workspace are unknown, like all cells
    without a particle. Sources: paper M, section III.B, and docs/concepts/belief.md.
    """

    open: Board
    known: Board
    frontier: Board

    @property
    def obstacles(self) -> Board:
        """The cells that are known to be obstacles, including rim cells outside the workspace."""
        return self.known - self.open

    @property
    def complete(self) -> bool:
        """Whether the belief has no frontier cells left, so that the task is complete."""
        return not self.frontier

    def with_particles(self, cells: Board) -> Belief:
        """Return the belief after particles were put into ``cells``: these cells are
        free, and in a coverage visited.
        """
        known = self.known | cells
        frontier = (cells - self.open).dilated() - known
        return Belief(
            open=self.open | cells, known=known, frontier=(self.frontier - cells) | frontier
        )

    @property
    def states(self) -> NDArray[np.uint8]:
        """The code of each cell of the workspace and its rim: UNKNOWN, FRONTIER, FREE or OBSTACLE
        (uint8).
        """
        states = np.full(self.open.layout.window, UNKNOWN, dtype=np.uint8)
        states[self.known.mask] = OBSTACLE
        states[self.open.mask] = FREE
        states[self.frontier.mask] = FRONTIER
        return states

    def picture(self, occupied: Board) -> NDArray[np.uint8]:
        """Return a picture of the belief and the particles, with one pixel per cell, including the
        rim (uint8, shape (H, W, 3)).
        """
        codes = self.states
        codes[occupied.mask] = PARTICLE
        return raster_of(codes)

    def observed(self, command: str, before: Board, after: Board) -> Belief:
        """Return the belief of a mapping after one push, in which all particles try to move by one
        cell.

        ``before`` and ``after`` are the cells that hold particles before and after the push. The
        push classifies each unknown cell that a particle tries to enter. The cell is free if it
        holds a particle after the push, and otherwise an obstacle.
        """
        entered = before.shifted(command) - self.known
        if not entered:
            return self
        free = entered & after
        known = self.known | entered
        return Belief(self.open | free, known, (self.frontier | free.dilated()) - known)

    def covered(self, after: Board) -> Belief:
        """Return the belief of a coverage after one push. The cells ``after``, which now hold
        particles, leave the frontier.
        """
        return Belief(self.open, self.known, self.frontier - after)


RULE_CODES = {"block": moves.BLOCK, "merge": moves.MERGE, "tilt": moves.TILT}


def pushed(layout: GridLayout, free: Words, state: SwarmState, code: int, rule: str) -> SwarmState:
    """Return the state of the swarm after one push in the direction of the command with the number
    ``code``.
    """
    everything = np.full(free.size, np.uint64(2**64 - 1))
    field = new_field(
        layout,
        free=free.ravel(),
        occupied=state.occupied.words.flatten(),
        known=everything,
        counts=_counts(state),
    )
    moves.push(field, code, RULE_CODES[rule])
    return state_of(layout, field)


def field_of(free: Words, state: SwarmState, belief: Belief) -> moves.Field:
    """Copy a state and a belief into flat arrays for kernels. Kernels change the copies
    in place.
    """
    return new_field(
        state.occupied.layout,
        free=free.ravel(),
        occupied=state.occupied.words.flatten(),
        open=belief.open.words.flatten(),
        known=belief.known.words.flatten(),
        frontier=belief.frontier.words.flatten(),
        counts=_counts(state),
    )


def new_field(
    layout: GridLayout, *, counts: NDArray[np.int32] | None = None, **boards: Words
) -> moves.Field:
    """Return the flat arrays for kernels: the given boards, an empty board for each missing board,
    and working memory.
    """
    block = max(moves.BLOCK_WORDS, layout.words[1])
    work = {name: np.zeros(block, dtype=np.uint64) for name in ("tried", "moving")}
    missing = [
        name for name in ("free", "occupied", "open", "known", "frontier") if name not in boards
    ]
    return moves.Field(
        **boards,
        **dict(zip(missing, empty_boards(layout, len(missing)), strict=True)),
        **work,
        counts=np.zeros((0, 0), dtype=np.int32) if counts is None else counts,
        layers=layout.layers,
        rows=layout.rows,
        width=layout.words[1],
    )


def empty_boards(layout: GridLayout, count: int) -> list[Words]:
    """Return ``count`` empty boards as flat arrays."""
    return [np.zeros(layout.words[0] * layout.words[1], dtype=np.uint64) for _ in range(count)]


def _counts(state: SwarmState) -> NDArray[np.int32] | None:
    """Return the number of particles per cell in the layout of kernels: flat rows, with 64 columns
    for each word.
    """
    if state.counts is None:
        return None
    layout = state.occupied.layout
    rows, words = layout.words
    wide = np.zeros((rows, 64 * words), dtype=np.int32)
    wide[:, : layout.columns] = state.counts.reshape(rows, layout.columns)
    return wide


def board_of(layout: GridLayout, flat: Words) -> Board:
    """Convert a flat array of a kernel to a board."""
    return Board(layout, flat.reshape(layout.words))


def state_of(layout: GridLayout, field: moves.Field) -> SwarmState:
    """Return the state of the swarm that the flat arrays of kernels hold."""
    counts = None
    if field.counts.size:
        counts = field.counts[:, : layout.columns].reshape(layout.window).copy()
    return SwarmState(board_of(layout, field.occupied), counts)
