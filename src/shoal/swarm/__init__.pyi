"""Public names, which `lazy_loader` imports when they are first used."""

from .episode import SwarmEpisode as SwarmEpisode
from .grid.board import RULES as RULES
from .grid.board import Board as Board
from .grid.board import GridLayout as GridLayout
from .grid.state import Belief as Belief
from .grid.state import SwarmState as SwarmState
from .grid.tasks import (
    PLACEMENTS as PLACEMENTS,
)
from .grid.tasks import (
    TASKS as TASKS,
)
from .grid.tasks import (
    Coverage as Coverage,
)
from .grid.tasks import (
    Gathering as Gathering,
)
from .grid.tasks import (
    Mapping as Mapping,
)
from .grid.tasks import (
    SubsetCoverage as SubsetCoverage,
)
from .grid.tasks import (
    Task as Task,
)
from .grid.tasks import (
    make_task as make_task,
)
from .grid.tasks import (
    place as place,
)
from .grid.world import GridWorld as GridWorld
from .maps.workspace import GridWorkspace as GridWorkspace
from .policies import (
    POLICIES as POLICIES,
)
from .policies import (
    Policy as Policy,
)
from .policies import (
    View as View,
)
from .policies import (
    make_policy as make_policy,
)
from .problem import SwarmProblem as SwarmProblem
