"""What a sweep plays: one class a kind of problem, with the measures of a trial.

A problem holds nothing but what a text can say, so that it has one canonical form and goes to any worker. What it names (a map, a
workspace, a region) is opened once a process.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError

from shoal.errors import InvalidInputError
from shoal.lab.problems.base import KINDS, Problem, Values, said
from shoal.lab.problems.function import FunctionProblem
from shoal.lab.problems.line import LineProblem, ScheduleProblem
from shoal.lab.problems.search import SearchProblem
from shoal.lab.problems.steering import SteeringTrials
from shoal.lab.problems.swarm import SwarmProblem

__all__ = [
    "KINDS",
    "FunctionProblem",
    "LineProblem",
    "Problem",
    "ScheduleProblem",
    "SearchProblem",
    "SteeringTrials",
    "SwarmProblem",
    "Values",
    "problem_of",
    "said",
]

AnyProblem = Annotated[
    SwarmProblem | LineProblem | ScheduleProblem | SteeringTrials | SearchProblem | FunctionProblem,
    Field(discriminator="kind"),
]
_READER: TypeAdapter[Problem] = TypeAdapter(AnyProblem)


def problem_of(fields: dict[str, Any], *, where: str = "problem") -> Problem:
    """Return the problem that fields describe.

    Raises
    ------
    InvalidInputError
        In one sentence that says where.
    """
    try:
        return _READER.validate_python(fields)
    except ValidationError as error:
        raise InvalidInputError(said(error, where=where)) from None
    except RecursionError:
        raise InvalidInputError(f"{where}: expected fields of modest depth, got more") from None
