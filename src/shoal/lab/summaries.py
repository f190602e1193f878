"""Summaries of a sweep: means and numbers of completed trials at each point, and comparisons between the values of paired axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from shoal.core.checks import shortened
from shoal.core.dataclass import dataclass
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError
from shoal.core.parts import PARTS, problem_type
from shoal.lab.statistics import Comparison, Estimate, Method, compare, estimate
from shoal.lab.storage.store import Store
from shoal.lab.sweeps.batches import is_storable

_DONE = tuple(str(status) for status in Status if status.done)


@dataclass(frozen=True)
class Row:
    """The statistics of one measure at one point of a sweep.

    Parameters
    ----------
    values : dict
        Values of the axes by name.
    estimate : Estimate or None
        Estimate of the mean. The estimate is None if no trial has the measure. It is also None if the measure grows until the task
        is done and no trial completed its task.
    missing : int
        Number of trials without the measure, because they have not yet run, have failed, or returned None.
    counted : int
        Number of trials with the measure.
    completed : int or None
        Number of these trials whose task is done, or None if trials have no status.
    bound : float or None
        Upper limit of the values in the mean, if some trials are unfinished and the measure grows until the task is done. The bound
        is the smallest value at which an unfinished trial ended, and a larger value counts as the bound. The true mean is larger
        than this restricted mean.
    """

    values: dict[str, Any]
    estimate: Estimate | None
    missing: int
    counted: int
    completed: int | None = None
    bound: float | None = None

    def __str__(self) -> str:
        if not self.counted:
            return f"no trial yet, {self.missing} missing"
        missing = f", {self.missing} missing" if self.missing else ""
        if self.estimate is None:
            return f"more than {self.bound:.6g}: 0 of {self.counted} trials completed{missing}"
        if self.completed is None or self.completed == self.counted:
            return f"{self.estimate} ({self.counted} trials{missing})"
        told = f"{self.estimate}" if self.bound is None else f"restricted mean to {self.bound:.6g}: {self.estimate}"
        return f"{told} ({self.completed} of {self.counted} trials completed{missing})"


@dataclass(frozen=True)
class Measured:
    """The values of one measure at a point of a sweep.

    Parameters
    ----------
    values : dict
        Values of the axes by name.
    trials : dict of int to float
        Values by trial number. Trials without a number as their value are left out.
    unfinished : set of int
        Trials whose task was not done.
    has_status : bool
        Whether trials have a status.
    censored : bool
        Whether the measure grows until the task is done. The value of an unfinished trial is then a lower bound.
    """

    values: dict[str, Any]
    trials: dict[int, float]
    unfinished: frozenset[int]
    has_status: bool
    censored: bool

    def bound(self) -> float | None:
        """Return the smallest value at which an unfinished trial ended.

        The result is None if all trials are finished, or if the measure does not grow until the task is done.
        """
        return min((self.trials[trial] for trial in self.unfinished), default=None) if self.censored else None


def measured(store: Store, name: str, measure: str) -> list[Measured]:
    """Return the measured values at each point of a sweep in order. No third-party code is imported.

    Raises
    ------
    InvalidInputError, UnknownNameError
    """
    stored = store.stored(name)
    axes, kind, measures = stored.axes, stored.form.problem.get("kind"), stored.measures
    if measure not in measures:
        raise InvalidInputError(f"measure: expected one of {', '.join(measures)}, got {measure!r}")
    censored = kind in PARTS and measure in problem_type(kind).censored
    at = len(axes) + 2 + measures.index(measure)
    status = len(axes) + 2 + measures.index("status") if kind in PARTS and "status" in measures else None
    trials: dict[str, dict[int, float]] = {}
    unfinished: dict[str, set[int]] = {}
    for row in store.rows(name):
        value, trial = row[at], row[len(axes)]
        if value is not None and not (isinstance(value, int | float) and is_storable(value)):
            raise InvalidInputError(
                f"measure: expected a measure with numbers, got {measure!r}, which is {shortened(value)} in trial {trial}"
            )
        if value is not None:
            key = repr(row[: len(axes)])
            trials.setdefault(key, {})[trial] = float(value)
            if status is not None and row[status] not in _DONE:
                unfinished.setdefault(key, set()).add(trial)
    return [
        Measured(values, trials.get(key, {}), frozenset(unfinished.get(key, ())), status is not None, censored)
        for _, values in store.points(name)
        for key in [repr(tuple(values.values()))]
    ]


def first_measure(measures: Sequence[str]) -> str:
    """Return the measure that a summary shows by default."""
    return next((name for name in ("moves", "share") if name in measures), next(iter(measures), ""))


def summarise(store: Store, name: str, measure: str, *, level: float = 0.95, method: Method = "auto") -> list[Row]:
    """Return the mean of a measure with its interval at each point of a sweep.

    For a measure that grows until the task is done, unfinished trials give only lower bounds. The estimate is then a restricted
    mean, and the field ``bound`` of the row contains its limit.

    Raises
    ------
    InvalidInputError, UnknownNameError
    """
    expected = store.stored(name).trials
    rows = []
    for point in measured(store, name, measure):
        bound, count = point.bound(), len(point.trials)
        completed = count - len(point.unfinished) if point.has_status else None
        found = None
        if count and not (bound is not None and completed == 0):
            found = estimate(_restricted(point, [*point.trials], bound), level=level, method=method)
        rows.append(Row(point.values, found, expected - count, count, completed, bound))
    return rows


def _restricted(point: Measured, trials: Sequence[int], bound: float | None) -> list[float]:
    """Return the values of trials, limited to the bound."""
    return [point.trials[trial] if bound is None else min(point.trials[trial], bound) for trial in trials]


def compare_along(
    store: Store, name: str, measure: str, axis: str, *, level: float = 0.95, method: Method = "auto"
) -> list[tuple[dict[str, Any], Any, Any, Comparison | None]]:
    """Compare the values of a paired axis with its first value, for each combination of the other axes.

    Returns
    -------
    list of (values of the other axes, first value, other value, Comparison)
        The comparison is None if fewer than two trials exist for both values, or if no trial completed its task.

    Raises
    ------
    InvalidInputError
        If the axis is not paired, because its points then have different seeds.
    UnknownNameError
    """
    paired = store.stored(name).form.paired
    if axis not in paired:
        raise InvalidInputError(
            f"axis: expected a paired axis ({', '.join(paired) or 'none'}), whose points share their seeds, got {axis!r}"
        )
    groups: dict[str, list[Measured]] = {}
    for point in measured(store, name, measure):
        groups.setdefault(repr(_without(point.values, axis)), []).append(point)
    return [
        (_without(point.values, axis), group[0].values[axis], point.values[axis], _compared(group[0], point, level, method))
        for group in groups.values()
        for point in group[1:]
    ]


def _without(values: dict[str, Any], axis: str) -> dict[str, Any]:
    return {other: value for other, value in values.items() if other != axis}


def _compared(first: Measured, second: Measured, level: float, method: Method) -> Comparison | None:
    """Compare two points by the trials that both have.

    Return None if there are fewer than two such trials, or if no trial of these points completed its task.
    """
    both = sorted(first.trials.keys() & second.trials.keys())
    unfinished = [trial for trial in both if trial in first.unfinished or trial in second.unfinished]
    bounds = [bound for bound in (first.bound(), second.bound()) if bound is not None]
    bound = min(bounds, default=None)
    if len(both) < 2 or (bound is not None and first.unfinished & second.unfinished >= {*both}):
        return None
    found = compare(
        _restricted(first, both, bound), _restricted(second, both, bound), level=level, method="t" if method == "auto" else method
    )
    return replace(found, unfinished=len(unfinished), bound=bound)
