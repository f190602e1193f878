"""steer(): plan, play, and say what came of it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import permutations
from typing import Any

import numpy as np

from shoal.errors import InvalidInputError
from shoal.steering.contact.disturbances import IDEAL, Disturbance, generators
from shoal.steering.episode import SteeringEpisode
from shoal.steering.planners import Planner, make_planner
from shoal.steering.planners.task import Task, why_approachable, why_unreachable
from shoal.steering.problem import SteeringProblem
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.region import Region
from shoal.version import __version__

MAX_MOVES = 100


def steer(
    problem: SteeringProblem,
    *,
    planner: str | Planner = "shortest",
    disturbance: Disturbance = IDEAL,
    seed: int = 0,
    max_moves: int = MAX_MOVES,
) -> SteeringEpisode:
    """Bring particles to their goals with one shared input.

    Parameters
    ----------
    problem : SteeringProblem
    planner : str or Planner
        "shortest", "greedy", "fewest-moves", "robust", "sampling", "module:attribute" or an object with a name and ``plan``.
    disturbance : Disturbance
        The world's friction, which planners know, and its noise, which they do not. A plan of any planner but "robust" is sent
        as it is.
    seed : int
        Of the noise, and of planners that draw numbers.
    max_moves : int

    Returns
    -------
    SteeringEpisode
        False as a bool unless the problem was solved.

    Raises
    ------
    InvalidInputError, UnknownNameError

    Examples
    --------
    >>> from shoal.steering import SteeringProblem, polygon, steer
    >>> square = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
    >>> episode = steer(SteeringProblem(square, [(0.2, 0.5), (0.4, 0.5)], [(0.3, 0.5), (0.4, 0.5)]))
    >>> episode.status, episode.n_moves, round(episode.path_length, 3)
    ('solved', 3, 0.6)
    """
    if isinstance(max_moves, bool) or not isinstance(max_moves, int) or max_moves < 1:
        raise InvalidInputError(f"max_moves: expected a whole number, 1 or more, got {max_moves!r}")
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise InvalidInputError(f"seed: expected a whole number, 0 or more, got {seed!r}")
    chosen = make_planner(planner)
    world = disturbance.world(problem, seed=seed)
    world.check_state(problem.start, what="start")
    world.check_state(problem.goal, what="goal")
    _check_planner(chosen, problem)
    begun = time.perf_counter()
    best: SteeringEpisode | None = None
    for order in _orders(problem):
        task = Task(_known(world, problem, disturbance), problem.start, problem.goal[order], problem.tolerance, max_moves, seed)
        found = _one_way(chosen, task, problem, world, disturbance, np.array(order), seed)
        if best is None or _rank(chosen, found) < _rank(chosen, best):
            best = found
    assert best is not None
    object.__setattr__(best, "seconds", time.perf_counter() - begun)
    return best


def _check_planner(planner: Planner, problem: SteeringProblem) -> None:
    general = getattr(planner, "general", False)
    if not general and isinstance(problem.workspace, Region):
        raise InvalidInputError(f"planner {planner.name}: expected a convex workspace, got a region (use the planner sampling)")
    if not general and problem.n_particles != 2:
        raise InvalidInputError(
            f"planner {planner.name}: expected 2 particles, got {problem.n_particles} (use the planner sampling)"
        )
    if not hasattr(planner, "plan"):
        raise InvalidInputError(f"planner: expected an object with a name and plan(task), got {planner!r:.80}")


def _orders(problem: SteeringProblem) -> Iterator[list[int]]:
    """Yield which goal each particle goes to: all ways if they are interchangeable."""
    n = problem.n_particles
    yield from (list(order) for order in permutations(range(n))) if problem.interchangeable else ([*range(n)],)


def _known(world: Any, problem: SteeringProblem, disturbance: Disturbance) -> Any:
    """Return the world as planners know it: without the gain and the noise."""
    return Disturbance(friction=disturbance.friction, radius=disturbance.radius).world(problem) if disturbance.gain else world


def _rank(planner: Planner, episode: SteeringEpisode) -> tuple[bool, float, float]:
    """Order ways to choose goals: those that arrive first, then by what the planner makes small."""
    if episode.error > episode.problem.tolerance:
        return True, episode.error, 0.0
    moves, length = float(episode.n_moves), episode.path_length
    return (False, moves, length) if getattr(planner, "prefers", "length") == "moves" else (False, length, moves)


def _one_way(
    planner: Planner, task: Task, problem: SteeringProblem, world: Any, disturbance: Disturbance, order: Any, seed: int
) -> SteeringEpisode:
    """Plan and play with a settled goal for each particle."""
    ideal = not isinstance(problem.workspace, Region) and problem.n_particles == 2
    reason = why_unreachable(task) if ideal else None
    status = "unreachable" if reason else "solved"
    moves: Points | None = np.zeros((0, problem.workspace.dimensions))
    states = None
    rngs = generators(seed)
    if not reason:
        control = getattr(planner, "control", None)
        if control is not None:
            moves, states = control(task, _Apparatus(world, disturbance, rngs))
        elif task.error(task.start) > task.tolerance:
            moves = task.straight()
            moves = planner.plan(task) if moves is None else moves
    if moves is None:
        moves = np.zeros((0, problem.workspace.dimensions))
    too_long = len(moves) if len(moves) > task.max_moves else 0
    if too_long and states is None:
        moves = moves[:0]
    if states is None:
        states = disturbance.replay(problem, moves, seed=seed)
    error = task.error(states[-1])
    if not reason and ideal:
        reason = why_approachable(task)
        status = "approachable" if reason else status
    if not reason and error > problem.tolerance:
        status = "limit"
        reason = _why(moves, error, task, disturbance)
        if too_long:
            reason = f"the plan that was found takes {too_long} moves, more than {task.max_moves}"
    if status == "approachable":
        reason = f"{reason}; this plan comes within {error:.3g}"
    bound = task.lower_bound() if ideal and not disturbance.gain and not disturbance.execution else None
    return SteeringEpisode(
        problem, planner.name, status, reason or "", moves, states, order, disturbance, seed, bound, 0.0, __version__
    )


def _why(moves: Points, error: float, task: Task, disturbance: Disturbance) -> str:
    if not len(moves):
        return "no plan was found"
    if disturbance.random:
        return (
            f"after {len(moves)} moves the particles are {error:.3g} from their goals, and more than {task.tolerance:g} is too far"
        )
    return f"the best plan of at most {task.max_moves} moves comes within {error:.3g}, and more than {task.tolerance:g} is too far"


class _Apparatus:
    """What a planner in a closed loop can do: send a move, look."""

    def __init__(self, world: Any, disturbance: Disturbance, rngs: Any) -> None:
        self._world, self._disturbance = world, disturbance
        _, self._execution, self._camera, self.rng = rngs
        self.noise = disturbance

    def begin(self, start: Points) -> None:
        """Put the particles at the start."""
        self.states = [self._world.initial(start)]
        self.moves: list[Points] = []

    def look(self) -> Points:
        """Return where the camera sees the particles."""
        return self._disturbance.observe(self.states[-1], self._camera)

    def send(self, move: Points) -> None:
        """Move the particles."""
        self.moves.append(np.asarray(move, dtype=np.float64))
        self.states.append(self._disturbance.execute(self._world, self.states[-1], move, self._execution))
