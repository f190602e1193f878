"""Robots in the world: missions on board of vehicles that speak MAVLink.

Python imports a name of this package only when a program first uses the name, because few programs
need pymavlink (the extra ``mavlink``).
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
