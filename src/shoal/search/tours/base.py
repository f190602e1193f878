"""The interface of tour makers, and the registry of all tour makers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.core.registry import Registry
from shoal.search.tours.masks import component_after_component, smallest_part
from shoal.search.tours.tour import Tour


@runtime_checkable
class TourMaker(Protocol):
    """An object that computes a tour through the cells of a grid.

    Attributes
    ----------
    name : str
        Name of the tour in reports and error messages.
    dimensions : tuple of int
        Numbers of dimensions of the masks that `make` accepts: (2,) or (2, 3).
    """

    name: str
    dimensions: tuple[int, ...]

    def make(self, mask: NDArray[np.bool_]) -> Tour:
        """Return a tour that visits each True cell of ``mask`` once.

        The mask has the shape (H, W) or (L, H, W), and at least one True cell.
        """
        ...


TOURS: Registry[type[TourMaker]] = Registry("tour")


class TourByOrder(ABC):
    """A tour maker that sorts the cells of each connected component, and visits one component after another."""

    name: str
    dimensions: tuple[int, ...] = (2,)
    closed = True

    def make(self, mask: NDArray[np.bool_]) -> Tour:
        """Return the tour through all True cells of the mask."""
        low, region = smallest_part(mask)
        cells = component_after_component(self._in_order(region), region)
        return Tour(cells + low, mask.shape, closed=self.closed, name=self.name)

    @abstractmethod
    def _in_order(self, region: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return all True cells of ``region`` in the order of the tour; int64, shape (N, dimensions)."""


def check_covers(tour: Tour, mask: NDArray[np.bool_]) -> Tour:
    """Return a tour unchanged if it visits all True cells of a mask and no other cells.

    Raises
    ------
    InvalidInputError
    """
    if tour.shape != mask.shape:
        raise InvalidInputError(f"tour {tour.name}: expected the shape {mask.shape} of the mask, got {tour.shape}")
    wrong = (tour.position >= 0) != mask
    if wrong.any():
        cell = tuple(int(index) for index in np.unravel_index(int(wrong.argmax()), mask.shape))
        does = "leaves out" if mask[cell] else "visits"
        raise InvalidInputError(f"tour {tour.name}: expected a tour of the True cells and no others, but it {does} cell {cell}")
    return tour
