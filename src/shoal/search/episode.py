"""SearchEpisode: a plan, what befell the robots, and what they searched; it plays again exactly."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import cached_property
from math import inf
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    FiniteFloat,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    ValidationError,
)

from shoal.errors import InvalidInputError
from shoal.files import atomic
from shoal.search.allocation.plan import SearchPlan, plan_search
from shoal.search.cells.routing import Route
from shoal.search.regions.coverage import Coverage, coverage_check
from shoal.search.regions.formats.text import check_file, read_text
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import region_of
from shoal.search.simulation import faults
from shoal.search.simulation.findings import Finding, merged
from shoal.search.simulation.scenario import Scenario, scenario_of
from shoal.search.simulation.trace import Played, RobotLog, as_planned, simulated
from shoal.search.tours.bitset import bits_of, bits_to_array

FORMAT: Literal[1] = 1
_KINDS = {
    kind.__name__: kind for kind in (faults.Crash, faults.Pause, faults.Slow, faults.Battery, faults.WrongPosition, faults.Liar)
}
_STATUS = {"dead": "dead", "paused": "paused"}


@dataclass(frozen=True, eq=False)
class SearchEpisode:
    """A search. True as a bool if all that can be reached was searched and every robot that lived knew it.

    Parameters
    ----------
    plan : SearchPlan
    scenario : Scenario
    network : str
        As `network_of` takes it; ``loss`` besides.
    speed : float
        Metres a second.
    simulated : bool
        Whether robots and messages were simulated; else all went as planned, or it was live.
    live : float or None
        Cells a second, if robots were processes.
    robots : tuple of RobotLog
    covered_at : float
        When the last cell that some robot can reach was searched, in the time of a cell; infinite if some never were.
    declared : dict of int to float
        When each robot, counted from 1 on, declared the search complete.
    sent, lost : int
        Messages, counted by receiver.
    takeovers : int
        How often a robot began with the part of one that it took for dead.
    seed : int
    seconds : float
        Time for planning and simulation.
    version : str
        Of Shoal.
    """

    part: ClassVar[str] = "search"

    plan: SearchPlan
    scenario: Scenario
    network: str
    loss: float
    speed: float
    simulated: bool
    live: float | None
    robots: tuple[RobotLog, ...]
    covered_at: float
    declared: dict[int, float]
    sent: int
    lost: int
    takeovers: int
    seed: int
    seconds: float
    version: str

    def __bool__(self) -> bool:
        return self.complete

    @cached_property
    def complete(self) -> bool:
        """Whether all cells that some robot can reach were searched and every robot that lives has found that out."""
        living = [number for number, log in enumerate(self.robots, start=1) if log.status not in ("dead", "paused")]
        planned = not self.simulated and self.live is None
        return self.covered_at < inf and (planned or (bool(self.declared) and set(living) <= set(self.declared)))

    @property
    def cell_time(self) -> float:
        """The time that a robot of speed 1 takes for a cell, seconds."""
        return self.plan.grid.size / self.speed

    @cached_property
    def routes(self) -> tuple[Route, ...]:
        """The way of each robot, metres."""
        return tuple(self.plan.route(robot, log.cells, log.detours) for robot, log in enumerate(self.robots))

    @cached_property
    def coverage(self) -> Coverage:
        """What the robots have seen of the region, checked apart from the cells."""
        liars = {fault.robot for fault in self.scenario.faults if isinstance(fault, faults.Liar)}
        seeing = [robot for robot, log in enumerate(self.robots) if robot + 1 not in liars and log.cells.size]
        ways = [self.routes[robot].points for robot in seeing]
        return coverage_check(self.plan.grid.region, ways, self.plan.footprints[seeing] if seeing else self.plan.grid.footprint)

    @cached_property
    def seen(self) -> tuple[tuple[NDArray[np.int64], ...], ...]:
        """By robot, the cells that it saw from each in which it stopped, as numbers on the tour."""
        return tuple(tuple(self.plan.seen(robot, log.cells)) for robot, log in enumerate(self.robots))

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What was found, as those know that declared the search complete; with nobody, as the robots knew."""
        reports: dict[int, set[int]] = {}
        tellers = self.declared or range(1, len(self.robots) + 1)
        for number in tellers:
            for cell, witnesses in self.robots[number - 1].found:
                reports.setdefault(cell, set()).update(witnesses)
        searched = {
            number: bits_of(int(cell) for cells in seen for cell in cells) for number, seen in enumerate(self.seen, start=1)
        }
        return merged(self.scenario, reports, searched)

    @cached_property
    def obstacles(self) -> dict[int, float]:
        """When each cell that cannot be entered was found to be one, in the time of a cell; in the order of the tour."""
        found: dict[int, float] = {}
        for moment, cell in sorted(entry for log in self.robots for entry in log.obstructed):
            found.setdefault(cell, moment)
        return dict(sorted(found.items()))

    @property
    def unreachable(self) -> int:
        """How many cells without an obstacle no robot could reach."""
        return len(self.plan.course) - (self.scenario.blocked | self.scenario.goal).bit_count()

    def report(self) -> dict[str, Any]:
        """Return the JSON object of ``shoal search``."""
        grid, frame = self.plan.grid, self.plan.grid.region.frame
        made = self.covered_at if self.covered_at < inf else None
        return {
            "region": {"name": grid.region.name, "cells": grid.n_cells, "area_m2": grid.region.area_m2, "cell_m": grid.size},
            "robots": len(self.robots),
            "tour": self.plan.tour.name,
            "allocation": self.plan.allocation.method,
            "makespan_cells": made,
            "makespan_s": None if made is None else made * self.cell_time,
            "planned_cells": self.plan.allocation.makespan,
            "lower_bound_cells": self.plan.allocation.lower_bound,
            "covered_fraction": self.coverage.covered_fraction,
            "uncovered_m2": self.coverage.uncovered_m2,
            "outside_m": self.coverage.outside_m,
            "complete": self.complete,
            "simulated": self.simulated,
            "live": self.live is not None,
            "messages": {"sent": self.sent, "lost": self.lost},
            "takeovers": self.takeovers,
            "obstacles": {"found": len(self.obstacles), "unreachable_cells": self.unreachable},
            "findings": [self._told(finding, frame) for finding in self.findings],
            "routes": [self._route(robot) for robot in range(len(self.robots))],
            "seed": self.seed,
            "seconds": self.seconds,
        }

    def _route(self, robot: int) -> dict[str, Any]:
        log, route = self.robots[robot], self.routes[robot]
        ways = np.diff(route.waypoints(), axis=0)
        return {
            "robot": robot + 1,
            "start": self.plan.places[robot].tolist(),
            "footprint_m": float(self.plan.footprints[robot]),
            "cells": len(log.cells) if self.plan.widths[robot] == 1 else len(np.unique(np.concatenate([*self.seen[robot], []]))),
            "stops": len(log.cells),
            "length_m": route.length,
            "turns": max(len(ways) - 1, 0),
            "status": log.status,
        }

    def _told(self, finding: Finding, frame: LocalFrame | None) -> dict[str, Any]:
        point = self.plan.course.points[finding.cell] * self.plan.grid.size
        told: dict[str, Any] = {"x": float(point[0]), "y": float(point[1])}
        if frame is not None:
            longitude, latitude = frame.to_degrees(point[None])[0]
            told |= {"longitude": float(longitude), "latitude": float(latitude)}
        return told | {
            "confidence": finding.confidence,
            "found_by": list(finding.found_by),
            "missed_by": list(finding.missed_by),
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the episode as JSON.

        Raises
        ------
        InvalidInputError
            If the suffix is not .json.
        OutputError
        """
        target = Path(path)
        if target.suffix != ".json":
            raise InvalidInputError(f"{target}: expected the suffix .json, got {target.suffix!r}")
        with atomic(target) as temporary:
            temporary.write_text(json.dumps(self._form().model_dump(), allow_nan=False) + "\n", encoding="utf-8")

    def _form(self) -> EpisodeForm:
        import shapely

        region, brief, scenario = self.plan.grid.region, self.scenario.brief, self.scenario
        frame = None if region.frame is None else (region.frame.longitude, region.frame.latitude)
        return EpisodeForm(
            format=FORMAT,
            kind="search",
            version=self.version,
            region=RegionForm(name=region.name, area=shapely.to_wkt(region.area, rounding_precision=-1), frame=frame),
            footprint=self.plan.footprints.tolist(),
            tour=self.plan.tour.name,
            allocation=self.plan.allocation.method,
            turn_cost=self.plan.course.turn_cost,
            transit=self.plan.transit,
            starts=self.plan.places.tolist(),
            rates=self.plan.rates.tolist(),
            network=self.network,
            loss=self.loss,
            faults=[
                {"kind": type(fault).__name__, **{name: getattr(fault, name) for name in fault.__slots__}}
                for fault in scenario.faults
            ],
            fold=brief.fold,
            energy=None if brief.energy == inf else brief.energy * self.plan.grid.size,
            recharge=brief.recharge * self.cell_time,
            targets=list(scenario.targets),
            obstacles=list(scenario.obstacles),
            stepwise=self.plan.course.stepwise,
            detection=scenario.detection,
            false_alarm=scenario.false_alarm,
            speed=self.speed,
            simulated=self.simulated,
            live=self.live,
            seed=self.seed,
            seconds=self.seconds,
            robots=[
                LogForm(
                    cells=log.cells.tolist(),
                    times=log.times.tolist(),
                    states=list(log.states),
                    found=list(log.found),
                    detours=list(log.detours),
                    obstructed=list(log.obstructed),
                )
                for log in self.robots
            ],
            covered_at=None if self.covered_at == inf else self.covered_at,
            declared=self.declared,
            sent=self.sent,
            lost=self.lost,
            takeovers=self.takeovers,
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> SearchEpisode:
        """Read an episode.

        Raises
        ------
        InvalidInputError
        """
        source = Path(path)
        check_file(source, what="search episode")
        try:
            form = EpisodeForm.model_validate_json(read_text(source))
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            raise InvalidInputError(f"{source}: not a search episode: {where or 'the file'}: {first['msg']}") from None
        try:
            return replayed(form)
        except InvalidInputError as error:
            raise InvalidInputError(f"{source}: {error}") from None

    def verify(self) -> bool:
        """Plan and play the search again and tell whether the same comes of it.

        What processes did cannot be played again: then only whether it fits what the episode says was searched, and when.
        """
        if self.live is not None:
            first = np.full(len(self.plan.course), inf)
            for log, seen in zip(self.robots, self.seen, strict=True):
                for cells, moment in zip(seen, log.times.tolist(), strict=True):
                    first[cells] = np.minimum(first[cells], moment)
            return float(first[bits_to_array(self.scenario.goal, len(first))].max()) == self.covered_at
        other = played_again(self._form())
        return (
            len(other.robots) == len(self.robots)
            and all(
                np.array_equal(one.cells, two.cells)
                and np.allclose(one.times, two.times, rtol=0, atol=1e-9)
                and (one.states, one.detours, one.obstructed) == (two.states, two.detours, two.obstructed)
                for one, two in zip(self.robots, other.robots, strict=True)
            )
            and (other.covered_at, other.declared, other.sent, other.lost) == (self.covered_at, self.declared, self.sent, self.lost)
        )


class RegionForm(BaseModel):
    """A region in an episode: well-known text in metres, and the middle of its frame in degrees."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    area: str
    frame: tuple[FiniteFloat, FiniteFloat] | None


class LogForm(BaseModel):
    """What one robot did."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    cells: list[NonNegativeInt]
    times: list[FiniteFloat]
    states: list[tuple[FiniteFloat, str]]
    found: list[tuple[NonNegativeInt, tuple[NonNegativeInt, ...]]]
    detours: list[tuple[NonNegativeInt, ...]] = []
    obstructed: list[tuple[FiniteFloat, NonNegativeInt]] = []


class EpisodeForm(BaseModel):
    """A search episode on disk."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal[1]
    kind: Literal["search"]
    version: str
    region: RegionForm
    footprint: PositiveFloat | list[PositiveFloat]
    tour: str
    allocation: str
    turn_cost: NonNegativeFloat
    transit: bool
    starts: list[tuple[FiniteFloat, FiniteFloat]]
    rates: list[PositiveFloat]
    network: str
    loss: NonNegativeFloat
    faults: list[dict[str, Any]]
    fold: PositiveInt
    energy: PositiveFloat | None
    recharge: NonNegativeFloat
    targets: list[NonNegativeInt]
    obstacles: list[NonNegativeInt] = []
    stepwise: bool = False
    detection: NonNegativeFloat
    false_alarm: NonNegativeFloat
    speed: PositiveFloat
    simulated: bool
    live: PositiveFloat | None
    seed: NonNegativeInt
    seconds: FiniteFloat
    robots: list[LogForm]
    covered_at: FiniteFloat | None
    declared: dict[PositiveInt, FiniteFloat]
    sent: NonNegativeInt
    lost: NonNegativeInt
    takeovers: NonNegativeInt


def fault_of(entry: dict[str, Any]) -> faults.Fault:
    """Return the fault that an entry of an episode describes.

    Raises
    ------
    InvalidInputError
    """
    kind = _KINDS.get(str(entry.get("kind")))
    values = {name: value for name, value in entry.items() if name != "kind"}
    if kind is None or set(values) != set(kind.__slots__) or not all(isinstance(value, int | float) for value in values.values()):
        raise InvalidInputError(f"faults: expected one of {', '.join(_KINDS)} with its numbers, got {entry!r:.120}")
    return kind(**values)


def _prepared(form: EpisodeForm) -> tuple[SearchPlan, Scenario]:
    """Return the plan and the scenario of an episode on disk."""
    import shapely

    try:
        area = shapely.from_wkt(form.region.area)
    except shapely.errors.ShapelyError:
        raise InvalidInputError("region: expected well-known text of a polygon, got something else") from None
    frame = None if form.region.frame is None else LocalFrame(*form.region.frame)
    plan = plan_search(
        region_of(area, frame=frame, name=form.region.name),
        robots=len(form.starts),
        footprint=form.footprint,
        starts=np.array(form.starts).reshape(-1, 2),
        tour=form.tour,
        allocation=form.allocation,
        turn_cost=form.turn_cost,
        rates=form.rates,
        transit=form.transit,
        stepwise=form.stepwise,
        seed=form.seed,
    )
    scenario = scenario_of(
        plan,
        network=form.network,
        loss=form.loss,
        faults=tuple(fault_of(entry) for entry in form.faults),
        fold=form.fold,
        energy=inf if form.energy is None else form.energy,
        recharge=form.recharge,
        speed=form.speed,
        targets=tuple(form.targets),
        detection=form.detection,
        false_alarm=form.false_alarm,
        obstacles=tuple(form.obstacles),
        seed=form.seed,
    )
    return plan, scenario


def _episode(form: EpisodeForm, plan: SearchPlan, scenario: Scenario, played: Played) -> SearchEpisode:
    return SearchEpisode(
        plan=plan,
        scenario=scenario,
        network=form.network,
        loss=form.loss,
        speed=form.speed,
        simulated=form.simulated,
        live=form.live,
        **vars(played),
        seed=form.seed,
        seconds=form.seconds,
        version=form.version,
    )


def played_again(form: EpisodeForm) -> SearchEpisode:
    """Plan and play an episode on disk again."""
    plan, scenario = _prepared(form)
    return _episode(form, plan, scenario, simulated(plan, scenario) if form.simulated else as_planned(plan))


def replayed(form: EpisodeForm) -> SearchEpisode:
    """Return the episode that a file tells of, as it tells it.

    Raises
    ------
    InvalidInputError
    """
    plan, scenario = _prepared(form)
    n = len(plan.course)
    if len(form.robots) != len(form.starts) or any(
        len(log.cells) != len(log.times) or any(cell >= n for cell in log.cells) for log in form.robots
    ):
        raise InvalidInputError(f"robots: expected cells below {n} and their times for {len(form.starts)} robots")
    logs = tuple(
        RobotLog(
            np.array(log.cells, dtype=np.int64),
            np.array(log.times, dtype=np.float64),
            tuple(log.states),
            tuple(log.found),
            tuple(log.detours),
            tuple(log.obstructed),
        )
        for log in form.robots
    )
    covered_at = inf if form.covered_at is None else form.covered_at
    return _episode(form, plan, scenario, Played(logs, covered_at, dict(form.declared), form.sent, form.lost, form.takeovers))
