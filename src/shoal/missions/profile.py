"""Heights and times of missions: what a chart of them shows."""

from __future__ import annotations

import numpy as np
import shapely

from shoal.core.dataclass import dataclass
from shoal.missions.approach import mission_trajectory
from shoal.missions.mission_set import MissionSet
from shoal.search.flight.terrain import open_terrain
from shoal.search.flight.timing import Floats

_GROUND = 200
"""Number of moments of a flight at which the height of the ground is evaluated."""

_LEVEL = 0.01  # metres by which a height may differ from the straight line that replaces it


@dataclass(frozen=True, eq=False)
class HeightProfile:
    """The height of a vehicle during one sortie, as a function of time.

    Parameters
    ----------
    robot, sortie : int
    times : ndarray of float64, shape (n,)
        Times in seconds after the start of the search, in increasing order. Between two times, the
        height changes linearly.
    heights : ndarray of float64, shape (n,)
        Heights of the vehicle above its home at these times, in metres.
    ground : ndarray of float64, shape (n,), or None
        Heights of the ground below the vehicle above its home, in metres, or None if the missions
        have no terrain.
    """

    robot: int
    sortie: int
    times: Floats
    heights: Floats
    ground: Floats | None


def height_profiles(missions: MissionSet) -> list[HeightProfile]:
    """Return the heights of planned missions, in the order of robots and sorties.

    A sortie without a planned start begins when all sorties with smaller numbers have ended, and
    the tolerated delay has passed.

    Parameters
    ----------
    missions : MissionSet
        Missions that were planned, not read from files.
    """
    plan, options = missions.plan, missions.options
    assert plan is not None
    vehicle, frame = plan.vehicle, plan.grid.region.frame
    path = getattr(options, "terrain", None)
    terrain = None if path is None else open_terrain(path)
    delay = 0.0 if options.required_separation is None else options.required_separation.delay
    ends: dict[int, float] = {}
    profiles = []
    for mission in sorted(missions.missions, key=lambda one: (one.sortie, one.robot)):
        way = mission.path_in(frame)
        flown = mission_trajectory(mission, way, vehicle, mission.rates(vehicle), 0.0)
        before = [end + delay for sortie, end in ends.items() if sortie < mission.sortie]
        start = max(before, default=0.0) if mission.start is None else mission.start
        ends[mission.sortie] = max(ends.get(mission.sortie, 0.0), start + flown.duration)
        times, ground = _bends(flown.times, flown.points[:, 2]), None
        if terrain is not None:
            times = np.union1d(times, np.linspace(0.0, flown.duration, _GROUND))
        points = flown.at(times)
        if terrain is not None:
            ground = terrain.at(points[:, :2], frame) - float(terrain.at(way[:1, :2], frame)[0])
        profiles.append(
            HeightProfile(mission.robot, mission.sortie, start + times, points[:, 2], ground)
        )
    return sorted(profiles, key=lambda one: (one.robot, one.sortie))


def _bends(times: Floats, heights: Floats) -> Floats:
    """Return the times between which the height changes linearly, except for `_LEVEL`."""
    line = shapely.linestrings(np.column_stack([times, heights]))
    return np.asarray(shapely.get_coordinates(shapely.simplify(line, _LEVEL))[:, 0])
