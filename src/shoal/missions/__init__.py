"""Missions for real vehicles: how Shoal creates them from routes, writes and reads them in six
formats, and checks them.
"""

from __future__ import annotations

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
