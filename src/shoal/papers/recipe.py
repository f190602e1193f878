"""Recipe: how Shoal reproduces a figure or theorem of a paper, from sweeps to a drawing, and to
claims with verdicts.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.lab.statistics import Estimate, Row
from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.claims import Claim, Verdict, verdict_of
from shoal.views.drawing.curves import Curve, Published

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Function = TypeVar("Function", bound=Callable[..., Any])

NO_DATA = "no data are published for this figure"
COMPLEX = "vessels:5000"


@dataclass(frozen=True)
class Settings:
    """Settings of a reproduction that the user chooses.

    Parameters
    ----------
    quick : bool
        Whether to save time by fewer trials and coarser maps.
    trials : int, optional
        Number of trials for each point of a sweep, in place of the recipe's number.
    map : str, optional
        A picture or the name of a map. This map replaces the unpublished "complex" map of paper M.
    seed : int
    """

    quick: bool = False
    trials: int | None = None
    map: str | None = None
    seed: int = 0

    def of(self, whole: int, quick: int) -> int:
        """Return the number of trials for each point of a sweep: the user's number, or else
        ``quick`` or ``whole``.

        The number ``quick`` applies to a quick reproduction, and the number ``whole`` to a full
        reproduction.
        """
        return self.trials if self.trials is not None else quick if self.quick else whole

    @property
    def complex(self) -> str:
        """Name of the map that stands for the map called "complex" in paper M."""
        return self.map or COMPLEX


@dataclass(frozen=True)
class Table:
    """A table of numbers, which Shoal stores as a CSV file."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    shown: bool = True


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result of a recipe.

    Parameters
    ----------
    figure : Figure
    claims : tuple of Claim
        The statements of the paper, each with Shoal's result and a verdict.
    sentence : str
        Explanations of the result, such as reasons for differences from the paper, with computed
        numbers.
    tables : tuple of Table
    note : str
        Note about published data; Shoal writes the note below the figure.
    """

    figure: Figure
    claims: tuple[Claim, ...]
    sentence: str
    tables: tuple[Table, ...]
    note: str = ""

    @property
    def verdict(self) -> Verdict:
        """The common verdict on all claims of the figure."""
        return verdict_of(self.claims)


@dataclass(frozen=True, eq=False)
class Recipe:
    """The description of a figure or theorem of a paper: how Shoal reproduces it.

    Parameters
    ----------
    name : str
        Name of the figure on the command line, such as "m-fig7".
    source : str
        Paper, and number of the figure in the paper.
    title : str
        Title of the figure.
    sweeps : callable
        Function (Settings) -> list of Sweep, which returns the sweeps of the figure.
    view : callable
        Function (Store, list of Sweep, Settings) -> Outcome, which draws the results of the sweeps.
    on_map : bool
        Whether the user may replace the map of the figure.
    also : str
        Places in the papers that show the figure, in addition to ``source``.
    """

    name: str
    source: str
    title: str
    sweeps: Callable[[Settings], list[Sweep]]
    view: Callable[[Store, list[Sweep], Settings], Outcome]
    on_map: bool = False
    also: str = ""


@dataclass(frozen=True, eq=False)
class Result:
    """A reproduced figure, or the reason why the reproduction failed.

    Parameters
    ----------
    recipe : Recipe
    outcome : Outcome or None
        The outcome of the recipe, or None if the reproduction failed.
    files : tuple of Path
        Paths of the written files: the figure, its tables and a summary.
    seconds : float
    trials : int
        Total number of trials in all sweeps of the figure.
    error : str
        The reason why the reproduction failed, or an empty text.
    """

    recipe: Recipe
    outcome: Outcome | None
    files: tuple[Path, ...]
    seconds: float
    trials: int
    error: str = ""


def measuring(*names: str) -> Callable[[Function], Function]:
    """Return a decorator for functions that run one trial of a sweep.

    The decorated function must return a dict with the keys ``names``.
    """

    def marked(function: Function) -> Function:
        vars(function)["measures"] = names
        return function

    return marked


def function_sweep(
    name: str, function: Callable[..., Any], axes: dict[str, Any], trials: int, settings: Settings
) -> Sweep:
    """Return a sweep of a function with the decorator `measuring`; the axes of the sweep are the
    function's arguments.
    """
    problem = {"kind": "function", "function": f"{function.__module__}:{function.__name__}"}
    return Sweep(name=name, problem=problem, axes=axes, trials=trials, seed=settings.seed)


def trials_of(store: Store, sweep: Sweep) -> list[dict[str, Any]]:
    """Return all trials of a sweep, each as a dict from the names of axes and measures
    to values.
    """
    columns = store.columns(sweep.name)
    return [dict(zip(columns, row, strict=True)) for row in store.rows(sweep.name)]


def trials_table(
    trials: Sequence[Mapping[str, Any]], columns: Sequence[str], *, title: str = "trials"
) -> Table:
    """Return a table of trials, which Shoal stores as CSV but does not show on the page
    of results.
    """
    return Table(
        title, columns, [[trial[name] for name in columns] for trial in trials], shown=False
    )


@cache
def published_table(name: str) -> tuple[dict[str, str], ...]:
    """Return the rows of the file ``name`` with published data of a paper."""
    text = resources.files("shoal.papers").joinpath("published", name).read_text(encoding="utf-8")
    return tuple(csv.DictReader(io.StringIO(text)))


def published_curve(name: str, *, points: bool = False, **only: str) -> Published:
    """Return a published curve from a file with the columns n, mean_moves and std_moves."""
    rows = [
        row
        for row in published_table(name)
        if all(row[key] == value for key, value in only.items())
    ]
    numbers = np.array(
        [[float(row[key] or "nan") for key in ("n", "mean_moves", "std_moves")] for row in rows]
    ).reshape(-1, 3)
    return Published(numbers[:, 0], numbers[:, 1], numbers[:, 2], points)


def curve_of(
    label: str, rows: Sequence[Row], axis: str, *, published: Published | None = None, **others: Any
) -> Curve:
    """Return the curve of means along ``axis``, from all rows whose other axes have the values in
    ``others``.
    """
    kept = [
        (row.values[axis], row.estimate)
        for row in rows
        if all(row.values[key] == value for key, value in others.items())
    ]
    found = [(float(x), e.mean, *ends(e)) for x, e in kept if e is not None]
    x, mean, low, high = np.array(found, dtype=np.float64).reshape(-1, 4).T
    return Curve(label, x, mean, low, high, published)


def ends(found: Estimate) -> tuple[float, float]:
    """Return both ends of the confidence interval of an estimate.

    For an estimate from a single trial, both ends equal the mean.
    """
    return (found.mean, found.mean) if found.count < 2 else (found.low, found.high)


def table_of(title: str, rows: Sequence[Row], *, shown: bool = True) -> Table:
    """Return a table of the estimates in ``rows``."""
    axes = [*rows[0].values] if rows else []
    lines = [
        [
            *row.values.values(),
            *(("", "", "", "", 0) if row.estimate is None else _line(row.estimate)),
            row.missing,
        ]
        for row in rows
    ]
    return Table(title, [*axes, "mean", "low", "high", "std", "trials", "missing"], lines, shown)


def _line(found: Estimate) -> tuple[Any, ...]:
    low, high = ends(found)
    return (
        round(found.mean, 4),
        round(low, 4),
        round(high, 4),
        "" if found.count < 2 else round(found.std, 4),
        found.count,
    )


def compared(curves: Sequence[Curve]) -> Table:
    """Return a table of Shoal's means beside the published values, at the published points."""
    rows = []
    for curve in curves:
        known = curve.published
        for n, mean in (
            () if known is None else zip(known.x.tolist(), known.mean.tolist(), strict=True)
        ):
            if curve.x.min() <= n <= curve.x.max():
                ours, low, high = (
                    near(curve.x, values, n) for values in (curve.mean, curve.low, curve.high)
                )
                rows.append(
                    [
                        curve.label,
                        int(n),
                        round(ours, 1),
                        f"{low:.1f} to {high:.1f}",
                        mean,
                        f"{100 * (ours / mean - 1):+.1f}",
                    ]
                )
    return Table(
        "ours and published", ["", "n", "ours", "95 % interval", "published", "difference, %"], rows
    )


def capital(text: str) -> str:
    """Return ``text`` with a capital first letter."""
    return f"{text[:1].upper()}{text[1:]}"


def counts_of(n_free: int, parts: int = 50) -> list[int]:
    """Return increasing numbers of particles in equal steps, up to one particle in each
    free cell.
    """
    return sorted({max(1, round(n_free * k / parts)) for k in range(1, parts + 1)})


def near(x: NDArray[np.float64], mean: NDArray[np.float64], at: float) -> float:
    """Return the value of the curve ``mean`` over ``x`` at the number of particles ``at``,
    interpolated on logarithmic scales.
    """
    return float(np.exp(np.interp(np.log(at), np.log(x), np.log(np.maximum(mean, 1e-9)))))
