"""WorldBatch: many simulated worlds that advance together. In each step, every world gets its own command."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_integer, world_generators
from shoal.core.errors import InvalidInputError
from shoal.swarm.batch.checks import check_numbers, check_problems
from shoal.swarm.batch.inspection import Boards, Inspection
from shoal.swarm.batch.maps import PaddedMaps
from shoal.swarm.batch.threads import processors, share_out
from shoal.swarm.grid.commands import LETTERS, encode
from shoal.swarm.grid.fields import RULE_CODES
from shoal.swarm.grid.randomness import trial_rng
from shoal.swarm.grid.tasks import check_reachable
from shoal.swarm.grid.trace import Trace
from shoal.swarm.kernels.batches.worlds import Steps, Worlds, begin_worlds, step_worlds
from shoal.swarm.kernels.dynamics.moves import BLOCK_WORDS
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.simulation.compiled import is_compiled
from shoal.swarm.simulation.starts import draw_start, swarm_of

SEEDS = 2**31
"""Upper limit (exclusive) of the random seeds for later episodes."""


class WorldBatch(Inspection):
    """Many simulated worlds that advance together in compiled code.

    World i starts like ``shoal.run(problem, seed=seed + i)``. The behaviour of a world depends on the world's own seed, but not on
    the number of worlds or threads.

    Parameters
    ----------
    problem : SwarmProblem, or sequence of them
        One problem for all worlds, or several problems. With several problems, each episode draws one problem at random. All
        problems of a batch must have equal values of the fields rule, task, slip, misplace, miss and confidence. The boards of all
        worlds are padded to a common shape. The batch ignores the policy of a problem.
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
        ``moves`` is the number of commands sent in the current episode of each world, and ``limits`` is the maximum number of
        commands. Each step and each reset writes to the arrays ``moves`` and ``limits``.
    frontier : ndarray of int32, shape (worlds,)
        Number of frontier cells in the belief of each world.
    complete, terminated, truncated : ndarray of bool, shape (worlds,)
        ``complete`` is true for a world whose task is done. ``terminated`` is true for a world without frontier cells. With noise,
        ``terminated`` equals ``complete``: as in `shoal.run`, a world without frontier cells continues until every cell that
        particles may enter is classified, and no wall may hide more than the confidence allows. ``truncated`` is true for a world
        whose episode reached its maximum number of commands before.
    seeds, maps : ndarray of int64, shape (worlds,)
        ``seeds`` contains the seed of each world's current episode, and ``maps`` contains the index of each world's current
        problem.

    Raises
    ------
    InvalidInputError
        Raised if a batch does not support a problem, or if the problems cannot share a batch.

    Notes
    -----
    Each world needs memory for four boards (64 cells per word of 8 bytes), 68 further bytes, and 1.3 kB for its random generator.
    The four boards of a world take 4.5 kB for the map vessels:1000 and 14.5 kB for the map vessels:5000. Under the rule merge, each
    world needs 4 more bytes per cell. Worlds with noise or with a third-party task advance one after the other in the slower code
    of `shoal.run`. The page docs/how-to/batches.md explains batches.

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
        self.threads = processors() if threads is None else check_integer(threads, what="threads", least=1)
        first = self.problems[0]
        self._mapping = bool(getattr(first.chosen_task, "mapping", True))
        self._compiled = first.noise is None and is_compiled(first.chosen_task)
        self._rule, self._padded = RULE_CODES[first.rule], PaddedMaps([one.place for one in self.problems])
        self.layout, self._merge, self._noisy = self._padded.layout, first.rule == "merge", first.noise is not None
        rows, width = self.layout.words
        boards = {name: np.zeros((count, self._padded.words), dtype=np.uint64) for name in Boards._fields}
        cells = (rows, 64 * width) if self._merge else (0, 0)
        self.maps, self.seeds = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        self._worlds = Worlds(
            free=self._padded.free, inside=self._padded.inside, map_of=self.maps, **boards,
            counts=np.zeros((count, *cells), dtype=np.int32), layers=self.layout.layers, rows=self.layout.rows, width=width,
        )  # fmt: skip
        kinds = (np.int8, np.int32, np.int32, *[np.int64] * 3, *[np.bool_] * 3)
        self._steps = Steps(*(np.zeros(count, kind) for kind in kinds))
        self._work = np.zeros((self.threads, 2, max(BLOCK_WORDS, width)), dtype=np.uint64)
        self._swarms: list[Any] = [None] * count
        self._rngs: list[Generator] = []
        self.moves, self.limits, self.frontier = self._steps.moves, self._steps.limits, self._steps.frontier
        self.complete, self.terminated, self.truncated = self._steps[-3:]
        self._all, self._once = np.arange(count), np.ones(count, dtype=np.int64)
        self.reset(seed=seed)

    def __repr__(self) -> str:
        return (
            f"<WorldBatch: {len(self)} worlds of {self.layout.shape}, {np.count_nonzero(self.terminated | self.truncated)} ended>"
        )

    @property
    def memory(self) -> int:
        """Size of all arrays of the batch in bytes, including working memory."""
        own = (self.seeds, self._work, self._all, self._once)
        return sum(array.nbytes for array in (*self._worlds[:-3], *self._steps, *own))

    def reset(
        self, where: ArrayLike | None = None, *, seed: int | Sequence[int | None] | None = None, maps: ArrayLike | None = None
    ) -> None:
        """Start a new episode in each selected world: choose one of the problems, and place the particles.

        Parameters
        ----------
        where : array_like of bool, shape (worlds,), optional
            Mask of the worlds to reset. By default, the method resets all worlds.
        seed : int, or sequence of int or None, one per world, optional
            Seed of the new episodes: world i gets the seed ``seed + i``, or the i-th entry of a sequence of seeds. A world without
            a seed draws a seed from its own random generator. The seed of an episode also determines the world's random
            generator, and therefore the seeds of the world's later episodes.
        maps : array_like of int, optional
            Index of the problem for each world, or one index for all worlds. By default, each world draws a problem at random.

        Raises
        ------
        InvalidInputError
            Raised if an argument is invalid. A call that raises an error changes no world.
        """
        chosen = self._chosen(where)
        if not chosen.size:
            return
        rngs = world_generators(seed, chosen, len(self), self._rngs)
        seeds = [own if own is not None else int(rng.integers(SEEDS)) for own, rng in rngs]
        if maps is None:
            numbers = [int(rng.integers(len(self.problems))) for _, rng in rngs]
        else:
            numbers = check_numbers(maps, chosen, len(self), what="maps", least=0, below=len(self.problems)).tolist()
        starts = [draw_start(self.problems[number], trial_rng(own)) for number, own in zip(numbers, seeds, strict=True)]
        if self._compiled:
            swarms: list[Any] = [None] * len(chosen)
            boards = self._first_boards(numbers, starts)
        else:
            swarms = [
                swarm_of(self.problems[number], *start, own) for number, start, own in zip(numbers, starts, seeds, strict=True)
            ]
        if not self._rngs:
            self._rngs = [rng for _, rng in rngs]
        self.maps[chosen], self.seeds[chosen] = numbers, seeds
        self._steps.limits[chosen] = [self.problems[number].max_moves for number in numbers]
        for world, swarm, (_, rng) in zip(chosen.tolist(), swarms, rngs, strict=True):
            self._swarms[world], self._rngs[world] = swarm, rng
        if self._compiled:
            self._share(begin_worlds, chosen, *boards)
            return
        for column in self._steps[1:5]:
            column[chosen] = 0
        self._steps.commands[chosen] = -1
        self._show(chosen)

    def _first_boards(self, numbers: list[int], starts: list[Any]) -> tuple[Any, ...]:
        """Return the start cells and the target cells of new episodes, as arrays for the kernel that starts worlds."""
        cells = [self._padded.lines(start) for start, _ in starts]
        targets = np.zeros((0, 0), dtype=np.uint64)
        if not self._mapping:
            targets = np.zeros((len(starts), self._padded.words), dtype=np.uint64)
            for row, number, (start, wanted) in zip(targets, numbers, starts, strict=True):
                place = self.problems[number].place
                check_reachable(place, start, wanted)
                row[:] = self._padded.free[number] if wanted is place.free else self._padded.of_mask(wanted)
        ends = np.cumsum([len(one) for one in cells], dtype=np.int64)
        return np.concatenate(cells), ends, targets

    def step(self, commands: ArrayLike | str, *, repeat: ArrayLike = 1, where: ArrayLike | None = None) -> Trace:
        """Send one command, or a run of equal commands, to each selected world, and scan each selected world afterwards.

        An episode that starts without frontier cells ends with its first command.

        Parameters
        ----------
        commands : array_like of int, shape (worlds,), or str
            One command per world, as a letter of ``lurd`` (``lurdio`` in 3-D), or as the index of a letter in ``lurd``
            (``lurdio``).
        repeat : array_like of int, optional
            Number of equal commands before the scan: one number for all worlds, or one number per world. A run ends early if the
            episode reaches its maximum number of commands.
        where : array_like of bool, shape (worlds,), optional
            Mask of the worlds that get a command. By default, all worlds get a command.

        Returns
        -------
        Trace
            One row per world, with the total effect of the world's commands. Each later step or reset overwrites the arrays of the
            trace.

        Raises
        ------
        InvalidInputError
            Raised if the number of commands differs from the number of worlds, if a command is invalid, or if the episode of a
            selected world has ended. A call that raises an error changes no world.
        """
        steps, chosen, ndim = self._steps, self._chosen(where), self.layout.ndim
        given = encode(commands, ndim=ndim) if isinstance(commands, str) else commands
        codes = check_numbers(given, chosen, len(self), what="commands", least=0, below=2 * ndim, single=False)
        ended = self.terminated | self.truncated
        if np.count_nonzero(ended):  # quicker than any()
            who = chosen[(ended & (self.moves > 0))[chosen]]
            if len(who):
                raise InvalidInputError(
                    f"step: expected worlds whose episodes are running, got world {who[0]}, whose episode has ended (reset "
                    "the world or leave it out with where)"
                )
        if isinstance(repeat, int) and repeat == 1:
            times = self._once[: len(chosen)]
        else:
            times = check_numbers(repeat, chosen, len(self), what="repeat", least=1).astype(np.int64)
            times = np.minimum(times, np.maximum(steps.limits[chosen] - steps.moves[chosen], 1))
        if chosen is self._all:
            steps.commands[:] = codes
        else:
            steps.commands[:], steps.classified[:], steps.travelled[:] = -1, 0, 0
            steps.commands[chosen] = codes
        if self._compiled:
            self._share(step_worlds, chosen, times)
        else:
            self._carry_out(chosen, times)
        return Trace(*steps[:4], steps.commands >= 0)

    def _carry_out(self, chosen: NDArray[np.int64], times: NDArray[np.int64]) -> None:
        """Send commands to worlds that the kernels do not support, one world after the other."""

        def work(_: int, first: int, last: int) -> None:
            for world, steps in zip(chosen[first:last].tolist(), times[first:last].tolist(), strict=True):
                rows, _scanned = self._swarms[world].carry_out(LETTERS[self._steps.commands[world]], steps, scan=True)
                columns = np.array(rows, dtype=np.int64).T
                self._steps.classified[world], self._steps.travelled[world] = columns[0].sum(), columns[2].sum()
                self._steps.moves[world] += steps
            self._show(chosen[first:last])

        share_out(work, len(chosen), words=64 * self._padded.words, threads=self.threads)

    def _show(self, chosen: NDArray[np.int64]) -> None:
        """For worlds that the kernels do not support, copy the boards and the status to the arrays of the batch."""
        steps = self._steps
        for world in chosen.tolist():
            swarm = self._swarms[world]
            boards = (swarm.state.occupied, swarm.belief.open, swarm.belief.known, swarm.belief.frontier)
            for name, board in zip(Boards._fields, boards, strict=True):
                self._padded.padded(board, getattr(self._worlds, name)[world])
            if swarm.state.counts is not None:
                layout, whole = swarm.state.occupied.layout, self._worlds.counts[world]
                whole[:] = 0
                part = whole.reshape(self.layout.layers, self.layout.rows, -1)[: layout.layers, : layout.rows, : layout.columns]
                part[...] = swarm.state.counts.reshape(part.shape)
            steps.frontier[world] = len(swarm.belief.frontier)
            steps.complete[world] = bool(swarm.finished)
            steps.terminated[world] = steps.complete[world] or (not self._noisy and steps.frontier[world] == 0)
            steps.truncated[world] = not steps.terminated[world] and steps.moves[world] >= steps.limits[world]

    def _share(self, kernel: Any, chosen: NDArray[np.int64], *arguments: Any) -> None:
        """Run a kernel on the selected worlds, in several threads."""

        def work(thread: int, first: int, last: int) -> None:
            kernel(self._worlds, self._steps, self._work[thread], chosen, *arguments, self._rule, self._mapping, first, last)

        share_out(work, len(chosen), words=self._padded.words, threads=self.threads)
