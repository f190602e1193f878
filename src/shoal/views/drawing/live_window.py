"""LiveWindow: a window that shows pictures as they come."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray


class LiveWindow:
    """A window with one picture in it; without a display nothing is seen, and nothing fails.

    Parameters
    ----------
    title : str
    """

    def __init__(self, title: str) -> None:
        self._figure = plt.figure()
        if self._figure.canvas.manager is not None:
            self._figure.canvas.manager.set_window_title(title)
        self._axes = self._figure.add_axes((0, 0, 1, 1))

    def show(self, picture: NDArray[np.uint8], *, pause: float) -> None:
        """Show a picture, uint8, shape (height, width, 3), and let so many seconds go by."""
        self._axes.clear()
        self._axes.set_axis_off()
        self._axes.imshow(picture)
        if self._figure.canvas.required_interactive_framework is not None:  # there is a display
            plt.pause(pause)

    def close(self) -> None:
        """Close the window."""
        plt.close(self._figure)
