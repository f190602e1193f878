"""Columns of stored results, against the parser of JSON."""

from __future__ import annotations

import json

import numpy as np
import pytest
from tests.without_compiler import printed

from shoal.core.errors import InvalidInputError
from shoal.lab.store import ResultTexts

VALUES = [
    *(0, 1, -3, 10, 999_999_999_999_999, -999_999_999_999_999, 1_000_000_000_000_000, 2**53),
    *(0.5, -1e-7, 1e300, True, None, "", "complete", "a,b", "a]", "[", "{", 'a"b', "\\", "é", "1"),
]


def random_rows(rng, values, width):
    return [[values[k] for k in rng.integers(0, len(values), width)] for _ in range(7)]


def compare(seed):
    """Compare rows of any values, of whole numbers only, and of texts and numbers."""
    rng = np.random.default_rng(seed)
    for values in (VALUES, VALUES[:6], VALUES[:13] + VALUES[16:17]):
        width = int(rng.integers(1, 5))
        rows = random_rows(rng, values, width)
        text = ",".join(json.dumps(row, separators=(",", ":")) for row in rows)
        numbers = [k for k in range(width) if rng.random() < 0.6]
        results = ResultTexts(text, numbers, len(rows), width, where="rows")
        for number in numbers:
            column = [row[number] for row in rows]
            assert [*results.column(number)] == column
            words = ["complete", "a]", "é"]
            assert results.is_any(number, words).tolist() == [value in words for value in column]


def compare_damaged(seed):
    """Compare with rows in which some bytes are others: both parsers take them, or none."""
    rng = np.random.default_rng(seed)
    rows = random_rows(rng, [3, 12, "complete"], 3)
    text = [*",".join(json.dumps(row, separators=(",", ":")) for row in rows)]
    for place in rng.integers(0, len(text), rng.integers(1, 3)):
        text[place] = rng.choice([*'[],"1-0'])
    damaged = "".join(text)
    try:
        parsed = json.loads(f"[{damaged}]")
        whole = len(parsed) == 7 and all(isinstance(row, list) and len(row) == 3 for row in parsed)
    except ValueError:
        whole = False
    if whole:
        assert columns_of(damaged) == [[*column] for column in zip(*parsed, strict=True)]
    else:
        with pytest.raises(InvalidInputError, match="rows"):
            columns_of(damaged)


def columns_of(text):
    results = ResultTexts(text, [0, 1, 2], 7, 3, where="rows")
    return [[*results.column(number)] for number in range(3)]


@pytest.mark.parametrize("seed", range(30))
def test_columns_of_rows(seed):
    compare(seed)
    for part in range(10):
        compare_damaged([seed, part])


def test_columns_of_rows_without_the_compiler():
    script = (
        "from tests.reference.test_rows import compare, compare_damaged\n"
        "for seed in range(10): compare(seed); compare_damaged(seed)\n"
        "print('equal')"
    )
    assert printed(script) == "equal\n"
