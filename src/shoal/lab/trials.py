"""Run trials: run one problem many times, each time with another random generator."""

from __future__ import annotations

import multiprocessing
import pickle
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import nullcontext
from functools import partial
from threading import Event
from typing import Any

from shoal.core.checks import MOST_TRIALS, check_function, check_integer, check_kind
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError
from shoal.core.interruption import stop_on_interruption
from shoal.core.registry import load_users_modules, users_modules
from shoal.core.version import count_processors
from shoal.swarm import SwarmEpisode, SwarmProblem
from shoal.swarm.policies import Compiled
from shoal.swarm.run import run
from shoal.swarm.simulation.loop import OnMoves


def make_executor(workers: int, *, compiled: bool) -> Executor:
    """Return an executor with ``workers`` threads or processes.

    If ``compiled`` is true, the executor has threads, because compiled code releases Python's
    interpreter lock, and threads start faster than processes. If ``compiled`` is false, as for
    policies written in Python, the executor has processes.
    """
    if compiled:
        return ThreadPoolExecutor(workers, thread_name_prefix="shoal")
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(
        workers, mp_context=context, initializer=begin_worker, initargs=users_modules()
    )


def begin_worker(folders: list[str], modules: list[str]) -> None:
    """Initialize a worker process: ignore Ctrl-C, which a terminal sends to all processes, and
    import the user's modules.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    load_users_modules(folders, modules)


def give_up(executor: Executor) -> None:
    """End the worker processes of an executor immediately, even in the middle of a trial."""
    for process in list((getattr(executor, "_processes", None) or {}).values()):
        process.terminate()


OnTrial = Callable[[int], None]
"""Function that `run_trials` calls with the number of finished trials."""


def run_trials(
    problem: SwarmProblem,
    *,
    trials: int,
    workers: int | None = None,
    seed: int = 0,
    on_trial: OnTrial | None = None,
    on_moves: OnMoves | None = None,
    keep: bool = False,
) -> list[SwarmEpisode]:
    """Run the given number of trials of one swarm problem, and return their episodes.

    Parameters
    ----------
    problem : SwarmProblem
    trials : int
        Number of trials, at least 1. Trial k uses the random generator for (seed, k), for any
        number of workers. Several trials of a policy written in Python run in worker processes,
        which import the policy. A policy that worker processes import must be in a module, or in a
        script with the guard that Python's multiprocessing requires.
    workers : int, optional
        Number of trials that run at the same time. The default is one trial per processor.
    seed : int
    on_trial : callable, optional
        Function that `run_trials` calls with the number of finished trials.
    on_moves : callable, optional
        Function that is called during the first trial, with the number of moves made and the number
        of remaining frontier cells. The function is not called if the first trial runs in another
        process.
    keep : bool
        Whether Ctrl-C keeps the results so far. Running trials then end after the moves made so
        far, with the status "interrupted", and trials that have not begun have no episode. If
        ``keep`` is false, if trials run in other processes, or at a second Ctrl-C, the function
        raises KeyboardInterrupt.

    Returns
    -------
    list of SwarmEpisode
        The episodes in the order of the trials.

    Raises
    ------
    InvalidInputError, UnknownNameError
        Raised if an argument is invalid.

    Examples
    --------
    >>> [e.moves for e in run_trials(SwarmProblem([[1] * 20], particles=20), trials=3, workers=2)]
    [4, 4, 4]
    """
    check_function(on_trial, what="on_trial")
    check_function(on_moves, what="on_moves")
    check_kind(problem, SwarmProblem, what="problem")
    workers = count_processors() if workers is None else workers
    trials = check_integer(trials, what="trials", least=1, most=MOST_TRIALS)
    workers = check_integer(workers, what="workers", least=1)
    compiled = isinstance(problem.setup.policy, Compiled)
    alone = min(workers, trials) == 1  # an extra process would cost more than it saves
    if not (compiled or alone):
        _check_importable(problem.policy)
    executor = make_executor(min(workers, trials), compiled=compiled or alone)
    stop = Event()
    threads = compiled or alone
    watch = partial(_watch, stop, on_moves, keep) if threads else None
    episodes: dict[int, SwarmEpisode] = {}
    ended = 0
    try:
        with stop_on_interruption(stop) if keep and threads else nullcontext():
            for index, episode in _finished(
                executor, problem, trials, 2 * workers, watch, seed, stop
            ):
                episodes[index] = episode
                ended += episode.status is not Status.INTERRUPTED
                if on_trial is not None and episode.status is not Status.INTERRUPTED:
                    on_trial(ended)
    except BrokenExecutor as error:
        # for example if every worker starts a script without a guard again
        raise _not_importable(problem.policy, error) from error
    except BaseException:
        give_up(executor)
        raise
    finally:
        stop.set()
        executor.shutdown(wait=True, cancel_futures=True)
    if not episodes:  # interrupted before the first trial
        raise KeyboardInterrupt
    ordered = [episodes[index] for index in sorted(episodes)]
    return [
        episode
        for episode in ordered
        if episode.trial == 0 or episode.moves or episode.status is not Status.INTERRUPTED
    ]


def _check_importable(policy: Any) -> None:
    """Refuse a policy that worker processes cannot import."""
    try:
        pickle.dumps(policy)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise _not_importable(policy, error) from error


def _not_importable(policy: Any, error: Exception) -> InvalidInputError:
    name = policy if isinstance(policy, str) else policy.name
    return InvalidInputError(
        f"policy {name}: expected a policy that other processes can import, got the error:"
        f" {' '.join(str(error).split())[:200]} (put the policy into a module and start scripts"
        " under if __name__ == '__main__', or use workers=1)"
    )


def _watch(stop: Event, on_moves: OnMoves | None, keep: bool, trial: int) -> dict[str, Any]:
    """Return the functions that a trial in a thread calls after moves. They end the trial as soon
    as ``stop`` is set.

    With ``keep``, the trial ends as an interrupted episode. In trial 0, the functions also call
    ``on_moves``.
    """

    def watch(moves: int, frontier: int) -> None:
        if stop.is_set() and not keep:
            raise CancelledError
        if on_moves is not None and trial == 0:
            on_moves(moves, frontier)

    return {"on_moves": watch, "stop": stop.is_set if keep else None}


def _finished(
    executor: Executor,
    problem: SwarmProblem,
    trials: int,
    at_once: int,
    watch: Callable[[int], dict[str, Any]] | None,
    seed: int,
    stop: Event,
) -> Iterator[tuple[int, SwarmEpisode]]:
    """Yield (trial number, episode) in the order in which trials finish. Submit at most ``at_once``
    trials at the same time.

    As soon as ``stop`` is set, no further trial begins.
    """
    pending: dict[Future[SwarmEpisode], int] = {}
    following = 0
    while pending or (following < trials and not stop.is_set()):
        while following < trials and len(pending) < at_once and not stop.is_set():
            watched = {} if watch is None else watch(following)
            pending[executor.submit(run, problem, seed=seed, trial=following, **watched)] = (
                following
            )
            following += 1
        if stop.is_set():
            pending = {future: index for future, index in pending.items() if not future.cancel()}
        for future in wait(pending, return_when=FIRST_COMPLETED).done:
            yield pending.pop(future), future.result()
