"""Noise: particles slip, scans show wrong positions, and a cell counts as known from a confidence
that the user chooses.

`Noise` is the model and `NoisyBelief` what a swarm knows under it: for each cell, the log-odds that
the cell is free.
"""

from __future__ import annotations

from dataclasses import replace
from math import log
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass
from shoal.swarm.grid.board import Board, GridLayout, encode, letters_of
from shoal.swarm.grid.paths import path_to_frontier
from shoal.swarm.grid.scans import Trace
from shoal.swarm.grid.state import Belief, new_field
from shoal.swarm.kernels import noise as kernels
from shoal.swarm.kernels.moves import new_record
from shoal.swarm.kernels.noise import PATIENCE, TIMES
from shoal.swarm.kernels.search import Search
from shoal.swarm.maps.workspace import GridWorkspace

if TYPE_CHECKING:
    from numpy.random import Generator

CONFIDENCE = 0.99
PRIOR = 0.25  # prior probability that an unknown cell is free: about the fraction in vascular maps
MOST = 0.5  # upper limit of each probability
SUREST = 0.99999
LOSS = 0.02
"""On a rig: prior probability that a particle disappears for good at a move, because it sticks,
dissolves or leaves the field.

Without it, a particle that no scan shows any more stays in the belief for ever. Of the values
0.0005, 0.005 and 0.02, the largest gives the fewest wrong cells if particles disappear, and as few
as the others if none does (`python -m benchmarks.rigs`).
"""
GHOSTS = 1e-3
"""On a rig: probability that a scan shows a particle in a given cell, although none is near it.

Cameras see dust and reflections. With less, a ghost in a cell that is known to be free counts as a
particle; with more, particles that stood behind another one are found again later.
"""
LEAPS = 0.02
"""On a rig: probability that a particle moves by two cells, as a fast one does that stands in the
front of its cell.

Without it, a belief that takes such a detection for a ghost loses the particle, and a policy sends it
back and forth: the particle is found again at the next command, and lost at the one after.
"""
PASSED = 60.0
"""On a rig: highest log-odds that a cell is free.

The slips of a real particle are not independent: it jams at a corner, and stays there at push after
push. A cell through which particles have passed a dozen times must not become a wall by this. With
the limit of simulations (`kernels.SURE`), the cells in front of jammed particles had to be looked at
again and again: 300 pulled particles took 1.58 times the moves of the grid in the map of an eye, and
1.10 times with this limit and `LEAPS` (`python -m benchmarks.physics --only eye`).
"""


@dataclass(frozen=True)
class Noise:
    """Probabilities of failed motions and observations. Failures of different particles or at
    different moves are independent.

    Parameters
    ----------
    slip : float
        Probability, from 0 to 0.5, that a command does not move a particle (the particle slips). A
        slipping particle blocks the particles behind it.
    misplace : float
        Probability that a scan shows a particle in a neighbouring cell instead of its true cell.
        All neighbouring cells (4 in 2-D, 6 in 3-D) are equally likely.
    miss : float
        Probability that a scan does not show a particle.

    Notes
    -----
    The page docs/concepts/noise.md explains the noise model.
    """

    slip: float = 0.0
    misplace: float = 0.0
    miss: float = 0.0

    def __post_init__(self) -> None:
        for name in ("slip", "misplace", "miss"):
            object.__setattr__(
                self, name, check_number(getattr(self, name), what=name, least=0, most=MOST)
            )

    def __bool__(self) -> bool:
        return bool(self.slip or self.misplace or self.miss)


def bound_of(confidence: Any) -> float:
    """Return the log-odds of a confidence. The confidence must exceed the prior probability that an
    unknown cell is an obstacle.

    Examples
    --------
    >>> round(bound_of(0.99), 2)
    4.6
    """
    sure = check_number(confidence, what="confidence", above=1 - PRIOR, most=SUREST)
    return log(sure / (1 - sure))


@dataclass(frozen=True)
class MapErrors:
    """The number of cells that a mapping with noise classified wrongly, and the number of cells
    that it left undecided.

    The numbers include only cells that a mapping without noise would classify.

    Parameters
    ----------
    free, walls : int
        ``free`` is the number of free cells that particles can reach. ``walls`` is the number of
        obstacle cells beside the reachable free cells.
    false_free : int
        Number of obstacle cells that the swarm classified as free.
    false_obstacles : int
        Number of free cells that the swarm classified as obstacles.
    undecided : int
        Number of cells that the swarm did not classify.
    """

    free: int
    walls: int
    false_free: int
    false_obstacles: int
    undecided: int

    @classmethod
    def of(cls, workspace: GridWorkspace, start: NDArray[np.int64], belief: Belief) -> MapErrors:
        """Return the errors in the final belief of a mapping. ``start`` contains the start cells of
        the particles.
        """
        labels = workspace.components
        reached = Board.of_mask(workspace.free & np.isin(labels, labels[tuple(start.T)]))
        walls = reached.dilated() - reached
        return cls(
            free=len(reached),
            walls=len(walls),
            false_free=len(belief.open & walls),
            false_obstacles=len(belief.obstacles & reached),
            undecided=len((reached | walls) - belief.known),
        )

    @property
    def right(self) -> float:
        """Number of correctly classified cells divided by ``free + walls``."""
        cells = self.free + self.walls
        return 1 - (self.false_free + self.false_obstacles + self.undecided) / cells

    @property
    def false_free_rate(self) -> float:
        """Fraction of the obstacle cells that the swarm classified as free."""
        return self.false_free / max(1, self.walls)

    @property
    def false_obstacle_rate(self) -> float:
        """Fraction of the free cells that the swarm classified as obstacles."""
        return self.false_obstacles / max(1, self.free)


PAD = 3  # the rim and two more cells that are never free
NEVER = -700.0  # log-odds
MAY_HOLD = 0.05  # probability from which a cell counts as one that may hold a particle
UNLIKELY = 0.05  # probability that no particle starts in a part of the map
SAFETY = 2.0  # the rest of a map may branch more than the part found so far


class NoisyBelief:
    """The belief of a swarm under noise: the log-odds that each cell is free. Commands and scans
    change the object in place.

    Parameters
    ----------
    shape : tuple of int
    seen : Board
        The cells in which the first scan shows particles.
    noise : Noise
    confidence : float
        A cell counts as classified if its probability of being free, or its probability of being an
        obstacle, is at least ``confidence``. The confidence must exceed 0.75.
    loss : float
        Probability that a particle disappears at a move. With a loss above 0, a particle that scans
        do not show for longer than the miss rate explains loses its probability, and scans may show
        `GHOSTS`, as those of a rig.
    prior : ndarray of float64, optional
        Log-odds that each cell is free before the first scan, for the cells of the workspace and of
        a rim that is one cell wide.
    rule : str
        "block" or "merge".

    Notes
    -----
    At each move, the belief spreads the probability of every particle over the cells that the
    particle may have entered. At each scan, Bayes' rule updates the log-odds of each cell together
    with the neighbouring cell from which a particle may have come. The belief treats all cells as
    independent of each other, except two neighbouring cells between which a particle may have
    moved. A move without a scan changes no log-odds. The page docs/concepts/noise.md explains the
    estimation.

    Examples
    --------
    In the following example, two commands push a particle against the wall on its left. Each
    command lowers the probability that the wall cell is free.

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
        prior: NDArray[np.float64] | None = None,
        rule: str = "block",
        noisy: kernels.NoisyState
        | None = None,  # of a simulation, whose true state is in the same arrays
    ) -> None:
        self.layout = GridLayout(shape)
        self.noise = noise
        self.confidence = confidence
        self.loss = loss
        self.state = noisy_state_of(self.layout, noise, confidence) if noisy is None else noisy
        self.guard = guard_of(self.layout)
        self._field = new_field(self.layout)
        self._first = seen
        self._behind: tuple[Board, float] | None = None  # free cells, and the share behind them
        self.state.rates.merge = rule == "merge"
        if loss > 0:
            self.state.rates.clutter, self.state.rates.surest = GHOSTS, PASSED
            self.state.rates.leap = LEAPS
        if prior is not None:
            inner_of(self.state.logit, shape, rim=1)[...] = prior
        self._show(seen)
        kernels.first_belief(self.state)
        kernels.refresh(self.state, self._field, self.guard)

    def update(self, command: str, seen: Board) -> int:
        """Update the belief after one command and one scan. ``seen`` contains the cells in which
        the scan shows particles.

        Return the number of cells classified for the first time.
        """
        self._show(seen)
        # Bayes' rule below then weighs "still there, but not seen" (which needs a miss) against
        # "gone" (which needs nothing)
        self.state.inside[:] *= 1 - self.loss
        return self.learn(encode(command, ndim=self.layout.ndim)[0])

    def weigh_deeds(self, command: str, before: str, seen: Board) -> NDArray[np.float64]:
        """Return the log-likelihoods (float64, shape (5,)) of a scan after a command that the rig
        may have carried out once, not at all, twice, in another direction, or late, together with
        the command before it.

        The belief stays as it is before the command. ``before`` is empty for the first command.
        """
        likelihoods, occupancy = np.zeros(5), self.state.inside.copy()
        self._show(seen)
        self.state.inside[:] *= 1 - self.loss
        codes = [encode(letter, ndim=self.layout.ndim)[0] for letter in command + before]
        kernels.weigh_deeds(
            self.state,
            codes[0],
            codes[1] if before else np.int8(-1),
            np.empty_like(occupancy),
            likelihoods,
        )
        self.state.inside[:] = occupancy
        return likelihoods

    def weigh_scan(self, command: str, seen: Board) -> float:
        """Return the log-likelihood of a scan after a command, or after no command (""). The belief
        stays as it is.
        """
        self._show(seen)
        code = encode(command, ndim=self.layout.ndim)[0] if command else np.int8(-1)
        return float(kernels.scan_likelihood(self.state, code))

    def look_again(self, seen: Board) -> None:
        """Update where the particles are after a scan at which nothing has moved since the scan
        before. The log-odds stay as they are, because no particle has tried to enter a cell.
        """
        self._show(seen)
        state, noise = self.state, self.noise
        hit = (1 - noise.miss) * (1 - noise.misplace)
        share = (1 - noise.miss) * noise.misplace / len(state.offsets)
        beside = np.sum([np.roll(state.inside, offset) for offset in state.offsets], axis=0)
        stray = np.minimum(share * beside + kernels.CLUTTER, 0.5)
        free = 1 / (1 + np.exp(-state.logit))
        before = np.where(state.seen, np.maximum(state.inside, kernels.LOST * free), state.inside)
        present = before * np.where(state.seen, hit + (1 - hit) * stray, (1 - hit) * (1 - stray))
        absent = (1 - before) * np.where(state.seen, stray, 1 - stray)
        state.inside[:] = present / (present + absent)
        state.inside[state.inside < kernels.FAINT] = 0

    def assume_number(self, number: int) -> None:
        """Believe after the first scan that about ``number`` particles are in the cells that are
        free, instead of only those that the scan shows.
        """
        state, noise = self.state, self.noise
        hit = (1 - noise.miss) * (1 - noise.misplace)
        share = (1 - noise.miss) * noise.misplace / len(state.offsets)
        free = 1 / (1 + np.exp(-state.logit))
        density = min(0.9, number / max(1.0, float(free.sum())))
        likelihood_ratio = np.where(state.seen, hit / max(share, kernels.UNKNOWN), 1 - hit)
        odds = free * density / (1 - density) * likelihood_ratio
        state.inside[:] = odds / (1 + odds)
        state.inside[free < 1 - self.confidence] = 0

    def place(self, seen: Board) -> None:
        """Believe that the particles were put elsewhere, and that a scan then shows ``seen``. Their
        number and the log-odds of the cells stay, except that a cell with a detection is more
        likely free.
        """
        number = max(1, round(max(self.particles, len(seen))))
        self._show(seen)
        kernels.first_belief(self.state)
        self.assume_number(number)
        kernels.refresh(self.state, self._field, self.guard)

    def learn(self, code: np.int8) -> int:
        """Update the belief after one command and one scan, as `update` does. ``code`` is the
        number of the command.

        Before the call, ``state.seen`` must contain the cells in which the scan shows particles.
        Return the number of cells classified for the first time.
        """
        kernels.learn_noisy(self.state, code)
        return int(kernels.refresh(self.state, self._field, self.guard))

    def spread(self, command: str) -> None:
        """Update the belief after a command without a scan.

        Spread the probability of each particle over the cells that the particle may have entered.
        The log-odds stay unchanged.
        """
        self.spread_code(encode(command, ndim=self.layout.ndim)[0])

    def spread_code(self, code: np.int8) -> None:
        """Update the belief after a command without a scan, as `spread` does. ``code`` is the
        number of the command.
        """
        kernels.spread_noisy(self.state, code)
        kernels.refresh(self.state, self._field, self.guard)

    def play(
        self, search: Search, rng: Generator, trace: Trace, *, every: int, limit: int
    ) -> tuple[int, int]:
        """Run the policy closest-frontier until the trace is full or the episode ends.

        Return the number of moves and the status code.
        """
        played, status = kernels.play_noisy(
            self.state, self._field, search, self.guard, rng, trace, every, limit
        )
        return int(played), int(status)

    def follow(self, rng: Generator, trace: Trace) -> None:
        """Replay the commands and the scans that the trace contains, and fill the other columns of
        the trace.
        """
        kernels.follow_noisy(self.state, self._field, self.guard, rng, trace)

    def _show(self, seen: Board) -> None:
        inner_of(self.state.seen, self.layout.shape, rim=1)[...] = seen.mask

    @property
    def probability(self) -> NDArray[np.float64]:
        """The probability that a cell is free (float64), for the cells of the workspace and of a
        rim that is one cell wide.
        """
        return 1 / (1 + np.exp(-self.logit))

    @property
    def logit(self) -> NDArray[np.float64]:
        """The log-odds that a cell is free (float64), for the cells of the workspace and of a rim
        that is one cell wide.
        """
        return np.array(inner_of(self.state.logit, self.layout.shape, rim=1))

    @property
    def particles(self) -> float:
        """Expected number of particles: the sum of the probabilities with which cells hold a
        particle.
        """
        return float(self.state.inside.sum())

    @property
    def remaining(self) -> int:
        """Number of frontier cells in the belief."""
        return int(self.guard.memory.remaining)

    @property
    def finished(self) -> bool:
        """Whether the mapping is complete: no frontier cell is in reach, and every cell that a
        particle may enter is classified.

        The property is false if the policy gave up a cell as undecidable, if no cell surely holds a
        particle, and while there are `weak_walls`.
        """
        belief, occupied = self.belief, self.occupied
        if self.undecided or not belief.open or not occupied or path_to_frontier(belief, occupied):
            return False
        return self.closed and not self.weak_walls

    @property
    def closed(self) -> bool:
        """Whether every cell that a particle may still enter is classified.

        The property looks at all cells that may hold a particle, and not only, as policies do, at
        cells that surely hold one and are surely free. A particle in an unclassified cell is beside
        cells that it can still classify.
        """
        reachable = self._reachable
        return bool(reachable.any()) and not bool((reachable & ~self.belief.open.mask).any())

    @property
    def _reachable(self) -> NDArray[np.bool_]:
        """Mask of the cells that are no walls and hang together with one that may hold a
        particle.
        """
        from scipy import ndimage

        passable = self.logit > -bound_of(self.confidence)
        may_hold = np.asarray(
            inner_of(self.state.inside > MAY_HOLD, self.layout.shape, rim=1), dtype=np.bool_
        )
        parts, _ = ndimage.label(passable)
        return np.isin(parts, np.unique(parts[may_hold & passable]))

    @property
    def weak_walls(self) -> Board:
        """The walls that must be pushed again before the mapping is complete, because too much may
        lie behind them.

        Let e be the probability of what the scans show at a wall if it is a free cell, divided by
        this probability if it is a wall. Of n free cells, each counts as a wall in the end with a
        probability of about e, and then hides the cells that particles reach only through it: on
        average a share f of the map (`cells_behind`). The expected share of hidden cells is n f e,
        and `SAFETY` times this share must not exceed 1 - ``confidence``. Behind a wall without
        unclassified cells beside it, nothing is hidden, and beside a small unclassified part, no
        more than this part. Beside a large one, the map may be larger than the part found so far,
        with as many more cells that hide others: at most so much larger that all particles start in
        the found part with a probability of `UNLIKELY`.

        Free cells that no particle can reach any more were reached through a cell that counts as a
        wall now. The odds that such cells are free multiply the odds that a wall between them and
        the cells in reach is free, and the product must not exceed the odds of a wrong classification.
        """
        return self._walls_before_unknown | self._walls_before_lost

    @property
    def _walls_before_lost(self) -> Board:
        from scipy import ndimage

        belief, logit = self.belief, self.logit
        reached = Board(self.layout, self.layout.pack(belief.open.mask & self._reachable))
        unreachable = belief.open - reached
        between = (belief.obstacles & reached.dilated() & unreachable.dilated()).mask
        if not between.any():
            return Board.empty(self.layout)
        parts, count = ndimage.label(unreachable.mask)
        surest = np.append(-np.inf, ndimage.maximum(logit, parts, np.arange(1, count + 1)))
        if self.loss > 0:  # a particle may have started there and disappeared
            surest[parts[self._first.mask]] = -np.inf
        evidence = largest_beside(surest[parts])
        bound = np.maximum(-kernels.SURE, -bound_of(self.confidence) - evidence)
        return Board(self.layout, self.layout.pack(between & (logit > bound)))

    @property
    def _walls_before_unknown(self) -> Board:
        from scipy import ndimage

        belief, inner = self.belief, (slice(1, -1),) * self.layout.ndim
        parts, _ = ndimage.label(~belief.known.mask[inner])
        sizes = np.bincount(parts.ravel())
        sizes[0] = 0  # classified cells
        behind = largest_beside(np.pad(sizes[parts], 1))  # cells of an unclassified part
        walls = np.zeros(self.layout.window, dtype=np.bool_)
        # beyond the rim, nothing is hidden
        walls[inner] = (belief.obstacles & belief.open.dilated()).mask[inner]
        walls &= behind > 0
        if not walls.any():
            return Board.empty(self.layout)
        classified = len(belief.known)
        larger = np.minimum(1 + behind / classified, UNLIKELY ** (-1 / max(1, len(self._first))))
        share = np.minimum(self._share_behind * larger, (1 + behind) / (classified + behind))
        mistaken = np.exp(self.logit - log(PRIOR / (1 - PRIOR)))
        return Board(
            self.layout,
            self.layout.pack(
                walls & (len(belief.open) * SAFETY * share * mistaken > 1 - self.confidence)
            ),
        )

    @property
    def _share_behind(self) -> float:
        """Mean share of the free cells that particles reach only through a given free cell."""
        free = self.belief.open
        if self._behind is None or self._behind[0] != free:
            cells = cells_behind(free, self._first)
            self._behind = free, float(cells.mean()) / len(cells)
        return self._behind[1]

    @property
    def confirmed(self) -> Board:
        """The cells that scans have shown to be free, with the given confidence."""
        return self.belief.open

    @property
    def hopeless(self) -> bool:
        """Whether no command can help although the task is not finished."""
        return False

    @property
    def progress(self) -> int:
        """Number of classified cells, by which a `Lookout` sees whether its commands help."""
        return len(self.belief.known)

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
        """The belief in the form that policies use: a `Belief` with all cells that are classified
        at the given confidence.
        """
        field = self._field
        return Belief(
            *(
                Board(self.layout, words.reshape(self.layout.words).copy())
                for words in (field.open, field.known, field.frontier)
            )
        )


class Lookout:
    """Chooses commands where a policy has none although the mapping is not complete.

    A policy sees a particle only where the belief is surer than 0.5, and plans only through cells
    that are classified as free. If errors are frequent or particles are few, it may therefore find
    no path although particles may still enter unclassified cells. Commands in all directions in
    turn then show where the particles are. A cell beyond the border of the field that counts as free
    is a mistake, which the nearest particle corrects with pushes. If every cell in reach is
    classified, the nearest particle pushes the nearest of the weak walls, behind which more
    unclassified cells may lie than the confidence allows. If no particle can reach one, particles
    push the walls between them and the rest of the map.

    After `PATIENCE` commands that neither classify a further cell nor leave fewer weak walls, and
    `TIMES` more for each cell of the longest path to a wall, the lookout gives up, so that every
    episode ends.

    Parameters
    ----------
    noisy : NoisyBelief

    Examples
    --------
    >>> from shoal.swarm.grid.board import GridLayout
    >>> from shoal.swarm.noise import Noise
    >>> belief = NoisyBelief((1, 3), Board.of_cells(GridLayout((1, 3)), [(0, 0)]), Noise(slip=0.05))
    >>> lookout = Lookout(belief)
    >>> [lookout.next() for _ in range(5)]
    [0, 1, 2, 3, 0]
    >>> sum(lookout.next() is not None for _ in range(1000))
    45
    """

    def __init__(self, noisy: NoisyBelief) -> None:
        self.noisy = noisy
        self._known, self._weak = -1, 0
        self._sent, self._budget = 0, PATIENCE

    def next(self) -> int | None:
        """Return the number of the next command, or None to give up."""
        noisy, belief = self.noisy, self.noisy.belief
        if noisy.hopeless:
            return None
        progress, path = noisy.progress, ""
        if progress > self._known:  # looking for the particles was worth it
            self._known, self._weak, self._sent, self._budget = progress, progress, 0, PATIENCE
        if noisy.closed:
            weak = noisy.weak_walls
            if len(weak) < self._weak:
                self._weak, self._sent, self._budget = len(weak), 0, PATIENCE
            path = path_to_frontier(replace(belief, frontier=weak), noisy.occupied)
            path = path or path_to_frontier(
                replace(belief, frontier=self._between(belief)), noisy.occupied
            )
        else:
            field = Board.of_mask(np.ones(noisy.layout.shape, dtype=np.bool_))
            beyond = replace(belief, open=belief.open & field, frontier=belief.open - field)
            path = path_to_frontier(beyond, noisy.occupied)
        self._budget = max(self._budget, PATIENCE + TIMES * len(path))
        if self._sent >= self._budget:
            return None
        self._sent += 1
        ndim = noisy.layout.ndim
        return int(encode(path[0], ndim=ndim)[0]) if path else (self._sent - 1) % (2 * ndim)

    def _between(self, belief: Belief) -> Board:
        """Return the weakest walls between the part of the map with particles and the rest of the
        map: one of them may be none.
        """
        reached = layer = self.noisy.occupied & belief.open
        while layer:
            layer = (layer.dilated() & belief.open) - reached
            reached = reached | layer
        between = (belief.obstacles & reached.dilated() & (belief.open - reached).dilated()).mask
        odds = np.where(between, self.noisy.logit, -np.inf)
        # the next push changes more
        return Board(reached.layout, reached.layout.pack(between & (odds > odds.max() - 1)))


LEVELS = 8
"""Number of shades between an unknown cell and a classified cell."""

# values of looks: shades from classified obstacle to classified free,
OBSTACLE, UNKNOWN, FREE = 0, LEVELS, 2 * LEVELS
FRONTIER = 2 * LEVELS + 1  # the same shades for frontier cells start here,
FALSE_FREE = 2 * FRONTIER  # an obstacle wrongly classified as free,
FALSE_OBSTACLE = FALSE_FREE + 1  # a free cell wrongly classified as obstacle
LOOKS = FALSE_OBSTACLE + 1


@dataclass(frozen=True)
class Moment:
    """One moment of an episode with noise. The arrays ``particles`` and ``looks`` cover the
    workspace and a rim of one cell.

    Parameters
    ----------
    particles : ndarray of bool
        Mask that is True for each cell with a particle. For a rig, the mask is True for each cell
        in which the last scan showed a particle.
    looks : ndarray of uint8
        The shade of each cell. A classified obstacle has the shade ``OBSTACLE``, an unknown cell
        has the shade ``UNKNOWN``, and a classified free cell has the shade ``FREE``. Between these
        three shades, the shade is linear in the log-odds that the cell is free. The constant
        ``FRONTIER`` is added to the shade of every frontier cell. If the true map is known, wrongly
        classified cells have the shade ``FALSE_FREE`` or ``FALSE_OBSTACLE``.
    """

    particles: NDArray[np.bool_]
    looks: NDArray[np.uint8]


def looks_of(belief: NoisyBelief, truth: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    """Return the shade of each cell in a picture of a belief. The class `Moment` explains the
    shades.

    ``truth`` is the true mask of the free cells, with a rim of one cell. If the true map is
    unknown, ``truth`` is None.

    Examples
    --------
    >>> from shoal.swarm.grid.board import Board, GridLayout
    >>> from shoal.swarm.noise import Noise
    >>> belief = NoisyBelief((1, 3), Board.of_cells(GridLayout((1, 3)), [(0, 0)]), Noise(slip=0.05))
    >>> looks_of(belief, None)[1].tolist()  # the particle stands between two frontier cells
    [25, 16, 25, 8, 8]
    """
    bound, start = bound_of(belief.confidence), log(PRIOR / (1 - PRIOR))
    gained = belief.logit - start
    share = np.where(gained >= 0, gained / (bound - start), gained / (bound + start))
    inner = LEVELS - 1  # shades of unclassified cells
    looks = (UNKNOWN + np.clip(np.rint(share * LEVELS), -inner, inner)).astype(np.uint8)
    classified = belief.belief
    free, obstacles = classified.open.mask, classified.obstacles.mask
    _shade(looks, classified)
    if truth is not None:
        looks[free & ~truth] = FALSE_FREE
        looks[obstacles & truth] = FALSE_OBSTACLE
    return np.asarray(looks)


def exact_looks(known: Belief) -> NDArray[np.uint8]:
    """Return the shade of each cell in a picture of a belief without noise."""
    looks = np.full(known.open.layout.window, UNKNOWN, dtype=np.uint8)
    _shade(looks, known)
    return looks


def _shade(looks: NDArray[np.uint8], belief: Belief) -> None:
    looks[belief.open.mask], looks[belief.obstacles.mask] = FREE, OBSTACLE
    looks[belief.frontier.mask] += FRONTIER


def truth_of(
    workspace: GridWorkspace, start: NDArray[np.int64], about: Noise, confidence: float
) -> kernels.NoisyState:
    """Return the arrays with which kernels simulate noise: the workspace, the start cells of the
    particles, and an empty belief.
    """
    noisy = noisy_state_of(GridLayout(workspace.shape), about, confidence)
    inner_of(noisy.truth, workspace.shape)[...] = workspace.free
    inner_of(noisy.occupied, workspace.shape)[tuple(start.T)] = True
    return noisy


def noisy_belief(
    workspace: GridWorkspace,
    start: NDArray[np.int64],
    about: Noise,
    confidence: float,
    rng: Generator,
) -> NoisyBelief:
    """Return the belief after the first scan of a simulation with noise.

    The arrays of the returned belief contain the true state of the simulation.
    """
    noisy, layout = truth_of(workspace, start, about, confidence), GridLayout(workspace.shape)
    kernels.look(noisy, rng)
    detections = Board(
        layout, layout.pack(np.array(inner_of(noisy.seen, layout.shape, rim=1), dtype=np.bool_))
    )
    return NoisyBelief(layout.shape, detections, about, confidence, noisy=noisy)


def largest_beside(values: NDArray[Any]) -> NDArray[Any]:
    """Return for each cell the largest value of its neighbours. The neighbour of a cell on the
    border is the cell on the opposite border.
    """
    beside = [np.roll(values, step, axis) for axis in range(values.ndim) for step in (-1, 1)]
    return np.asarray(np.maximum.reduce(beside))


def cells_behind(free: Board, roots: Board) -> NDArray[np.int64]:
    """Return for each free cell the number of free cells that become unreachable from ``roots`` if
    the cell is a wall.

    Of a root, the function returns 0.

    Parameters
    ----------
    free : Board
    roots : Board
        The cells from which particles start. A part of the map without a root gets one of its cells
        as root.

    Returns
    -------
    ndarray of int64, shape (n,)
        In the order of ``free.cells``.

    Notes
    -----
    Source: Hopcroft and Tarjan (1973), Efficient algorithms for graph manipulation: a depth-first
    search, in which the subtree of a child belongs behind its parent if no edge leads from it to a
    cell found before the parent.

    Examples
    --------
    >>> free = Board.of_mask(np.array([[1, 1, 1, 1], [1, 1, 0, 0]], dtype=bool))
    >>> cells_behind(free, Board.of_cells(free.layout, [(1, 0)])).tolist()
    [0, 2, 1, 0, 0, 0]
    """
    index = np.full(free.layout.window, -1, dtype=np.int64)
    mask = free.mask
    index[mask] = np.arange(len(free))
    beside = [np.roll(index, step, axis)[mask] for axis in range(index.ndim) for step in (-1, 1)]
    neighbours = np.stack(
        beside, axis=1
    ).tolist()  # a board never reaches around its rim: both sides would have to be free
    starts = [i for i in index[(roots & free).mask].tolist() if i >= 0]
    count = len(neighbours)
    discovery, low, size, behind = [0] * count, [0] * count, [1] * count, [0] * count
    outside = set(starts)
    time = 1  # all roots are found at time 1, as if one cell outside the map joined them
    for first in [*starts, *range(count)]:
        if discovery[first]:
            continue
        time += 1
        discovery[first] = time
        low[first] = 1 if first in outside else time
        stack = [(first, -1, iter(neighbours[first]))]
        while stack:
            cell, parent, unexplored = stack[-1]
            for neighbour in unexplored:
                if neighbour < 0 or neighbour == parent:
                    continue
                if discovery[neighbour]:
                    low[cell] = min(low[cell], discovery[neighbour])
                    continue
                time += 1
                discovery[neighbour] = time
                low[neighbour] = 1 if neighbour in outside else time
                stack.append((neighbour, cell, iter(neighbours[neighbour])))
                break
            else:
                stack.pop()
                if stack:
                    before = stack[-1][0]
                    size[before] += size[cell]
                    low[before] = min(low[before], low[cell])
                    if low[cell] >= discovery[before]:
                        behind[before] += size[cell]
    sizes = np.array(behind, dtype=np.int64)
    sizes[starts] = 0
    return sizes


def padded_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the shape of the arrays in which kernels store a workspace of the given shape.

    Each array has a margin of three cells on each side of the workspace.
    """
    return tuple(size + 2 * PAD for size in shape)


def noisy_state_of(layout: GridLayout, about: Noise, confidence: float) -> kernels.NoisyState:
    """Return the arrays with which kernels store a noisy state, for an unknown workspace without
    particles.
    """
    shape = padded_shape(layout.shape)
    strides = [1, shape[-1], shape[-1] * shape[-2]]
    steps = {
        "l": -strides[0],
        "u": -strides[1],
        "r": strides[0],
        "d": strides[1],
        "i": -strides[2],
        "o": strides[2],
    }
    size = int(np.prod(shape))
    logit = np.full(shape, np.log(PRIOR / (1 - PRIOR)))
    guard = np.ones(shape, dtype=np.bool_)
    guard[(slice(PAD - 1, 1 - PAD),) * layout.ndim] = False
    logit[guard] = NEVER
    return kernels.NoisyState(
        truth=np.zeros(size, dtype=np.bool_),
        occupied=np.zeros(size, dtype=np.bool_),
        seen=np.zeros(size, dtype=np.bool_),
        logit=logit.ravel(),
        inside=np.zeros(size),
        staying=np.zeros(size),
        moved=np.zeros(size),
        offsets=np.array([steps[letter] for letter in letters_of(layout.ndim)], dtype=np.int64),
        rates=new_record(
            kernels.RATES,
            **vars(about),
            clutter=kernels.CLUTTER,
            bound=bound_of(confidence),
            surest=kernels.SURE,
            leap=0.0,
        ),
        layers=layout.layers,
        rows=layout.rows,
        columns=layout.columns,
    )


def inner_of(
    flat: NDArray[np.generic], shape: tuple[int, ...], *, rim: int = 0
) -> NDArray[np.generic]:
    """Return the part of a kernel's array that covers the workspace and a margin of
    ``rim`` cells.
    """
    margin = PAD - rim
    return flat.reshape(padded_shape(shape))[(slice(margin, -margin or None),) * len(shape)]


def guard_of(layout: GridLayout) -> kernels.ProgressGuard:
    """Return the initial memory of the progress guard, which makes sure that an episode with noise
    ends.
    """
    size = layout.words[0] * layout.words[1]
    memory = new_record(kernels.MEMORY, budget=-1)
    return kernels.ProgressGuard(
        np.zeros(size, dtype=np.uint64), np.zeros(size, dtype=np.uint64), memory
    )


class NoisyWorld:
    """The true state of a simulation with noise, under the move rule block.

    Parameters
    ----------
    workspace : GridWorkspace
    start : array_like of int, shape (n, ndim)
    noise : Noise
    rng : Generator

    Examples
    --------
    >>> world = NoisyWorld(GridWorkspace([[1, 1, 1]]), [(0, 0)], Noise(slip=0.5), np.random.default_rng(1))
    >>> [world.step("r") or world.scan().tolist() for _ in range(3)]
    [[[0, 1]], [[0, 1]], [[0, 1]]]
    """

    def __init__(
        self, workspace: GridWorkspace, start: ArrayLike, noise: Noise, rng: Generator
    ) -> None:
        cells = np.asarray(start, dtype=np.int64)
        self.shape, self.rng = workspace.shape, rng
        self.state = truth_of(workspace, cells, noise, CONFIDENCE)

    def step(self, command: str) -> None:
        """Move the particles by one command. Each particle may slip."""
        kernels.move_noisy(self.state, encode(command, ndim=len(self.shape))[0], self.rng)

    def enter(self, cell: tuple[int, ...]) -> bool:
        """Let a particle come in at a free cell, and return whether there was room for it."""
        occupied = inner_of(self.state.occupied, self.shape)
        if occupied[cell]:
            return False
        occupied[cell] = True
        return True

    def scan(self) -> NDArray[np.int64]:
        """Return the cells in which a new scan shows particles (int64, shape (k, ndim)).

        Because of the noise, particles may appear in rim cells outside the workspace. In a
        workspace of H rows and W columns, a rim cell has the row -1 or H, or the column -1 or W.
        """
        kernels.look(self.state, self.rng)
        return np.argwhere(inner_of(self.state.seen, self.shape, rim=1)) - 1
