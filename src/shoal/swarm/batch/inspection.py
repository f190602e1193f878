"""Observations of many worlds: boards with one bit per cell, planes with one byte per cell, and sums over the particles.

The methods `state` and `belief` of `Inspection` observe a single world.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import shortened
from shoal.core.dataclass import one_line
from shoal.core.errors import InvalidInputError
from shoal.swarm.batch.checks import check_out, check_where
from shoal.swarm.batch.maps import PaddedMaps
from shoal.swarm.batch.threads import share_out
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import GridLayout, Words
from shoal.swarm.grid.commands import letters_of
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.kernels.batches import measures
from shoal.swarm.kernels.batches import planes as kernels
from shoal.swarm.kernels.batches.worlds import Worlds
from shoal.swarm.policies.paths import search_of

PLANES = ("particles", "free", "obstacles", "frontier", "unknown", "map")
"""Names of the planes. Each plane has one value per cell.

The plane "particles" contains the number of particles in each cell, at most 255. Every other plane contains 1 for the cells that
the name of the plane describes, and 0 for all other cells. The plane "free" shows the cells that are known to be free. The plane
"obstacles" shows the cells that are known to be obstacles, and the cells beyond the border of a small map. In a mapping, the plane
"frontier" shows the unknown cells beside known free cells. In a coverage, it shows the target cells that are not yet covered. The
plane "unknown" shows the unclassified cells. The plane "map" shows the true free cells, which a mapping policy must not use.
"""


class Boards(NamedTuple):
    """The boards of all worlds: read-only uint64 arrays of shape (worlds, layers x rows, words per row).

    `shoal.swarm.grid.board` explains the bits of a board. `shoal.swarm.Belief` explains the meaning of each board.
    """

    occupied: Words
    open: Words
    known: Words
    frontier: Words

    def __repr__(self) -> str:
        return one_line(self)


class Measures(NamedTuple):
    """Sums over the particles of each selected world. Each array of sums has one row per selected world.

    In the sums, a cell with more than 255 particles counts as a cell with 255 particles.
    """

    probing: NDArray[np.int64]  # (worlds, commands): number of particles that would enter a frontier cell
    moving: NDArray[np.int64]  # (worlds, commands): number of particles whose next cell may be free and holds no particle
    places: NDArray[np.int64]  # (worlds, ndim): sums of the particles' indices into the planes
    squares: NDArray[np.int64]  # (worlds, ndim): sums of the squares of these indices
    particles: NDArray[np.int64]  # (worlds,): number of particles
    frontier: NDArray[np.int64]  # (worlds,): number of frontier cells
    known: NDArray[np.int64]  # (worlds,): number of cells that are known or frontier cells

    def __repr__(self) -> str:
        return one_line(self)

    @property
    def middle(self) -> NDArray[np.float64]:
        """Mean position of the particles of each world, as indices into the planes (float64, shape (worlds, ndim))."""
        return self.places / np.maximum(self.particles, 1)[:, None]

    @property
    def spread(self) -> NDArray[np.float64]:
        """Standard deviation of the particles' positions along each axis, in cells (float64, shape (worlds, ndim))."""
        mean_square = self.squares / np.maximum(self.particles, 1)[:, None]
        return np.asarray(np.sqrt(np.maximum(mean_square - self.middle**2, 0.0)))


class Inspection:
    """Base class of `shoal.swarm.batch.WorldBatch`: the boards of many worlds, and methods to observe the worlds."""

    layout: GridLayout
    maps: NDArray[np.int64]
    threads: int
    _all: NDArray[np.int64]
    _worlds: Worlds
    _padded: PaddedMaps
    _merge: bool
    _noisy: bool
    _work: Words

    def __len__(self) -> int:
        return len(self._all)

    def _chosen(self, where: ArrayLike | None) -> NDArray[np.int64]:
        """Return the indices of the worlds that the mask ``where`` selects."""
        return self._all if where is None else check_where(where, len(self))

    @property
    def boards(self) -> Boards:
        """Read-only views of the boards of all worlds. Each step of the batch changes the boards."""
        views = [getattr(self._worlds, name).reshape(len(self), *self.layout.words) for name in Boards._fields]
        for view in views:
            view.flags.writeable = False
        return Boards(*views)

    def state(self, world: int) -> SwarmState:
        """Return a copy of the state of one world: the cells of all particles."""
        board = self._padded.board(self._worlds.occupied[world], int(self.maps[world]))
        counts = None
        if self._worlds.counts.size:
            whole = self._worlds.counts[world].reshape(self.layout.layers, self.layout.rows, -1)
            counts = whole[: board.layout.layers, : board.layout.rows, : board.layout.columns].reshape(board.layout.window).copy()
        return SwarmState(board, counts)

    def belief(self, world: int) -> Belief:
        """Return a copy of the belief of one world."""
        names, index = ("open", "known", "frontier"), int(self.maps[world])
        return Belief(*(self._padded.board(getattr(self._worlds, name)[world], index) for name in names))

    def planes(
        self, names: Sequence[str] = PLANES[:4], *, where: ArrayLike | None = None, out: NDArray[np.uint8] | None = None
    ) -> NDArray[np.uint8]:
        """Return planes of the selected worlds: arrays with one byte per cell.

        Parameters
        ----------
        names : sequence of str
            Names of planes from `PLANES`. By default, the method returns the planes "particles", "free", "obstacles" and
            "frontier".
        where : array_like of bool, shape (worlds,), optional
            Mask of the worlds to observe. By default, the method observes all worlds.
        out : ndarray of uint8, C-contiguous, optional
            Array into which the method writes the planes. By default, the method makes a new array.

        Returns
        -------
        ndarray of uint8, shape (worlds, planes, ...)
            The planes of the selected worlds. The last axes have the shape `layout.window`, which includes a rim of one cell,
            because the particles must also classify rim cells.

        Raises
        ------
        InvalidInputError
        """
        codes = _codes_of(names)
        chosen = self._chosen(where)
        filled = check_out(out, (len(chosen), len(names), *self.layout.window))
        lines = filled.reshape(len(chosen), len(names), self.layout.layers * self.layout.rows, self.layout.columns)

        def work(_: int, first: int, last: int) -> None:
            kernels.write_planes(self._worlds, chosen, codes, lines, first, last)

        share_out(work, len(chosen), words=16 * len(names) * self._padded.words, threads=self.threads)
        return filled

    def windows(
        self, names: Sequence[str], centers: NDArray[np.int64], side: int, *, where: ArrayLike | None = None
    ) -> NDArray[np.uint8]:
        """Return planes of a square or cube of cells around one cell of each selected world.

        Cells beyond the map appear as obstacles.

        Parameters
        ----------
        names : sequence of str
            Names of planes from the list `PLANES`.
        centers : ndarray of int64, shape (worlds, ndim)
            Indices, into the planes, of the central cell of each selected world.
        side : int
            Number of cells along each side of the square or cube.
        where : array_like of bool, shape (worlds,), optional
            Mask of the worlds to observe. By default, the method observes all worlds.

        Returns
        -------
        ndarray of uint8, shape (worlds, planes, side, side), or (worlds, planes, side, side, side) in 3-D
        """
        chosen, ndim, codes = self._chosen(where), self.layout.ndim, _codes_of(names)
        filled = np.empty((len(chosen), len(names), *[side] * ndim), dtype=np.uint8)
        cut = filled.reshape(len(chosen), len(names), -1, side, side)
        middles = np.zeros((len(chosen), 3), dtype=np.int64)
        middles[:, 3 - ndim :] = centers

        def work(_: int, first: int, last: int) -> None:
            measures.write_windows(self._worlds, chosen, codes, middles, self.layout.columns, cut, first, last)

        share_out(work, len(chosen), words=side**ndim, threads=self.threads)
        return filled

    def measures(self, *, where: ArrayLike | None = None) -> Measures:
        """Return sums over the particles of each world. The class `Measures` lists the sums."""
        chosen, ndim = self._chosen(where), self.layout.ndim
        shapes = ((len(chosen), 2 * ndim, 2), (len(chosen), 3, 2), (len(chosen), 3))
        commands, axes, totals = (np.zeros(shape, dtype=np.int64) for shape in shapes)

        def work(_: int, first: int, last: int) -> None:
            measures.measure_worlds(self._worlds, chosen, self.layout.columns, commands, axes, totals, first, last)

        share_out(work, len(chosen), words=4 * self._padded.words, threads=self.threads)
        return Measures(
            commands[:, :, measures.PROBING], commands[:, :, measures.MOVING], axes[:, 3 - ndim :, measures.SUM],
            axes[:, 3 - ndim :, measures.SQUARES], *totals.T,
        )  # fmt: skip

    def nearest_frontier(self, *, where: ArrayLike | None = None) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Return the length, first command and last cell of the shortest path from any particle to a frontier cell, for each world.

        Returns
        -------
        ndarray of int64, shape (worlds,)
            Length of the shortest path in each world, in cells. If no path exists, the length is 0.
        ndarray of int64, shape (worlds,)
            Code of the first command of each shortest path.
        ndarray of int64, shape (worlds, ndim)
            Indices, into the planes, of the last cell of each shortest path.
        """
        chosen, searches = self._chosen(where), self._searches
        found = np.zeros((len(chosen), 5), dtype=np.int64)

        def work(thread: int, first: int, last: int) -> None:
            measures.find_nearest(self._worlds, chosen, self._work[thread], searches[thread], found, first, last)

        share_out(work, len(chosen), words=16 * self._padded.words, threads=self.threads)
        return found[:, 0], found[:, 1], found[:, 5 - self.layout.ndim :]

    @cached_property
    def _searches(self) -> list[Any]:
        """Working memory of each thread for the search of shortest paths."""
        size = int(np.prod(self.layout.window))
        return [search_of(self.layout, ties="column-major", neighbours="lurd", plan_size=size) for _ in range(self.threads)]

    def action_masks(self, *, where: ArrayLike | None = None) -> NDArray[np.int8]:
        """Return a mask of the commands that can have an effect, according to the belief of each world.

        The mask is int8 and has the shape (worlds, commands).

        Under the rules block and tilt, a command can have an effect if the next cell of any particle holds no particle and is not a
        known obstacle. Under the rule merge, a command can have an effect if the next cell of any particle is not a known obstacle.
        In an episode with noise, every command may have an effect.
        """
        chosen = self._chosen(where)
        masks = np.ones((len(chosen), len(letters_of(self.layout.ndim))), dtype=np.int8)

        def work(_: int, first: int, last: int) -> None:
            kernels.mark_commands(self._worlds, chosen, self._merge, masks, first, last)

        if not self._noisy:
            share_out(work, len(chosen), words=self._padded.words, threads=self.threads)
        return masks


def _codes_of(names: Sequence[str]) -> NDArray[np.int64]:
    """Return the codes of planes: whole numbers by which kernels identify planes."""
    if isinstance(names, str) or any(name not in PLANES for name in names):
        raise InvalidInputError(f"planes: expected names out of {', '.join(PLANES)}, got {shortened(names)}")
    return np.array([PLANES.index(name) for name in names], dtype=np.int64)
