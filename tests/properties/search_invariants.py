"""What must hold after every event of a search, whatever is lost and whoever dies."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

from shoal.search.problem.network import Battery, Crash, Liar, Pause, Slow, WrongPosition
from shoal.search.simulation.scenario import Scenario
from shoal.search.simulation.world import SearchWorld
from shoal.search.tours.masks import at_least


class InvariantError(AssertionError):
    """An invariant does not hold: there is a fault in Shoal. The message says the seed that replays
    it.
    """


class Checker:
    """Checks a world after every event; give it as ``check``.

    Raises
    ------
    InvariantError
        On the first event after which one of these does not hold:

        1. Who declares the search complete is right: every cell that it can reach has been searched
           by a robot that does not lie.
        2. A robot is in a cell of the region, and goes to one.
        3. No two robots search in one cell at the same time.
        4. What a robot believes of those that do not lie has happened, what they call obstructed
           is, and it forgets nothing.
        5. No robot has moved further than its energy lets it.
        6. Messages lost are no more than messages sent.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.liars = {fault.robot for fault in scenario.faults if isinstance(fault, Liar)}
        self.known: dict[int, Mapping[int, int]] = {}

    def __call__(self, world: SearchWorld, number: int) -> None:
        """Check what the last event, of that robot, may have broken."""
        vehicle = world.vehicles[number]
        n = len(self.scenario.brief.tour_cost)
        if (
            number in world.declared
            and number not in self.liars
            and self.scenario.reach(number) & ~world.covered
        ):
            self._fail(world, number, "declared the search complete before it was")
        if not (0 <= vehicle.place < n and (vehicle.going is None or 0 <= vehicle.going < n)):
            self._fail(
                world,
                number,
                f"is at {vehicle.place}, on the way to {vehicle.going}: not in the region",
            )
        inside = [
            other.searching
            for other in world.vehicles.values()
            if other.alive and other.searching is not None
        ]
        if len(inside) != len(set(inside)):
            self._fail(world, number, "is in a cell that another robot is searching")
        if self.scenario.blocked >> vehicle.place & 1:
            self._fail(world, number, f"is in cell {vehicle.place}, which cannot be entered")
        self._check_beliefs(world, number)
        if vehicle.alive and vehicle.energy < -1e-6:
            self._fail(world, number, "has moved further than its energy lets it")
        if world.air.lost > world.air.sent:
            self._fail(world, number, "has lost more messages than were sent")

    def _check_beliefs(self, world: SearchWorld, number: int) -> None:
        robot = world.vehicles[number].robot
        before, self.known[number] = self.known.get(number), robot.searched
        if before is not robot.searched:
            for other, bits in robot.searched.items():
                if other not in self.liars and bits & ~world.searched.get(other, 0):
                    self._fail(
                        world, number, f"believes that robot {other} has searched what it has not"
                    )
            if before and any(
                bits & ~robot.searched.get(other, 0) for other, bits in before.items()
            ):
                self._fail(world, number, "has forgotten what was searched")
        for other, bits in robot.closed.items():
            if other not in self.liars and bits & ~self.scenario.blocked:
                self._fail(
                    world,
                    number,
                    f"believes what robot {other} never found, that a free cell is obstructed",
                )

    def _fail(self, world: SearchWorld, number: int, what: str) -> None:
        raise InvariantError(
            f"at {world.time:.6g} robot {number} {what} (seed {self.scenario.seed}):"
            f" {self.scenario.faults}"
        )


def check_outcome(scenario: Scenario, outcome: SearchWorld) -> None:
    """Check what must hold when a search has ended.

    Raises
    ------
    InvariantError
        Unless, with at least one robot that does not fail and has the energy, all cells that such
        ones can reach were searched, each such robot has declared the search complete, and that was
        done by the time in which each of them would have done it alone, where none of them was kept
        waiting before a cell, is slow, had to recharge or met an obstacle. With a multiplicity, and
        as many robots that never fail or lie, each cell was searched by so many.
    """
    failing = {
        fault.robot
        for fault in scenario.faults
        if isinstance(fault, Crash | Pause | Slow | Battery | Liar)
    }
    good = [number for number in outcome.vehicles if number not in failing]
    if scenario.brief.energy < inf:
        good = [number for number in good if outcome.vehicles[number].alive]
    seed = f"(seed {scenario.seed}): {scenario.faults}"
    if not good:
        return
    if any(scenario.reach(number) & ~outcome.covered for number in good):
        raise InvariantError(f"robots {good} live, but not all was searched {seed}")
    silent = [number for number in good if number not in outcome.declared]
    if silent:
        raise InvariantError(f"robots {silent} live, but never found that all was searched {seed}")
    kept = sum(vehicle.waited for vehicle in outcome.vehicles.values())
    lost = {fault.robot for fault in scenario.faults if isinstance(fault, WrongPosition)}
    bounds = [outcome.vehicles[number].robot.deadline for number in good if number not in lost]
    whole = all(scenario.reach(number) == scenario.brief.everything for number in outcome.vehicles)
    if (
        bounds
        and not kept
        and scenario.brief.energy == inf
        and whole
        and outcome.covered_at > min(bounds) + 1e-6
    ):
        raise InvariantError(
            f"all was searched at {outcome.covered_at:.6g}, alone per robot needs {min(bounds):.6g}"
            f" {seed}"
        )


def searched_by(outcome: SearchWorld, count: int) -> int:
    """Return the cells that so many robots have visited, as bits."""
    sets = []
    for vehicle in outcome.vehicles.values():
        bits = 0
        for _, cell in vehicle.visits:
            bits |= 1 << cell
        sets.append(bits)
    return at_least(sets, count)
