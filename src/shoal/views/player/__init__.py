"""The player: one HTML page, with nothing outside it, that plays a swarm episode, a steering episode or a search.

The page of a swarm episode simulates it again from its start and its commands, so the file stays small: some 70 kB, of
which the episode takes a few. With noise it cannot, and is told what there is to see at each move. Those of
a steering episode and of a search are told the ways, in straight pieces.
"""

from __future__ import annotations

import html
import json
import re
from importlib import resources

__all__ = ["render", "render_search", "render_steering"]

_MARKER = re.compile(r"<!-- shoal:(\w+) -->")
_SHARED = {"css": "player.css", "head": "head.html", "buttons": "buttons.html", "hands": "hands.js", "desk": "desk.js"}
_SWARM = _SHARED | {
    "simulate": "simulate.js",
    "recorded": "",
    "picture": "picture.js",
    "chart": "chart.js",
    "player": "player.js",
    "stage": "stage.html",
    "more": "",
}
_VOLUME = _SWARM | {"picture": "volume.js", "stage": "volume_stage.html", "more": "volume.css"}
_STEERING = _SHARED | {
    "more": "steering.css",
    "track": "track.js",
    "views": "views.js",
    "scene": "scene.js",
    "player": "steering.js",
}
_SEARCH = _SHARED | {
    "more": "search.css",
    "track": "track.js",
    "views": "views.js",
    "scene": "search_scene.js",
    "player": "search.js",
}


def render(data: dict[str, object]) -> str:
    r"""Return the text of a page that plays an episode.

    Parameters
    ----------
    data : dict
        The episode, ready for JSON:

        - ``title``, ``map``, ``policy``, ``version`` : str, shown as they are; ``seed`` : int or None.
        - ``task`` : ``"mapping"``, ``"coverage"`` or ``"subset-coverage"``.
        - ``rule`` : ``"block"``, ``"merge"`` or ``"tilt"``.
        - ``shape`` : ``[H, W]`` or ``[D, H, W]``; ``spacing`` : None or missing, or the size of a cell along each axis.
        - ``free`` : base64 of ``numpy.packbits(free.ravel())``; a set bit is a free cell.
        - ``start`` : base64 of the particles as little-endian uint32 indices ``r * W + c``, in 3-D ``(l * H + r) * W + c``.
        - ``targets`` : None, or the cells to cover in the form of ``free``; None in the task ``"coverage"``
          means all free cells.
        - ``commands`` : str of the letters ``lurd``, in 3-D ``lurdio``.
        - ``scanned`` : None or missing if a scan followed every command; else base64 of ``numpy.packbits`` of whether one
          followed each.
        - ``status`` : ``"complete"``, ``"stalled"`` or ``"limit"``.
        - With noise instead of ``start`` and ``targets``: ``moments`` : base64 of `shoal.views.player.moments.packed_moments`;
          ``looks`` : what their numbers mean; ``noise`` : rates by name; ``goal`` : how many cells there are to settle;
          ``truth`` : whether it is known what is wrong; ``seen`` : whether particles are where they were seen, not where they are.

    Returns
    -------
    str
        An HTML document with styles, scripts and data inlined. It loads nothing; its content security policy
        forbids it to.

    Raises
    ------
    TypeError
        If a value has no JSON form.
    ValueError
        If a number is not finite.

    Notes
    -----
    The data is not checked here: a page whose data describes no episode opens, and says in one sentence what
    is wrong with it.

    Examples
    --------
    >>> page = render({"title": "A </script> in the title"})
    >>> "A </script>" in page, r"A \u003c/script>" in page
    (False, True)
    """
    shape = data.get("shape")
    volume = isinstance(shape, list) and len(shape) == 3
    files = _VOLUME if volume else _SWARM
    return _assembled("player.html", files | {"recorded": "recorded.js"} if "moments" in data else files, data)


def render_steering(data: dict[str, object]) -> str:
    """Return the text of a page that plays a steering episode.

    Parameters
    ----------
    data : dict
        As `shoal.views.player.steering_page.steering_data` returns it.

    Returns
    -------
    str
        As `render` does.

    Raises
    ------
    TypeError
        If a value has no JSON form.
    ValueError
        If a number is not finite.
    """
    return _assembled("steering.html", _STEERING, data)


def render_search(data: dict[str, object]) -> str:
    """Return the text of a page that plays a search.

    Parameters
    ----------
    data : dict
        As `shoal.views.player.search_page.search_data` returns it.

    Returns
    -------
    str
        As `render` does.

    Raises
    ------
    TypeError
        If a value has no JSON form.
    ValueError
        If a number is not finite.
    """
    return _assembled("search.html", _SEARCH, data)


def _assembled(page: str, files: dict[str, str], data: dict[str, object]) -> str:
    parts = {name: _read(file) if file else "" for name, file in files.items()}
    parts["title"] = html.escape(str(data.get("title") or "Shoal"))
    # A "<" could end the script block or open a comment in it. In JSON it only stands inside strings.
    parts["data"] = json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", r"\u003c")
    return _MARKER.sub(lambda marker: parts[marker[1]], _read(page))


def _read(file: str) -> str:
    """Return the text of a file of this package."""
    return resources.files(__name__).joinpath(file).read_text(encoding="utf-8")
