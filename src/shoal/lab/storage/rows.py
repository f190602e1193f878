"""Conversion and validation of rows in a store: rows of sweeps, and rows of results."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import product
from math import prod
from typing import Any

from shoal.core.checks import parse_json, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, errors_at
from shoal.lab.sweeps.axes import MAX_POINTS, axis_values
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

    def check_points(self, texts: Sequence[str]) -> None:
        """Refuse stored points that are not the points of the sweep, in the order of the sweep.

        Two points with the same axis values would otherwise share one mean in a summary. The check compares the axis values only,
        so that it runs no third-party code; `shoal.lab.storage.integrity` also compares the digests of the problems.

        Raises
        ------
        InvalidInputError
        """
        with errors_at(f"{self.where}: spec"):
            axes = [axis_values(name, values) for name, values in self.form.axes.items()]
        count = prod(len(values) for values in axes)
        expected = [json.dumps(values) for values in product(*axes)] if count <= MAX_POINTS else []
        if [*texts] == expected and len(set(texts)) == count:
            return
        hint = "restore a copy, or start a new store"
        seen: set[str] = set()
        for text in texts:
            if text in seen:
                raise InvalidInputError(
                    f"{self.where}: expected points that differ, got two points with the axis values {shortened(text)}; {hint}"
                )
            seen.add(text)
        raise InvalidInputError(
            f"{self.where}: expected the {count} points of the sweep's axes, got {len(texts)} points, not all of which are equal "
            f"to these; {hint}"
        )


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
