"""Events and result of a live search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

from shoal.core.dataclass import dataclass
from shoal.search.tours.bitset import at_least, bitset_of


@dataclass(frozen=True, slots=True)
class LiveEvent:
    """An event that a robot reported, or an event that the supervisor caused.

    Parameters
    ----------
    time : float
        Time of the event, in units of the time in which a robot of speed 1 searches one cell.
    robot : int
        Number of the robot.
    kind : str
        The robot's new status ("listening", "searching", "waiting" or "complete"), or an event. Events with a cell are "enters",
        "leaves", "searched", "blocked" (by another robot) and "obstructed". Events without a cell are "home", "recharged" and
        "declared". The supervisor adds the events "killed", "stopped" (at the time limit) and "failed" (with a reason).
    cell : int or None
        Tour index of the cell of the event.
    found : bool
        Whether the robot found something in the cell.
    place : tuple of float
        Position of the robot in cell sides, as in `TourCost.points`. For an event by the supervisor, the position is an empty
        tuple.
    reason : str
        For an event "failed", the reason for which the process failed.
    through : tuple of int
        The cells that the robot has passed since its last search, if robots move from cell to cell.
    around : tuple of int
        The cells around ``cell`` that the robot also sees, because its footprint is wider than one cell.
    beside : tuple of int
        The cells of ``around`` in which the robot found something.
    """

    time: float
    robot: int
    kind: str
    cell: int | None = None
    found: bool = False
    place: tuple[float, ...] = ()
    reason: str = ""
    through: tuple[int, ...] = ()
    around: tuple[int, ...] = ()
    beside: tuple[int, ...] = ()


@dataclass(frozen=True)
class LiveOutcome:
    """The result of a live search.

    Parameters
    ----------
    complete : bool
        Whether robots really searched every reachable cell, and all surviving robots (at least one) declared completion.
    covered : float
        Fraction of the reachable cells that robots really searched.
    declared, killed : dict of int to float
        Time at which each robot declared completion, and time at which the supervisor killed each crashed robot.
    failed : dict of int to str
        Reason for which the process of a robot ended too early: a program error, or a kill from outside.
    sent, heard, lost, dropped : int
        Numbers of messages that were sent, received, lost and dropped, in total for all robots. Robots drop a message if it comes
        from no robot of the search or contains impossible values. Messages that a killed robot sends after its last report do not
        count.
    channel : str
        Channel of the messages: "multicast" or "unicast".
    port : int
        Port of the multicast group, or 0 with unicast.
    startup, seconds : float
        Duration of the start of all processes, and duration of the search after this start, in seconds.
    timed_out : bool
        Whether the search reached its time limit.
    events : tuple of LiveEvent
        All events of the search, sorted by time.
    """

    complete: bool
    covered: float
    declared: dict[int, float]
    killed: dict[int, float]
    failed: dict[int, str]
    sent: int
    heard: int
    lost: int
    dropped: int
    channel: str
    port: int
    startup: float
    seconds: float
    timed_out: bool
    events: tuple[LiveEvent, ...] = field(repr=False)


def searched_by(events: Sequence[LiveEvent]) -> dict[int, int]:
    """Return a bitset of the cells that each robot really searched, by the number of the robot.

    Examples
    --------
    >>> searched_by([LiveEvent(1.0, 7, "searched", 2), LiveEvent(2.0, 7, "searched", 3)])
    {7: 12}
    """
    searched: dict[int, int] = {}
    for event in events:
        if event.kind == "searched" and event.cell is not None:
            searched[event.robot] = searched.get(event.robot, 0) | bitset_of((event.cell, *event.around))
    return searched


def covered_share(events: Sequence[LiveEvent], goal: int) -> float:
    """Return the fraction of the cells in the bitset ``goal`` that robots really searched."""
    return (at_least(list(searched_by(events).values()), 1) & goal).bit_count() / goal.bit_count()
