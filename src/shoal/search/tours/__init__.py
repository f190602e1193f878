"""Tours by name, and conversion between cells and their indices on the Hilbert and Moore curves."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import shoal.search.tours.headland  # noqa: F401 - registers tours, as the modules `rows` and `curves` do
from shoal.core.errors import InvalidInputError
from shoal.core.registry import configured
from shoal.search.tours.curves import join_layers
from shoal.search.tours.masks import check_mask, components
from shoal.search.tours.tour import (
    TOURS,
    Tour,
    TourMaker,
    TourMetrics,
    check_covers,
    hilbert_decode,
    hilbert_encode,
    moore_decode,
    moore_encode,
)

__all__ = [
    "TOURS",
    "Tour",
    "TourMaker",
    "TourMetrics",
    "components",
    "find_tour_maker",
    "hilbert_decode",
    "hilbert_encode",
    "make_tour",
    "moore_decode",
    "moore_encode",
]


def make_tour(maker: str | TourMaker, mask_or_shape: Any) -> Tour:
    """Return a tour through all cells of a mask.

    Parameters
    ----------
    maker : str or TourMaker
        A name in the registry ``TOURS``, such as "spanning-tree", or an object with the methods of
        `TourMaker`. A text of the form "module:attribute" names a tour maker object, or a class
        that Shoal calls without arguments.
    mask_or_shape : array_like of bool, shape (H, W) or (L, H, W); or a tuple of 2 or 3 int
        A mask that is True for the cells to visit, with row 0 on top, or the shape of a full
        rectangle or box. For a 3-D mask, the names "hilbert", "open-hilbert" and
        "hilbert-rectangle" give 3-D curves. With any other name, Shoal computes a plane tour of
        each layer, and joins these tours.

    Returns
    -------
    Tour
        A tour that visits each True cell once. The tour finishes each connected component of the
        mask before it starts another component.

    Examples
    --------
    >>> tour = make_tour("moore", (8, 8))
    >>> len(tour), tour.closed, tour.metrics().closing_edge
    (64, True, 1.0)
    >>> make_tour("hilbert", (8, 8)).metrics().closing_edge
    7.0
    """
    mask = check_mask(mask_or_shape)
    chosen = find_tour_maker(maker)
    if mask.ndim in chosen.dimensions:
        return _make(chosen, mask)
    layers = np.flatnonzero(mask.any(axis=(1, 2))).tolist()
    tour = join_layers([_make(chosen, mask[layer]) for layer in layers], layers=layers)
    return check_covers(Tour(tour.cells, mask.shape, closed=tour.closed, name=tour.name), mask)


def _make(maker: TourMaker, mask: NDArray[np.bool_]) -> Tour:
    tour = maker.make(mask)
    if not isinstance(tour, Tour):
        raise InvalidInputError(
            f"tour {maker.name}: expected make() to return a Tour, got {type(tour).__name__}"
        )
    return check_covers(tour, mask)


def find_tour_maker(maker: str | TourMaker) -> TourMaker:
    """Return the tour maker that a name or a text of the form ``module:attribute`` describes.

    The function returns a tour maker object unchanged.
    """
    factory: Any = configured(TOURS, maker) if isinstance(maker, str) else maker
    try:
        instance = factory() if isinstance(factory, type) else factory
    except TypeError as error:
        raise InvalidInputError(
            f"the tour {maker!r}: expected a class without arguments: {error}"
        ) from None
    if not isinstance(instance, TourMaker):
        raise InvalidInputError(
            f"the tour {maker!r}: expected name, dimensions and make(mask), got"
            f" {type(instance).__name__}"
        )
    return instance
