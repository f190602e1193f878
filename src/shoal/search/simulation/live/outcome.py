"""What a live search reports, and what it came to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

from shoal.core.dataclass import dataclass
from shoal.search.tours.bitset import at_least, bitset_of


@dataclass(frozen=True, slots=True)
class LiveEvent:
    """Something that a robot has reported, or that was done to it.

    Parameters
    ----------
    time : float
        In the time that a robot of speed 1 takes for a cell.
    robot : int
    kind : str
        A status ("listening", "searching", "waiting", "complete"); "enters", "leaves", "searched", "blocked" (by another robot),
        "obstructed" with a cell; "home", "recharged", "declared"; "killed", "stopped" (at the time limit) and "failed" (with a
        reason) come from the outside.
    cell : int or None
    found : bool
        Whether something was found in the cell.
    place : tuple of float
        Where the robot is, as `TourCost.points`; empty if it is not the robot that tells.
    reason : str
    through : tuple of int
        The cells that a robot has passed since it last searched one, where it goes from cell to cell.
    around : tuple of int
        The cells that it has seen besides, with a wider footprint.
    beside : tuple of int
        Those of them with something to find.
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
    """What a live search came to.

    Parameters
    ----------
    complete : bool
        Every cell that some robot can reach was searched in truth, and every robot that was left alive, at least one, declared it.
    covered : float
        The share of cells that were searched in truth, by any robot, up to its death; of those that some robot can reach.
    declared, killed : dict of int to float
        When each robot declared the search complete, and when it was killed.
    failed : dict of int to str
        Robots whose process ended too soon, and why: mistakes in the program, or somebody else killed it.
    sent, heard, lost, dropped : int
        Messages that robots sent, that came to a robot, those of them that were lost there, and those that were no robot's of this
        search or said what cannot be; as far as reported.
    channel : str
        "multicast" or "unicast".
    port : int
        Of the multicast group; 0 with unicast.
    startup, seconds : float
        How long it took until all processes were ready, and from then on; in seconds.
    timed_out : bool
    events : tuple of LiveEvent
        In the order of their times.
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
    """Return what each robot has searched in truth, as bits.

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
    """Return the share of some cells, as bits, that were searched."""
    return (at_least(list(searched_by(events).values()), 1) & goal).bit_count() / goal.bit_count()
