"""Views of steering episodes: figures of plans and of reachable sets, films, and the data of the
player page.
"""

from lazy_loader import attach

__getattr__, __dir__, __all__ = attach(__name__, submodules=["figures", "films", "page"])
