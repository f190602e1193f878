"""Claims: the statement of a paper, Shoal's result, and a verdict (agrees, differs or not
comparable).

One rule determines the verdicts on all claims. The rounding of a paper's printed value gives a
range of values. The statistical error of Shoal's result gives a confidence interval. A claim agrees
if the confidence interval of Shoal's result lies in the range of the printed value. A claim differs
if the confidence interval of Shoal's result and the range of the printed value are disjoint. If the
confidence interval and the range of the printed value overlap partly, the claim is not comparable,
because a decision needs more trials. If the printed value of a claim depends on unpublished data,
the claim is not comparable.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from math import inf, isnan

import numpy as np
from numpy.typing import ArrayLike

from shoal.core.dataclass import dataclass
from shoal.lab.statistics import Estimate, Row
from shoal.views.drawing.curves import Published


class Verdict(StrEnum):
    """The verdict on one claim, or on all claims of a figure."""

    AGREES = "agrees"
    DIFFERS = "differs"
    NOT_COMPARABLE = "not comparable"


@dataclass(frozen=True)
class Claim:
    """A statement of a paper beside Shoal's result, with a verdict.

    Parameters
    ----------
    what : str
    printed, ours : str
    criterion : str
        The condition for agreement, or the reason why the printed value and Shoal's value are not
        comparable.
    verdict : Verdict
    """

    what: str
    printed: str
    ours: str
    criterion: str
    verdict: Verdict


Found = float | Estimate | tuple[float, float, float]
"""An exact number, or a mean with the ends of its 95 % interval."""


def claim(
    what: str,
    printed: str | float,
    ours: Found,
    *,
    within: tuple[float, float] | None = None,
    why: str = "",
    unlike: str = "",
) -> Claim:
    """Return a claim with its verdict.

    Parameters
    ----------
    what : str
        Name of the compared quantity.
    printed : str or float
    ours : float, Estimate or (value, low, high)
    within : (low, high), optional
        The range of values that agree with the printed words or the printed number. By default, all
        numbers that round to the printed number.
    why : str
        The reason for the choice of the range ``within``.
    unlike : str
        The reason why the printed value and Shoal's value are not comparable; an empty text if they
        are comparable.

    Examples
    --------
    >>> claim("mean moves", 29.7, 29.73).verdict, claim("mean moves", "60.7", (58.7, 58.6, 58.8)).verdict
    (<Verdict.AGREES: 'agrees'>, <Verdict.DIFFERS: 'differs'>)
    >>> claim("mean moves", "about twice", (1.9, 1.4, 2.4), within=(1.5, 2.5)).verdict
    <Verdict.NOT_COMPARABLE: 'not comparable'>
    """
    text = printed if isinstance(printed, str) else f"{printed:g}"
    if isinstance(ours, Estimate):
        value, low, high = ours.mean, ours.low, ours.high
    else:
        value, low, high = ours if isinstance(ours, tuple) else (float(ours),) * 3
    exact = low == high
    said = (
        f"{value:.4g}"
        if exact
        else f"{value:.4g}, one trial"
        if isnan(low)
        else f"{value:.4g} [{low:.4g}, {high:.4g}]"
    )
    if unlike:
        return Claim(what, text, said, unlike, Verdict.NOT_COMPARABLE)
    least, most = _rounded(text) if within is None else within
    criterion = (
        f"{'ours' if exact else 'our 95 % interval'}"
        f" {_range_words(least, most)}{f': {why}' if why else ''}"
    )
    if isnan(low) or not ((least <= low and high <= most) or high < least or low > most):
        return Claim(
            what, text, said, f"{criterion}; too few trials to tell", Verdict.NOT_COMPARABLE
        )
    return Claim(
        what,
        text,
        said,
        criterion,
        Verdict.AGREES if least <= low and high <= most else Verdict.DIFFERS,
    )


def _rounded(text: str) -> tuple[float, float]:
    """Return the range of all numbers that round to the number in ``text``."""
    half = 0.5 * 10.0 ** -len(text.partition(".")[2])
    return float(text) - half, float(text) + half


def _range_words(least: float, most: float) -> str:
    if least == most:
        return f"is {least:.6g}"
    if least == -inf:
        return f"is {most:.6g} at most"
    return f"is {least:.6g} at least" if most == inf else f"lies in {least:.6g} to {most:.6g}"


def curve_claim(
    what: str, rows: Sequence[Row], published: Published, *, trials: int, margin: float, why: str
) -> Claim:
    """Return the claim that Shoal's curve of means agrees with a published curve within a relative
    margin.

    For each number of particles, the comparison uses the logarithm of Shoal's mean divided by the
    published mean. The interval of this ratio contains the statistical errors of both means. The
    curves agree if the 95 % interval of the mean ratio over all numbers of particles lies within
    the margin, and if the interval of the ratio at each single number of particles overlaps the
    margin. The intervals at single numbers of particles are so wide that chance refutes only one in
    twenty correct curves.

    Parameters
    ----------
    what : str
    rows : sequence of Row
        Shoal's results: one row for each number of particles n of the published curve.
    published : Published
    trials : int
        Number of trials behind each published mean.
    margin : float
        Relative margin, above 0; for example, 0.05 allows deviations of 5 %.
    why : str
        The reason for the size of ``margin``.
    """
    from scipy.stats import norm

    ours = {row.values["particles"]: row.estimate for row in rows}
    std = np.zeros_like(published.mean) if published.std is None else np.nan_to_num(published.std)
    found = np.array(
        [
            (e.mean, e.std / e.count**0.5, printed, deviation / trials**0.5)
            for n, printed, deviation in zip(published.x, published.mean, std, strict=True)
            if (e := ours[int(n)]) is not None
        ]
    )
    ratio = np.log(found[:, 0] / found[:, 2])
    error = np.hypot(found[:, 1] / found[:, 0], found[:, 3] / found[:, 2])
    half, bound = float(norm.ppf(1 - 0.025 / len(ratio))), float(np.log1p(margin))
    worst = int(np.argmax(np.abs(ratio)))
    mean, spread = float(ratio.mean()), 1.96 * float(np.sqrt(np.sum(error**2))) / len(ratio)
    said = (
        f"mean ratio {np.exp(mean):.3f} [{np.exp(mean - spread):.3f}, {np.exp(mean + spread):.3f}]"
        f" over {len(ratio)} n"
    )
    said += f", farthest {np.exp(ratio[worst]):.3f} at n = {published.x[worst]:g}"
    criterion = (
        f"the interval of the mean ratio lies within {100 * margin:.0f} % of 1, and no n is"
        f" outside: {why}"
    )
    outside = bool(np.any(np.abs(ratio) - half * error > bound)) or abs(mean) - spread > bound
    if isnan(spread) or (not outside and abs(mean) + spread > bound):
        return Claim(
            what, "curve", said, f"{criterion}; too few trials to tell", Verdict.NOT_COMPARABLE
        )
    return Claim(what, "curve", said, criterion, Verdict.DIFFERS if outside else Verdict.AGREES)


def ratio(above: Estimate, below: Estimate) -> tuple[float, float, float]:
    """Return ``above`` / ``below`` for two independent means, and both ends of the ratio's 95 %
    interval.
    """
    value = above.mean / below.mean
    spread = 1.96 * float(np.hypot(*(e.std / e.mean / e.count**0.5 for e in (above, below))))
    return value, value * float(np.exp(-spread)), value * float(np.exp(spread))


def mean_ratio(
    above: Mapping[int, Estimate], below: Mapping[int, Estimate], counts: list[int]
) -> tuple[float, float, float]:
    """Return the mean of ``above[n]`` / ``below[n]`` over all n in ``counts``, and both ends of the
    95 % interval of this mean.
    """
    ratios = np.array([ratio(above[n], below[n]) for n in counts])
    mean = float(ratios[:, 0].mean())
    half = float(np.sqrt(np.sum(np.diff(ratios[:, 1:]) ** 2))) / 2 / len(ratios)
    return mean, mean - half, mean + half


def order_claim(
    what: str, printed: str, smaller: Mapping[int, Estimate], larger: Mapping[int, Estimate]
) -> Claim:
    """Return the claim that ``smaller[n]`` / ``larger[n]`` is below 1 on average over all numbers
    of particles n.

    The verdict is also "differs" if the ratio is significantly above 1 at more than 5 % of the
    numbers of particles.
    """
    counts = [n for n in smaller if smaller[n].mean > 0 and larger[n].mean > 0]
    contrary = sum(ratio(smaller[n], larger[n])[1] > 1 for n in counts)
    found = claim(
        f"{what}: mean ratio over n",
        printed,
        mean_ratio(smaller, larger, counts),
        within=(0, 1),
        why=f"and the contrary shown at 5 % of the n at most; it is at {contrary} of {len(counts)}",
    )
    return replace(found, verdict=Verdict.DIFFERS) if contrary > 0.05 * len(counts) else found


def exponent(x: ArrayLike, y: ArrayLike) -> tuple[float, float, float]:
    """Return the exponent of a power law y(x), fitted as a straight line in logarithms, and both
    ends of its 95 % interval.
    """
    from scipy.stats import linregress, t

    fit = linregress(np.log(x), np.log(y))
    half = float(t.ppf(0.975, np.size(x) - 2) * fit.stderr)
    return float(fit.slope), float(fit.slope) - half, float(fit.slope) + half


def verdict_of(claims: Iterable[Claim]) -> Verdict:
    """Return the common verdict on all claims of a figure.

    The verdict is "differs" if at least one claim differs. If no claim differs, the verdict is
    "agrees" if at least one claim agrees. If no claim differs and no claim agrees, the verdict is
    "not comparable".
    """
    answers = [claim.verdict for claim in claims]
    return next(
        (one for one in (Verdict.DIFFERS, Verdict.AGREES) if one in answers), Verdict.NOT_COMPARABLE
    )
