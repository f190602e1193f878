"""Numbers in mission files: writing coordinates with a fixed number of decimals, and counting the decimals of a number."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np

from shoal.core.checks import check_json_memory
from shoal.core.errors import InvalidInputError
from shoal.search.missions.diagnostics import Sheet, decimals_of
from shoal.search.regions.projection import DECIMALS

_MOST_VALUES = 2_000_000


def degrees(value: float) -> str:
    """Return a coordinate in degrees as text.

    Examples
    --------
    >>> degrees(8.5), degrees(-0.000000001)
    ('8.50000000', '0.00000000')
    """
    text = f"{value:.{DECIMALS}f}"
    return text.lstrip("-") if float(text) == 0 else text


def plain(value: float) -> str:
    """Return a number as a short, exact text without an exponent.

    Examples
    --------
    >>> plain(30.0), plain(2.5), plain(1e-7)
    ('30', '2.5', '0.0000001')
    """
    if value == int(value) and abs(value) < 1e15:
        return str(int(value))
    return np.format_float_positional(value, trim="-")


class Number(float):
    """A number from a JSON file, with the number of decimals that it had in the file."""

    decimals = 0

    def __new__(cls, text: str) -> Number:
        """Return the number that a text represents."""
        made = super().__new__(cls, text)
        made.decimals = decimals_of(text)
        return made


def load_json(text: str, sheet: Sheet) -> Any:
    """Parse the JSON text of a mission file. Numbers with decimals become `Number`. An invalid text makes the sheet unreadable."""
    if (values := text.count(",")) > _MOST_VALUES:  # each `Number` needs about 150 bytes
        sheet.add("unreadable", "", f"expected at most {_MOST_VALUES} values, got {values}")
        return None
    try:
        check_json_memory(text, where="")
        return json.loads(text, parse_float=Number)
    except InvalidInputError as error:
        sheet.add("unreadable", "", str(error).removeprefix(": "))
    except json.JSONDecodeError as error:
        sheet.add("unreadable", f"line {error.lineno}", f"expected JSON, got something else: {error.msg.lower()}")
    except (RecursionError, ValueError):
        sheet.add("unreadable", "", "expected JSON, got values nested too deeply or a number of too many digits")
    return None


def dump_json(value: Any) -> str:
    """Return a JSON text, in which the strings from the function `raw` appear as numbers.

    Examples
    --------
    >>> dump_json([raw("8.50000000"), 1.5])
    '[8.50000000, 1.5]'
    """
    text = json.dumps(value, indent=1, allow_nan=False, ensure_ascii=False)
    text = re.sub(r'"\\u001f([-\d.]+)"', r"\1", text)
    return re.sub(r"\[\s+([^\[\]{}]*?)\s+\]", lambda found: "[" + re.sub(r",\s+", ", ", found[1]) + "]", text)


def raw(number: str) -> str:
    """Mark the text of a number, so that `dump_json` writes this text unchanged as a number."""
    return f"\x1f{number}"
