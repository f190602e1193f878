"""Chains of wall contacts, and queries for chains."""

from __future__ import annotations

from dataclasses import field, replace
from functools import cached_property
from math import inf

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.jit import working_time
from shoal.steering.kernels.chain import settle
from shoal.steering.kernels.chain_limits import Kind, new_work
from shoal.steering.kernels.cycles import CycleModel
from shoal.steering.planners.chains.kinds import bounds_of, lengths_over_walls
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.normalized_walls import NormalizedWalls

MARGIN = 1e-8  # relative to the size: distance of the other particle from the walls
ENOUGH = 1e-7  # distance from all limits of a first guess on flat walls
ROOM = 1e-4  # distance from all limits of a first guess on a circle
REFINING = np.array([20.0 * 12.0**k for k in range(8)])
_DEEPEST = 12  # cycles of a chain that is refined without search


@dataclass(frozen=True, eq=False)
class Chain:
    """A sequence of cycles (a wall contact, then an adjustment by the other particle), in the units of `NormalizedWalls`.

    Parameters
    ----------
    touchers : ndarray of int64, shape (cycles,)
        Index, 0 or 1, of the particle that a wall holds in each cycle (the toucher).
    walls : ndarray of int64, shape (cycles,)
        Index of the wall that holds the touching particle in each cycle.
    unknowns : ndarray of float64, shape (cycles (d - 1) + (cycles - 1) d,)
        Positions of the contacts along their walls, followed by the position differences of the particles between the cycles.
    length : float
        Total length of the moves; infinite if the length has not been computed.
    last : ndarray of float64, shape (d,), optional
        The position difference after the last cycle, if it is not the position difference of the goals.
    """

    touchers: NDArray[np.int64]
    walls: NDArray[np.int64]
    unknowns: NDArray[np.float64]
    length: float
    last: Points | None = None

    @property
    def cycles(self) -> int:
        """Number of cycles, each with one wall contact."""
        return len(self.walls)

    def contacts(self, walls: NormalizedWalls) -> Points:
        """Return the positions of the wall contacts; float64, shape (cycles, d)."""
        d, flat = walls.dimensions, self.walls < len(walls.frames)
        along, contacts = self.unknowns[: self.cycles * (d - 1)].reshape(-1, d - 1), np.empty((self.cycles, d))
        frames = walls.frames[self.walls[flat]]
        contacts[flat] = frames[:, 0] + np.einsum("mk,mki->mi", along[flat], frames[:, 1:])
        if not flat.all():
            angles = along[~flat, 0] / walls.circle[2]
            contacts[~flat, :2] = walls.circle[2] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            contacts[~flat, 2:] = along[~flat, 1:]
        return contacts

    def differences(self, before: Points, after: Points) -> Points:
        """Return the position difference of the particles at the start and after each cycle; float64, shape (cycles + 1, d)."""
        d = len(before)
        between = self.unknowns[self.cycles * (d - 1) :].reshape(-1, d)
        return np.concatenate([before[None], between, (after if self.last is None else self.last)[None]])


class StartAndGoal:
    """Base class of a query: start and goal of two particles, and the time at which the search for a plan must stop."""

    start: Points
    goal: Points
    deadline: float

    @property
    def late(self) -> bool:
        """Whether the deadline of the search has passed."""
        return working_time() > self.deadline

    @property
    def before(self) -> Points:
        """The position difference Δ of the particles at the start."""
        return np.asarray(self.start[1] - self.start[0])

    @property
    def after(self) -> Points:
        """The position difference Δ of the goals."""
        return np.asarray(self.goal[1] - self.goal[0])


@dataclass(frozen=True, eq=False)
class ChainQuery(StartAndGoal):
    """A request for a chain of wall contacts: start, goal, walls and friction, in the units of `NormalizedWalls`.

    Parameters
    ----------
    walls : NormalizedWalls
    start, goal : ndarray of float64, shape (2, d)
    friction : float
        Coefficient of friction of the walls. With infinite friction, a particle that is pushed into a wall never slides.
    margin : float
        Minimum distance between the walls and the particle that touches no wall, in the units of `NormalizedWalls`.
    push : float
        Minimum component of each adjustment into the wall that holds the touching particle, in the units of `NormalizedWalls`.
    rounds : ndarray of float64
        For each round of the optimization, the sharpness of the barrier function that keeps a chain inside its limits. The
        lower the last sharpness is, the farther from its limits the chain stays.
    deadline : float
        Time at which the search stops, in seconds on the clock `shoal.jit.working_time`.
    """

    walls: NormalizedWalls
    start: Points
    goal: Points
    friction: float = inf
    margin: float = MARGIN
    push: float = 1e-9
    rounds: NDArray[np.float64] = field(default_factory=lambda: REFINING)
    deadline: float = inf

    def model(self, inside: float = 1.0) -> CycleModel:
        """Return the walls and constants for kernels that compute cycles, with ``margin`` and ``push`` multiplied by ``inside``."""
        walls = self.walls
        return CycleModel(
            walls.frames, walls.reaches, walls.normals, walls.offsets, walls.circle, self.friction, self.margin * inside,
            self.push * inside,
        )  # fmt: skip

    def flat(self) -> ChainQuery:
        """Return the query in the plane, without vertical coordinates."""
        assert self.walls.base is not None
        return replace(self, walls=self.walls.base, start=self.start[:, :2].copy(), goal=self.goal[:, :2].copy())

    def settle(
        self,
        guess: NDArray[np.float64],
        touchers: NDArray[np.int64],
        on: NDArray[np.int64],
        *,
        enough: float = ENOUGH,
        rounds: NDArray[np.float64] | None = None,
        bound: float = inf,
    ) -> float:
        """Change the unknowns ``guess`` of a chain in place, so that the chain becomes feasible and short.

        ``touchers`` and ``on`` hold the touching particle and the wall of each cycle. The method returns the length of the
        resulting chain, or infinity if the optimization finds no feasible chain.
        """
        kind = Kind(touchers, on, self.start, self.goal, self.walls.shape, self.friction, self.margin, self.push)
        work = new_work(len(on), self.walls.dimensions)
        return float(settle(guess, enough, self.rounds if rounds is None else rounds, bound, kind, work))

    @cached_property
    def _lengths_over_walls(self) -> NDArray[np.float64]:
        return lengths_over_walls(self.start, self.goal, self.walls)

    def bounds_of(self, touchers: NDArray[np.int64], on: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return, for each kind of chain, a lower bound on the length of all chains of this kind; float64, shape (kinds,).

        A kind of chain is a sequence of touching particles (a row of ``touchers``) and walls (a row of ``on``); both arrays have
        the shape (kinds, cycles).
        """
        return bounds_of(touchers, on, self.start, self.goal, self.walls, self._lengths_over_walls)

    def guess(self, cycles: int) -> NDArray[np.float64]:
        """Return initial unknowns: contacts at the midpoints of walls, and a position difference after each cycle except the last.

        The guessed position differences are equally spaced on the straight line from the start's difference to the goals'
        difference, and then divided by 2.
        """
        between = (self.before + (self.after - self.before) * np.arange(1, cycles)[:, None] / cycles) / 2
        return np.concatenate((np.zeros(cycles * (self.walls.dimensions - 1)), between.ravel()))


def refined(query: ChainQuery, chain: Chain) -> Chain:
    """Return the shortest chain that has the same touching particles and walls as ``chain``.

    If ``chain`` has more than 12 cycles, or if the optimization fails, the result is ``chain`` itself.
    """
    if chain.cycles > _DEEPEST:
        return chain
    if chain.last is not None:  # use the difference that the chain really reaches
        off = (chain.last - query.after) / 2
        query = replace(query, goal=query.goal + np.stack([-off, off]))
    guess = chain.unknowns.copy()
    length = query.settle(guess, chain.touchers, chain.walls)
    return replace(chain, unknowns=guess, length=length) if length < inf else chain
