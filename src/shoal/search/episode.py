"""SearchEpisode: a search problem with its plan, its scenario, and the trace of what the robots
did.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import (
    check_bool,
    check_integer,
    check_number,
    parse_json,
    read_text,
    shortened,
)
from shoal.core.dataclass import dataclass
from shoal.core.episode import Episode, Status, Verification
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.core.files import check_suffix, write_json, write_text
from shoal.search.cells.layers import layers_of
from shoal.search.cells.routing import Route
from shoal.search.flight.timing import turns_of
from shoal.search.planning.plan import SearchPlan, SortieTimes, end_of, plan_search
from shoal.search.planning.sightings import (
    Sightings,
    Success,
    first_seen,
    sightings_of,
    success_of,
)
from shoal.search.problem import CENTRE, SearchProblem
from shoal.search.problem.network import Liar
from shoal.search.problem.prior import with_contents
from shoal.search.problem.target import MovingGround
from shoal.search.regions.coverage import UNSEEN, AreaCoverage, combine_coverages
from shoal.search.simulation.scenario import Scenario, scenario_of
from shoal.search.simulation.trace import (
    Finding,
    RobotLog,
    SearchTrace,
    coverages,
    least_honest_searches,
    merge_findings,
    planned_trace,
    search_times,
    simulated_trace,
)
from shoal.search.tours.masks import array_to_bits, bits_to_array

FORMAT: Literal[2] = 2


@dataclass(frozen=True, eq=False)
class Visits:
    """The first search of each cell of a tour of N cells.

    Parameters
    ----------
    robots : ndarray of int64, shape (N,)
        The robot that searched the cell first, counted from 0, or -1.
    times : ndarray of float64, shape (N,)
        When it did, in seconds since the start of the search, or infinity.
    """

    robots: NDArray[np.int64]
    times: NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class SearchEpisode(Episode):
    """The result of a search. ``bool(episode)`` is true if its `status` is ``complete``.

    Parameters
    ----------
    problem : SearchProblem
        The problem as the user declared it.
    plan : SearchPlan
    scenario : Scenario
        The scenario of the search, with lengths in cell sides and times in units of `cell_time`.
    trace : SearchTrace
    simulated : bool
        Whether Shoal simulated robots and messages. If false, the search was live, or the trace
        only repeats the plan.
    seed : int
    seconds : float
        Computing time of the planning and the simulation, in seconds.
    versions : mapping of str to str
    """

    part: ClassVar[str] = "search"

    problem: SearchProblem
    plan: SearchPlan
    scenario: Scenario
    trace: SearchTrace
    simulated: bool
    seed: int
    seconds: float
    versions: Mapping[str, str]

    @cached_property
    def status(self) -> Status:  # type: ignore[override]  # computed on first use
        """``complete`` if robots searched all reachable cells, saw the region between them, and
        every working robot knows that the search is complete.

        The share that stays unseen is at most `SearchProblem.most_unseen`.
        """
        return (
            Status.COMPLETE
            if self.trace.covered_at < inf
            and not self._unaware
            and self._unseen_share <= self.problem.most_unseen
            else Status.INCOMPLETE
        )

    @cached_property
    def _unseen_share(self) -> float:
        """Share of the region that no robot saw, although the cells there were searched; 0 if it is
        at most `UNSEEN`.

        Only footprints that turn with their robots can leave gaps: others see their whole cells.
        """
        if self.plan.image is None:
            return 0.0
        cells, layers = self.plan.tour.cells, layers_of(self.plan.grid)
        out_of_reach = ~bits_to_array(self.scenario.goal, len(cells))
        gaps, area = 0.0, 0.0
        for number, coverage in zip(self._whole_layers, self.coverages, strict=True):
            uncovered, area = coverage.uncovered, area + coverage.area_m2
            here = out_of_reach if cells.shape[1] == 2 else out_of_reach & (cells[:, 0] == number)
            if here.any():
                uncovered = uncovered.difference(layers[number].area_of(cells[here, -2:]))
            gaps += float(uncovered.area)
        return gaps / area if gaps > UNSEEN * area else 0.0

    @property
    def reason(self) -> str:
        """One sentence that explains the status of the episode."""
        goal, further, count = self.scenario.goal, self._further_looks, self.problem.multiplicity
        cells, looks = (goal & ~further).bit_count(), (goal & further).bit_count()
        if self.trace.covered_at == inf:
            late = np.isinf(search_times(self.scenario, self.trace.robots))
            missing = array_to_bits(late)
            unsearched, unseen = (missing & ~further).bit_count(), (missing & further).bit_count()
            often = "never searched" if count == 1 else f"searched by fewer than {count} robots"
            again = f"{unseen} of {looks} further looks at cells were not taken" if unseen else ""
            text = f"{unsearched} of {cells} cells that robots can reach were {often}"
            return again if again and not unsearched else ", and ".join(filter(None, [text, again]))
        by = "" if count == 1 else f" by {count} robots"
        if by and self.liars:
            honest = least_honest_searches(self.scenario, self.trace.robots, self.liars)
            by += f", at some cells only {honest} of them honest," if honest < count else ""
        again = f", with {looks} further looks at some of them," if looks else ""
        back = ", and every vehicle that works was back," if self.plan.flies else ""
        text = (
            f"all {cells} cells that robots can reach were searched{by}{again}{back} after"
            f" {duration_text(self.makespan or 0.0)}"
        )
        if self._as_planned:
            text += ", according to the plan: nothing was simulated"
        elif self._unaware:
            text += f", but {len(self._unaware)} live robots do not know it"
        else:
            text += ", and every live robot knows it"
        if not self._unseen_share:
            return text
        gaps_m2 = self._unseen_share * self.coverage.area_m2
        return (
            f"{text}; no robot saw {gaps_m2:.4g} m² between footprints"
            f" ({100 * self._unseen_share:.2g} % of the region)"
        )

    @property
    def _as_planned(self) -> bool:
        return not self.simulated and self.problem.live is None

    @cached_property
    def _unaware(self) -> list[int]:
        """Numbers of the robots that still work but have not declared the search complete."""
        if self._as_planned:
            return []
        living = [
            number
            for number, log in enumerate(self.trace.robots, start=1)
            if log.status not in ("dead", "paused")
        ]
        return [number for number in living if number not in self.trace.declared] or (
            [] if self.trace.declared else [0]
        )

    @property
    def makespan(self) -> float | None:
        """Time of the search in seconds, or None if a reachable cell was never searched.

        If the problem names a vehicle, the time ends when the last working vehicle is back from its
        last sortie, with all charges in between. Otherwise, the time ends when all reachable cells
        have been searched.
        """
        if self.trace.covered_at == inf:
            return None
        if not self.plan.flies:
            return self.plan.seconds(self.trace.covered_at)
        return max((end for end in self.returns if end is not None), default=0.0)

    @cached_property
    def returns(self) -> tuple[float | None, ...]:
        """Time in seconds at which each vehicle is back from its last sortie, by the flights along
        the cells that it searched.

        None stands for a vehicle that died, and for a vehicle that searched nothing.
        """
        plan = self.plan
        if self._faultless:
            return tuple(end_of(sorties) if sorties else None for sorties in plan.sorties)
        times: list[float | None] = []
        for robot, log in enumerate(self.trace.robots):
            if not log.cells.size or log.status == "dead":
                times.append(None)
                continue
            if not any(log.detours) and np.array_equal(log.cells, plan.stops(robot)):
                sorties = plan.sorties[robot]
            else:
                sorties = plan.sorties_along(
                    robot, log.cells, log.detours, cells=float(log.times[-1])
                )
            waited = sum(then - since for since, then in self._waits(log))
            times.append(end_of(sorties) + waited * plan.cell_seconds)
        return tuple(times)

    @property
    def _faultless(self) -> bool:
        """Whether nothing can go wrong in the search. Then every vehicle flies its missions, and
        needs no help.
        """
        return self.problem.live is None and not self.scenario.uncertain

    @staticmethod
    def _waits(log: RobotLog) -> list[tuple[float, float]]:
        """Return when a robot waited or paused between its searches: pairs of begin and end, in
        units of `cell_time`.
        """
        last = float(log.times[-1])
        return [
            (since, min(then, last))
            for (since, state), (then, _) in pairwise([*log.states, (last, "")])
            if state in ("waiting", "paused") and since < last
        ]

    def clock(self, moments: ArrayLike, robot: int | None = None) -> NDArray[np.float64]:
        """Convert moments of the trace to seconds since the start of the search.

        The end of the search is at `makespan`. If the problem names a vehicle, earlier moments are
        in proportion: those of the search to `makespan`, and those of robot number ``robot``
        (counted from 0) to its departure and its own return. If something can go wrong, all robots
        have the clock of the search, so that a fault changes nothing of what was before.
        """
        moments = np.asarray(moments, dtype=np.float64)
        if not self.plan.flies:
            return self.plan.seconds(0.0) + moments * self.plan.cell_seconds
        seconds = moments * self._pace
        if robot is None or not self._faultless or (end := self.returns[robot]) is None:
            return seconds
        cell, last = self.plan.cell_seconds, float(self.trace.robots[robot].times[-1])
        departure = min(float(self.plan.delays[robot]) / cell, last)
        own = np.interp(moments, [0.0, departure, last], [0.0, departure * cell, end])
        # when its work is done, a robot waits for what the others do
        return np.where(moments <= last, own, np.maximum(seconds, end))

    @cached_property
    def _pace(self) -> float:
        """Duration in seconds of one unit of the trace's time, in the whole search of vehicles."""
        if 0 < self.trace.covered_at < inf:
            return (self.makespan or 0.0) / self.trace.covered_at
        paces = [
            end / float(log.times[-1])
            for end, log in zip(self.returns, self.trace.robots, strict=True)
            if end is not None and log.times.size
        ]
        return max(paces, default=self.plan.cell_seconds)

    @property
    def cell_time(self) -> float:
        """Time in seconds in which a robot of speed 1 searches one cell."""
        return self.plan.cell_seconds

    @property
    def metrics(self) -> dict[str, Any]:
        """Metrics of the search, with times in seconds. ``share`` is the makespan divided by the
        least time of one robot alone.
        """
        plan, trace = self.plan, self.trace
        return {
            "status": str(self.status),
            "cells": self.n_cells,
            "makespan": self.makespan,
            "share": (
                None
                if self.makespan is None
                else self._in_cells(trace.covered_at, self.makespan) / plan.tour_cost.least
            ),
            "expected_find": self.expected_find,
            "planned": plan.planned_seconds,
            "lower_bound": plan.least_seconds,
            "sent": trace.sent,
            "lost": trace.lost,
            "takeovers": trace.takeovers,
            "obstacles_found": len(self.obstacles),
            "unreachable_cells": self.unreachable,
        }

    @cached_property
    def routes(self) -> tuple[Route, ...]:
        """The path of each robot in metres."""
        return tuple(
            self.plan.route(robot, log.cells, log.detours)
            for robot, log in enumerate(self.trace.robots)
        )

    @cached_property
    def liars(self) -> frozenset[int]:
        """Numbers of the robots that falsely report cells as searched."""
        return frozenset(fault.robot for fault in self.scenario.faults if isinstance(fault, Liar))

    @property
    def coverage(self) -> AreaCoverage:
        """Coverage of all layers together, computed from the paths of the robots and not from
        cells.
        """
        return combine_coverages(self.coverages)

    @cached_property
    def coverages(self) -> tuple[AreaCoverage, ...]:
        """The coverage of each layer, from the lowest layer to the highest."""
        seeing = [
            robot
            for robot, log in enumerate(self.trace.robots)
            if robot + 1 not in self.liars and log.cells.size
        ]
        return coverages(self.plan, self.trace, self.routes, seeing)

    @cached_property
    def visible_cells(self) -> tuple[tuple[NDArray[np.int64], ...], ...]:
        """For each stop of each robot, the tour indices of the cells that the robot saw from this
        stop.
        """
        return tuple(
            tuple(self.plan.visible_cells(robot, log.cells))
            for robot, log in enumerate(self.trace.robots)
        )

    @cached_property
    def sightings(self) -> tuple[Sightings, ...]:
        """When each robot is at its stops, in seconds since the start of the search.

        A vehicle is at its stops when it passes them on its flights, with its turns, climbs and
        charges. If something can go wrong, times are those of `clock`, which are in proportion to
        the times of the search alone.
        """
        flown = self.plan.flies and self._faultless
        return tuple(
            sightings_of(self.plan, robot, log.cells)
            if flown and not any(log.detours)
            else Sightings(self.clock(log.times, robot), np.zeros((0, 2)), np.zeros(0))
            for robot, log in enumerate(self.trace.robots)
        )

    @cached_property
    def visits(self) -> Visits:
        """The first search of each cell, by any robot that reports the truth. A vehicle may first
        see a cell on its way between two others.
        """
        robots, times = first_seen(self.plan, self.sightings, self.problem.view)
        robots, times = robots[:, 0], times[:, 0]
        if (
            self.plan.tour.cells.shape[1] == 3
        ):  # further looks at the same ground count at their stops
            further = self.plan.tour.cells[:, 0] > 0
            robots[further], times[further] = -1, inf
        for robot, log in enumerate(self.trace.robots):
            if robot + 1 in self.liars or not log.cells.size:
                continue
            moments = self.sightings[robot].times.tolist()
            for cells, moment in zip(self.visible_cells[robot], moments, strict=True):
                earlier = cells[moment < times[cells]]
                robots[earlier], times[earlier] = robot, moment
        return Visits(robots, times)

    @cached_property
    def success(self) -> Success | None:
        """The probability that a single target is found, over time, by the prior of the problem and
        its probability of detection; None for a problem without a prior.

        Each search of a place finds a target in it with the probability of detection, if no search
        before did. Robots that do not report the truth find nothing. The first search of a vehicle
        counts from when its footprint, which moves along its flight, reaches each of 4 x 4 places in
        the cell.
        """
        if self.plan.ground is None:
            return None
        none = Sightings(np.zeros(0), np.zeros((0, 2)), np.zeros(0))
        honest = [robot not in self.liars for robot in range(1, len(self.sightings) + 1)]
        last = max((float(own.times[-1]) for own in self.sightings if len(own.times)), default=0.0)
        return success_of(
            self.plan,
            [own if true else none for own, true in zip(self.sightings, honest, strict=True)],
            [own if true else () for own, true in zip(self.visible_cells, honest, strict=True)],
            view=self.problem.view,
            detection=self.problem.chosen_detection,
            limit=self.problem.at_most * (self.plan.plain_seconds or 0.0)
            if isinstance(self.plan.ground, MovingGround)
            else self.makespan or last,
        )

    @property
    def expected_find(self) -> float | None:
        """Expected time in seconds until a single target is found, by the prior of the problem;
        None without a prior, and if nothing can be found.

        A target that stands still is at a place that robots search, and robots repeat the search
        until they find it (`shoal.search.problem.target.Ground.expected_time`). If each search of a
        cell finds a target in it, this is the sum of each cell's probability times its first
        search or, of a vehicle, times the mean of when its footprint reaches 4 x 4 places in the
        cell. A target that moves and is not found counts as found after the longest time of the
        plan, `SearchProblem.at_most` times that without a prior.
        """
        return None if self.success is None else self.success.mean

    def _prior_report(self) -> dict[str, Any] | None:
        tour_cost = self.plan.tour_cost
        if tour_cost.odds is None:
            return None
        ground = self.plan.ground
        return {
            "inside": self.plan.prior_inside,
            "before": self.plan.prior_before,
            "left": (
                ground.outside(self.makespan or self.plan.planned_seconds)
                if isinstance(ground, MovingGround)
                else None
            ),
            "success": 0.0 if self.success is None else self.success.probability,
            "at_most": self.problem.at_most,
            "plain_s": self.plan.plain_seconds,
        }

    def save_visits(self, path: str | os.PathLike[str]) -> None:
        """Write a CSV file with the first search of each cell: the cell's viewpoint in metres, the
        number of the robot, and the time in seconds. A search of several altitudes has a column for
        the altitude. Cells that nobody searched have no row. A cell that robots search in several
        passes or look at again has one row.
        """
        visits, plan = self.visits, self.plan
        robots, times = visits.robots.copy(), visits.times.copy()
        same = self._same_cells
        # from the last look to the first, which is the one that stays
        order = np.argsort(-times, kind="stable")
        robots[same[order]], times[same[order]] = robots[order], times[order]
        robots[same != np.arange(len(same))] = -1
        cells = np.flatnonzero(robots >= 0)
        cells = cells[np.argsort(times[cells], kind="stable")]
        places = plan.positions(cells)
        several = len(set(plan.altitudes)) > 1
        names = ["x_m", "y_m", *(["altitude_m"] if several else [])]
        lines = [",".join([*names, "robot", "time_s"])]
        for place, robot, moment in zip(
            places[:, : 3 if several else 2].tolist(),
            robots[cells].tolist(),
            times[cells].tolist(),
            strict=True,
        ):
            numbers = [*(f"{number:.6f}" for number in place), str(robot + 1), f"{moment:.6f}"]
            lines.append(",".join(numbers))
        write_text(Path(path), "\n".join(lines) + "\n")

    @property
    def _same_cells(self) -> NDArray[np.int64]:
        """The tour index of each cell in the lowest layer that has the same cell at the same
        altitude, such as that of the first of several passes; int64, shape (N,).
        """
        plan, layers = self.plan, layers_of(self.plan.grid)
        cells = plan.tour.cells
        if cells.shape[1] == 2:
            return np.arange(len(cells))
        middles = np.zeros((len(cells), 2))
        for up, layer in enumerate(layers):
            these = cells[:, 0] == up
            lattice = layer.lattice
            middles[these] = lattice.to_region(lattice.centers(*cells[these, 1:].T))
        ups = np.asarray(plan.altitudes)[cells[:, 0]]
        keys = np.column_stack([ups, np.rint(middles / (1e-3 * plan.grid.size))])
        order = np.argsort(cells[:, 0], kind="stable")
        _, index, inverse = np.unique(keys[order], axis=0, return_index=True, return_inverse=True)
        same = np.zeros(len(cells), dtype=np.int64)
        same[order] = order[index[inverse.ravel()]]
        return same

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Findings known to robots that declared the search complete, or to any robot if no robot
        declared it complete.
        """
        reports: dict[int, set[int]] = {}
        for number in self.trace.declared or range(1, len(self.trace.robots) + 1):
            for cell, witnesses in self.trace.robots[number - 1].found:
                reports.setdefault(cell, set()).update(witnesses)
        if not reports:
            return ()
        numbers = np.arange(len(self.plan.tour_cost))
        searched = {
            number: array_to_bits(np.isin(numbers, np.concatenate([numbers[:0], *cells_of_stops])))
            for number, cells_of_stops in enumerate(self.visible_cells, start=1)
        }
        return merge_findings(self.scenario, reports, searched)

    @cached_property
    def obstacles(self) -> dict[int, float]:
        """The time of discovery, in units of `cell_time`, of each obstacle that robots found, by
        the tour index of its cell.
        """
        discovered: dict[int, float] = {}
        for moment, cell in sorted(entry for log in self.trace.robots for entry in log.obstructed):
            discovered.setdefault(cell, moment)
        return dict(sorted(discovered.items()))

    @property
    def unreachable(self) -> int:
        """Number of free cells that no robot could reach."""
        every = (1 << len(self.plan.tour_cost)) - 1
        blocked, goal = self.scenario.blocked, self.scenario.goal
        return (every & ~(blocked | goal | self._further_looks)).bit_count()

    @cached_property
    def _further_looks(self) -> int:
        """The places on the tour that are second looks at other cells, as bits."""
        if len(layers_of(self.plan.grid)) == 1:
            return 0
        layers = self.plan.tour.cells[:, 0]
        return array_to_bits(~np.isin(layers, self._whole_layers))

    @property
    def n_cells(self) -> int:
        """Number of cells of the region, in all layers. A cell at which robots look again counts
        once.
        """
        return len(self.plan.tour_cost) - self._further_looks.bit_count()

    def report(self) -> dict[str, Any]:
        """Return the JSON object that ``shoal search`` prints."""
        grid, trace, allocation = self.plan.grid, self.trace, self.plan.allocation
        return {
            "status": str(self.status),
            "reason": self.reason,
            "region": {
                "name": grid.region.name,
                "cells": self.n_cells,
                "further_looks": grid.n_cells - self.n_cells,
                "area_m2": grid.region.area_m2,
                "margin_m": grid.region.margin,
                "unseen_m2": grid.region.unseen_m2,
                "cell_m": grid.size,
                "angle_degrees": self.plan.row_angle,
                "no_go_zones": grid.region.no_go_zones,
            },
            "layers": [
                self._layer(number, coverage)
                for number, coverage in zip(self._whole_layers, self.coverages, strict=True)
            ],
            "robots": len(trace.robots),
            "tour": self.plan.tour.name,
            "allocation": allocation.allocator,
            "compared": [candidate.report() for candidate in self.plan.compared],
            "makespan_cells": (
                None if self.makespan is None else self._in_cells(trace.covered_at, self.makespan)
            ),
            "makespan_s": self.makespan,
            "planned_cells": self._in_cells(allocation.makespan, self.plan.planned_seconds),
            "planned_s": self.plan.planned_seconds,
            "expected_find_s": self.expected_find,
            "prior": self._prior_report(),
            "lateral_range": self.problem.lateral_report(),
            "lower_bound_cells": max(0.0, self.plan.cells(self.plan.least_seconds)),
            "lower_bound_s": self.plan.least_seconds,
            "covered_fraction": self.coverage.covered_fraction,
            "uncovered_m2": self.coverage.uncovered_m2,
            "outside_m": self.coverage.outside_m,
            "simulated": self.simulated,
            "live": self.problem.live is not None,
            "messages": {"sent": trace.sent, "lost": trace.lost, "dropped": trace.dropped},
            "takeovers": trace.takeovers,
            "obstacles": {"found": len(self.obstacles), "unreachable_cells": self.unreachable},
            "targets": {
                "there": len(self.scenario.targets),
                "found": len(
                    {finding.cell for finding in self.findings} & {*self.scenario.targets}
                ),
            },
            "findings": [self._finding_report(finding) for finding in self.findings],
            "routes": [self._route(robot) for robot in range(len(trace.robots))],
            "seed": self.seed,
            "seconds": self.seconds,
        }

    def _in_cells(self, cells: float, seconds: float) -> float:
        """Return a time in cells: the time of flights if the problem names a vehicle, and otherwise
        the given number of cells.
        """
        return self.plan.cells(seconds) if self.plan.flies else cells

    @property
    def _whole_layers(self) -> list[int]:
        """Numbers of the layers that are no second looks at another."""
        layers = layers_of(self.plan.grid)
        return [number for number, layer in enumerate(layers) if layer.whole is None]

    def _layer(self, number: int, coverage: AreaCoverage) -> dict[str, Any]:
        grid = layers_of(self.plan.grid)[number]
        return {
            "altitude_m": self.plan.altitudes[number],
            "ground_sample_m": self.problem.vehicle_at(self.plan.altitudes[number]).ground_sample,
            "angle_degrees": self.plan.tour.row_angle(grid.angle, number),
            "cells": grid.n_cells,
            "cell_m": grid.size,
            "covered_fraction": coverage.covered_fraction,
        }

    def _route(self, robot: int) -> dict[str, Any]:
        log, route = self.trace.robots[robot], self.routes[robot]
        out, back = self.plan.outside_lengths(robot)
        return {
            "robot": robot + 1,
            "start": self.plan.places[robot].tolist(),
            "landing": (
                (self.plan.places if self.plan.landing is None else self.plan.landing)[
                    robot
                ].tolist()
            ),
            "footprint_m": float(self.plan.footprints[robot]),
            "cells": (
                len(log.cells)
                if self.plan.widths[robot] == 1
                else len(np.unique(np.concatenate([*self.visible_cells[robot], []])))
            ),
            "stops": len(log.cells),
            "length_m": route.length,
            "outside_out_m": out,
            "outside_home_m": back,
            "turns": int(turns_of(route.points).sum()),
            "status": log.status,
        }

    def _finding_report(self, finding: Finding) -> dict[str, Any]:
        point, frame = self.plan.positions([finding.cell])[0], self.plan.grid.region.frame
        data: dict[str, Any] = dict(zip(("x", "y", "altitude"), point.tolist(), strict=False))
        if frame is not None:
            data |= dict(
                zip(
                    ("longitude", "latitude"),
                    frame.to_degrees(point[None, :2])[0].tolist(),
                    strict=True,
                )
            )
        witnesses = {"found_by": list(finding.found_by), "missed_by": list(finding.missed_by)}
        return data | {"confidence": finding.confidence} | witnesses

    def verify(self) -> Verification:
        """Simulate the search again from its plan, and compare the new trace with the stored trace.

        A live search cannot be repeated. For a live search, the method compares the stored makespan
        with the stored cell times.
        """
        if self.problem.live is not None:
            good = (
                float(search_times(self.scenario, self.trace.robots).max()) == self.trace.covered_at
            )
            return Verification(
                good,
                f"a live search: the stored cells and times are {'' if good else 'not '}consistent",
            )
        again = (
            simulated_trace(self.plan, self.scenario)
            if self.simulated
            else planned_trace(self.plan, self.scenario.brief)
        )
        difference = self.trace.difference(again)
        return Verification(
            not difference,
            difference or "planned and simulated again: all robots act as in the episode",
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the episode as JSON, with the trace, the problem, and the contents of the files
        that the problem names.

        Raises
        ------
        InvalidInputError
            If the suffix of ``path`` is not ``.json``.
        OutputError
        """
        target = check_suffix(path, ".json")
        data = {
            "format": FORMAT,
            "kind": "search",
            "versions": dict(self.versions),
            "problem": self.self_contained().to_dict(),
            "seed": self.seed,
            "seconds": self.seconds,
            "simulated": self.simulated,
            "schedule": self.plan.schedule,
            "trace": self.trace.to_dict(),
        }
        write_json(target, data, indent=None)

    def self_contained(self) -> SearchProblem:
        """Return the problem with the contents of files in place of the file names."""
        problem, plan = self.problem, self.plan
        changes: dict[str, Any] = {}
        if problem.place_is_file() or problem.no_go or problem.searched or problem.place.barriers:
            changes |= {
                "region": problem.place,
                "no_go": (),
                "searched": (),
                "layer": None,
                "inner": None,
                "hidden": None,
                "closed_lines": False,
            }
        if problem.prior:
            changes["prior"] = with_contents(problem.prior)
        if isinstance(problem.starts, str) and os.path.exists(problem.starts):
            changes["starts"] = plan.places
        if isinstance(problem.along, str) and problem.along != CENTRE:
            changes["along"] = problem.line
        if isinstance(problem.launch, str):
            changes["launch"] = plan.places
        if isinstance(problem.land, str):
            changes["land"] = plan.landing
        for name, cells in (
            ("targets", self.scenario.targets),
            ("obstacles", self.scenario.obstacles),
        ):
            if isinstance(getattr(problem, name), str):
                changes[name] = plan.positions(list(cells))[:, :2]
        return problem.replaced(**changes)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, trust: bool = False) -> SearchEpisode:
        """Read an episode. The method refuses tours and allocations given as MODULE:ATTRIBUTE,
        unless ``trust`` is true.
        """
        source = str(path)
        data = parse_json(read_text(Path(path), what="search episode"), where=source)
        names = {
            "format",
            "kind",
            "versions",
            "problem",
            "seed",
            "seconds",
            "simulated",
            "schedule",
            "trace",
        }
        if (
            not isinstance(data, dict)
            or data.get("kind") != "search"
            or data.get("format") != FORMAT
            or set(data) != names
        ):
            raise InvalidInputError(
                f"{source}: expected a search episode of format {FORMAT}, got {shortened(data)}"
            )
        try:
            seed = check_integer(data["seed"], what="seed", least=0)
            if not trust:
                SearchProblem.refuse_code(data["problem"], where="problem")
            problem = SearchProblem.from_dict(data["problem"])
            plan = plan_search(problem, seed=seed)
            plan = replace(plan, schedule=_schedule_from(data["schedule"], problem.robots))
            return cls(
                problem=problem,
                plan=plan,
                scenario=scenario_of(problem, plan, seed),
                trace=SearchTrace.from_dict(
                    data["trace"], robots=problem.robots, cells=len(plan.tour_cost)
                ),
                simulated=check_bool(data["simulated"], what="simulated"),
                seed=seed,
                seconds=check_number(data["seconds"], what="seconds"),
                versions={
                    str(name): str(version) for name, version in dict(data["versions"]).items()
                },
            )
        except (ShoalError, TypeError, ValueError) as error:
            raise InvalidInputError(f"{source}: not a search episode: {error}") from None


def _schedule_from(data: Any, robots: int) -> tuple[SortieTimes, ...] | None:
    """Return the start times and durations of all sorties from an episode file, or None if the plan
    determines them.
    """
    if data is None:
        return None
    if len(data) != robots:
        raise InvalidInputError(f"schedule: expected {robots} robots, got {len(data)}")
    return tuple(
        tuple(
            (
                check_number(start, what="start", least=0),
                check_number(time, what="duration", least=0),
            )
            for start, time in sorties
        )
        for sorties in data
    )


def starts_text(times: Iterable[float]) -> str:
    """Return when vehicles start, given the times of their starts in seconds.

    Examples
    --------
    >>> starts_text([0.0, 0.0]), starts_text([0.0, 42.5, 7.0])
    ('all start at once', 'the last starts after 42.5 s')
    """
    last = max(times, default=0.0)
    return f"the last starts after {duration_text(last)}" if last else "all start at once"


def duration_text(seconds: float) -> str:
    """Return a duration as text: in seconds if the duration is below one minute, and as h:mm:ss
    otherwise.

    Examples
    --------
    >>> duration_text(42.5), duration_text(390), duration_text(3725.4)
    ('42.5 s', '0:06:30', '1:02:05')
    """
    if round(seconds) < 60:
        return f"{seconds:.3g} s"
    minutes, remainder = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{remainder:02d}"
