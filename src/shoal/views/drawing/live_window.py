"""LiveWindow: a window that shows pictures of a running episode."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray


class LiveWindow:
    """A window that shows one picture. On a machine without a display, the class shows nothing and raises no error."""

    def __init__(self, title: str) -> None:
        self._figure = plt.figure()
        if self._figure.canvas.manager is not None:
            self._figure.canvas.manager.set_window_title(title)
        self._axes = self._figure.add_axes((0, 0, 1, 1))

    def show(self, picture: NDArray[np.uint8], *, pause: float) -> None:
        """Show a uint8 picture of shape (height, width, 3) in the window, and wait for ``pause`` seconds."""
        self._axes.clear()
        self._axes.set_axis_off()
        self._axes.imshow(picture)
        if self._figure.canvas.required_interactive_framework is not None:  # a display exists
            plt.pause(pause)

    def close(self) -> None:
        """Close the window."""
        plt.close(self._figure)
