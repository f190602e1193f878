"""Segmentation of the vessels in a photograph, and conversion of the vessels to a map of free
cells.

The package takes the green channel of a photograph and finds the field of view inside the black or
white surround. The package subtracts the background of the photograph, which is the median over a
wide window. Line detectors and ridge filters compute how much each pixel looks like part of a
vessel. A lower and an upper threshold select the vessel pixels, which become the free cells of the
map. The package `imaging` needs scikit-image, which the extra ``shoal[imaging]`` installs.
"""

from shoal.swarm.maps.imaging.network import (
    CentreLines,
    Segment,
    centre_lines,
    dropped_parts,
    dropped_text,
    map_of_vessels,
    pixels_a_cell,
    place_of_network,
    segment_vessels,
)
from shoal.swarm.maps.imaging.segmentation import HIGH, LOW, VesselFinder, Vessels, find_vessels
from shoal.swarm.maps.imaging.vessel_statistics import (
    VesselStatistics,
    box_dimension,
    murray_exponents,
    vessel_statistics,
)

__all__ = [
    "HIGH",
    "LOW",
    "CentreLines",
    "Segment",
    "VesselFinder",
    "VesselStatistics",
    "Vessels",
    "box_dimension",
    "centre_lines",
    "dropped_parts",
    "dropped_text",
    "find_vessels",
    "map_of_vessels",
    "murray_exponents",
    "pixels_a_cell",
    "place_of_network",
    "segment_vessels",
    "vessel_statistics",
]
