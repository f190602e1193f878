"""Conversion and validation of rows in a store: rows of sweeps, and rows of results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from shoal.core.checks import parse_json, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.lab.sweeps.sweep import Sweep, SweepForm, form_of, sweep_of


@dataclass(frozen=True)
class StoredSweep:
    """The description of a sweep in a store. The method `sweep` creates the sweep and its problem.

    Parameters
    ----------
    id : int
        Number of the sweep's row in the store.
    where : str
        First words of error messages: the names of the store file and the sweep.
    spec : dict
        The sweep as JSON data, as returned by `shoal.lab.Sweep.describe`.
    inputs : mapping of str to str
        Digests of the maps, workspaces and regions that the sweep opens.
    measures : tuple of str
    trials, n_points : int
        ``trials`` is the number of trials per point, and ``n_points`` is the number of points.
    """

    id: int
    where: str
    spec: Mapping[str, Any]
    inputs: Mapping[str, str]
    measures: tuple[str, ...]
    trials: int
    n_points: int

    @cached_property
    def form(self) -> SweepForm:
        """The fields of the sweep, each converted to the type of the field."""
        return form_of(self.spec, where=self.where)

    @property
    def axes(self) -> tuple[str, ...]:
        """The names of the sweep's axes."""
        return tuple(self.form.axes)

    def sweep(self) -> Sweep:
        """Return the sweep as the user declared it for the run."""
        return sweep_of(self.spec, where=self.where)

    def values(self, text: str) -> dict[str, Any]:
        """Return the value of each axis by its name, from the text in the stored row of a point."""
        values = parse_json(text, where=f"{self.where}: point")
        if not isinstance(values, list) or len(values) != len(self.axes):
            raise InvalidInputError(
                f"{self.where}: expected {len(self.axes)} values at a point, one per axis, got {shortened(values)}"
            )
        return dict(zip(self.axes, values, strict=True))


def stored_sweep(row: tuple[Any, ...], *, where: str) -> StoredSweep:
    """Return the sweep that a row with the columns (id, spec, inputs, measures, trials, points) describes.

    Raises
    ------
    InvalidInputError
        Raised if the row of the sweep is damaged.
    """
    number, *texts, trials, points = row
    spec, inputs, measures = (
        parse_json(text if isinstance(text, str) else "", where=f"{where}: {column}")
        for column, text in zip(("spec", "inputs", "measures"), texts, strict=True)
    )
    if not isinstance(spec, dict) or not isinstance(inputs, dict):
        raise InvalidInputError(f"{where}: expected JSON objects as spec and inputs, got {shortened(spec)} and {shortened(inputs)}")
    if not isinstance(measures, list) or not all(isinstance(name, str) for name in measures):
        raise InvalidInputError(f"{where}: measures: expected a list of names, got {shortened(measures)}")
    if not isinstance(trials, int) or not isinstance(points, int):
        raise InvalidInputError(
            f"{where}: expected whole numbers of trials and of points, got {shortened(trials)} and {shortened(points)}"
        )
    return StoredSweep(number, where, spec, inputs, tuple(measures), trials, points)


def columns_of(axes: list[tuple[list[Any], int]], parts: tuple[list[str], ...], stored: StoredSweep) -> list[Sequence[Any]]:
    """Return rows of results as columns: the axes, the trial numbers, the seeds and the measures.

    Each entry of ``axes`` is (axis values of a point, number of rows of the point). ``parts`` contains JSON texts of the trial
    numbers, the seeds and the results.

    Raises
    ------
    InvalidInputError
        Raised if a row of results is damaged.
    """
    first: list[list[Any]] = [[] for _ in axes[0][0]]
    for values, count in axes:
        for column, value in zip(first, values, strict=True):
            column.extend([value] * count)
    trials, seeds, results = (parse_json(f"[{','.join(part)}]", where=f"{stored.where}: results") for part in parts)
    width = len(stored.measures)
    bad = next((one for one in results if not isinstance(one, list) or len(one) != width), None)
    if not all(type(one) is int for one in (*trials, *seeds)):
        raise InvalidInputError(f"{stored.where}: trials: expected whole numbers of trials and seeds, got something else")
    if bad is not None or not len(trials) == len(seeds) == len(results):
        got = f"{len(results)} rows for {len(trials)} trials" if bad is None else shortened(bad)
        raise InvalidInputError(f"{stored.where}: results: expected rows of {width} values, got {got}")
    return [*first, trials, seeds, *(zip(*results, strict=True) if width else ())]
