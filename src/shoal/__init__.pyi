"""Public names, which `lazy_loader` imports when they are first used."""

from .core.episode import Episode as Episode, Status as Status, Verification as Verification
from .core.errors import (
    InvalidInputError as InvalidInputError,
    MissingExtraError as MissingExtraError,
    OutputError as OutputError,
    RigError as RigError,
    ShoalError as ShoalError,
    UnknownNameError as UnknownNameError,
)
from .core.problem import Problem as Problem
from .core.version import __version__ as __version__
from .lab import run_trials as run_trials
from .parts import load as load, load_problem as load_problem, run as run
from .search import SearchProblem as SearchProblem, open_region as open_region
from .steering import SteeringProblem as SteeringProblem, open_workspace as open_workspace
from .swarm import GridWorkspace as GridWorkspace, SwarmProblem as SwarmProblem
from .swarm.maps.files import open_map as open_map, read_map as read_map, write_map as write_map
from .views import figure as figure, film as film
