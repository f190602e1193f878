"""Missions for real vehicles: how Shoal creates them from routes, writes and reads them in six
formats, and checks them.

Python imports a name of this package only when a program first uses the name, because commands need
only the options of missions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from shoal.core.registry import loaded_on_use

if TYPE_CHECKING:
    from shoal.missions.checking import MissionCheck
    from shoal.missions.diagnostics import RULES, Diagnostic, Rule
    from shoal.missions.files import mission_files, read_mission, write_missions
    from shoal.missions.formats import FORMATS, MissionFormat
    from shoal.missions.linting import lint
    from shoal.missions.mission import CAPS, Mission, split_missions
    from shoal.missions.mission_set import MissionSet, check_missions
    from shoal.missions.options import CheckOptions, MissionOptions
    from shoal.search.flight.dubins import Airspace
    from shoal.search.flight.flight import Altitudes, Flight

_HOMES = {
    "checking": ("MissionCheck",),
    "diagnostics": ("RULES", "Diagnostic", "Rule"),
    "files": ("mission_files", "read_mission", "write_missions"),
    "formats": ("FORMATS", "MissionFormat"),
    "linting": ("lint",),
    "mission": ("CAPS", "Airspace", "Altitudes", "Flight", "Mission", "split_missions"),
    "mission_set": ("MissionSet", "check_missions"),
    "options": ("CheckOptions", "MissionOptions"),
}

__all__ = [
    "CAPS",
    "FORMATS",
    "RULES",
    "Airspace",
    "Altitudes",
    "CheckOptions",
    "Diagnostic",
    "Flight",
    "Mission",
    "MissionCheck",
    "MissionFormat",
    "MissionOptions",
    "MissionSet",
    "Rule",
    "check_missions",
    "lint",
    "mission_files",
    "read_mission",
    "split_missions",
    "write_missions",
]

__getattr__ = loaded_on_use(__name__, _HOMES)


def __dir__() -> list[str]:
    return __all__
