"""Base classes of the planners. Each planner observes every move and keeps its memory in arrays for
kernels.
"""

from __future__ import annotations

import copy
from typing import Any, ClassVar

import numpy as np
from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import Board, letters_of
from shoal.swarm.grid.state import Belief, SwarmState, field_of
from shoal.swarm.kernels import episodes as planner_episode
from shoal.swarm.policies.compiled import Compiled
from shoal.swarm.policies.planners.state import Pace, planner_of, seed_of
from shoal.swarm.policies.planners.tuning import Tuning
from shoal.swarm.policies.protocol import Decision, View

UNLIMITED = 1e9
USUAL = 1000  # number of particles for which the budget is used unchanged
MOST_FEW, MOST_MANY = 10.0, 4.0  # maximum budget factor for fewer and for more particles


@dataclass(frozen=True)
class PlannerPolicy(Compiled):
    """Base class of the planners: policies that simulate moves before they choose a command."""

    runs: ClassVar[bool] = False
    rules: ClassVar[frozenset[str]] = frozenset({"block", "merge"})
    tuning: ClassVar[Tuning | None] = None
    milliseconds: ClassVar[float] = 0.0

    def settings(self, particles: int) -> tuple[float, ...]:
        """Return the planning budget and the tuning for a number of particles, in the form that
        kernels expect.
        """
        return () if self.tuning is None else (UNLIMITED, *self.tuning)

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next command. ``memory`` holds the last command and everything that the
        planner has learnt.
        """
        layout, memory = view.occupied.layout, copy.deepcopy(memory)
        belief = _plannable(view.belief)
        field = field_of(
            belief.open.words, SwarmState(view.occupied), belief
        )  # planners do not read the true state
        if memory is None:
            options = self.settings(len(view.occupied))
            planner = planner_of(
                layout,
                belief,
                rule=view.rule,
                mapping=view.mapping,
                seed=seed_of(rng),
                options=options,
            )
            pace = Pace(self.milliseconds)
        else:
            planner, pace = memory.planner, memory.pace
            planner.memory.remaining = len(belief.frontier)
            # With noise, a scan may classify cells that no particle tried to enter with the last
            # command. The prior does not learn from them: its window around such a cell may lie
            # outside the board.
            entered = belief.open.shifted(letters_of(layout.ndim)[memory.command])
            planner.prior.before[:] |= (belief.known - entered).words.ravel()
            planner_episode.observe_outcome(
                field, view.mapping, planner, memory.command, view.classified
            )
        with pace.timed(planner, 1):
            command = int(planner_episode.choose(self.code, field, view.mapping, planner))
        if command < 0:
            return "", None
        planner.prior.before[:] = field.known
        return letters_of(layout.ndim)[command], _Remembered(planner, command, pace)


def _plannable(belief: Belief) -> Belief:
    """Return a belief without free cells on the rim, where kernels expect none. With noise, a
    belief may err there.
    """
    rim = belief.open & Board.full(belief.open.layout) - Board.of_mask(
        np.ones(belief.open.layout.shape, dtype=np.bool_)
    )
    if not rim:
        return belief
    inside = belief.open - rim
    return Belief(inside, belief.known, belief.frontier & inside.dilated())


@dataclass(frozen=True)
class _Remembered:
    planner: Any
    command: int
    pace: Pace


@dataclass(frozen=True)
class Budgeted(PlannerPolicy):
    """Base class of the planners with an adjustable planning budget.

    Parameters
    ----------
    budget : float
        Planning budget for 1000 particles: the mean number of simulated moves per move sent. For n
        < 1000 particles, the budget is multiplied by min(10, (1000 / n)^2), because a small swarm
        needs more moves and gains more from planning than a large swarm. For n > 1000 particles,
        the budget is multiplied by min(4, n / 1000), because a large swarm needs few moves in
        total. Equal seeds and equal budgets give equal commands on every machine.
    milliseconds : float
        Mean computing time per move in milliseconds. A computing time above 0 replaces the budget,
        and the planner's commands then depend on the speed and load of the machine. Shoal can
        replay an episode with a limit on computing time, because the episode contains the commands.
    """

    budget: float = UNLIMITED
    # an option of this class, but not of the base class
    milliseconds: float = 0.0  # type: ignore[misc]

    def __post_init__(self) -> None:
        if not 0 < self.budget <= 1e12:
            raise InvalidInputError(
                "budget: expected simulated moves a move, above 0 and at most 1e12, got"
                f" {self.budget:g}"
            )
        if not 0 <= self.milliseconds <= 1e9:
            raise InvalidInputError(
                f"milliseconds: expected a time a move, 0 to 1e9, got {self.milliseconds:g}"
            )

    def settings(self, particles: int) -> tuple[float, ...]:
        """Return the planning budget and the tuning for a number of particles, in the form that
        kernels expect.
        """
        assert self.tuning is not None
        few, many = (
            min(MOST_FEW, (USUAL / max(1, particles)) ** 2),
            min(MOST_MANY, particles / USUAL),
        )
        return (self.budget * max(few, many), *self.tuning)
