"""Summaries of a sweep: the mean of a measure and the number of completed trials at each point, and comparisons of points."""

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
        Values of the sweep's axes at the point, by axis name.
    estimate : Estimate or None
        Estimate of the mean of the measure. The estimate is None if no trial has the measure. For a measure that grows until
        the task is done, the estimate is None if no trial completed its task.
    missing : int
        Number of trials that have not yet run, have failed, or returned None as the measure.
    counted : int
        Number of trials with a value of the measure.
    completed : int or None
        Number of completed trials that have a value of the measure. ``completed`` is None if trials have no status.
    bound : float or None
        Upper limit of the values in the mean: a value above ``bound`` counts as ``bound``. ``bound`` is the smallest value at which
        an unfinished trial ended, and makes the estimated mean smaller than the true mean. ``bound`` is None if all trials are
        finished, or if the measure does not grow until the task is done.
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
        Values of the sweep's axes at the point, by axis name.
    trials : dict of int to float
        Value of the measure by trial number. Trials without a numeric value are omitted.
    unfinished : set of int
        Numbers of the trials that did not complete their task.
    has_status : bool
        Whether trials have a status.
    censored : bool
        Whether the measure grows until the task is done. For a growing measure, the value of an unfinished trial is a lower bound.
    """

    values: dict[str, Any]
    trials: dict[int, float]
    unfinished: frozenset[int]
    has_status: bool
    censored: bool

    def bound(self) -> float | None:
        """Return the smallest value at which an unfinished trial ended.

        Return None if all trials are finished, or if the measure does not grow until the task is done.
        """
        return min((self.trials[trial] for trial in self.unfinished), default=None) if self.censored else None


def measured(store: Store, name: str, measure: str) -> list[Measured]:
    """Return the values of a measure at each point of a sweep, in the order of the points.

    The function imports no third-party code.

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
    """Return the name of the measure that a summary shows by default."""
    return next((name for name in ("moves", "share") if name in measures), next(iter(measures), ""))


def summarise(store: Store, name: str, measure: str, *, level: float = 0.95, method: Method = "auto") -> list[Row]:
    """Return the mean of a measure, with a confidence interval, at each point of a sweep.

    For a measure that grows until the task is done, an unfinished trial gives only a lower bound of its value. The estimate of such
    a measure is a restricted mean: a value above the row's field ``bound`` counts as ``bound``.

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
    """Return the values of the given trials at one point, with every value above ``bound`` replaced by ``bound``."""
    return [point.trials[trial] if bound is None else min(point.trials[trial], bound) for trial in trials]


def compare_along(
    store: Store, name: str, measure: str, axis: str, *, level: float = 0.95, method: Method = "auto"
) -> list[tuple[dict[str, Any], Any, Any, Comparison | None]]:
    """Compare a measure at each value of a paired axis with the measure at the axis's first value.

    For each later value of the paired axis, and for each combination of values of the other axes, there is one comparison.

    Returns
    -------
    list of (values of the other axes, first value, other value, Comparison)
        The comparison is None if fewer than two trials have results for both values of the axis, or if no trial completed its task.

    Raises
    ------
    InvalidInputError
        Raised if the axis is not paired. Points along an axis that is not paired have different seeds.
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
    """Compare two points of a sweep by the trials that have results at both points.

    Return None if fewer than two trials have results at both points, or if no trial completed its task.
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
