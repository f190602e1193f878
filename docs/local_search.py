"""A hook of MkDocs: the search works from the disk, so its helper script comes from this site and not from the network."""

from __future__ import annotations

import posixpath
import re
from typing import Any

_HELPER = re.compile(r'<script src="[^"]*iframe-worker/shim"></script>')


def on_post_page(output: str, *, page: Any, config: Any) -> str:
    """Return the page with the site's own copy of the script."""
    ours = posixpath.relpath("javascripts/iframe-worker.js", posixpath.dirname(page.file.dest_uri) or ".")
    return _HELPER.sub(f'<script src="{ours}"></script>', output)
