"""Missions for tests, from the fields of all structures at once."""

from __future__ import annotations

from shoal.missions import split_missions
from shoal.search.flight.dubins import Airspace
from shoal.search.flight.flight import Altitudes, Flight

OF_ALTITUDES = {"altitude_frame": "frame", "terrain": "terrain", "terrain_error": "error"}
OF_AIRSPACE = ("blocked", "area", "free")
OF_SPLIT = ("robot", "autopilot", "cap", "tolerance", "find_path", "out")


def flight_of(frame=None, **fields):
    """Return a `Flight`, with the fields of its `Altitudes` and its `Airspace` among its own."""
    altitudes = {own: fields.pop(name) for name, own in OF_ALTITUDES.items() if name in fields}
    airspace = {name: fields.pop(name) for name in OF_AIRSPACE if name in fields}
    return Flight(
        frame=frame, altitudes=Altitudes(**altitudes), airspace=Airspace(**airspace), **fields
    )


def missions_of(route, frame, **fields):
    """Return the missions of a route, with the fields of its `Flight` among the arguments."""
    split = {name: fields.pop(name) for name in OF_SPLIT if name in fields}
    return split_missions(route, flight_of(frame, **fields), **split)
