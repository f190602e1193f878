"""The kinds of problems that a sweep can run: swarm, steering, search, line, schedule and function.

All values in the problem of a sweep can be written as text, so that Shoal can send the problem to any worker. A worker process
opens each map, workspace or region once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from shoal.core import parts
from shoal.core.checks import shortened, suggestion
from shoal.core.errors import InvalidInputError
from shoal.core.problem import Problem
from shoal.lab.problems.base import MeasuredProblem
from shoal.lab.problems.function import FunctionProblem
from shoal.lab.problems.line import LineProblem, ScheduleProblem

__all__ = [
    "KINDS",
    "FunctionProblem",
    "LineProblem",
    "ScheduleProblem",
    "check_trial",
    "trial",
    "trial_problem",
    "trial_problem_type",
]

_OWN: dict[str, type[MeasuredProblem]] = {kind.part: kind for kind in (LineProblem, ScheduleProblem, FunctionProblem)}
KINDS = (*parts.PARTS, *_OWN)


def trial_problem(fields: Mapping[str, Any], *, where: str = "problem") -> Problem:
    """Return the problem that a mapping of fields describes. The field ``kind`` is one of `KINDS`.

    Raises
    ------
    InvalidInputError
        Raised if a field is invalid. The error message gives the location of the field.
    """
    kind = fields.get("kind")
    if kind not in KINDS:
        raise InvalidInputError(
            f"{where}: expected a kind, one of {', '.join(KINDS)}, got {shortened(kind)}{suggestion(kind, KINDS)}"
        )
    return trial_problem_type(str(kind)).from_dict(fields, where=where)


def trial_problem_type(kind: str) -> type[Problem]:
    """Return the problem class of a kind, such as "swarm" or "line"."""
    return _OWN.get(kind) or parts.problem_type(kind)


def check_trial(problem: Problem) -> None:
    """Refuse a problem of which no trial can run, at its place: settings, names, files and third-party code.

    Raises
    ------
    InvalidInputError, UnknownNameError
    """
    if isinstance(problem, MeasuredProblem):
        problem.check_at_place()
    else:
        parts.check(problem)


def trial(problem: Problem, seed: int) -> list[Any]:
    """Run one trial, and return the values of all measures in ``problem.measures``: texts, numbers, booleans or None."""
    measured = problem.trial(seed) if isinstance(problem, MeasuredProblem) else parts.run(problem, seed=seed).metrics
    return [measured[name] for name in problem.measures]
