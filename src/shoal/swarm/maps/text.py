"""Maps as text files: rows of ``.`` and ``#``, comma-separated ones and zeros (CSV), and MovingAI's format ``.map``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import read_text
from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.reading import MapOptions, check_size
from shoal.swarm.maps.workspace import GridWorkspace


def read_rows(path: Path, _options: MapOptions) -> NDArray[np.bool_]:
    """Return the free cells of a text map. In a text map, ``.`` is a free cell, and ``#`` is an obstacle."""
    return _cells(path, _lines(path), 1, free=".", blocked="#")


def read_csv(path: Path, _options: MapOptions) -> NDArray[np.bool_]:
    """Return the free cells of a CSV map. In a CSV map, 1 is a free cell, and 0 is an obstacle."""
    rows = [[value.strip() for value in line.split(",")] for line in _lines(path)]
    return _cells(path, rows, 1, free="1", blocked="0", expected="0 or 1")


def read_movingai(path: Path, _options: MapOptions) -> NDArray[np.bool_]:
    """Return the free cells of a MovingAI map: the cells with the letters ``.``, ``G`` and ``S``."""
    lines = _lines(path)
    sizes: dict[str, int] = {}
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words == ["map"]:
            body = lines[number:]
            break
        if len(words) == 2 and words[0] in {"height", "width"} and re.fullmatch("[0-9]{1,9}", words[1]):
            sizes[words[0]] = int(words[1])
        elif not (len(words) == 2 and words[0] == "type"):
            raise InvalidInputError(
                f"{path}, line {number}: expected 'type NAME', 'height N', 'width N' or 'map', got {line[:40]!r}"
            )
    else:
        raise InvalidInputError(f"{path}: expected a line 'map' after the header, got none in {len(lines)} lines")
    if not body:
        raise InvalidInputError(f"{path}, line {number + 1}: expected a row of cells after 'map', got the end of the file")
    cells = _cells(path, body, number + 1, free=".GS", blocked="@OTW")
    for key, got in (("height", cells.shape[0]), ("width", cells.shape[1])):
        if sizes.get(key, got) != got:
            raise InvalidInputError(f"{path}: expected {key} {sizes[key]} according to the header, got {got}")
    return cells


def encode_rows(workspace: GridWorkspace) -> bytes:
    """Return a map as the bytes of a text file that `read_rows` can read."""
    return f"{workspace.text}\n".encode()


def encode_csv(workspace: GridWorkspace) -> bytes:
    """Return a map as the bytes of a CSV file that `read_csv` can read."""
    return "".join(",".join(np.where(row, "1", "0")) + "\n" for row in workspace.free).encode()


def encode_movingai(workspace: GridWorkspace) -> bytes:
    """Return a map as the bytes of a MovingAI file that `read_movingai` can read."""
    height, width = workspace.shape
    return f"type octile\nheight {height}\nwidth {width}\nmap\n{workspace.text.replace('#', '@')}\n".encode()


LARGEST_TEXT = 2**26  # bytes; reading takes up to 100 bytes of memory per cell


def _lines(path: Path) -> list[str]:
    text = read_text(path, what="map", most=LARGEST_TEXT)
    return text.replace("\r\n", "\n").replace("\r", "\n").rstrip("\n").split("\n")


def _cells(
    path: Path, rows: Sequence[Sequence[str]], first_line: int, *, free: str, blocked: str, expected: str = ""
) -> NDArray[np.bool_]:
    """Convert rows of words to cells. Error messages contain the line and the column of a wrong word."""
    width = len(rows[0])
    if not width:
        raise InvalidInputError(f"{path}, line {first_line}: expected a row of cells, got an empty line")
    check_size(path, len(rows), width)
    table = dict.fromkeys(free, True) | dict.fromkeys(blocked, False)
    for number, row in enumerate(rows, start=first_line):
        for column, word in enumerate(row, start=1):
            if word not in table:
                wanted = expected or f"one of {free + blocked!r}"
                raise InvalidInputError(f"{path}, line {number}, column {column}: expected {wanted}, got {word[:20]!r}")
        if len(row) != width:
            raise InvalidInputError(f"{path}, line {number}: expected {width} cells as in the first row, got {len(row)}")
    return np.array([[table[word] for word in row] for row in rows], dtype=np.bool_)
