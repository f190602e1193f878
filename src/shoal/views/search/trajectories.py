"""Trajectories of robots: the position and the layer of each robot over time."""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.search import RobotLog, SearchEpisode
from shoal.search.problem.faults import Slow
from shoal.search.simulation.coverages import cell_spans

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


def death_of(log: RobotLog) -> float:
    """Return the time at which a robot failed, or infinity if it never failed."""
    return next((moment for moment, state in log.states if state == "dead"), inf)


@dataclass(frozen=True, eq=False)
class RobotTrajectory:
    """The position of a robot as a function of time.

    Parameters
    ----------
    times : ndarray of float64, shape (k,)
        Increasing times, in cell times (the time that a robot of speed 1 needs for one cell).
    points : ndarray of float64, shape (k, 2)
        Positions of the robot at ``times``, in metres. The robot moves uniformly from one position to the next. Before the first
        and after the last time, the robot stands still.
    """

    times: Floats
    points: Floats

    def at(self, time: float) -> Floats:
        """Return the position of the robot at a given time, in metres; float64, shape (2,)."""
        return np.array([np.interp(time, self.times, column) for column in self.points.T])

    def until(self, time: float) -> Floats:
        """Return the path of the robot up to a given time, as positions in metres; float64, shape (n, 2)."""
        return np.concatenate([self.points[: np.searchsorted(self.times, time, side="right")], self.at(time)[None]])


class RobotWays:
    """The paths of all robots in a search episode."""

    def __init__(self, episode: SearchEpisode) -> None:
        self.episode = episode

    def stop_ends(self, robot: int) -> Numbers:
        """Return indices of points of a robot's route; int64, shape (k + 1,).

        The indices are those of the start and of the k points at which the robot searched a cell.
        """
        log, route = self.episode.trace.robots[robot], self.episode.routes[robot]
        ends = cell_spans(self.episode.plan, route, log)[:, 1] if len(log.cells) else np.zeros(0, dtype=np.int64)
        return np.concatenate([[0], ends])

    def of(self, robot: int) -> Floats:
        """Return the route of a robot, (x, y) in metres and possibly the layer; float64, shape (k, 2) or (k, 3).

        If the grid has several layers, a third column holds the layer. A point between two cells belongs to the layer with the
        nearer altitude. If the altitudes of both cells are equally near, a point between them belongs to the layer of the second
        cell.
        """
        plan, route, log = self.episode.plan, self.episode.routes[robot], self.episode.trace.robots[robot]
        if route.points.shape[1] == 2 or not len(log.cells):
            return route.points[:, :2]
        ends, layers = self.stop_ends(robot), plan.tour.cells[log.cells, 0]
        cell = np.clip(np.searchsorted(ends, np.arange(len(route.points))) - 1, 0, len(layers) - 1)
        here, before = layers[cell], np.concatenate([[0], layers])[cell]
        away = np.abs(route.points[:, 2] - np.array(plan.altitudes)[np.stack([here, before])])
        return np.column_stack([route.points[:, :2], np.where(away[0] <= away[1], here, before)])

    def _way(self, start: Floats, end: Floats) -> tuple[Floats, Floats]:
        """Return the path between two points (columns as in `of`), and the distance of each point from the start, in metres."""
        plan = self.episode.plan
        ups = np.array(plan.altitudes)
        if len(ups) == 1:
            found = plan.leg(start, end)
            return found, np.concatenate([[0.0], np.cumsum(plan.leg_lengths(found))])
        ends = np.array([[*place[:2], place[2] if len(place) == 3 else 0.0] for place in (start, end)])
        heights = ups[ends[:, 2].astype(np.int64)]
        if plan.grid.region.contains(ends[:, :2]).all():
            found = plan.paths.legs(np.column_stack([ends[:, :2], heights])).points
        else:  # an outside launch point: the altitude changes at the beginning of the path
            found = plan.leg(start, end)
            found = np.column_stack([found, np.where(np.arange(len(found)) == 0, *heights)])
        nearer = np.argmin(np.abs(found[:, 2, None] - ups[ends[:, 2].astype(np.int64)]), axis=1)
        far = np.concatenate([[0.0], np.cumsum(plan.leg_lengths(found))])
        return np.column_stack([found[:, :2], ends[nearer, 2]]), far

    def _rate(self, robot: int, times: Floats) -> Floats:
        """Return the relative speed of a robot just before each of the given times."""
        rates = np.full(len(times), self.episode.scenario.rates[robot])
        for fault in self.episode.scenario.faults:
            if isinstance(fault, Slow) and fault.robot == robot + 1:
                rates[times > fault.time] /= fault.factor
        return rates

    def trajectory(self, robot: int) -> RobotTrajectory:
        """Return the trajectory of a robot, that is, its route as a function of time.

        In a drawing, a robot arrives in a cell when it has searched the cell, and departs for the next cell as late as possible.
        """
        log = self.episode.trace.robots[robot]
        if not len(log.cells):
            return self._first_leg(robot)
        route, size = self.episode.routes[robot], self.episode.plan.grid.size
        ends = self.stop_ends(robot)
        way = self.of(robot)
        far = np.concatenate([[0.0], np.cumsum(self.episode.plan.leg_lengths(route.points))])
        lengths = np.diff(far[ends]) / size
        rates = self._rate(robot, log.times)
        arrivals = log.times.copy()
        arrivals[0] = max(arrivals[0] - 1.0 / rates[0], 0.0)  # it searches the first cell from where it stands
        lasting = np.where(np.arange(len(lengths)) == 0, lengths, np.maximum(lengths, 1.0)) / rates
        departures = np.maximum(arrivals - lasting, np.concatenate([[0.0], log.times[:-1]]))
        leg = np.repeat(np.arange(len(lengths)), np.diff(ends))
        share = (far[1:] - far[ends[leg]]) / np.maximum(np.diff(far[ends])[leg], 1e-300)
        share[ends[1:] - 1] = 1.0
        moments = departures[leg] + share * (arrivals - departures)[leg]
        times = np.insert(np.concatenate([[0.0], moments]), ends[:-1] + 1, departures)
        points = np.insert(way, ends[:-1] + 1, way[ends[:-1]], axis=0)
        times = np.maximum.accumulate(times)
        new = np.concatenate([[True], (np.diff(times) > 1e-9) | (np.abs(np.diff(points, axis=0)).max(axis=1) > 0)])
        return self._with_ways_home(robot, RobotTrajectory(times[new], points[new]))

    def _with_ways_home(self, robot: int, trajectory: RobotTrajectory) -> RobotTrajectory:
        """Return the trajectory with a path to the launch point and back wherever the robot recharged between two searched cells.

        The time between the two searches shows that the robot recharged.
        """
        plan, log, brief = self.episode.plan, self.episode.trace.robots[robot], self.episode.scenario.brief
        if brief.energy == inf or plan.tour_cost.stepwise:  # the latter's paths home are part of the route
            return trajectory
        start, rates, size = int(plan.starts[robot]), self._rate(robot, log.times), plan.grid.size
        times, points, home = trajectory.times, trajectory.points, self._home(robot)
        for k in range(len(log.cells) - 1, 0, -1):
            one, other = int(log.cells[k - 1]), int(log.cells[k])
            there, back = plan.tour_cost.length(one, start) / rates[k], plan.tour_cost.length(start, other) / rates[k]
            if abs(log.times[k] - log.times[k - 1] - there - brief.recharge - back - 1 / rates[k]) > 1e-6:
                continue
            first, last = np.searchsorted(times, log.times[k - 1], side="right"), np.searchsorted(times, log.times[k], side="left")
            left = log.times[k - 1]
            ways = [self._way(points[first - 1], home), self._way(home, points[last])]
            moments = [
                begin + span * far / max(float(far[-1]), size * 1e-9)
                for (_, far), begin, span in zip(ways, (left, left + there + brief.recharge), (there, back), strict=True)
            ]
            times = np.concatenate([times[:first], *moments, times[last:]])
            points = np.concatenate([points[:first], *(way for way, _ in ways), points[last:]])
        return RobotTrajectory(times, points)

    def _first_leg(self, robot: int) -> RobotTrajectory:
        """Return the trajectory of a robot that failed before it searched a cell: its path towards its part of the tour."""
        plan, died = self.episode.plan, death_of(self.episode.trace.robots[robot])
        home, cells = self._home(robot), plan.numbers(plan.allocation.arcs[robot])
        began = next((moment for moment, state in self.episode.trace.robots[robot].states if state == "searching"), inf)
        if not (len(cells) and began < died < inf):
            return RobotTrajectory(np.zeros(1), home[None])
        first = plan.positions(cells[:1])[0]
        way, far = self._way(home, first if len(first) == 2 else np.append(first[:2], plan.tour.cells[cells[0], 0]))
        times = began + far / plan.grid.size / float(self._rate(robot, np.array([died]))[0])
        whole = RobotTrajectory(times, way)
        kept = whole.until(min(died, float(times[-1])))
        return RobotTrajectory(np.append(times[: len(kept) - 1], min(died, float(times[-1]))), kept)

    def _home(self, robot: int) -> Floats:
        """Return the launch point of a robot, with columns as in `of`."""
        home = self.episode.plan.places[robot]
        return home if len(self.episode.plan.altitudes) == 1 else np.append(home, 0.0)
