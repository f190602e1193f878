"""Public names, which `lazy_loader` imports when they are first used."""

from .core.episode import Episode as Episode
from .core.episode import Status as Status
from .core.episode import Verification as Verification
from .core.errors import (
    InvalidInputError as InvalidInputError,
)
from .core.errors import (
    MissingExtraError as MissingExtraError,
)
from .core.errors import (
    OutputError as OutputError,
)
from .core.errors import (
    RigError as RigError,
)
from .core.errors import (
    ShoalError as ShoalError,
)
from .core.errors import (
    UnknownNameError as UnknownNameError,
)
from .core.problem import Problem as Problem
from .core.version import __version__ as __version__
from .lab import run_trials as run_trials
from .parts import load as load
from .parts import load_problem as load_problem
from .parts import run as run
from .search import SearchProblem as SearchProblem
from .search import open_region as open_region
from .steering import SteeringProblem as SteeringProblem
from .steering import open_workspace as open_workspace
from .swarm import GridWorkspace as GridWorkspace
from .swarm import SwarmProblem as SwarmProblem
from .swarm.maps.files import open_map as open_map
from .swarm.maps.files import read_map as read_map
from .swarm.maps.files import write_map as write_map
from .views import figure as figure
from .views import film as film
