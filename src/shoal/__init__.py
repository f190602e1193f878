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
    from shoal.core.episode import Episode, Status, Verification
    from shoal.core.errors import (
        InvalidInputError,
        MissingExtraError,
        OutputError,
        RigError,
        ShoalError,
        UnknownNameError,
    )
    from shoal.core.problem import Problem
    from shoal.core.version import __version__
    from shoal.lab import run_trials
    from shoal.parts import load, load_problem, run
    from shoal.search import SearchProblem, open_region
    from shoal.steering import SteeringProblem, open_workspace
    from shoal.swarm import GridWorkspace, SwarmProblem
    from shoal.swarm.maps.files import open_map, read_map, write_map
    from shoal.views import figure, film

_HOMES = {
    "core.episode": (
        "Episode",
        "Status",
        "Verification",
    ),
    "core.errors": (
        "InvalidInputError",
        "MissingExtraError",
        "OutputError",
        "RigError",
        "ShoalError",
        "UnknownNameError",
    ),
    "core.problem": ("Problem",),
    "core.version": ("__version__",),
    "lab": ("run_trials",),
    "parts": (
        "load",
        "load_problem",
        "run",
    ),
    "search": (
        "SearchProblem",
        "open_region",
    ),
    "steering": (
        "SteeringProblem",
        "open_workspace",
    ),
    "swarm": (
        "GridWorkspace",
        "SwarmProblem",
    ),
    "swarm.maps.files": (
        "open_map",
        "read_map",
        "write_map",
    ),
    "views": (
        "figure",
        "film",
    ),
}

__all__ = [
    "Episode",
    "GridWorkspace",
    "InvalidInputError",
    "MissingExtraError",
    "OutputError",
    "Problem",
    "RigError",
    "SearchProblem",
    "ShoalError",
    "Status",
    "SteeringProblem",
    "SwarmProblem",
    "UnknownNameError",
    "Verification",
    "__version__",
    "figure",
    "film",
    "load",
    "load_problem",
    "open_map",
    "open_region",
    "open_workspace",
    "read_map",
    "run",
    "run_trials",
    "write_map",
]


def _draw_page(episode: "Episode") -> object:
    from shoal.views import notebook_page

    return notebook_page(episode)


def _draw_layers(workspace: "GridWorkspace") -> object:
    from shoal.views.swarm.volume import notebook_picture

    return notebook_picture(workspace)


register_display("html", _draw_page)
register_display("png", _draw_layers)


def __getattr__(name: str) -> object:
    from shoal.core.registry import loaded_on_use

    return loaded_on_use(__name__, _HOMES)(name)


def __dir__() -> list[str]:
    return __all__
