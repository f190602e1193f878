"""SteeringProblem: a workspace, where the particles are and where they are to be."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from shoal.errors import InvalidInputError
from shoal.steering.workspaces.convex_geometry import Points, check_points
from shoal.steering.workspaces.formats import Workspace, describe, open_workspace, read_json, read_text, said, workspace_of

TOLERANCE = 1e-6
FINEST = 1e-8  # of the size: contacts are no more exact


class ProblemForm(BaseModel):
    """A problem file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    workspace: str | dict[str, Any]
    start: list[list[FiniteFloat]] = Field(min_length=2)
    goal: list[list[FiniteFloat]] = Field(min_length=2)
    tolerance: FiniteFloat = TOLERANCE
    interchangeable: bool = False


@dataclass(frozen=True, eq=False)
class SteeringProblem:
    """Two particles or more, all moved by one shared input, and a goal for each.

    Parameters
    ----------
    workspace : ConvexWorkspace or Region
    start, goal : ndarray of float64, shape (n, d)
        Where particle k is, and is to be.
    tolerance : float
        How far from its goal each may end.
    interchangeable : bool
        Whether any particle may go to any goal.

    Raises
    ------
    InvalidInputError
        If a point is outside or no number, if two particles start at one place and are to part, if the counts differ, or for a
        tolerance below 1e-8 of the size.

    Examples
    --------
    >>> from shoal.steering import polygon
    >>> square = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
    >>> SteeringProblem(square, [(0.2, 0.2), (0.4, 0.3)], [(0.7, 0.7), (0.6, 0.2)]).delta.tolist()
    [0.2, 0.09999999999999998]
    """

    workspace: Workspace
    start: Points
    goal: Points
    tolerance: float = TOLERANCE
    interchangeable: bool = False

    def __post_init__(self) -> None:
        start = self.workspace.check_inside(self.start, what="start")
        goal = self.workspace.check_inside(
            check_points(self.goal, what="goal", dimensions=self.workspace.dimensions, count=len(start)), what="goal"
        )
        object.__setattr__(self, "start", start)
        object.__setattr__(self, "goal", goal)
        least = FINEST * self.workspace.size
        number = isinstance(self.tolerance, int | float | np.number) and not isinstance(self.tolerance, bool)
        if not number or not least <= self.tolerance < np.inf:
            raise InvalidInputError(f"tolerance: expected a number of at least {least:g}, 1e-8 of the size, got {self.tolerance!r}")
        for one in range(len(start)):
            for other in range(one):
                if np.array_equal(start[one], start[other]) and np.abs(goal[one] - goal[other]).max() > self.tolerance:
                    raise InvalidInputError(
                        f"start: expected particles at different points, got {tuple(start[one].tolist())} "
                        f"for {other + 1} and {one + 1}: a shared input never parts them"
                    )

    @property
    def delta(self) -> Points:
        """Δ at the start: particle 2 less particle 1; float64, shape (d,)."""
        return np.asarray(self.start[1] - self.start[0])

    @property
    def n_particles(self) -> int:
        """Number of particles."""
        return len(self.start)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> SteeringProblem:
        """Read a problem file.

        Raises
        ------
        InvalidInputError
        """
        source = Path(path)
        return problem_of(read_json(read_text(source), where=str(source)), where=str(source), folder=source.parent)

    def describe(self) -> dict[str, Any]:
        """Return the content of a problem file."""
        return {
            "workspace": describe(self.workspace),
            "start": self.start.tolist(),
            "goal": self.goal.tolist(),
            "tolerance": self.tolerance,
            "interchangeable": self.interchangeable,
        }


def problem_of(data: Any, *, where: str, folder: Path = Path()) -> SteeringProblem:
    """Return the problem that parsed JSON describes; a workspace that is a text is a name or a file beside the problem's.

    Raises
    ------
    InvalidInputError
    """
    try:
        form = ProblemForm.model_validate(data)
    except ValidationError as error:
        raise InvalidInputError(said(error, where=where)) from None
    if isinstance(form.workspace, str):
        beside = folder / form.workspace
        workspace = open_workspace(beside if beside.is_file() else form.workspace)
    else:
        workspace = workspace_of(form.workspace, where=f"{where}: workspace")
    try:
        return SteeringProblem(workspace, form.start, form.goal, form.tolerance, form.interchangeable)  # type: ignore[arg-type]  # made arrays there
    except InvalidInputError as error:
        raise InvalidInputError(f"{where}: {error}") from None
