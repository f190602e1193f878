"""The data that the processes of all live robots receive at their start."""

from __future__ import annotations

from random import Random

from shoal.core.checks import shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.protocol.envelope import Receiver, Sender
from shoal.search.protocol.messages import LONGEST, Beacon
from shoal.search.protocol.robot import Robot
from shoal.search.simulation.live.radio import Channel, Radio
from shoal.search.simulation.scenario import Scenario


@dataclass(frozen=True)
class LiveTask:
    """The data that the processes of all live robots receive at their start.

    Parameters
    ----------
    scenario : Scenario
        The scenario of the search. Obstacles in the scenario block the vehicles, but the robots do not know the obstacles.
    speed : float
        Number of cells that a robot of speed 1 searches per second of real time.
    channel : str
        Channel of the messages: "multicast" or "unicast".
    port : int
        Port of the multicast group.
    key : bytes
        Key that signs the messages of this search. Robots drop messages without a signature by this key.
    """

    scenario: Scenario
    speed: float
    channel: Channel
    port: int
    key: bytes = b""

    def check(self, beacon: Beacon) -> None:
        """Refuse a beacon that no robot of this search can have sent.

        Raises
        ------
        InvalidInputError
        """
        robots, cells = len(self.scenario.starts), len(self.scenario.brief.tour_cost)
        for told in beacon.heartbeats:
            known = 1 <= told.robot <= robots
            if not known or (told.start, told.rate, told.width) != self._of(told.robot):
                raise InvalidInputError(
                    f"beacon: expected a robot of this search with its start, speed and width, got {shortened(told)}"
                )
        numbers = {beacon.sender, *(number for number, _ in (*beacon.searched, *beacon.closed))}
        sets = [bits >> cells for _, bits in (*beacon.searched, *beacon.closed)]
        sets += [bits >> robots + 1 | bits & 1 for _, bits in beacon.found]
        if not numbers <= set(range(1, robots + 1)) or any(sets) or any(cell >= cells for cell, _ in beacon.found):
            raise InvalidInputError(f"beacon: expected {robots} robots and {cells} cells, got other numbers")

    def _of(self, number: int) -> tuple[int, float, int]:
        return self.scenario.starts[number - 1], self.scenario.rates[number - 1], self.scenario.widths[number - 1]

    def radio(self, number: int) -> Radio:
        """Return the radio of the robot with a given number."""
        scenario, most = self.scenario, self.scenario.packet or LONGEST
        receiver = Receiver(self.key, robots=len(scenario.starts), cells=len(scenario.brief.tour_cost), most=most)
        random = Random(f"{scenario.seed} {number}")
        loss = next((medium.numbers[0] for medium in scenario.network.media if medium.kind == "loss"), 0.0)
        return Radio(self.channel, Sender(number, self.key, most), receiver, port=self.port, loss=loss, random=random)

    def robot(self, number: int) -> Robot:
        """Return the initial state of the robot with a given number."""
        return Robot(number, self.scenario.brief, *self._of(number))
