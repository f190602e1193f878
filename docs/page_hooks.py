"""Hooks of MkDocs: the search works from the disk, and lines of pages break at good places, also on
a phone.
"""

from __future__ import annotations

import posixpath
import re
from typing import Any

_HELPER = re.compile(r'<script src="[^"]*iframe-worker/shim"></script>')
_CELL = re.compile(r"<t[dh][ >].*?</t[dh]>", re.S)
_PICTURE = re.compile(r'(<img [^>]*src="([^"]+)"[^>]*>)')
_CODE = re.compile(r"<code[ >].*?</code>", re.S)
_PROSE = re.compile(r"<(pre|code)[ >].*?</\1>|<[^>]*>|[^<]+", re.S)
_TEXT = re.compile(r"(?<=>)[^<>]+(?=<)")
_OPTION = re.compile(r"(?<![\w-])--?[a-z][\w-]*")
_BREAK = re.compile(
    r"(?<=[^\W\d])[_:=](?=\w)|(?<=\w)@(?=\w)|(?<=\w\w)/(?=\w\w)|(?<=[^\W\d])[.,](?=[^\W\d])|(?<=\w)(?=\[)"
)
_UNIT = r"%|µs|ms|s|min|h|mm|cm|m|km|MB|GB"
_TOGETHER = re.compile(rf"\s(?=±\s)|(?<=±)\s|(?<=\d)\s(?=(?:{_UNIT})(?!\w))")
_INDEX = re.compile(r"(?<!\w)([^\W\d_]'?)_(?:\{([^{}]+)\}|(\w)(?![^\W²]))")
_POWER = re.compile(r"(?<=[\w)])\^(?:\(([^()]+)\)|(\d+\.\d+|\w+))")
_LONG = re.compile(r"\S{16,}")
_EMPTY = re.compile(r'\s*\N{EN DASH}\s*<div class="doc-md-description">\s*</div>')


def on_page_content(html: str, **_: Any) -> str:
    """Return the page with lines that break at good places, and pictures that lead to themselves,
    where a phone can enlarge them.

    In tables, names may break after one of ``_.,:=@/``, and before ``[``. An option such as
    ``--film`` may not break, and a number may not break from its unit or its uncertainty. Formulas
    such as ``p_1`` and ``k^(n+1)`` get indices and powers. In lists of parameters, no dash stands
    before an empty description.
    """
    html = _EMPTY.sub("", _PICTURE.sub(r'<a href="\2">\1</a>', html))
    html = _PROSE.sub(lambda piece: piece[0] if piece[0][0] == "<" else _formulas(piece[0]), html)
    html = _CELL.sub(lambda cell: _PROSE.sub(_breakable, cell[0]), html)
    return _CODE.sub(
        lambda code: _in_text(_OPTION, r'<span class="option">\g<0></span>', code[0]), html
    )


def on_post_page(output: str, *, page: Any, config: Any) -> str:
    """Return the page with the site's own copy of the search's helper script, which would come from
    the network.
    """
    return _with_own_helper(output, posixpath.dirname(page.file.dest_uri) or ".")


def on_post_template(output: str, *, template_name: str, config: Any) -> str:
    """Return the page for missing pages with the site's own helper script and a link to the first
    page.
    """
    if template_name != "404.html":
        return output
    return _with_own_helper(output, None).replace(
        "</h1>", '</h1>\n<p><a href="/index.html">Go to the first page</a></p>', 1
    )


def _with_own_helper(output: str, folder: str | None) -> str:
    """Return a page of a folder, or a page that a server sends for any folder, with the site's own
    copy of the script.
    """
    ours = "javascripts/iframe-worker.js"
    place = f"/{ours}" if folder is None else posixpath.relpath(ours, folder)
    return _HELPER.sub(f'<script src="{place}"></script>', output)


def _formulas(text: str) -> str:
    """Return a text with indices, powers, and numbers that stay with their units."""
    text = _INDEX.sub(lambda index: f"{index[1]}<sub>{index[2] or index[3]}</sub>", text)
    text = _POWER.sub(lambda power: f"<sup>{_formulas(power[1] or power[2])}</sup>", text)
    return _TOGETHER.sub("\N{NO-BREAK SPACE}", text)


def _breakable(piece: re.Match[str]) -> str:
    """Return a piece of a cell in which all names in code, and long words in the text,
    may break.
    """
    if piece[1] == "code":
        return _in_text(_BREAK, r"\g<0><wbr>", piece[0])
    return (
        piece[0]
        if piece[0][0] == "<"
        else _LONG.sub(lambda word: _BREAK.sub(r"\g<0><wbr>", word[0]), piece[0])
    )


def _in_text(pattern: re.Pattern[str], replacement: str, html: str) -> str:
    return _TEXT.sub(lambda text: pattern.sub(replacement, text[0]), html)
