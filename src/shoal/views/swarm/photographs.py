"""Pictures of the vessels in a photograph: the mask of the vessels, and the outline of the mask on the photograph."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from shoal.core.files import atomic

OUTLINE = (64, 255, 96)  # a colour that does not occur in an eye


def mask_picture(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return a vessel mask as a picture with white vessels on black; uint8, shape (H, W)."""
    return np.asarray(mask, dtype=np.uint8) * np.uint8(255)


def overlay_picture(photograph: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the photograph with the outline of the mask drawn just outside the vessels; uint8, shape (H, W, 3)."""
    drawn = np.array(photograph if photograph.ndim == 3 else np.dstack([photograph] * 3))
    wide = max(1, round(max(mask.shape) / 1000))
    drawn[ndimage.binary_dilation(mask, np.ones((3, 3)), iterations=wide) & ~mask] = OUTLINE
    return drawn


def beside(photograph: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return a picture: the photograph on the left, its vessels in white on the right; uint8, shape (H, 2 W + gap, 3)."""
    gap = np.full((mask.shape[0], max(1, mask.shape[1] // 50), 3), 255, dtype=np.uint8)
    colours = photograph if photograph.ndim == 3 else np.dstack([photograph] * 3)
    return np.hstack([colours, gap, np.dstack([mask_picture(mask)] * 3)])


def save_picture(picture: NDArray[Any], path: Path) -> Path:
    """Write a uint8 picture of shape (H, W) or (H, W, 3) to a file, and return the path of the file.

    The suffix of ``path`` determines the format.

    Raises
    ------
    OutputError
    """
    encoded = io.BytesIO()  # Pillow does not detect a partial write on a full disk
    jpeg = path.suffix.lower() in {".jpg", ".jpeg"}
    Image.fromarray(picture).save(encoded, format="JPEG" if jpeg else "PNG", **({"quality": 90} if jpeg else {}))
    with atomic(path) as temporary:
        temporary.write_bytes(encoded.getvalue())
    return path
