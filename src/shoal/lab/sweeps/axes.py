"""The axes of a sweep. An axis is a list of values, or a range that Shoal expands to a list."""

from __future__ import annotations

import json
from collections.abc import Mapping
from decimal import Decimal
from math import exp, isfinite, log
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StrictInt, ValidationError

from shoal.core.checks import shortened, validation_message
from shoal.core.errors import InvalidInputError

MAX_POINTS = 100_000


class RangeForm(BaseModel):
    """An axis as a range, given by its ends ``from`` and ``to``, and by either ``step`` or ``count``.

    The range includes its end ``to`` if the steps reach it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    start: StrictInt | float = Field(alias="from")
    stop: StrictInt | float = Field(alias="to")
    step: StrictInt | float | None = None
    count: StrictInt | None = Field(default=None, ge=1, le=MAX_POINTS)
    scale: Literal["linear", "log"] = "linear"


def axis_values(name: str, given: Any) -> tuple[Any, ...]:
    """Return the values of an axis. Expand a range to its values, and return a list of values unchanged.

    Raises
    ------
    InvalidInputError

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
            raise InvalidInputError(f"{where}: expected numbers below 1e300, got {shortened(given)}") from None
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
                f"{where}: expected texts, numbers, truth values or lists of these, got {value!r:.80}"
            ) from None
    return values


def _range(form: RangeForm, where: str) -> tuple[Any, ...]:
    if (form.step is None) == (form.count is None):
        raise InvalidInputError(f"{where}: expected either step or count, got {'neither' if form.step is None else 'both'}")
    whole = isinstance(form.start, int) and isinstance(form.stop, int)
    if form.count is not None:
        return _spaced(form, whole=whole, where=where)
    assert form.step is not None  # one of the two is given
    if form.scale == "log" or form.step == 0 or (form.stop - form.start) / form.step < 0:
        raise InvalidInputError(f"{where}: expected a step that leads from {form.start} to {form.stop}, got {form.step}")
    # Computed in decimals, so that the values are 0.1, 0.2, 0.3 and not 0.30000000000000004.
    start, stop, step = (Decimal(str(number)) for number in (form.start, form.stop, form.step))
    steps = int((stop - start) / step)
    if steps > MAX_POINTS:
        raise InvalidInputError(f"{where}: expected at most {MAX_POINTS} values, got {steps + 1}")
    values = [start + step * k for k in range(steps + 1)]
    return tuple(int(value) if whole and isinstance(form.step, int) else float(value) for value in values)


def _spaced(form: RangeForm, *, whole: bool, where: str) -> tuple[Any, ...]:
    """Return ``count`` values between the ends of a range, with linear or logarithmic steps.

    If both ends of the range are whole numbers, round each value and omit repetitions.
    """
    count = form.count or 1
    if form.scale == "log" and not (form.start > 0 and form.stop > 0):
        raise InvalidInputError(f"{where}: expected a logarithmic range between numbers above 0, got {form.start} to {form.stop}")
    low, high = (log(form.start), log(form.stop)) if form.scale == "log" else (form.start, form.stop)
    raw = [low + (high - low) * k / max(1, count - 1) for k in range(count)]
    values = [exp(value) for value in raw] if form.scale == "log" else raw
    if whole:
        return tuple(dict.fromkeys(round(value) for value in values))
    return tuple(float(f"{value:.12g}") for value in values)
