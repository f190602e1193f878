"""A folder of missions: the mission files, a map of the missions, and a check report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from shoal.core.errors import InvalidInputError
from shoal.core.files import write_json
from shoal.core.notices import tell_once
from shoal.missions import FORMATS, Mission, MissionCheck, write_missions
from shoal.missions.approach import (
    MissionApproach,
    airspace_of,
    homes_of,
    missions_approach,
    near_homes,
)
from shoal.missions.deconfliction import plan_missions
from shoal.missions.fence import CORNERS, fenced_region
from shoal.missions.files import UNCOVERED
from shoal.search.episode import SearchEpisode
from shoal.search.flight.terrain import open_terrain
from shoal.search.planning.plan import (
    NARROWER,
    NO_ROOM,
    SearchPlan,
    narrower_margin_text,
    plan_at_margin,
)
from shoal.search.problem import SearchProblem
from shoal.search.problem.mission_options import MissionOptions
from shoal.search.regions.margin import without_margin
from shoal.search.regions.places import read_points
from shoal.search.run import run
from shoal.views.drawing.charts import save_figure
from shoal.views.search.missions import missions_figure

MAP = "map.png"


class MissionFolder:
    """A folder for the missions of a search plan. The missions assume that no robot has a fault.

    Attributes
    ----------
    problem : SearchProblem
        The problem, in whose region vehicles keep the margin and the exclusion polygons of the
        missions' fence.

    Raises
    ------
    InvalidInputError, UnknownNameError
        If an option is invalid, or if a rover would have to leave the region. The constructor
        raises the error before any planning.
    """

    def __init__(self, folder: Path, problem: SearchProblem, options: MissionOptions) -> None:
        self.folder, self.given = folder, options
        self.missions: tuple[Mission, ...] = ()
        self.approach: MissionApproach | None = None
        for name in options.format:
            FORMATS.get(name)
        options.check_for(problem)
        self.asked = problem
        self.problem = self._ready(problem)
        self.terrain = None if options.terrain is None else open_terrain(Path(options.terrain))

    def _ready(self, problem: SearchProblem) -> SearchProblem:
        """Return the problem with the margin of missions, and with exclusion polygons that the
        autopilot can store.
        """
        region = problem.kept_margin(without_margin(problem.place), fenced=True)
        if self._fenced:
            places = np.concatenate(problem.known_places(region))
            wing = problem.chosen_vehicle.kind == "fixed-wing"
            region = fenced_region(region, CORNERS[self.given.autopilot], places=places, wing=wing)
        if not region.margin:
            tell_once(
                "margin: paths may touch the fence and no-go zones, because the margin is 0 m"
            )
        return problem.replaced(margin=region.margin).at_place(region)

    @property
    def _fenced(self) -> bool:
        """Whether a file of the chosen formats contains a fence."""
        return not self.given.format or bool({"plan", "wpl"} & {*self.given.format})

    def planned(self, *, seed: int) -> SearchPlan:
        """Plan the search, and create its missions.

        If a vehicle has no room for a turn or a path, and the user asked for no margin, the method
        tries narrower margins.
        """
        wide = self.problem.margin or 0.0
        for share in NARROWER if self.asked.margin is None else ():
            try:
                plan = plan_at_margin(self.problem, seed=seed)
                self.plan(plan)
            except InvalidInputError as error:
                if not str(error).startswith(NO_ROOM):
                    raise
                self.problem = self._ready(
                    self.asked.replaced(margin=share * wide).at_place(self.asked.place)
                )
            else:
                if self.problem.margin != wide:
                    tell_once(narrower_margin_text(self.problem.margin or 0.0, wide))
                return plan
        plan = plan_at_margin(self.problem, seed=seed)
        self.plan(plan)
        return plan

    def plan(self, plan: SearchPlan) -> None:
        """Create the missions of a search plan."""
        given, region = self.given, plan.grid.region
        self.missions = plan_missions(
            plan,
            separation=given.kept_apart,
            rally=None
            if given.rally is None
            else read_points(Path(given.rally), region, what="rally points"),
            terrain=self.terrain,
            fenced=self._fenced,
            **{
                name: getattr(given, name)
                for name in (
                    "autopilot",
                    "cap",
                    "altitude_frame",
                    "terrain_error",
                    "airspace",
                    "ending",
                )
            },
        )
        if given.kept_apart is not None:
            self.approach = missions_approach(
                self.missions, given.kept_apart, region.frame, vehicle=plan.vehicle
            )

    def run(self, *, seed: int) -> SearchEpisode:
        """Run the search with the missions' start times, which keep the vehicles apart."""
        plan = self.planned(seed=seed)
        problem = self.problem
        flights: list[list[tuple[float, float]]] = [[] for _ in range(problem.robots)]
        for mission in self.missions:
            flights[mission.robot - 1].append(
                (mission.start or 0.0, mission.duration(plan.vehicle))
            )
        seconds = tuple(one[0][0] if one else 0.0 for one in flights)
        if any(seconds):
            problem = problem.replaced(delays=seconds).at_place(problem.place)
        plan = replace(plan, delays=np.array(seconds), schedule=tuple(map(tuple, flights)))
        return run(problem, seed=seed, plan=plan)

    def write(self, plan: SearchPlan) -> list[Path]:
        """Write the missions of a search plan and their map; return the paths of the written files.

        If the missions do not exist yet, the method creates them first.
        """
        if not self.missions:
            self.plan(plan)
        written = write_missions(
            self.missions,
            self.folder,
            formats=self.given.format or None,
            vehicle=plan.vehicle,
            angle=plan.grid.angle,
        )
        save_figure(
            missions_figure(self.missions, plan.grid.region, self.approach), self.folder / MAP
        )
        return [*written, self.folder / MAP]

    def report(self, plan: SearchPlan) -> dict[str, Any]:
        """Return a summary of the missions as JSON data."""
        kept, near, frame = self.given.kept_apart, self.approach, plan.grid.region.frame
        homes = (
            None if kept is None else near_homes(homes_of(self.missions), kept.horizontal, frame)
        )
        return {
            "sorties": len(self.missions),
            "usable_s": None if plan.vehicle.endurance is None else plan.vehicle.usable_seconds,
            "recharge_s": plan.vehicle.recharge_seconds,
            "separation_m": None if kept is None else [kept.horizontal, kept.vertical],
            "delay_tolerance_s": None if kept is None else kept.delay,
            "nearest_approach": None if near is None else near.report(frame),
            "near_homes": None if homes is None else homes.report(),
            "airspace_m": airspace_of(self.missions, plan.grid.region),
            "starts": [
                {
                    **one.flight_report(plan.vehicle),
                    "robot": one.robot,
                    "sortie": one.sortie,
                    "start_s": one.start,
                    "altitude_m": one.altitude,
                    "takeover_m": one.takeover,
                }
                for one in self.missions
            ],
        }


def write_check(result: MissionCheck, folder: Path, *, drawn: bool = True) -> list[Path]:
    """Write the report of a mission check, and return the paths of the written files.

    If the check has measured the coverage, the function writes the uncovered area beside the
    report. If ``drawn`` is true, the function writes a map beside the report.
    """
    written = [folder / "check.json"]
    write_json(written[0], result.report())
    if result.coverage is not None:
        written.append(folder / UNCOVERED)
        result.write_uncovered(written[1])
    if result.missions and drawn:
        save_figure(missions_figure(result.missions, result.region, result.approach), folder / MAP)
        written.append(folder / MAP)
    return written
