"""Costs of a vehicle's motion in cells, the unit of planners."""

from __future__ import annotations

from math import pi

from shoal.search.flight.dubins import shortest_length
from shoal.search.flight.vehicle import Vehicle


def turn_cells(vehicle: Vehicle, size: float) -> float:
    """Return the cost of a turn in cells: its duration or, for a fixed wing, half the extra length of the curve between rows.

    A row ends with two turns: one towards the next row, and one into that row.

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
    """Return the endurance in seconds between the climb to the search altitude and the descent from it, without the reserve."""
    return vehicle.usable_seconds - climbing_seconds(vehicle)


def climbing_seconds(vehicle: Vehicle) -> float:
    """Return the total time in seconds of the climb to the search altitude and the descent from it."""
    return float(vehicle.vertical_seconds([vehicle.height, -vehicle.height]).sum())
