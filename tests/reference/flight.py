"""Mission files flown by other code: what lies in the .plan alone, leg by leg, on the ellipsoid,
with plain numbers.

Nothing of the library is asked. A vehicle is a dict of the fields of its file.
"""

from __future__ import annotations

import json
import math
from itertools import pairwise

from pyproj import Geod

EARTH = Geod(ellps="WGS84")


def way_of_plan(path):
    """Return (longitude, latitude, metres above home) from the ground at home along all waypoints
    to the ground where it ends.
    """
    mission = json.loads(path.read_text())["mission"]
    south, west, base = mission["plannedHomePosition"]
    relative = {1: True, 2: False}[mission["globalPlanAltitudeMode"]]
    points = [
        (item["params"][5], item["params"][4], item["params"][6] - (0 if relative else base))
        for item in mission["items"]
        if item["command"] == 16
    ]
    last = mission["items"][-1]
    assert last["command"] in (20, 21)
    end = (west, south) if last["command"] == 20 else (last["params"][5], last["params"][4])
    # a fixed wing climbs on its way to the first one
    up = [(west, south, points[0][2])] if mission["vehicleType"] == 2 else []
    down = [] if mission["vehicleType"] == 10 else [(*end, points[-1][2])]
    return [(west, south, 0.0), *up, *points, *down, (*end, 0.0)]


def legs_of(way):
    """Yield (bearing at its begin and at its end in degrees, metres along the ground, metres up) of
    each leg.
    """
    for (x, y, z), (east, north, top) in pairwise(way):
        bearing, back, length = EARTH.inv(x, y, east, north)
        yield bearing, back + 180, (length if length > 0.005 else 0.0), top - z


def ground_speed(bearing, speed, wind, wind_from):
    """Return the speed over ground: the heading is sought for which air and wind together go along
    the bearing.
    """
    towards = math.radians(wind_from + 180 - bearing)
    drift = math.asin(wind * math.sin(towards) / speed)
    return speed * math.cos(drift) + wind * math.cos(towards)


def seconds_of(way, vehicle):
    """Return how long a vehicle flies a way."""
    speed, wind = vehicle["cruise_speed"], vehicle.get("wind_speed", 0.0)
    turn = vehicle.get("turn_time")
    if turn is None:
        turn = speed / vehicle["acceleration"] if "acceleration" in vehicle else 0.0
    total, before = turn, None  # half for starting, half for stopping
    flat, cut = [], vehicle.get("acceptance_radius", 1.0)  # the bends and legs since the last stop
    for bearing, end, length, up in legs_of(way):
        along = (
            length / ground_speed(bearing, speed, wind, vehicle.get("wind_from", 0.0))
            if length
            else 0.0
        )
        rate = vehicle.get("climb_speed" if up > 0 else "sink_speed")
        total += max(along, abs(up) / rate if rate else 0.0)
        if not length and not up:
            continue
        heading = bearing if length else "up or down"
        if before is not None and before != heading:
            vertical = "up or down" in (before, heading)
            bend = 180.0 if vertical else abs((heading - before + 180) % 360 - 180)
            if bend > 45.0:
                total, flat = total + turn + lost_in_curves(flat, speed, turn, cut), []
            elif bend > 0.99:
                flat.append((bend, 0.0))
        flat.append((0.0, length))
        before = end if length else heading
    return total + lost_in_curves(flat, speed, turn, cut)


def lost_in_curves(pieces, speed, turn, cut):
    """Return the time lost in gentle bends between two stops, by small steps along the way.

    The pieces of the way are bends (degrees, 0) and straight legs (0, metres). Around each bend,
    the speed is at most that of the arc that touches both legs. Elsewhere it changes by at most the
    acceleration.
    """
    if not turn or not any(bend for bend, _ in pieces):
        return 0.0
    reach = speed * turn  # the square of the speed over the acceleration
    lengths = [length for _, length in pieces if length]
    ends, at, number = [], 0.0, 0
    for bend, length in pieces:
        at += length
        number += bool(length)
        if bend and 0 < number < len(lengths):
            half = math.radians(bend) / 2
            touch = min(
                lengths[number - 1] / 2,
                lengths[number] / 2,
                cut * math.tan(half) / (1 / math.cos(half) - 1),
            )
            ends.append((at - touch, at + touch, min(1.0, touch / math.tan(half) / reach)))
    step = min(0.2, at / 50)
    squares = [1.0] * (math.ceil(at / step) + 1)
    for begin, end, square in ends:
        for k in range(
            max(math.ceil(begin / step), 0), min(math.floor(end / step), len(squares) - 1) + 1
        ):
            squares[k] = min(squares[k], square)
    for order in (range(1, len(squares)), range(len(squares) - 2, -1, -1)):
        for k in order:
            squares[k] = min(squares[k], squares[k - order.step] + 2 * step / reach)
    return sum(step / speed * (2 / (math.sqrt(a) + math.sqrt(b)) - 1) for a, b in pairwise(squares))


def usable_seconds(vehicle):
    return vehicle["endurance"] * 60 * (1 - vehicle.get("reserve", 0.0))


ROUNDING = 0.0016  # metres: of coordinates with 8 decimals, both axes together


def narrow_turns(way, radius):
    """Return the legs of a way that are too short for turns of a radius at both of their ends.

    A circle that touches both legs of a bend begins R tan(bend / 2) before it: two bends share the
    leg between them. Rounding moves both ends of a leg, and so turns short legs.
    """
    legs = [(bearing, end, length) for bearing, end, length, _ in legs_of(way) if length]
    bends = [abs((two[0] - one[1] + 180) % 360 - 180) for one, two in pairwise(legs)]
    for bend, (one, two) in zip(bends, pairwise(legs), strict=True):
        assert bend <= 30.1 + math.degrees(ROUNDING / one[2] + ROUNDING / two[2]), (
            "no bend is a corner"
        )
    needs = [0.0, *(radius * math.tan(math.radians(bend) / 2) for bend in bends), 0.0]
    # what rounding may turn each leg by, as a need
    turned = [0.0, *(radius * ROUNDING / length for _, _, length in legs), 0.0]
    return [
        (bearing, length, one + two)
        for number, ((bearing, _, length), one, two) in enumerate(
            zip(legs, needs[:-1], needs[1:], strict=True), start=1
        )
        if one + two
        > length + ROUNDING + turned[number] + (turned[number - 1] + turned[number + 1]) / 2
    ]


def bilinear(grid, x, y):
    """Return the height at a place of a grid whose first row is the southernmost, at
    whole numbers.
    """
    column, row = min(max(int(x), 0), len(grid[0]) - 2), min(max(int(y), 0), len(grid) - 2)
    right, up = x - column, y - row
    low = grid[row][column] * (1 - right) + grid[row][column + 1] * right
    high = grid[row + 1][column] * (1 - right) + grid[row + 1][column + 1] * right
    return low * (1 - up) + high * up


def dubins_path(start, word, parts, radius):
    """Return the path of one Dubins curve, tangent after tangent."""
    x, y, heading = map(float, start)
    found = [(x, y)]
    for letter, length in zip(word, map(float, parts), strict=True):
        sense = {"L": 1.0, "R": -1.0, "S": 0.0}[letter]
        if not sense:
            x, y = x + radius * length * math.cos(heading), y + radius * length * math.sin(heading)
            continue
        count = max(1, math.ceil(length / (math.pi / 6) - 1e-9))
        bend = length / count
        reach = radius * math.tan(bend / 2)
        for _ in range(count):
            x, y = x + reach * math.cos(heading), y + reach * math.sin(heading)
            if reach > 0.01:  # otherwise the path bends slightly where the arc begins
                found.append((x, y))
            heading += sense * bend
            x, y = x + reach * math.cos(heading), y + reach * math.sin(heading)
    found.append((x, y))
    return found
