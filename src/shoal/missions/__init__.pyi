"""Public names, which `lazy_loader` imports when they are first used."""

from .checking import MissionCheck as MissionCheck
from .diagnostics import RULES as RULES
from .diagnostics import Diagnostic as Diagnostic
from .diagnostics import Rule as Rule
from .files import mission_files as mission_files
from .files import read_mission as read_mission
from .files import write_missions as write_missions
from .formats import FORMATS as FORMATS
from .formats import MissionFormat as MissionFormat
from .linting import lint as lint
from .mission import CAPS as CAPS
from .mission import Mission as Mission
from .mission import split_missions as split_missions
from .mission_set import MissionSet as MissionSet
from .mission_set import check_missions as check_missions
from .options import CheckOptions as CheckOptions
from .options import MissionOptions as MissionOptions
