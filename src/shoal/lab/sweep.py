"""Sweeps: points of parameters and their trials, and the sweep files that declare them."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from decimal import Decimal
from functools import cached_property
from itertools import product
from math import exp, isfinite, log, prod
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StrictInt, ValidationError

from shoal.core.checks import (
    MOST_TRIALS,
    check_integer,
    check_list,
    parse_toml,
    read_text,
    shortened,
    validation_message,
)
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, errors_at
from shoal.core.problem import Problem
from shoal.lab.problems import FunctionProblem, trial_problem

MAX_POINTS = 100_000


class RangeForm(BaseModel):
    """An axis as a range, given by its ends ``from`` and ``to``, and by either ``step`` or
    ``count``.

    The range includes its end ``to`` if the steps reach it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    start: StrictInt | float = Field(alias="from")
    stop: StrictInt | float = Field(alias="to")
    step: StrictInt | float | None = None
    count: StrictInt | None = Field(default=None, ge=1, le=MAX_POINTS)
    scale: Literal["linear", "log"] = "linear"


def axis_values(name: str, given: Any) -> tuple[Any, ...]:
    """Return the values of an axis. Expand a range to its values, and return a list of values
    unchanged.

    Examples
    --------
    >>> axis_values("particles", {"from": 100, "to": 500, "step": 200})
    (100, 300, 500)
    >>> axis_values("loss", {"from": 0, "to": 0.3, "step": 0.1})
    (0.0, 0.1, 0.2, 0.3)
    >>> axis_values("particles", {"from": 1, "to": 1000, "count": 4, "scale": "log"})
    (1, 10, 100, 1000)
    """
    where = f"axes.{name}"
    if isinstance(given, Mapping):
        try:
            values = _range(RangeForm.model_validate(given), where)
        except ValidationError as error:
            raise InvalidInputError(validation_message(error, where=where)) from None
        except ArithmeticError:
            raise InvalidInputError(
                f"{where}: expected numbers below 1e300, got {shortened(given)}"
            ) from None
    elif isinstance(given, list | tuple | range):
        values = tuple(given)
    else:
        raise InvalidInputError(f"{where}: expected a list of values or a range, got {given!r:.80}")
    if not values:
        raise InvalidInputError(f"{where}: expected one value or more, got none")
    if len(values) > MAX_POINTS:
        raise InvalidInputError(f"{where}: expected at most {MAX_POINTS} values, got {len(values)}")
    for value in values:
        if isinstance(value, float) and not isfinite(value):
            raise InvalidInputError(f"{where}: expected finite numbers, got {value!r}")
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError):
            raise InvalidInputError(
                f"{where}: expected texts, numbers, truth values or lists of these, got"
                f" {value!r:.80}"
            ) from None
    return values


def _range(form: RangeForm, where: str) -> tuple[Any, ...]:
    if (form.step is None) == (form.count is None):
        raise InvalidInputError(
            f"{where}: expected either step or count, got"
            f" {'neither' if form.step is None else 'both'}"
        )
    whole = isinstance(form.start, int) and isinstance(form.stop, int)
    if form.count is not None:
        return _spaced(form, whole=whole, where=where)
    assert form.step is not None  # one of the two is given
    if form.scale == "log" or form.step == 0 or (form.stop - form.start) / form.step < 0:
        raise InvalidInputError(
            f"{where}: expected a step that leads from {form.start} to {form.stop}, got {form.step}"
        )
    # Computed in decimals, so that the values are 0.1, 0.2, 0.3 and not 0.30000000000000004.
    start, stop, step = (Decimal(str(number)) for number in (form.start, form.stop, form.step))
    steps = int((stop - start) / step)
    if steps > MAX_POINTS:
        raise InvalidInputError(f"{where}: expected at most {MAX_POINTS} values, got {steps + 1}")
    values = [start + step * k for k in range(steps + 1)]
    return tuple(
        int(value) if whole and isinstance(form.step, int) else float(value) for value in values
    )


def _spaced(form: RangeForm, *, whole: bool, where: str) -> tuple[Any, ...]:
    """Return ``count`` values between the ends of a range, with linear or logarithmic steps.

    If both ends of the range are whole numbers, round each value and omit repetitions.
    """
    count = form.count or 1
    if form.scale == "log" and not (form.start > 0 and form.stop > 0):
        raise InvalidInputError(
            f"{where}: expected a logarithmic range between numbers above 0, got {form.start} to"
            f" {form.stop}"
        )
    low, high = (
        (log(form.start), log(form.stop)) if form.scale == "log" else (form.start, form.stop)
    )
    raw = [low + (high - low) * k / max(1, count - 1) for k in range(count)]
    values = [exp(value) for value in raw] if form.scale == "log" else raw
    if whole:
        return tuple(dict.fromkeys(round(value) for value in values))
    return tuple(float(f"{value:.12g}") for value in values)


_HEADER = re.compile(r"\[\s*([\w.-]+)\s*\]")
_FIELD = re.compile(r"""(["']?)([\w.-]+)\1\s*=""")


def line_of(text: str, message: str) -> int | None:
    r"""Return the line of the field named by an error message such as "problem: mpa: expected ...",
    or None for a missing field.

    Examples
    --------
    >>> line_of("trials = 2\n\n[problem]\nmpa = 3", "problem: mpa: expected no such field, got 3")
    4
    >>> line_of("[axes]\nlegs = [4]", "problem at legs = 4: legs: expected no such field, got 4")
    2
    >>> line_of("trials = 2", "name: expected this field, got none") is None
    True
    """
    lines = _lines(text)
    where, _, _ = message.partition(": expected")
    best: tuple[int, int] | None = None
    for name in re.findall(r"[\w.-]+", where):
        for prefix in ("", "problem.", "axes."):
            line = lines.get(prefix + name)
            if line is not None and (best is None or (prefix + name).count(".") >= best[0]):
                best = ((prefix + name).count("."), line)
    return None if best is None else best[1]


def _lines(text: str) -> dict[str, int]:
    """Return the line number of each header and each field, by dotted name."""
    found: dict[str, int] = {}
    section = ""
    for number, line in enumerate(text.splitlines(), 1):
        header, field = _HEADER.match(line.strip()), _FIELD.match(line.strip())
        if header:
            section = f"{header[1]}."
            found.setdefault(header[1], number)
        elif field:
            found.setdefault(section + field[2], number)
    return found


_TABLES = ("problem", "axes")


def as_toml(sweep: Mapping[str, Any]) -> str:
    """Return the text of a sweep file. Omit empty tables, and fields with the value None.

    Parameters
    ----------
    sweep : mapping
        The fields of a sweep file, as returned by `shoal.lab.Sweep.describe`. Each axis is a list
        of values or a range.

    Raises
    ------
    InvalidInputError
        Raised if TOML cannot represent a value.

    Examples
    --------
    >>> print(as_toml({"name": "a", "trials": 3, "problem": {"kind": "line", "cells": 9}, "axes": {"particles": [1, 2]}}))
    name = "a"
    trials = 3
    <BLANKLINE>
    [problem]
    kind = "line"
    cells = 9
    <BLANKLINE>
    [axes]
    particles = [1, 2]
    <BLANKLINE>
    """
    blocks = [
        _fields(
            {name: value for name, value in sweep.items() if name not in _TABLES and value != []}
        )
    ]
    for name in _TABLES:
        if not isinstance(sweep.get(name) or {}, Mapping):
            raise InvalidInputError(f"{name}: expected a table, got {shortened(sweep[name])}")
    blocks += [f"[{name}]\n{_fields(sweep[name])}" for name in _TABLES if sweep.get(name)]
    return "\n".join(blocks)


def _fields(table: Mapping[str, Any]) -> str:
    return "".join(
        f"{_key(name)} = {_value(value, name)}\n"
        for name, value in table.items()
        if value is not None
    )


def _key(name: str) -> str:
    plain = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if plain else _text(name)


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any, name: str) -> str:
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, Mapping):
        return (
            "{ "
            + ", ".join(f"{_key(key)} = {_value(one, name)}" for key, one in value.items())
            + " }"
        )
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(one, name) for one in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    raise InvalidInputError(
        f"{name}: expected texts, numbers, truth values or lists of these, got {shortened(value)}"
    )


LARGEST_SWEEP = 10_000_000
"""Maximum size of a sweep file, in bytes."""


class SweepForm(BaseModel):
    """The fields of a sweep file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    problem: dict[str, Any]
    axes: dict[str, Any] = Field(default_factory=dict)
    trials: StrictInt = 1
    seed: StrictInt = 0
    paired: list[str] = Field(default_factory=list)


@dataclass(frozen=True)
class Point:
    """One point of a sweep: a problem that the sweep runs ``trials`` times.

    Parameters
    ----------
    number : int
        Index of the point in the list of all points of the sweep.
    values : dict
        Values of the sweep's axes at the point, by axis name.
    problem : Problem
    key : str
        Digest of the point's problem. A store identifies each point by the key of the point.
    seeds : str
        Text of the point's problem without the paired axes. ``seeds``, the seed of the sweep and
        the trial number determine the seed of a trial.
    """

    number: int
    values: Mapping[str, Any]
    problem: Problem
    key: str
    seeds: str


def check_sweep_name(name: Any, *, what: str) -> str:
    """Check that the name of a sweep can be part of a file name, and return the name."""
    usable = isinstance(name, str) and 0 < len(name) <= 80 and name[0] not in ".-"
    if not usable or not all(c.isascii() and (c.isalnum() or c in "._-") for c in name):
        raise InvalidInputError(
            f"{what}: expected at most 80 letters, digits, points, hyphens and underscores (no"
            f" blanks; neither a point nor a hyphen first), got {name!r:.100}"
        )
    return str(name)


@dataclass(frozen=True)
class Sweep:
    """Trials of one problem at every combination of values on several axes.

    Parameters
    ----------
    name : str
        Name of the sweep, which consists of letters, digits, ``.``, ``_`` and ``-``.
    problem : dict
        The fields of the sweep's problem. The field ``kind`` is "swarm", "line", "schedule",
        "steering", "search" or "function", and determines all other fields.
    axes : dict
        For each axis, which is a field of the problem, a list of values or a range such as
        ``{"from": 100, "to": 5000, "step": 100}``. A range may have ``count`` instead of ``step``.
        A range with ``"scale": "log"`` has logarithmic steps. If the problem is a function, the
        axes are arguments of the function.
    trials : int
        Number of trials at each point of the sweep.
    seed : int
        Seed of the sweep. The seed of a trial depends on the seed of the sweep, the problem of the
        point and the trial number, and on nothing else.
    paired : sequence of str
        Names of the paired axes, which do not influence the seeds of trials. If two points differ
        in paired axes only, their k-th trials have equal seeds.

    Examples
    --------
    >>> sweep = Sweep(name="corridor", problem={"kind": "swarm", "map": "line:50"}, axes={"particles": [5, 10]}, trials=3)
    >>> [point.problem.particles for point in sweep.points], sweep.total
    ([5, 10], 6)
    """

    name: str
    problem: Mapping[str, Any]
    axes: Mapping[str, Any] = field(default_factory=dict)
    trials: int = 1
    seed: int = 0
    paired: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_sweep_name(self.name, what="name")
        for name, value, least, most in (
            ("trials", self.trials, 1, MOST_TRIALS),
            ("seed", self.seed, 0, 2**63 - 1),
        ):
            object.__setattr__(self, name, check_integer(value, what=name, least=least, most=most))
        for name, given in (("problem", self.problem), ("axes", self.axes)):
            if not isinstance(given, Mapping):
                raise InvalidInputError(f"{name}: expected fields with values, got {given!r:.80}")
        object.__setattr__(self, "problem", dict(self.problem))
        object.__setattr__(
            self, "axes", {name: axis_values(name, values) for name, values in self.axes.items()}
        )
        object.__setattr__(self, "paired", tuple(check_list(self.paired, str, what="paired")))
        for name in self.paired:
            if name not in self.axes:
                raise InvalidInputError(
                    f"paired: expected names of axes ({', '.join(self.axes) or 'none'}), got"
                    f" {name!r}"
                )
        if self.n_points > MAX_POINTS:
            raise InvalidInputError(
                f"axes: expected at most {MAX_POINTS} points, got {self.n_points}"
            )
        _ = self.points

    @property
    def n_points(self) -> int:
        """Number of points of the sweep."""
        return prod(len(values) for values in self.axes.values())

    @property
    def total(self) -> int:
        """Number of trials of the sweep, at all points together."""
        return self.n_points * self.trials

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """All points of the sweep, in an order in which the value of the last axis
        changes fastest.
        """
        kind = self.problem.get("kind")
        made = tuple(
            self._point(
                number, dict(zip(self.axes, values, strict=True)), function=kind == "function"
            )
            for number, values in enumerate(product(*self.axes.values()))
        )
        seen: dict[str, Point] = {}
        for point in made:
            other = seen.setdefault(point.key, point)
            if other is not point:
                raise InvalidInputError(
                    f"axes: expected points that differ, got {_words(other.values)} and"
                    f" {_words(point.values)}"
                )
        return made

    def _point(self, number: int, values: dict[str, Any], *, function: bool) -> Point:
        fields = dict(self.problem)
        if function:  # the axes are the function's arguments
            fields["arguments"] = dict(fields.get("arguments", {})) | values
        else:
            fields |= values
        problem = trial_problem(
            fields, where=f"problem at {_words(values)}" if values else "problem"
        )
        if isinstance(problem, FunctionProblem):
            kept = {
                name: value
                for name, value in (problem.arguments or {}).items()
                if name not in self.paired
            }
            seeds = problem.replaced(arguments=kept).canonical()
        else:
            seeds = problem.canonical(without=self.paired)
        return Point(number, values, problem, digest_of(problem.canonical()), seeds)

    @property
    def measures(self) -> tuple[str, ...]:
        """Names of the measures that each trial of the sweep gives."""
        return self.points[0].problem.measures

    def describe(self) -> dict[str, Any]:
        """Return the sweep as JSON data. Equal sweeps give equal data."""
        return {
            "name": self.name,
            "problem": self.problem,
            "axes": {name: list(values) for name, values in self.axes.items()},
            "trials": self.trials,
            "seed": self.seed,
            "paired": list(self.paired),
        }

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Sweep:
        """Read a sweep file in TOML format.

        Raises
        ------
        InvalidInputError
            Raised if the file is invalid. The error message contains the file name, the line number
            and the wrong field.
        """
        return sweep_in(
            read_text(Path(path), what="sweep file", most=LARGEST_SWEEP), where=str(path)
        )


def sweep_in(
    text: str, *, where: str, check: Callable[[dict[str, Any]], None] | None = None
) -> Sweep:
    """Return the sweep that the text of a sweep file describes.

    Parameters
    ----------
    text : str
        The text of a sweep file in TOML format.
    where : str
        Text with which error messages begin, such as the name of the file.
    check : callable, optional
        Function that checks the fields before the sweep is made. Shoal adds the line number of the
        wrong field to an error message of ``check``.

    Raises
    ------
    InvalidInputError
        Raised if the text of the sweep file is invalid. The error message contains the line number
        and the wrong field.
    """
    data = parse_toml(text, where=where)
    try:
        if check is not None:
            check(data)
        return sweep_of(data, where=where)
    except InvalidInputError as error:
        message = str(error).removeprefix(f"{where}: ")
        line = line_of(text, message)
        raise InvalidInputError(
            f"{where}, line {line}: {message}" if line else f"{where}: {message}"
        ) from None


def sweep_of(data: Mapping[str, Any], *, where: str = "sweep") -> Sweep:
    """Return the sweep that the parsed data of a TOML or JSON file describe.

    Parameters
    ----------
    data : mapping
        The fields of a sweep file.
    where : str
        Text with which error messages begin, such as the name of the file.
    """
    form = form_of(data, where=where)
    with errors_at(where):
        return Sweep(form.name, form.problem, form.axes, form.trials, form.seed, tuple(form.paired))


def form_of(data: Mapping[str, Any], *, where: str) -> SweepForm:
    """Return the fields of a sweep, each converted to the type of the field. Do not create the
    sweep's problem.
    """
    try:
        return SweepForm.model_validate(data)
    except ValidationError as error:
        raise InvalidInputError(validation_message(error, where=where)) from None


def _words(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in values.items())


def digest_of(content: str | bytes) -> str:
    """Return a short digest of a text or a bytes object."""
    return hashlib.blake2b(
        content.encode() if isinstance(content, str) else content, digest_size=16
    ).hexdigest()


def trial_seed(sweep_seed: int, seeds: str, trial: int) -> int:
    """Return the seed of a trial: 63 bits of a digest of the sweep's seed, the problem without
    paired axes, and the trial number.

    Examples
    --------
    >>> trial_seed(0, "{}", 0) == trial_seed(0, "{}", 0) != trial_seed(0, "{}", 1)
    True
    """
    digest = hashlib.blake2b(f"{sweep_seed}\n{seeds}\n{trial}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big") >> 1


def differences(old: Mapping[str, Any], new: Mapping[str, Any], *, path: str = "") -> Iterator[str]:
    """Yield the differences between the descriptions of two sweeps, such as "trials: 10 -> 20".

    Examples
    --------
    >>> list(differences({"trials": 10, "axes": {"n": [1]}}, {"trials": 20, "axes": {"n": [1, 2]}}))
    ['trials: 10 -> 20', 'axes.n: [1] -> [1, 2]']
    """
    for name in dict.fromkeys([*old, *new]):
        here = f"{path}.{name}" if path else name
        before, after = old.get(name), new.get(name)
        if isinstance(before, Mapping) and isinstance(after, Mapping):
            yield from differences(before, after, path=here)
        elif before != after:
            said_as = [
                ("none" if value is None else _shortened(json.dumps(value)))
                for value in (before, after)
            ]
            yield f"{here}: {said_as[0]} -> {said_as[1]}"


def _shortened(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:40]} ... {text[-15:]}"


def distinct_places(points: tuple[Point, ...]) -> Iterator[Point]:
    """For each map, workspace or region of a sweep, yield the first point that uses it."""
    seen: set[tuple[str, str | None]] = set()
    for point in points:
        place = (point.problem.part, point.problem.place_key())
        if place not in seen:
            seen.add(place)
            yield point


def is_extended(old: Sweep, new: Sweep) -> bool:
    """Return whether the sweep ``new`` contains all trials of the sweep ``old``."""
    seeds = {point.key: point.seeds for point in new.points}
    kept = all(seeds.get(point.key) == point.seeds for point in old.points)
    return kept and new.trials >= old.trials and new.seed == old.seed
