"""What a planner costs: the expected number of moves and the planning time, estimated from sizes
alone.

The estimates do not depend on the machine, because the policy ``auto`` chooses by them, and equal
problems must give equal episodes on every machine. The function `shoal.swarm.run.expected_duration`
measures the speed of the machine in addition.
"""

from __future__ import annotations

from math import floor, log10, prod

from shoal.swarm.grid.board import GridLayout
from shoal.swarm.policies.planners.beam_rollout import BeamRollout
from shoal.swarm.policies.planners.planner_policy import Budgeted

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


def expected_moves(n_free: int, particles: int, *, noisy: bool = False) -> float:
    """Return the number of moves that the planner best usually needs for a mapping.

    The formula is a fit to episodes of 500 to 100,000 free cells with 5 to 200 free cells for each
    particle. It is right within a factor of 2.
    """
    crowding = max(1.0, n_free / max(1, particles))
    return SHARE * 8.0 * float(crowding**0.8 * n_free**0.25) * (NOISY if noisy else 1.0)


def planning_seconds(
    policy: Budgeted, shape: tuple[int, ...], n_free: int, particles: int, *, noisy: bool = False
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
