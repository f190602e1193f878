"""The player: a self-contained HTML page that plays an episode of swarm, steering or search.

The folder ``shared/`` contains the page template, styles and scripts for all episodes. The folders
``swarm/``, ``steering/`` and ``search/`` contain additional files for the episodes of one part of
Shoal. The player page of a swarm episode is small (about 70 kB). The page contains only the start
cells and the commands of the particles (a few kB), and simulates the episode. A player page cannot
simulate noise, so the page of an episode with noise contains the observable data of each move. The
player pages of steering episodes and of searches contain trajectories that consist of straight
segments.
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
    r"""Return the HTML text of a page that plays an episode.

    Parameters
    ----------
    part : str
        Part of Shoal to which the episode belongs: "swarm", "steering" or "search".
    data : mapping
        The episode as JSON data, from the function `shoal.views.swarm.page.page_data`,
        `shoal.views.steering.page.page_data` or `shoal.views.search.page.page_data`.

    Returns
    -------
    str
        An HTML document with inline styles, scripts and data. The content security policy of the
        document forbids the loading of other files.

    Raises
    ------
    TypeError
        If ``data`` contains a value that JSON cannot represent.
    ValueError
        If ``data`` contains a number that is not finite.

    Notes
    -----
    The function does not check ``data``. A page with invalid data opens and shows an error message
    of one sentence.

    Examples
    --------
    >>> page = render("swarm", {"title": "A </script> in the title"})
    >>> "A </script>" in page, r"A \u003c/script>" in page
    (False, True)
    """
    shape = data.get("shape")
    styles, scripts = files_of(
        part, volume=isinstance(shape, list) and len(shape) == 3, recorded="moments" in data
    )
    parts = {
        "policy": "style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:",
        "title": html.escape(str(data.get("title") or "Shoal")),
        "styles": f"<style>\n{''.join(map(_read, styles))}</style>",
        "scripts": "\n".join(f"<script>\n{_read(name)}</script>" for name in scripts),
        # A "<" could end the script block or open a comment. In JSON, it occurs only inside
        # strings.
        "data": json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", r"\u003c"),
    }
    return _page(part, "swarm/volume.js" in scripts, parts)


def served_page(
    part: str,
    *,
    volume: bool = False,
    recorded: bool = False,
    more: tuple[str, ...] = (),
    files: str = "",
) -> str:
    """Return a player page without an episode, for a server.

    The page links its styles and scripts at addresses that begin with ``files``. One of the scripts
    in ``more`` must supply the episode, which may still be running.

    Parameters
    ----------
    part : str
    volume, recorded : bool
        Only for swarm episodes. ``volume``: whether the map is 3-D. ``recorded``: whether the
        episode has noise.
    more : tuple of str
        Addresses of additional styles and scripts for the page.
    files : str
        Base address of the files of the package ``shoal.views.player``, with a slash at its end.

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
        "styles": "\n".join(
            f'<link rel="stylesheet" href="{one}">' for one in addresses if one.endswith(".css")
        ),
        "scripts": "\n".join(
            f'<script src="{one}"></script>' for one in addresses if one.endswith(".js")
        ),
        "data": "",
    }
    return _page(part, volume, parts)


def files_of(
    part: str, *, volume: bool = False, recorded: bool = False
) -> tuple[list[str], list[str]]:
    """Return the file names of the styles and the scripts of a player page; `served_page` explains
    the parameters.
    """
    if part != "swarm":
        scripts = [name.format(part=part) for name in (*_TRAJECTORIES, *_FRAME)]
        colours = ["search/colours.css"] if part == "search" else []
        return ["shared/style.css", *colours, f"{part}/style.css"], scripts
    pictures = ["swarm/volume.js" if volume else "swarm/picture.js", "swarm/chart.js"]
    frame = [name.format(part=part) for name in _FRAME]
    styles = ["shared/style.css", *(["swarm/volume.css"] if volume else [])]
    return styles, [
        "swarm/simulate.js",
        *(["swarm/recorded.js"] if recorded else []),
        *pictures,
        *frame,
    ]


def _page(part: str, volume: bool, parts: Mapping[str, str]) -> str:
    blocks = dict(zip(*[iter(_BLOCK.split(_read(f"{part}/page.html"))[1:])] * 2, strict=True))
    if volume:
        blocks["stage"] = blocks["volume_stage"]
    filled = {name: block.rstrip("\n") for name, block in blocks.items()}
    filled |= {"kind": "" if part == "swarm" else f" {part}", **parts}
    return _MARKER.sub(lambda marker: filled[marker[1]], _read("shared/page.html"))


def _read(file: str) -> str:
    """Return the text of a file in the package ``shoal.views.player``."""
    return resources.files(__name__).joinpath(file).read_text(encoding="utf-8")
