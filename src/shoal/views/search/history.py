"""What a search looked like at each time: paths, states, and the panels that show them."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from math import ceil, inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.geometry import partial_sums, segments_of
from shoal.search import RobotLog, SearchEpisode
from shoal.search.allocation.allocate import partition
from shoal.search.cells.clipping import own_piece
from shoal.search.cells.grid import CellGrid
from shoal.search.cells.lanes import LineLattice
from shoal.search.cells.layers import layers_of
from shoal.search.planning.plan import SearchPlan
from shoal.search.problem.network import Liar, Slow, WrongPosition
from shoal.search.problem.target import Ground, Looks, MovingGround
from shoal.search.simulation.trace import Finding, cell_spans
from shoal.views.drawing.canvas import rings_of

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
        Positions of the robot at ``times``, in metres. The robot moves uniformly from one position
        to the next. Before the first and after the last time, the robot stands still.
    """

    times: Floats
    points: Floats

    def at(self, time: float) -> Floats:
        """Return the position of the robot at a given time, in metres; float64, shape (2,)."""
        return np.array([np.interp(time, self.times, column) for column in self.points.T])

    def until(self, time: float) -> Floats:
        """Return the path of the robot up to a given time, as positions in metres; float64, shape
        (n, 2).
        """
        return np.concatenate(
            [self.points[: np.searchsorted(self.times, time, side="right")], self.at(time)[None]]
        )


class RobotRoutes:
    """The paths of all robots in a search episode."""

    def __init__(self, episode: SearchEpisode) -> None:
        self.episode = episode

    def stop_ends(self, robot: int) -> Numbers:
        """Return indices of points of a robot's route; int64, shape (k + 1,).

        The indices are those of the start and of the k points at which the robot searched a cell.
        """
        log, route = self.episode.trace.robots[robot], self.episode.routes[robot]
        ends = (
            cell_spans(self.episode.plan, route, log)[:, 1]
            if len(log.cells)
            else np.zeros(0, dtype=np.int64)
        )
        return np.concatenate([[0], ends])

    def of(self, robot: int) -> Floats:
        """Return the route of a robot, (x, y) in metres and possibly the layer; float64, shape (k,
        2) or (k, 3).

        If the grid has several layers, a third column holds the layer. A point between two cells
        belongs to the layer with the nearer altitude. If the altitudes of both cells are equally
        near, a point between them belongs to the layer of the second cell.
        """
        plan = self.episode.plan
        route = self.episode.routes[robot]
        log = self.episode.trace.robots[robot]
        if route.points.shape[1] == 2 or not len(log.cells):
            return route.points[:, :2]
        ends, layers = self.stop_ends(robot), plan.tour.cells[log.cells, 0]
        cell = np.clip(np.searchsorted(ends, np.arange(len(route.points))) - 1, 0, len(layers) - 1)
        own_layer, previous_layer = layers[cell], np.concatenate([[0], layers])[cell]
        away = np.abs(
            route.points[:, 2] - np.array(plan.altitudes)[np.stack([own_layer, previous_layer])]
        )
        return np.column_stack(
            [route.points[:, :2], np.where(away[0] <= away[1], own_layer, previous_layer)]
        )

    def _way(self, start: Floats, end: Floats) -> tuple[Floats, Floats]:
        """Return the path between two points (columns as in `of`), and the distance of each point
        from the start, in metres.
        """
        plan = self.episode.plan
        ups = np.array(plan.altitudes)
        if len(ups) == 1:
            path = plan.leg(start, end)
            return path, partial_sums(plan.leg_lengths(path))
        ends = np.array(
            [[*place[:2], place[2] if len(place) == 3 else 0.0] for place in (start, end)]
        )
        heights = ups[ends[:, 2].astype(np.int64)]
        if plan.grid.region.contains(ends[:, :2]).all():
            path = plan.paths.legs(np.column_stack([ends[:, :2], heights])).points
        else:  # an outside launch point: the altitude changes at the beginning of the path
            path = plan.leg(start, end)
            path = np.column_stack([path, np.where(np.arange(len(path)) == 0, *heights)])
        nearer = np.argmin(np.abs(path[:, 2, None] - ups[ends[:, 2].astype(np.int64)]), axis=1)
        far = partial_sums(plan.leg_lengths(path))
        return np.column_stack([path[:, :2], ends[nearer, 2]]), far

    def _rate(self, robot: int, times: Floats) -> Floats:
        """Return the relative speed of a robot just before each of the given times."""
        rates = np.full(len(times), self.episode.scenario.rates[robot])
        for fault in self.episode.scenario.faults:
            if isinstance(fault, Slow) and fault.robot == robot + 1:
                rates[times > fault.time] /= fault.factor
        return rates

    def trajectory(self, robot: int) -> RobotTrajectory:
        """Return the trajectory of a robot, that is, its route as a function of time.

        In a drawing, a robot arrives in a cell when it has searched the cell, and departs for the
        next cell as late as possible.
        """
        log = self.episode.trace.robots[robot]
        if not len(log.cells):
            return self._first_leg(robot)
        route, size = self.episode.routes[robot], self.episode.plan.grid.size
        ends = self.stop_ends(robot)
        path = self.of(robot)
        far = partial_sums(self.episode.plan.leg_lengths(route.points))
        lengths = np.diff(far[ends]) / size
        rates = self._rate(robot, log.times)
        arrivals = log.times.copy()
        # it searches the first cell from where it stands
        arrivals[0] = max(arrivals[0] - 1.0 / rates[0], 0.0)
        lasting = np.where(np.arange(len(lengths)) == 0, lengths, np.maximum(lengths, 1.0)) / rates
        departures = np.maximum(arrivals - lasting, np.concatenate([[0.0], log.times[:-1]]))
        leg = np.repeat(np.arange(len(lengths)), np.diff(ends))
        share = (far[1:] - far[ends[leg]]) / np.maximum(np.diff(far[ends])[leg], 1e-300)
        share[ends[1:] - 1] = 1.0
        moments = departures[leg] + share * (arrivals - departures)[leg]
        times = np.insert(np.concatenate([[0.0], moments]), ends[:-1] + 1, departures)
        points = np.insert(path, ends[:-1] + 1, path[ends[:-1]], axis=0)
        times = np.maximum.accumulate(times)
        new = np.concatenate(
            [[True], (np.diff(times) > 1e-9) | (np.abs(np.diff(points, axis=0)).max(axis=1) > 0)]
        )
        return self._with_paths_home(robot, RobotTrajectory(times[new], points[new]))

    def _with_paths_home(self, robot: int, trajectory: RobotTrajectory) -> RobotTrajectory:
        """Return the trajectory with a path to the launch point and back wherever the robot
        recharged between two searched cells.

        The time between the two searches shows that the robot recharged.
        """
        plan = self.episode.plan
        log = self.episode.trace.robots[robot]
        brief = self.episode.scenario.brief
        # the latter's paths home are part of the route
        if brief.energy == inf or plan.tour_cost.stepwise:
            return trajectory
        start, rates, size = int(plan.starts[robot]), self._rate(robot, log.times), plan.grid.size
        times, points, home = trajectory.times, trajectory.points, self._home(robot)
        for k in range(len(log.cells) - 1, 0, -1):
            last_cell, next_cell = int(log.cells[k - 1]), int(log.cells[k])
            flight_home = plan.tour_cost.length(last_cell, start) / rates[k]
            flight_back = plan.tour_cost.length(start, next_cell) / rates[k]
            if (
                abs(
                    log.times[k]
                    - log.times[k - 1]
                    - flight_home
                    - brief.recharge
                    - flight_back
                    - 1 / rates[k]
                )
                > 1e-6
            ):
                continue
            first = np.searchsorted(times, log.times[k - 1], side="right")
            last = np.searchsorted(times, log.times[k], side="left")
            left_at = log.times[k - 1]
            paths = [self._way(points[first - 1], home), self._way(home, points[last])]
            moments = [
                begin + span * far / max(float(far[-1]), size * 1e-9)
                for (_, far), begin, span in zip(
                    paths,
                    (left_at, left_at + flight_home + brief.recharge),
                    (flight_home, flight_back),
                    strict=True,
                )
            ]
            times = np.concatenate([times[:first], *moments, times[last:]])
            points = np.concatenate([points[:first], *(path for path, _ in paths), points[last:]])
        return RobotTrajectory(times, points)

    def _first_leg(self, robot: int) -> RobotTrajectory:
        """Return the trajectory of a robot that failed before it searched a cell: its path towards
        its part of the tour.
        """
        plan, died = self.episode.plan, death_of(self.episode.trace.robots[robot])
        home, cells = self._home(robot), plan.numbers(plan.allocation.arcs[robot])
        began = next(
            (
                moment
                for moment, state in self.episode.trace.robots[robot].states
                if state == "searching"
            ),
            inf,
        )
        if not (len(cells) and began < died < inf):
            return RobotTrajectory(np.zeros(1), home[None])
        first = plan.positions(cells[:1])[0]
        path, far = self._way(
            home, first if len(first) == 2 else np.append(first[:2], plan.tour.cells[cells[0], 0])
        )
        times = began + far / plan.grid.size / float(self._rate(robot, np.array([died]))[0])
        planned = RobotTrajectory(times, path)
        flown = planned.until(min(died, float(times[-1])))
        return RobotTrajectory(
            np.append(times[: len(flown) - 1], min(died, float(times[-1]))), flown
        )

    def _home(self, robot: int) -> Floats:
        """Return the launch point of a robot, with columns as in `of`."""
        home = self.episode.plan.places[robot]
        return home if len(self.episode.plan.altitudes) == 1 else np.append(home, 0.0)


_EARLY = 1e-3  # cells: times are rounded
_GAP = 0.12  # distance between panels, relative to a panel's longer side
# squares per side of the smallest cell, if cells are no squares of the drawing: as many as the
# drawing has room for
_FINE = 2, 12
SHADE = 0.6
"""Exponent of the probability per cell that gives the strength of its colour."""

_STRONGEST = 0.995  # quantile of the probability per cell that gets the full colour
_SQUARES = 100_000  # in a drawing of one layer


class LayerPanels:
    """A drawing of the cells of all layers, one panel for each layer. The drawing consists of rows
    of squares.

    North is up. If the rows of cells run from west to east or from south to north, each square of
    the drawing is a cell. If they run at another angle or along a line, or if layers differ in
    their cells, the squares of the drawing are smaller than cells. The panels of the layers follow each other
    from left to right and then downwards, beginning with the lowest layer.
    """

    def __init__(self, plan: SearchPlan) -> None:
        self.plan, self.layers = plan, layers_of(plan.grid)
        first = self.layers[0]
        upright = first.angle % 90 == 0 and not isinstance(first.lattice, LineLattice)
        self.alike = upright and all(layer is first for layer in self.layers)
        boxes = np.array([self._box(layer) for layer in dict.fromkeys(self.layers)])
        area = float(np.prod(boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)))
        parts = round(float(np.clip(plan.grid.size * (_SQUARES / area) ** 0.5, *_FINE)))
        self.step = first.size if self.alike else plan.grid.size / parts
        self.largest = max(layer.size for layer in self.layers)
        low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        # rows and columns
        self._panel = np.rint(np.ceil((high - low) / self.step - 1e-6)).astype(np.int64)[::-1]
        self._low_left = np.array([low[0], high[1] - self.step * self._panel[0]])
        gap = max(1, ceil(_GAP * int(self._panel.max()))) if len(self.layers) > 1 else 0
        wide = float(self._panel[1] + gap) / float(self._panel[0] + gap)
        self.columns = min(len(self.layers), max(1, round(sqrt(1.5 * len(self.layers) / wide))))
        self._apart = self._panel + gap

    def _box(self, layer: CellGrid) -> tuple[Floats, Floats]:
        """Return the lower left and upper right corner of a box around a layer's cells, in drawing
        coordinates in metres.
        """
        if isinstance(layer.lattice, LineLattice):
            low, high = np.array(layer.region.area.bounds).reshape(2, 2)
            return low, high
        (left, top), (rows, columns) = layer.corner, layer.shape
        across, down = columns * layer.size, rows * layer.size
        corners = layer.lattice.to_region(
            np.array(
                [(left, top), (left + across, top), (left, top - down), (left + across, top - down)]
            )
        )
        return corners.min(axis=0), corners.max(axis=0)

    def _offsets(self, layers: Numbers) -> Floats:
        """Return the displacement of the panel of each given layer from the first panel, in metres;
        float64, shape (n, 2).
        """
        return (
            np.stack(
                [
                    layers % self.columns * self._apart[1],
                    -(layers // self.columns) * self._apart[0],
                ],
                axis=1,
            )
            * self.step
        )

    def place(self, points: Floats, layers: Floats | Numbers) -> Floats:
        """Convert points of the region in given layers to drawing coordinates in metres; float64,
        shape (n, 2).
        """
        return points if len(self.layers) == 1 else points + self._offsets(layers.astype(np.int64))

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Number of rows and number of columns of squares in the whole drawing."""
        down = ceil(len(self.layers) / self.columns)
        rows, columns = (self._apart * (down - 1, self.columns - 1) + self._panel).tolist()
        return rows, columns

    @property
    def first_extent(self) -> tuple[float, float, float, float]:
        """The left, right, bottom and top edges of the panel of the lowest layer, in metres."""
        left, top = float(self._low_left[0]), float(self._low_left[1] + self.step * self._panel[0])
        down, right = (self._panel * self.step).tolist()
        return left, left + right, top - down, top

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """The left, right, bottom and top edges of all squares of the drawing, in metres."""
        left, top = float(self._low_left[0]), float(self._low_left[1] + self.step * self._panel[0])
        return left, left + self.shape[1] * self.step, top - self.shape[0] * self.step, top

    @cached_property
    def numbers(self) -> Numbers:
        """For each square of the drawing, the tour index of the cell that contains the square, or
        -1; int64, of shape `shape`.
        """
        numbers = np.full(self.shape, -1, dtype=np.int64)
        position = self.plan.tour.position
        rows, columns = self._panel.tolist()
        left, top = self.extent[0], self.extent[3]
        for number, layer in enumerate(self.layers):
            down, right = divmod(number, self.columns)
            y, x = np.indices((rows, columns)) + 0.5
            x, y = left + self.step * x, top - self.step * y
            middles = layer.lattice.from_region(np.column_stack([x.ravel(), y.ravel()]))
            row, col = layer.lattice.cells_at(middles)
            inside = (row >= 0) & (col >= 0) & (row < layer.shape[0]) & (col < layer.shape[1])
            own = position if position.ndim == 2 else position[number]
            cells = np.full(len(middles), -1, dtype=np.int64)
            cells[inside] = own[row[inside], col[inside]]
            begin = self._apart * (down, right)
            numbers[begin[0] : begin[0] + rows, begin[1] : begin[1] + columns] = cells.reshape(
                rows, columns
            )
        return numbers

    @cached_property
    def parts(self) -> list[list[Floats]]:
        """The closed border lines of each part of the region in each layer, the outer line first,
        in drawing coordinates.
        """
        shapes = [
            (self.shape_of(layer.region.area, number)) for number, layer in enumerate(self.layers)
        ]
        return [rings for shape in shapes for rings in rings_of(shape)]

    def shape_of(self, shape: Any, layer: int) -> Any:
        """Convert a Shapely geometry from region coordinates to the drawing coordinates
        of a layer.
        """
        from shapely.affinity import translate

        return translate(shape, *self._offsets(np.array([layer]))[0].tolist())

    @property
    def borders(self) -> list[Floats]:
        """The borders between the cells of all layers, as lines in drawing coordinates; float64, each
        of shape (k, 2).
        """
        lines = []
        for number, layer in enumerate(self.layers):
            to_region, where = layer.lattice.to_region, np.full(2, number)
            if isinstance(layer.lattice, LineLattice):
                rings = [ring for piece in layer.clipped.pieces for ring in rings_of(piece)[0]]
                lines += [self.place(to_region(ring), np.full(len(ring), number)) for ring in rings]
                continue
            (left, top), (rows, columns), side = layer.corner, layer.shape, layer.size
            right, low = left + columns * side, top - rows * side
            upright = [[(x, low), (x, top)] for x in left + side * np.arange(1, columns)]
            level = [[(left, y), (right, y)] for y in low + side * np.arange(1, rows)]
            lines += [self.place(to_region(np.array(line)), where) for line in (*upright, *level)]
        return lines

    @property
    def labels(self) -> list[tuple[str, float, float]]:
        """The label of each panel, and the x and y of its upper left corner in metres. For a single
        layer, the list is empty.
        """
        if len(self.layers) == 1:
            return []
        ups, tour, (left, _, _, top) = self.plan.altitudes, self.plan.tour, self.extent
        looks = [
            sum((other.whole or other) is (layer.whole or layer) for other in self.layers[: k + 1])
            for k, layer in enumerate(self.layers)
        ]
        first = [k for k, layer in enumerate(self.layers) if layer.whole is None]
        words = []
        for k, layer in enumerate(self.layers):
            own = [f"{ups[k]:.4g} m"] if len({*ups}) > 1 else []
            if layer.whole is not None:
                own.append(f"look {looks[k]} where it pays")
            elif len(first) == 1:
                own.append("first look")
            elif len({ups[up] for up in first}) < len(first):
                own.append(f"rows at {tour.row_angle(layer.angle, k):.4g}\N{DEGREE SIGN}")
            words.append(", ".join(own))
        offsets = self._offsets(np.arange(len(ups)))
        return [
            (word, left + float(x), top + float(y))
            for word, (x, y) in zip(words, offsets, strict=True)
        ]


def sizes_text(plan: SearchPlan) -> str:
    """Return the side of the cells, or the range of sides, as a text such as "8.8 to 14.7 m"."""
    low, high = (choose(layer.size for layer in layers_of(plan.grid)) for choose in (min, max))
    return f"{low:.3g} m" if low == high else f"{low:.3g} to {high:.3g} m"


# Neighbouring colours of the cycle differ in hue and lightness. All are dark enough for thin lines
# and white numbers.
ROBOTS = (
    "#0072b2",
    "#d55e00",
    "#00805d",
    "#aa4499",
    "#946c00",
    "#2f94d6",
    "#882255",
    "#5f7a1f",
    "#d1495b",
    "#4b3ba6",
    "#7a4a21",
    "#138a94",
)


def robot_colour(robot: int) -> str:
    """Return the colour of the robot with the index ``robot``, counted from 0.

    If there are more than twelve robots, several robots have the same colour, and only their
    numbers distinguish them in drawings.
    """
    return ROBOTS[robot % len(ROBOTS)]


@dataclass(frozen=True, slots=True)
class Activity:
    """A period in which a robot had one activity.

    Parameters
    ----------
    begin, end : float
        Start and end of the period, in cell times (the time that a robot of speed 1 needs for one
        cell).
    kind : str
        "listening", "own" (searching its own part), "taken" (searching the part of another robot),
        "waiting", "paused", "dead" or "complete".
    other : int
        Number of the other robot whose part the robot searches, or 0 in all other activities.
    """

    begin: float
    end: float
    kind: str
    other: int = 0


class SearchHistory:
    """A search episode with additional data for drawing.

    All times are in cell times of the whole search. The times of each robot are those of its own
    flights (see `SearchEpisode.clock`), so `clock` of a drawn time gives its seconds.

    The class computes the robots' parts of the tour as if all robots knew about each other. A robot
    that is dead from the beginning has no part.
    """

    def __init__(self, episode: SearchEpisode) -> None:
        self.episode = episode
        self.n_cells = len(episode.plan.tour_cost)
        self.n_robots = len(episode.trace.robots)
        self.liars = frozenset(
            fault.robot for fault in episode.scenario.faults if isinstance(fault, Liar)
        )

    @cached_property
    def _clock(self) -> tuple[float, float]:
        """The second at which the time of the drawing begins, and the seconds of one cell time."""
        start, unit_end = (float(moment) for moment in self.episode.clock([0.0, 1.0]))
        return start, unit_end - start

    def _drawing_times(self, seconds: ArrayLike) -> Floats:
        """Return times of the drawing for seconds since the start of the search."""
        start, unit = self._clock
        return (np.asarray(seconds, dtype=np.float64) - start) / unit

    def drawing_times(self, robot: int, moments: ArrayLike, *, with_return: bool = False) -> Floats:
        """Return the times at which a drawing shows moments of a robot's log.

        A robot is at each of its stops when the episode says that it is (`SearchEpisode.sightings`).
        The last moment is that of its last stop, or, with ``with_return``, that of its return.
        """
        moments = np.asarray(moments, dtype=np.float64)
        log, clock = self.episode.trace.robots[robot], self.episode.clock
        drawn = self._drawing_times(clock(moments, robot))
        if not (self.episode.plan.flies and log.times.size):
            return drawn
        looks = self.episode.sightings[robot].times
        departure = min(
            float(self.episode.plan.delays[robot]) / self.episode.plan.cell_seconds,
            float(log.times[0]),
        )
        knots = [0.0, departure, *log.times.tolist()]
        seconds = [*clock([0.0, departure], robot).tolist(), *looks.tolist()]
        seconds[1] = min(seconds[1], seconds[2])
        before = moments < knots[-1] if with_return else moments <= knots[-1]
        return np.where(before, self._drawing_times(np.interp(moments, knots, seconds)), drawn)

    @cached_property
    def logs(self) -> tuple[RobotLog, ...]:
        """The log of each robot, with the times of the drawing."""
        if not self.episode.plan.flies:
            return self.episode.trace.robots
        drawn_logs = []
        for robot, log in enumerate(self.episode.trace.robots):
            times = self.drawing_times(robot, log.times)
            begins, finds = (
                self.drawing_times(
                    robot, [moment for moment, _ in events], with_return=True
                ).tolist()
                for events in (log.states, log.obstructed)
            )
            states = zip(begins, (state for _, state in log.states), strict=True)
            obstructed = zip(finds, (cell for _, cell in log.obstructed), strict=True)
            drawn_logs.append(
                replace(
                    log,
                    times=times,
                    states=tuple(states),
                    obstructed=tuple(obstructed),
                )
            )
        return tuple(drawn_logs)

    @cached_property
    def end(self) -> float:
        """Time of the last event of the search, in cell times (the time that a robot of speed 1
        needs for one cell); at least 1.
        """
        moments = [state[0] for log in self.logs for state in log.states]
        moments += [float(log.times[-1]) for log in self.logs if log.times.size]
        if self.episode.makespan is not None:
            moments.append(float(self._drawing_times(self.episode.makespan)))
        return max([1.0, *moments, *self.episode.trace.declared.values()])

    @cached_property
    def owners(self) -> tuple[Numbers, dict[int, int]]:
        """The owner of each cell in the order of the tour, and the rank of each robot.

        The owner of a cell is the number of the robot whose part contains the cell, or 0 if no part
        contains the cell. The rank of a robot is its position in the order of the robots along the
        tour, counted from 0. The dictionary of the ranks has the numbers of the robots as keys.
        """
        episode = self.episode
        tour_cost = self.episode.plan.tour_cost
        scenario = self.episode.scenario
        owner = np.zeros(self.n_cells, dtype=np.int64)
        if not episode.simulated:
            works = list(enumerate(episode.plan.allocation.arcs, start=1))
        else:
            off = {
                fault.robot: fault.off
                for fault in episode.scenario.faults
                if isinstance(fault, WrongPosition)
            }
            team = [
                (number, (start + off.get(number, 0)) % self.n_cells, rate, width)
                for number, (start, rate, width) in enumerate(
                    zip(scenario.starts, scenario.rates, scenario.widths, strict=True), 1
                )
                if episode.trace.robots[number - 1].states[:1] != ((0.0, "dead"),)
            ]
            parts = (
                partition(tour_cost, episode.plan.allocation.allocator, tuple(team)) if team else ()
            )
            works = [(part.robot, part.arcs) for part in parts]
        for number, arcs in works:
            owner[episode.plan.numbers(arcs)] = number
        return owner, {number: rank for rank, (number, _) in enumerate(works)}

    def foreign_owners(self, robot: int) -> Numbers:
        """Return, for each stop of a robot, the number of the other robot in whose part the stop
        lies, or 0; int64, shape (k,).

        A stop is a cell in which the robot searched. For a stop in the robot's own part of the
        tour, the value is 0. With a footprint wider than one cell, the value is 0 if the robot sees
        at least one new cell of its own part. If the robot sees new cells of other parts only, the
        value names the part with the most newly seen cells. If several robots must search each
        cell, the parts of the next robots along the tour also count as the robot's own part.
        """
        owner, ranks = self.owners
        theirs = owner[self.episode.trace.robots[robot].cells]
        if self.episode.plan.widths[robot] > 1:
            fresh = np.ones(self.n_cells, dtype=np.bool_)
            for k, cells in enumerate(self.episode.visible_cells[robot]):
                whose = owner[cells[fresh[cells]]]
                theirs[k] = (
                    robot + 1 if robot + 1 in whose else np.bincount(whose, minlength=1).argmax()
                )
                fresh[cells] = False
        number, multiplicity = robot + 1, self.episode.scenario.brief.multiplicity
        if number not in ranks:
            return theirs
        mine = theirs == number
        # if several robots search each cell, the parts ahead also belong to its own work
        for (
            other,
            rank,
        ) in ranks.items():
            if (rank - ranks[number]) % len(ranks) < multiplicity:
                mine |= theirs == other
        return np.where(mine, 0, theirs)

    @cached_property
    def first(self) -> tuple[Floats, Numbers]:
        """The time of the first search of each cell, and the number of the searching robot;
        infinity and 0 for an unsearched cell.

        A search by a robot with the fault `Liar` does not count.
        """
        times, by = np.full(self.n_cells, inf), np.zeros(self.n_cells, dtype=np.int64)
        for number, log in enumerate(self.logs, start=1):
            if number not in self.liars and log.cells.size:
                cells, earliest = _earliest(self.episode.visible_cells[number - 1], log)
                new = earliest < times[cells]
                times[cells[new]], by[cells[new]] = earliest[new], number
        if self.episode.plan.flies:  # a vehicle may first see a cell on its way to a stop
            visits = self.episode.visits
            sight_times = self._drawing_times(visits.times)
            new = sight_times < times
            times[new], by[new] = sight_times[new], visits.robots[new] + 1
        return times, by

    @cached_property
    def _looks(self) -> Looks | None:
        """The looks of robots that tell the truth at where the target may be, with their times in
        the drawing; None without a prior.
        """
        ground = self.episode.plan.ground
        if ground is None:
            return None
        cells, times = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
        for number, own in enumerate(self.episode.sightings, start=1):
            if number not in self.liars and len(own.times):
                cells_of_stops = self.episode.visible_cells[number - 1]
                cells += cells_of_stops
                times.append(
                    np.repeat(own.times, [len(stop_cells) for stop_cells in cells_of_stops])
                )
        looks = ground.looks(np.concatenate(cells), np.concatenate(times))
        seconds = looks.times
        if isinstance(ground, Ground):  # a vehicle may first see a cell on its way to a stop
            sight_times = self.episode.visits.times[looks.cells]
            seconds = np.where(looks.earlier == 0, np.minimum(sight_times, seconds), seconds)
        return replace(looks, times=self._drawing_times(seconds))

    def probabilities(self, time: float) -> Floats:
        """Return the probability that the target is in each cell and not found up to a given time;
        float64, shape (n,). Without a prior, it is 0 everywhere.

        Cells of several layers that show the same ground have the same probability.
        """
        ground, looks = self.episode.plan.ground, self._looks
        probabilities = np.zeros(self.n_cells)
        if ground is None or looks is None:
            return probabilities
        start, unit = self._clock
        seconds = start + unit * float(np.clip(time, 0.0, self.end))
        past = looks.times <= time
        searches = np.bincount(looks.pieces[past], minlength=len(ground.masses))
        masses = ground.masses * (1.0 - self.episode.problem.chosen_detection) ** searches
        still = ground if isinstance(ground, Ground) else ground.still(seconds)
        for column in still.cells.T:
            np.add.at(probabilities, column[column >= 0], masses[column >= 0])
        return probabilities

    def heat(self, time: float) -> Floats:
        """Return how strongly each cell is coloured because the target is likely there and not found
        up to a given time, from 0 to 1; float64, shape (n,).
        """
        return self._shade(self.probabilities(time))

    def _shade(self, likely: Floats) -> Floats:
        return np.asarray(np.clip(likely / self.strongest, 0.0, 1.0) ** SHADE)

    @cached_property
    def cooling(self) -> tuple[Floats, Numbers, Floats]:
        """How looks change the heat of cells (see `heat`) if the target does not move: increasing
        times, cells, and the heat of these cells from then on; float64, int64 and float64, shape
        (k,).
        """
        ground, looks = self.episode.plan.ground, self._looks
        if not isinstance(ground, Ground) or looks is None:
            return np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0)
        # a look changes a piece of the ground, and so each cell that shows the piece
        cells = ground.cells[looks.pieces]
        present = cells >= 0
        missed = (1.0 - self.episode.problem.chosen_detection) ** looks.earlier
        masses = ground.masses[looks.pieces] * missed * self.episode.problem.chosen_detection
        times = np.broadcast_to(looks.times[:, None], cells.shape)[present]
        changes = np.broadcast_to(masses[:, None], cells.shape)[present]
        order = np.lexsort((times, cells[present]))
        times, cells, changes = times[order], cells[present][order], changes[order]
        total = np.cumsum(changes)
        begins = np.searchsorted(cells, cells)  # the first change of the same cell
        before = np.concatenate([[0.0], total])[begins]
        heat = self._shade(np.maximum(self.probabilities(-inf)[cells] - (total - before), 0.0))
        # of changes at the same time, the last one holds
        last = np.append((np.diff(cells) > 0) | (np.diff(times) > 0), True)[: len(cells)]
        order = np.argsort(times[last], kind="stable")
        return times[last][order], cells[last][order], heat[last][order]

    @cached_property
    def strongest(self) -> float:
        """The probability from which on a cell has the full colour of `heat`."""
        return max(float(np.quantile(self.probabilities(-inf), _STRONGEST)), 1e-300)

    @cached_property
    def success(self) -> tuple[Floats, Floats]:
        """Times of searches, in the unit of the trace, and the probability that the target is found
        until each of them. They are empty without a prior.
        """
        success = self.episode.success
        if success is None:
            return np.zeros(0), np.zeros(0)
        return self._drawing_times(success.times), success.probabilities

    def success_at(self, time: float) -> float:
        """Return the probability that the target is found up to a given time."""
        times, probabilities = self.success
        count = int(np.searchsorted(times, time + _EARLY, "right"))
        return float(probabilities[count - 1]) if count else 0.0

    def seen_at(self, robot: int) -> Floats:
        """Return, in increasing order, the times at which a robot first saw the cells that it
        searched; float64, shape (k,).
        """
        log = self.logs[robot]
        return (
            np.sort(_earliest(self.episode.visible_cells[robot], log)[1])
            if len(log.cells)
            else np.zeros(0)
        )

    @cached_property
    def taken_over(self) -> NDArray[np.bool_]:
        """For each cell in tour order, whether the first search came from a stop in another robot's
        part (see `foreign_owners`); bool.
        """
        foreign = np.zeros(self.n_cells, dtype=np.bool_)
        for robot in range(self.n_robots):
            cells_of_stops = self.episode.visible_cells[robot]
            over = np.concatenate(
                [
                    *(cells_of_stops[k] for k in np.flatnonzero(self.foreign_owners(robot) > 0)),
                    np.zeros(0, dtype=np.int64),
                ]
            )
            foreign[over[self.first[1][over] == robot + 1]] = True
        return foreign

    def state_at(self, time: float) -> tuple[int, int]:
        """Return numbers that differ between times at which other cells are searched, or a target
        that moves is elsewhere.
        """
        if isinstance(self.episode.plan.ground, MovingGround):
            return self.searched(time), int(time)
        return self.searched(time), int(np.searchsorted(self.success[0], time, "right"))

    def searched(self, time: float) -> int:
        """Return the number of cells that robots have searched up to a given time."""
        return int(np.count_nonzero(self.first[0] <= time))

    def death(self, robot: int) -> float:
        """Return the time at which a robot failed, or infinity if it never failed."""
        return death_of(self.logs[robot])

    @cached_property
    def activities(self) -> tuple[tuple[Activity, ...], ...]:
        """The activities of each robot in the order of time."""
        return tuple(tuple(self._activities(robot)) for robot in range(self.n_robots))

    def _activities(self, robot: int) -> list[Activity]:
        log = self.logs[robot]
        activities: list[Activity] = []
        bounds = [moment for moment, _ in log.states] + [self.end]
        owners = self.foreign_owners(robot)
        for (begin, state), end in zip(log.states, bounds[1:], strict=True):
            if state == "searching":
                inside = np.flatnonzero((log.times > begin) & (log.times <= end))
                _add_searches(activities, begin, end, log.times[inside], owners[inside])
            elif end > begin or state in ("dead", "complete"):
                activities.append(Activity(begin, end, state))
        return activities

    @cached_property
    def trajectories(self) -> tuple[RobotTrajectory, ...]:
        """The trajectory of each robot in drawing coordinates (see `on_picture`)."""
        trajectories = map(self.routes.trajectory, range(self.n_robots))
        return tuple(
            RobotTrajectory(
                self.drawing_times(robot, trajectory.times), self.on_picture(trajectory.points)
            )
            for robot, trajectory in enumerate(trajectories)
        )

    @cached_property
    def obstacles(self) -> dict[int, float]:
        """The time of discovery of each obstacle that robots found, by the tour index of its
        cell.
        """
        discovered: dict[int, float] = {}
        for moment, cell in sorted(entry for log in self.logs for entry in log.obstructed):
            discovered.setdefault(cell, moment)
        return discovered

    def on_picture(self, points: Floats) -> Floats:
        """Convert points of the region to drawing coordinates in metres, in which the rows of cells
        are horizontal.

        A third column of ``points`` contains the layer of each point. If ``points`` has two
        columns, all points are in the lowest layer.
        """
        return self.panels.place(
            points[:, :2], points[:, 2] if points.shape[1] == 3 else np.zeros(len(points))
        )

    @cached_property
    def panels(self) -> LayerPanels:
        """The panels of the drawing, one for each layer of cells."""
        return LayerPanels(self.episode.plan)

    @cached_property
    def routes(self) -> RobotRoutes:
        """The paths of all robots."""
        return RobotRoutes(self.episode)

    @property
    def circle(self) -> float:
        """Radius, in metres, of the circles in which a fixed-wing aircraft waits; 0 for other
        vehicles.
        """
        return self.episode.plan.vehicle.ground_radius

    @property
    def north(self) -> float | None:
        """Direction of north in the drawing, in degrees clockwise from up: 0, or None for a region
        without a position on Earth.
        """
        return None if self.episode.plan.grid.region.frame is None else 0.0

    def place_of(self, finding: Finding) -> Floats:
        """Return the position of a finding in drawing coordinates, in metres; float64,
        shape (2,).
        """
        plan = self.episode.plan
        place = plan.positions([finding.cell])[:, :2]
        return np.asarray(self.panels.place(place, plan.tour.cells[[finding.cell], 0])[0])

    def raster(self, values: Any, empty: Any) -> Any:
        """Return the value of each square in the drawing.

        The array ``values`` contains one value for each cell, in the order of the tour. A square
        without a cell gets the value ``empty``.
        """
        values = np.asarray(values)
        return np.concatenate([values, np.full((1, *values.shape[1:]), empty, dtype=values.dtype)])[
            self.panels.numbers
        ]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """The left, right, bottom and top edges of all cells in the drawing, in metres."""
        return self.panels.extent

    @property
    def sides(self) -> tuple[float, float, float, float]:
        """The left, right, bottom and top edges of the drawing in metres, including paths from
        launch points outside the region.
        """
        left, right, bottom, top = self.extent
        x, y = np.concatenate(
            [self.on_picture(self.routes.of(robot)) for robot in range(self.n_robots)]
        ).T
        bounds = (
            min(left, float(x.min())),
            max(right, float(x.max())),
            min(bottom, float(y.min())),
            max(top, float(y.max())),
        )
        beyond = 0.0 if bounds == self.extent else 0.5 * self.episode.plan.grid.size
        return bounds[0] - beyond, bounds[1] + beyond, bounds[2] - beyond, bounds[3] + beyond

    def outline(self, robot: int) -> Floats:
        """Return the border of all cells that a robot searched in other robots' parts, as segments
        in metres; shape (k, 2, 2).
        """
        chosen = (self.first[1] == robot + 1) & self.taken_over
        grid = self.episode.plan.grid
        if isinstance(grid, CellGrid) and not self.panels.alike:
            # not along the squares of the drawing, which are smaller than cells
            import shapely

            cells = self.episode.plan.tour.cells[chosen]
            if not len(cells):
                return np.zeros((0, 2, 2))
            shapes = (
                [own_piece(grid.clipped, grid.lattice, grid.own, (r, c)) for r, c in cells.tolist()]
                if isinstance(grid.lattice, LineLattice)
                else grid.lattice.boxes(*cells.T)
            )
            return np.concatenate(
                [
                    segments_of(grid.lattice.to_region(ring))
                    for part in rings_of(shapely.union_all(shapes, grid_size=1e-6))
                    for ring in part
                ]
            )
        mask = self.raster(chosen, False)
        left, _, _, top = self.extent
        size = self.panels.step
        padded = np.pad(mask, 1)
        rows, cols = np.nonzero(padded[:, 1:] != padded[:, :-1])
        upright = np.stack(
            [np.stack([cols, rows - 1], axis=1), np.stack([cols, rows], axis=1)], axis=1
        )
        across_rows, across_cols = np.nonzero(padded[1:] != padded[:-1])
        level = np.stack(
            [
                np.stack([across_cols - 1, across_rows], axis=1),
                np.stack([across_cols, across_rows], axis=1),
            ],
            axis=1,
        )
        corners = np.concatenate([upright, level]).astype(np.float64)
        return np.asarray(corners * (size, -size) + (left, top))


def _earliest(cells_of_stops: tuple[Numbers, ...], log: RobotLog) -> tuple[Numbers, Floats]:
    cells, index = np.unique(np.concatenate(cells_of_stops), return_index=True)
    return cells, log.times[
        np.repeat(np.arange(len(cells_of_stops)), [len(some) for some in cells_of_stops])[index]
    ]


def _add_searches(
    activities: list[Activity], begin: float, end: float, times: Floats, owner_of_stop: Numbers
) -> None:
    """Add to ``activities`` the searching activities of a robot between two times, one activity for
    each searched part.
    """
    bounds = (
        np.flatnonzero(np.diff(owner_of_stop))
        if len(owner_of_stop)
        else np.zeros(0, dtype=np.int64)
    )
    owners = [int(owner_of_stop[k]) for k in (*bounds, -1)] if len(owner_of_stop) else [0]
    ends = [*(float(times[k]) for k in bounds), end]
    for other, until in zip(owners, ends, strict=True):
        if until > begin:
            activities.append(Activity(begin, until, "taken" if other else "own", other))
        begin = until
