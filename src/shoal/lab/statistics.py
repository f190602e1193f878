"""Statistics of trials: means, intervals, paired differences, and the summaries of sweeps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import shortened
from shoal.core.dataclass import dataclass
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError
from shoal.lab.batches import is_storable
from shoal.lab.store import Store
from shoal.parts import PARTS, problem_type

Method = Literal["auto", "t", "log", "bootstrap"]
METHODS: tuple[Method, ...] = ("auto", "t", "log", "bootstrap")
RESAMPLES = 2000
_DRAWN = 2**20  # values that the bootstrap draws at once


def number_text(value: float) -> str:
    """Return a number as text: rounded to a whole number if it is 1000 or more, otherwise with four
    significant digits.

    Examples
    --------
    >>> number_text(446.833), number_text(0.12345), number_text(123456.7)
    ('446.8', '0.1235', '123457')
    """
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e15 else f"{value:.4g}"


@dataclass(frozen=True)
class Estimate:
    """The mean of a sample, and the confidence interval of the mean.

    Parameters
    ----------
    mean : float
    low, high : float
        Lower and upper end of the confidence interval. For a sample of one value, both are NaN.
    std : float
        Sample standard deviation, or NaN for a sample of one value.
    count : int
    level : float
        Confidence level of the interval, above 0 and below 1.
    method : str
        Method that gave the confidence interval: "t", "log" or "bootstrap".
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
            return f"{number_text(self.mean)} (one trial: no interval)"
        return f"{number_text(self.mean)} [{number_text(self.low)}, {number_text(self.high)}]"


@dataclass(frozen=True)
class Comparison:
    """Paired comparison of a measure for two settings a and b. The two trials of a pair have equal
    seeds.

    Parameters
    ----------
    difference : Estimate
        Estimate of the mean difference: the value for b minus the value for a.
    ratio : float
        Mean of the values for b, divided by the mean of the values for a.
    effect : float
        Effect size: Cohen's d of paired values, which is the mean of the differences divided by the
        standard deviation of the differences. The effect size is 0 if all differences are 0, and
        infinite if all differences are equal but not 0.
    smaller : float
        Fraction of the pairs in which the value for b is smaller than the value for a. A pair of
        equal values counts one half.
    p_value : float
        P-value of Wilcoxon's two-sided signed-rank test, or 1 if all differences are 0.
    unfinished : int
        Number of pairs in which at least one of the two trials did not complete its task.
    bound : float, optional
        Upper limit of the compared values: the smallest value at which an unfinished trial ended.
        In the comparison, a value above ``bound`` counts as ``bound``.
    ratio_low, ratio_high : float, optional
        Lower and upper end of the confidence interval of the ratio, if the method is "log".
    """

    difference: Estimate
    ratio: float
    effect: float
    smaller: float
    p_value: float
    unfinished: int = 0
    bound: float | None = None
    ratio_low: float | None = None
    ratio_high: float | None = None

    @property
    def ratio_text(self) -> str:
        """The ratio as text, with its confidence interval if the method is "log"."""
        if self.ratio_low is None or self.ratio_high is None:
            return f"{self.ratio:.4g}"
        return f"{self.ratio:.4g} [{self.ratio_low:.4g}, {self.ratio_high:.4g}]"

    def __str__(self) -> str:
        return (
            f"difference {self.difference}, ratio {self.ratio_text}, effect {self.effect:.3g}, p"
            f" {self.p_value:.2g}{self.note}"
        )

    @property
    def note(self) -> str:
        """Text with the number of unfinished pairs and the limit of the values. If all pairs are
        finished, the text is empty.
        """
        if not self.unfinished:
            return ""
        restricted = "" if self.bound is None else f", values restricted to {self.bound:.6g}"
        return f" ({self.unfinished} of {self.difference.count} pairs unfinished{restricted})"


def estimate(
    values: ArrayLike, *, level: float = 0.95, method: Method = "auto", seed: int = 0
) -> Estimate:
    """Return the mean of independent values with a confidence interval.

    Parameters
    ----------
    values : array_like of float, shape (n,)
        Values of the sample: one or more finite numbers.
    level : float
        Confidence level of the interval, above 0 and below 1.
    method : str
        Method for the confidence interval. "t" is Student's interval, which suits many values or
        normally distributed values. "log" is Student's interval of the logarithm of the mean. For n
        values with the standard deviation std, the delta method estimates the standard error of the
        logarithm of the mean as std / (mean * sqrt(n)). The interval of "log" never extends below
        zero, and covers the mean of skewed values more often than the interval of "t". "bootstrap"
        is the bias-corrected and accelerated bootstrap. "auto" means "log" if no value is below
        zero, as for counts and times, and "t" if some value is below zero.
    seed : int
        Seed of the random numbers in the bootstrap.

    Examples
    --------
    >>> print(estimate([2, 4, 4, 6]))
    4 [2.089, 7.659]
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
    low, high = (
        (float("nan"),) * 2
        if count < 2
        else (mean, mean)
        if std == 0
        else _interval(array, std, level, method, seed)
    )
    return Estimate(mean, low, high, std, count, level, method)


def _interval(
    array: NDArray[np.float64], std: float, level: float, method: Method, seed: int
) -> tuple[float, float]:
    """Return the ends of the confidence interval for values that are not all equal."""
    from scipy import stats

    mean, count = float(array.mean()), len(array)
    if method == "bootstrap":
        return _bootstrap_interval(array, level, seed)
    half = float(stats.t.ppf((1 + level) / 2, count - 1)) * std / count**0.5
    if method == "log":
        factor = float(np.exp(half / mean))
        return mean / factor, mean * factor
    return mean - half, mean + half


def _bootstrap_interval(array: NDArray[np.float64], level: float, seed: int) -> tuple[float, float]:
    """Return the bias-corrected and accelerated bootstrap interval of the mean, in memory that does
    not grow with the product of values and resamples.

    `scipy.stats.bootstrap` computes the same ends, but keeps all values that are left out one at a
    time: the square of the sample.
    """
    # Efron and Tibshirani, An Introduction to the Bootstrap (1993), equations 14.9, 14.14, 14.15
    from scipy.special import ndtr, ndtri

    rng = np.random.default_rng(seed)
    count, mean = len(array), array.mean()
    at_once = max(1, _DRAWN // count)
    means = np.concatenate(
        [
            array[rng.integers(0, count, (min(at_once, RESAMPLES - begin), count))].mean(axis=1)
            for begin in range(0, RESAMPLES, at_once)
        ]
    )
    below = ((means < mean).sum() + (means <= mean).sum()) / (2 * RESAMPLES)
    bias = ndtri(below)
    # without its i-th value, the mean changes by (mean - x_i) / (n - 1)
    left = array - mean
    acceleration = (left**3).sum() / (6 * (left**2).sum() ** 1.5)
    edges = bias + ndtri(np.array([(1 - level) / 2, (1 + level) / 2]))
    low, high = np.quantile(means, ndtr(bias + edges / (1 - acceleration * edges)))
    return float(low), float(high)


def _checked(values: ArrayLike, level: float) -> NDArray[np.float64]:
    if not 0 < level < 1:
        raise InvalidInputError(f"level: expected a number above 0 and below 1, got {level!r}")
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInputError(f"values: expected numbers, got {values!r:.80}") from None
    if array.ndim != 1 or not array.size or not np.isfinite(array).all():
        raise InvalidInputError(
            f"values: expected one finite number or more in a row, got shape {array.shape}"
        )
    return array


def estimate_ratio(a: ArrayLike, b: ArrayLike, *, level: float = 0.95, seed: int = 0) -> Estimate:
    """Return the mean of a divided by the mean of b, for two independent samples, with the interval
    of the bias-corrected and accelerated bootstrap.

    Parameters
    ----------
    a, b : array_like of float, shape (n,)
        Values of the samples, which may have different lengths. The values of b are above 0.
    level, seed
        Options ``level`` and ``seed`` of the function `estimate`.

    Returns
    -------
    Estimate
        The standard deviation of the estimate is NaN, and its count is the size of the smaller
        sample. For a sample of one value, the ends of the interval are NaN.

    Examples
    --------
    >>> print(estimate_ratio([4, 6, 5, 5], [2, 2.5, 3, 2.5]))
    2 [1.636, 2.444]
    """
    above, below = _checked(a, level), _checked(b, level)
    ratio, count = float(above.mean() / below.mean()), min(len(above), len(below))
    low, high = (float("nan"),) * 2 if count < 2 else (ratio,) * 2
    if count > 1 and (np.ptp(above) or np.ptp(below)):
        from scipy import stats

        interval = stats.bootstrap(
            (above, below),
            lambda x, y, axis: x.mean(axis=axis) / y.mean(axis=axis),
            confidence_level=level,
            n_resamples=RESAMPLES,
            rng=np.random.default_rng(seed),
        ).confidence_interval
        low, high = float(interval.low), float(interval.high)
    return Estimate(ratio, low, high, float("nan"), count, level, "bootstrap")


def compare(
    a: ArrayLike, b: ArrayLike, *, level: float = 0.95, method: Method = "t", seed: int = 0
) -> Comparison:
    """Compare the values of two settings a and b. For each k, the k-th values of a and b must come
    from trials with equal seeds.

    Parameters
    ----------
    a, b : array_like of float, shape (n,)
        Values of the two settings: at least two values for each setting.
    level, method, seed
        Options ``level``, ``method`` and ``seed`` of the function `estimate`. A difference has no
        logarithm; with the method "log", the comparison therefore has a confidence interval of the
        ratio on a logarithmic scale, and Student's interval of the difference. The delta method
        estimates the standard error of the logarithm of the ratio as s / sqrt(n), where s is the
        standard deviation of b / mean(b) - a / mean(a) over the n pairs.

    Examples
    --------
    >>> found = compare([10, 12, 14, 16], [9, 11, 12, 13])
    >>> found.difference.mean, round(found.effect, 2), found.smaller
    (-1.75, -1.83, 1.0)
    >>> print(compare([10, 12, 14, 16], [9, 11, 12, 13], method="log").ratio_text)
    0.8654 [0.7905, 0.9473]
    """
    before, after = _checked(a, level), _checked(b, level)
    if len(before) != len(after) or len(before) < 2:
        raise InvalidInputError(
            f"compare: expected two rows of equal length with 2 values or more, got {len(before)}"
            f" and {len(after)} values"
        )
    least = float(min(before.min(), after.min()))
    if method == "log" and least < 0:
        raise InvalidInputError(f"method log: expected values of 0 or more, got {least:g}")
    differences = after - before
    difference = estimate(
        differences, level=level, method="t" if method == "log" else method, seed=seed
    )
    effect = (
        difference.mean / difference.std
        if difference.std
        else (0.0 if difference.mean == 0 else float(np.copysign(np.inf, difference.mean)))
    )
    smaller = float(np.mean((differences < 0) + 0.5 * (differences == 0)))
    p_value = 1.0
    if differences.any():
        from scipy import stats

        p_value = float(stats.wilcoxon(differences, zero_method="zsplit").pvalue)
    ratio = float(after.mean() / before.mean()) if before.mean() else float("nan")
    low, high = _ratio_interval(before, after, level) if method == "log" else (None, None)
    return Comparison(difference, ratio, effect, smaller, p_value, ratio_low=low, ratio_high=high)


def _ratio_interval(
    before: NDArray[np.float64], after: NDArray[np.float64], level: float
) -> tuple[float, float]:
    """Return the ends of the confidence interval of the ratio of two paired means, or NaN if a mean
    is 0.
    """
    from scipy import stats

    if not (before.mean() > 0 and after.mean() > 0):
        return float("nan"), float("nan")
    spread = float((after / after.mean() - before / before.mean()).std(ddof=1))
    half = float(stats.t.ppf((1 + level) / 2, len(before) - 1)) * spread / len(before) ** 0.5
    ratio = float(after.mean() / before.mean())
    return ratio / float(np.exp(half)), ratio * float(np.exp(half))


_DONE = tuple(str(status) for status in Status if status.done)


@dataclass(frozen=True)
class Row:
    """The statistics of one measure at one point of a sweep.

    Parameters
    ----------
    values : dict
        Values of the sweep's axes at the point, by axis name.
    estimate : Estimate or None
        Estimate of the mean of the measure. The estimate is None if no trial has the measure. For a
        measure that grows until the task is done, the estimate is None if no trial completed its
        task.
    missing : int
        Number of trials that have not yet run, have failed, or returned None as the measure.
    counted : int
        Number of trials with a value of the measure.
    completed : int or None
        Number of completed trials that have a value of the measure. ``completed`` is None if trials
        have no status.
    bound : float or None
        Upper limit of the values in the mean: a value above ``bound`` counts as ``bound``.
        ``bound`` is the smallest value at which an unfinished trial ended, and makes the estimated
        mean smaller than the true mean. ``bound`` is None if all trials are finished, or if the
        measure does not grow until the task is done.
    """

    values: dict[str, Any]
    estimate: Estimate | None
    missing: int
    counted: int
    completed: int | None = None
    bound: float | None = None

    def report(self) -> dict[str, Any]:
        """Return the row as data for JSON; infinities and NaN stay."""
        return {
            "axes": self.values,
            "trials": self.counted,
            "missing": self.missing,
            "completed": self.completed,
            "bound": self.bound,
            "estimate": self.estimate and asdict(self.estimate),
        }

    def __str__(self) -> str:
        if not self.counted:
            return f"no trial yet, {self.missing} missing"
        missing = f", {self.missing} missing" if self.missing else ""
        if self.estimate is None:
            return f"more than {self.bound:.6g}: 0 of {self.counted} trials completed{missing}"
        if self.completed is None or self.completed == self.counted:
            return f"{self.estimate} ({self.counted} trials{missing})"
        mean = (
            f"{self.estimate}"
            if self.bound is None
            else f"restricted mean to {self.bound:.6g}: {self.estimate}"
        )
        return f"{mean} ({self.completed} of {self.counted} trials completed{missing})"


@dataclass(frozen=True)
class Measured:
    """The values of one measure at a point of a sweep.

    Parameters
    ----------
    axes : dict
        Values of the sweep's axes at the point, by axis name.
    trials : numpy.ndarray of int64, shape (n,)
        Numbers of the trials with a numeric value, rising.
    values : numpy.ndarray of float64, shape (n,)
        Value of the measure in each of these trials.
    unfinished : numpy.ndarray of bool, shape (n,)
        Whether each trial ended before its task was complete.
    has_status : bool
        Whether trials have a status.
    censored : bool
        Whether the measure grows until the task is done. For a growing measure, the value of an
        unfinished trial is a lower bound.
    """

    axes: dict[str, Any]
    trials: NDArray[np.int64]
    values: NDArray[np.float64]
    unfinished: NDArray[np.bool_]
    has_status: bool
    censored: bool

    def bound(self) -> float | None:
        """Return the smallest value at which an unfinished trial ended.

        Return None if all trials are finished, or if the measure does not grow until the task is
        done.
        """
        if not self.censored or not self.unfinished.any():
            return None
        return float(self.values[self.unfinished].min())

    def at(self, trials: NDArray[np.int64]) -> Measured:
        """Return the values of some of the trials."""
        chosen = np.searchsorted(self.trials, trials)
        return replace(
            self,
            trials=self.trials[chosen],
            values=self.values[chosen],
            unfinished=self.unfinished[chosen],
        )


def measured(store: Store, name: str, measure: str) -> Iterator[Measured]:
    """Yield the values of a measure at each point of a sweep, in the order of the points.

    The function imports no third-party code.
    """
    stored = store.stored(name)
    kind = stored.form.problem.get("kind")
    censored = kind in PARTS and measure in problem_type(kind).censored
    has_status = kind in PARTS and "status" in stored.measures
    for axes, trials, values, open_ in store.values(
        name, measure, done=_DONE if has_status else ()
    ):
        # a text, list or None makes an array of objects, and so does a number too large to store
        plain = isinstance(values, np.ndarray) or set(map(type, values)) <= {bool, int, float}
        array = np.asarray(values) if plain and len(values) else np.array(None)
        if array.dtype.kind not in "bif" or not np.isfinite(array).all():
            for trial, value in zip(trials, values, strict=True):
                if isinstance(value, str | list | dict) or not is_storable(value):
                    raise InvalidInputError(
                        f"measure: expected a measure with numbers, got {measure!r}, which is"
                        f" {shortened(value)} in trial {trial}"
                    )
            there = np.array([value is not None for value in values], dtype=np.bool_)
            array = np.array([value for value in values if value is not None], dtype=np.float64)
        else:
            there = np.ones(len(trials), dtype=np.bool_)
        yield Measured(
            axes,
            trials[there],
            array.astype(np.float64),
            open_[there],
            has_status,
            censored,
        )


def first_measure(measures: Sequence[str]) -> str:
    """Return the name of the measure that a summary shows by default."""
    usual = ("moves", "makespan")
    return next((name for name in usual if name in measures), next(iter(measures), ""))


def summarise(
    store: Store, name: str, measure: str, *, level: float = 0.95, method: Method = "auto"
) -> list[Row]:
    """Return the mean of a measure, with a confidence interval, at each point of a sweep.

    For a measure that grows until the task is done, an unfinished trial gives only a lower bound of
    its value. The estimate of such a measure is a restricted mean: a value above the row's field
    ``bound`` counts as ``bound``.
    """
    expected = store.stored(name).trials
    rows = []
    for point in measured(store, name, measure):
        bound, count = point.bound(), len(point.trials)
        completed = count - int(point.unfinished.sum()) if point.has_status else None
        estimated = None
        if count and not (bound is not None and completed == 0):
            estimated = estimate(_restricted(point, bound), level=level, method=method)
        rows.append(Row(point.axes, estimated, expected - count, count, completed, bound))
    return rows


def _restricted(point: Measured, bound: float | None) -> NDArray[np.float64]:
    """Return the values at one point, with every value above ``bound`` replaced by ``bound``."""
    return point.values if bound is None else np.minimum(point.values, bound)


def compare_along(
    store: Store,
    name: str,
    measure: str,
    axis: str,
    *,
    level: float = 0.95,
    method: Method = "auto",
) -> list[tuple[dict[str, Any], Any, Any, Comparison | None]]:
    """Compare a measure at each value of a paired axis with the measure at the axis's first value.

    For each later value of the paired axis, and for each combination of values of the other axes,
    there is one comparison.

    Returns
    -------
    list of (values of the other axes, first value, other value, Comparison)
        The comparison is None if fewer than two trials have results for both values of the axis, or
        if no trial completed its task.

    Raises
    ------
    InvalidInputError
        Raised if the axis is not paired. Points along an axis that is not paired have different
        seeds.
    UnknownNameError
    """
    paired = store.stored(name).form.paired
    if axis not in paired:
        raise InvalidInputError(
            f"axis: expected a paired axis ({', '.join(paired) or 'none'}), whose points share"
            f" their seeds, got {axis!r}"
        )
    firsts: dict[str, Measured] = {}
    groups: dict[str, list[tuple[dict[str, Any], Any, Any, Comparison | None]]] = {}
    for point in measured(store, name, measure):
        others = _without(point.axes, axis)
        group = groups.setdefault(repr(others), [])
        first = firsts.setdefault(repr(others), point)
        if first is not point:
            found = _compared(first, point, level, method)
            group.append((others, first.axes[axis], point.axes[axis], found))
    return [comparison for group in groups.values() for comparison in group]


def _without(values: dict[str, Any], axis: str) -> dict[str, Any]:
    return {other: value for other, value in values.items() if other != axis}


def _compared(first: Measured, second: Measured, level: float, method: Method) -> Comparison | None:
    """Compare two points of a sweep by the trials that have results at both points.

    Return None if fewer than two trials have results at both points, or if no trial completed its
    task.
    """
    both = np.intersect1d(first.trials, second.trials, assume_unique=True)
    bounds = [bound for bound in (first.bound(), second.bound()) if bound is not None]
    bound = min(bounds, default=None)
    a, b = first.at(both), second.at(both)
    if len(both) < 2 or (bound is not None and (a.unfinished & b.unfinished).all()):
        return None
    comparison = compare(
        _restricted(a, bound),
        _restricted(b, bound),
        level=level,
        method="t" if method == "auto" else method,
    )
    unfinished = int((a.unfinished | b.unfinished).sum())
    return replace(comparison, unfinished=unfinished, bound=bound)
