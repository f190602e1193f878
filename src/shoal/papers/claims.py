"""Claims: what a paper prints, what we find, and whether the two agree, differ, or cannot be compared.

One rule decides all: what was printed stands for a range of values, what we found for an interval. The claim agrees if the interval
lies in the range, differs if the two have nothing in common, and cannot be compared if they overlap in part, which more trials
would settle, or if what was printed is of something that was not published.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from math import inf, isnan

import numpy as np
from numpy.typing import ArrayLike

from shoal.core.dataclass import dataclass
from shoal.lab.statistics import Estimate
from shoal.lab.summaries import Row
from shoal.views.drawing.curves import Published


class Verdict(StrEnum):
    """The answer to a claim, or to all claims of a figure."""

    AGREES = "agrees"
    DIFFERS = "differs"
    NOT_COMPARABLE = "not comparable"


@dataclass(frozen=True)
class Claim:
    """Something that a paper says, beside what we find.

    Parameters
    ----------
    what : str
    printed, ours : str
    criterion : str
        When the two agree, or why they cannot be compared.
    verdict : Verdict
    """

    what: str
    printed: str
    ours: str
    criterion: str
    verdict: Verdict


Found = float | Estimate | tuple[float, float, float]
"""A number that is known, or a mean with the ends of its 95 % interval."""


def claim(
    what: str, printed: str | float, ours: Found, *, within: tuple[float, float] | None = None, why: str = "", unlike: str = ""
) -> Claim:
    """Return a claim with its verdict.

    Parameters
    ----------
    what : str
        What is measured.
    printed : str or float
    ours : float, Estimate or (value, low, high)
    within : (low, high), optional
        What the printed words or number stand for; by default the numbers that round to it.
    why : str
        Why that range.
    unlike : str
        Why the two cannot be compared, if they cannot.

    Examples
    --------
    >>> claim("mean moves", 29.7, 29.73).verdict, claim("mean moves", "60.7", (58.7, 58.6, 58.8)).verdict
    (<Verdict.AGREES: 'agrees'>, <Verdict.DIFFERS: 'differs'>)
    >>> claim("mean moves", "about twice", (1.9, 1.4, 2.4), within=(1.5, 2.5)).verdict
    <Verdict.NOT_COMPARABLE: 'not comparable'>
    """
    text = printed if isinstance(printed, str) else f"{printed:g}"
    value, low, high = (ours.mean, ours.low, ours.high) if isinstance(ours, Estimate) else _interval(ours)
    exact = low == high
    said = f"{value:.4g}" if exact else f"{value:.4g}, one trial" if isnan(low) else f"{value:.4g} [{low:.4g}, {high:.4g}]"
    if unlike:
        return Claim(what, text, said, unlike, Verdict.NOT_COMPARABLE)
    least, most = _rounded(text) if within is None else within
    criterion = f"{'ours' if exact else 'our 95 % interval'} {_range_words(least, most)}{f': {why}' if why else ''}"
    if isnan(low) or not ((least <= low and high <= most) or high < least or low > most):
        return Claim(what, text, said, f"{criterion}; too few trials to tell", Verdict.NOT_COMPARABLE)
    return Claim(what, text, said, criterion, Verdict.AGREES if least <= low and high <= most else Verdict.DIFFERS)


def _interval(ours: float | tuple[float, float, float]) -> tuple[float, float, float]:
    return ours if isinstance(ours, tuple) else (float(ours), float(ours), float(ours))


def _rounded(text: str) -> tuple[float, float]:
    """Return the numbers that round to a text."""
    half = 0.5 * 10.0 ** -len(text.partition(".")[2])
    return float(text) - half, float(text) + half


def _range_words(least: float, most: float) -> str:
    if least == most:
        return f"is {least:.6g}"
    if least == -inf:
        return f"is {most:.6g} at most"
    return f"is {least:.6g} at least" if most == inf else f"lies in {least:.6g} to {most:.6g}"


def curve_claim(what: str, rows: Sequence[Row], published: Published, *, trials: int, margin: float, why: str) -> Claim:
    """Return the claim that two curves of means are the same up to a margin, in shares of the published one.

    Means are compared by the logarithms of their ratios, with the errors of both. The curves agree if the 95 % interval of the
    mean ratio over all n lies within the margin, and no n has an interval outside of it; that of one n is so wide that of all
    together one in twenty curves would be refuted by chance.

    Parameters
    ----------
    what : str
    rows : sequence of Row
        One for each n of the published curve, by the axis ``particles``.
    published : Published
    trials : int
        Behind each published mean.
    margin : float
        Above 0.
    why : str
        Why that margin.
    """
    from scipy.stats import norm

    ours = {row.values["particles"]: row.estimate for row in rows}
    pairs = [(ours[int(n)], mean, std) for n, mean, std in zip(published.x, published.mean, _deviations(published), strict=True)]
    found = np.array([(e.mean, e.std / e.count**0.5, mean, std / trials**0.5) for e, mean, std in pairs if e is not None])
    ratio = np.log(found[:, 0] / found[:, 2])
    error = np.hypot(found[:, 1] / found[:, 0], found[:, 3] / found[:, 2])
    half, bound = float(norm.ppf(1 - 0.025 / len(ratio))), float(np.log1p(margin))
    worst = int(np.argmax(np.abs(ratio)))
    mean, spread = float(ratio.mean()), 1.96 * float(np.sqrt(np.sum(error**2))) / len(ratio)
    said = f"mean ratio {np.exp(mean):.3f} [{np.exp(mean - spread):.3f}, {np.exp(mean + spread):.3f}] over {len(ratio)} n"
    said += f", farthest {np.exp(ratio[worst]):.3f} at n = {published.x[worst]:g}"
    criterion = f"the interval of the mean ratio lies within {100 * margin:.0f} % of 1, and no n is outside: {why}"
    outside = bool(np.any(np.abs(ratio) - half * error > bound)) or abs(mean) - spread > bound
    if isnan(spread) or (not outside and abs(mean) + spread > bound):
        return Claim(what, "curve", said, f"{criterion}; too few trials to tell", Verdict.NOT_COMPARABLE)
    return Claim(what, "curve", said, criterion, Verdict.DIFFERS if outside else Verdict.AGREES)


def _deviations(published: Published) -> np.ndarray:
    return np.zeros_like(published.mean) if published.std is None else np.nan_to_num(published.std)


def ratio(above: Estimate, below: Estimate) -> tuple[float, float, float]:
    """Return the ratio of two means with the ends of its interval, by the errors of both; they are taken as independent."""
    value = above.mean / below.mean
    spread = 1.96 * float(np.hypot(*(e.std / e.mean / e.count**0.5 for e in (above, below))))
    return value, value * float(np.exp(-spread)), value * float(np.exp(spread))


def mean_ratio(above: Mapping[int, Estimate], below: Mapping[int, Estimate], counts: list[int]) -> tuple[float, float, float]:
    """Return the mean over numbers of particles of the ratios of two means, with the ends of its interval."""
    ratios = np.array([ratio(above[n], below[n]) for n in counts])
    mean, half = float(ratios[:, 0].mean()), float(np.sqrt(np.sum(np.diff(ratios[:, 1:]) ** 2))) / 2 / len(ratios)
    return mean, mean - half, mean + half


def order_claim(what: str, printed: str, smaller: Mapping[int, Estimate], larger: Mapping[int, Estimate]) -> Claim:
    """Return the claim that one mean is below another: on average over n, and at no more n the other way than by chance."""
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
    """Return the power of x that y follows, a straight line in logarithms, with the ends of its 95 % interval."""
    from scipy.stats import linregress, t

    found = linregress(np.log(x), np.log(y))
    half = float(t.ppf(0.975, np.size(x) - 2) * found.stderr)
    return float(found.slope), float(found.slope) - half, float(found.slope) + half


def verdict_of(claims: Iterable[Claim]) -> Verdict:
    """Return the answer to all claims together: they differ if one does, and agree if one does and none differs."""
    answers = [claim.verdict for claim in claims]
    return next((one for one in (Verdict.DIFFERS, Verdict.AGREES) if one in answers), Verdict.NOT_COMPARABLE)
