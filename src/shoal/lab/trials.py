"""run_trials(): the same problem many times, each trial with its own generator."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import Any

from shoal.errors import InvalidInputError
from shoal.lab.executors import default_workers, make_executor
from shoal.swarm import Episode, GridWorkspace, make_policy, run
from shoal.swarm.policies import Compiled

OnTrial = Callable[[int], None]
"""Called with the number of trials finished so far."""


def run_trials(
    workspace: GridWorkspace,
    *,
    trials: int,
    workers: int | None = None,
    seed: int = 0,
    on_trial: OnTrial | None = None,
    **problem: Any,
) -> list[Episode]:
    """Play ``trials`` episodes of one problem.

    Parameters
    ----------
    workspace : GridWorkspace
    trials : int
        1 or more. Trial k uses the generator of (seed, k), whatever the workers.
    workers : int, optional
        How many run at once; default: one a processor.
    seed : int
    on_trial : callable, optional
        Told the progress.
    **problem
        As for :func:`shoal.swarm.run`: task, policy, particles, placement, rule, max_moves.

    Returns
    -------
    list of Episode
        In the order of the trials.

    Raises
    ------
    InvalidInputError, UnknownNameError
        For arguments that do not fit.

    Examples
    --------
    >>> workspace = GridWorkspace([[1] * 20])
    >>> [e.moves for e in run_trials(workspace, trials=3, workers=2, particles=20)]
    [4, 4, 4]
    """
    if trials < 1:
        raise InvalidInputError(f"trials: expected 1 or more, got {trials}")
    workers = default_workers() if workers is None else workers
    compiled = isinstance(make_policy(problem.get("policy", "closest-frontier")), Compiled)
    executor = make_executor(min(workers, max(1, trials)), compiled=compiled)
    episodes: dict[int, Episode] = {}
    try:
        for index, episode in _finished(executor, workspace, trials, 2 * workers, seed=seed, **problem):
            episodes[index] = episode
            if on_trial is not None:
                on_trial(len(episodes))
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
    return [episodes[index] for index in range(trials)]


def _finished(
    executor: Executor, workspace: GridWorkspace, trials: int, at_once: int, **problem: Any
) -> Iterator[tuple[int, Episode]]:
    """Yield (trial, episode) as they finish, with no more than ``at_once`` waiting."""
    pending: dict[Future[Episode], int] = {}
    following = 0
    while following < trials or pending:
        while following < trials and len(pending) < at_once:
            pending[executor.submit(run, workspace, trial=following, **problem)] = following
            following += 1
        for future in wait(pending, return_when=FIRST_COMPLETED).done:
            yield pending.pop(future), future.result()
