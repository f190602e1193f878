"""Cost of a vehicle's turns in cells, and its endurance at the search altitude in seconds."""

from __future__ import annotations

from math import pi

from shoal.search.flight.dubins import shortest_length
from shoal.search.flight.vehicle import Vehicle


def turn_cells(vehicle: Vehicle, size: float) -> float:
    """Return the cost of a turn: the number of cells of side ``size`` that the vehicle would pass in the time of the turn.

    At the end of a row, a vehicle turns twice: towards the next row, and into the next row. For a fixed wing, the cost of a turn is
    (L - s) / (2 s), where L is the length of the curve from a row to the next row, and s is the distance between the rows.

    Examples
    --------
    >>> turn_cells(Vehicle(cruise_speed=5.0, turn_time=4.0), 10.0)
    2.0
    >>> round(turn_cells(Vehicle(preset="fixed-wing", turn_radius=40.0), 20.0), 2)
    6.22
    """
    if vehicle.radius:
        radius = vehicle.ground_radius
        return max(shortest_length((0.0, 0.0, 0.0), (0.0, size, pi), radius) - size, 0.0) / 2 / size
    return vehicle.turn_seconds * vehicle.cruise / size


def working_seconds(vehicle: Vehicle) -> float:
    """Return the usable endurance in seconds, minus the time for the climb to the search altitude and for the descent."""
    return vehicle.usable_seconds - climbing_seconds(vehicle)


def climbing_seconds(vehicle: Vehicle) -> float:
    """Return the total time in seconds that a vehicle needs to climb to the search altitude and to descend again."""
    return float(vehicle.vertical_seconds([vehicle.height, -vehicle.height]).sum())
