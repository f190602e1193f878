"""Missions for real vehicles: how Shoal creates them from routes, writes and reads them in six
formats, and checks them.

Python imports a name of this package only when a program first uses the name, because commands need
only the options of missions.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
