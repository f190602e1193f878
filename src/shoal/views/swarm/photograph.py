"""The photograph from which a map was read, under pictures of the map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from shoal.core.errors import ShoalError
from shoal.core.notices import tell_once
from shoal.swarm import SwarmEpisode
from shoal.swarm.maps.files import vessel_map

_UNDER = 0.55  # how much of the photograph shows through unknown cells and obstacles
_THROUGH = 0.25  # and through all others


class PhotographBelow:
    """A photograph under pictures of a map, all of one size.

    Parameters
    ----------
    pixels : ndarray of uint8, shape (height, width, 3)
        What of the photograph is under a picture.
    """

    def __init__(self, pixels: NDArray[np.uint8]) -> None:
        self._pixels = pixels
        self._seen = [np.floor(share * pixels).astype(np.uint8) for share in (_THROUGH, _UNDER)]

    @classmethod
    def of(
        cls, episode: SwarmEpisode, size: tuple[int, int], cell: float
    ) -> PhotographBelow | None:
        """Return the photograph under pictures of an episode's plane map, or None if the map was
        not read from a photograph, or the photograph is not there any more.

        Parameters
        ----------
        episode : SwarmEpisode
        size : (int, int)
            Width and height of the pictures, with the rim of one cell around the map.
        cell : float
            Side of a cell in pixels.
        """
        problem = episode.problem
        if not problem.vessels or not isinstance(problem.map, str):
            return None
        try:
            left, top, right, bottom = vessel_map(problem.map, **problem.reading).picture_box
            with Image.open(problem.map) as opened:
                upright = ImageOps.exif_transpose(opened).convert("RGB")
            # the last cell may be partly beside the photograph
            box = left, top, min(right, upright.width), min(bottom, upright.height)
        except (OSError, ShoalError) as error:
            tell_once(f"film: no photograph under the map: {error}")
            return None
        # the rim around the map shows no photograph but its last pixels
        width, height = (max(1, round(side - 2 * cell)) for side in size)
        inner = np.asarray(upright.resize((width, height), Image.Resampling.BICUBIC, box=box))
        rim = [
            ((full - side) // 2, full - side - (full - side) // 2)
            for full, side in ((size[1], height), (size[0], width))
        ]
        return cls(np.pad(inner, (*rim, (0, 0)), mode="edge"))

    def under(
        self,
        colours: NDArray[np.uint8],
        solid: NDArray[np.bool_],
        resampling: Image.Resampling = Image.Resampling.NEAREST,
    ) -> NDArray[np.uint8]:
        """Return the picture of a map on the photograph; uint8, shape (height, width, 3).

        Parameters
        ----------
        colours : ndarray of uint8, shape (H, W, 3)
            The colour of each cell, with the rim.
        solid : ndarray of bool, shape (H, W)
            Cells that hide more of the photograph.
        resampling : PIL.Image.Resampling
            How the colours are enlarged or reduced to the size of the pictures.
        """
        size = self._pixels.shape[1::-1]
        shares = np.where(solid, 1.0 - _THROUGH, 1.0 - _UNDER)[..., None]
        dimmed = Image.fromarray(np.floor(shares * colours).astype(np.uint8))
        over = np.asarray(dimmed.resize(size, resampling))
        covered = np.asarray(Image.fromarray(solid).resize(size, Image.Resampling.NEAREST))
        picture = np.where(covered[..., None], *self._seen)
        return np.asarray(np.add(picture, over, out=picture))

    def shade(self, colour: tuple[int, ...], solid: bool) -> tuple[int, ...]:
        """Return what the colour of cells looks like on the photograph's median colour: cells
        that hide more of the photograph (solid), or others.
        """
        median, through = np.median(self._pixels, axis=(0, 1)), _THROUGH if solid else _UNDER
        return tuple(
            round(through * below + (1.0 - through) * over)
            for below, over in zip(median, colour, strict=True)
        )
