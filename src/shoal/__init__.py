"""Shoal simulates and plans for groups of simple robots: mapping with swarms, steering with one shared input, multi-robot search.

The function `run` runs a problem of any part (swarm, steering or search) and returns an episode, the record of the run:

>>> import shoal
>>> episode = shoal.run("line:9", particles=3)
>>> episode.status.done, bool(episode.verify())
(True, True)

The statement ``import shoal`` takes little time, because Shoal loads each part of the library only when it is used.
"""

from __future__ import annotations

import sys

if sys.argv[:1] == ["-m"] and not sys.flags.safe_path:
    # `python -m shoal` puts the current folder first on the search path, where a file could replace a module of Python.
    del sys.path[0]
# Only a command handles signals from here on. Worker processes have the same arguments but do not.
if sys.argv and (sys.argv[0] == "-m" or sys.argv[0].endswith("/shoal")) and "multiprocessing" not in sys.modules:
    import _signal  # type: ignore[import-not-found]  # signal takes some milliseconds, in which Ctrl-C would be told as a traceback

    if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
        _signal.signal(_signal.SIGINT, _signal.SIG_DFL)
    from shoal.core.interruption import begin

    begin()

from typing import TYPE_CHECKING

from shoal.core.registry import loaded_on_use
from shoal.core.version import __version__

if TYPE_CHECKING:
    from shoal.core.episode import Episode, Status, Verification
    from shoal.core.errors import InvalidInputError, MissingExtraError, OutputError, RigError, ShoalError, UnknownNameError
    from shoal.core.parts import load, load_problem, run
    from shoal.core.problem import Problem
    from shoal.lab import run_trials
    from shoal.search import SearchProblem, open_region
    from shoal.steering import SteeringProblem, open_workspace
    from shoal.swarm import GridWorkspace, SwarmProblem
    from shoal.swarm.maps.files import read_map, write_map
    from shoal.swarm.maps.open import open_map
    from shoal.views import figure, film

_HOMES = {
    "core.episode": ("Episode", "Status", "Verification"),
    "core.errors": ("InvalidInputError", "MissingExtraError", "OutputError", "RigError", "ShoalError", "UnknownNameError"),
    "core.parts": ("load", "load_problem", "run"),
    "core.problem": ("Problem",),
    "lab": ("run_trials",),
    "search": ("SearchProblem", "open_region"),
    "steering": ("SteeringProblem", "open_workspace"),
    "swarm": ("GridWorkspace", "SwarmProblem"),
    "swarm.maps.files": ("read_map", "write_map"),
    "swarm.maps.open": ("open_map",),
    "views": ("figure", "film"),
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


__getattr__ = loaded_on_use(__name__, _HOMES)


def __dir__() -> list[str]:
    return __all__
