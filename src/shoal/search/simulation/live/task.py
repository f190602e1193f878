"""The initial data of the robots' processes."""

from __future__ import annotations

from random import Random

from shoal.core.checks import shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.cells.distances import CellDistances
from shoal.search.problem.faults import Slow
from shoal.search.protocol.envelope import Receiver, Sender
from shoal.search.protocol.messages import LONGEST, Beacon
from shoal.search.protocol.robot import Brief, Robot
from shoal.search.simulation.live.radio import Channel, Radio


@dataclass(frozen=True)
class LiveTask:
    """The data that all robots' processes receive.

    Parameters
    ----------
    brief : Brief
    starts : tuple of int
    rates : tuple of float
        Speed of each robot.
    speed : float
        Speed in cells per second of a robot of speed 1.
    channel : str
    port : int
        Port of the multicast group.
    loss : float
    seed : int
    targets : frozenset of int
        Cells that contain a target.
    blocked : int
        Blocked cells as a bitset. Vehicles collide with these cells, but the robots do not know them.
    widths : tuple of int
        Width of each robot's footprint in cells. An empty tuple means 1 for all robots.
    key : bytes
        Key of this run. Messages without its signature come from other senders.
    packet : int
        Maximum length of a message in bytes.
    slow : tuple of Slow
        Robots whose vehicles are slower than declared.
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
    blocked: int = 0
    widths: tuple[int, ...] = ()
    key: bytes = b""
    packet: int = LONGEST
    slow: tuple[Slow, ...] = ()

    def check(self, beacon: Beacon) -> None:
        """Refuse a beacon that no robot of this run can have sent.

        Raises
        ------
        InvalidInputError
        """
        robots, cells = len(self.starts), len(self.brief.tour_cost)
        for told in beacon.heartbeats:
            known = 1 <= told.robot <= robots
            if not known or (told.start, told.rate, told.width) != self._of(told.robot):
                raise InvalidInputError(f"beacon: expected robots of this search, as they are, got {shortened(told)}")
        numbers = {beacon.sender, *(number for number, _ in (*beacon.searched, *beacon.closed))}
        sets = [bits >> cells for _, bits in (*beacon.searched, *beacon.closed)]
        sets += [bits >> robots + 1 | bits & 1 for _, bits in beacon.found]
        if not numbers <= set(range(1, robots + 1)) or any(sets) or any(cell >= cells for cell, _ in beacon.found):
            raise InvalidInputError(f"beacon: expected {robots} robots and {cells} cells, got others")

    def _of(self, number: int) -> tuple[int, float, int]:
        return self.starts[number - 1], self.rates[number - 1], self.widths[number - 1] if self.widths else 1

    def radio(self, number: int) -> Radio:
        """Return a robot's radio."""
        receiver = Receiver(self.key, robots=len(self.starts), cells=len(self.brief.tour_cost), most=self.packet)
        sender, random = Sender(number, self.key, self.packet), Random(f"{self.seed} {number}")
        return Radio(self.channel, sender, receiver, port=self.port, loss=self.loss, random=random)

    def robot(self, number: int) -> Robot:
        """Return a robot in its initial state."""
        return Robot(number, self.brief, *self._of(number))

    def seen(self, width: int, cell: int) -> tuple[int, ...]:
        """Return the cells visible from a cell with a footprint of a given width. The result does not contain the cell itself."""
        return tuple(one for one in self.brief.tour_cost.seen(cell, width).tolist() if one != cell) if width > 1 else ()

    @property
    def goal(self) -> int:
        """The cells that at least one robot can reach, as a bitset."""
        distances = self.brief.tour_cost.distances
        if not isinstance(distances, CellDistances):
            return self.brief.everything
        found = 0
        for start in self.starts:
            found |= distances.reach(start, self.blocked)
        return found
