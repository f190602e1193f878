"""Vessel segmentation of photographs, and conversion of the vessels to a map of free cells.

The steps are: take the green channel; find the field of view (a fundus photograph has a dark surround); subtract the background (a
median over a wide window); apply line detectors and ridge filters; apply thresholds with hysteresis; convert the pixels to cells.
This package needs scikit-image, which the extra ``shoal[imaging]`` installs.
"""

from shoal.swarm.maps.imaging.centre_lines import CentreLines, Segment, centre_lines
from shoal.swarm.maps.imaging.network import map_of_vessels, pixels_a_cell, segment_vessels
from shoal.swarm.maps.imaging.segmentation import HIGH, LOW, VesselFinder, Vessels, find_vessels
from shoal.swarm.maps.imaging.vessel_statistics import VesselStatistics, box_dimension, murray_exponents, vessel_statistics

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
    "find_vessels",
    "map_of_vessels",
    "murray_exponents",
    "pixels_a_cell",
    "segment_vessels",
    "vessel_statistics",
]
