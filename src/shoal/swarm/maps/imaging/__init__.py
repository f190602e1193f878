"""Vessel segmentation of photographs, and conversion of the vessels to a map of free cells.

The steps are: take the green channel; find the field of view (a fundus photograph has a dark surround); subtract the background (a
median over a wide window); apply line detectors and ridge filters; apply thresholds with hysteresis; convert the pixels to cells.
This package needs scikit-image, which the extra ``shoal[imaging]`` installs.
"""

from shoal.swarm.maps.imaging.network import map_of_vessels, pixels_a_cell, segment_vessels
from shoal.swarm.maps.imaging.segmentation import HIGH, LOW, VesselFinder, Vessels, find_vessels

__all__ = ["HIGH", "LOW", "VesselFinder", "Vessels", "find_vessels", "map_of_vessels", "pixels_a_cell", "segment_vessels"]
