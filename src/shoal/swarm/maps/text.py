"""Maps as text and as arrays of numbers."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import read_text
from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.swarm.maps.reading import (
    KINDS,
    PIECE,
    MapOptions,
    Mask,
    check_data,
    check_size,
    check_used,
    index_of,
    reading,
)
from shoal.swarm.maps.values import free_by_number, free_in_array
from shoal.swarm.maps.workspace import GridWorkspace

LARGEST_TEXT = 2**26
"""Maximum number of bytes of a map as text."""

MOST_LINES = 2**19
"""Maximum number of lines of a map as text."""

LONGEST_LINE = 2**24
"""Maximum number of characters in a line of numbers that are not single digits."""


def read_rows(path: Path, options: MapOptions) -> Mask:
    """Return the free cells of a text map: rows of ``.`` (free) and ``#`` (obstacle), or a table of
    numbers.

    The first line decides: a line of ``.`` and ``#`` only begins a map of letters. In a table,
    blanks, tabs, commas or semicolons separate the numbers, or every cell is one digit. Lines that
    begin with ``#`` are comments of a table.
    """
    lines = _lines(path)
    if any(line[:1].isdigit() or line[:1] in {"+", "-"} for line in map(str.lstrip, lines[:100])):
        return _table(path, lines, options)
    check_used(KINDS["letters"], options.given_values, where=str(path))
    free = _cells(path, lines, 1, free=".", blocked="#")
    return ~free if options.invert else free


def read_csv(path: Path, options: MapOptions) -> Mask:
    """Return the free cells of a table of numbers. Without a level or a label, 1 is a free cell,
    and 0 is an obstacle.
    """
    return _table(path, _lines(path), options)


def read_movingai(path: Path, options: MapOptions) -> Mask:
    """Return the free cells of a MovingAI map: the cells with the letters ``.``, ``G``
    and ``S``.
    """
    lines = _lines(path)
    sizes: dict[str, int] = {}
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words == ["map"]:
            body = lines[number:]
            break
        if (
            len(words) == 2
            and words[0] in {"height", "width"}
            and re.fullmatch("[0-9]{1,9}", words[1])
        ):
            sizes[words[0]] = int(words[1])
        elif not (len(words) == 2 and words[0] == "type"):
            raise InvalidInputError(
                f"{path}, line {number}: expected 'type NAME', 'height N', 'width N' or 'map', got"
                f" {line[:40]!r}"
            )
    else:
        raise InvalidInputError(
            f"{path}: expected a line 'map' after the header, got none in {len(lines)} lines"
        )
    if not body:
        raise InvalidInputError(
            f"{path}, line {number + 1}: expected a row of cells after 'map', got the end of the"
            " file"
        )
    cells = _cells(path, body, number + 1, free=".GS", blocked="@OTW")
    for key, size in (("height", cells.shape[0]), ("width", cells.shape[1])):
        if sizes.get(key, size) != size:
            raise InvalidInputError(
                f"{path}: expected {key} {sizes[key]} according to the header, got {size}"
            )
    return ~cells if options.invert else cells


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


def _lines(path: Path) -> list[str]:
    text = (
        read_text(path, what="map", most=LARGEST_TEXT)
        .replace("\r\n", "\n")
        .replace("\r", "\n")
        .rstrip("\n")
    )
    if text.count("\n") >= MOST_LINES:
        raise InvalidInputError(
            f"{path}: expected at most {MOST_LINES} lines, got {text.count(chr(10)) + 1}"
        )
    return text.split("\n")


def _cells(path: Path, rows: Sequence[str], first_line: int, *, free: str, blocked: str) -> Mask:
    """Convert rows of letters to cells. Error messages contain the line and the column of a wrong
    letter.
    """
    width = len(rows[0])
    if not width:
        raise InvalidInputError(
            f"{path}, line {first_line}: expected a row of cells, got an empty line"
        )
    check_size(path, len(rows), width)
    pattern = re.compile(f"[{re.escape(free + blocked)}]*")
    table = np.zeros(128, dtype=np.bool_)
    table[[ord(letter) for letter in free]] = True
    cells = np.zeros((len(rows), width), dtype=np.bool_)
    for number, row in enumerate(rows):
        match = pattern.match(row)
        end = match.end() if match else 0
        if end < len(row):
            raise InvalidInputError(
                f"{path}, line {first_line + number}, column {end + 1}: expected one of"
                f" {free + blocked!r}, got {row[end]!r}"
            )
        if len(row) != width:
            raise InvalidInputError(
                f"{path}, line {first_line + number}: expected {width} cells as in the first row,"
                f" got {len(row)}"
            )
        cells[number] = table[np.frombuffer(row.encode("ascii"), dtype=np.uint8)]
    return cells


def _table(path: Path, lines: list[str], options: MapOptions) -> Mask:
    """Return the free cells of a table of numbers."""

    def rows() -> Iterator[tuple[int, str]]:
        for number, line in enumerate(lines, start=1):
            row = line.strip()
            if row and row[0] != "#":
                yield number, row

    count = sum(1 for _ in rows())
    if not count:
        raise InvalidInputError(
            f"{path}, line 1: expected a row of cells, got"
            f" {'a comment' if lines[0] else 'an empty line'}"
        )
    # one digit a cell, without anything between the digits
    single = all(row.isascii() and row.isdigit() for _, row in rows())
    free_numbers: set[float] = set()  # the number of free cells, as soon as it is known
    first = _numbers(path, *next(rows()), single=single, options=options, free_numbers=free_numbers)
    check_size(path, count, len(first))
    table = np.zeros((count, len(first)), dtype=first.dtype)
    for index, (number, line) in enumerate(rows()):
        row = _numbers(
            path, number, line, single=single, options=options, free_numbers=free_numbers
        )
        if len(row) != len(first):
            raise InvalidInputError(
                f"{path}, line {number}: expected {len(first)} cells as in the first row, got"
                f" {len(row)}"
            )
        if row.dtype != table.dtype and table.dtype == np.uint8:
            table = table.astype(np.float64)
        table[index] = row
    return free_in_array(table, options, where=str(path))


def _numbers(
    path: Path,
    line_number: int,
    line: str,
    *,
    single: bool,
    options: MapOptions,
    free_numbers: set[float],
) -> NDArray[Any]:
    """Return the numbers of one line of a table. Without a level or a label, each number is 0, NaN,
    or one common other number.
    """
    numbers: NDArray[Any] | None
    digits = (
        np.frombuffer(line.encode(), dtype=np.uint8) - np.uint8(ord("0"))
        if single
        else _single_digits(line)
    )
    if digits is None:
        if len(line) > LONGEST_LINE:
            raise InvalidInputError(
                f"{path}, line {line_number}: expected at most {LONGEST_LINE} characters, got"
                f" {len(line)}"
            )
        mark = "," if "," in line else ";" if ";" in line else ""
        fields = line.split(mark) if mark else line.split()
        try:  # Python takes 1_0 for 10, which is a slip in a table
            numbers = None if "_" in line else np.array(fields, dtype=np.float64)
        except ValueError:
            numbers = None
    else:
        numbers = digits
    if numbers is not None and (options.by_number or _is_mask(numbers, free_numbers)):
        return numbers
    words = list(line) if single else fields if digits is None else re.split("[ \t,;]", line)
    for column, word in enumerate(words, start=1):
        if not _is_number(word) or not (
            options.by_number or _is_mask(np.array([float(word)]), free_numbers)
        ):
            hint = " (--level and --label take other numbers)" if _is_number(word) else ""
            expected = "a number" if options.by_number else f"0 or {next(iter(free_numbers), 1):g}"
            raise InvalidInputError(
                f"{path}, line {line_number}, column {column}: expected {expected}, got"
                f" {word.strip()[:20]!r}{hint}"
            )
    raise AssertionError  # one of the words is wrong


def _single_digits(line: str) -> NDArray[np.uint8] | None:
    """Return the numbers of a line of single digits with one separator between two digits, or None
    for any other line.
    """
    if len(line) % 2 == 0 or not line.isascii():
        return None
    letters = np.frombuffer(line.encode(), dtype=np.uint8)
    digits, between = letters[::2] - np.uint8(ord("0")), letters[1::2]
    if (digits > 9).any() or (
        between.size and not ((between == between[0]).all() and chr(between[0]) in " \t,;")
    ):
        return None
    return digits


def _is_mask(numbers: NDArray[Any], free_numbers: set[float]) -> bool:
    """Return whether all numbers other than 0 and NaN are the number in ``free_numbers``, to which
    the first such number is added.
    """
    free = numbers[(numbers != 0) & ~np.isnan(numbers)]
    if free.size and not free_numbers and (free == free[0]).all():
        free_numbers.add(float(free[0]))
    return not free.size or bool((free == next(iter(free_numbers), np.nan)).all())


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return "_" not in word


MATLAB_NUMBERS = {
    "logical": 1,
    "int8": 1,
    "uint8": 1,
    "int16": 2,
    "uint16": 2,
    "int32": 4,
    "uint32": 4,
    "int64": 8,
    "uint64": 8,
    "single": 4,
    "double": 8,
}
"""MATLAB's classes of numbers, with the bytes of a number."""

MOST_CHANNELS = 16
"""Maximum length of the last axis of an array of which a channel is chosen: a longer axis has the
columns of a map.
"""


def read_npy(path: Path, options: MapOptions) -> Mask:
    """Read a ``.npy`` file and return the free cells of the map.

    With a channel, the last axis of the array has the channels, as in an array of a colour picture.
    """
    with path.open("rb") as file, reading(path, "a NumPy array file (.npy)"):
        shape, fortran, dtype = _npy_header(file)
        axes = len(shape) - (options.channel is not None)
        if options.channel is not None and (
            axes not in (2, 3) or not 2 <= shape[-1] <= MOST_CHANNELS
        ):
            raise InvalidInputError(
                f"{path}: channel: expected a last axis of 2 to {MOST_CHANNELS} channels, got an"
                f" array of shape {shape}"
            )
        if axes not in (2, 3) or dtype.kind not in "biuf" or min(shape, default=0) < 0:
            raise InvalidInputError(
                f"{path}: expected a 2-D or 3-D array of booleans or numbers, got {dtype} {shape}"
            )
        check_size(path, *shape[:axes])
        begin, size = file.tell(), prod(shape) * dtype.itemsize
        check_data(path, size)
        if path.stat().st_size - begin < size:
            raise ValueError(f"the length of the data, {size} bytes, is greater than file size")
        channel = None
        if options.channel is not None:
            channel = index_of([""] * shape[-1], options.channel, where=str(path))

        def pieces() -> Iterator[NDArray[Any]]:
            file.seek(begin)
            step = max(1, PIECE // max(1, row)) * row
            for first in range(0, prod(shape), max(1, step)):
                numbers = file.read(min(step, prod(shape) - first) * dtype.itemsize)
                yield np.frombuffer(numbers, dtype=dtype).reshape(-1, *stored_shape[1:])

        stored_shape = shape[::-1] if fortran else shape
        row = prod(stored_shape[1:])
        if (
            channel is None
            and axes == 3
            and shape[-1] in (3, 4)
            and dtype == np.uint8
            and min(shape[:2]) > 2 * shape[-1]
        ):
            tell_once(
                f"shoal: {path}: the array is read as {shape[0]} layers of {shape[1]} rows and"
                f" {shape[2]} columns (--channel reads one channel of a colour picture)"
            )
        if channel is None:
            free = np.concatenate(
                [
                    np.zeros((0, *stored_shape[1:]), np.bool_),
                    *free_by_number(pieces, options, where=str(path)),
                ]
            )
            return np.ascontiguousarray(free.T) if fortran else free
        array = np.concatenate([*pieces()]).reshape(stored_shape)
        selection = np.ascontiguousarray((array.T if fortran else array)[..., channel])
        return free_in_array(selection, options, where=str(path))


def read_matlab(path: Path, options: MapOptions) -> Mask:
    """Read a MATLAB file and return the free cells of the only matrix in it. The third index of a
    matrix counts the layers.

    Numbers that belong to the matrix, such as the size of a cell, may stand beside it: only an
    array of more than one row and more than one column counts, unless there is no other.
    """
    from scipy.io import loadmat, whosmat

    with reading(path, "a MATLAB file (.mat)"):
        try:
            entries = whosmat(path)
            matrices = [
                entry
                for entry in entries
                if entry[2] in MATLAB_NUMBERS and len(entry[1]) in (2, 3) and prod(entry[1]) > 0
            ]
        except NotImplementedError:
            raise InvalidInputError(
                f"{path}: expected a MATLAB file up to version 7, got version 7.3 (save(..., '-v7')"
                " in MATLAB writes version 7)"
            ) from None
        large = [entry for entry in matrices if sum(side > 1 for side in entry[1]) > 1] or matrices
        if len(large) != 1:
            sizes = [
                (f"{name} {'x'.join(map(str, shape))}", kind)
                for name, shape, kind in large[:8] or entries[:8]
            ]
            names = (
                ", ".join(words if large else f"{words} ({kind})" for words, kind in sizes)
                or "none"
            )
            raise InvalidInputError(
                f"{path}: expected one matrix of numbers in 2 or 3 dimensions, got {names}"
            )
        name, shape, kind = large[0]
        check_size(path, *shape)
        check_data(path, prod(shape) * MATLAB_NUMBERS[kind])
        array = np.asarray(loadmat(path, variable_names=[name])[name])
        if array.dtype.kind not in "biuf":
            raise InvalidInputError(f"{path}: expected a matrix of real numbers, got {array.dtype}")
        array = array if array.ndim == 2 else array.transpose(2, 0, 1)
        return free_in_array(array, options, where=str(path))


def encode_npy(workspace: GridWorkspace) -> bytes:
    """Return a workspace as the bytes of a ``.npy`` file."""
    buffer = io.BytesIO()
    np.save(buffer, workspace.free)
    return buffer.getvalue()


def _npy_header(file: io.BufferedReader) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return the shape, the order (True for Fortran's) and the dtype of a ``.npy`` file, and stop
    at its data.
    """
    version = np.lib.format.read_magic(file)
    if version not in {(1, 0), (2, 0), (3, 0)}:
        raise ValueError(f"version {version}")
    # Version 3 allows names of fields with any letters; the header of an array of plain numbers
    # equals that of version 2.
    read = (
        np.lib.format.read_array_header_1_0
        if version == (1, 0)
        else np.lib.format.read_array_header_2_0
    )
    shape, fortran, dtype = read(file)
    if dtype.hasobject:
        raise ValueError("Python objects in dtype")
    return tuple(int(side) for side in shape), bool(fortran), dtype
