"""A matplotlib figure that notebooks display even without an import of pyplot."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """A matplotlib figure that displays itself in a notebook."""

    def _repr_png_(self) -> bytes:
        return encode_figure(self)


def encode_figure(figure: Figure) -> bytes:
    """Return a figure as PNG bytes, with a size that suits notebooks."""
    picture = BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    return picture.getvalue()
