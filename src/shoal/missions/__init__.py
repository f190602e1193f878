"""Missions for real vehicles: how Shoal creates them from routes, writes and reads them in six
formats, and checks them.
"""

from __future__ import annotations

from shoal.missions.checking import MissionCheck, check_missions, lint
from shoal.missions.diagnostics import RULES, Diagnostic, Rule
from shoal.missions.files import FORMATS, MissionFormat, mission_files, read_mission, write_missions
from shoal.missions.mission import Mission, missions_of
from shoal.search.problem.mission_options import CAPS

__all__ = [
    "CAPS",
    "FORMATS",
    "RULES",
    "Diagnostic",
    "Mission",
    "MissionCheck",
    "MissionFormat",
    "Rule",
    "check_missions",
    "lint",
    "mission_files",
    "missions_of",
    "read_mission",
    "write_missions",
]
