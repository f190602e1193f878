"""The planners beam-rollout, alias ``best``, and greedy-classify: their options, their decisions,
and what planning costs.

The kernels of `shoal.swarm.kernels.planning.plan_search` choose the commands. A planner observes
every move, and keeps its memory in arrays for these kernels. Source: docs/concepts/planners.md.
"""

from __future__ import annotations

import copy
from math import floor, log10, prod
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import Board, GridLayout, letters_of
from shoal.swarm.grid.state import Belief, SwarmState, field_of, pushed
from shoal.swarm.kernels import episodes
from shoal.swarm.policies.compiled import Compiled
from shoal.swarm.policies.planners.state import Pace, Tuning, planner_of, seed_of
from shoal.swarm.policies.protocol import Decision, View

if TYPE_CHECKING:
    from numpy.random import Generator

USUAL = 1000  # number of particles for which the budget is used unchanged
MOST_FEW, MOST_MANY = 10.0, 4.0  # maximum budget factor for fewer and for more particles
MOST_SECONDS = (
    60.0  # longest planning time, estimated for a usual machine, that the policy auto chooses
)
LEAST_BUDGET = 10.0  # a smaller budget gives no fewer moves than the policy closest-frontier
SHARE = 0.65  # moves of the planner best relative to the policy closest-frontier
NOISY = 1.6  # moves with noise relative to moves without noise
PREDICTION, SIMULATION = (
    1.5e-6,
    1e-8,
)  # seconds per word of a board: for each move sent, and for each simulated move

TUNING = Tuning(
    end_frontier=200,
    end_surprise=0.3,
    horizon=120,
    discount=0.99,
    far_surprise=0.1,
    far_horizon=1000,
    far_discount=0.999,
    frontier_worth=25,
    surprise_weight=35,
    future_weight=1,
    beam_width=10,
    beam_depth=5,
    beam_leaves=8,
    run_candidates=1,
    variations=3,
    free_threshold=0.75,
    prediction_layers=200,
    joint_chance=0.7,
    learned=1,
    force_after=450,
)


@dataclass(frozen=True)
class PlannerPolicy(Compiled):
    """Base class of the planners: policies that simulate moves before they choose a command."""

    runs: ClassVar[bool] = False
    rules: ClassVar[frozenset[str]] = frozenset({"block", "merge"})
    milliseconds: ClassVar[float] = 0.0

    def settings(self, particles: int) -> tuple[float, ...]:
        """Return the planning budget and the tuning for a number of particles, in the form that
        kernels expect.
        """
        return ()

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
            # command. The prior does not learn from them: the cells around such a cell may lie
            # outside the board.
            entered = belief.open.shifted(letters_of(layout.ndim)[memory.command])
            planner.prior.before[:] |= (belief.known - entered).words.ravel()
            episodes.observe_outcome(field, view.mapping, planner, memory.command, view.classified)
        quiet = int(planner.memory.quiet)
        if memory is not None and quiet > 0 and _is_astray(memory, view, belief):
            if planner.memory.forced > 0:  # a path from a cell where its particle is not
                planner.memory.forced = planner.memory.plan_at = planner.memory.plan_length = 0
            if quiet < planner.options.force_after:
                planner.memory.quiet = 0  # the kernel plans anew after a move that is not quiet
        with pace.timed(planner, 1):
            command = int(episodes.choose(self.code, field, view.mapping, planner))
        planner.memory.quiet = quiet
        if command < 0:
            return "", None
        planner.prior.before[:] = field.known
        return letters_of(layout.ndim)[command], _Remembered(
            planner, command, pace, belief, view.occupied
        )


def _is_astray(memory: _Remembered, view: View, belief: Belief) -> bool:
    """Return whether the last command, which classified no cell, had another effect than planned:
    particles are elsewhere, or an unclassified cell was tried and is unclassified still.

    Only noise can make it so.
    """
    before, layout = memory.belief, view.occupied.layout
    entered = memory.occupied.shifted(letters_of(layout.ndim)[memory.command])
    if view.mapping and entered & before.frontier & belief.frontier:
        return True
    state = SwarmState(memory.occupied)
    expected = pushed(layout, before.open.words, state, memory.command, view.rule)
    return expected.occupied != view.occupied


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
    belief: Belief
    occupied: Board


@dataclass(frozen=True)
class GreedyClassify(PlannerPolicy):
    """Send the command that immediately classifies the most frontier cells.

    If no command classifies a cell immediately, send the commands of a shortest path to a frontier
    cell.

    Every episode of the policy greedy-classify ends, because each command or path classifies at
    least one cell. Source: docs/concepts/planners.md.
    """

    kind: ClassVar[str] = "greedy-classify"
    code: ClassVar[int] = episodes.GREEDY


@dataclass(frozen=True)
class BeamRollout(PlannerPolicy):
    """Simulate candidate plans in the predicted world, and send the first command of the best plan.

    The names ``best`` and ``beam-rollout`` mean the same policy.

    The candidate plans are the rest of the last plan, single commands, runs in one direction, the
    best plans of a beam search, and random variations of the best candidate. A greedy base policy
    completes each candidate plan. After 450 consecutive moves that classify no cell, the planner
    sends all commands of the shortest path to a frontier cell, so that every episode ends. Source:
    docs/concepts/planners.md.

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

    kind: ClassVar[str] = "beam-rollout"
    code: ClassVar[int] = episodes.BEAM_ROLLOUT
    tuning: ClassVar[Tuning] = TUNING
    budget: float = 1000.0
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

        For fewer than 1000 particles, the planning budget is larger, and the planner tries more
        random variations of plans. For more than 1000 particles, the planning budget is larger, the
        beam search is wider and deeper, and the early classification of cells has less weight. The
        planner then simulates plans to the end even if the frontier is large, because many
        particles classify all cells in few moves. With a limit on computing time, the number of
        variations and the size of the beam search do not depend on the number of particles.
        """
        fewer, more = min(MOST_FEW, USUAL / max(1, particles)), min(MOST_MANY, particles / USUAL)
        tuning, many = self.tuning, max(1.0, more)
        tuning = tuning._replace(
            end_frontier=tuning.end_frontier * many, frontier_worth=tuning.frontier_worth / many
        )
        if not self.milliseconds:
            tuning = tuning._replace(
                variations=tuning.variations * max(1.0, fewer),
                beam_width=tuning.beam_width * many**2,
                beam_depth=tuning.beam_depth * many**0.5,
            )
        return (self.budget * max(min(MOST_FEW, fewer**2), more), *tuning)


def expected_moves(n_free: int, particles: int, *, noisy: bool = False) -> float:
    """Return the number of moves that the planner best usually needs for a mapping.

    The formula is a fit to episodes of 500 to 100,000 free cells with 5 to 200 free cells for each
    particle. It is right within a factor of 2.
    """
    crowding = max(1.0, n_free / max(1, particles))
    return SHARE * 8.0 * float(crowding**0.8 * n_free**0.25) * (NOISY if noisy else 1.0)


def planning_seconds(
    policy: BeamRollout, shape: tuple[int, ...], n_free: int, particles: int, *, noisy: bool = False
) -> float:
    """Return the planning time of an episode of mapping on a usual machine, in seconds."""
    moves = expected_moves(n_free, particles, noisy=noisy)
    if policy.milliseconds:
        return moves * policy.milliseconds / 1000
    return (
        moves
        * prod(GridLayout(shape).words)
        * (PREDICTION + SIMULATION * policy.settings(particles)[0])
    )


def fit_planner(
    shape: tuple[int, ...], n_free: int, particles: int, *, noisy: bool = False
) -> BeamRollout | None:
    """Return the planner best with a budget at which an episode takes at most about `MOST_SECONDS`.

    If the usual budget is small enough, the planner has the usual budget. If even the budget
    `LEAST_BUDGET` takes longer, return None.
    """
    usual = BeamRollout()
    if planning_seconds(usual, shape, n_free, particles, noisy=noisy) <= MOST_SECONDS:
        return usual
    per_move = (
        MOST_SECONDS
        / expected_moves(n_free, particles, noisy=noisy)
        / prod(GridLayout(shape).words)
    )
    budget = (per_move - PREDICTION) / (SIMULATION * BeamRollout(budget=1.0).settings(particles)[0])
    if budget < LEAST_BUDGET:
        return None
    unit = 10.0 ** floor(log10(budget))
    return BeamRollout(budget=round(floor(budget / unit) * unit))
