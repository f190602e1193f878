"""Figures of swarm episodes: the map, and the number of frontier cells over the moves."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from shoal.core.checks import check_integer
from shoal.core.errors import InvalidInputError
from shoal.core.files import atomic
from shoal.swarm import SwarmEpisode
from shoal.swarm.maps.workspace import PALETTE, in_strips
from shoal.views.drawing.charts import (
    INK,
    MUTED,
    draw_scale_bar,
    figure_width,
    fit_columns,
    new_figure,
    padded_figure,
    plain_axes,
    set_title,
    text_size,
)
from shoal.views.drawing.curves import median_of
from shoal.views.swarm.colours import (
    WRONG_FREE,
    WRONG_OBSTACLE,
    codes_after,
    legend_colour,
    legend_of,
    palette_of_cells,
)
from shoal.views.swarm.volume import CORNER, Fit, Slices, caption_boxes, sheet_width
from shoal.views.swarm.volume import sheet as volume_sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch


_LINE = 1.35  # height of a line as a multiple of the size of its text
SIDE = 900  # pixels of the rotated 3-D view
_WIDE = 9.0  # inches: width of a figure with several maps
_MOMENTS = 3  # maps side by side, of several moments of an episode


def map_figure(episode: SwarmEpisode, *, moves: int | Sequence[int] | None = None) -> Figure:
    """Return a figure of an episode's map: particles, frontier cells, free cells, obstacles and
    unknown cells.

    The figure cuts a very wide map into strips and stacks the strips like lines of text. The figure
    shows a 3-D map from a corner, with three slices of the map on the right.

    Parameters
    ----------
    episode : SwarmEpisode
    moves : int or sequence of int, optional
        Number of moves after which the figure shows the map, or None for the end of the episode.
        With several numbers, the figure has a panel for each; the workspace must be plane.

    Raises
    ------
    InvalidInputError
        If the episode has fewer than ``moves`` moves, or a 3-D workspace would need several panels.
    """
    workspace = episode.workspace
    if isinstance(moves, Sequence):
        counts = [check_integer(n, what="moves", least=0, most=episode.moves) for n in moves]
        if workspace.ndim == 3 and len(counts) > 1:
            raise InvalidInputError(f"at: expected one number for a volume, got {len(counts)}")
        if len(counts) > 1:
            return map_panels([(episode, n) for n in counts], columns=min(_MOMENTS, len(counts)))
        (moves,) = counts
    moves = (
        episode.moves
        if moves is None
        else check_integer(moves, what="moves", least=0, most=episode.moves)
    )
    palette = palette_of_cells(episode)
    codes = codes_after(episode, moves)
    inches = 6.4
    if workspace.ndim == 3:
        slices, fit = Slices.of(workspace), Fit.of(workspace)
        points = 72 * figure_width(inches) / sheet_width(codes.shape, SIDE, workspace.spacing)
        line = round(_LINE * text_size() / points)
        sheet = volume_sheet(
            codes,
            slices,
            azimuth=CORNER,
            side=SIDE,
            spacing=workspace.spacing,
            palette=palette,
            fit=fit,
            unnamed=line,
        )
    else:
        sheet = in_strips(palette.rgb[codes])
    height, width = sheet.shape[:2]
    figure = new_figure(inches, float(np.clip(inches * height / width + 0.9, 2.2, 9.5)))
    axes = figure.add_subplot()
    axes.imshow(sheet, interpolation="nearest" if max(height, width) < 900 else "antialiased")
    axes.set_axis_off()
    if workspace.ndim == 3:
        _name_slices(
            axes, slices, *caption_boxes(codes.shape, SIDE, workspace.spacing, line), points
        )
    scans = 1 + int(np.count_nonzero(episode.trace.scanned[:moves]))
    scan_note = "" if episode.trace.scanned.all() else f" and {scans} scans"
    note = f"\n{episode.out_of_reach} are out of reach" if episode.unreachable else ""
    set_title(axes, f"{episode.workspace.name} after {moves} moves{scan_note}{note}", in_print="")
    _legend(
        figure,
        axes,
        episode,
        noisy=episode.noisy,
        seen=episode.observations is not None,
    )
    if workspace.spacing is not None:
        volume = workspace.ndim == 3
        cell = min(workspace.spacing) / fit.pixels_a_cell(SIDE) if volume else workspace.spacing[1]
        draw_scale_bar(figure, axes, unit="mm", size=cell, above=SIDE if volume else width - 0.5)
    return figure


def _name_slices(
    axes: Axes, slices: Slices, corners: list[tuple[int, int]], width: int, points: float
) -> None:
    """Write the names of the slices above them; a pixel is ``points`` points wide."""
    from matplotlib.textpath import TextPath

    longest = max(TextPath((0, 0), name, size=1).get_extents().width for name in slices.names)
    size = min(text_size(), width * points / longest)
    for (x, y), name in zip(corners, slices.names, strict=True):
        axes.text(x, y - 0.3 * size / points, name, fontsize=size, color=INK)


def map_panels(
    shown: Sequence[tuple[SwarmEpisode, int]],
    *,
    columns: int,
    chart: Callable[[Axes], None] | None = None,
) -> Figure:
    """Return a figure with several plane maps side by side, as in figure 1 of paper M.

    Parameters
    ----------
    shown : sequence of (SwarmEpisode, int)
        For each map, an episode and the number of moves after which the map shows it.
    columns : int
        Number of maps side by side in one row.
    chart : callable, optional
        Function that draws a chart on given axes below the maps.

    Raises
    ------
    InvalidInputError
        If ``shown`` is empty.
    """
    if not shown:
        raise InvalidInputError("map panels: expected at least one episode, got none")
    rows = -(-len(shown) // columns)
    height, width = (side + 2 for side in shown[0][0].workspace.shape)
    tall = rows * (_WIDE / columns * height / width + 0.3) + 0.4
    figure = padded_figure(_WIDE, tall + (3.6 if chart else 0.3))
    above, *below = figure.subfigures(
        1 + bool(chart), 1, squeeze=False, height_ratios=[tall, 3.6] if chart else None
    ).ravel()
    panels = above.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(shown) :]:  # of the last row
        axes.remove()
    for axes, (episode, moves) in zip(panels[: len(shown)], shown, strict=True):
        axes.imshow(
            palette_of_cells(episode).rgb[codes_after(episode, moves)], interpolation="nearest"
        )
        axes.set_axis_off()
        many = "" if all(one is episode for one, _ in shown) else f"{episode.particles} particles, "
        set_title(axes, f"{many}{moves} moves")
    handles = _handles(shown[0][0])
    labels = [str(handle.get_label()) for handle in handles]
    above.legend(
        handles=handles,
        loc="outside lower center",
        ncols=fit_columns(labels, len(handles), width=figure.get_figwidth()),
        frameon=False,
        fontsize=text_size(),
        handlelength=1,
        handleheight=1,
    )
    if chart:
        chart(below[0].subplots())
    return figure


def _handles(episode: SwarmEpisode, *, seen: bool = False) -> list[Patch]:
    from matplotlib.patches import Patch

    names = legend_of(episode)
    if seen:
        names = names | {"particle": "seen at the last scan"}
    return [
        Patch(facecolor=legend_colour(episode, key), edgecolor=MUTED, linewidth=0.5, label=name)
        for key, name in names.items()
        if not (episode.targets is not None and key == "unknown")
    ]


def _legend(figure: Figure, axes: Axes, episode: SwarmEpisode, *, noisy: bool, seen: bool) -> None:
    from matplotlib.patches import Patch

    handles = _handles(episode, seen=seen)
    if noisy:
        handles += [
            Patch(facecolor=colour, edgecolor=MUTED, linewidth=0.5, label=label)
            for colour, label in (
                (WRONG_FREE, "wrongly free"),
                (WRONG_OBSTACLE, "wrongly an obstacle"),
            )
        ]
    axes.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.01),
        ncols=fit_columns(
            [str(handle.get_label()) for handle in handles],
            len(handles),
            width=figure.get_figwidth(),
            spacing=1.4,
        ),
        frameon=False,
        fontsize=text_size(),
        handlelength=1,
        handleheight=1,
        columnspacing=1.4,
    )


def frontier_figure(episodes: SwarmEpisode | Sequence[SwarmEpisode]) -> Figure:
    """Return a figure of the number of frontier cells over the moves, as in figure 8 of paper M.

    A line shows each of the first 200 episodes. For several episodes, a thick line shows the median
    of all episodes.

    Raises
    ------
    InvalidInputError
        If ``episodes`` is empty.
    """
    episodes = episodes if isinstance(episodes, Sequence) else [episodes]
    if not episodes:
        raise InvalidInputError("frontier figure: expected at least one episode, got none")
    from matplotlib.ticker import MaxNLocator

    figure = new_figure(6.4, 3.6)
    axes = figure.add_subplot()
    curves = [np.concatenate([[e.first_frontier], e.trace.frontier]) for e in episodes]
    many = len(curves) > 1
    for curve in curves[:200]:
        axes.plot(
            curve, color=PALETTE["frontier"], lw=0.7 if many else 1.8, alpha=0.35 if many else 1.0
        )
    if many:
        axes.plot(
            median_of(curves),
            color=PALETTE["particle"],
            lw=2,
            label=f"median of {len(curves)} trials",
        )
        axes.legend(frameon=False, fontsize=text_size())
    first = episodes[0]
    cells = "frontier cells" if first.targets is None else "cells not covered yet"
    if first.task == "gathering":
        cells = "cells with particles to gather"
    axes.set(xlabel="moves", ylabel=cells, xlim=(0, None), ylim=(0, None))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    set_title(
        axes,
        f"{first.workspace.name}: {first.task} by {first.policy}, {first.particles} particles",
        in_print="",
    )
    plain_axes(axes)
    return figure


FIGURES = {"map": map_figure, "frontier": frontier_figure}


OUTLINE = (64, 255, 96)  # a colour that does not occur in an eye


def mask_picture(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return a vessel mask as a picture with white vessels on black; uint8, shape (H, W)."""
    return np.asarray(mask, dtype=np.uint8) * np.uint8(255)


def overlay_picture(photograph: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the photograph with the outline of the mask drawn just outside the vessels; uint8,
    shape (H, W, 3).
    """
    picture = np.array(photograph if photograph.ndim == 3 else np.dstack([photograph] * 3))
    wide = max(1, round(max(mask.shape) / 1000))
    picture[ndimage.binary_dilation(mask, np.ones((3, 3)), iterations=wide) & ~mask] = OUTLINE
    return picture


def beside(photograph: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return a picture: the photograph on the left, its vessels in white on the right; uint8, shape
    (H, 2 W + gap, 3).
    """
    gap = np.full((mask.shape[0], max(1, mask.shape[1] // 50), 3), 255, dtype=np.uint8)
    colours = photograph if photograph.ndim == 3 else np.dstack([photograph] * 3)
    return np.hstack([colours, gap, np.dstack([mask_picture(mask)] * 3)])


def save_picture(picture: NDArray[Any], path: Path) -> Path:
    """Write a uint8 picture of shape (H, W) or (H, W, 3) to a file, and return the path of the
    file.

    The suffix of ``path`` determines the format.
    """
    encoded = io.BytesIO()  # Pillow does not detect a partial write on a full disk
    jpeg = path.suffix.lower() in {".jpg", ".jpeg"}
    Image.fromarray(picture).save(
        encoded, format="JPEG" if jpeg else "PNG", **({"quality": 90} if jpeg else {})
    )
    with atomic(path) as temporary:
        temporary.write_bytes(encoded.getvalue())
    return path
