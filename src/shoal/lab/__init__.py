"""Experiments with many runs: trials of one problem, and sweeps over many problems.

The results of trials do not depend on the number of workers.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
