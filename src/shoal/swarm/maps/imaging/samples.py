"""Photographs for demonstrations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import MissingExtraError


def retina() -> NDArray[np.uint8]:
    """Return the photograph of a retina that scikit-image contains (CC0), as a uint8 array of shape
    (1411, 1411, 3).

    Raises
    ------
    MissingExtraError
        Raised if scikit-image is not installed.
    """
    try:
        from skimage import data
    except ImportError:
        raise MissingExtraError(
            "the photograph of an eye needs scikit-image: pip install 'shoal[imaging]'"
        ) from None
    # scikit-image gives no types
    photograph: NDArray[np.uint8] = data.retina()  # type: ignore[no-untyped-call]
    return photograph
