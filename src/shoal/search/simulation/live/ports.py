"""The three ports of a robot's agent: vehicle, radio and sensor.

The `Agent` of a live search and the process of a real robot differ in what stands behind the ports,
and in nothing else. `shoal.testing` checks each port. Times are in the unit of a search: the time
in which a robot of speed 1 searches one cell. Points are in cell sides, as in `TourCost.points`.
"""

from __future__ import annotations

from typing import Protocol

from shoal.core.dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Leg:
    """What a vehicle is told to do: go to a cell and search it.

    Parameters
    ----------
    cell : int
        Tour index of the last cell.
    goal : tuple of float
        Centre of this cell in cell sides.
    distance : float
        Length of the path in cell sides.
    length : float
        Length of the path, and the cost of turns and of the search at its end, in cell sides.
    through : tuple of int
        The cells of the path, if the robot moves from cell to cell.
    home : bool
        Whether the leg ends at the place where the robot recharges, and nothing is searched.
    """

    cell: int
    goal: tuple[float, ...]
    distance: float
    length: float
    through: tuple[int, ...] = ()
    home: bool = False


class RobotVehicle(Protocol):
    """Where am I, go there, what is left.

    Attributes
    ----------
    fault : str
        Why the vehicle can no longer do what it is told; empty as long as it can. Once there is a
        fault, it stays.
    """

    fault: str

    def where(self) -> tuple[float, ...]:
        """Return the vehicle's position."""

    def go(self, leg: Leg, time: float) -> None:
        """Begin a leg, and halt one cell before its end until `enter` allows the last cell."""

    def enter(self) -> None:
        """Go on to the end of the leg."""

    def step(self, time: float) -> bool:
        """Go on to a time. Return whether the vehicle is where it may go: one cell before the end
        of its leg or, after `enter`, at the end. Return False without a leg.
        """

    def due(self, time: float) -> float:
        """Return the time of the next `step` at the latest: infinity if nothing will change."""

    def stop(self, time: float) -> None:
        """Stand still, where the vehicle is, until the next leg."""

    def left(self) -> float | None:
        """Return the fraction of the battery that is left, or None if the vehicle does not know."""

    def secure(self) -> None:
        """Begin the safe action: what the vehicle does when the search is over for it."""


class Radio(Protocol):
    """Broadcast bytes, and receive what others broadcast. Messages may be lost, doubled or damaged.

    Attributes
    ----------
    most : int
        Maximum number of bytes of a message.
    rate : float
        Number of bytes of messages that it can send in a second on average; infinity if that is
        more than robots need.
    fault : str
        Why the radio can no longer send; empty as long as it can.
    """

    most: int
    rate: float
    fault: str

    def fileno(self) -> int:
        """Return a file descriptor that is readable when messages have come."""

    def broadcast(self, message: bytes) -> int:
        """Send a message to all others without waiting. Return the number of copies that could not
        be sent.
        """

    def receive(self) -> tuple[bytes, object] | None:
        """Return a message that has come from another, and where it came from; None if there is
        none.
        """

    def close(self) -> None:
        """Close the radio."""


@dataclass(frozen=True, slots=True)
class CellFinding:
    """What the sensor saw from a cell: whether there is something in it, the other cells that were
    seen, and those of them with something in it.
    """

    found: bool = False
    around: tuple[int, ...] = ()
    beside: tuple[int, ...] = ()


class SearchSensor(Protocol):
    """What is in this cell: something that is searched for, another robot, or an obstacle."""

    def search(self, cell: int) -> CellFinding:
        """Return what is seen from a cell, in which the vehicle stands."""

    def enter(self, cell: int) -> bool:
        """Return whether the cell ahead is free of other robots. From then on, it is this robot's,
        until it enters another one or leaves.
        """

    def leave(self, cell: int) -> None:
        """Give up a cell that was entered."""

    def obstacle_on(self, source: int, through: tuple[int, ...]) -> tuple[int | None, int]:
        """Return the first known obstacle on the path from ``source`` through the cells
        ``through``, and the number of cells before it; None and the number of cells if there is
        none.
        """
