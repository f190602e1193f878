"""The parser of XML texts, of which strangers may be the authors: it has limits, and expands nothing."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from dataclasses import field
from xml.parsers import expat

from shoal.core.checks import decode_text
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError

MOST_ELEMENTS = 300_000
"""Most elements and attributes of an XML text."""

DEEPEST = 100
"""Most elements inside each other in an XML text."""

_BOMS = (  # the longer ones first: the mark of UTF-16 is the beginning of that of UTF-32
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
    (b"<\0?\0", "utf-16-le"),
    (b"\0<\0?", "utf-16-be"),
)


_DECLARED = re.compile(
    rb"""<\?xml[^>]{0,200}?encoding\s*=\s*["']([A-Za-z][A-Za-z0-9._-]{0,40})["']"""
)


class XmlError(Exception):
    """A mistake in an XML text, and the line number of the mistake."""

    def __init__(self, message: str, line: int, *, readable: bool = False) -> None:
        super().__init__(message)
        self.line, self.readable = line, readable


@dataclass
class Element:
    """An XML element: its name without the namespace, its line number, its attributes, the parts of
    its text, and its children.
    """

    tag: str
    line: int
    attributes: dict[str, str]
    parts: list[str] = field(default_factory=list)
    children: list[Element] = field(default_factory=list)

    @property
    def text(self) -> str:
        """The text inside the element, without the text of its children."""
        return "".join(self.parts)

    def walk(self) -> Iterator[Element]:
        """Yield all elements inside this element, in the order of the file."""
        waiting = list(reversed(self.children))
        while waiting:
            element = waiting.pop()
            yield element
            waiting += reversed(element.children)

    def all(self, tag: str) -> list[Element]:
        """Return all elements with the name ``tag`` inside this element, in the order
        of the file.
        """
        return [element for element in self.walk() if element.tag == tag]

    def first(self, tag: str) -> Element | None:
        """Return the first element with the name ``tag`` inside this element, or None if no element
        has this name.
        """
        return next((element for element in self.walk() if element.tag == tag), None)


def decode_xml(raw: bytes, *, where: str) -> str:
    """Decode an XML file by its byte order mark or by the encoding that it declares, such as UTF-16
    or ISO-8859-1.

    Without both, the encoding is UTF-8 (XML 1.0, appendix F). A file of ASCII characters is read
    whatever it declares.

    Raises
    ------
    InvalidInputError
        If the encoding is unknown, or if the bytes are not text in this encoding.
    """
    encoding = next((name for mark, name in _BOMS if raw.startswith(mark)), None)
    if encoding is None:
        declared = _DECLARED.match(raw.lstrip()[:400])
        encoding = declared[1].decode() if declared else "utf-8"
        try:
            codec = codecs.lookup(encoding).name
            "".encode(codec)  # refuses codecs between bytes and bytes, such as zlib
        except (LookupError, ValueError):
            if not raw.isascii():
                raise InvalidInputError(
                    f"{where}: expected a known encoding of XML, got {encoding[:40]!r}"
                ) from None
            codec = "ascii"
        # A declaration that can be read in single bytes is wrong if it says UTF-16; programs that
        # write it write UTF-8.
        if codec in ("utf-8", "ascii") or codec.startswith(("utf-16", "utf-32")):
            return decode_text(raw, where=where)
    try:
        text = raw.decode(encoding)
    except UnicodeError as error:
        reason = getattr(error, "reason", error)
        raise InvalidInputError(
            f"{where}: expected text in {encoding}, as the file declares, got something else:"
            f" {reason}"
        ) from None
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise InvalidInputError(f"{where}: expected text, got a zero byte in line {line}")
    return text


def parse_xml(text: str, *, root: str) -> Element:
    """Parse an XML text, and return its root element, which must have the name ``root``.

    Raises
    ------
    XmlError
        If the text is not XML, is too large or too deeply nested, or has another root element. If
        only the root element is wrong, the attribute ``readable`` of the error is true.
    """
    # Checked before parsing: the parser collects all attributes of an element before it reports the
    # element.
    if text.count('="') + text.count("='") > 2 * MOST_ELEMENTS:
        raise XmlError(f"expected at most {MOST_ELEMENTS} elements and attributes, got more", 1)
    # the text is already decoded, so the parser ignores the encoding that the text declares
    parser = expat.ParserCreate("utf-8")
    parser.buffer_text = True
    top = Element("", 0, {})
    open_elements = [top]
    count = 0

    def start(name: str, attributes: dict[str, str]) -> None:
        if len(open_elements) > DEEPEST:
            raise XmlError("expected XML, got tags nested too deeply", parser.CurrentLineNumber)
        nonlocal count
        count += 1 + len(attributes)
        if count > MOST_ELEMENTS:
            raise XmlError(
                f"expected at most {MOST_ELEMENTS} elements and attributes, got more",
                parser.CurrentLineNumber,
            )
        element = Element(name.rpartition(":")[2], parser.CurrentLineNumber, attributes)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def add(data: str) -> None:
        open_elements[-1].parts.append(data)

    def refuse(*_: object) -> None:
        raise XmlError(
            "expected XML without a document type, got <!DOCTYPE", parser.CurrentLineNumber
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _name: open_elements.pop()
    parser.CharacterDataHandler = add
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text.encode(errors="replace"), True)
    except expat.ExpatError as error:
        message = expat.errors.messages[error.code]
        raise XmlError(f"expected XML, got something else: {message}", error.lineno) from None
    root_element = top.children[0]
    if root_element.tag != root:
        raise XmlError(
            f"expected <{root}>, got <{root_element.tag[:40]}>", root_element.line, readable=True
        )
    return root_element
