"""Helping: the cell that an idle robot searches next, in its own part or in the part of a dead or
late robot.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil

from shoal.core.dataclass import dataclass
from shoal.search.allocation.allocate import Arc
from shoal.search.allocation.costs import TourCost
from shoal.search.kernels.protocol.numbers import WORTH
from shoal.search.protocol.state import Robot, can_come, is_late, is_live, speed_of


@dataclass(frozen=True, slots=True)
class Run:
    """A run of remaining cells, in the order of the search.

    The attribute ``first`` is the tour index of the first cell, and ``count`` is the number of
    cells. The attribute ``step`` is the direction of the search: 1 for increasing tour indices, or
    -1. The attribute ``pace`` is the search rate of the robot that searches the run, or 0 if no
    robot searches the run. The attribute ``late`` is the time until the robot that searches the run
    arrives at the first cell of the run.
    """

    first: int
    count: int
    step: int
    pace: float = 0.0
    late: float = 0.0

    def halves(self, ahead: int, pace: float, n: int, late: float = 0.0) -> list[Run]:
        """Split this run after its first ``ahead`` cells, and return the resulting runs without
        empty runs.

        A robot with the search rate ``pace`` arrives at the second run after the time ``late``, and
        searches it.
        """
        front = Run(self.first, ahead, self.step, self.pace, self.late)
        back = Run((self.first + self.step * ahead) % n, self.count - ahead, self.step, pace, late)
        return [half for half in (front, back) if half.count]


def cell_to_help(robot: Robot, remaining: int, own: int, time: float) -> int | None:
    """Return the cell that an idle robot searches next, in its own part or in the part of a dead or
    late robot.

    The result is None if no such cell remains for the robot, or if the robot would save no time
    there.
    """
    n, parts = len(robot.brief.tour_cost), robot.parts
    count = min(robot.brief.multiplicity, len(parts))
    open_parts = [
        index
        for index, part in enumerate(parts)
        if part.bits & remaining
        and any(_is_left(robot, parts[index - back].robot, own, time) for back in range(count))
    ]
    if not open_parts:
        return None
    helpers = [
        part.robot
        for part in parts
        if part.robot != robot.number and can_come(robot, part.robot, own, time)
    ]
    runs = [
        run
        for index in open_parts
        for arc in parts[index].arcs
        for run in _remaining_runs(robot, arc, remaining, helpers, time)
    ]
    for run in runs:
        if not run.pace and run.first == (robot.cell + run.step) % n:
            return run.first  # the robot continues
    for back in range(1, len(parts) + 1):
        number = parts[open_parts[0] - back].robot
        if number == robot.number:
            best = _best_run(robot, speed_of(robot, number, time), robot.cell, runs)
            return None if best is None else (best[0].first + best[0].step * best[1]) % n
        if (
            number in helpers
            and robot.peers[number].heartbeat.status == "waiting"
            and not is_late(robot, number, time)
        ):
            speed = speed_of(robot, number, time)
            best = _best_run(robot, speed, robot.peers[number].heartbeat.place % n, runs)
            if best is not None:
                runs.remove(best[0])
                runs += best[0].halves(best[1], speed[1], n)
    return None


def is_taken(robot: Robot, cell: int, time: float) -> bool:
    """Return whether another live robot is searching a cell or moving to it."""
    return any(
        peer.heartbeat.place == cell
        and peer.heartbeat.status == "searching"
        and is_live(robot, number, time)
        for number, peer in robot.peers.items()
    )


def leaves_to_others(robot: Robot, own: int, time: float) -> bool:
    """Return whether the robot leaves help to others: the robot is late, and another robot is idle
    and not late.

    A robot that leaves help to others continues only its own work.
    """
    return is_late(robot, robot.number, time) and any(
        peer.heartbeat.status == "waiting"
        and not is_late(robot, number, time)
        and can_come(robot, number, own, time)
        for number, peer in robot.peers.items()
    )


def _is_left(robot: Robot, number: int, own: int, time: float) -> bool:
    return (
        number == robot.number
        or not can_come(robot, number, own, time)
        or is_late(robot, number, time)
    )


def _remaining_runs(
    robot: Robot, arc: Arc, remaining: int, helpers: list[int], time: float
) -> Iterator[Run]:
    """Yield the runs of remaining cells in an arc, in the order of the search. A new run begins
    where another robot searches.
    """
    n = len(robot.brief.tour_cost)
    open_cells = arc.bits(n) & remaining
    fronts: dict[int, tuple[float, float]] = {}
    for number in helpers:
        peer = robot.peers[number]
        heartbeat = peer.heartbeat
        ahead = (heartbeat.place - arc.first) * arc.step % n
        if heartbeat.status == "searching" and ahead < arc.count:
            cell, own = heartbeat.place % n, robot.searched.get(number, 0) & ~open_cells
            rate, pace = speed_of(robot, number, time)
            late = (
                max(peer.since + peer.distance / rate - time, 0.0)
                if open_cells >> cell & 1
                else 0.0
            )
            while own >> cell & 1:  # the peer has searched this cell since it reported its position
                own, cell = own & ~(1 << cell), (cell + arc.step) % n
            if open_cells >> cell & 1:
                fronts[cell] = max(fronts.get(cell, (0.0, 0.0)), (pace, late))
    for first, length in arc.stretches(open_cells, n):
        run = Run(first, length, arc.step)
        places = sorted(
            ((cell - run.first) * arc.step % n, *front) for cell, front in fronts.items()
        )
        halves = [run]
        for ahead, pace, late in [place for place in places if place[0] < length]:
            *before, last = halves
            halves = before + last.halves(
                ahead - (last.first - run.first) * arc.step % n, pace, n, late
            )
        yield from halves


def _best_run(
    robot: Robot, speed: tuple[float, float], at: int, runs: list[Run]
) -> tuple[Run, int] | None:
    """Return the run in which a helper saves the most time, and the number of cells that the helper
    skips at the front of the run.

    In a search with probabilities, it is the run in which the helper finds the target most probably
    in each unit of time. If the helper saves no time in any run, the result is None.
    """
    tour_cost = robot.brief.tour_cost
    rate, pace = speed
    longest = (tour_cost.whole + len(tour_cost)) / pace
    best, most, least = None, -1.0, WORTH / pace
    for run in runs:
        travel = tour_cost.length(at, run.first) / rate
        alone = min(run.late + run.count / run.pace, longest) if run.pace else 2 * longest
        ahead = _cells_to_skip(run, travel, pace)
        # the time without the helper, minus the time until the helper has searched its cells
        work = (run.count - ahead) / pace
        gain = alone - travel - work
        if ahead >= run.count or gain <= least:
            continue
        likely = tour_cost.odds is not None
        value = _likelihood(tour_cost, run, ahead) / (travel + work) if likely else gain
        if value > most:
            best, most = (run, ahead), value
    return best


def _likelihood(tour_cost: TourCost, run: Run, ahead: int) -> float:
    """Return the probability that the target is in a run behind its first ``ahead`` cells."""
    count = run.count - ahead
    low = (run.first + ahead if run.step > 0 else run.first - run.count + 1) % len(tour_cost)
    return float(tour_cost.odds_ahead[low + count] - tour_cost.odds_ahead[low])


def _cells_to_skip(run: Run, travel: float, pace: float) -> int:
    """Return the number of cells that a helper skips at the front of a run. The helper reaches the
    run after the time ``travel``.
    """
    # a slow robot may not yet have reached the last cell
    if not run.pace or run.count == 1:
        return 0
    return max(
        ceil((travel - run.late + run.count / pace) / (1 / run.pace + 1 / pace)),
        int(run.late <= travel),
    )
