"""The encoding of pictures in answers."""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST_SHOWN = 1600
"""Maximum length of the larger side of a photograph on a page, in pixels."""


def fit_to_page(pixels: NDArray[Any]) -> NDArray[Any]:
    """Return every k-th row and column of a picture, so that the result has at most `LARGEST_SHOWN`
    pixels on each side.
    """
    step = -(-max(pixels.shape[:2]) // LARGEST_SHOWN)
    return pixels[::step, ::step]


def picture_of(pixels: NDArray[Any], kind: str) -> str:
    """Return pixels as a JPEG or PNG picture, encoded in base64."""
    from PIL import Image

    encoded = io.BytesIO()
    Image.fromarray(pixels).save(
        encoded, format=kind, **({"quality": 88} if kind == "JPEG" else {"compress_level": 1})
    )
    return base64_of(encoded.getvalue())


def picture_of_mask(mask: NDArray[np.bool_]) -> str:
    """Return a mask as a one-bit PNG picture, which is white where the mask is True and transparent
    where it is False.
    """
    from PIL import Image

    encoded = io.BytesIO()
    Image.fromarray(mask.astype(np.uint8) * 255).convert("1").save(
        encoded, format="PNG", transparency=0, compress_level=1
    )
    return base64_of(encoded.getvalue())


def base64_of(data: bytes) -> str:
    """Return bytes as a base64 text, which JSON can contain."""
    return base64.b64encode(data).decode()
