"""Common code of answers: places in a cache, and pictures."""

from __future__ import annotations

import base64
import io
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST_SHOWN = 1600
"""Maximum length in pixels of a photograph's larger side on a page."""

_places: dict[str, Any] = {}


def opened(problem: Any) -> Any:
    """Return the place of a problem: its map, workspace or region. A cache keeps eight places while their files are unchanged."""
    name = next(iter(problem.declarations()))
    path = getattr(problem, name)
    stamp = os.stat(path).st_mtime_ns if problem.place_is_file() else 0
    key = f"{stamp} {problem.place_key()}"
    if key not in _places:
        if len(_places) > 7:
            del _places[next(iter(_places))]
        _places[key] = problem.place
    return _places[key]


def fit_to_page(pixels: NDArray[Any]) -> NDArray[Any]:
    """Return every k-th pixel, so that the larger side is at most `LARGEST_SHOWN`."""
    step = -(-max(pixels.shape[:2]) // LARGEST_SHOWN)
    return pixels[::step, ::step]


def picture_of(pixels: NDArray[Any], kind: str) -> str:
    """Return pixels as a base64 JPEG or PNG picture."""
    from PIL import Image

    encoded = io.BytesIO()
    Image.fromarray(pixels).save(encoded, format=kind, **({"quality": 88} if kind == "JPEG" else {"compress_level": 1}))
    return base64_of(encoded.getvalue())


def picture_of_mask(mask: NDArray[np.bool_]) -> str:
    """Return a mask as a one-bit PNG: white where the mask is True, and transparent elsewhere."""
    from PIL import Image

    encoded = io.BytesIO()
    Image.fromarray(mask.astype(np.uint8) * 255).convert("1").save(encoded, format="PNG", transparency=0, compress_level=1)
    return base64_of(encoded.getvalue())


def base64_of(data: bytes) -> str:
    """Return bytes as base64 text for JSON."""
    return base64.b64encode(data).decode()
