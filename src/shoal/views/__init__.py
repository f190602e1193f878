"""Figures, films and the HTML player of an episode of any part.

Only this package and ``papers`` import matplotlib.
"""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

from shoal.core.checks import check_choice
from shoal.core.errors import InvalidInputError
from shoal.core.files import atomic
from shoal.views.drawing.charts import save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from shoal.core.episode import Episode


__all__ = ["figure", "film", "notebook_page", "save_figure"]

INLINE = 1_000_000  # maximum characters of a player in a notebook


def figure(episode: Episode | Sequence[Episode], *, kind: str | None = None, **options: Any) -> Figure:
    """Return the figure of an episode.

    Parameters
    ----------
    episode : Episode
        The episode, of any part. For ``kind="frontier"`` also several episodes, whose median is drawn.
    kind : str, optional
        Kind of the figure. The default is the first kind of the part:

        - swarm: "map" (option ``moves``: number of moves before the picture; default: all), "frontier" (frontier cells by move).
        - steering: "plan".
        - search: "routes", "timeline" (activities of each robot over time).
    **options
        Options of the kind of figure, as listed above.

    Raises
    ------
    InvalidInputError
        If the part does not have this kind or option.
    """
    kinds = _views_of(episode[0] if isinstance(episode, Sequence) and episode else episode, "figures").FIGURES
    if kind is None:
        kind = next(iter(kinds))
    drawn: Figure = kinds[check_choice(kind, what="kind", choices=kinds)](episode, **options)
    return drawn


def film(episode: Episode, path: str | os.PathLike[str], *, on_frame: Callable[[int, int], None] | None = None) -> None:
    """Write a film of an episode of any part. The suffix determines the format.

    Parameters
    ----------
    episode : Episode
        An episode that `verify` confirms, because the film replays the motion between its moves.
    path : path
        ``.gif``, ``.mp4`` (H.264) or ``.html`` (the player).
    on_frame : callable, optional
        Function that is called with (frames done, total frames).

    Raises
    ------
    InvalidInputError
        If the suffix is unsupported, or the episode is too large for a browser.
    OutputError
        If the file cannot be written. No partial file remains.
    """
    from shoal.views.drawing.encoding import check_film, encode_film

    target = check_film(path)
    suffix = target.suffix.lower()
    with atomic(target) as temporary:
        if suffix == ".html":
            temporary.write_text(_views_of(episode, "page").player_page(episode), encoding="utf-8")
        else:
            encode_film(temporary, _views_of(episode, "films").clip_of(episode, suffix), gif=suffix == ".gif", on_frame=on_frame)


def notebook_page(episode: Episode) -> str:
    """Return an episode as HTML for a notebook: its figure, one sentence, and its player unless the player is too large."""
    from shoal.views.drawing.notebook_figure import encode_figure  # needs matplotlib, which is slow to import

    encoded, name = base64.b64encode(encode_figure(figure(episode))).decode(), html.escape(repr(episode).strip("<>"))
    told = name if html.escape(episode.sentence) in name else f"{name}<br/>{html.escape(episode.sentence)}"
    try:
        player = _views_of(episode, "page").player_page(episode)
    except InvalidInputError:  # the episode is too large for a browser
        player = ""
    frame = (
        f'<details><summary>play</summary><iframe srcdoc="{html.escape(player)}" loading="lazy" '
        'style="width:100%;height:720px;border:1px solid #ccc"></iframe></details>'
    )
    return (
        f'<figure style="margin:0"><img alt="{name}" src="data:image/png;base64,{encoded}" style="max-width:100%"/>'
        f"<figcaption>{told}</figcaption>{frame * (0 < len(player) < INLINE)}</figure>"
    )


def _views_of(episode: Any, room: str) -> Any:
    """Return a view module of the episode's part. The views of other parts and the kernels of other parts are not loaded."""
    part = getattr(episode, "part", None)
    if part not in ("swarm", "steering", "search"):
        raise InvalidInputError(f"episode: expected an episode of swarm, steering or search, got {type(episode).__name__}")
    return import_module(f"shoal.views.{part}.{room}")
