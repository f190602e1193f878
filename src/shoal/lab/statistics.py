"""Means with how sure they are: confidence intervals, paired comparisons, effect sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.checks import shortened
from shoal.episode import Status
from shoal.errors import InvalidInputError
from shoal.lab.storage.store import Store
from shoal.lab.sweeps.batches import is_storable
from shoal.parts import PARTS, problem_type

Method = Literal["auto", "t", "log", "bootstrap"]
METHODS: tuple[Method, ...] = ("auto", "t", "log", "bootstrap")
RESAMPLES = 2000
_DONE = tuple(str(status) for status in Status if status.done)


@dataclass(frozen=True)
class Estimate:
    """A mean and its confidence interval.

    Parameters
    ----------
    mean : float
    low, high : float
        Ends of the interval; not numbers for a single value, of which nothing is known.
    std : float
        Sample standard deviation; not a number for a single value.
    count : int
    level : float
        Of confidence.
    method : str
        "t", "log" or "bootstrap".
    """

    mean: float
    low: float
    high: float
    std: float
    count: int
    level: float
    method: Method

    def __str__(self) -> str:
        if self.count < 2:
            return f"{self.mean:.6g} (one trial: no interval)"
        return f"{self.mean:.6g} [{self.low:.6g}, {self.high:.6g}]"


@dataclass(frozen=True)
class Comparison:
    """What a measure is more for b than for a, trial by trial on the same seeds.

    Parameters
    ----------
    difference : Estimate
        Of b - a.
    ratio : float
        Mean of b by mean of a.
    effect : float
        Cohen's d of paired values: mean of the differences by their standard deviation; 0 if all are 0, infinite if all are equal
        otherwise.
    smaller : float
        Share of the pairs in which b is smaller; ties count a half.
    p_value : float
        Of Wilcoxon's signed-rank test, two-sided; 1 if all differences are 0.
    unfinished : int
        Pairs of which a trial, or both, ended before its task was done.
    bound : float, optional
        Values above it were compared as equal to it: the least at which an unfinished trial ended.
    """

    difference: Estimate
    ratio: float
    effect: float
    smaller: float
    p_value: float
    unfinished: int = 0
    bound: float | None = None

    def __str__(self) -> str:
        told = f"difference {self.difference}, ratio {self.ratio:.4g}, effect {self.effect:.3g}, p {self.p_value:.2g}"
        if not self.unfinished:
            return told
        restricted = "" if self.bound is None else f", values restricted to {self.bound:.6g}"
        return f"{told} ({self.unfinished} of {self.difference.count} pairs unfinished{restricted})"


def estimate(values: ArrayLike, *, level: float = 0.95, method: Method = "auto", seed: int = 0) -> Estimate:
    """Return the mean of independent values with a confidence interval.

    Parameters
    ----------
    values : array_like of float, shape (n,)
        One or more, finite.
    level : float
        Above 0 and below 1.
    method : str
        "t": Student's interval, right for means of many values or of normal ones. "log": Student's interval of the logarithm of
        the mean, whose standard error is std / (mean * sqrt(n)), the delta method. It never goes below zero, and holds a skewed
        mean more often than "t" does. "bootstrap": the bias-corrected and accelerated bootstrap. "auto": "log" if no value is
        below zero, as of counts and times, else "t".
    seed : int
        Of the bootstrap.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> print(estimate([2, 4, 4, 6]))
    4 [2.08907, 7.65891]
    """
    array = _checked(values, level)
    mean, count = float(array.mean()), len(array)
    if method not in METHODS:
        raise InvalidInputError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    if method == "log" and array.min() < 0:
        raise InvalidInputError(f"method log: expected values of 0 or more, got {array.min():g}")
    if method == "auto":
        method = "log" if array.min() >= 0 else "t"
    std = float(array.std(ddof=1)) if count > 1 else float("nan")
    low, high = (float("nan"),) * 2 if count < 2 else (mean, mean) if std == 0 else _interval(array, std, level, method, seed)
    return Estimate(mean, low, high, std, count, level, method)


def _interval(array: NDArray[np.float64], std: float, level: float, method: Method, seed: int) -> tuple[float, float]:
    """Return the ends of the interval of values that differ."""
    from scipy import stats

    mean, count = float(array.mean()), len(array)
    if method == "bootstrap":
        rng = np.random.default_rng(seed)
        found = stats.bootstrap((array,), np.mean, confidence_level=level, n_resamples=RESAMPLES, rng=rng).confidence_interval
        return float(found.low), float(found.high)
    half = float(stats.t.ppf((1 + level) / 2, count - 1)) * std / count**0.5
    if method == "log":
        factor = float(np.exp(half / mean))
        return mean / factor, mean * factor
    return mean - half, mean + half


def _checked(values: ArrayLike, level: float) -> NDArray[np.float64]:
    if not 0 < level < 1:
        raise InvalidInputError(f"level: expected a number above 0 and below 1, got {level!r}")
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInputError(f"values: expected numbers, got {values!r:.80}") from None
    if array.ndim != 1 or not array.size or not np.isfinite(array).all():
        raise InvalidInputError(f"values: expected one finite number or more in a row, got shape {array.shape}")
    return array


def compare(a: ArrayLike, b: ArrayLike, *, level: float = 0.95, method: Method = "t", seed: int = 0) -> Comparison:
    """Compare two rows of values of which the k-th of each were made with the same seed.

    Parameters
    ----------
    a, b : array_like of float, shape (n,)
        Two or more.
    level, method, seed
        As for `estimate`.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> found = compare([10, 12, 14, 16], [9, 11, 12, 13])
    >>> found.difference.mean, round(found.effect, 2), found.smaller
    (-1.75, -1.83, 1.0)
    """
    before, after = _checked(a, level), _checked(b, level)
    if len(before) != len(after) or len(before) < 2:
        raise InvalidInputError(f"compare: expected two rows of equal length, 2 or more, got {len(before)} and {len(after)}")
    differences = after - before
    found = estimate(differences, level=level, method=method, seed=seed)
    effect = found.mean / found.std if found.std else (0.0 if found.mean == 0 else float(np.copysign(np.inf, found.mean)))
    smaller = float(np.mean((differences < 0) + 0.5 * (differences == 0)))
    p_value = 1.0
    if differences.any():
        from scipy import stats

        p_value = float(stats.wilcoxon(differences, zero_method="zsplit").pvalue)
    ratio = float(after.mean() / before.mean()) if before.mean() else float("nan")
    return Comparison(found, ratio, effect, smaller, p_value)


@dataclass(frozen=True)
class Row:
    """A point of a sweep and what is known of one measure there.

    Parameters
    ----------
    values : dict
        By axis.
    estimate : Estimate or None
        Of the mean; None if no trial has the measure, or if it grows until the task is done and no trial has done it.
    missing : int
        Trials that have it not: not played yet, failed, or None.
    counted : int
        Trials that have it.
    completed : int or None
        Those of them whose task is done; None if trials have no status.
    bound : float or None
        If not all are done and the measure grows until then: the estimate is of a restricted mean, in which larger values count
        as this one, the least at which an unfinished trial ended. The mean is larger.
    """

    values: dict[str, Any]
    estimate: Estimate | None
    missing: int
    counted: int
    completed: int | None = None
    bound: float | None = None

    def __str__(self) -> str:
        if not self.counted:
            return "no trial yet"
        if self.estimate is None:
            return f"more than {self.bound:.6g}: 0 of {self.counted} trials completed"
        if self.completed is None or self.completed == self.counted:
            return f"{self.estimate}" + (f" ({self.counted} of {self.counted + self.missing} trials)" if self.missing else "")
        told = f"{self.estimate}" if self.bound is None else f"restricted mean to {self.bound:.6g}: {self.estimate}"
        return f"{told} ({self.completed} of {self.counted} trials completed)"


@dataclass(frozen=True)
class Measured:
    """The values of one measure at a point of a sweep.

    Parameters
    ----------
    values : dict
        By axis.
    trials : dict of int to float
        By trial; those without a number are left out.
    unfinished : set of int
        Trials whose task was not done.
    has_status : bool
        Whether trials say so.
    censored : bool
        Whether the measure grows until the task is done: what an unfinished trial has is a lower bound.
    """

    values: dict[str, Any]
    trials: dict[int, float]
    unfinished: frozenset[int]
    has_status: bool
    censored: bool

    def bound(self) -> float | None:
        """Return the least value at which an unfinished trial ended; None if none did or its value is none of a bound."""
        return min((self.trials[trial] for trial in self.unfinished), default=None) if self.censored else None


def measured(store: Store, name: str, measure: str) -> list[Measured]:
    """Return what was measured at each point of a sweep, in its order. No code that the store names is imported.

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
                f"measure: expected one that is a number, got {measure!r}, which is {shortened(value)} in trial {trial}"
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


def summarise(store: Store, name: str, measure: str, *, level: float = 0.95, method: Method = "auto") -> list[Row]:
    """Return the mean of a measure with its interval at each point of a sweep.

    A measure that grows until the task is done is known of unfinished trials as a lower bound only: then the estimate is of the
    restricted mean, and the row says so.

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
    """Return the values of trials, none above the bound."""
    return [point.trials[trial] if bound is None else min(point.trials[trial], bound) for trial in trials]


def compare_along(
    store: Store, name: str, measure: str, axis: str, *, level: float = 0.95, method: Method = "auto"
) -> list[tuple[dict[str, Any], Any, Any, Comparison | None]]:
    """Compare the values of a paired axis with its first one, at each combination of the other axes.

    Returns
    -------
    list of (values of the other axes, first value, other value, Comparison)
        None instead of a comparison if fewer than two trials have both, or the task of no trial is done.

    Raises
    ------
    InvalidInputError
        If the axis is not paired: then the seeds differ.
    UnknownNameError
    """
    paired = store.stored(name).form.paired
    if axis not in paired:
        raise InvalidInputError(
            f"axis: expected a paired one ({', '.join(paired) or 'none'}), whose points share their seeds, got {axis!r}"
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
    """Compare two points on the trials that both have; None if these are fewer than two, or no trial of either is done."""
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
