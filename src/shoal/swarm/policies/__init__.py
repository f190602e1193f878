"""Policies: methods that choose the next commands of a swarm.

The package imports each public name when it is first used: `POLICIES` lists the names of policies
without their kernels.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
"""Public names, which `lazy_loader` imports when they are first used."""
