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
        Time in units of the time that a robot of speed 1 needs for one cell.
    robot : int
    kind : str
        A status ("listening", "searching", "waiting", "complete"), or an event. Events with a cell are "enters", "leaves",
        "searched", "blocked" (by another robot) and "obstructed". Other events are "home", "recharged" and "declared". The
        supervisor adds the events "killed", "stopped" (at the time limit) and "failed" (with a reason).
    cell : int or None
    found : bool
        Whether the robot found something in the cell.
    place : tuple of float
        Position of the robot in the units of `TourCost.points`. The tuple is empty if the robot did not report the event itself.
    reason : str
    through : tuple of int
        The cells that the robot has passed since its last search, if robots move from cell to cell.
    around : tuple of int
        The additional cells that the robot sees with a footprint wider than one cell.
    beside : tuple of int
        The cells of ``around`` with findings.
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
    """Result of a live search.

    Parameters
    ----------
    complete : bool
        Whether robots really searched every reachable cell, at least one robot survived, and all survivors declared completion.
    covered : float
        Fraction of the reachable cells that any robot really searched before it failed.
    declared, killed : dict of int to float
        Time at which each robot declared completion, and time at which each killed robot was killed.
    failed : dict of int to str
        Robots whose process ended too early, with the reason: a program error, or a kill from outside.
    sent, heard, lost, dropped : int
        Number of messages sent, received, and lost at the receiver. ``dropped`` counts messages that came from no robot of this
        search or had impossible content. The numbers of a killed robot are those of its last report.
    channel : str
        "multicast" or "unicast".
    port : int
        Port of the multicast group, or 0 with unicast.
    startup, seconds : float
        Duration in seconds of the start of all processes, and duration of the search that follows.
    timed_out : bool
    events : tuple of LiveEvent
        The events in the order of their times.
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
    """Return the cells that each robot really searched, as bitsets.

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
