"""Views of searches: figures of routes, timelines and tours, films, and the data of the player
page.
"""

from lazy_loader import attach

__getattr__, __dir__, __all__ = attach(__name__, submodules=["figures", "films", "page"])
