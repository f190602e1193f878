"""Frontier cells by move, of several policies in one chart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError
from shoal.views.drawing.charts import INK, new_figure, plain_axes, set_title
from shoal.views.drawing.curves import COLOURS, add_note

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def frontier_curves(groups: Mapping[str, Sequence[NDArray[np.int32]]], *, title: str, note: str = "") -> Figure:
    """Return frontier cells against moves, as paper M, Fig. 8: a thin line a trial, a thick one the median of each group.

    Parameters
    ----------
    groups : mapping from name to arrays of int32, shape (moves + 1,)
        Frontier cells before the first move and after each.
    title, note : str

    Raises
    ------
    InvalidInputError
        If a group has no trial.
    """
    if not groups or not all(len(curves) for curves in groups.values()):
        raise InvalidInputError("frontier curves: expected one trial or more of each group, got none")
    figure = new_figure(7.4, 4.4)
    axes = figure.add_subplot()
    for (name, curves), colour in zip(groups.items(), COLOURS, strict=False):
        longest = max(len(curve) for curve in curves)
        table = np.zeros((len(curves), longest))
        for row, curve in zip(table, curves, strict=True):
            row[: len(curve)] = curve
            axes.plot(np.arange(1, len(curve) + 1), np.maximum(curve, 0.5), color=colour, lw=0.5, alpha=0.25)
        median = np.median(table, axis=0)
        alive = median > 0
        axes.plot(np.arange(1, longest + 1)[alive], median[alive], color=colour, lw=2.2, label=f"{name}, median of {len(curves)}")
    axes.set(xlabel="moves + 1", ylabel="frontier cells", xscale="log", yscale="log", ylim=(0.8, None))
    axes.legend(frameon=False, fontsize=9, labelcolor=INK)
    set_title(axes, title)
    plain_axes(axes)
    add_note(figure, note)
    return figure
