"""The kinds of problems that a sweep can run: swarm, steering, search, line, schedule and function.

All values in the problem of a sweep can be written as text, so that Shoal can send the problem to
any worker. A worker process opens each map, workspace or region once.
"""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from shoal import parts
from shoal.core.checks import shortened, suggestion
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.problem import Problem, option
from shoal.core.registry import Registry
from shoal.swarm.theory.one_dimension import Line, sample
from shoal.swarm.theory.scan_schedules import (
    EveryStep,
    Hyperexponential,
    OneJump,
    Powers,
    ScanSchedule,
)

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


@dataclass(frozen=True, eq=False)
class MeasuredProblem(Problem, ABC):
    """A problem whose trials return measures instead of episodes."""

    @abstractmethod
    def trial(self, seed: int) -> dict[str, Any]:
        """Run one trial and return the measures of the trial by name."""


def _check_arguments(value: Any) -> dict[str, Any] | None:
    if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
        raise InvalidInputError(f"arguments: expected names with values, got {shortened(value)}")
    return dict(value) or None


@dataclass(frozen=True, eq=False)
class FunctionProblem(MeasuredProblem):
    """A problem whose trials call a Python function that the user names in the form
    "module:attribute".

    Each trial calls the function with ``seed`` and ``arguments``. The function must return a dict
    of measures, and must have an attribute ``measures``: a tuple of the names of these measures.
    """

    part = "function"

    function: str = option(help="Your function, as MODULE:ATTRIBUTE.", names=())
    arguments: Mapping[str, Any] | None = option(
        None, help="Arguments of the function, in addition to the seed.", check=_check_arguments
    )

    @property
    # of other problems a class says it
    def measures(self) -> tuple[str, ...]:  # type: ignore[override]
        """The names of all measures that the third-party function returns."""
        measures = getattr(self.called, "measures", ())
        if not measures or not all(isinstance(name, str) for name in measures):
            raise InvalidInputError(
                f"function {self.function}: expected an attribute measures that names its results,"
                " got none"
            )
        return tuple(measures)

    @cached_property
    def called(self) -> Callable[..., Any]:
        """The third-party function as a Python object."""
        function = Registry[Callable[..., Any]]("function").get(self.function)
        if not callable(function):
            raise InvalidInputError(
                f"function {self.function}: expected a function, got {shortened(function)}"
            )
        return function

    def check_at_place(self) -> None:
        """Refuse arguments that the third-party function does not accept."""
        try:
            inspect.signature(self.called).bind(seed=0, **(self.arguments or {}))
        except TypeError as error:
            raise InvalidInputError(f"function {self.function}: {error}") from None

    def trial(self, seed: int) -> dict[str, Any]:
        """Call the third-party function, and return the measures of the trial."""
        values = self.called(seed=seed, **(self.arguments or {}))
        if not isinstance(values, dict) or {*values} != {*self.measures}:
            raise InvalidInputError(
                f"function {self.function}: expected a dict of {', '.join(self.measures)}, got"
                f" {shortened(values)}"
            )
        return values


@dataclass(frozen=True, eq=False)
class LineProblem(MeasuredProblem):
    """Random placements of particles on a line. A trial computes means over many placements (paper
    M, section III.A).
    """

    part = "line"
    measures = (
        "first",
        "last",
        "largest_gap",
        "spread",
        "boundary",
        "coverage",
        "printed_coverage",
    )

    cells: int = option(help="Number of cells of the line.", least=1)
    particles: int = option(help="Number of particles.", least=1)
    placements: int = option(1, help="Number of random placements in each trial.", least=1)

    @cached_property
    def line(self) -> Line:
        """The line of the problem, with its numbers of cells and particles."""
        return Line(self.cells, self.particles)

    def check_at_place(self) -> None:
        """Refuse a problem with more particles than cells."""
        _ = self.line

    def trial(self, seed: int) -> dict[str, Any]:
        """Draw random placements, and return the mean of each measure.

        The command ``shoal line`` draws the same placements from the same seed.
        """
        drawn = sample(self.line, self.placements, seed=seed, workers=1)
        return {name: float(getattr(drawn, name).mean()) for name in self.measures}


@dataclass(frozen=True, eq=False)
class ScheduleProblem(MeasuredProblem):
    """The search for a wall at an unknown distance on a line, with a scan schedule (paper M,
    section III.A.3).
    """

    part = "schedule"
    measures = ("distance", "moves", "scans", "move_ratio", "scan_ratio", "weighted_ratio")

    schedule: str = option(
        "i^i", help="Schedule of scans: every-step, i^i, powers:K or one-jump:M."
    )
    max_distance: int = option(
        1000,
        help="Maximum of the random distance of the wall (the minimum is 0).",
        least=0,
        most=10**15,
    )
    distance: int | None = option(
        None, help="Distance of the wall, in place of a random distance.", least=0, most=10**15
    )
    scan_cost: float = option(10.0, help="Price of a scan, in any unit.", least=0)
    move_cost: float = option(
        1.0, help="Price of a move, in the same unit as the price of a scan.", least=0
    )

    @cached_property
    def scans(self) -> ScanSchedule:
        """The scan schedule that the field ``schedule`` names."""
        made = {"every-step": EveryStep, "i^i": Hyperexponential}.get(self.schedule)
        if made is not None:
            return made()
        name, _, number = self.schedule.partition(":")
        if name in {"powers", "one-jump"} and number.isdecimal():
            return Powers(int(number)) if name == "powers" else OneJump(int(number))
        raise InvalidInputError(
            f"schedule: expected every-step, i^i, powers:K or one-jump:M, got {self.schedule!r}"
        )

    def check_at_place(self) -> None:
        """Refuse prices of scans and moves that are both 0, and a schedule whose last scan comes
        before the farthest wall.
        """
        farthest = self.max_distance if self.distance is None else self.distance
        self.scans.cost(farthest).weighted_ratio(scan_cost=self.scan_cost, move_cost=self.move_cost)

    def trial(self, seed: int) -> dict[str, Any]:
        """Return the measures of the search for a wall at the distance ``distance``, in moves.

        If ``distance`` is None, draw a random distance from 0 to ``max_distance``.
        """
        at = self.distance
        cost = self.scans.cost(
            int(np.random.default_rng(seed).integers(self.max_distance + 1)) if at is None else at
        )
        weighted = cost.weighted_ratio(scan_cost=self.scan_cost, move_cost=self.move_cost)
        ratios = {
            "move_ratio": float(cost.move_ratio),
            "scan_ratio": float(cost.scan_ratio),
            "weighted_ratio": float(weighted),
        }
        return {"distance": cost.distance, "moves": cost.moves, "scans": cost.scans} | ratios


_OWN: dict[str, type[MeasuredProblem]] = {
    kind.part: kind for kind in (LineProblem, ScheduleProblem, FunctionProblem)
}
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
            f"{where}: expected a kind, one of {', '.join(KINDS)}, got"
            f" {shortened(kind)}{suggestion(kind, KINDS)}"
        )
    return trial_problem_type(str(kind)).from_dict(fields, where=where)


def trial_problem_type(kind: str) -> type[Problem]:
    """Return the problem class of a kind, such as "swarm" or "line"."""
    return _OWN.get(kind) or parts.problem_type(kind)


def check_trial(problem: Problem) -> None:
    """Refuse a problem of which no trial can run, at its place: settings, names, files and
    third-party code.
    """
    if isinstance(problem, MeasuredProblem):
        problem.check_at_place()
    else:
        parts.check(problem)


def trial(problem: Problem, seed: int) -> list[Any]:
    """Run one trial, and return the values of all measures in ``problem.measures``: texts, numbers,
    booleans or None.
    """
    measured = (
        problem.trial(seed)
        if isinstance(problem, MeasuredProblem)
        else parts.run(problem, seed=seed).metrics
    )
    return [measured[name] for name in problem.measures]
