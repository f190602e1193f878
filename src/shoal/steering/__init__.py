"""Steering of particles by one shared input, between walls that hold particles.

The package imports the module of a public name when a program first uses the name.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
