"""Missions for real vehicles: how Shoal creates them from routes, writes and reads them in six formats, and checks them."""

from __future__ import annotations

from shoal.search.missions.checking import MissionCheck, check_missions
from shoal.search.missions.diagnostics import RULES, Diagnostic, Rule
from shoal.search.missions.files import FORMATS, MissionFormat, mission_files, read_mission, write_missions
from shoal.search.missions.lint import lint
from shoal.search.missions.mission import Mission
from shoal.search.missions.splitting import missions_of
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
