"""Rows of a store, converted and validated: sweeps, and the columns of results."""

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
    """A sweep in the form in which a store contains it. The problem is created only when the method `sweep` is called.

    Parameters
    ----------
    id : int
        Number of the sweep's row.
    where : str
        Name of the file and of the sweep, with which error messages begin.
    spec : dict
        The result of `shoal.lab.Sweep.describe`.
    inputs : mapping of str to str
        Digests of the files that the sweep opens.
    measures : tuple of str
    trials, n_points : int
        Number of trials per point, and number of points.
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
        """The fields of the sweep, converted to their types."""
        return form_of(self.spec, where=self.where)

    @property
    def axes(self) -> tuple[str, ...]:
        """The names of the axes."""
        return tuple(self.form.axes)

    def sweep(self) -> Sweep:
        """Return the sweep as it was declared when it was run."""
        return sweep_of(self.spec, where=self.where)

    def values(self, text: str) -> dict[str, Any]:
        """Return the axis values that the row of a point contains."""
        values = parse_json(text, where=f"{self.where}: point")
        if not isinstance(values, list) or len(values) != len(self.axes):
            raise InvalidInputError(
                f"{self.where}: expected {len(self.axes)} values at a point, one per axis, got {shortened(values)}"
            )
        return dict(zip(self.axes, values, strict=True))


def stored_sweep(row: tuple[Any, ...], *, where: str) -> StoredSweep:
    """Return the sweep that a row (id, spec, inputs, measures, trials, points) describes.

    Raises
    ------
    InvalidInputError
        If the row is damaged.
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
    """Return the columns of a chunk of result rows. Each entry of ``axes`` is (axis values, number of rows with these values).

    Raises
    ------
    InvalidInputError
        If a row is damaged.
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
