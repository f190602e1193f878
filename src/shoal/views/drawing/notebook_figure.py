"""A matplotlib figure that notebooks display even if pyplot is not imported."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """A figure that displays itself in a notebook."""

    def _repr_png_(self) -> bytes:
        return encode_figure(self)


def encode_figure(figure: Figure) -> bytes:
    """Return a figure as PNG in the size for notebooks."""
    picture = BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    return picture.getvalue()
