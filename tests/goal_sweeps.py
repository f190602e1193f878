"""Goals of one particle all over a workspace, planned one after the other: what the page of results
makes of a stored sweep.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from shoal.core.checks import check_integer, check_points
from shoal.papers.steering.shortest_paths import GoalSweep
from shoal.steering import ConvexWorkspace, SteeringProblem
from shoal.steering.run import run


def sweep_goals(
    workspace: ConvexWorkspace,
    start: ArrayLike,
    fixed: ArrayLike,
    *,
    varied: int = 2,
    samples: int = 41,
    planner: str = "greedy",
    tolerance: float = 1e-3,
    interchangeable: bool = False,
) -> GoalSweep:
    """Plan for goals of one particle all over a plane workspace.

    Parameters
    ----------
    workspace : ConvexWorkspace
        A polygon or a disk.
    start : array_like of float, shape (2, 2)
    fixed : array_like of float, shape (2,)
        The goal of the other particle.
    varied : int
        1 or 2: whose goal is varied.
    samples : int
        Goals by side, in the middles of as many equal parts of the extent of the workspace.
    planner : str
    tolerance : float
    interchangeable : bool

    Raises
    ------
    InvalidInputError

    Notes
    -----
    Source: paper W, section VI, Figs. 14 and 16.

    Examples
    --------
    >>> from shoal.papers.steering.shortest_paths import DISK_GOALS, DISK_START
    >>> from shoal.steering import disk
    >>> sweep = sweep_goals(disk(), DISK_START, DISK_GOALS[0], samples=5)
    >>> int(np.isfinite(sweep.moves).sum()), float(np.nanmin(sweep.moves)) >= 3
    (21, True)
    """
    check_integer(varied, what="varied", least=1, most=2)
    check_integer(samples, what="samples", least=2)
    other = check_points([fixed], what="fixed", dimensions=2, count=1)[0]
    problem = SteeringProblem(
        workspace,
        start,
        np.stack([other, other]),
        tolerance,
        interchangeable,
        planner=planner,
    )
    half = (
        np.full(2, workspace.radius) if workspace.round else np.ptp(workspace.vertices, axis=0) / 2
    )
    middle = workspace.center if workspace.round else workspace.vertices.min(axis=0) + half
    steps = (2 * np.arange(samples) + 1) / samples - 1
    x, y = middle[0] + half[0] * steps, middle[1] + half[1] * steps
    moves, lengths = np.full((samples, samples), np.nan), np.full((samples, samples), np.nan)
    unsolved = 0
    for row, column in np.ndindex(samples, samples):
        place = np.array([x[column], y[row]])
        if not workspace.contains(place):
            continue
        episode = run(problem.replaced(goal_x=x[column], goal_y=y[row], varied=varied))
        if episode:
            moves[row, column], lengths[row, column] = episode.moves, episode.length
        else:
            unsolved += 1
    return GoalSweep(problem, varied, planner, x, y, moves, lengths, unsolved)
