"""Plans for known maps: a fixed command string, found before the first move."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from shoal.errors import InvalidInputError
from shoal.swarm.policies import BeamRollout
from shoal.swarm.policies.planner import Tuning
from shoal.swarm.running import run
from shoal.swarm.tasks import Coverage
from shoal.swarm.workspace import GridWorkspace

OFFLINE_BUDGET = 8_000.0  # imagined moves a move: nobody waits between two moves


@dataclass(frozen=True)
class OfflineRollout(BeamRollout):
    """beam-rollout that searches wider and longer."""

    tuning: ClassVar[Tuning] = BeamRollout.tuning._replace(width=24, depth=12, leaves=6, variations=12)
    budget: float = OFFLINE_BUDGET


@dataclass(frozen=True, eq=False)
class _Given(Coverage):
    """Coverage of given cells."""

    name: ClassVar[str] = "coverage"
    targets: NDArray[np.bool_] | None = None

    def choose_targets(self, workspace: GridWorkspace, rng: Generator) -> NDArray[np.bool_] | None:
        """Return the given cells, or all free ones."""
        return workspace.free if self.targets is None else self.targets


def plan_coverage(
    workspace: GridWorkspace,
    start: ArrayLike,
    *,
    targets: NDArray[np.bool_] | None = None,
    rule: str = "block",
    budget: float = OFFLINE_BUDGET,
    attempts: int = 1,
    seed: int = 0,
) -> str:
    """Return commands that bring some particle onto every free cell, or every target: a plan, as nothing is left to chance.

    The planner beam-rollout with the map itself for a prediction.

    Parameters
    ----------
    workspace : GridWorkspace
    start : array_like of int, shape (n, ndim)
        Cells of the particles.
    targets : ndarray of bool, the shape of the workspace, optional
        The cells to cover, if not all.
    rule : str
        "block" or "merge".
    budget : float
        Moves that may be imagined for each command of the plan, on average.
    attempts : int
        Plans of which the shortest is returned; each with other random variations.
    seed : int

    Raises
    ------
    InvalidInputError
        If a target cannot be reached, or an argument does not fit.

    Examples
    --------
    >>> plan_coverage(GridWorkspace([[1, 1, 1, 1, 1]]), [(0, 1)])
    'lrrrr'

    Notes
    -----
    Source: docs/concepts/planners.md.
    """
    if attempts < 1:
        raise InvalidInputError(f"attempts: expected 1 or more, got {attempts}")
    task = _Given(targets=None if targets is None else np.asarray(targets, dtype=np.bool_))
    options = {"task": task, "policy": OfflineRollout(budget=budget), "start": start, "rule": rule, "seed": seed}
    episodes = [run(workspace, trial=trial, **options) for trial in range(attempts)]  # type: ignore[arg-type]  # of mixed types
    return min((episode.commands for episode in episodes), key=len)
