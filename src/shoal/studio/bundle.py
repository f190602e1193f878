"""The studio's page in few requests: its modules as one script, its style sheets as one.

The modules are written for the browser as they are. Fetched one by one, they cost a request each,
and each import is known only when the module before it has come.
"""

from __future__ import annotations

import re
from collections.abc import Callable

_IMPORT = re.compile(r'^import\s*\{([^}]*)\}\s*from\s*"(\.[^"]+)";\n', re.M)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const) (\w+))", re.M)
_EXPORTED_LIST = re.compile(r"^export \{([^}]*)\};\n", re.M)
_LEFT = re.compile(r"^(?:import|export)\b.*", re.M)
_SHEET = re.compile(r'<link rel="stylesheet" href="([^"]+)">\n?')
_SCRIPT = re.compile(r'<script((?: type="module")?) src="([^"]+)"></script>\n?')

Read = Callable[[str], str]
"""Function that returns the text of a file, given its name."""


def script_of(entry: str, read: Read) -> str:
    r"""Return a module and all that it imports as one script: each other module is a function that
    is called once and returns what the module exports.

    Parameters
    ----------
    entry : str
        Name of the module, relative to the folder of all modules.
    read : callable
        Returns the text of a module.

    Raises
    ------
    ValueError
        Raised for a circle of imports, and for an import or export of another form than
        ``import { a, b as c } from "./file.js"`` and exports by name.

    Examples
    --------
    >>> files = {
    ...     "a.js": 'import { one } from "./b.js";\none();\n',
    ...     "b.js": "export function one() {}\n",
    ... }
    >>> print(script_of("a.js", files.__getitem__))
    const $0 = (() => {
    function one() {}
    return { one };
    })();
    const { one } = $0;
    one();
    <BLANKLINE>
    """
    names: dict[str, str] = {}
    parts: list[str] = []
    exported: dict[str, list[str]] = {}
    _add(entry, read, names, parts, exported, entry=True)
    return "".join(parts)


def _add(
    name: str,
    read: Read,
    names: dict[str, str],
    parts: list[str],
    exported: dict[str, list[str]],
    *,
    entry: bool,
) -> None:
    names[name] = ""  # until all that it imports is there
    text = read(name)
    for _, path in _IMPORT.findall(text):
        other = _joined(name, path)
        if other not in names:
            _add(other, read, names, parts, exported, entry=False)
        elif not names[other]:
            raise ValueError(f"{name} and {other} import each other")

    def imported(found: re.Match[str]) -> str:
        other = _joined(name, found[2])
        for one in found[1].split(","):
            if one.strip() and one.split()[0] not in exported[other]:
                raise ValueError(f"{name}: {other} does not export {one.split()[0]}")
        wanted = re.sub(r"\s+as\s+", ": ", " ".join(found[1].split()).rstrip(", "))
        return f"const {{ {wanted} }} = {names[_joined(name, found[2])]};\n"

    exports = _EXPORT.findall(text)
    for listed in _EXPORTED_LIST.findall(text):
        exports += [one.strip() for one in listed.split(",")]
    exported[name] = exports
    text = _IMPORT.sub(imported, _EXPORTED_LIST.sub("", _EXPORT.sub("", text)))
    if left := _LEFT.search(text):
        raise ValueError(f"{name}: expected imports and exports by name, got {left[0]}")
    names[name] = f"${len(parts)}"
    parts.append(
        text
        if entry
        else f"const {names[name]} = (() => {{\n{text}return {{ {', '.join(exports)} }};\n}})();\n"
    )


def _joined(name: str, path: str) -> str:
    """Return the name of the module that a module imports by a relative path."""
    folders = name.split("/")[:-1]
    for part in path.split("/"):
        if part == "..":
            folders.pop()
        elif part != ".":
            folders.append(part)
    return "/".join(folders)


def sources_of(page: str) -> tuple[list[str], list[str]]:
    """Return the addresses of the style sheets and of the scripts of a page, in their order."""
    return _SHEET.findall(page), [address for _, address in _SCRIPT.findall(page)]


def bundled(page: str, *, sheet: str, script: str) -> str:
    r"""Return a page that asks for one style sheet and one script instead of all that it names.

    Examples
    --------
    >>> page = '<link rel="stylesheet" href="a.css">\n<link rel="stylesheet" href="b.css">\n'
    >>> bundled(page, sheet="c.css", script="c.js")
    '<link rel="stylesheet" href="c.css">\n'
    """
    sheets = iter([f'<link rel="stylesheet" href="{sheet}">\n'])
    page = _SHEET.sub(lambda _: next(sheets, ""), page)
    scripts = iter([script])

    def first(found: re.Match[str]) -> str:
        address = next(scripts, None)
        return "" if address is None else f'<script{found[1]} src="{address}"></script>\n'

    return _SCRIPT.sub(first, page)
