"""Pictures of environments: render modes, and a window for people."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import shortened

Picture = NDArray[np.uint8]

MODES = ["rgb_array", "ansi", "human"]
SIDE = 480
"""Approximate length in pixels of a picture's larger side."""


def check_render_mode(render_mode: str | None, known: list[str]) -> str | None:
    """Return the given render mode. An unknown render mode raises UnsupportedMode, as
    in Gymnasium.
    """
    if render_mode is not None and render_mode not in known:
        raise gymnasium.error.UnsupportedMode(
            f"render_mode: expected one of {', '.join(known)}, got {shortened(render_mode)}"
        )
    return render_mode


def rendered(env: Any, picture: Callable[[], Picture], text: Callable[[], str]) -> Any:
    """Return the result of ``env.render()`` for the render mode of the environment.

    In the render mode "human", the function shows the picture in a window and returns None.

    Raises
    ------
    gymnasium.error.UnsupportedMode
        If the environment has no render mode.
    """
    if env.render_mode == "rgb_array":
        return picture()
    if env.render_mode == "ansi":
        return text()
    if env.render_mode is None:
        raise gymnasium.error.UnsupportedMode(
            f"render: expected a render_mode, one of {', '.join(MODES)}, got an environment without"
            " a render_mode"
        )
    if getattr(env, "_live_window", None) is None:
        from shoal.views.drawing.encoding import LiveWindow

        env._live_window = LiveWindow(type(env).__name__)
    env._live_window.show(picture(), pause=1 / env.metadata["render_fps"])
    return None


def close_window(env: Any) -> None:
    """Close the window of an environment if the environment has opened one."""
    if getattr(env, "_live_window", None) is not None:
        env._live_window.close()
        env._live_window = None


def enlarged(raster: Picture) -> Picture:
    """Enlarge a picture with one pixel per cell by a whole factor, so that its longer side has
    about `SIDE` pixels.
    """
    times = max(1, SIDE // max(raster.shape[:2]))
    return raster.repeat(times, axis=0).repeat(times, axis=1)
