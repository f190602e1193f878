"""Checks of what a browser sends: the JSON of a request, and the fields that a question or a job
has.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from shoal.core.checks import decode_text, parse_json, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError

MOST_DIGITS = 19
"""Maximum number of digits of a whole number in a request. A larger seed arrives as text."""


@dataclass(frozen=True)
class Field:
    """A field of a request: the types of its value, and whether the request must have the field."""

    kinds: tuple[type, ...]
    required: bool = True


_WORDS = {
    str: "a text",
    dict: "an object",
    list: "a list",
    bool: "true or false",
    int: "a whole number",
    float: "a number",
}
TEXT, OBJECT, LIST = Field((str,)), Field((dict,)), Field((list,))
MAYBE_TEXT, MAYBE_OBJECT, MAYBE_LIST, MAYBE_BOOL, MAYBE_INTEGER, MAYBE_NUMBER, SEED = (
    Field(kinds, required=False)
    for kinds in ((str,), (dict,), (list,), (bool,), (int,), (int, float), (int, str))
)


def read_json(body: bytes) -> dict[str, Any]:
    """Return the JSON object in the body of a request.

    Raises
    ------
    InvalidInputError
        Raised for a body that is not a JSON object in UTF-8, and for what JSON allows but no field
        has: NaN and infinities, whole numbers of more than `MOST_DIGITS` digits, a key that occurs
        twice, deep nesting, and halves of characters.

    Examples
    --------
    >>> read_json(b'{"seed": 1e999}')
    Traceback (most recent call last):
    ...
    shoal.core.errors.InvalidInputError: request: expected finite numbers, got 1e999
    """
    fields = parse_json(
        decode_text(body, where="request"),
        where="request",
        parse_constant=_finite,
        parse_float=_finite,
        parse_int=_short,
    )
    if not isinstance(fields, dict):
        raise InvalidInputError(f"request: expected a JSON object, got {shortened(fields)}")
    try:
        json.dumps(fields, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise InvalidInputError(
            "request: expected texts of whole characters, got half of a surrogate pair"
        ) from None
    return fields


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise InvalidInputError(f"request: expected finite numbers, got {text[:40]}")
    return number


def _short(text: str) -> int:
    if len(text.lstrip("-")) > MOST_DIGITS:
        raise InvalidInputError(
            f"request: expected whole numbers of at most {MOST_DIGITS} digits, got {text[:24]}…"
        )
    return int(text)


def check_request(data: Mapping[str, Any], fields: Mapping[str, Field]) -> None:
    """Check that a request has the fields of a question or job, each of the right type, and no
    other field.

    Examples
    --------
    >>> check_request({"file": 5}, {"file": TEXT})
    Traceback (most recent call last):
    ...
    shoal.core.errors.InvalidInputError: file: expected a text, got 5
    """
    for name, value in data.items():
        if name not in fields:
            known = f"one of {', '.join(fields)}" if fields else "no fields"
            raise InvalidInputError(f"request: expected {known}, got the field {shortened(name)}")
        field = fields[name]
        if value is None and not field.required:
            continue
        if not isinstance(value, field.kinds) or (
            isinstance(value, bool) and bool not in field.kinds
        ):
            expected = " or ".join(_WORDS[kind] for kind in field.kinds)
            raise InvalidInputError(f"{name}: expected {expected}, got {shortened(value)}")
    for name, field in fields.items():
        if field.required and name not in data:
            raise InvalidInputError(f"{name}: expected {_WORDS[field.kinds[0]]}, got no such field")
