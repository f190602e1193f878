"""Paper W, figures 14 and 16: the costs of plans for many goals of one particle."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.lab.storage.store import Store
from shoal.lab.sweeps.sweep import Sweep
from shoal.papers.recipe import Settings, Table
from shoal.steering import ConvexWorkspace, SteeringProblem, open_workspace

# Fig. 14: starts of the particles, and goals of particle 1.
DISK_START = ((0.2, 0.2), (-0.1, -0.1))
DISK_GOALS = ((0.0, 0.0), (-0.2, 0.0))
# Fig. 16: starts, and the goal of particle 2. The paper does not print its three cases; these are ours.
SQUARE_CASES = (
    (((0.25, 0.25), (0.75, 0.75)), (0.5, 0.5)),
    (((0.2, 0.8), (0.3, 0.3)), (0.8, 0.2)),
    (((0.2, 0.4), (0.85, 0.5)), (0.15, 0.55)),
)


@dataclass(frozen=True, eq=False)
class GoalSweep:
    """Costs of plans for many goals of one particle, with all other settings fixed.

    Parameters
    ----------
    problem : SteeringProblem
        A problem with the workspace, the starts and the tolerance of all plans. In this problem, both particles have the goal of
        the particle whose goal does not vary.
    varied : int
        Number of the particle whose goal varies, 1 or 2.
    planner : str
    x, y : ndarray of float64, shape (n,)
        The x coordinates and the y coordinates of the goals.
    moves : ndarray of float64, shape (n, n)
        Number of moves of the plan for each y (row) and x (column) of the goal, or NaN outside the workspace and where no plan
        succeeds.
    lengths : ndarray of float64, shape (n, n)
        Length of the plan for each y (row) and x (column) of the goal, or NaN outside the workspace and where no plan succeeds.
    unsolved : int
        Number of goals inside the workspace without a successful plan.
    """

    problem: SteeringProblem
    varied: int
    planner: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    moves: NDArray[np.float64]
    lengths: NDArray[np.float64]
    unsolved: int


def goals(name: str, workspace: str, start: Any, fixed: Any, varied: int, settings: Settings, *, either: bool = False) -> Sweep:
    """Return a sweep that varies the goal of one particle over a square grid that covers the workspace."""
    samples = (21 if settings.quick else 61) if workspace == "disk" else (17 if settings.quick else 41)
    opened = open_workspace(workspace)
    assert isinstance(opened, ConvexWorkspace)  # named workspaces are
    low, high = (-0.5, 0.5) if opened.round else (0.0, 1.0)
    steps = [round(float(low + (high - low) * (2 * k + 1) / (2 * samples)), 12) for k in range(samples)]
    problem = {
        "kind": "steering", "workspace": workspace, "start": [list(point) for point in start],
        "goal": [list(fixed)] * 2, "varied": varied,
        "planner": "greedy", "tolerance": 1e-3, "interchangeable": either,
    }  # fmt: skip
    return Sweep(name=f"{name}.{samples}", problem=problem, axes={"goal_y": steps, "goal_x": steps}, seed=settings.seed)


def goal_sweep(store: Store, sweep: Sweep) -> GoalSweep:
    """Read the results of a sweep over goals from a store, and return the costs for the figure."""
    problem: Any = sweep.points[0].problem
    x, y = np.array(sweep.axes["goal_x"]), np.array(sweep.axes["goal_y"])
    workspace = open_workspace(problem.workspace)
    columns = store.columns(sweep.name)
    at = {name: columns.index(name) for name in ("status", "moves", "length")}
    moves, lengths = np.full((len(x), len(x)), np.nan), np.full((len(x), len(x)), np.nan)
    unsolved = 0
    for k, row in enumerate(store.rows(sweep.name)):
        if row[at["status"]] == "solved":
            moves.flat[k], lengths.flat[k] = row[at["moves"]], row[at["length"]]
        else:
            unsolved += bool(workspace.contains((x[k % len(x)], y[k // len(x)])))
    steered = SteeringProblem(workspace, problem.start, problem.goal, problem.tolerance, problem.interchangeable)
    return GoalSweep(steered, problem.varied, problem.planner, x, y, moves, lengths, unsolved)


def goal_table(names: list[str], sweeps: list[GoalSweep]) -> Table:
    """Return a table that summarizes, for each sweep, the numbers of moves and the lengths of the plans to all goals."""
    rows = [
        [
            name,
            f"{np.nanmean(s.moves):.2f} ± {np.nanstd(s.moves):.2f}",
            int(np.nanmax(s.moves)),
            f"{np.nanmean(s.lengths):.3f} ± {np.nanstd(s.lengths):.3f}",
            f"{np.nanmax(s.lengths):.3f}",
            s.unsolved,
        ]
        for name, s in zip(names, sweeps, strict=True)
    ]
    return Table(
        "over all goals: mean ± standard deviation", ["", "moves", "most moves", "length", "longest", "without a plan"], rows
    )


def goal_data(names: list[str], sweeps: list[GoalSweep]) -> Table:
    """Return a table of the number of moves and the length of the plan for each goal of each sweep."""
    rows = []
    for name, s in zip(names, sweeps, strict=True):
        for row, column in np.argwhere(np.isfinite(s.moves)):
            rows.append([name, s.x[column], s.y[row], int(s.moves[row, column]), round(float(s.lengths[row, column]), 6)])
    return Table("goal by goal", ["panel", "x", "y", "moves", "length"], rows, shown=False)
