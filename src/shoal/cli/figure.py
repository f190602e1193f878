"""shoal figure: draw a figure of an episode for print, with its caption."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import check_folder, check_seed, print_json, print_table
from shoal.core.errors import InvalidInputError
from shoal.core.files import check_suffix, write_text
from shoal.parts import load

EXAMPLE = "Example: shoal figure result/episode.npz --at 20 --width 85 --out map.pdf"


def figure(
    episode_file: Annotated[
        Path,
        typer.Argument(
            metavar="EPISODE",
            help="Episode file: .npz from map, cover or gather, or .json from steer or search.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="FILE",
            help=(
                "File for the figure: .png, .svg or .pdf. The caption is written beside it, as"
                " NAME.caption.txt."
            ),
        ),
    ],
    kind: Annotated[
        str | None,
        typer.Option(
            "--kind",
            help=(
                "Kind of the figure: map or frontier of a swarm, plan of steering, routes,"
                " timeline or success of a search. The default is the first of each part."
            ),
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            "--at",
            metavar="MOMENT,...",
            help=(
                "Moment that the figure shows: the number of moves, or of seconds of a search."
                " Several moments of a plane map, separated by commas, give a panel each."
            ),
        ),
    ] = None,
    width: Annotated[
        float | None,
        typer.Option(
            "--width",
            metavar="MM",
            help=(
                "Width in print, such as 85 for one column of a journal. Such a figure has no"
                " heading. By default, the figure has a size for a screen. Unit: mm."
            ),
        ),
    ] = None,
    font_size: Annotated[
        float | None,
        typer.Option("--font-size", help="With --width: size of the text. Default: 8. Unit: pt."),
    ] = None,
    dpi: Annotated[
        float | None, typer.Option("--dpi", help="Pixels an inch. Default: 150, in print 300.")
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            "--seed", help="Seed of the episode. Shoal refuses an episode with another seed."
        ),
    ] = None,
    trust: options.Trust = False,
    json_: options.Json = False,
) -> None:
    """Draw a figure of an episode, for a screen or for print, at its end or at any moment."""
    from shoal import views
    from shoal.studio.forms import command_beside
    from shoal.views.drawing.charts import FIGURES, PRINT_DPI

    check_folder(check_suffix(out, *FIGURES).parent)
    episode = load(episode_file, trust=trust)
    check_seed(episode_file, seed, episode.seed)
    chosen = kind if kind is not None else views.figure_kinds(episode)[0]
    drawn = views.figure(
        episode,
        kind=chosen,
        width=width,
        font_size=font_size,
        **_moments(chosen, at, views.MOMENTS),
    )
    views.save_figure(drawn, out, dpi=PRINT_DPI if dpi is None and width is not None else dpi)
    caption = out.with_suffix(".caption.txt")
    command, files = (
        (None, [])
        if episode.seed is None
        else command_beside(episode.problem, out, seed=episode.seed)
    )
    write_text(caption, views.caption(episode, kind=chosen, moment=at, command=command))
    inches = drawn.get_size_inches()
    result = {
        "kind": chosen,
        "width_mm": round(25.4 * float(inches[0]), 2),
        "height_mm": round(25.4 * float(inches[1]), 2),
        "out": str(out),
        "caption": str(caption),
    }
    if json_:
        print_json(result)
    else:
        size = f"{result['width_mm']} x {result['height_mm']} mm"
        print_table([("size", size)], title=f"figure {chosen}", written=[out, caption, *files])


def _moments(kind: str, at: str | None, known: Mapping[str, str]) -> dict[str, Any]:
    """Return the option of `shoal.views.figure` for the text of ``--at``; ``known`` names it for
    each kind of figure.
    """
    if at is None:
        return {}
    if kind not in known:
        raise InvalidInputError(
            f"--at: expected none for the figure {kind}, which shows the whole episode, got {at}"
        )
    convert = int if known[kind] == "moves" else float
    try:
        moments = [convert(text) for text in at.split(",")]
    except ValueError:
        raise InvalidInputError(f"--at: expected {known[kind]}, such as 20, got {at!r}") from None
    if len(moments) > 1 and kind != "map":
        raise InvalidInputError(f"--at: expected one moment for the figure {kind}, got {at}")
    return {known[kind]: moments[0] if len(moments) == 1 else moments}
