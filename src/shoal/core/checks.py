"""Checks of the arguments of functions. Each check returns the checked value, or raises an error
with a one-sentence message.
"""

from __future__ import annotations

import difflib
import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from math import inf, isfinite
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError

if TYPE_CHECKING:
    from pydantic import ValidationError


Kind = TypeVar("Kind")

LARGEST_TEXT = 200_000_000
"""Maximum size of a text file, in bytes. Shoal refuses a larger text file before reading it."""

FARTHEST = 1e100
"""Largest absolute value of a coordinate. Coordinates up to `FARTHEST` give areas that do not
overflow.
"""

LARGEST_WKT = 20_000_000
"""Maximum length of a region in well-known text (WKT), in characters."""

DEEPEST = 50
"""Maximum nesting depth of lists and objects in a JSON or TOML file."""

_LARGEST_VALUES = 600_000_000
_JSON_MEMORY = {"{": 240, "[": 88, ",": 16}
"""Memory in bytes that Python needs for each object, list and further value, besides numbers and
texts.
"""

_DEEPEST_ARRAY = 8  # lists around an array whose entries may be masked
_DEEPEST_KEY = 10  # parts of a TOML key, such as problem.vehicle.name
_MOST_KEYS = 100_000
_MOST_VALUES = 500_000  # the parser needs about five seconds for a million
# texts and comments, which may contain any number of dots
_TOML_TEXTS = re.compile(
    r'''"""(?s:.*?)"""|\'{3}(?s:.*?)\'{3}|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|#[^\n]*'''
)
_TOML_DEEP_KEY = re.compile(rf"(?<![\w-])[\w-]+(?:[ \t]*\.[ \t]*[\w-]+){{{_DEEPEST_KEY}}}")


def check_integer(value: Any, *, what: str, least: float = -inf, most: float = inf) -> int:
    """Check a whole number, and return it as an int. Accept NumPy integers and refuse booleans.

    Examples
    --------
    >>> check_integer(np.int64(3), what="particles", least=1)
    3
    >>> check_integer(0, what="particles", least=1)
    Traceback (most recent call last):
    ...
    shoal.core.errors.InvalidInputError: particles: expected a whole number, 1 or more, got 0
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or not least <= value <= most:
        raise InvalidInputError(
            f"{what}: expected a whole number{_ranged(least, most)}, got {shortened(value)}"
        )
    return int(value)


def check_number(
    value: Any,
    *,
    what: str,
    least: float = -inf,
    most: float = inf,
    above: float = -inf,
    below: float = inf,
    finite: bool = True,
) -> float:
    """Return a number as a float after checking its range.

    The checked number must be at least ``least``, at most ``most``, more than ``above``, and less
    than ``below``.

    Examples
    --------
    >>> check_number(1, what="loss", least=0, most=1)
    1.0
    """
    number = isinstance(value, Real | Decimal) and not isinstance(value, bool)
    try:
        good = (
            number and least <= value <= most and above < value and (value < below or below == inf)
        )
        good = good and (not finite or isfinite(value))
        value = float(value) if good else value
    except OverflowError:  # a whole number too large for a float
        good = False
    if not good:
        raise InvalidInputError(
            f"{what}: expected a number{_ranged(least, most, above, below)}, got {shortened(value)}"
        )
    return float(value)


def check_bool(value: Any, *, what: str) -> bool:
    """Check that a value is a boolean, and return the value."""
    if not isinstance(value, bool | np.bool_):
        raise InvalidInputError(f"{what}: expected true or false, got {shortened(value)}")
    return bool(value)


def check_text(value: Any, *, what: str) -> str:
    """Check that a value is a string, and return the value."""
    if not isinstance(value, str):
        raise InvalidInputError(f"{what}: expected a text, got {shortened(value)}")
    return value


def check_function(value: Any, *, what: str, optional: bool = True) -> None:
    """Check that a value is a function or, if it is ``optional``, None."""
    if not callable(value) and not (optional and value is None):
        raise InvalidInputError(f"{what}: expected a function, got {shortened(value)}")


def check_kind(value: Any, kind: type[Kind], *, what: str) -> Kind:
    """Check that a value is an object of a class, and return the value.

    Examples
    --------
    >>> check_kind("x", Path, what="folder")
    Traceback (most recent call last):
    ...
    shoal.core.errors.InvalidInputError: folder: expected a Path, got 'x'
    """
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise InvalidInputError(
            f"{what}: expected {article} {kind.__name__}, got {shortened(value)}"
        )
    return value


def check_list(values: Any, kind: type = object, *, what: str) -> list[Any]:
    """Check that a value is a list or a similar object, and that its entries are objects of a class.
    Return the entries as a list.
    """
    single = isinstance(values, np.ndarray) and values.ndim == 0
    if single or isinstance(values, str | bytes | Mapping) or not isinstance(values, Iterable):
        raise InvalidInputError(f"{what}: expected a list, got {shortened(values)}")
    return [check_kind(value, kind, what=what) for value in values]


def as_path(value: Any, *, what: str = "path") -> Path:
    """Return the path of a file or folder as a Path. Refuse anything else."""
    path = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(path, str):
        raise InvalidInputError(
            f"{what}: expected the path of a file or folder, got {shortened(value)}"
        )
    return Path(path)


def check_choice(value: Any, *, what: str, choices: Iterable[str]) -> str:
    """Check that a text is one of ``choices``, and return the text. The error message suggests the
    nearest valid choice.

    Examples
    --------
    >>> check_choice("blok", what="rule", choices=("block", "merge"))
    Traceback (most recent call last):
    ...
    shoal.core.errors.InvalidInputError: rule: expected one of block, merge, got 'blok' (did you mean 'block'?)
    """
    known = list(choices)
    if not isinstance(value, str) or value not in known:
        raise InvalidInputError(
            f"{what}: expected one of {', '.join(known)}, got"
            f" {shortened(value)}{suggestion(value, known)}"
        )
    return str(value)


def check_array(values: Any, *, expected: str) -> NDArray[Any]:
    """Return numbers as an array. Refuse rows of different lengths, texts, complex numbers and
    masked entries, of which NumPy would silently take the hidden value.

    Parameters
    ----------
    values : array_like
    expected : str
        Beginning of the error message, such as "starts: expected numbers of cells".

    Examples
    --------
    >>> check_array(np.ma.masked_greater([1, 2], 1), expected="rates: expected speeds")
    Traceback (most recent call last):
    ...
    shoal.core.errors.InvalidInputError: rates: expected speeds, got a masked one at (1,)
    """
    place = _masked_place(values)
    if place is not None:
        raise InvalidInputError(f"{expected}, got a masked one at {place}")
    try:
        array = np.asarray(values)
    except ValueError:
        raise InvalidInputError(f"{expected}, got rows of different lengths") from None
    try:
        # such as decimal numbers; NumPy would take None for nan
        if array.dtype.kind == "O" and not any(entry is None for entry in array.flat):
            array = array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    if array.dtype.kind not in "biuf":
        raise InvalidInputError(f"{expected}, got {shortened(values)}")
    return array


def _masked_place(values: Any, depth: int = 0) -> tuple[int, ...] | None:
    """Return the place of a masked entry of an array, or of arrays in lists, or None."""
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        return tuple(np.argwhere(np.ma.getmaskarray(values))[0].tolist())
    if isinstance(values, list | tuple) and depth < _DEEPEST_ARRAY:
        for index, entry in enumerate(values):
            if isinstance(entry, list | tuple | np.ma.MaskedArray):
                place = _masked_place(entry, depth + 1)
                if place is not None:
                    return (index, *place)
    return None


def check_points(
    points: Any, *, what: str, dimensions: int, count: int | None = None
) -> NDArray[np.float64]:
    """Return points as a float64 array of shape (count, dimensions). Refuse a coordinate whose
    absolute value exceeds `FARTHEST`.
    """
    number = {None: "points", 1: "one point"}.get(count, f"{count} points")
    expected = f"{what}: expected {number} of {dimensions} numbers"
    array = check_array(points, expected=expected).astype(np.float64, copy=False)
    if (
        array.ndim != 2
        or array.shape[1] != dimensions
        or (count is not None and len(array) != count)
    ):
        raise InvalidInputError(f"{expected}, got an array of shape {array.shape}")
    near = (np.abs(array) <= FARTHEST).all(axis=1)
    if not near.all():
        index = int(np.argmin(near))
        kind = (
            f"numbers up to {FARTHEST:g}" if np.isfinite(array[index]).all() else "finite numbers"
        )
        raise InvalidInputError(
            f"{what}: expected {kind}, got {tuple(array[index].tolist())} at point {index + 1}"
        )
    return array


def describe_missing_file(path: str | os.PathLike[str]) -> str:
    """Return what is at a path in place of a file: ``"no such file"``, ``"a folder"``, or ``"a pipe
    or a device"``, which may let a reader wait for ever; empty for a file.
    """
    if os.path.isfile(path):  # unlike Path.is_file, it accepts names of any length
        return ""
    if os.path.isdir(path):
        return "a folder"
    return "a pipe or a device" if os.path.exists(path) else "no such file"


def check_file(path: Path, *, what: str, most: int = LARGEST_TEXT) -> None:
    """Raise an error if there is no file at ``path``, or if the file is empty or larger than
    ``most`` bytes.
    """
    try:
        size = path.stat().st_size if path.is_file() else 0
    except (OSError, ValueError) as error:
        raise InvalidInputError(
            f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from None
    expected = f"{path}: expected {'an' if what[0] in 'aeiou' else 'a'} {what}"
    if missing := describe_missing_file(path):
        raise InvalidInputError(f"{expected}, got {missing}")
    if size == 0:
        raise InvalidInputError(f"{expected}, got an empty file")
    if size > most:
        raise InvalidInputError(f"{expected} of at most {most} bytes, got {size} bytes")


def read_text(path: Path, *, what: str, most: int = LARGEST_TEXT) -> str:
    """Read a UTF-8 file and return its text.

    Raises
    ------
    InvalidInputError
        Raised if the file is not UTF-8 text. The error message contains the line number of the
        first wrong byte.
    """
    check_file(path, what=what, most=most)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InvalidInputError(f"{path}: cannot be read: {error.strerror or error}") from None
    return decode_text(raw, where=str(path))


def decode_text(raw: bytes, *, where: str) -> str:
    """Decode UTF-8 bytes and return the text.

    Raises
    ------
    InvalidInputError
        Raised if the bytes are not UTF-8 text. The error message contains the line number of the
        first wrong byte.
    """
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise InvalidInputError(
            f"{where}: expected text in UTF-8, got byte 0x{raw[error.start]:02x} in line {line}"
        ) from None
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise InvalidInputError(f"{where}: expected text, got a zero byte in line {line}")
    return text


def parse_json(text: str, *, where: str, **hooks: Any) -> Any:
    """Parse a JSON text. Refuse lists and objects that are nested more than `DEEPEST` levels deep,
    and repeated names. ``hooks`` are the hooks of `json.loads` for numbers.

    Raises
    ------
    InvalidInputError
        Raised if the text is not JSON, or if parsing it could need more memory than
        `_LARGEST_VALUES` and twenty times the length of the text. The error message contains the
        line and the column of the error.
    """
    check_json_memory(text, where=where)
    try:
        value = json.loads(text, object_pairs_hook=lambda pairs: _once_each(pairs, where), **hooks)
    except json.JSONDecodeError as error:
        raise InvalidInputError(
            f"{where}: expected JSON, got something else in line {error.lineno}, column"
            f" {error.colno}: {error.msg.lower()}"
        ) from None
    except InvalidInputError:
        raise
    except (RecursionError, ValueError) as error:
        why = (
            "lists and objects that are nested too deeply"
            if isinstance(error, RecursionError)
            else "a number of too many digits"
        )
        raise InvalidInputError(f"{where}: expected JSON, got {why}") from None
    if text.count("[") + text.count("{") > DEEPEST:  # else, nothing can be nested that deep
        check_depth(value, where=where)
    return value


def check_json_memory(text: str, *, where: str) -> None:
    """Refuse a JSON text before parsing if its values could need more memory than `_LARGEST_VALUES`
    and twenty times its length.

    A text of braces otherwise needs up to a hundred times its own length.
    """
    memory = sum(text.count(sign) * size for sign, size in _JSON_MEMORY.items())
    if memory > max(_LARGEST_VALUES, 20 * len(text)):
        raise InvalidInputError(
            f"{where}: expected JSON of at most {_LARGEST_VALUES} bytes in memory, got about"
            f" {memory} bytes"
        )


def _once_each(pairs: list[tuple[str, Any]], where: str) -> dict[str, Any]:
    """Return the fields of a JSON object. Refuse a repeated name, of which Python would silently
    keep the last value.
    """
    entries = dict(pairs)
    if len(entries) < len(pairs):
        seen: set[str] = set()
        for name, value in pairs:
            if name in seen:
                raise InvalidInputError(
                    f"{where}: expected each name once, got {shortened(name)} again, with"
                    f" {shortened(value)}"
                )
            seen.add(name)
    return entries


def parse_toml(text: str, *, where: str) -> dict[str, Any]:
    """Parse a TOML text. Refuse keys of too many parts, too many keys, and values that are nested
    more than `DEEPEST` levels deep.

    Raises
    ------
    InvalidInputError
        Raised if the text is not TOML. The error message contains the line and the column of the
        error.
    """
    import tomllib  # only sweeps are written in TOML

    # Checked before parsing: the parser needs memory that grows with the square of the number of
    # parts of a key.
    bare = _TOML_TEXTS.sub(lambda text: "" if text[0].startswith("#") else "q", text)
    deep = _TOML_DEEP_KEY.search(bare)
    if deep:
        raise InvalidInputError(
            f"{where}: expected keys of at most {_DEEPEST_KEY} parts, got {shortened(deep[0])}"
        )
    keys = bare.count("=") + bare.count("[")
    if keys > _MOST_KEYS:
        raise InvalidInputError(
            f"{where}: expected at most {_MOST_KEYS} keys, tables and lists, got {keys}"
        )
    if bare.count(",") > _MOST_VALUES:
        raise InvalidInputError(
            f"{where}: expected at most {_MOST_VALUES} values in lists, got {bare.count(',')} or"
            " more"
        )
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InvalidInputError(
            f"{where}: expected TOML in UTF-8, with each key once, got something else: {error}"
        ) from None
    except (RecursionError, ValueError) as error:
        why = (
            "values that are nested too deeply"
            if isinstance(error, RecursionError)
            else "a number of too many digits"
        )
        raise InvalidInputError(f"{where}: expected TOML, got {why}") from None
    check_depth(data, where=where)
    return data


_GEOMETRY = re.compile(
    r"\s*(MULTI)?(POINT|LINESTRING|POLYGON|CURVE|SURFACE|GEOMETRYCOLLECTION)(\s*(Z|M|ZM))?\s*"
    r"(\(|EMPTY)",
    re.IGNORECASE,
)


def is_wkt(text: str) -> bool:
    """Return whether a text is the well-known text of a geometry, and no name of a file.

    Examples
    --------
    >>> is_wkt("POLYGON ((0 0, 2 0, 2 1, 0 0))"), is_wkt("polygon.csv")
    (True, False)
    """
    return _GEOMETRY.match(text) is not None


def read_polygon(text: str, *, where: str) -> Any:
    """Return a polygon or multipolygon from its well-known text, and refuse any other geometry."""
    return _read_wkt(text, "POLYGON", "POLYGON ((0 0, 2 0, 2 1, 0 0))", where)


def read_linestring(text: str, *, where: str) -> Any:
    """Return a line from its well-known text, and refuse any other geometry."""
    return _read_wkt(text, "LINESTRING", "LINESTRING (0 0, 2 0)", where)


def _read_wkt(text: str, kind: str, example: str, where: str) -> Any:
    import shapely

    if len(text) > LARGEST_WKT:
        raise InvalidInputError(
            f"{where}: expected at most {LARGEST_WKT} characters, got {len(text)}"
        )
    expected = f"expected well-known text such as {example}"
    if not re.match(rf"\s*(MULTI)?{kind}\b", text, re.IGNORECASE):
        raise InvalidInputError(f"{where}: {expected}, got {shortened(text.strip()[:40])}")
    try:
        # 1e400 is refused like any coordinate that is too large
        with np.errstate(all="ignore"):
            return shapely.from_wkt(text.strip())
    except (shapely.errors.ShapelyError, TypeError, UnicodeError):
        opening, closing = text.count("("), text.count(")")
        if opening != closing:
            raise InvalidInputError(
                f"{where}: expected as many closing as opening parentheses, got {closing} and"
                f" {opening}"
            ) from None
        for number, ring in enumerate(re.findall(r"\(([^()]*)\)", text), start=1):
            vertices = [vertex.split() for vertex in ring.split(",")]
            check_vertices(vertices, where, number if kind == "POLYGON" else None)
            _check_dimensions(vertices, where, number if kind == "POLYGON" else None, text)
        raise InvalidInputError(f"{where}: {expected}, got {shortened(text)}") from None


def _check_dimensions(vertices: list[list[str]], where: str, ring: int | None, text: str) -> None:
    """Refuse vertices of a well-known text that have more numbers than others, or than its type."""
    names = re.match(r"\s*\w+?\s*(ZM|Z|M)?\s*\(", text, re.IGNORECASE)
    stated = names[1] if names else None
    count = 2 + len(stated) if stated else len(vertices[0])
    why = f"as {stated.upper()} says" if stated else "as the first vertex has"
    for number, vertex in enumerate(vertices, start=1):
        if len(vertex) > 4 or len(vertex) != count:
            place = where + ("" if ring is None else f", ring {ring}")
            expected = "from 2 to 4 numbers" if len(vertex) > 4 else f"{count} numbers, {why}"
            raise InvalidInputError(
                f"{place}, vertex {number}: expected {expected}, got {shortened(' '.join(vertex))}"
            )


def fault_place(shape: Any) -> str:
    """Return where an invalid Shapely polygon has its fault, as the text " at (x, y)", or an empty
    text if Shapely names no point.

    Examples
    --------
    >>> import shapely
    >>> fault_place(shapely.Polygon([(0, 0), (3, 4), (3, 0), (0, 4)]))
    ' at (1.5, 2)'
    """
    from shapely.validation import explain_validity

    match = re.search(r"\[(\S+) ([^\s\]]+)", explain_validity(shape))
    return f" at ({float(match[1]):.10g}, {float(match[2]):.10g})" if match else ""


def check_vertices(vertices: Any, where: str, ring: int | None = None) -> None:
    """Refuse vertices that are no pairs of numbers, or a ring with a number (counted from 1) that
    does not end where it begins, or a line of fewer than two vertices.
    """
    where += "" if ring is None else f", ring {ring}"
    if not isinstance(vertices, list):
        raise InvalidInputError(f"{where}: expected a list of vertices, got {shortened(vertices)}")
    places = []
    for number, vertex in enumerate(vertices, start=1):
        try:
            x, y = [float(value) for value in vertex[:4]][:2]
        except (KeyError, TypeError, ValueError, OverflowError):
            words = isinstance(vertex, list) and all(isinstance(value, str) for value in vertex)
            actual = " ".join(vertex) if words else vertex
            raise InvalidInputError(
                f"{where}, vertex {number}: expected two numbers, x and y, got {shortened(actual)}"
            ) from None
        places.append((x, y))
    if ring is None and len(places) < 2:
        raise InvalidInputError(
            f"{where}: expected a line of two points or more, got {len(places)}"
        )
    if ring is not None and places and places[0] != places[-1]:
        begin, end = (f"({x:.10g}, {y:.10g})" for x, y in (places[0], places[-1]))
        raise InvalidInputError(
            f"{where}, vertex {len(places)}: expected a closed ring, which ends where it begins, at"
            f" {begin}, got {end}"
        )


_NESTING = (list, dict)  # made once: a union in the loop takes most of its time


def check_depth(data: Any, *, where: str) -> None:
    """Refuse lists and objects that are nested more than `DEEPEST` levels deep, because many
    libraries fail on such data.
    """
    level = [data]
    for _ in range(DEEPEST + 1):
        level = [
            one
            for outer in level
            if isinstance(outer, _NESTING)
            for one in (outer.values() if isinstance(outer, dict) else outer)
            if isinstance(one, _NESTING)
        ]
        if not level:
            return
    raise InvalidInputError(
        f"{where}: expected lists and objects that are nested at most {DEEPEST} deep, got deeper"
        " ones"
    )


def validation_message(error: ValidationError, *, where: str, without: Iterable[str] = ()) -> str:
    """Return Pydantic's first error as one sentence with the path of the wrong field. The path
    omits the names in ``without``.
    """
    every = error.errors()
    # a misspelt field is also reported as missing
    first = next((one for one in every if one["type"] == "extra_forbidden"), every[0])
    left_out = set(without)
    place = "".join(
        f"[{part}]" if isinstance(part, int) else f".{part}"
        for part in first["loc"]
        if part not in left_out
    )
    what = _EXPECTED.get(first["type"], first["msg"].replace("Input should be ", "expected "))
    got = (
        "none" if first["type"] in ("missing", "union_tag_not_found") else shortened(first["input"])
    )
    return (
        f"{where}{': ' if place else ''}{place.lstrip('.')}: {what[0].lower()}{what[1:]}, got {got}"
    )


_EXPECTED = {
    "extra_forbidden": "expected no such field",
    "missing": "expected this field",
    "int_type": "expected a whole number",
    "int_parsing": "expected a whole number",
    "int_from_float": "expected a whole number",
    "string_type": "expected a text",
    "float_type": "expected a number",
    "float_parsing": "expected a number",
    "bool_type": "expected true or false",
    "bool_parsing": "expected true or false",
    "dict_type": "expected fields with values",
    "list_type": "expected a list",
    "tuple_type": "expected a list",
}


def suggestion(word: Any, known: Iterable[str]) -> str:
    """Return " (did you mean 'X'?)" with the known word nearest to ``word``, or an empty text if no
    known word is similar.
    """
    near = difflib.get_close_matches(str(word), list(known), n=1, cutoff=0.6)
    return f" (did you mean {near[0]!r}?)" if near else ""


def shortened(value: Any) -> str:
    """Return a value as a text for error messages: one line of at most 80 characters."""
    try:
        return " ".join(repr(value).split())[:80]
    except ValueError:  # a whole number with more digits than Python can print
        return "a number of too many digits"


def range_text(least: float, most: float, above: float = -inf, below: float = inf) -> str:
    """Return a number's range in words, such as "from 0 to 1" or "1 or more". Return an empty text
    for a range without limits.

    Examples
    --------
    >>> range_text(0, 1), range_text(1, inf), range_text(-inf, inf, above=0, below=1)
    ('from 0 to 1', '1 or more', 'above 0 and below 1')
    """
    if least > -inf and most < inf:
        return f"from {_plain(least)} to {_plain(most)}"
    parts = (
        [f"{_plain(least)} or more"]
        if least > -inf
        else [f"above {_plain(above)}"]
        if above > -inf
        else []
    )
    parts += (
        [f"at most {_plain(most)}"]
        if most < inf
        else [f"below {_plain(below)}"]
        if below < inf
        else []
    )
    return " and ".join(parts)


def _ranged(least: float, most: float, above: float = -inf, below: float = inf) -> str:
    """Return a number's range as the end of an error message, such as " from 0 to 1" or ", 1 or
    more".
    """
    text = range_text(least, most, above, below)
    return f" {text}" if text.startswith("from") else f", {text}" if text else ""


def _plain(number: float) -> str:
    """Return a number as a text. Keep all digits of whole numbers."""
    return shortened(number) if isinstance(number, int) else f"{number:g}"


MOST_TRIALS = 1_000_000_000
"""Maximum number of trials of a run and of a sweep."""


def count_text(count: int, word: str) -> str:
    """Return a number and the word for the counted things as a text; the word gets an "s" unless
    the number is 1.

    Examples
    --------
    >>> count_text(1, "robot"), count_text(1200, "cell")
    ('1 robot', '1,200 cells')
    """
    return f"{count:,} {word}{'s' * (count != 1)}"


def shape_text(shape: Sequence[int]) -> str:
    """Return the shape of a map in cells as a text that names each side; a map in three dimensions
    also has layers.

    Examples
    --------
    >>> shape_text((36, 60)), shape_text((5, 1, 1200))
    ('36 rows × 60 columns', '5 layers × 1 row × 1,200 columns')
    """
    words = ("layer", "row", "column")[3 - len(shape) :]
    return " × ".join(
        count_text(int(count), word) for count, word in zip(shape, words, strict=True)
    )
