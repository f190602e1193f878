"""Records: sets of named numbers that kernels change in place. Compiled and plain Python code use the names as attributes."""

from __future__ import annotations

from typing import Any

import numpy as np


def record_type(number: type[np.generic], *names: str) -> np.dtype[Any]:
    """Return the type of a record whose fields are all numbers of one type."""
    return np.dtype([(name, number) for name in names])


def new_record(kind: np.dtype[Any], **values: float) -> Any:
    """Return a record with the given values. Fields without a given value are 0.

    Examples
    --------
    >>> memory = new_record(record_type(np.int64, "at", "length"), length=3)
    >>> memory.at += 1
    >>> int(memory.at), int(memory.length)
    (1, 3)
    """
    record = np.rec.array(np.zeros(1, dtype=kind))[0]
    for name, value in values.items():
        record[name] = value
    return record
