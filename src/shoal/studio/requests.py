"""Checks of what a browser sends: the JSON of a request, and the fields that a question or a job
has.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from shoal.core.checks import DEEPEST, check_depth, shortened
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
}
TEXT, OBJECT, LIST = Field((str,)), Field((dict,)), Field((list,))
MAYBE_TEXT, MAYBE_OBJECT, MAYBE_LIST, MAYBE_BOOL, MAYBE_INTEGER, SEED = (
    Field(kinds, required=False)
    for kinds in ((str,), (dict,), (list,), (bool,), (int,), (int, str))
)

QUESTIONS: dict[str, dict[str, Field]] = {
    "page": {"file": TEXT},
    "copies": {"problem": MAYBE_OBJECT, "file": MAYBE_TEXT, "seed": SEED},
    "save": {"problem": OBJECT, "name": MAYBE_TEXT, "seed": SEED},
    "map": {"problem": OBJECT, "cells": MAYBE_OBJECT, "seed": SEED},
    "photograph": {"file": TEXT},
    "vessels": {"problem": OBJECT, "exact": MAYBE_BOOL},
    "sketch": {"shape": LIST, "free": TEXT, "name": MAYBE_TEXT},
    "steer": {"problem": OBJECT, "seed": SEED},
    "workspace": {"problem": OBJECT, "seed": SEED},
    "reach": {"problem": OBJECT, "moves": MAYBE_INTEGER, "seed": SEED},
    "plan": {"problem": OBJECT, "drawing": MAYBE_OBJECT, "frame": MAYBE_LIST, "seed": SEED},
    "missions": {
        "problem": OBJECT,
        "drawing": MAYBE_OBJECT,
        "missions": MAYBE_OBJECT,
        "frame": MAYBE_LIST,
        "seed": SEED,
    },
    "simulate": {"problem": OBJECT, "drawing": MAYBE_OBJECT, "seed": SEED},
    "draw": {"problem": OBJECT, "drawing": MAYBE_OBJECT},
    "earth": {"frame": LIST},
    "papers": {},
    "lab-forms": {},
    "sweeps": {},
    "sweep": {"store": TEXT, "sweep": MAYBE_TEXT, "measure": MAYBE_TEXT},
    "new-sweep": {"toml": MAYBE_TEXT, "sweep": MAYBE_OBJECT},
    "picture": {"file": TEXT},
}
"""The fields of each question of a page. Each question may also have the field ``slow``."""

JOBS: dict[str, dict[str, Field]] = {
    "play": {"problem": OBJECT, "seed": SEED},
    "compare": {"problem": OBJECT, "policies": LIST, "trials": MAYBE_INTEGER, "seed": SEED},
    "export": {"episode": TEXT, "format": TEXT},
    "reproduce": {"name": MAYBE_TEXT, "quick": MAYBE_BOOL},
    "sweep": {"toml": TEXT, "store": MAYBE_TEXT, "sweep": MAYBE_TEXT},
    "table": {"store": TEXT, "sweep": MAYBE_TEXT, "measure": MAYBE_TEXT, "format": TEXT},
    "missions": {"problem": OBJECT, "missions": MAYBE_OBJECT, "seed": SEED},
}
"""The fields of the description of each kind of job."""


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
    try:
        found = json.loads(
            body.decode("utf-8"),
            parse_constant=_finite,
            parse_float=_finite,
            parse_int=_short,
            object_pairs_hook=_unique,
        )
    except InvalidInputError:
        raise
    except UnicodeDecodeError:
        raise InvalidInputError("request: expected JSON in UTF-8, got other bytes") from None
    except RecursionError:
        raise InvalidInputError(
            f"request: expected JSON nested at most {DEEPEST} deep, got deeper lists and objects"
        ) from None
    except ValueError:
        raise InvalidInputError(
            f"request: expected a JSON object, got {shortened(body[:60])}"
        ) from None
    if not isinstance(found, dict):
        raise InvalidInputError(f"request: expected a JSON object, got {shortened(found)}")
    check_depth(found, where="request")
    try:
        json.dumps(found, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise InvalidInputError(
            "request: expected texts of whole characters, got half of a surrogate pair"
        ) from None
    return found


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


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InvalidInputError(f"request: expected each key once, got {shortened(twice)} twice")
    return found


def check_request(data: Mapping[str, Any], fields: Mapping[str, Field]) -> None:
    """Check that a request has the fields of a question or job, each of the right type, and no
    other field.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> check_request({"file": 5}, QUESTIONS["page"])
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
