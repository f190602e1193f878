"""Writing of sweep files: a sweep as TOML, with one table for the problem and one table for the axes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError

_TABLES = ("problem", "axes")


def as_toml(sweep: Mapping[str, Any]) -> str:
    """Return the text of a sweep file. Omit empty tables, and fields with the value None.

    Parameters
    ----------
    sweep : mapping
        The fields of a sweep file, as returned by `shoal.lab.Sweep.describe`. Each axis is a list of values or a range.

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
    blocks = [_fields({name: value for name, value in sweep.items() if name not in _TABLES and value != []})]
    blocks += [f"[{name}]\n{_fields(sweep[name])}" for name in _TABLES if sweep.get(name)]
    return "\n".join(blocks)


def _fields(table: Mapping[str, Any]) -> str:
    return "".join(f"{_key(name)} = {_value(value, name)}\n" for name, value in table.items() if value is not None)


def _key(name: str) -> str:
    plain = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if plain else _text(name)


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any, name: str) -> str:
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(one, name)}" for key, one in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(one, name) for one in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    raise InvalidInputError(f"{name}: expected texts, numbers, truth values or lists of these, got {shortened(value)}")
