"""Policy offline: compute a complete plan of commands for a known map before the first move."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_integer
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import decode, trial_rng
from shoal.swarm.grid.scans import Trace
from shoal.swarm.grid.state import RULE_CODES, Belief, SwarmState, field_of
from shoal.swarm.grid.tasks import Coverage
from shoal.swarm.grid.world import GridWorld, check_start
from shoal.swarm.kernels import episodes
from shoal.swarm.kernels.moves import RUNNING
from shoal.swarm.kernels.planning import anneal, plan_search
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.policies.compiled import check_rules
from shoal.swarm.policies.planners.beam_rollout import BeamRollout
from shoal.swarm.policies.planners.state import Tuning, planner_of, seed_of
from shoal.swarm.policies.protocol import Decision, View

if TYPE_CHECKING:
    from numpy.random import Generator

# default number of simulated moves per command, large because no robot waits between two commands
PLAN_BUDGET = 32_000.0
FIRST_SHARE = 0.25  # fraction of the budget for the initial plan of the annealing
HEAT, COOL = (
    3.0,
    0.1,
)  # typical accepted increase of the plan length, in moves, at the first and at the last temperature
LEAST = 200  # a plan of fewer commands gets the budget of a plan with this number of commands
# number of calls of the annealing kernel, one for each temperature; Python can be interrupted
# between two calls
PIECES = 60
PLACES = 64  # states stored along a plan


@dataclass(frozen=True)
class FirstPlan(BeamRollout):
    """The planner beam-rollout with a wider search, for the initial plan of the policy offline."""

    kind: ClassVar[str] = "offline"
    tuning: ClassVar[Tuning] = BeamRollout.tuning._replace(
        beam_width=24, beam_depth=12, beam_leaves=6
    )

    def settings(self, particles: int) -> tuple[float, ...]:
        """Return the planning budget and the tuning, which do not depend on the number of
        particles.
        """
        return (self.budget, *self.tuning)


@dataclass(frozen=True)
class Offline:
    """Send the plan of `plan_coverage`. The policy needs the map, so it cannot map an unknown
    workspace.

    Parameters
    ----------
    budget : float
        Planning budget: the mean number of simulated moves per command of the plan.
    """

    kind: ClassVar[str] = "offline"
    gathers: ClassVar[bool] = False
    budget: float = PLAN_BUDGET

    def __post_init__(self) -> None:
        if not 0 < self.budget <= 1e12:
            raise InvalidInputError(
                "budget: expected simulated moves a command, above 0 and at most 1e12, got"
                f" {self.budget:g}"
            )

    @property
    def name(self) -> str:
        """The registered name of the policy. A budget that differs from the default is part of the
        name.
        """
        return self.kind if self.budget == PLAN_BUDGET else f"{self.kind}:budget={self.budget:g}"

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return all commands of the plan at the first decision, and no commands at later
        decisions.
        """
        if memory is not None:
            return "", memory
        if view.mapping:
            raise InvalidInputError(
                "policy offline: expected a task whose map is known, such as coverage, got a"
                " mapping"
            )
        # Particles that share a cell stay together forever, so one particle per cell is enough.
        state = SwarmState.of_cells(
            view.occupied.layout, view.occupied.cells, shared=view.rule == "merge"
        )
        return plan_from(view.belief, state, view.rule, self.budget, rng), "sent"


def plan_coverage(
    workspace: GridWorkspace,
    start: ArrayLike,
    *,
    targets: NDArray[np.bool_] | None = None,
    rule: str = "block",
    budget: float = PLAN_BUDGET,
    attempts: int = 1,
    seed: int = 0,
) -> str:
    """Return commands under which the particles visit every free cell of a known map, or every
    target cell.

    The planner beam-rollout makes an initial plan. The planner uses the true map in place of a
    predicted map. Simulated annealing then shortens the initial plan.

    Parameters
    ----------
    workspace : GridWorkspace
    start : array_like of int, shape (n, ndim)
        Start cells of the particles.
    targets : ndarray of bool, the shape of the workspace, optional
        The cells that the particles must cover. By default, the particles must cover all free
        cells.
    rule : str
        The move rule: "block" or "merge".
    budget : float
        Planning budget: the mean number of simulated moves per command of the plan. A plan of fewer
        than 200 commands gets as many simulated moves as a plan of 200 commands.
    attempts : int
        Number of plans to compute. Each plan uses different random numbers. The function returns
        the shortest plan.
    seed : int

    Raises
    ------
    InvalidInputError
        Raised if particles cannot reach a target cell, or if an argument is invalid.

    Examples
    --------
    >>> plan_coverage(GridWorkspace([[1, 1, 1, 1, 1]]), [(0, 1)])
    'lrrrr'

    Notes
    -----
    Source: docs/concepts/planners.md.
    """
    check_integer(attempts, what="attempts", least=1)
    world = GridWorld(workspace, rule)
    state = world.initial(check_start(workspace, start, rule=rule))
    required = workspace.free if targets is None else np.asarray(targets, dtype=np.bool_)
    belief = Coverage().begin(world, state, required)
    plans = [
        plan_from(belief, state, rule, budget, trial_rng(seed, trial)) for trial in range(attempts)
    ]
    return min(plans, key=len)


def plan_from(belief: Belief, state: SwarmState, rule: str, budget: float, rng: Generator) -> str:
    """Return commands that cover the remaining frontier cells of a known map."""
    check_rules(FirstPlan(), state.occupied.layout, rule)
    if belief.complete:
        return ""
    planner, first = first_plan(belief, state, rule, budget * FIRST_SHARE, rng)
    capacity = 2 * len(first) + 8 * anneal.LONGEST_CHANGE
    every = max(4, -(-capacity // PLACES))
    plan, trial, shortest = (np.zeros(capacity, dtype=np.int8) for _ in range(3))
    checkpoints = np.zeros((capacity // every + 1, *planner.root.shape), dtype=np.uint64)
    course = anneal.AnnealedPlan(plan, trial, shortest, checkpoints, every)
    plan[: len(first)] = shortest[: len(first)] = first
    length = fewest = len(first)
    plan_search.prepare(field_of(belief.open.words, state, belief), False, planner)
    total = budget * (1 - FIRST_SHARE) * max(LEAST, len(first))
    for heat in np.geomspace(HEAT, COOL, PIECES):
        length, fewest, _ = anneal.anneal(planner, course, length, fewest, heat, total / PIECES)
    return decode(shortest[:fewest])


def first_plan(
    belief: Belief, state: SwarmState, rule: str, budget: float, rng: Generator
) -> tuple[Any, NDArray[np.int8]]:
    """Return the planner that has made an initial plan, and the commands of the initial plan as
    codes 0 to 5.
    """
    policy = FirstPlan(budget=budget)
    options = policy.settings(len(state.occupied))
    planner = planner_of(
        belief.open.layout, belief, rule=rule, mapping=False, seed=seed_of(rng), options=options
    )
    field = field_of(belief.open.words, state, belief)  # changed while the plan is simulated
    pieces, status = [], RUNNING
    while status == RUNNING:
        trace = Trace.empty(256)
        played, status = episodes.play_planner(
            policy.code, field, RULE_CODES[rule], False, planner, trace
        )
        pieces.append(trace.commands[:played])
    return planner, np.concatenate(pieces)
