"""What SQLite has joined, as the columns of a table."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any


def columns_of(axes: list[tuple[list[Any], int]], parts: tuple[list[str], ...], width: int) -> list[Sequence[Any]]:
    """Return the columns of a chunk; axes come as (values, how many rows)."""
    first: list[list[Any]] = [[] for _ in axes[0][0]]
    for values, count in axes:
        for column, value in zip(first, values, strict=True):
            column.extend([value] * count)
    trials, seeds, results = (json.loads(f"[{','.join(part)}]") for part in parts)
    return [*first, trials, seeds, *(zip(*results, strict=True) if width else ())]
