"""Which robot may enter a cell, when no sensor sees the others: what the beacons say.

Each heartbeat names the cell that its robot goes to or stands in: its claim. Each beacon repeats
some heartbeats of others, and so tells whose claims its sender knows. A robot *lets* another one go
first when it repeats the other's claim while it claims another cell itself. (Compare Ricart and
Agrawala 1981.)

- Nobody enters a cell for which it has let another robot go first, as long as that one claims it.
- The robot to which the division of the tour gives the cell needs nothing else.
- All others must be let by that robot, and by all living robots with lower numbers.

A beacon that is lost lets a robot wait, and never lets two robots in. What is left to chance: a
robot that is taken for dead, and a claim that was told eight times and heard by one robot never.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf

from shoal.search.allocation.allocate import partition
from shoal.search.protocol.robot import relayed_heartbeats
from shoal.search.protocol.state import Event, Heard, Robot, silence_limit
from shoal.search.simulation.live.ports import CellFinding
from shoal.search.simulation.scenario import Scenario

_TOLD = 8  # beacons with a claim after which a robot that claims another cell has heard it
_SILENT = 16  # beacons after whose time without a message a robot no longer counts
_LEAVING = 3  # beacons in whose time a robot leaves the cell that it no longer claims
_STUCK = 30  # beacons after which the lowest number goes, where robots wait for each other


class RadioSensor:
    """A sensor that finds nothing by itself, and knows of other robots what their beacons say.

    Parameters
    ----------
    scenario : Scenario
        The search, by which all robots know to whom each cell was given.
    robot : callable
        Function that returns the present state of the robot.
    now : callable
        Function that returns the time.
    restarted : bool
        Whether the robot's program was started anew. It then does not know whom it has let go
        first, and takes the first claims that it hears for these.
    """

    def __init__(
        self,
        scenario: Scenario,
        robot: Callable[[], Robot],
        now: Callable[[], float],
        *,
        restarted: bool = False,
    ) -> None:
        self._robot, self._now = robot, now
        numbers = range(1, len(scenario.starts) + 1)
        robots = tuple(zip(numbers, scenario.starts, scenario.rates, scenario.widths, strict=True))
        brief = scenario.brief
        self._parts = {
            part.robot: part.bits for part in partition(brief.tour_cost, brief.allocator, robots)
        }
        self._forgot = {*numbers} if restarted else set[int]()  # to whom it may have let a cell
        self._grace: float | None = None  # all others may live until then
        self._cell: int | None = None  # the cell that is claimed
        self._count_before, self._since = 0, 0.0  # beacons sent, and the time, before the claim
        self._let_me: set[int] = set()
        self._let_go: dict[int, int] = {}  # which cell each other robot was let
        self._previous_claims: dict[
            int, tuple[int, float]
        ] = {}  # the cell each robot claimed before
        self._count = 0

    def note(self, event: Event) -> None:
        """Note whom this robot lets go first, and who lets it. Call this with each event, before
        the event has an effect.
        """
        robot = self._robot()
        self._note_own(robot)
        if not isinstance(event, Heard) or not event.beacon.heartbeats:
            return
        for heartbeat in event.beacon.heartbeats:
            peer = robot.peers.get(heartbeat.robot)
            if peer is None or heartbeat.count <= peer.heartbeat.count:
                continue
            if heartbeat.place != peer.heartbeat.place:
                self._previous_claims[heartbeat.robot] = peer.heartbeat.place, event.time
        sender, *others = event.beacon.heartbeats
        if sender.robot != event.beacon.sender or sender.robot == robot.number:
            return
        if sender.robot in self._forgot:
            self._forgot.discard(sender.robot)
            self._let_go[sender.robot] = sender.place
        peer = robot.peers.get(sender.robot)
        if peer is not None and peer.heartbeat.count > sender.count:
            return  # an old one
        for heartbeat in others:
            knows = heartbeat.robot == robot.number and heartbeat.count > self._count_before
            if knows and heartbeat.place == self._cell != sender.place:
                self._let_me.add(sender.robot)

    def _note_own(self, robot: Robot) -> None:
        """Note the claim of this robot, and what its last beacon has said."""
        place = robot.cell if robot.target is None or robot.target < 0 else robot.target
        if robot.count > self._count:
            self._count = robot.count
            for heartbeat in relayed_heartbeats(robot):
                if heartbeat.place != place:
                    self._let_go[heartbeat.robot] = heartbeat.place
            if place != self._cell or robot.status != "searching":
                self._cell = None  # others no longer know the claim
        if robot.target is not None and robot.target != self._cell:
            self._cell, self._count_before, self._since = robot.target, robot.count, self._now()
            self._let_me = set()

    def search(self, cell: int) -> CellFinding:
        """Return that nothing was found: what is searched for is on the images."""
        return CellFinding()

    def enter(self, cell: int) -> bool:
        """Return whether this robot may enter a cell now."""
        robot, now = self._robot(), self._now()
        self._note_own(robot)
        silence = max(silence_limit(robot), _SILENT * robot.brief.beat)
        if self._grace is None:
            self._grace = now + silence
        others = [
            number
            for number in self._parts
            if number != robot.number
            and (now <= self._grace or now - _last_heard(robot, number) <= silence)
        ]
        claim = {
            number: robot.peers[number].heartbeat.place == cell
            and robot.peers[number].heartbeat.status == "searching"
            for number in others
            if number in robot.peers
        }
        stuck = now - self._since > _STUCK * robot.brief.beat
        return all(
            self._lets(robot, number, claim.get(number), cell)
            or (
                stuck
                and claim.get(number) is True
                and self._let_go.get(number) != cell
                and self._is_after(number, robot, cell)
            )
            for number in others
        )

    def _is_after(self, number: int, robot: Robot, cell: int) -> bool:
        """Return whether another robot comes after this one where robots wait for each other: the
        robot to which the cell was given goes first, and then the lowest number.
        """
        if self._parts[robot.number] >> cell & 1:
            return True
        return number > robot.number and not self._parts[number] >> cell & 1

    def _lets(self, robot: Robot, number: int, claims: bool | None, cell: int) -> bool:
        """Return whether another robot lets this one enter a cell."""
        before, when = self._previous_claims.get(number, (None, 0.0))
        if before == cell and self._now() < when + _LEAVING * robot.brief.beat:
            return False  # it may still be on its way out
        if number in self._forgot or (claims and self._let_go.get(number) == cell):
            return False
        if self._parts[robot.number] >> cell & 1:
            return True
        if number > robot.number and not self._parts[number] >> cell & 1:
            return True
        if number in self._let_me:
            return True
        if claims is None or claims:
            return False
        peer = robot.peers[number]
        deadline = self._since + _TOLD * robot.brief.beat
        return peer.heartbeat.status == "complete" or peer.heard > deadline

    def leave(self, cell: int) -> None:
        """Do nothing: the next beacon tells where the robot goes."""

    def obstacle_on(self, here: int, through: tuple[int, ...]) -> tuple[int | None, int]:
        """Return that no obstacle is known."""
        return None, len(through)


def _last_heard(robot: Robot, number: int) -> float:
    """Return when a robot was heard last."""
    peer = robot.peers.get(number)
    return -inf if peer is None else peer.heard
