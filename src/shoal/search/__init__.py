"""Exhaustive search of a region by robots without a coordinator, along one closed tour.

Python imports a name of this package only when a program first uses the name, because the import of
Numba takes long. The function `shoal.search.run.run` runs a `SearchProblem`.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
