"""RecordVideo: videos of episodes, written by Shoal's encoder."""

from __future__ import annotations

from contextlib import suppress
from inspect import signature
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from shoal.core.errors import InvalidInputError

QUALITY = 23
"""Constant rate factor of H.264 for videos."""


class RecordVideo(gymnasium.wrappers.RecordVideo):
    """Gymnasium's wrapper RecordVideo without the library MoviePy: Shoal encodes the videos.

    Parameters
    ----------
    env : gymnasium.Env
        An environment with the render mode "rgb_array".
    *args, **options
        The other parameters of `gymnasium.wrappers.RecordVideo`.

    Raises
    ------
    InvalidInputError
        If ``disable_logger`` is False: the encoder has no logger.

    Notes
    -----
    See docs/how-to/environments.md.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], *args: Any, **options: Any) -> None:
        given = signature(super().__init__).bind(env, *args, **options).arguments
        if not given.get("disable_logger", True):
            raise InvalidInputError("disable_logger: expected True (the encoder has no logger)")
        # Gymnasium looks for MoviePy when all else is set up.
        with suppress(gymnasium.error.DependencyNotInstalled):
            super().__init__(env, *args, **options)

    def stop_recording(self) -> None:
        """Stop the recording, and write its video."""
        from shoal.views.drawing.encoding import write_mp4

        frames, self.recorded_frames = self.recorded_frames, []
        if frames:
            path = Path(self.video_folder, f"{self._video_name}.mp4")
            pictures = (np.asarray(frame, dtype=np.uint8) for frame in frames)
            write_mp4(path, pictures, self.frames_per_sec, quality=QUALITY)
        self.recording, self._video_name = False, None
