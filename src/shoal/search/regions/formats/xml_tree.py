"""A safe reader of XML texts, which refuses document types and entities, and stores the line number of each element."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from xml.parsers import expat

from shoal.core.dataclass import dataclass
from shoal.search.regions.limits import DEEPEST, MOST_ELEMENTS


class XmlError(Exception):
    """A mistake in an XML text, and the line number of the mistake."""

    def __init__(self, message: str, line: int, *, readable: bool = False) -> None:
        super().__init__(message)
        self.line, self.readable = line, readable


@dataclass
class Element:
    """An XML element: its name without the namespace, its line number, its attributes, the parts of its text, and its children."""

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
        """Return all elements with the name ``tag`` inside this element, in the order of the file."""
        return [element for element in self.walk() if element.tag == tag]

    def first(self, tag: str) -> Element | None:
        """Return the first element with the name ``tag`` inside this element, or None if no element has this name."""
        return next((element for element in self.walk() if element.tag == tag), None)


def parse_xml(text: str, *, root: str) -> Element:
    """Parse an XML text, and return its root element, which must have the name ``root``.

    Raises
    ------
    XmlError
        If the text is not XML, is too large or too deeply nested, or has another root element. If only the root element is wrong,
        the attribute ``readable`` of the error is true.
    """
    parser = expat.ParserCreate("utf-8")  # the text is already decoded, so the parser ignores the encoding that the text declares
    parser.buffer_text = True
    top = Element("", 0, {})
    open_elements = [top]
    count = 0

    def start(name: str, attributes: dict[str, str]) -> None:
        if len(open_elements) > DEEPEST:
            raise XmlError("expected XML, got tags nested too deeply", parser.CurrentLineNumber)
        nonlocal count
        count += 1
        if count > MOST_ELEMENTS:
            raise XmlError(f"expected at most {MOST_ELEMENTS} elements, got more", parser.CurrentLineNumber)
        element = Element(name.rpartition(":")[2], parser.CurrentLineNumber, attributes)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def add(data: str) -> None:
        open_elements[-1].parts.append(data)

    def refuse(*_: object) -> None:
        raise XmlError("expected XML without a document type, got <!DOCTYPE", parser.CurrentLineNumber)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _name: open_elements.pop()
    parser.CharacterDataHandler = add
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text.encode(errors="replace"), True)
    except expat.ExpatError as error:
        said = expat.errors.messages[error.code]
        raise XmlError(f"expected XML, got something else: {said}", error.lineno) from None
    found = top.children[0]
    if found.tag != root:
        raise XmlError(f"expected <{root}>, got <{found.tag[:40]}>", found.line, readable=True)
    return found
