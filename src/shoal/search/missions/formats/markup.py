"""XML read safely: without document types, and so without entities."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.parsers import expat

from shoal.search.missions.diagnostics import Sheet

_DEEPEST = 100


@dataclass
class Element:
    """One element: its name without namespace, its line, its attributes, its text and its children."""

    tag: str
    line: int
    attributes: dict[str, str]
    text: str = ""
    children: list[Element] = field(default_factory=list)

    def all(self, tag: str) -> list[Element]:
        """Return the elements of a name below this one, in the order of the file."""
        found: list[Element] = []
        waiting = list(reversed(self.children))
        while waiting:
            element = waiting.pop()
            if element.tag == tag:
                found.append(element)
            waiting += reversed(element.children)
        return found

    def first(self, tag: str) -> Element | None:
        """Return the first element of a name below this one."""
        found = self.all(tag)
        return found[0] if found else None


def parse(text: str, root: str, sheet: Sheet) -> Element | None:
    """Return the root of an XML text; note what is wrong and return None if it is not what was expected."""
    parser = expat.ParserCreate()
    parser.buffer_text = True
    top = Element("", 0, {})
    open_elements = [top]

    def start(name: str, attributes: dict[str, str]) -> None:
        if len(open_elements) > _DEEPEST:
            raise _RefusedError("expected XML, got tags nested too deeply")
        element = Element(name.rpartition(":")[2], parser.CurrentLineNumber, attributes)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def add(data: str) -> None:
        open_elements[-1].text += data

    def refuse(*_: object) -> None:
        raise _RefusedError("expected XML without a document type, got <!DOCTYPE")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _name: open_elements.pop()
    parser.CharacterDataHandler = add
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        sheet.add("unreadable", f"line {error.lineno}", f"expected XML, got something else: {expat.errors.messages[error.code]}")
        return None
    except _RefusedError as error:
        sheet.add("unreadable", f"line {parser.CurrentLineNumber}", str(error))
        return None
    found = top.children[0]
    if found.tag != root:
        sheet.add("wrong-value", f"line {found.line}", f"expected <{root}>, got <{found.tag[:40]}>")
        return None
    return found


class _RefusedError(Exception):
    pass
