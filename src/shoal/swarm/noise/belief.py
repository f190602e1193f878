"""NoisyBelief: for each cell, the log-odds that the cell is free, estimated from noisy observations of particles."""

from __future__ import annotations

from math import log

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.commands import encode, letters_of
from shoal.swarm.grid.fields import new_field
from shoal.swarm.grid.trace import Trace
from shoal.swarm.kernels.noise import noisy_episode
from shoal.swarm.kernels.noise import noisy_state as kernels
from shoal.swarm.kernels.records import new_record
from shoal.swarm.kernels.search.frontier_search import Search
from shoal.swarm.noise.branches import cells_behind
from shoal.swarm.noise.model import CONFIDENCE, PRIOR, Noise, bound_of
from shoal.swarm.policies.paths import path_to_frontier

PAD = 3  # the rim and two more cells that are never free
NEVER = -700.0  # log-odds
MAY_HOLD = 0.05  # probability from which a cell counts as one that may hold a particle
SAFETY = 2.0  # the rest of a map may branch more than the part found so far


def padded_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the shape of the arrays in which kernels store a workspace of the given shape.

    Each array has a margin of three cells on each side of the workspace.
    """
    return tuple(size + 2 * PAD for size in shape)


def noisy_state_of(layout: GridLayout, about: Noise, confidence: float) -> kernels.NoisyState:
    """Return the arrays with which kernels store a noisy state, for an unknown workspace without particles."""
    shape = padded_shape(layout.shape)
    strides = [1, shape[-1], shape[-1] * shape[-2]]
    steps = {"l": -strides[0], "u": -strides[1], "r": strides[0], "d": strides[1], "i": -strides[2], "o": strides[2]}
    size = int(np.prod(shape))
    logit = np.full(shape, np.log(PRIOR / (1 - PRIOR)))
    guard = np.ones(shape, dtype=np.bool_)
    guard[(slice(PAD - 1, 1 - PAD),) * layout.ndim] = False
    logit[guard] = NEVER
    return kernels.NoisyState(
        truth=np.zeros(size, dtype=np.bool_),
        there=np.zeros(size, dtype=np.bool_),
        seen=np.zeros(size, dtype=np.bool_),
        logit=logit.ravel(),
        inside=np.zeros(size),
        staying=np.zeros(size),
        moved=np.zeros(size),
        offsets=np.array([steps[letter] for letter in letters_of(layout.ndim)], dtype=np.int64),
        rates=new_record(kernels.RATES, **vars(about), bound=bound_of(confidence)),
        layers=layout.layers,
        rows=layout.rows,
        columns=layout.columns,
    )


def inner_of(flat: NDArray[np.generic], shape: tuple[int, ...], *, rim: int = 0) -> NDArray[np.generic]:
    """Return the part of a kernel's array that covers the workspace and a margin of ``rim`` cells."""
    cut = PAD - rim
    return flat.reshape(padded_shape(shape))[(slice(cut, -cut or None),) * len(shape)]


class NoisyBelief:
    """The belief of a swarm under noise: the log-odds that each cell is free. Commands and scans change the object in place.

    Parameters
    ----------
    shape : tuple of int
    seen : Board
        The cells in which the first scan shows particles.
    noise : Noise
    confidence : float
        A cell counts as classified if its probability of being free, or its probability of being an obstacle, is at least
        ``confidence``. The confidence must exceed 0.75.
    loss : float
        Probability that a particle disappears at a move. With a loss above 0, a particle that scans do not show for longer than
        the miss rate explains loses its probability.

    Raises
    ------
    InvalidInputError

    Notes
    -----
    At each move, the belief spreads the probability of every particle over the cells that the particle may have entered. At each
    scan, Bayes' rule updates the log-odds of each cell together with the neighbouring cell from which a particle may have come. The
    belief treats all cells as independent of each other, except two neighbouring cells between which a particle may have moved. A
    move without a scan changes no log-odds. The page docs/concepts/noise.md explains the estimation.

    Examples
    --------
    In the following example, two commands push a particle against the wall on its left. Each command lowers the probability that
    the wall cell is free.

    >>> layout = GridLayout((1, 3))
    >>> here = Board.of_cells(layout, [(0, 0)])
    >>> belief = NoisyBelief((1, 3), here, Noise(slip=0.05, misplace=0.01))
    >>> for _ in range(2):
    ...     first_time_settled = belief.update("l", here)
    ...     print(round(float(belief.probability[1, 0]), 4))
    0.0172
    0.0009
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        seen: Board,
        noise: Noise,
        confidence: float = CONFIDENCE,
        *,
        loss: float = 0.0,
        noisy: kernels.NoisyState | None = None,  # of a simulation, whose true state is in the same arrays
    ) -> None:
        self.layout, self.noise, self.confidence, self.loss = GridLayout(shape), noise, confidence, loss
        self.state = noisy_state_of(self.layout, noise, confidence) if noisy is None else noisy
        self.guard = guard_of(self.layout)
        self._field = new_field(self.layout)
        self._first = seen
        self._behind: tuple[Board, float] | None = None  # free cells, and the share behind them
        self._show(seen)
        kernels.first_belief(self.state)
        noisy_episode.refresh(self.state, self._field, self.guard)

    def update(self, command: str, seen: Board) -> int:
        """Update the belief after one command and one scan. ``seen`` contains the cells in which the scan shows particles.

        Return the number of cells classified for the first time.
        """
        self._show(seen)
        # Bayes' rule below then weighs "still there, but not seen" (which needs a miss) against "gone" (which needs nothing)
        self.state.inside[:] *= 1 - self.loss
        return self.learn(encode(command, ndim=self.layout.ndim)[0])

    def learn(self, code: np.int8) -> int:
        """Update the belief after one command and one scan, as `update` does. ``code`` is the number of the command.

        Before the call, ``state.seen`` must contain the cells in which the scan shows particles. Return the number of cells
        classified for the first time.
        """
        kernels.learn_noisy(self.state, code)
        return int(noisy_episode.refresh(self.state, self._field, self.guard))

    def spread(self, command: str) -> None:
        """Update the belief after a command without a scan.

        Spread the probability of each particle over the cells that the particle may have entered. The log-odds stay unchanged.
        """
        self.spread_code(encode(command, ndim=self.layout.ndim)[0])

    def spread_code(self, code: np.int8) -> None:
        """Update the belief after a command without a scan, as `spread` does. ``code`` is the number of the command."""
        kernels.spread_noisy(self.state, code)
        noisy_episode.refresh(self.state, self._field, self.guard)

    def play(self, search: Search, rng: Generator, trace: Trace, *, every: int, limit: int) -> tuple[int, int]:
        """Run the policy closest-frontier until the trace is full or the episode ends.

        Return the number of moves and the status code.
        """
        played, status = noisy_episode.play_noisy(self.state, self._field, search, self.guard, rng, trace, every, limit)
        return int(played), int(status)

    def follow(self, rng: Generator, trace: Trace) -> None:
        """Replay the commands and the scans that the trace contains, and fill the other columns of the trace."""
        noisy_episode.follow_noisy(self.state, self._field, self.guard, rng, trace)

    def _show(self, seen: Board) -> None:
        inner_of(self.state.seen, self.layout.shape, rim=1)[...] = seen.mask

    @property
    def probability(self) -> NDArray[np.float64]:
        """The probability that a cell is free (float64), for the cells of the workspace and of a rim that is one cell wide."""
        return 1 / (1 + np.exp(-self.logit))

    @property
    def logit(self) -> NDArray[np.float64]:
        """The log-odds that a cell is free (float64), for the cells of the workspace and of a rim that is one cell wide."""
        return np.array(inner_of(self.state.logit, self.layout.shape, rim=1))

    @property
    def particles(self) -> float:
        """Expected number of particles: the sum of the probabilities with which cells hold a particle."""
        return float(self.state.inside.sum())

    @property
    def remaining(self) -> int:
        """Number of frontier cells in the belief."""
        return int(self.guard.memory.remaining)

    @property
    def finished(self) -> bool:
        """Whether the mapping is complete: no frontier cell is in reach, and every cell that a particle may enter is classified.

        The property is false if the policy gave up a cell as undecidable, if no cell surely holds a particle, and while there are
        `weak_walls`.
        """
        belief, occupied = self.belief, self.occupied
        if self.undecided or not belief.open or not occupied or path_to_frontier(belief, occupied):
            return False
        return self.closed and not self.weak_walls

    @property
    def closed(self) -> bool:
        """Whether every cell that a particle may still enter is classified.

        The property looks at all cells that may hold a particle, and not only, as policies do, at cells that surely hold one and
        are surely free. A particle in an unclassified cell is beside cells that it can still classify.
        """
        from scipy import ndimage

        passable = self.logit > -bound_of(self.confidence)
        may_hold = np.asarray(inner_of(self.state.inside > MAY_HOLD, self.layout.shape, rim=1), dtype=np.bool_)
        parts, _ = ndimage.label(passable)
        reachable = np.isin(parts, np.unique(parts[may_hold & passable]))
        return bool(reachable.any()) and not bool((reachable & ~self.belief.open.mask).any())

    @property
    def weak_walls(self) -> Board:
        """The walls that must be pushed again before the mapping is complete, because too much may lie behind them.

        Let e be the probability of what the scans show at a wall if it is a free cell, divided by this probability if it is a wall.
        Of n free cells, each counts as a wall in the end with a probability of about e, and then hides the cells that particles
        reach only through it: on average a share f of the map (`cells_behind`). The expected share of hidden cells is n f e, and
        `SAFETY` times this share must not exceed 1 - ``confidence``. Behind a wall without unclassified cells beside it, nothing is
        hidden, and beside a small unclassified part, no more than this part.
        """
        from scipy import ndimage

        belief, inner = self.belief, (slice(1, -1),) * self.layout.ndim
        parts, _ = ndimage.label(~belief.known.mask[inner])
        sizes = np.bincount(parts.ravel())
        sizes[0] = 0  # classified cells
        around = np.pad(sizes[parts], 1)
        behind = np.zeros_like(around)  # cells of the largest unclassified part beside a cell
        for axis in range(self.layout.ndim):
            for way in (-1, 1):
                np.maximum(behind, np.roll(around, way, axis), out=behind)
        walls = np.zeros(self.layout.window, dtype=np.bool_)
        walls[inner] = (belief.obstacles & belief.open.dilated()).mask[inner]  # beyond the rim, nothing is hidden
        walls &= behind > 0
        if not walls.any():
            return Board.empty(self.layout)
        share = np.minimum(self._share_behind, (1 + behind) / (len(belief.known) + behind))
        mistaken = np.exp(self.logit - log(PRIOR / (1 - PRIOR)))
        return Board(self.layout, self.layout.pack(walls & (len(belief.open) * SAFETY * share * mistaken > 1 - self.confidence)))

    @property
    def _share_behind(self) -> float:
        """Mean share of the free cells that particles reach only through a given free cell."""
        free = self.belief.open
        if self._behind is None or self._behind[0] != free:
            cells = cells_behind(free, self._first)
            self._behind = free, float(cells.mean()) / len(cells)
        return self._behind[1]

    @property
    def undecided(self) -> int:
        """Number of frontier cells that the policy has given up as undecidable."""
        return int(self.guard.memory.undecided)

    @property
    def occupied(self) -> Board:
        """The cells that hold a particle with a probability above 0.5."""
        return Board(self.layout, self._field.occupied.reshape(self.layout.words).copy())

    @property
    def belief(self) -> Belief:
        """The belief in the form that policies use: a `Belief` with all cells that are classified at the given confidence."""
        field = self._field
        return Belief(
            *(Board(self.layout, words.reshape(self.layout.words).copy()) for words in (field.open, field.known, field.frontier))
        )


def guard_of(layout: GridLayout) -> noisy_episode.ProgressGuard:
    """Return the initial memory of the progress guard, which makes sure that an episode with noise ends."""
    size = layout.words[0] * layout.words[1]
    memory = new_record(noisy_episode.MEMORY, budget=-1)
    return noisy_episode.ProgressGuard(np.zeros(size, dtype=np.uint64), np.zeros(size, dtype=np.uint64), memory)
