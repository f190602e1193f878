"""Search for homes and landing points that are nearer to each other than the required separation of vehicles in flight."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.search.missions.mission import Mission
from shoal.search.missions.rules import ROUNDING
from shoal.search.regions.projection import LocalFrame

Place = tuple[float, float]


@dataclass(frozen=True)
class NearHomes:
    """Two different vehicles whose homes or landing points are nearest to each other.

    Parameters
    ----------
    robots : tuple of int
        Numbers of the two robots.
    distance : float
        Smallest distance in metres between a home or landing point of one robot and a home or landing point of the other robot.
    pairs : int
        Number of pairs of robots whose homes or landing points are nearer to each other than ``required``.
    required : float
        Horizontal separation of vehicles in flight, in metres.
    """

    robots: tuple[int, int]
    distance: float
    pairs: int
    required: float

    def report(self) -> dict[str, Any]:
        """Return the nearest homes as a mapping that can be written as JSON."""
        return {"robots": list(self.robots), "distance_m": self.distance, "pairs": self.pairs, "warning": str(self)}

    def __str__(self) -> str:
        one, other = self.robots
        more = f" and {self.pairs - 1} more pair{'s' * (self.pairs > 2)} as near" if self.pairs > 1 else ""
        return (
            f"expected homes and landing points of different vehicles at least {self.required:g} m apart, "
            f"got {self.distance:.3g} m between robots {one} and {other}{more}; give each vehicle its own point, "
            "or clear the point before the next vehicle uses it"
        )


def near_homes(places: Iterable[tuple[int, Place]], required: float, frame: LocalFrame | None) -> NearHomes | None:
    """Return the nearest homes or landing points of different robots, or None if all are at least ``required`` metres apart.

    Parameters
    ----------
    places : iterable of (int, (float, float))
        Pairs of a robot's number and the position of a home or landing point of this robot. Positions are in degrees if a frame is
        given, and otherwise in metres.
    required : float
        Smallest allowed distance in metres.
    frame : LocalFrame or None
        Local frame in which distances are measured.

    Raises
    ------
    InvalidInputError
        If a position is too far away for the frame.
    """
    import shapely

    known = sorted({*places})
    if not known:
        return None
    robots = np.array([robot for robot, _ in known])
    points = np.array([place for _, place in known])
    points = points if frame is None else frame.to_metres(points)
    made = shapely.points(points)
    one, other = shapely.STRtree(made).query(made, predicate="dwithin", distance=max(required - ROUNDING, 0.0))
    one, other = np.stack([one, other])[:, robots[one] < robots[other]]
    if not len(one):
        return None
    apart = np.hypot(*(points[one] - points[other]).T)
    nearest = int(np.argmin(apart))
    pairs = len({*zip(robots[one].tolist(), robots[other].tolist(), strict=True)})
    return NearHomes((int(robots[one[nearest]]), int(robots[other[nearest]])), float(apart[nearest]), pairs, required)


def homes_of(missions: Iterable[Mission]) -> list[tuple[int, Place]]:
    """Return the homes and landing points of missions, as pairs of a robot's number and a position.

    A point at which a vehicle loiters is no landing point.
    """
    found = [(mission.robot, mission.home) for mission in missions]
    return found + [(mission.robot, mission.end) for mission in missions if mission.loiter is None]
