"""Exhaustive search by robots without a coordinator, along one closed tour."""

from __future__ import annotations

from shoal.search.tours import (
    Tour,
    TourMaker,
    TourMetrics,
    components,
    hilbert_decode,
    hilbert_encode,
    make_tour,
    moore_decode,
    moore_encode,
)

__all__ = [
    "Tour",
    "TourMaker",
    "TourMetrics",
    "components",
    "hilbert_decode",
    "hilbert_encode",
    "make_tour",
    "moore_decode",
    "moore_encode",
]
