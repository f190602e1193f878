"""Public names, which `lazy_loader` imports when they are first used."""

from .episode import SwarmEpisode as SwarmEpisode
from .grid.board import RULES as RULES, Board as Board, GridLayout as GridLayout
from .grid.state import Belief as Belief, SwarmState as SwarmState
from .grid.tasks import (
    PLACEMENTS as PLACEMENTS,
    TASKS as TASKS,
    Coverage as Coverage,
    Mapping as Mapping,
    SubsetCoverage as SubsetCoverage,
    Task as Task,
    make_task as make_task,
    place as place,
)
from .grid.world import GridWorld as GridWorld
from .maps.workspace import GridWorkspace as GridWorkspace
from .policies import (
    POLICIES as POLICIES,
    Policy as Policy,
    View as View,
    make_policy as make_policy,
)
from .problem import SwarmProblem as SwarmProblem
