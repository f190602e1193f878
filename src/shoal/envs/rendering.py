"""What environments show: pictures, texts, and a window that keeps up with the episode."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]

MODES = ["rgb_array", "ansi", "human"]
SIDE = 480
"""Pixels of the larger side of a picture, about."""


def rendered(env: Any, picture: Callable[[], Picture], text: Callable[[], str]) -> Any:
    """Return what ``env.render()`` returns in the environment's mode; in mode human the window shows the picture.

    Raises
    ------
    gymnasium.error.UnsupportedMode
        If the environment was made without a mode.
    """
    if env.render_mode == "rgb_array":
        return picture()
    if env.render_mode == "ansi":
        return text()
    if env.render_mode is None:
        raise gymnasium.error.UnsupportedMode(
            f"render: expected a render_mode, one of {', '.join(MODES)}, got an environment without"
        )
    if getattr(env, "_live_window", None) is None:
        from shoal.views.drawing.live_window import LiveWindow

        env._live_window = LiveWindow(type(env).__name__)
    env._live_window.show(picture(), pause=1 / env.metadata["render_fps"])
    return None


def close_window(env: Any) -> None:
    """Close the window of an environment, if it has one."""
    if getattr(env, "_live_window", None) is not None:
        env._live_window.close()
        env._live_window = None


def enlarged(raster: Picture) -> Picture:
    """Return a picture of one pixel a cell with the pixels repeated, until it is about `SIDE` wide or high."""
    times = max(1, SIDE // max(raster.shape[:2]))
    return raster.repeat(times, axis=0).repeat(times, axis=1)
