"""Figures, films and the HTML player for episodes of all three parts: swarm, steering and search.

In Shoal, only the packages ``views`` and ``papers`` import matplotlib.
"""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Callable, Sequence
from inspect import signature
from typing import TYPE_CHECKING, Any

from shoal.core.checks import check_choice, check_function
from shoal.core.errors import InvalidInputError
from shoal.core.files import atomic
from shoal.core.version import versions
from shoal.parts import PARTS
from shoal.views import search, steering, swarm
from shoal.views.drawing.charts import check_layout, printed, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from shoal.core.episode import Episode


__all__ = ["figure", "film", "notebook_page", "save_figure"]

MOMENTS = {"map": "moves", "plan": "moves", "routes": "seconds"}
"""By kind of figure, the option of `figure` that chooses a moment."""

INLINE = 1_000_000  # maximum characters of a player in a notebook


def figure(
    episode: Episode | Sequence[Episode],
    *,
    kind: str | None = None,
    width: float | None = None,
    font_size: float | None = None,
    **options: Any,
) -> Figure:
    """Return a matplotlib figure of an episode, for a screen or for print.

    Parameters
    ----------
    episode : Episode
        An episode of swarm, steering or search. The figure "frontier" also accepts a list of swarm
        episodes. For several episodes, the figure also shows the median of their curves.
    kind : str, optional
        Kind of the figure. For a swarm episode, "map" (the default) shows the map, and "frontier"
        shows the number of frontier cells over the moves. For a steering episode, "plan" shows the
        paths of the particles. For a search, "routes" (the default) shows the path of each robot,
        "timeline" shows the activities of each robot over time, and "success" shows the prior of
        the search and the probability that the target is found, over time.
    width : float, optional
        Width of a figure for print, in millimetres, from 30 to 1000. Such a figure has no heading,
        because captions have one. By default, the figure has a size for a screen, and a heading.
    font_size : float, optional
        Size of the text of a figure for print in points, from 4 to 20; by default, 8.
    **options
        Options of the chosen kind of figure, which choose the moment that the figure shows; by
        default, the end. The kinds "map" and "plan" have the option ``moves``, a number of moves;
        for the map of a plane workspace, also several numbers, with one panel for each. The kind
        "routes" has the option ``seconds``, a time since the start.

    Raises
    ------
    InvalidInputError
        If Shoal has no figure of the given kind for the episode, if the kind does not have a
        given option, if a number is out of its range, or if the text of a figure for print has no
        room in its width.
    """
    first = episode[0] if isinstance(episode, Sequence) and episode else episode
    kinds = _views_of(first).figures.FIGURES
    if kind is None:
        kind = next(iter(kinds))
    draw = kinds[check_choice(kind, what="kind", choices=kinds)]
    known = [
        name for name, one in signature(draw).parameters.items() if one.kind is one.KEYWORD_ONLY
    ]
    for name in options:
        check_choice(name, what=f"option of the figure {kind}", choices=known)
    with printed(width, font_size), check_layout(kind) as figures:
        figures.append(draw(episode, **options))
    return figures[0]


def caption(
    episode: Episode, *, kind: str, moment: str | None = None, command: str | None = None
) -> str:
    """Return a caption of a figure: what it shows, how to repeat the episode, and the versions that
    made and drew it.

    Parameters
    ----------
    episode : Episode
    kind : str
        Kind of the figure.
    moment : str, optional
        The moment that the figure shows, as text such as "20".
    command : str, optional
        Command that repeats the episode, or None if no seed repeats it.
    """
    import matplotlib

    at = "" if moment is None else f" at {MOMENTS[kind]} {moment}"
    drawn_by = versions() | {"matplotlib": matplotlib.__version__}
    computed_by, drawn = (
        ", ".join(f"{name} {version}" for name, version in known.items())
        for known in (episode.versions, drawn_by)
    )
    problem = "an episode that no seed repeats" if command is None else command
    return (
        f"{kind.capitalize()}{at}. {episode.sentence}\nProblem: {problem}\n"
        f"Computed with {computed_by}.\nDrawn with {drawn}.\n"
    )


def figure_kinds(episode: Episode) -> list[str]:
    """Return the kinds of figures that an episode has, the default first."""
    return list(_views_of(episode).figures.FIGURES)


def film(
    episode: Episode,
    path: str | os.PathLike[str],
    *,
    size: str | None = None,
    rate: int | None = None,
    on_frame: Callable[[int, int], None] | None = None,
) -> None:
    """Write a film of an episode of swarm, steering or search. The suffix of ``path`` determines
    the format.

    Parameters
    ----------
    episode : Episode
        An episode whose method ``verify`` succeeds, because the film needs a simulation of the
        motion within each move.
    path : path
        Path of the film, with the suffix ``.gif``, ``.mp4`` (H.264) or ``.html`` (the player).
    size : str, optional
        Size of a film for presentations: "wide" (1920 x 1080 pixels) or "square" (1080 x 1080).
        Such a film has a title, numbers, a scale (but for steering) and a card at its end, shows
        particles between the cells of their moves, and has the photograph of a map under it.
    rate : int, optional
        Frames per second of a film for presentations: 30 (the default) or 60.
    on_frame : callable, optional
        Function that Shoal calls after each frame, with the number of finished frames and the total
        number of frames.

    Raises
    ------
    InvalidInputError
        If the suffix of ``path`` is not supported, if the episode is too large for a browser, or if
        ``size`` or ``rate`` has no effect: on a player, a GIF with a rate, the film of a volume.
    OutputError
        If writing the file fails. After a failure, no partial file remains.
    """
    check_function(on_frame, what="on_frame")
    from shoal.views.drawing.encoding import check_film, encode_film
    from shoal.views.drawing.stage import stage_of

    target = check_film(path)
    suffix = target.suffix.lower()
    stage = stage_of(suffix, size, rate)
    with atomic(target) as temporary:
        if suffix == ".html":
            temporary.write_text(_views_of(episode).page.player_page(episode), encoding="utf-8")
        else:
            encode_film(
                temporary,
                _views_of(episode).films.clip_of(episode, suffix, stage),
                gif=suffix == ".gif",
                on_frame=on_frame,
            )


def notebook_page(episode: Episode) -> str:
    """Return an episode as HTML for a notebook: its figure, one sentence, and its player unless the
    player is too large.
    """
    from shoal.views.drawing.encoding import (
        encode_figure,  # needs matplotlib, which is slow to import
    )

    encoded = base64.b64encode(encode_figure(figure(episode))).decode()
    name = html.escape(repr(episode).strip("<>"))
    caption = (
        name
        if html.escape(episode.sentence) in name
        else f"{name}<br/>{html.escape(episode.sentence)}"
    )
    try:
        player = _views_of(episode).page.player_page(episode)
    except InvalidInputError:  # the episode is too large for a browser
        player = ""
    frame = (
        f'<details><summary>play</summary><iframe srcdoc="{html.escape(player)}" loading="lazy" '
        'style="width:100%;height:720px;border:1px solid #ccc"></iframe></details>'
    )
    return (
        f'<figure style="margin:0"><img alt="{name}" src="data:image/png;base64,{encoded}"'
        ' style="max-width:100%"/>'
        f"<figcaption>{caption}</figcaption>{frame * (0 < len(player) < INLINE)}</figure>"
    )


def page_data(episode: Episode) -> dict[str, Any]:
    """Return an episode as JSON data for the player.

    Raises
    ------
    InvalidInputError
        If the episode is too large for a browser.
    """
    data: dict[str, Any] = _views_of(episode).page.page_data(episode)
    return data


def _views_of(episode: Any) -> Any:
    """Return the package that draws the episodes of a part, with the modules ``figures``, ``films``
    and ``page``. Each is imported when it is used, because matplotlib is slow to import.
    """
    part = getattr(episode, "part", None)
    if part not in PARTS:
        raise InvalidInputError(
            "episode: expected an episode of swarm, steering or search, got"
            f" {type(episode).__name__}"
        )
    packages: dict[str, Any] = {"swarm": swarm, "steering": steering, "search": search}
    return packages[str(part)]
