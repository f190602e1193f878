"""What vehicles cost planners, who reckon in cells."""

from __future__ import annotations

from math import pi

from shoal.search.flight.dubins import shortest_length
from shoal.search.flight.vehicle import Vehicle


def turn_cells(vehicle: Vehicle, size: float) -> float:
    """Return what a turn costs, in cells: its time, or of a fixed wing half of what the curve from row to row is longer.

    A row ends with two turns: into the way to the next row, and into that row.

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
    """Return how long a battery lasts between climbing to the altitude of the search and sinking from it, the reserve left."""
    return vehicle.usable_seconds - climbing_seconds(vehicle)


def climbing_seconds(vehicle: Vehicle) -> float:
    """Return how long climbing to the altitude of the search and sinking from it take together."""
    return float(vehicle.vertical_seconds([vehicle.height, -vehicle.height]).sum())
