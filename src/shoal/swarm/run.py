"""Run one episode of a swarm problem.

If kernels support the policy, the task, the scan rule and the noise of a problem, compiled code
runs the whole episode. If kernels do not support a problem, Python code runs the episode.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from numpy.random import Generator

from shoal.core.checks import check_function, check_integer
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError
from shoal.core.version import versions
from shoal.jit import Stopwatch
from shoal.swarm.episode import SwarmEpisode
from shoal.swarm.grid.board import Board, trial_rng
from shoal.swarm.grid.tasks import Gathering
from shoal.swarm.policies import (
    BeamRollout,
    ClosestFrontier,
    Compiled,
    Offline,
    PlannerPolicy,
    Policy,
    RandomMoves,
)
from shoal.swarm.policies.planners.beam_rollout import SHARE, expected_moves
from shoal.swarm.problem import SwarmProblem, SwarmSetup
from shoal.swarm.simulation.compiled import (
    Game,
    NoisyGame,
    PlannerGame,
    PolicyGame,
    compiled_loop,
    is_compiled,
)
from shoal.swarm.simulation.gathering import GatheringGame
from shoal.swarm.simulation.loop import OnMoves, OnTrace, Stop, closed_loop, make_decider
from shoal.swarm.simulation.swarms import ExactSwarm, NoisySwarm, begin_swarm

# seconds of an episode, and of its run by closest-frontier, from which its duration is estimated
MEASURED, PILOT = 1.0, 2.0


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
    check_function(on_moves, what="on_moves")
    check_function(on_trace, what="on_trace")
    if not isinstance(problem, SwarmProblem):
        raise InvalidInputError(f"problem: expected a SwarmProblem, got {type(problem).__name__}")
    seed = check_integer(seed, what="seed", least=0)
    trial = check_integer(trial, what="trial", least=0)
    setup, rng = problem.setup, trial_rng(seed, trial)
    start, targets = setup.draw_start(rng)
    swarm = begin_swarm(setup, start, targets, seed, trial)
    first, watch = len(swarm.belief.frontier), Stopwatch()
    complete = swarm.belief.complete and swarm.finished
    region = None if targets is None else Board.of_mask(targets)
    game = None if stepwise or complete else _game(setup, swarm, region, rng)
    if game is not None:
        trace, status = compiled_loop(game, problem.max_moves, on_moves, on_trace, stop=stop)
    else:
        trace, status = closed_loop(
            swarm,
            make_decider(setup, swarm.belief, rng, getattr(swarm, "noisy", None)),
            max_moves=problem.max_moves,
            mapping=setup.mapping,
            on_moves=on_moves,
            on_trace=on_trace,
            stop=stop,
            targets=region,
        )
    return SwarmEpisode(
        problem=problem,
        start=start,
        targets=targets,
        trace=trace,
        status=status,
        policy=setup.policy_name,
        first_frontier=first,
        seed=seed,
        trial=trial,
        seconds=watch.seconds,
        versions=versions(),
    )


def check(problem: SwarmProblem) -> None:
    """Refuse a problem that cannot run, without running it. The function draws one start, as a
    third-party placement may fail.
    """
    problem.setup.draw_start(trial_rng(0, 0))


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
    setup = problem.setup
    policy = setup.policy
    if not isinstance(policy, BeamRollout) or not is_compiled(setup.task):
        return None
    pilot = problem.replaced(policy="closest-frontier", budget=None, time_per_move=None).at_place(
        setup.workspace
    )
    watch = Stopwatch()
    pilot_episode = run(pilot, seed=seed, trial=trial, stop=lambda: watch.seconds > PILOT)
    moves = SHARE * pilot_episode.moves
    if pilot_episode.status is Status.INTERRUPTED:
        moves = max(
            moves,
            expected_moves(
                setup.workspace.n_free, problem.particles, noisy=problem.noise is not None
            ),
        )
    moves = min(float(problem.max_moves), moves)
    if policy.milliseconds:
        return Duration(moves, moves * policy.milliseconds / 1000)
    load_kernels(problem)
    watch = Stopwatch()
    episode = run(problem, seed=seed, trial=trial, stop=lambda: watch.seconds > MEASURED)
    if episode.status is not Status.INTERRUPTED:
        return Duration(episode.moves, episode.seconds)
    moves = max(moves, episode.moves)
    return Duration(moves, episode.seconds_per_move * moves)


def _game(
    setup: SwarmSetup, swarm: ExactSwarm | NoisySwarm, region: Board | None, rng: Generator
) -> Game | None:
    """Return the object that runs an episode in compiled code, or None if kernels do not support
    the problem.
    """
    policy, scanning = setup.policy, setup.problem.scanning
    if isinstance(swarm, NoisySwarm):
        return (
            NoisyGame(policy, swarm.noisy, swarm.rng, every=scanning.step)
            if isinstance(policy, ClosestFrontier)
            else None
        )
    if isinstance(setup.task, Gathering):
        return GatheringGame(policy, swarm, region, rng) if scanning.every_move else None
    # The commands of random-moves are drawn in advance, one per move. Runs of several equal
    # commands are therefore not compiled.
    one_by_one = isinstance(policy, RandomMoves) and not scanning.every_move
    if not isinstance(policy, Compiled) or not is_compiled(setup.task) or one_by_one:
        return None
    if isinstance(policy, PlannerPolicy):
        return PlannerGame(
            policy,
            swarm.world.free,
            swarm.state,
            swarm.belief,
            rule=swarm.rule,
            mapping=setup.mapping,
            rng=rng,
        )
    return PolicyGame(policy, swarm, rng, scanning=scanning)


def load_kernels(problem: SwarmProblem) -> None:
    """Load or compile the kernels that a problem needs, by running a similar problem on a map of
    two cells.
    """
    policy, task, mapping = problem.setup.policy, problem.setup.task, problem.setup.mapping
    if isinstance(policy, Compiled | Offline) and is_compiled(task):
        budget = {"budget": 1.0} if isinstance(policy, Offline) else {}
        prices = {
            name: getattr(problem, name)
            for name in ("rule", "scan_every", "slip", "misplace", "miss")
        }
        _load_kernels(
            "mapping" if mapping else "coverage",
            type(policy)(**budget),
            **prices,
        )


@cache
def _load_kernels(task: str, policy: Policy, **fields: Any) -> None:
    run(SwarmProblem([[1, 1]], particles=1, task=task, policy=policy, **fields))
