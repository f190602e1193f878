"""The history of a search episode for drawings: each robot's positions and activities, and the robot that searched each cell."""

from __future__ import annotations

from functools import cached_property
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.search import Arc, RobotLog, SearchEpisode
from shoal.search.allocation.partition import partition
from shoal.search.problem.faults import Liar, WrongPosition
from shoal.search.simulation.findings import Finding
from shoal.views.search.panels import LayerPanels
from shoal.views.search.trajectories import RobotTrajectory, RobotWays, death_of

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
# Neighbouring colours of the cycle differ in hue and lightness. All are dark enough for thin lines and white numbers.
ROBOTS = (
    "#0072b2", "#d55e00", "#00805d", "#aa4499", "#946c00", "#2f94d6",
    "#882255", "#5f7a1f", "#d1495b", "#4b3ba6", "#7a4a21", "#138a94",
)  # fmt: skip


def robot_colour(robot: int) -> str:
    """Return the colour of the robot with the index ``robot``, counted from 0.

    If there are more than twelve robots, several robots have the same colour, and only their numbers distinguish them in drawings.
    """
    return ROBOTS[robot % len(ROBOTS)]


@dataclass(frozen=True, slots=True)
class Activity:
    """A period in which a robot had one activity.

    Parameters
    ----------
    begin, end : float
        Start and end of the period, in cell times (the time that a robot of speed 1 needs for one cell).
    kind : str
        "listening", "own" (searching its own part), "taken" (searching the part of another robot), "waiting", "paused", "dead" or
        "complete".
    other : int
        Number of the other robot whose part the robot searches, or 0 in all other activities.
    """

    begin: float
    end: float
    kind: str
    other: int = 0


class SearchHistory:
    """A search episode with additional data for drawing.

    The class computes the robots' parts of the tour as if all robots knew about each other. A robot that is dead from the beginning
    has no part.
    """

    def __init__(self, episode: SearchEpisode) -> None:
        self.episode = episode
        self.n_cells = len(episode.plan.tour_cost)
        self.n_robots = len(episode.trace.robots)
        self.liars = frozenset(fault.robot for fault in episode.scenario.faults if isinstance(fault, Liar))

    @cached_property
    def end(self) -> float:
        """Time of the last event of the search, in cell times (the time that a robot of speed 1 needs for one cell); at least 1."""
        moments = [state[0] for log in self.episode.trace.robots for state in log.states]
        moments += [float(log.times[-1]) for log in self.episode.trace.robots if log.times.size]
        return max([1.0, *moments, *self.episode.trace.declared.values()])

    @cached_property
    def owners(self) -> tuple[Numbers, dict[int, int]]:
        """The owner of each cell in the order of the tour, and the rank of each robot.

        The owner of a cell is the number of the robot whose part contains the cell, or 0 if no part contains the cell. The rank of
        a robot is its position in the order of the robots along the tour, counted from 0. The dictionary of the ranks has the
        numbers of the robots as keys.
        """
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
        """Return the arcs (stretches of the tour) that the plan gives to the robot with the index ``robot``, counted from 0."""
        return self.episode.plan.allocation.arcs[robot]

    def others(self, robot: int) -> Numbers:
        """Return, for each stop of a robot, the number of the other robot in whose part the stop lies, or 0; int64, shape (k,).

        A stop is a cell in which the robot searched. For a stop in the robot's own part of the tour, the value is 0. With a
        footprint wider than one cell, the value is 0 if the robot sees at least one new cell of its own part. If the robot sees new
        cells of other parts only, the value names the part with the most newly seen cells. If several robots must search each cell,
        the parts of the next robots along the tour also count as the robot's own part.
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
        for other, rank in ranks.items():  # if several robots search each cell, the parts ahead also belong to its own work
            if (rank - ranks[number]) % len(ranks) < multiplicity:
                mine |= theirs == other
        return np.where(mine, 0, theirs)

    @cached_property
    def first(self) -> tuple[Floats, Numbers]:
        """The time of the first search of each cell, and the number of the searching robot; infinity and 0 for an unsearched cell.

        A search by a robot with the fault `Liar` does not count.
        """
        times, by = np.full(self.n_cells, inf), np.zeros(self.n_cells, dtype=np.int64)
        for number, log in enumerate(self.episode.trace.robots, start=1):
            if number not in self.liars and log.cells.size:
                cells, earliest = _earliest(self.episode.seen[number - 1], log)
                new = earliest < times[cells]
                times[cells[new]], by[cells[new]] = earliest[new], number
        return times, by

    def seen_at(self, robot: int) -> Floats:
        """Return, in increasing order, the times at which a robot first saw the cells that it searched; float64, shape (k,)."""
        log = self.episode.trace.robots[robot]
        return np.sort(_earliest(self.episode.seen[robot], log)[1]) if len(log.cells) else np.zeros(0)

    @cached_property
    def taken(self) -> NDArray[np.bool_]:
        """For each cell in tour order, whether the first search came from a stop in another robot's part (see `others`); bool."""
        found = np.zeros(self.n_cells, dtype=np.bool_)
        for robot in range(self.n_robots):
            seen = self.episode.seen[robot]
            over = np.concatenate([*(seen[k] for k in np.flatnonzero(self.others(robot) > 0)), np.zeros(0, dtype=np.int64)])
            found[over[self.first[1][over] == robot + 1]] = True
        return found

    def searched(self, time: float) -> int:
        """Return the number of cells that robots have searched up to a given time."""
        return int(np.count_nonzero(self.first[0] <= time))

    def death(self, robot: int) -> float:
        """Return the time at which a robot failed, or infinity if it never failed."""
        return death_of(self.episode.trace.robots[robot])

    @cached_property
    def activities(self) -> tuple[tuple[Activity, ...], ...]:
        """The activities of each robot in the order of time."""
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
        """The trajectory of each robot in drawing coordinates (see `on_picture`)."""
        found = (self.ways.trajectory(robot) for robot in range(self.n_robots))
        return tuple(RobotTrajectory(one.times, self.on_picture(one.points)) for one in found)

    def on_picture(self, points: Floats) -> Floats:
        """Convert points of the region to drawing coordinates in metres, in which the rows of cells are horizontal.

        A third column of ``points`` contains the layer of each point. If ``points`` has two columns, all points are in the lowest
        layer.
        """
        return self.panels.place(points[:, :2], points[:, 2] if points.shape[1] == 3 else np.zeros(len(points)))

    @cached_property
    def panels(self) -> LayerPanels:
        """The panels of the drawing, one for each layer of cells."""
        return LayerPanels(self.episode.plan)

    @cached_property
    def ways(self) -> RobotWays:
        """The paths of all robots."""
        return RobotWays(self.episode)

    @property
    def circle(self) -> float:
        """Radius, in metres, of the circles in which a fixed-wing aircraft waits; 0 for other vehicles."""
        return self.episode.plan.vehicle.ground_radius

    @property
    def north(self) -> float | None:
        """Direction of north in the drawing, in degrees clockwise from up; None for a region without a position on Earth."""
        return None if self.episode.plan.grid.region.frame is None else self.panels.angle

    def place_of(self, finding: Finding) -> Floats:
        """Return the position of a finding in drawing coordinates, in metres; float64, shape (2,)."""
        plan = self.episode.plan
        place = plan.positions([finding.cell])[:, :2]
        return np.asarray(self.panels.place(place, plan.tour.cells[[finding.cell], 0])[0])

    def raster(self, values: Any, empty: Any) -> Any:
        """Return the value of each square in the drawing.

        The array ``values`` contains one value for each cell, in the order of the tour. A square without a cell gets the value
        ``empty``.
        """
        values = np.asarray(values)
        return np.concatenate([values, np.full((1, *values.shape[1:]), empty, dtype=values.dtype)])[self.panels.numbers]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """The left, right, bottom and top edges of all cells in the drawing, in metres."""
        return self.panels.extent

    @property
    def sides(self) -> tuple[float, float, float, float]:
        """The left, right, bottom and top edges of the drawing in metres, including paths from launch points outside the region."""
        left, right, bottom, top = self.extent
        x, y = np.concatenate([self.on_picture(self.ways.of(robot)) for robot in range(self.n_robots)]).T
        seen = min(left, float(x.min())), max(right, float(x.max())), min(bottom, float(y.min())), max(top, float(y.max()))
        beyond = 0.0 if seen == self.extent else 0.5 * self.episode.plan.grid.size
        return seen[0] - beyond, seen[1] + beyond, seen[2] - beyond, seen[3] + beyond

    def outline(self, robot: int) -> Floats:
        """Return the border of all cells that a robot searched in other robots' parts, as segments in metres; shape (k, 2, 2)."""
        mask = self.raster((self.first[1] == robot + 1) & self.taken, False)
        left, _, _, top = self.extent
        size = self.panels.step
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
    """Add to ``found`` the searching activities of a robot between two times, one activity for each searched part."""
    bounds = np.flatnonzero(np.diff(others)) if len(others) else np.zeros(0, dtype=np.int64)
    owners = [int(others[k]) for k in (*bounds, -1)] if len(others) else [0]
    ends = [*(float(times[k]) for k in bounds), end]
    for other, until in zip(owners, ends, strict=True):
        if until > begin:
            found.append(Activity(begin, until, "taken" if other else "own", other))
        begin = until
