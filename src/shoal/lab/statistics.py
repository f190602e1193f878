"""Means with how sure they are: confidence intervals, paired comparisons, effect sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.errors import InvalidInputError
from shoal.lab.storage.store import Store

Method = Literal["t", "bootstrap"]
RESAMPLES = 2000


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
    """

    difference: Estimate
    ratio: float
    effect: float
    smaller: float
    p_value: float

    def __str__(self) -> str:
        return f"difference {self.difference}, ratio {self.ratio:.4g}, effect {self.effect:.3g}, p {self.p_value:.2g}"


def estimate(values: ArrayLike, *, level: float = 0.95, method: Method = "t", seed: int = 0) -> Estimate:
    """Return the mean of independent values with a confidence interval.

    Parameters
    ----------
    values : array_like of float, shape (n,)
        One or more, finite.
    level : float
        Above 0 and below 1.
    method : str
        "t": Student's interval, right for means of many values or of normal ones. "bootstrap": the bias-corrected and accelerated
        bootstrap, for few values of a skewed distribution.
    seed : int
        Of the bootstrap.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> print(estimate([2, 4, 4, 6]))
    4 [1.40154, 6.59846]
    """
    array = _checked(values, level)
    mean, count = float(array.mean()), len(array)
    std = float(array.std(ddof=1)) if count > 1 else float("nan")
    if method not in {"t", "bootstrap"}:
        raise InvalidInputError(f"method: expected 't' or 'bootstrap', got {method!r}")
    if count < 2:
        return Estimate(mean, float("nan"), float("nan"), std, count, level, method)
    if std == 0:
        return Estimate(mean, mean, mean, 0.0, count, level, method)
    from scipy import stats

    if method == "t":
        half = float(stats.t.ppf((1 + level) / 2, count - 1)) * std / count**0.5
        return Estimate(mean, mean - half, mean + half, std, count, level, method)
    rng = np.random.default_rng(seed)
    found = stats.bootstrap((array,), np.mean, confidence_level=level, n_resamples=RESAMPLES, rng=rng).confidence_interval
    return Estimate(mean, float(found.low), float(found.high), std, count, level, method)


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
        None if no trial has the measure.
    missing : int
        Trials that have it not: not done yet, failed, or None.
    """

    values: dict[str, Any]
    estimate: Estimate | None
    missing: int


def measured(store: Store, name: str, measure: str) -> list[tuple[dict[str, Any], dict[int, float]]]:
    """Return (values by axis, {trial: value}) for each point of a sweep, in its order; trials without a number are left out.

    Raises
    ------
    InvalidInputError, UnknownNameError
    """
    sweep = store.sweep(name)
    if measure not in sweep.measures:
        raise InvalidInputError(f"measure: expected one of {', '.join(sweep.measures)}, got {measure!r}")
    width, at = len(sweep.axes), store.columns(name).index(measure)
    trials: dict[str, dict[int, float]] = {}
    for row in store.rows(name):
        value = row[at]
        if isinstance(value, str):
            raise InvalidInputError(
                f"measure: expected one that is a number, got {measure!r}, which is {value!r} in trial {row[width]}"
            )
        if value is not None:
            trials.setdefault(repr(row[:width]), {})[row[width]] = float(value)
    return [(dict(point.values), trials.get(repr(_row_key(point.values)), {})) for point in sweep.points]


def _row_key(values: Any) -> tuple[Any, ...]:
    return tuple([*value] if isinstance(value, tuple) else value for value in values.values())


def summarise(store: Store, name: str, measure: str, *, level: float = 0.95, method: Method = "t") -> list[Row]:
    """Return the mean of a measure with its interval at each point of a sweep.

    Raises
    ------
    InvalidInputError, UnknownNameError
    """
    expected = store.sweep(name).trials
    rows = []
    for values, trials in measured(store, name, measure):
        found = estimate([*trials.values()], level=level, method=method) if trials else None
        rows.append(Row(values, found, expected - len(trials)))
    return rows


def compare_along(
    store: Store, name: str, measure: str, axis: str, *, level: float = 0.95, method: Method = "t"
) -> list[tuple[dict[str, Any], Any, Any, Comparison | None]]:
    """Compare the values of a paired axis with its first one, at each combination of the other axes.

    Returns
    -------
    list of (values of the other axes, first value, other value, Comparison)
        None instead of a comparison if fewer than two trials have both.

    Raises
    ------
    InvalidInputError
        If the axis is not paired: then the seeds differ.
    UnknownNameError
    """
    sweep = store.sweep(name)
    if axis not in sweep.paired:
        raise InvalidInputError(
            f"axis: expected a paired one ({', '.join(sweep.paired) or 'none'}), whose points share their seeds, got {axis!r}"
        )
    groups: dict[str, list[tuple[dict[str, Any], dict[int, float]]]] = {}
    for values, trials in measured(store, name, measure):
        others = {other: value for other, value in values.items() if other != axis}
        groups.setdefault(repr(others), []).append((values, trials))
    rows = []
    for group in groups.values():
        first, base = group[0]
        for values, trials in group[1:]:
            both = sorted(base.keys() & trials.keys())
            found = None
            if len(both) > 1:
                found = compare([base[k] for k in both], [trials[k] for k in both], level=level, method=method)
            others = {other: value for other, value in values.items() if other != axis}
            rows.append((others, first[axis], values[axis], found))
    return rows


def by_axis(rows: Sequence[Row], axis: str, **others: Any) -> tuple[NDArray[np.float64], list[Estimate]]:
    """Return the values of an axis and the estimates there, of the rows with the given values on other axes."""
    kept = [row for row in rows if all(row.values[name] == value for name, value in others.items()) and row.estimate is not None]
    return np.array([float(row.values[axis]) for row in kept]), [row.estimate for row in kept if row.estimate is not None]
