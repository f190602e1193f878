"""Shoal simulates and plans for groups of simple robots: mapping with swarms, steering with one
shared input, multi-robot search.

The function `run` runs a problem of any part (swarm, steering or search) and returns an episode,
the record of the run:

>>> import shoal
>>> episode = shoal.run("line:9", particles=3)
>>> episode.status.done, bool(episode.verify())
(True, True)

The statement ``import shoal`` takes little time, because Shoal loads each part of the library only
when it is used.
"""

# No import of a module of Python's: `python -m shoal` puts the current folder first on the search
# path, where a file could replace it, until `shoal.__main__` runs.
from shoal.core.display import register_display

TYPE_CHECKING = False
if TYPE_CHECKING:
    from shoal.core.episode import Episode
    from shoal.swarm.maps.workspace import GridWorkspace


def _draw_page(episode: "Episode") -> object:
    from shoal.views import notebook_page

    return notebook_page(episode)


def _draw_layers(workspace: "GridWorkspace") -> object:
    from shoal.views.swarm.volume import notebook_picture

    return notebook_picture(workspace)


register_display("html", _draw_page)
register_display("png", _draw_layers)


def __getattr__(name: str) -> object:
    from lazy_loader import attach_stub

    load, _, names = attach_stub(__name__, __file__)  # the names of `__init__.pyi`
    return names if name == "__all__" else load(name)


def __dir__() -> object:
    return __getattr__("__all__")
