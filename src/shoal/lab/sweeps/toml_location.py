"""Location of a field in a TOML file, for the line numbers in error messages."""

from __future__ import annotations

import re

_HEADER = re.compile(r"\[\s*([\w.-]+)\s*\]")
_FIELD = re.compile(r"""(["']?)([\w.-]+)\1\s*=""")


def line_of(text: str, message: str) -> int | None:
    r"""Return the line of the field named by an error message such as "problem: mpa: expected ...", or None for a missing field.

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
