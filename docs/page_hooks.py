"""Hooks of MkDocs: the search works from the disk, and pages are readable on a phone."""

from __future__ import annotations

import posixpath
import re
from typing import Any

_HELPER = re.compile(r'<script src="[^"]*iframe-worker/shim"></script>')
_CELL = re.compile(r"<t[dh][ >].*?</t[dh]>", re.S)
_PICTURE = re.compile(r'(<img [^>]*src="([^"]+)"[^>]*>)')
_CODE = re.compile(r"(?<=<code>)[^<]*(?=</code>)")


def on_page_content(html: str, **_: Any) -> str:
    """Return the page for a phone, too: a picture leads to itself, which can be enlarged, and cells of tables break at good places.

    Names may break after ``_``, ``.``, ``:`` or ``/``. A number may not break from its uncertainty, as in ``0.81 ± 0.05``.
    """
    html = _PICTURE.sub(r'<a href="\2">\1</a>', html)
    return _CELL.sub(lambda cell: _CODE.sub(_breakable, cell[0]).replace(" ± ", "\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}"), html)


def on_post_page(output: str, *, page: Any, config: Any) -> str:
    """Return the page with the site's own copy of the search's helper script, which would come from the network."""
    ours = posixpath.relpath("javascripts/iframe-worker.js", posixpath.dirname(page.file.dest_uri) or ".")
    return _HELPER.sub(f'<script src="{ours}"></script>', output)


def _breakable(name: re.Match[str]) -> str:
    return re.sub(r"(?<=\w)[_.:/](?=\w)", r"\g<0><wbr>", name[0])
