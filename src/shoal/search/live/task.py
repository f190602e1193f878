"""What the robots' processes are told at their beginning."""

from __future__ import annotations

from dataclasses import dataclass

from shoal.search.live.radio import Channel
from shoal.search.robot import Brief


@dataclass(frozen=True)
class LiveTask:
    """What all robots' processes are told.

    Parameters
    ----------
    brief : Brief
    starts : tuple of int
    rates : tuple of float
        Of each robot.
    speed : float
        Cells a second of a robot of speed 1.
    channel : str
    port : int
        Of the multicast group.
    loss : float
    seed : int
    targets : frozenset of int
        Cells with something to find.
    """

    brief: Brief
    starts: tuple[int, ...]
    rates: tuple[float, ...]
    speed: float
    channel: Channel
    port: int
    loss: float
    seed: int
    targets: frozenset[int]
