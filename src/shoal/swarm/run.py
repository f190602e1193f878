"""Run one episode of a swarm problem.

If kernels support the policy, the task, the scan rule and the noise of a problem, compiled code
runs the whole episode. If kernels do not support a problem, Python code runs the episode.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from numpy.random import Generator

from shoal.core.checks import check_integer
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError
from shoal.core.version import versions
from shoal.jit import Stopwatch
from shoal.swarm.episode import SwarmEpisode
from shoal.swarm.grid.board import trial_rng
from shoal.swarm.policies import (
    Budgeted,
    ClosestFrontier,
    Compiled,
    Offline,
    PlannerPolicy,
    Policy,
    RandomMoves,
    shown_name,
)
from shoal.swarm.policies.planners.cost import SHARE, expected_moves
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.simulation.compiled import (
    Game,
    NoisyGame,
    PlannerGame,
    SearchGame,
    compiled_loop,
    is_compiled,
)
from shoal.swarm.simulation.loop import OnMoves, OnTrace, Stop, closed_loop, make_decider
from shoal.swarm.simulation.swarms import ExactSwarm, NoisySwarm, draw_start, swarm_of

MEASURED, PILOT = (
    1.0,
    2.0,
)  # seconds of an episode, and of its run by closest-frontier, from which its duration is estimated


def run(
    problem: SwarmProblem,
    *,
    seed: int = 0,
    trial: int = 0,
    stepwise: bool = False,
    on_moves: OnMoves | None = None,
    on_trace: OnTrace | None = None,
    stop: Stop | None = None,
) -> SwarmEpisode:
    """Run one episode of a swarm problem.

    Parameters
    ----------
    problem : SwarmProblem
    seed, trial : int
        Seed and trial number, at least 0. The seed and the trial number together determine all
        random numbers of the episode. Two runs of a problem with equal seeds and equal trial
        numbers give equal episodes.
    stepwise : bool
        Whether to run a built-in policy command by command in Python, like a third-party policy.
        The option ``stepwise`` does not change the episode.
    on_moves : callable, optional
        Function that `run` calls during the episode, with the number of moves made and the number
        of remaining frontier cells.
    on_trace : callable, optional
        Function that `run` calls during the episode, with each new piece of the trace.
    stop : callable, optional
        Function that `run` calls several times a second. If it returns true, the episode ends after
        the moves made so far, with the status "interrupted".

    Returns
    -------
    SwarmEpisode

    Raises
    ------
    InvalidInputError, UnknownNameError
        Raised if the settings of the problem are invalid.

    Examples
    --------
    >>> episode = run(SwarmProblem([[1, 1, 1, 1]], particles=4, policy="closest-frontier"))
    >>> str(episode.status), episode.commands
    ('complete', 'ludr')
    """
    if not isinstance(problem, SwarmProblem):
        raise InvalidInputError(f"problem: expected a SwarmProblem, got {type(problem).__name__}")
    seed, trial = (
        check_integer(seed, what="seed", least=0),
        check_integer(trial, what="trial", least=0),
    )
    problem.check_at_place()
    rng = trial_rng(seed, trial)
    start, targets = draw_start(problem, rng)
    swarm = swarm_of(problem, start, targets, seed, trial)
    first, watch = len(swarm.belief.frontier), Stopwatch()
    game = (
        None
        if stepwise or (swarm.belief.complete and swarm.finished)
        else _game(problem, swarm, rng)
    )
    if game is None:
        mapping = getattr(problem.chosen_task, "mapping", True)
        decider = make_decider(problem, swarm.belief, rng, getattr(swarm, "noisy", None))
        limit = problem.max_moves
        trace, status = closed_loop(
            swarm,
            decider,
            max_moves=limit,
            mapping=mapping,
            on_moves=on_moves,
            on_trace=on_trace,
            stop=stop,
        )
    else:
        trace, status = compiled_loop(game, problem.max_moves, on_moves, on_trace, stop=stop)
    return SwarmEpisode(
        problem=problem,
        start=start,
        targets=targets,
        trace=trace,
        status=status,
        policy=shown_name(problem.chosen_policy, problem.policy),
        first_frontier=first,
        seed=seed,
        trial=trial,
        seconds=watch.seconds,
        versions=versions(),
    )


def check(problem: SwarmProblem) -> None:
    """Refuse a problem that cannot run, without running it. The function draws one start, as a
    third-party placement may fail.

    Raises
    ------
    InvalidInputError, UnknownNameError
    """
    problem.check_at_place()
    draw_start(problem, trial_rng(0, 0))


class Duration(NamedTuple):
    """How long an episode of a planner is expected to take.

    Attributes
    ----------
    moves : float
        Expected number of moves.
    seconds : float
        Expected computing time of the episode.
    """

    moves: float
    seconds: float


def expected_duration(problem: SwarmProblem, *, seed: int = 0, trial: int = 0) -> Duration | None:
    """Return how long an episode is expected to take, or None if the policy is no planner or the
    task is a third party's.

    The function plays the episode with the policy closest-frontier, which takes a fraction of a
    second, and `MEASURED` seconds of the episode itself. The expectation is right within a factor
    of about 2.

    Raises
    ------
    InvalidInputError, UnknownNameError
        Raised if the settings of the problem are invalid.
    """
    policy = problem.chosen_policy
    if not isinstance(policy, Budgeted) or not is_compiled(problem.chosen_task):
        return None
    pilot = problem.replaced(policy="closest-frontier", budget=None, time_per_move=None).at_place(
        problem.place
    )
    watch = Stopwatch()
    piloted = run(pilot, seed=seed, trial=trial, stop=lambda: watch.seconds > PILOT)
    moves = SHARE * piloted.moves
    if piloted.status is Status.INTERRUPTED:
        moves = max(
            moves,
            expected_moves(
                problem.place.n_free, problem.particles, noisy=problem.noise is not None
            ),
        )
    moves = min(float(problem.max_moves), moves)
    if policy.milliseconds:
        return Duration(moves, moves * policy.milliseconds / 1000)
    load_kernels(problem)
    watch = Stopwatch()
    begun = run(problem, seed=seed, trial=trial, stop=lambda: watch.seconds > MEASURED)
    if begun.status is not Status.INTERRUPTED:
        return Duration(begun.moves, begun.seconds)
    moves = max(moves, begun.moves)
    return Duration(moves, begun.seconds_per_move * moves)


def _game(problem: SwarmProblem, swarm: ExactSwarm | NoisySwarm, rng: Generator) -> Game | None:
    """Return the object that runs an episode in compiled code, or None if kernels do not support
    the problem.
    """
    policy, task, scanning = problem.chosen_policy, problem.chosen_task, problem.scanning
    if isinstance(swarm, NoisySwarm):
        return (
            NoisyGame(policy, swarm.noisy, swarm.rng, every=scanning.step)
            if isinstance(policy, ClosestFrontier)
            else None
        )
    # The commands of random-moves are drawn in advance, one per move. Runs of several equal
    # commands are therefore not compiled.
    one_by_one = isinstance(policy, RandomMoves) and not scanning.every_move
    if not isinstance(policy, Compiled) or not is_compiled(task) or one_by_one:
        return None
    options: dict[str, Any] = {
        "rule": problem.rule,
        "mapping": getattr(task, "mapping", True),
        "rng": rng,
    }
    if isinstance(policy, PlannerPolicy):
        return PlannerGame(policy, swarm.world.free, swarm.state, swarm.belief, **options)
    n_free = swarm.world.workspace.n_free
    return SearchGame(
        policy,
        swarm.world.free,
        swarm.state,
        swarm.belief,
        **options,
        n_free=n_free,
        scanning=scanning,
    )


def load_kernels(problem: SwarmProblem) -> None:
    """Load or compile the kernels that a problem needs, by running a similar problem on a map of
    two cells.
    """
    policy, task = problem.chosen_policy, problem.chosen_task
    if isinstance(policy, Compiled | Offline) and is_compiled(task):
        budget = {"budget": 1.0} if isinstance(policy, Offline) else {}
        prices = {
            name: getattr(problem, name)
            for name in ("rule", "scan_every", "slip", "misplace", "miss")
        }
        _load_kernels(
            "mapping" if getattr(task, "mapping", True) else "coverage",
            type(policy)(**budget),
            **prices,
        )


@cache
def _load_kernels(task: str, policy: Policy, **fields: Any) -> None:
    run(SwarmProblem([[1, 1]], particles=1, task=task, policy=policy, **fields))
