"""Forms of observations: pictures and vectors, for learning programs that accept one array only."""

from __future__ import annotations

from math import prod
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

from shoal.envs.options import OptionError

LEAST_SIDE = 36
"""Smallest side of an image: the smallest that the usual three convolutions accept (Mnih et al.,
Human-level control through deep reinforcement learning, Nature 518, 2015).
"""

MOST_PLANES = 256


class Form:
    """The observations of a batch, in the form in which the simulation gives them.

    Parameters
    ----------
    source : gymnasium.Space
        Space of one observation of the simulation.

    Attributes
    ----------
    space : gymnasium.Space
        Space of one observation in this form.
    """

    same = True
    """Whether this form is that of the simulation."""

    def __init__(self, source: gymnasium.Space[Any]) -> None:
        self.space = source

    def __call__(self, batch: Any) -> Any:
        """Return observations, stacked along the first axis, in this form."""
        return batch


class FlatForm(Form):
    """All numbers of an observation along one axis, as float32, in the order of
    `gymnasium.spaces.flatten`.
    """

    same = False

    def __init__(self, source: gymnasium.Space[Any]) -> None:
        flat = gymnasium.spaces.flatten_space(source)
        assert isinstance(flat, Box)
        # Rounding keeps the order of numbers, so rounded numbers are within rounded bounds.
        low, high = (bound.astype(np.float32) for bound in (flat.low, flat.high))
        self.space = Box(low, high, dtype=np.float32)
        self._names = tuple(source.spaces) if isinstance(source, Dict) else ()

    def __call__(self, batch: Any) -> NDArray[np.float32]:
        """Return observations as an array of shape (observations, numbers)."""
        arrays = [batch[name] for name in self._names] or [batch]
        rows = [array.reshape(len(array), -1).astype(np.float32) for array in arrays]
        return rows[0] if len(rows) == 1 else np.concatenate(rows, axis=1)


class ImageForm(Form):
    """The planes of an observation as the channels of a picture; uint8, shape (channels, height,
    width).

    Each channel is scaled so that the largest value of its plane becomes 255. The layers of a plane
    in three dimensions become channels. Cells are added below and at the right, so that each side
    has at least `LEAST_SIDE` cells and as many as there are channels; from the shape, programs then
    tell which axis holds the channels.

    Parameters
    ----------
    source : gymnasium.Space
        A Box with the planes, or a Dict with the entry "planes", and perhaps the entry "likely":
        probabilities, which become further channels, in which the likeliest cell has the value 255.
        An image leaves out other entries.
    dimensions : int
        Number of dimensions of the grid, which has the last axes of the planes.
    beyond : sequence of int
        Value of each plane, 0 or 1, in the cells that are added.
    """

    same = False

    def __init__(
        self, source: gymnasium.Space[Any], dimensions: int, beyond: tuple[int, ...]
    ) -> None:
        self._nested = isinstance(source, Dict)
        planes: Any = source["planes"] if isinstance(source, Dict) else source
        *layers, height, width = planes.shape[-dimensions:]
        self._likely = isinstance(source, Dict) and "likely" in source.spaces
        certain = prod(planes.shape[:-2])
        channels = certain + self._likely * prod(layers)
        if channels > MOST_PLANES:
            raise OptionError(
                f"observation: expected an image of at most {MOST_PLANES} planes, got {channels}"
                " (choose another observation)"
            )
        self._size = height, width
        self._scale = 255 / planes.high.reshape(certain, height, width).max(axis=(1, 2))
        self._scale = self._scale.reshape(certain, 1, 1)
        whole = np.all(self._scale % 1 == 0) and planes.dtype == np.uint8
        if whole:
            self._scale = self._scale.astype(np.uint8)
        sides = [max(side, LEAST_SIDE, channels) for side in self._size]
        filling = np.repeat(255 * np.array(beyond, dtype=np.uint8), prod(layers))
        outside = np.zeros(channels, dtype=np.uint8)
        outside[:certain] = np.tile(filling, certain // len(filling))
        self._empty = np.broadcast_to(outside[:, None, None], (channels, *sides))
        self.space = Box(0, 255, self._empty.shape, np.uint8)

    def __call__(self, batch: Any) -> NDArray[np.uint8]:
        """Return observations as an array of shape (observations, channels, height, width)."""
        planes = batch["planes"] if self._nested else batch
        height, width = self._size
        planes = planes.reshape(len(planes), -1, height, width)
        images = np.empty((len(planes), *self._empty.shape), dtype=np.uint8)
        images[..., height:, :] = self._empty[:, height:]
        images[..., :height, width:] = self._empty[:, :height, width:]
        known = images[:, : planes.shape[1], :height, :width]
        if self._scale.dtype == np.uint8:
            np.multiply(planes, self._scale, out=known)
        else:
            known[:] = np.rint(planes * self._scale)
        if self._likely:
            odds = batch["likely"].reshape(len(planes), -1, height, width)
            most = odds.max(axis=(1, 2, 3), keepdims=True)
            images[:, planes.shape[1] :, :height, :width] = np.rint(
                255 * (odds / np.maximum(most, np.finfo(np.float32).tiny))
            )
        return images


def observation_form(
    name: str, source: gymnasium.Space[Any], *, dimensions: int = 2, beyond: tuple[int, ...] = (0,)
) -> Form:
    """Return the form with the name of an option ``observation``."""
    if name == "image":
        return ImageForm(source, dimensions, beyond)
    return FlatForm(source) if name == "flat" else Form(source)
