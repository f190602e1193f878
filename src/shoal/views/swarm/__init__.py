"""Views of swarm episodes: figures of maps and frontiers, films, the data of the player page, and
charts of the theory.
"""

from lazy_loader import attach

__getattr__, __dir__, __all__ = attach(__name__, submodules=["figures", "films", "page"])
