"""Run one episode of a swarm problem. Built-in policies run entirely in compiled code. All other policies run step by step."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.core.checks import check_integer
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError
from shoal.core.version import versions
from shoal.jit import Stopwatch
from shoal.swarm.episode import SwarmEpisode
from shoal.swarm.grid.randomness import noise_rng, trial_rng
from shoal.swarm.grid.trace import Trace
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.noise.simulated import noisy_belief
from shoal.swarm.policies import ClosestFrontier, Compiled, Offline, PlannerPolicy, Policy, RandomMoves
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.simulation.compiled import Game, NoisyGame, PlannerGame, SearchGame, compiled_loop, is_compiled
from shoal.swarm.simulation.deciders import Decider, ReplannedRuns, make_decider
from shoal.swarm.simulation.exact import ExactSwarm
from shoal.swarm.simulation.loop import Controlled, OnMoves, OnTrace, closed_loop
from shoal.swarm.simulation.noisy import NoisySwarm
from shoal.swarm.simulation.starts import draw_start


def run(
    problem: SwarmProblem,
    *,
    seed: int = 0,
    trial: int = 0,
    stepwise: bool = False,
    on_moves: OnMoves | None = None,
    on_trace: OnTrace | None = None,
) -> SwarmEpisode:
    """Run one episode.

    Parameters
    ----------
    problem : SwarmProblem
    seed, trial : int
        Seed and trial number, at least 0. The same seed and trial number always give the same episode.
    stepwise : bool
        Whether to run built-in policies step by step, like third-party policies. The option does not change the episode.
    on_moves : callable, optional
        Function that is called with the progress: (moves so far, frontier cells left).
    on_trace : callable, optional
        Function that receives each piece of the trace during the run.

    Returns
    -------
    SwarmEpisode

    Raises
    ------
    InvalidInputError, UnknownNameError
        If the problem is invalid.

    Examples
    --------
    >>> episode = run(SwarmProblem([[1, 1, 1, 1]], particles=4, policy="closest-frontier"))
    >>> str(episode.status), episode.commands
    ('complete', 'ludr')
    """
    if not isinstance(problem, SwarmProblem):
        raise InvalidInputError(f"problem: expected a SwarmProblem, got {type(problem).__name__}")
    seed, trial = check_integer(seed, what="seed", least=0), check_integer(trial, what="trial", least=0)
    problem.check_at_place()
    rng = trial_rng(seed, trial)
    start, targets = draw_start(problem, rng)
    if problem.noise is None:
        trace, status, first, seconds = _without_noise(problem, start, targets, rng, stepwise, (on_moves, on_trace))
    else:
        trace, status, first, seconds = _with_noise(problem, start, rng, noise_rng(seed, trial), stepwise, (on_moves, on_trace))
    return SwarmEpisode(
        problem=problem,
        start=start,
        targets=targets,
        trace=trace,
        status=status,
        policy=problem.chosen_policy.name,
        first_frontier=first,
        seed=seed,
        trial=trial,
        seconds=seconds,
        versions=versions(),
    )


_Played = tuple[Trace, Status, int, float]
_Told = tuple[OnMoves | None, OnTrace | None]


def _without_noise(
    problem: SwarmProblem,
    start: NDArray[np.int64],
    targets: NDArray[np.bool_] | None,
    rng: Generator,
    stepwise: bool,
    told: _Told,
) -> _Played:
    policy, task, scanning = problem.chosen_policy, problem.chosen_task, problem.scanning
    world = GridWorld(problem.place, problem.rule)
    state = world.initial(start)
    belief = task.begin(world, state, targets)
    first, mapping = len(belief.frontier), getattr(task, "mapping", True)
    if belief.complete:
        return Trace.empty(0), Status.COMPLETE, first, 0.0
    # The commands of random-moves are drawn in advance, one per move. Runs of several equal commands are therefore not compiled.
    compiled = isinstance(policy, Compiled) and is_compiled(task) and (scanning.every_move or not isinstance(policy, RandomMoves))
    watch = Stopwatch()
    if not compiled or stepwise:
        decider = make_decider(scanning, policy, rule=world.rule, mapping=mapping, belief=belief, rng=rng)
        return *_in_python(ExactSwarm(world, task, state, belief), decider, problem, mapping, told), first, watch.seconds
    options: dict[str, Any] = {"rule": world.rule, "mapping": mapping, "rng": rng}
    game: Game
    if isinstance(policy, PlannerPolicy):
        game = PlannerGame(policy, world.free, state, belief, **options)
    else:
        game = SearchGame(policy, world.free, state, belief, **options, n_free=world.workspace.n_free, scanning=scanning)
    return *compiled_loop(game, problem.max_moves, *told), first, watch.seconds


def _with_noise(
    problem: SwarmProblem,
    start: NDArray[np.int64],
    rng: Generator,
    luck: Generator,
    stepwise: bool,
    told: _Told,
) -> _Played:
    assert problem.noise is not None
    policy, every = problem.chosen_policy, problem.scanning.step
    noisy = noisy_belief(problem.place, start, problem.noise, problem.confidence, luck)
    first, watch = noisy.remaining, Stopwatch()
    if isinstance(policy, ClosestFrontier) and not stepwise:
        game = NoisyGame(policy, noisy, luck, every=every)
        return *compiled_loop(game, problem.max_moves, *told), first, watch.seconds
    decider = ReplannedRuns(policy, rng, every=every, max_moves=problem.max_moves)
    return *_in_python(NoisySwarm(noisy, luck), decider, problem, True, told), first, watch.seconds


def _in_python(swarm: Controlled, decider: Decider, problem: SwarmProblem, mapping: bool, told: _Told) -> tuple[Trace, Status]:
    return closed_loop(swarm, decider, max_moves=problem.max_moves, mapping=mapping, on_moves=told[0], on_trace=told[1])


def load_kernels(problem: SwarmProblem) -> None:
    """Load or compile the kernels that a problem needs, by a run of a similar problem on two cells."""
    policy, task = problem.chosen_policy, problem.chosen_task
    if isinstance(policy, Compiled | Offline) and is_compiled(task):
        budget = {"budget": 1.0} if isinstance(policy, Offline) else {}
        prices = {name: getattr(problem, name) for name in ("rule", "scan_every", "slip", "misplace", "miss")}
        _load_kernels("mapping" if getattr(task, "mapping", True) else "coverage", type(policy)(**budget), **prices)


@cache
def _load_kernels(task: str, policy: Policy, **fields: Any) -> None:
    run(SwarmProblem([[1, 1]], particles=1, task=task, policy=policy, **fields))
