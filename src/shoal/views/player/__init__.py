"""The player: a self-contained HTML page that plays an episode of any part.

Styles, scripts and the page template are in ``shared/``, and files for a single part in the folder of that part. The page of a
swarm episode simulates the episode from its start and its commands. Therefore the file is small: about 70 kB, of which the
episode's data are a few kB. A page cannot simulate noise. Therefore the page of an episode with noise contains the observable data
of each move. The pages of steering episodes and searches contain trajectories of straight segments.
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Mapping
from importlib import resources
from typing import Any

_MARKER = re.compile(r"<!-- shoal:(\w+) -->")
_BLOCK = re.compile(r"<!-- block:(\w+) -->\n")
_TRAJECTORIES = ("shared/track.js", "shared/views.js", "{part}/scene.js")
_FRAME = ("shared/hands.js", "shared/desk.js", "{part}/player.js")


def render(part: str, data: Mapping[str, Any]) -> str:
    r"""Return the text of a page that plays an episode.

    Parameters
    ----------
    part : str
        "swarm", "steering" or "search".
    data : mapping
        The episode in a form for JSON, from the part's ``page_data``: `shoal.views.swarm.page.page_data`,
        `shoal.views.steering.page.page_data` or `shoal.views.search.page.page_data`.

    Returns
    -------
    str
        An HTML document with inline styles, scripts and data. The page loads no other files, because its content security policy
        forbids it.

    Raises
    ------
    TypeError
        If a value cannot be represented in JSON.
    ValueError
        If a number is not finite.

    Notes
    -----
    The data are not checked here. A page with invalid data opens and shows an error of one sentence.

    Examples
    --------
    >>> page = render("swarm", {"title": "A </script> in the title"})
    >>> "A </script>" in page, r"A \u003c/script>" in page
    (False, True)
    """
    shape = data.get("shape")
    styles, scripts = files_of(part, volume=isinstance(shape, list) and len(shape) == 3, recorded="moments" in data)
    parts = {
        "policy": "style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:",
        "title": html.escape(str(data.get("title") or "Shoal")),
        "styles": f"<style>\n{''.join(map(_read, styles))}</style>",
        "scripts": "\n".join(f"<script>\n{_read(name)}</script>" for name in scripts),
        # A "<" could end the script block or open a comment. In JSON, it occurs only inside strings.
        "data": json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", r"\u003c"),
    }
    return _page(part, "swarm/volume.js" in scripts, parts)


def served_page(part: str, *, volume: bool = False, recorded: bool = False, more: tuple[str, ...] = (), files: str = "") -> str:
    """Return the player's page for a server, without an episode.

    The styles and scripts of the page are links to addresses that begin with ``files``. A script supplies the episode, even while
    the episode runs.

    Parameters
    ----------
    part : str
    volume, recorded : bool
        For a swarm: whether the map is 3-D, and whether there is noise.
    more : tuple of str
        Addresses of additional styles and scripts.
    files : str
        Base address of this package's files, with a slash at its end.

    Examples
    --------
    >>> '<script src="/player/swarm/picture.js">' in served_page("swarm", files="/player/")
    True
    """
    styles, scripts = files_of(part, volume=volume, recorded=recorded)
    addresses = [*(files + name for name in (*styles, *scripts)), *more]
    parts = {
        "policy": "style-src 'self'; script-src 'self'; img-src data:",
        "title": "Shoal",
        "styles": "\n".join(f'<link rel="stylesheet" href="{one}">' for one in addresses if one.endswith(".css")),
        "scripts": "\n".join(f'<script src="{one}"></script>' for one in addresses if one.endswith(".js")),
        "data": "",
    }
    return _page(part, volume, parts)


def files_of(part: str, *, volume: bool = False, recorded: bool = False) -> tuple[list[str], list[str]]:
    """Return the names of the styles and scripts of a player. See `served_page` for the parameters."""
    if part != "swarm":
        scripts = [name.format(part=part) for name in (*_TRAJECTORIES, *_FRAME)]
        colours = ["search/colours.css"] if part == "search" else []
        return ["shared/style.css", *colours, f"{part}/style.css"], scripts
    pictures = ["swarm/volume.js" if volume else "swarm/picture.js", "swarm/chart.js"]
    frame = [name.format(part=part) for name in _FRAME]
    styles = ["shared/style.css", *(["swarm/volume.css"] if volume else [])]
    return styles, ["swarm/simulate.js", *(["swarm/recorded.js"] if recorded else []), *pictures, *frame]


def _page(part: str, volume: bool, parts: Mapping[str, str]) -> str:
    blocks = dict(zip(*[iter(_BLOCK.split(_read(f"{part}/page.html"))[1:])] * 2, strict=True))
    if volume:
        blocks["stage"] = blocks["volume_stage"]
    filled = {name: block.rstrip("\n") for name, block in blocks.items()}
    filled |= {"kind": "" if part == "swarm" else f" {part}", **parts}
    return _MARKER.sub(lambda marker: filled[marker[1]], _read("shared/page.html"))


def _read(file: str) -> str:
    """Return the text of a file in this package."""
    return resources.files(__name__).joinpath(file).read_text(encoding="utf-8")
