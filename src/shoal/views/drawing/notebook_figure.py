"""A matplotlib figure that notebooks show as a picture, whether pyplot was imported or not."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """A figure that shows itself in a notebook."""

    def _repr_png_(self) -> bytes:
        return encode_figure(self)


def encode_figure(figure: Figure) -> bytes:
    """Return a figure as PNG, as large as a notebook shows it."""
    picture = BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    return picture.getvalue()
