"""KML: polygons of placemarks, by the standard library's parser, without document types (and so without entities)."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from shoal.errors import InvalidInputError
from shoal.search.regions.formats.text import is_true, read_text
from shoal.search.regions.outline_checks import Outline, Outlines, Ring


def read_kml(path: Path) -> Outlines:
    """Return the polygons in a KML file.

    Raises
    ------
    InvalidInputError
        With the line.
    """
    reader = _Reader(path)
    reader.parse(read_text(path))
    if not reader.found:
        got = "only " + " and ".join(sorted(reader.passed)) if reader.passed else "none"
        raise InvalidInputError(f"{path}: expected a Polygon, got {got}")
    return Outlines(tuple(reader.found), str(path), geographic=True)


@dataclass
class _Polygon:
    line: int
    shell: Ring | None = None
    holes: list[Ring] = field(default_factory=list)


class _Reader:
    """What the parser calls for every tag; collects outlines."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.found: list[Outline] = []
        self.passed: set[str] = set()
        self._tags: list[str] = []
        self._text: list[str] = []
        self._text_line = 0
        self._polygon: _Polygon | None = None
        self._waiting: list[_Polygon] = []  # of this placemark, until its attributes are known
        self._no_go = False
        self._attribute = ""
        self._parser = expat.ParserCreate()
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text.append
        self._parser.StartDoctypeDeclHandler = self._refuse

    def parse(self, text: str) -> None:
        try:
            self._parser.Parse(text.encode(), True)
        except expat.ExpatError as error:
            said = expat.errors.messages[error.code]
            raise InvalidInputError(f"{self.path}: expected XML, got something else in line {error.lineno}: {said}") from None

    def _refuse(self, *_: object) -> None:
        raise InvalidInputError(
            f"{self.path}: expected KML without a document type, got <!DOCTYPE in line {self._parser.CurrentLineNumber}"
        )

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        tag = name.rpartition(":")[2]
        line = self._parser.CurrentLineNumber
        if not self._tags and tag != "kml":
            raise InvalidInputError(f"{self.path}: expected <kml>, got <{name[:60]}> in line {line}")
        if len(self._tags) > 200:
            raise InvalidInputError(f"{self.path}: expected KML, got tags nested too deeply in line {line}")
        if tag == "Placemark":
            self._no_go, self._waiting = False, []
        elif tag == "Polygon":
            self._polygon = _Polygon(line)
        elif tag in ("Data", "SimpleData"):
            self._attribute = attributes.get("name", "")
        elif tag in ("Point", "LineString", "Track") or (tag == "LinearRing" and self._polygon is None):
            self.passed.add(tag)
        self._tags.append(tag)
        self._text.clear()
        self._text_line = line

    def _end(self, name: str) -> None:
        tag = self._tags.pop()
        text = "".join(self._text)
        if tag == "coordinates" and self._polygon is not None:
            self._ring(text)
        elif tag == "Polygon" and self._polygon is not None:
            if self._polygon.shell is None:
                raise InvalidInputError(f"{self.path}: line {self._polygon.line}: expected a Polygon with coordinates, got none")
            self._waiting.append(self._polygon)
            self._polygon = None
            if "Placemark" not in self._tags:
                self._flush()
        elif tag == "name" and self._tags[-1:] == ["Placemark"]:
            self._no_go |= re.match(r"no[-_ ]?go\b", text.strip(), flags=re.IGNORECASE) is not None
        elif tag in ("value", "SimpleData") and self._attribute == "no_go":
            self._no_go |= is_true(text)
        elif tag == "Placemark":
            self._flush()
        self._text.clear()

    def _flush(self) -> None:
        for polygon in self._waiting:
            assert polygon.shell is not None
            self.found.append(Outline(polygon.shell, tuple(polygon.holes), self._no_go))
        self._waiting = []

    def _ring(self, text: str) -> None:
        assert self._polygon is not None
        inner = "innerBoundaryIs" in self._tags
        polygon = self._polygon
        name = f"hole {len(polygon.holes) + 1}" if inner else "outline"
        where = f"{self.path}: polygon {len(self.found) + len(self._waiting) + 1} (line {polygon.line}), {name}"
        vertices: list[tuple[float, float]] = []
        lines: list[int] = []
        for offset, row in enumerate(text.split("\n")):
            for word in row.split():
                vertices.append(_vertex(word, f"{self.path}: line {self._text_line + offset}"))
                lines.append(self._text_line + offset)
        if not vertices:
            raise InvalidInputError(f"{where}: expected coordinates, got none")
        ring = Ring(np.array(vertices), where, np.array(lines))
        if inner:
            polygon.holes.append(ring)
        elif polygon.shell is None:
            polygon.shell = ring
        else:
            raise InvalidInputError(f"{where}: expected one outer boundary, got a second one")


def _vertex(word: str, where: str) -> tuple[float, float]:
    """Read "longitude,latitude" or "longitude,latitude,altitude"."""
    parts = word.split(",")
    try:
        if len(parts) not in (2, 3):
            raise ValueError
        numbers = [float(part) for part in parts]
    except ValueError:
        hint = " (no blanks beside commas)" if word.startswith(",") or word.endswith(",") else ""
        raise InvalidInputError(f"{where}: expected longitude,latitude[,altitude]{hint}, got {word[:60]!r}") from None
    return numbers[0], numbers[1]
