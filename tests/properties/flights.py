"""Random plans of vehicles with little in the battery, and the judgement of their mission files by
other code.
"""

from __future__ import annotations

import numpy as np
import shapely
from tests.missions import missions_of
from tests.reference.flight import narrow_turns, seconds_of, usable_seconds, way_of_plan

from shoal.core.errors import InvalidInputError
from shoal.missions import write_missions
from shoal.search import LocalFrame, region_of
from shoal.search.flight.dubins import LINK
from shoal.search.flight.vehicle import vehicle_of
from shoal.search.planning.plan import plan_search
from shoal.search.problem import SearchProblem

KINDS = ("multirotor", "fixed-wing", "rover")


def random_vehicle(rng, kind):
    """Return the fields of a vehicle, all that count for its times among them."""
    cruise = float(
        rng.uniform(1, 3)
        if kind == "rover"
        else rng.uniform(12, 22)
        if kind == "fixed-wing"
        else rng.uniform(3, 14)
    )
    fields = {"preset": kind, "cruise_speed": cruise, "reserve": float(rng.choice([0.0, 0.2, 0.5]))}
    if kind != "fixed-wing":
        fields |= (
            {"turn_time": float(rng.uniform(0, 6))}
            if rng.random() < 0.5
            else {"acceleration": float(rng.uniform(0.5, 4))}
        )
    if kind != "rover":
        fields |= {
            "climb_speed": float(rng.uniform(1, 5)),
            "sink_speed": float(rng.uniform(0.5, 3)),
            "altitude": float(rng.uniform(20, 120)),
        }
        fields |= {
            "wind_speed": float(rng.uniform(0, 0.9) * cruise * (rng.random() < 0.7)),
            "wind_from": float(rng.uniform(0, 360)),
        }
    if kind == "fixed-wing":
        fields["turn_radius"] = float(rng.uniform(1.02, 3) * cruise**2 / (9.80665 * 3**0.5))
    return fields


def random_problem(seed):
    """Return the search of a random region on Earth by robots of a kind, and the fields of the
    vehicle.
    """
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % 3]
    fields = random_vehicle(rng, kind)
    size = fields["cruise_speed"] * float(rng.uniform(20, 90))
    angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(4, 9))))
    corners = (
        size
        * rng.uniform(0.5, 1.2, (len(angles), 1))
        * np.column_stack([np.cos(angles), np.sin(angles)])
    )
    shape = shapely.convex_hull(shapely.multipoints(corners))
    frame = LocalFrame(float(rng.uniform(-179, 179)), float(rng.uniform(-75, 75)))
    region = region_of(shape, frame=frame, name="random")
    far = (
        2 * np.ptp(corners, axis=0).max() / (fields["cruise_speed"] - fields.get("wind_speed", 0.0))
    )
    aloft = fields.get("altitude", 0.0) * (
        1 / fields.get("climb_speed", 1) + 1 / fields.get("sink_speed", 1)
    )
    turns = 8 * max(
        fields.get("turn_time", 0),
        fields["cruise_speed"] / fields.get("acceleration", 1e9),
        fields.get("turn_radius", 0),
    )
    fields["endurance"] = float(
        (rng.uniform(1.3, 4) * far + aloft + turns + 30) / 60 / (1 - fields["reserve"])
    )
    robots = int(rng.integers(1, 4))
    problem = SearchProblem(
        region,
        robots=robots,
        footprint=size / float(rng.uniform(6, 14)),
        vehicle=fields,
        simulate=False,
        starts="clustered",
        angle=float(rng.uniform(0, 180)),
    )
    return problem, fields


def random_plan(seed):
    """Return the plan of a `random_problem`, and the fields of the vehicle."""
    problem, fields = random_problem(seed)
    return plan_search(problem, seed=seed), fields


def missions_of_plan(plan, **options):
    """Return the missions of all robots of a plan."""
    found = []
    for robot in range(len(plan.places)):
        found += missions_of(
            plan.route(robot, plan.stops(robot)).points,
            plan.grid.region.frame,
            robot=robot + 1,
            home=plan.places[robot],
            vehicle=plan.vehicle,
            link=LINK * float(plan.footprints[robot]),
            find_path=plan.leg,
            **options,
        )
    return found


def judged(seed, folder):
    """Return the time of each mission of a random plan as a share of what the battery allows, and
    legs too short for turns.

    None for a plan that is refused since the battery is too small.
    """
    plan, fields = random_plan(seed)
    try:
        missions = missions_of_plan(plan)
    except InvalidInputError as error:
        if "endurance: expected sorties of more than" not in str(error):
            raise
        return None
    shares, narrow = [], []
    for path in write_missions(missions, folder, formats=["plan"]):
        way = way_of_plan(path)
        told = vehicle_of(fields).to_dict(defaults=True)
        shares.append(
            seconds_of(way, {name: value for name, value in told.items() if value is not None})
            / usable_seconds(fields)
        )
        if fields["preset"] == "fixed-wing":
            wider = (1 + fields["wind_speed"] / fields["cruise_speed"]) ** 2
            narrow += narrow_turns(way, fields["turn_radius"] * wider)
    return shares, narrow
