"""What a search episode tells, ready to be drawn: who was where when, whose cells are whose, and what each robot did in turn."""

from __future__ import annotations

from functools import cached_property
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.dataclass import dataclass
from shoal.search import Arc, RobotLog, SearchEpisode
from shoal.search.allocation.partition import partition
from shoal.search.cells.routing import length_of
from shoal.search.problem.faults import Liar, Slow, WrongPosition
from shoal.search.simulation.findings import Finding

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
# Neighbours in the cycle differ in hue and in lightness; all are dark enough for thin lines and white numbers.
ROBOTS = (
    "#0072b2", "#d55e00", "#00805d", "#aa4499", "#946c00", "#2f94d6",
    "#882255", "#5f7a1f", "#d1495b", "#4b3ba6", "#7a4a21", "#138a94",
)  # fmt: skip


def robot_colour(robot: int) -> str:
    """Return the colour of a robot, counted from 0; after twelve they come again, and the numbers tell them apart."""
    return ROBOTS[robot % len(ROBOTS)]


@dataclass(frozen=True, slots=True)
class Activity:
    """A time in which a robot did one thing.

    Parameters
    ----------
    begin, end : float
        In the time of a cell.
    kind : str
        "listening", "own" (searching its own part), "taken" (searching another's), "waiting", "paused", "dead" or "complete".
    other : int
        Whose part, as the number of the robot; 0 if it is nobody's or not another's.
    """

    begin: float
    end: float
    kind: str
    other: int = 0


@dataclass(frozen=True, eq=False)
class RobotTrajectory:
    """Where a robot is at each time.

    Parameters
    ----------
    times : ndarray of float64, shape (k,)
        Rising, in the time of a cell.
    points : ndarray of float64, shape (k, 2)
        Metres; in between it moves straight and evenly, before and after it stands.
    """

    times: Floats
    points: Floats

    def at(self, time: float) -> Floats:
        """Return the place at a time; float64, shape (2,)."""
        return np.array([np.interp(time, self.times, self.points[:, 0]), np.interp(time, self.times, self.points[:, 1])])

    def until(self, time: float) -> Floats:
        """Return the way up to a time; float64, shape (n, 2)."""
        return np.concatenate([self.points[: np.searchsorted(self.times, time, side="right")], self.at(time)[None]])


class SearchHistory:
    """An episode, ready to be drawn.

    The parts are those that all robots agree on who have heard of one another; who was dead from the beginning has none.

    Parameters
    ----------
    episode : SearchEpisode
    """

    def __init__(self, episode: SearchEpisode) -> None:
        self.episode = episode
        self.n_cells = len(episode.plan.tour_cost)
        self.n_robots = len(episode.trace.robots)
        self.liars = frozenset(fault.robot for fault in episode.scenario.faults if isinstance(fault, Liar))

    @cached_property
    def end(self) -> float:
        """When the last thing happened, in the time of a cell; above 0."""
        moments = [state[0] for log in self.episode.trace.robots for state in log.states]
        moments += [float(log.times[-1]) for log in self.episode.trace.robots if log.times.size]
        return max([1.0, *moments, *self.episode.trace.declared.values()])

    @cached_property
    def owners(self) -> tuple[Numbers, dict[int, int]]:
        """Whose each cell was to search, by number on the tour (0: nobody's), and the order of the robots round the tour."""
        episode, tour_cost, scenario = self.episode, self.episode.plan.tour_cost, self.episode.scenario
        owner = np.zeros(self.n_cells, dtype=np.int64)
        if not episode.simulated:
            works = list(enumerate(episode.plan.allocation.arcs, start=1))
        else:
            off = {fault.robot: fault.off for fault in episode.scenario.faults if isinstance(fault, WrongPosition)}
            known = [
                (number, (start + off.get(number, 0)) % self.n_cells, rate, width)
                for number, (start, rate, width) in enumerate(zip(scenario.starts, scenario.rates, scenario.widths, strict=True), 1)
                if episode.trace.robots[number - 1].states[:1] != ((0.0, "dead"),)
            ]
            parts = partition(tour_cost, episode.plan.allocation.allocator, tuple(known)) if known else ()
            works = [(part.robot, part.arcs) for part in parts]
        for number, arcs in works:
            owner[episode.plan.numbers(arcs)] = number
        return owner, {number: rank for rank, (number, _) in enumerate(works)}

    def arcs(self, robot: int) -> tuple[Arc, ...]:
        """Return the plan's work of a robot, counted from 0."""
        return self.episode.plan.allocation.arcs[robot]

    def others(self, robot: int) -> Numbers:
        """Return whose part each cell belonged to that a robot stopped to search, 0 where it was its own work; int64, shape (k,).

        With a wider footprint: its own if any was that it had not seen before, else whose most of these were.
        """
        owner, ranks = self.owners
        theirs = owner[self.episode.trace.robots[robot].cells]
        if self.episode.plan.widths[robot] > 1:
            fresh = np.ones(self.n_cells, dtype=np.bool_)
            for k, seen in enumerate(self.episode.seen[robot]):
                whose = owner[seen[fresh[seen]]]
                theirs[k] = robot + 1 if robot + 1 in whose else np.bincount(whose, minlength=1).argmax()
                fresh[seen] = False
        number, multiplicity = robot + 1, self.episode.scenario.brief.multiplicity
        if number not in ranks:
            return theirs
        mine = theirs == number
        for other, rank in ranks.items():  # where cells are searched by several, the parts ahead are its own work, too
            if (rank - ranks[number]) % len(ranks) < multiplicity:
                mine |= theirs == other
        return np.where(mine, 0, theirs)

    @cached_property
    def first(self) -> tuple[Floats, Numbers]:
        """When each cell was first searched by a robot that does not lie (infinite if never), and by which (0 if by none)."""
        times, by = np.full(self.n_cells, inf), np.zeros(self.n_cells, dtype=np.int64)
        for number, log in enumerate(self.episode.trace.robots, start=1):
            if number not in self.liars and log.cells.size:
                cells, earliest = _earliest(self.episode.seen[number - 1], log)
                new = earliest < times[cells]
                times[cells[new]], by[cells[new]] = earliest[new], number
        return times, by

    def seen_at(self, robot: int) -> Floats:
        """Return when a robot first saw each cell that it searched, rising; float64, shape (k,)."""
        log = self.episode.trace.robots[robot]
        return np.sort(_earliest(self.episode.seen[robot], log)[1]) if len(log.cells) else np.zeros(0)

    @cached_property
    def taken(self) -> NDArray[np.bool_]:
        """Which cells were first searched by a robot that had taken them over; bool, by number on the tour."""
        found = np.zeros(self.n_cells, dtype=np.bool_)
        for robot in range(self.n_robots):
            seen = self.episode.seen[robot]
            over = np.concatenate([*(seen[k] for k in np.flatnonzero(self.others(robot) > 0)), np.zeros(0, dtype=np.int64)])
            found[over[self.first[1][over] == robot + 1]] = True
        return found

    def searched(self, time: float) -> int:
        """Return how many cells had been searched at a time."""
        return int(np.count_nonzero(self.first[0] <= time))

    def death(self, robot: int) -> float:
        """Return when a robot died; infinite if it did not."""
        return next((moment for moment, state in self.episode.trace.robots[robot].states if state == "dead"), inf)

    @cached_property
    def activities(self) -> tuple[tuple[Activity, ...], ...]:
        """What each robot did."""
        return tuple(tuple(self._activities(robot)) for robot in range(self.n_robots))

    def _activities(self, robot: int) -> list[Activity]:
        log = self.episode.trace.robots[robot]
        found: list[Activity] = []
        bounds = [moment for moment, _ in log.states] + [self.end]
        others = self.others(robot)
        for (begin, state), end in zip(log.states, bounds[1:], strict=True):
            if state == "searching":
                inside = np.flatnonzero((log.times > begin) & (log.times <= end))
                _add_searching(found, begin, end, log.times[inside], others[inside])
            elif end > begin or state in ("dead", "complete"):
                found.append(Activity(begin, end, state))
        return found

    @cached_property
    def trajectories(self) -> tuple[RobotTrajectory, ...]:
        """Where each robot was, as `on_picture`."""
        found = (self._trajectory(robot) for robot in range(self.n_robots))
        return tuple(RobotTrajectory(one.times, self.on_picture(one.points)) for one in found)

    def on_picture(self, points: Floats) -> Floats:
        """Return points of the region as they are drawn: rows of cells level, whatever their angle; metres."""
        return self.episode.plan.grid.lattice.from_region(points)

    @property
    def north(self) -> float | None:
        """By how much north is turned from up, degrees clockwise; None for a region without a place on Earth."""
        return None if self.episode.plan.grid.region.frame is None else self.episode.plan.grid.angle

    def place_of(self, finding: Finding) -> Floats:
        """Return where a finding is drawn, float64, shape (2,)."""
        return self.on_picture(self.episode.plan.tour_cost.points[finding.cell] * self.episode.plan.grid.size)

    def stop_ends(self, robot: int) -> Numbers:
        """Return where on its route a robot has searched each of its cells, before them its start; int64, shape (k + 1,)."""
        grid, cells = self.episode.plan.grid, self.episode.plan.tour.cells[self.episode.trace.robots[robot].cells]
        if not len(cells):
            return np.zeros(1, dtype=np.int64)
        index = grid.ordinals(cells)
        counts = grid.viewpoint_starts[index + 1] - grid.viewpoint_starts[index]
        if any(detours := self.episode.trace.robots[robot].detours):
            counts = counts + np.array([len(passed) for passed in detours], dtype=np.int64)
        return np.asarray(self.episode.routes[robot].stops[np.concatenate([[0], np.cumsum(counts)])])

    def _rate(self, robot: int, times: Floats) -> Floats:
        """Return how fast a robot moved before each time."""
        rates = np.full(len(times), self.episode.scenario.rates[robot])
        for fault in self.episode.scenario.faults:
            if isinstance(fault, Slow) and fault.robot == robot + 1:
                rates[times > fault.time] /= fault.factor
        return rates

    def _trajectory(self, robot: int) -> RobotTrajectory:
        """Lay the route of a robot out in time: it comes to each cell when it has searched it, and sets out as late as it can."""
        log = self.episode.trace.robots[robot]
        if not len(log.cells):
            return self._first_leg(robot)
        route, size = self.episode.routes[robot], self.episode.plan.grid.size
        ends = self.stop_ends(robot)
        far = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(route.points, axis=0).T))])
        lengths = np.diff(far[ends]) / size
        rates = self._rate(robot, log.times)
        arrivals = log.times.copy()
        arrivals[0] = max(arrivals[0] - 1.0 / rates[0], 0.0)  # in the first cell it searches where it stands
        lasting = np.where(np.arange(len(lengths)) == 0, lengths, np.maximum(lengths, 1.0)) / rates
        departures = np.maximum(arrivals - lasting, np.concatenate([[0.0], log.times[:-1]]))
        leg = np.repeat(np.arange(len(lengths)), np.diff(ends))
        share = (far[1:] - far[ends[leg]]) / np.maximum(np.diff(far[ends])[leg], 1e-300)
        share[ends[1:] - 1] = 1.0
        moments = departures[leg] + share * (arrivals - departures)[leg]
        times = np.insert(np.concatenate([[0.0], moments]), ends[:-1] + 1, departures)
        points = np.insert(route.points, ends[:-1] + 1, route.points[ends[:-1]], axis=0)
        times = np.maximum.accumulate(times)
        new = np.concatenate([[True], (np.diff(times) > 1e-9) | (np.abs(np.diff(points, axis=0)).max(axis=1) > 0)])
        return self._with_ways_home(robot, RobotTrajectory(times[new], points[new]))

    def _with_ways_home(self, robot: int, trajectory: RobotTrajectory) -> RobotTrajectory:
        """Lay in the ways to the start and back where a robot recharged: so long was it away between two cells."""
        plan, log, brief = self.episode.plan, self.episode.trace.robots[robot], self.episode.scenario.brief
        if brief.energy == inf or plan.tour_cost.stepwise:  # the latter's ways home are a part of the route
            return trajectory
        start, rates, size = int(plan.starts[robot]), self._rate(robot, log.times), plan.grid.size
        times, points, home = trajectory.times, trajectory.points, plan.places[robot][None]
        for k in range(len(log.cells) - 1, 0, -1):
            one, other = int(log.cells[k - 1]), int(log.cells[k])
            there, back = plan.tour_cost.length(one, start) / rates[k], plan.tour_cost.length(start, other) / rates[k]
            if abs(log.times[k] - log.times[k - 1] - there - brief.recharge - back - 1 / rates[k]) > 1e-6:
                continue
            first, last = np.searchsorted(times, log.times[k - 1], side="right"), np.searchsorted(times, log.times[k], side="left")
            left = log.times[k - 1]
            ways = [
                plan.paths.legs(np.concatenate(ends)).points
                for ends in ((points[first - 1 : first], home), (home, points[last : last + 1]))
            ]
            moments = [
                begin
                + span * np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))]) / max(length_of(way), size * 1e-9)
                for way, begin, span in zip(ways, (left, left + there + brief.recharge), (there, back), strict=True)
            ]
            times = np.concatenate([times[:first], *moments, times[last:]])
            points = np.concatenate([points[:first], *ways, points[last:]])
        return RobotTrajectory(times, points)

    def _first_leg(self, robot: int) -> RobotTrajectory:
        """Return the trajectory of a robot that searched nothing: as far as it came on the way to its part."""
        plan, died = self.episode.plan, self.death(robot)
        home = plan.places[robot]
        cells = plan.numbers(self.arcs(robot))
        began = next((moment for moment, state in self.episode.trace.robots[robot].states if state == "searching"), inf)
        if not (len(cells) and began < died < inf):
            return RobotTrajectory(np.zeros(1), home[None])
        way = plan.paths.legs(np.stack([home, plan.grid.waypoint(tuple(plan.tour.cells[cells[0]]))])).points
        rate = float(self._rate(robot, np.array([died]))[0])
        times = began + np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))]) / plan.grid.size / rate
        whole = RobotTrajectory(times, way)
        kept = whole.until(min(died, float(times[-1])))
        return RobotTrajectory(np.append(times[: len(kept) - 1], min(died, float(times[-1]))), kept)

    def raster(self, values: Any, empty: Any) -> Any:
        """Return values by number on the tour as an array of the grid's shape."""
        grid, cells = self.episode.plan.grid, self.episode.plan.tour.cells
        values = np.asarray(values)
        found = np.full((*grid.shape, *values.shape[1:]), empty, dtype=values.dtype)
        found[tuple(cells.T)] = values
        return found

    @cached_property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of the grid, metres."""
        grid = self.episode.plan.grid
        left, top = grid.corner
        height, width = grid.shape
        return left, left + width * grid.size, top - height * grid.size, top

    def outline(self, robot: int) -> Floats:
        """Return the sides around the cells that a robot was first to search for another one; shape (k, 2, 2), metres."""
        mask = self.raster((self.first[1] == robot + 1) & self.taken, False)
        left, _, _, top = self.extent
        size = self.episode.plan.grid.size
        padded = np.pad(mask, 1)
        rows, cols = np.nonzero(padded[:, 1:] != padded[:, :-1])
        upright = np.stack([np.stack([cols, rows - 1], axis=1), np.stack([cols, rows], axis=1)], axis=1)
        across_rows, across_cols = np.nonzero(padded[1:] != padded[:-1])
        level = np.stack([np.stack([across_cols - 1, across_rows], axis=1), np.stack([across_cols, across_rows], axis=1)], axis=1)
        corners = np.concatenate([upright, level]).astype(np.float64)
        return np.asarray(corners * (size, -size) + (left, top))


def _earliest(seen: tuple[Numbers, ...], log: RobotLog) -> tuple[Numbers, Floats]:
    cells, index = np.unique(np.concatenate(seen), return_index=True)
    return cells, log.times[np.repeat(np.arange(len(seen)), [len(some) for some in seen])[index]]


def _add_searching(found: list[Activity], begin: float, end: float, times: Floats, others: Numbers) -> None:
    """Add what a robot searched from one time to another: a activity for each part."""
    bounds = np.flatnonzero(np.diff(others)) if len(others) else np.zeros(0, dtype=np.int64)
    owners = [int(others[k]) for k in (*bounds, -1)] if len(others) else [0]
    ends = [*(float(times[k]) for k in bounds), end]
    for other, until in zip(owners, ends, strict=True):
        if until > begin:
            found.append(Activity(begin, until, "taken" if other else "own", other))
        begin = until
