"""Simulation of thousands of worlds at once in compiled code, so that programs can learn policies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_integer, shortened
from shoal.core.dataclass import one_line
from shoal.core.errors import InvalidInputError
from shoal.core.random import world_generators
from shoal.core.version import count_processors
from shoal.swarm.grid.board import LETTERS, Board, GridLayout, Words, encode, letters_of, trial_rng
from shoal.swarm.grid.paths import search_of
from shoal.swarm.grid.scans import Trace
from shoal.swarm.grid.state import RULE_CODES, Belief, SwarmState
from shoal.swarm.grid.tasks import check_reachable
from shoal.swarm.kernels import batches as kernels
from shoal.swarm.kernels.batches import Starts, Steps, Worlds, begin_worlds, step_worlds
from shoal.swarm.kernels.moves import BLOCK_WORDS
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.simulation.compiled import is_compiled
from shoal.swarm.simulation.swarms import begin_swarm

__all__ = ["PLANES", "Boards", "WorldBatch"]

ALIKE = ("rule", "task", "slip", "misplace", "miss", "confidence")
"""Names of the problem fields that must be equal in all problems of a batch."""

SEEDS = 2**31
"""Upper limit (exclusive) of the random seeds for later episodes."""

LARGEST = 2**62  # of the whole numbers that a caller gives

SMALLEST = 1 << 16
"""Minimum number of board words, of 64 cells each, for which an additional thread saves time: about
40 µs of work. Its call takes 30 µs of the processor.
"""

PLANES = ("particles", "free", "obstacles", "frontier", "unknown", "map")
"""Names of the planes. Each plane has one value per cell.

The plane "particles" contains the number of particles in each cell, at most 255. Every other plane
contains 1 for the cells that the name of the plane describes, and 0 for all other cells. The plane
"free" shows the cells that are known to be free. The plane "obstacles" shows the cells that are
known to be obstacles, and the cells beyond the border of a small map. In a mapping, the plane
"frontier" shows the unknown cells beside known free cells. In a coverage, it shows the target cells
that are not yet covered. The plane "unknown" shows the unclassified cells. The plane "map" shows
the true free cells, which a mapping policy must not use.
"""


class Boards(NamedTuple):
    """The boards of all worlds: read-only uint64 arrays of shape (worlds, layers x rows, words per
    row).

    `shoal.swarm.grid.board` explains the bits of a board. `shoal.swarm.Belief` explains the meaning
    of each board.
    """

    occupied: Words
    open: Words
    known: Words
    frontier: Words

    def __repr__(self) -> str:
        return one_line(self)


class Measures(NamedTuple):
    """Sums over the particles of each selected world. Each array of sums has one row per selected
    world.

    In the sums, a cell with more than 255 particles counts as a cell with 255 particles.
    """

    # (worlds, commands): number of particles that would enter a frontier cell
    probing: NDArray[np.int64]
    # (worlds, commands): number of particles whose next cell may be free and holds no particle
    moving: NDArray[np.int64]
    places: NDArray[np.int64]  # (worlds, ndim): sums of the particles' indices into the planes
    squares: NDArray[np.int64]  # (worlds, ndim): sums of the squares of these indices
    particles: NDArray[np.int64]  # (worlds,): number of particles
    frontier: NDArray[np.int64]  # (worlds,): number of frontier cells
    known: NDArray[np.int64]  # (worlds,): number of cells that are known or frontier cells

    def __repr__(self) -> str:
        return one_line(self)

    @property
    def middle(self) -> NDArray[np.float64]:
        """Mean position of the particles of each world, as indices into the planes (float64, shape
        (worlds, ndim)).
        """
        return self.places / np.maximum(self.particles, 1)[:, None]

    @property
    def spread(self) -> NDArray[np.float64]:
        """Standard deviation of the particles' positions along each axis, in cells (float64, shape
        (worlds, ndim)).
        """
        mean_square = self.squares / np.maximum(self.particles, 1)[:, None]
        return np.asarray(np.sqrt(np.maximum(mean_square - self.middle**2, 0.0)))


class WorldBatch:
    """Many simulated worlds that advance together in compiled code.

    World i starts like ``shoal.run(problem, seed=seed + i)``. The behaviour of a world depends on
    the world's own seed, but not on the number of worlds or threads.

    Parameters
    ----------
    problem : SwarmProblem, or sequence of them
        One problem for all worlds, or several problems. With several problems, each episode draws
        one problem at random. All problems of a batch must have equal values of the fields rule,
        task, slip, misplace, miss and confidence. The boards of all worlds are padded to a common
        shape. The batch ignores the policy of a problem.
    worlds : int
        Number of worlds.
    seed : int, sequence of int, or None
        Seeds of the first episodes. The method `reset` explains the argument ``seed``.
    threads : int, optional
        Maximum number of threads. The default is one thread per processor.

    Attributes
    ----------
    problems : list of SwarmProblem
    layout : GridLayout
        The window of cells of all boards and planes, including a rim of one cell.
    moves, limits : ndarray of int64, shape (worlds,)
        ``moves`` is the number of commands sent in the current episode of each world, and
        ``limits`` is the maximum number of commands. Each step and each reset writes to the arrays
        ``moves`` and ``limits``.
    frontier : ndarray of int32, shape (worlds,)
        Number of frontier cells in the belief of each world.
    complete, terminated, truncated : ndarray of bool, shape (worlds,)
        ``complete`` is true for a world whose task is done. ``terminated`` is true for a world
        without frontier cells. With noise, ``terminated`` equals ``complete``: as in `shoal.run`, a
        world without frontier cells continues until every cell that particles may enter is
        classified, and no wall may hide more than the confidence allows. ``truncated`` is true for
        a world whose episode reached its maximum number of commands before.
    seeds, maps : ndarray of int64, shape (worlds,)
        ``seeds`` contains the seed of each world's current episode, and ``maps`` contains the index
        of each world's current problem.

    Raises
    ------
    InvalidInputError
        Raised if a batch does not support a problem, or if the problems cannot share a batch.

    Notes
    -----
    Each world needs memory for four boards (64 cells per word of 8 bytes), 68 further bytes, and
    1.3 kB for its random generator. The four boards of a world take 4.5 kB for the map vessels:1000
    and 14.5 kB for the map vessels:5000. Under the rule merge, each world needs 4 more bytes per
    cell. Worlds with noise or with a third-party task advance one after the other in the slower
    code of `shoal.run`. The page docs/how-to/batches.md explains batches.

    Examples
    --------
    >>> batch = WorldBatch(SwarmProblem("line:9", particles=3), worlds=4)
    >>> rng = np.random.default_rng(1)
    >>> while not batch.complete.all():
    ...     trace = batch.step(rng.integers(4, size=4), where=~batch.complete)
    >>> batch.moves.tolist()
    [114, 37, 34, 108]
    >>> batch.planes(["particles", "frontier"]).shape
    (4, 2, 3, 11)
    """

    def __init__(
        self,
        problem: SwarmProblem | Sequence[SwarmProblem],
        worlds: int,
        *,
        seed: int | Sequence[int | None] | None = 0,
        threads: int | None = None,
    ) -> None:
        self.problems = [problem] if isinstance(problem, SwarmProblem) else list(problem)
        check_problems(self.problems)
        count = check_integer(worlds, what="worlds", least=1)
        self.threads = (
            count_processors()
            if threads is None
            else check_integer(threads, what="threads", least=1)
        )
        first = self.problems[0]
        self._setups = [problem.setup for problem in self.problems]
        self._compiled = first.noise is None and is_compiled(self._setups[0].task)
        self._noisy = first.noise is not None
        self._padded = PaddedMaps([setup.workspace for setup in self._setups])
        self.layout = self._padded.layout
        rows, width = self.layout.words
        boards = {
            name: np.zeros((count, self._padded.words), dtype=np.uint64) for name in Boards._fields
        }
        cells = (rows, 64 * width) if first.rule == "merge" else (0, 0)
        self.maps, self.seeds = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        self._worlds = Worlds(
            free=self._padded.free,
            inside=self._padded.inside,
            map_of=self.maps,
            **boards,
            counts=np.zeros((count, *cells), dtype=np.int32),
            layers=self.layout.layers,
            rows=self.layout.rows,
            columns=self.layout.columns,
            width=width,
            rule=RULE_CODES[first.rule],
            mapping=self._setups[0].mapping,
        )
        kinds = (np.int8, np.int32, np.int32, *[np.int64] * 3, *[np.bool_] * 3)
        self._steps = Steps(*(np.zeros(count, kind) for kind in kinds))
        self._work = np.zeros((self.threads, 2, max(BLOCK_WORDS, width)), dtype=np.uint64)
        self._scratch = [(work,) for work in self._work]
        self._swarms: list[Any] = [None] * count
        self._rngs: list[Generator] = []
        self.moves, self.limits = self._steps.moves, self._steps.limits
        self.frontier = self._steps.frontier
        self.complete, self.terminated, self.truncated = self._steps[-3:]
        self._all, self._once = np.arange(count), np.ones(count, dtype=np.int64)
        self.reset(seed=seed)

    def __repr__(self) -> str:
        return (
            f"<WorldBatch: {len(self)} worlds of {self.layout.shape},"
            f" {np.count_nonzero(self.terminated | self.truncated)} ended>"
        )

    def __len__(self) -> int:
        return len(self._all)

    @property
    def memory(self) -> int:
        """Size of all arrays of the batch in bytes, including working memory."""
        own = (self.seeds, self._work, self._all, self._once)
        return sum(array.nbytes for array in (*self._worlds[:8], *self._steps, *own))

    def reset(
        self,
        where: ArrayLike | None = None,
        *,
        seed: int | Sequence[int | None] | None = None,
        maps: ArrayLike | None = None,
    ) -> None:
        """Start a new episode in each selected world: choose one of the problems, and place the
        particles.

        Parameters
        ----------
        where : array_like of bool, shape (worlds,), optional
            Mask of the worlds to reset. By default, the method resets all worlds.
        seed : int, or sequence of int or None, one per world, optional
            Seed of the new episodes: world i gets the seed ``seed + i``, or the i-th entry of a
            sequence of seeds. A world without a seed draws a seed from its own random generator.
            The seed of an episode also determines the world's random generator, and therefore the
            seeds of the world's later episodes.
        maps : array_like of int, optional
            Index of the problem for each world, or one index for all worlds. By default, each world
            draws a problem at random.

        Raises
        ------
        InvalidInputError
            Raised if an argument is invalid. A call that raises an error changes no world.
        """
        worlds = self._chosen(where)
        if not worlds.size:
            return
        rngs = world_generators(seed, worlds, len(self), self._rngs)
        seeds = [own if own is not None else int(rng.integers(SEEDS)) for own, rng in rngs]
        if maps is None:
            numbers = [int(rng.integers(len(self.problems))) for _, rng in rngs]
        else:
            numbers = check_numbers(
                maps, worlds, len(self), what="maps", least=0, below=len(self.problems)
            ).tolist()
        starts = [
            self._setups[number].draw_start(trial_rng(own))
            for number, own in zip(numbers, seeds, strict=True)
        ]
        if self._compiled:
            swarms: list[Any] = [None] * len(worlds)
            boards = self._first_boards(numbers, starts)
        else:
            swarms = [
                begin_swarm(self._setups[number], *start, own)
                for number, start, own in zip(numbers, starts, seeds, strict=True)
            ]
        if not self._rngs:
            self._rngs = [rng for _, rng in rngs]
        self.maps[worlds], self.seeds[worlds] = numbers, seeds
        self._steps.limits[worlds] = [self.problems[number].max_moves for number in numbers]
        for world, swarm, (_, rng) in zip(worlds.tolist(), swarms, rngs, strict=True):
            self._swarms[world], self._rngs[world] = swarm, rng
        if self._compiled:
            self._share(begin_worlds, worlds, self._steps, boards, scratch=self._scratch)
            return
        for column in self._steps[1:5]:
            column[worlds] = 0
        self._steps.commands[worlds] = -1
        self._show(worlds)

    def step(
        self, commands: ArrayLike | str, *, repeat: ArrayLike = 1, where: ArrayLike | None = None
    ) -> Trace:
        """Send one command, or a run of equal commands, to each selected world, and scan each
        selected world afterwards.

        An episode that starts without frontier cells ends with its first command.

        Parameters
        ----------
        commands : array_like of int, shape (worlds,), or str
            One command per world, as a letter of ``lurd`` (``lurdio`` in 3-D), or as the index of a
            letter in ``lurd`` (``lurdio``).
        repeat : array_like of int, optional
            Number of equal commands before the scan: one number for all worlds, or one number per
            world. A run ends early if the episode reaches its maximum number of commands.
        where : array_like of bool, shape (worlds,), optional
            Mask of the worlds that get a command. By default, all worlds get a command.

        Returns
        -------
        Trace
            One row per world, with the total effect of the world's commands. Each later step or
            reset overwrites the arrays of the trace.

        Raises
        ------
        InvalidInputError
            Raised if the number of commands differs from the number of worlds, if a command is
            invalid, or if the episode of a selected world has ended. A call that raises an error
            changes no world.
        """
        steps, worlds, ndim = self._steps, self._chosen(where), self.layout.ndim
        numbers = encode(commands, ndim=ndim) if isinstance(commands, str) else commands
        codes = check_numbers(
            numbers, worlds, len(self), what="commands", least=0, below=2 * ndim, single=False
        )
        ended = self.terminated | self.truncated
        if np.count_nonzero(ended):  # quicker than any()
            ended_worlds = worlds[(ended & (self.moves > 0))[worlds]]
            if len(ended_worlds):
                raise InvalidInputError(
                    f"step: expected worlds whose episodes are running, got world"
                    f" {ended_worlds[0]}, whose episode has ended (reset the world or leave it out"
                    " with where)"
                )
        if isinstance(repeat, int) and repeat == 1:
            times = self._once[: len(worlds)]
        else:
            times = check_numbers(repeat, worlds, len(self), what="repeat", least=1).astype(
                np.int64
            )
            times = np.minimum(times, np.maximum(steps.limits[worlds] - steps.moves[worlds], 1))
        if worlds is self._all:
            steps.commands[:] = codes
        else:
            steps.commands[:], steps.classified[:], steps.travelled[:] = -1, 0, 0
            steps.commands[worlds] = codes
        if self._compiled:
            self._share(step_worlds, worlds, steps, times, scratch=self._scratch)
        else:
            self._carry_out(worlds, times)
        return Trace(*steps[:4], steps.commands >= 0)

    @property
    def boards(self) -> Boards:
        """Read-only views of the boards of all worlds. Each step of the batch changes
        the boards.
        """
        views = [
            getattr(self._worlds, name).reshape(len(self), *self.layout.words)
            for name in Boards._fields
        ]
        for view in views:
            view.flags.writeable = False
        return Boards(*views)

    def state(self, world: int) -> SwarmState:
        """Return a copy of the state of one world: the cells of all particles."""
        board = self._padded.board(self._worlds.occupied[world], int(self.maps[world]))
        counts = None
        if self._worlds.counts.size:
            padded = self._worlds.counts[world].reshape(self.layout.layers, self.layout.rows, -1)
            counts = (
                padded[: board.layout.layers, : board.layout.rows, : board.layout.columns]
                .reshape(board.layout.window)
                .copy()
            )
        return SwarmState(board, counts)

    def belief(self, world: int) -> Belief:
        """Return a copy of the belief of one world."""
        names, index = ("open", "known", "frontier"), int(self.maps[world])
        return Belief(
            *(self._padded.board(getattr(self._worlds, name)[world], index) for name in names)
        )

    def planes(
        self,
        names: Sequence[str] = PLANES[:4],
        *,
        where: ArrayLike | None = None,
        out: NDArray[np.uint8] | None = None,
    ) -> NDArray[np.uint8]:
        """Return planes of the selected worlds: arrays with one byte per cell.

        Parameters
        ----------
        names : sequence of str
            Names of planes from `PLANES`. By default, the method returns the planes "particles",
            "free", "obstacles" and "frontier".
        where : array_like of bool, shape (worlds,), optional
            Mask of the worlds to observe. By default, the method observes all worlds.
        out : ndarray of uint8, C-contiguous, optional
            Array into which the method writes the planes. By default, the method makes a new array.

        Returns
        -------
        ndarray of uint8, shape (worlds, planes, ...)
            The planes of the selected worlds. The last axes have the shape `layout.window`, which
            includes a rim of one cell, because the particles must also classify rim cells.
        """
        codes = _codes_of(names)
        worlds = self._chosen(where)
        filled = check_out(out, (len(worlds), len(names), *self.layout.window))
        lines = filled.reshape(
            len(worlds), len(names), self.layout.layers * self.layout.rows, self.layout.columns
        )
        self._share(kernels.write_planes, worlds, codes, lines, boards=7 * len(names))
        return filled

    def windows(
        self,
        names: Sequence[str],
        centers: NDArray[np.int64],
        side: int,
        *,
        where: ArrayLike | None = None,
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
        ndarray of uint8, shape (worlds, planes, side, side), or (worlds, planes, side, side, side)
        in 3-D
        """
        worlds, ndim, codes = self._chosen(where), self.layout.ndim, _codes_of(names)
        filled = np.empty((len(worlds), len(names), *[side] * ndim), dtype=np.uint8)
        cells = filled.reshape(len(worlds), len(names), -1)
        middles = np.zeros((len(worlds), 3), dtype=np.int64)
        middles[:, 3 - ndim :] = centers
        share = side**ndim / self._padded.words
        self._share(kernels.write_windows, worlds, codes, middles, side, cells, boards=share)
        return filled

    def measures(self, *, where: ArrayLike | None = None, commands: bool = True) -> Measures:
        """Return sums over the particles of each world. The class `Measures` lists the sums.

        If ``commands`` is false, the sums for each command are left out.
        """
        worlds, ndim = self._chosen(where), self.layout.ndim
        count = 2 * ndim if commands else 0
        shapes = ((len(worlds), count, 2), (len(worlds), 3, 2), (len(worlds), 3))
        probes, axes, totals = (np.zeros(shape, dtype=np.int64) for shape in shapes)
        self._share(kernels.measure_worlds, worlds, probes, axes, totals, boards=4)
        return Measures(
            probes[:, :, kernels.PROBING],
            probes[:, :, kernels.MOVING],
            axes[:, 3 - ndim :, kernels.SUM],
            axes[:, 3 - ndim :, kernels.SQUARES],
            *totals.T,
        )

    def nearest_frontier(
        self, *, where: ArrayLike | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Return the length, first command and last cell of the shortest path from any particle to
        a frontier cell, for each world.

        Returns
        -------
        ndarray of int64, shape (worlds,)
            Length of the shortest path in each world, in cells. If no path exists, the length is 0.
        ndarray of int64, shape (worlds,)
            Code of the first command of each shortest path.
        ndarray of int64, shape (worlds, ndim)
            Indices, into the planes, of the last cell of each shortest path.
        """
        worlds = self._chosen(where)
        nearest = np.zeros((len(worlds), 5), dtype=np.int64)
        self._share(kernels.find_nearest, worlds, nearest, boards=16, scratch=self._searches)
        return nearest[:, 0], nearest[:, 1], nearest[:, 5 - self.layout.ndim :]

    def action_masks(self, *, where: ArrayLike | None = None) -> NDArray[np.int8]:
        """Return a mask of the commands that can have an effect, according to the belief of each
        world.

        The mask is int8 and has the shape (worlds, commands).

        Under the rules block and tilt, a command can have an effect if the next cell of any
        particle holds no particle and is not a known obstacle. Under the rule merge, a command can
        have an effect if the next cell of any particle is not a known obstacle. In an episode with
        noise, every command may have an effect.
        """
        worlds = self._chosen(where)
        masks = np.ones((len(worlds), len(letters_of(self.layout.ndim))), dtype=np.int8)
        if not self._noisy:
            self._share(kernels.mark_commands, worlds, masks)
        return masks

    def _chosen(self, where: ArrayLike | None) -> NDArray[np.int64]:
        """Return the indices of the worlds that the mask ``where`` selects."""
        return self._all if where is None else check_where(where, len(self))

    def _first_boards(self, numbers: list[int], starts: list[Any]) -> Starts:
        """Return the start cells and the target cells of new episodes."""
        cells = [self._padded.lines(start) for start, _ in starts]
        targets = np.zeros((0, 0), dtype=np.uint64)
        if not self._worlds.mapping:
            targets = np.zeros((len(starts), self._padded.words), dtype=np.uint64)
            for row, number, (start, target_cells) in zip(targets, numbers, starts, strict=True):
                place = self._setups[number].workspace
                check_reachable(place, start, target_cells)
                row[:] = (
                    self._padded.free[number]
                    if target_cells is place.free
                    else self._padded.of_mask(target_cells)
                )
        ends = np.cumsum([len(start) for start in cells], dtype=np.int64)
        return Starts(np.concatenate(cells), ends, targets)

    def _carry_out(self, worlds: NDArray[np.int64], times: NDArray[np.int64]) -> None:
        """Send commands to worlds that the kernels do not support, one world after the other."""

        def work(_: int, first: int, last: int) -> None:
            for world, steps in zip(
                worlds[first:last].tolist(), times[first:last].tolist(), strict=True
            ):
                rows, _scanned = self._swarms[world].carry_out(
                    LETTERS[self._steps.commands[world]], steps, scan=True
                )
                columns = np.array(rows, dtype=np.int64).T
                self._steps.classified[world] = columns[0].sum()
                self._steps.travelled[world] = columns[2].sum()
                self._steps.moves[world] += steps
            self._show(worlds[first:last])

        share_out(work, len(worlds), words=64 * self._padded.words, threads=self.threads)

    def _show(self, worlds: NDArray[np.int64]) -> None:
        """For worlds that the kernels do not support, copy the boards and the status to the arrays
        of the batch.
        """
        steps = self._steps
        for world in worlds.tolist():
            swarm = self._swarms[world]
            belief = swarm.belief
            boards = (swarm.state.occupied, belief.open, belief.known, belief.frontier)
            for name, board in zip(Boards._fields, boards, strict=True):
                self._padded.padded(board, getattr(self._worlds, name)[world])
            if swarm.state.counts is not None:
                layout, padded = swarm.state.occupied.layout, self._worlds.counts[world]
                padded[:] = 0
                window = padded.reshape(self.layout.layers, self.layout.rows, -1)[
                    : layout.layers, : layout.rows, : layout.columns
                ]
                window[...] = swarm.state.counts.reshape(window.shape)
            steps.frontier[world] = len(swarm.belief.frontier)
            steps.complete[world] = bool(swarm.finished)
            steps.terminated[world] = steps.complete[world] or (
                not self._noisy and steps.frontier[world] == 0
            )
            steps.truncated[world] = (
                not steps.terminated[world] and steps.moves[world] >= steps.limits[world]
            )

    def _share(
        self,
        kernel: Any,
        worlds: NDArray[np.int64],
        *arguments: Any,
        boards: float = 1,
        scratch: Sequence[tuple[Any, ...]] | None = None,
    ) -> None:
        """Run a kernel on the selected worlds, in several threads.

        The work for a world is that for ``boards`` of its boards. ``scratch`` contains working
        memory for each thread.
        """

        def work(thread: int, first: int, last: int) -> None:
            own = () if scratch is None else scratch[thread]
            kernel(self._worlds, worlds, *own, *arguments, first, last)

        words = int(boards * self._padded.words)
        share_out(work, len(worlds), words=words, threads=self.threads)

    @cached_property
    def _searches(self) -> list[tuple[Any, ...]]:
        """Working memory of each thread for the search of shortest paths."""
        size = int(np.prod(self.layout.window))
        return [
            (work, search_of(self.layout, ties="column-major", neighbours="lurd", plan_size=size))
            for work in self._work
        ]


class PaddedMaps:
    """Boards of several maps, padded to a common shape.

    Parameters
    ----------
    places : sequence of GridWorkspace
        The maps. Either all maps must be 2-D, or all maps must be 3-D.
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
        """Return a view of the part of a flat padded board that the window of a smaller
        map covers.
        """
        board = flat.reshape(self.layout.layers, self.layout.rows, self.layout.words[1])
        return board[: layout.layers, : layout.rows, : layout.words[1]]

    def padded(self, board: Board, out: Words | None = None) -> Words:
        """Copy the board of one map into ``out``, a flat board of the common shape."""
        words = np.zeros(self.words, dtype=np.uint64) if out is None else out
        layout = board.layout
        words.fill(0)
        self._cut(words, layout)[...] = board.words.reshape(
            layout.layers, layout.rows, layout.words[1]
        )
        return words

    def board(self, flat: Words, index: int) -> Board:
        """Return a copy of the board of map number ``index``, cut out of the padded flat board
        ``flat``.
        """
        layout = self.layouts[index]
        return Board(layout, self._cut(flat, layout).reshape(layout.words).copy())

    def lines(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the rows and the columns of a map's cells on boards of the common shape (int64,
        shape (n, 2)).

        The rows of a 3-D board are numbered over all layers.
        """
        padded = cells + 1
        if padded.shape[1] == 3:
            return np.stack([padded[:, 0] * self.layout.rows + padded[:, 1], padded[:, 2]], axis=1)
        return padded

    def of_mask(self, mask: NDArray[np.bool_]) -> Words:
        """Convert a mask of a map's cells to a flat board of the common shape."""
        return self.padded(Board.of_mask(mask))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="shoal-batch")


def share_out(
    work: Callable[[int, int, int], None], count: int, *, words: int, threads: int
) -> None:
    """Divide ``range(count)`` into parts, and call ``work(thread, first, last)`` for each part, in
    several threads.

    Parameters
    ----------
    work : callable
        Function that processes the worlds from ``first`` to ``last`` - 1. The result for a world
        must not depend on the division of the worlds into parts.
    count : int
        Number of worlds.
    words : int
        Number of board words per world. For worlds of few words, the function uses fewer threads
        than for worlds of many words.
    threads : int
        Maximum number of threads.
    """
    parts = max(1, min(threads, count, count * words // SMALLEST))
    if parts == 1:
        work(0, 0, count)
        return
    ends = [count * index // parts for index in range(parts + 1)]
    futures = [
        _pool(threads).submit(work, index, ends[index], ends[index + 1])
        for index in range(parts - 1)
    ]
    try:
        work(parts - 1, ends[parts - 1], count)
    finally:
        wait(futures)
    for future in futures:
        future.result()


def check_problems(problems: list[SwarmProblem]) -> None:
    """Refuse problems that Shoal cannot simulate in one batch."""
    if not problems or not all(isinstance(problem, SwarmProblem) for problem in problems):
        raise InvalidInputError(
            f"problem: expected a SwarmProblem, or several, got {shortened(problems)}"
        )
    first = problems[0]
    for problem in problems:
        problem.check_at_place()
        for name in ALIKE:
            mine, theirs = getattr(first, name), getattr(problem, name)
            if mine != theirs:
                raise InvalidInputError(
                    f"problems: expected the same {name} in all of them, got {shortened(mine)} and"
                    f" {shortened(theirs)}"
                )


def check_out(out: Any, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return the array ``out`` after checking its dtype and shape. If ``out`` is None, return a new
    uint8 array.
    """
    if out is None:
        return np.empty(shape, dtype=np.uint8)
    valid = isinstance(out, np.ndarray) and out.dtype == np.uint8 and out.shape == shape
    if not valid or not out.flags.c_contiguous or not out.flags.writeable:
        description = f"{out.dtype} {out.shape}" if isinstance(out, np.ndarray) else shortened(out)
        if valid:
            description += (
                ", which is not contiguous"
                if not out.flags.c_contiguous
                else ", which cannot be written to"
            )
        raise InvalidInputError(
            f"out: expected a C-contiguous array of uint8 {shape}, got {description}"
        )
    filled: NDArray[np.uint8] = out
    return filled


def check_where(where: Any, count: int) -> NDArray[np.int64]:
    """Return the indices of the worlds that the mask ``where`` selects."""
    mask = np.asarray(where)
    if mask.dtype != np.bool_ or mask.shape != (count,):
        raise InvalidInputError(
            f"where: expected {count} booleans, one per world, got {mask.dtype} {mask.shape}"
        )
    return mask.nonzero()[0]


def check_numbers(
    values: Any,
    worlds: NDArray[np.int64],
    count: int,
    *,
    what: str,
    least: int,
    below: int = LARGEST,
    single: bool = True,
) -> NDArray[np.integer[Any]]:
    """Return one whole number for each selected world. If ``single`` is true, one number may stand
    for all worlds.

    ``worlds`` contains the indices of the selected worlds. The check ignores the numbers of worlds
    that are not selected.
    """
    numbers = np.asarray(values)
    if numbers.dtype.kind not in "iu" or not (
        (single and numbers.ndim == 0) or numbers.shape == (count,)
    ):
        raise InvalidInputError(
            f"{what}: expected {count} whole numbers, one per world, got {numbers.dtype}"
            f" {numbers.shape}"
        )
    if numbers.ndim == 0:
        numbers = np.full(len(worlds), numbers)
    elif len(worlds) < count:
        numbers = numbers[worlds]
    if len(worlds) and not least <= numbers.min() <= numbers.max() < below:
        index = int(np.argmax((numbers < least) | (numbers >= below)))
        expected = f"{least} to {below - 1}" if below < LARGEST else f"{least} or more"
        raise InvalidInputError(
            f"{what}: expected {expected}, got {numbers[index]} for world {worlds[index]}"
        )
    return numbers


def _codes_of(names: Sequence[str]) -> NDArray[np.int64]:
    """Return the codes of planes: whole numbers by which kernels identify planes."""
    if isinstance(names, str) or any(name not in PLANES for name in names):
        raise InvalidInputError(
            f"planes: expected names out of {', '.join(PLANES)}, got {shortened(names)}"
        )
    return np.array([PLANES.index(name) for name in names], dtype=np.int64)
