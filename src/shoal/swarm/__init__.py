"""Mapping and coverage by a swarm of particles on a grid. One command moves all particles.

The package `shoal.swarm` imports each public name when it is first used.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
