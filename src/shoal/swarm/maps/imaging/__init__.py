"""Vessels in photographs: which pixels they are, and the map of free cells that they make.

The steps: the green channel; the field of view (a fundus photograph has a dark surround); what is darker than the ground, a wide
median; line detectors and long ridges; thresholds with hysteresis; cells. Needs scikit-image, the extra ``shoal[imaging]``.
"""

from shoal.swarm.maps.imaging.network import map_of_vessels, pixels_a_cell, segment_vessels
from shoal.swarm.maps.imaging.segmentation import HIGH, LOW, VesselFinder, Vessels, find_vessels

__all__ = ["HIGH", "LOW", "VesselFinder", "Vessels", "find_vessels", "map_of_vessels", "pixels_a_cell", "segment_vessels"]
