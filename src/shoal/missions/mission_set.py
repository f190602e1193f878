"""MissionSet: the missions of all robots of a search, planned or read from files, to be checked,
written and run.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from shoal.core.checks import as_path, check_list
from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.missions.approach import (
    MissionApproach,
    airspace_of,
    homes_of,
    missions_approach,
    near_homes,
)
from shoal.missions.checking import (
    MissionCheck,
    SmallestImage,
    cautions_about_circling,
    cautions_about_distance,
    check_sheets,
    distance_of,
    seen_over_ground,
)
from shoal.missions.deconfliction import plan_missions
from shoal.missions.diagnostics import Sheet
from shoal.missions.fence import CORNERS, region_with_barriers
from shoal.missions.files import (
    format_of,
    mission_of,
    mission_texts,
    number_apart,
    open_sheets,
    sheets_of_texts,
    write_missions,
)
from shoal.missions.formats import FORMATS
from shoal.missions.linting import Limits, lint_sheets
from shoal.missions.mission import Mission
from shoal.missions.options import CheckOptions, MissionOptions
from shoal.search.episode import SearchEpisode
from shoal.search.flight.dubins import NoRoomError
from shoal.search.flight.flight import Altitudes
from shoal.search.flight.terrain import Terrain, open_terrain
from shoal.search.planning.orientation import STRAIGHT
from shoal.search.planning.plan import (
    SearchPlan,
    attempts,
    in_order,
    narrower_margin_text,
    plan_at_margin,
    price_of_turns,
    tell_if_straight_rows_are_faster,
    without_delays,
)
from shoal.search.planning.sightings import planned_success
from shoal.search.problem import LIKELY, SHORTER, TOUR, SearchProblem
from shoal.search.problem.fields import AUTO
from shoal.search.regions.margin import without_margin
from shoal.search.regions.places import read_points
from shoal.search.regions.projection import ROUNDED
from shoal.search.regions.region import SearchRegion
from shoal.search.run import run

VEHICLE = "multirotor"
"""The vehicle of missions of a search that names none."""

_SLIGHT = 0.02  # of the time of a plan: shorter waiting changes little
_SEEN = 0.9995  # share of what a camera sees over flat ground, below which missions are refused
_EXACT = {True: "plan", False: "csv"}  # formats of missions in degrees and in metres
_MUCH_LONGER = 2  # times as long: missions for which a part of the reserve is given up
_ROUNDED = 1.0  # second: rounding of times in files


class MissionSet:
    """The missions of all robots of a search, on the assumption that no robot has a fault.

    Make a set with `from_problem` or `from_plan`, or read one with `read`.

    Attributes
    ----------
    problem : SearchProblem or None
        The problem, in whose region vehicles keep the margin and the exclusion polygons of the
        missions' fence; None for a set that was read.
    plan : SearchPlan or None
        The plan of the search; None for a set that was read.
    options : MissionOptions
    seed : int
        The seed of the plan, with which `run` simulates the search.
    folder : Path or None
        The folder from which the set was read.
    terrain : Terrain or None
        The ground under planned missions.

    Examples
    --------
    >>> problem = SearchProblem("rectangle:60x40", robots=2, footprint=20)
    >>> missions = MissionSet.from_problem(problem)
    >>> [mission.name for mission in missions.missions], missions.plan.vehicle.kind
    (['robot-01', 'robot-02'], 'multirotor')
    >>> missions.check().coverage.covered_fraction
    1.0
    """

    def __init__(
        self,
        missions: Sequence[Mission] | None = None,
        *,
        problem: SearchProblem | None = None,
        plan: SearchPlan | None = None,
        options: MissionOptions | None = None,
        seed: int = 0,
        folder: Path | None = None,
        terrain: Terrain | None = None,
    ) -> None:
        self._missions = (
            None if missions is None else tuple(check_list(missions, Mission, what="missions"))
        )
        self.problem, self.plan, self.seed, self.folder = problem, plan, seed, folder
        self.terrain = terrain
        self.options = MissionOptions() if options is None else options

    @classmethod
    def from_problem(
        cls, problem: SearchProblem, options: MissionOptions | None = None, *, seed: int = 0
    ) -> MissionSet:
        """Plan a search and its missions.

        Missions need a vehicle: a multirotor, if the problem names none. If a vehicle has no room
        for a turn or a path, the method tries narrower margins, other angles of the rows and a smaller
        reserve, unless the problem gives them. `cautions` says what the plan lacks then.

        Raises
        ------
        InvalidInputError, UnknownNameError
            If an option is invalid, or if a rover would have to leave the region, before any
            planning; or if the robots cannot search the region as the problem demands.
        """
        options = MissionOptions() if options is None else options
        problem.check_at_place()
        for name in options.format:
            FORMATS.get(name)
        if problem.vehicle is None:
            problem = problem.replaced(vehicle=VEHICLE).at_place(problem.place)
        options.check_for(problem)
        reserve = problem.default_cross_track if problem.cross_track is None else 0.0
        reserves = (reserve, reserve / 2, 0.0) if reserve else (problem.cross_track,)
        problem = problem.replaced(cross_track=reserves[0]).at_place(problem.place)
        terrain = None if options.terrain is None else open_terrain(options.terrain)
        fenced = _add_barriers(problem, options)
        widest = fenced.margin or 0.0
        # to stay out of no-go zones counts more than to see everything in spite of errors; other
        # angles take the longest, so they are tried with the whole reserve and at the end
        fallbacks = [
            (own, turned, margin)
            for safe in (True, False)
            for own in reserves
            for turned, margin in attempts(problem, widest)
            if (margin >= problem.least_margin) == safe
            and (not turned or own == reserves[0 if safe else -1])
        ]

        def make(own: float | None, turned: bool, margin: float) -> MissionSet:
            """Return the missions with a reserve, rows at the best or at other angles, and a margin."""
            attempt = fenced
            if (own, margin) != (fenced.cross_track, fenced.margin) or turned:
                other = problem.replaced(cross_track=own)
                if problem.margin is None:
                    other = other.replaced(margin=margin)
                attempt = _add_barriers(other.at_place(problem.place), options)
            plan = plan_at_margin(attempt, seed=seed, rotated_rows=turned)
            if turned:  # a run of the problem makes the same plan
                attempt = attempt.replaced(angle=plan.grid.angle).at_place(attempt.place)
            return cls.from_plan(plan, options, problem=attempt, seed=seed, terrain=terrain)

        refusal: InvalidInputError | None = None
        for own, turned, margin in fallbacks:
            try:
                missions = make(own, turned, margin)
                break
            except InvalidInputError as error:
                # another angle, margin or reserve is tried for room alone, but may fail for any reason
                if refusal is None and not isinstance(error, NoRoomError):
                    raise
                refusal = refusal if turned else error
        else:
            assert refusal is not None
            raise refusal
        why = "a vehicle has no room for its turns or its path"
        assert missions.plan is not None
        if (
            own
            and own == reserve
            and problem.tour == AUTO
            and missions.plan.tour.name not in STRAIGHT
        ):
            # where no vehicle can turn from row to row, what is left may take many times as long
            with suppress(InvalidInputError):
                quicker = make(reserve / 2, turned, margin)
                if missions.end > _MUCH_LONGER * quicker.end:
                    own, missions = reserve / 2, quicker
                    why = f"missions take more than {_MUCH_LONGER} times as long"
        if own != reserves[0]:
            tell_once(
                f"cross_track: {own:.3g} m in place of {reserve:.3g} m, because with narrower rows"
                f" {why}: with errors of positions, gaps may remain"
            )
        plan, taken = missions.plan, missions.problem
        assert plan is not None
        assert taken is not None
        if options.required_separation is not None and plan.image is None:
            missions = missions._choose_after_waiting(plan.alternatives, terrain)
        if options.required_separation is not None and problem.prior and problem.order == AUTO:
            missions = missions._pick_soonest(terrain)
        if not taken.margin:
            tell_once(
                "margin: paths may touch the fence and no-go zones, because the margin is 0 m"
            )
        if taken.margin != widest:
            tell_once(narrower_margin_text(taken.margin or 0.0, widest))
        tell_if_straight_rows_are_faster(plan, taken, seed)
        missions._tell_if_late()
        missions._check_sees_ground()
        return missions

    def _check_sees_ground(self) -> None:
        """Refuse missions whose camera does not see over the terrain what it sees over flat ground,
        because it flies lower above the ground than planned.
        """
        seen = self._seen_over_ground
        if seen is not None and seen[0] < _SEEN * seen[1]:
            over, flat, smallest = seen
            raise InvalidInputError(
                f"altitude_frame: expected altitudes from which the camera sees {100 * flat:.4g} % of"
                f" the region, as over flat ground, got {100 * over:.4g} % with altitudes above"
                f" {self.options.altitude_frame}: {smallest}; give altitude_frame ground"
            )

    @cached_property
    def _seen_over_ground(self) -> tuple[float, float, SmallestImage] | None:
        """The share of the region that a camera sees over the terrain, the share over flat ground,
        and the smallest image; None without a terrain or a camera, or if no image is too small.
        """
        if self.terrain is None or self.plan is None or self.plan.image is None:
            return None
        texts = mission_texts(
            self.missions, formats=[_EXACT[self.missions[0].geographic]], angle=self.plan.facing
        )
        options = self.check_options.replaced(terrain=self.terrain)
        return seen_over_ground(sheets_of_texts(texts), options)

    def _tell_if_late(self) -> None:
        """Tell if the last vehicle is back later than the limit of a plan with a prior."""
        problem, plan = self.problem, self.plan
        assert problem is not None
        assert plan is not None
        if plan.plain_seconds is None or plan.refusal is not None:
            return
        limit = problem.at_most * plan.plain_seconds
        if self.end > limit + _ROUNDED:
            tell_once(
                f"at_most: the missions end after {self.end:.0f} s and not within {limit:.0f} s,"
                f" {problem.at_most:g} times the plan without the prior, because vehicles wait for"
                " others that they are kept apart from, or follow the ground"
            )

    def _choose_after_waiting(
        self, alternatives: Sequence[SearchPlan], terrain: Terrain | None
    ) -> MissionSet:
        """Return these missions, or those of an alternative plan with a lower `price_of_turns`,
        because fewer vehicles wait for others.
        """
        best, problem = self, self.problem
        assert problem is not None
        tried = [problem]
        for plan in alternatives:
            if price_of_turns(plan, problem) >= best._price_of_turns:
                continue
            # planned by its names, as a run of these missions plans it again
            choices = {"tour": plan.tour.name, "allocation": plan.allocation.allocator}
            named = problem.replaced(
                **{key: name for key, name in choices.items() if getattr(problem, key) == AUTO}
            ).at_place(problem.place)
            if named in tried:  # they make a plan that is known
                continue
            tried.append(named)
            try:
                alternative = self.from_plan(
                    plan_at_margin(named, seed=self.seed),
                    self.options,
                    problem=named,
                    seed=self.seed,
                    terrain=terrain,
                )
            except InvalidInputError:
                continue
            best = min(best, alternative, key=lambda missions: missions._price_of_turns)
        return best

    @cached_property
    def _price_of_turns(self) -> float:
        """The `price_of_turns` of the plan, with the time by which vehicles wait for others."""
        assert self.plan is not None
        assert self.problem is not None
        waiting = self.end - without_delays(self.plan)
        return price_of_turns(self.plan, self.problem) + waiting

    def _pick_soonest(self, terrain: Terrain | None) -> MissionSet:
        """Return these missions, or those in another order that find the target of the prior earlier
        on average, because fewer vehicles wait for others.

        All keep the limit of the plan with the prior or, if no order does, that many times the time
        of the missions in the order without it.
        """
        plan, problem = self.plan, self.problem
        assert plan is not None
        assert problem is not None
        waiting = self._waiting
        if plan.refusal is not None or waiting <= _ROUNDED:
            return self
        others = (SHORTER, TOUR) if waiting > _SLIGHT * plan.planned_seconds else (TOUR,)
        made = {LIKELY: self}
        times = {LIKELY: _expected_find(self.scheduled, problem)}
        limit = problem.at_most * (plan.plain_seconds or 0.0) + _ROUNDED
        for order in others:
            named = problem.replaced(order=order).at_place(problem.place)
            other = in_order(plan, named)
            if order == TOUR:
                to_beat = [times[name] for name, one in made.items() if one.end <= limit]
                if _expected_find(other, named) >= min(to_beat, default=inf):  # without waiting
                    break
            try:
                made[order] = self.from_plan(
                    other, self.options, problem=named, seed=self.seed, terrain=terrain
                )
            except InvalidInputError:
                continue
            times[order] = _expected_find(made[order].scheduled, named)
        if TOUR in made and min(one.end for one in made.values()) > limit:
            limit = problem.at_most * made[TOUR].end
        in_time = [name for name, one in made.items() if one.end <= limit]
        best = min(in_time or [LIKELY], key=times.__getitem__)
        if best != LIKELY:
            tell_once(
                f"order: {best}, in which vehicles that keep apart find the target after"
                f" {times[best]:.0f} s on average and end after {made[best].end:.0f} s, in place of"
                f" {times[LIKELY]:.0f} s and {self.end:.0f} s; --order sets another one"
            )
        return made[best]

    @property
    def _waiting(self) -> float:
        """Longest time in seconds by which a sortie starts later than planned, to keep apart."""
        plan = self.plan
        assert plan is not None
        return max(
            (
                (mission.start or 0.0) - plan.sorties[mission.robot - 1][mission.sortie - 1][0]
                for mission in self.missions
                if mission.sortie <= len(plan.sorties[mission.robot - 1])
            ),
            default=0.0,
        )

    @property
    def end(self) -> float:
        """The time in seconds at which the last vehicle is back."""
        assert self.plan is not None
        return max(
            (
                (mission.start or 0.0) + mission.duration(self.plan.vehicle)
                for mission in self.missions
            ),
            default=0.0,
        )

    @classmethod
    def from_plan(
        cls,
        plan: SearchPlan,
        options: MissionOptions | None = None,
        *,
        problem: SearchProblem | None = None,
        seed: int = 0,
        terrain: Terrain | None = None,
    ) -> MissionSet:
        """Make the missions of a plan. Only `run` needs the ``problem`` and the ``seed`` of the plan."""
        options = MissionOptions() if options is None else options
        region = plan.grid.region
        rally = options.rally
        missions = plan_missions(
            plan,
            separation=options.required_separation,
            rally=None if rally is None else read_points(Path(rally), region, what="rally points"),
            fenced=options.fenced,
            airspace=options.airspace,
            ending=options.ending,
            autopilot=options.autopilot,  # type: ignore[arg-type]  # one of the choices
            cap=options.cap,
            altitudes=Altitudes(options.altitude_frame, terrain, options.terrain_error),
        )
        plan = replace(plan, ending=_ending_of(missions))  # its times are those of the missions
        return cls(
            missions, problem=problem, plan=plan, options=options, seed=seed, terrain=terrain
        )

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> MissionSet:
        """Read the mission files of a folder. What is wrong in them, `check` reports.

        Raises
        ------
        InvalidInputError
            If the folder has no mission files.
        """
        if not as_path(folder, what="folder").is_dir():
            raise InvalidInputError(
                f"{folder}: expected a folder of mission files, got"
                f" {'a file' if Path(folder).exists() else 'none'}"
            )
        return cls(folder=Path(folder))

    @cached_property
    def missions(self) -> tuple[Mission, ...]:
        """The missions, robot by robot and sortie by sortie.

        Of a set that was read, these are the missions of the first format in the folder, without
        those that a vehicle cannot fly.
        """
        if self._missions is not None:
            return self._missions
        sheets = self._sheets()
        flyable = []
        for sheet in sheets:
            if format_of(Path(sheet.file)) == format_of(Path(sheets[0].file)) and sheet.readable:
                try:
                    flyable.append(mission_of(sheet, sheet.file))
                except InvalidInputError:
                    continue  # a diagnostic of the check says why
        return tuple(sorted(flyable, key=lambda mission: (mission.robot, mission.sortie)))

    def _sheets(self) -> list[Sheet]:
        """Return what the files of the missions contain, fresh for a check, which adds to it."""
        if self.folder is None:
            return sheets_of_texts(self.texts())
        sheets = open_sheets(self.folder)
        number_apart(sheets)
        return sheets

    def texts(self) -> dict[str, str]:
        """Return the texts of the files that `write` writes, by file name."""
        return mission_texts(self.missions, **self._writing)

    @property
    def _writing(self) -> dict[str, Any]:
        plan = self.plan
        return {
            "formats": self.options.format or None,
            "vehicle": None if plan is None else plan.vehicle,
            "angle": None if plan is None else plan.facing,
        }

    def write(self, folder: str | os.PathLike[str]) -> list[Path]:
        """Write the missions in the formats of the options, and return the written files, as
        `write_missions` does.
        """
        return write_missions(self.missions, folder, **self._writing)

    def check(self, options: CheckOptions | None = None) -> MissionCheck:
        """Check the files of the missions against what ``options`` say.

        Parameters
        ----------
        options : CheckOptions, optional
            By default, missions with a plan are compared with the plan: its region, footprints and
            vehicle, and the cap and the separation of the missions. A set that was read needs
            ``options``, because its files do not name the region.
        """
        return check_sheets(self._sheets(), self.check_options if options is None else options)

    @property
    def check_options(self) -> CheckOptions:
        """What a check compares missions with a plan with."""
        if self.plan is None:
            raise InvalidInputError(
                "options: expected the region of missions that were read, got none"
            )
        sides = tuple(self.plan.footprints.tolist())
        planned = sides if len({*sides}) > 1 else sides[0]
        terrain: dict[str, Any] = {}
        if self.options.terrain is not None:
            terrain = {name: getattr(self.options, name) for name in ("terrain", "terrain_error")}
        return CheckOptions(
            self.plan.grid.region if self.problem is None else self.problem.place,
            footprint=planned if self.problem is None else self.problem.view,
            angle=self.plan.facing,
            cap=self.options.cap,
            separation=self.options.required_separation or (0.0,),
            vehicle=self.plan.vehicle,
            **terrain,
        )

    @property
    def region(self) -> SearchRegion | None:
        """The region of the plan, or None for a set that was read."""
        return None if self.plan is None else self.plan.grid.region

    @cached_property
    def approach(self) -> MissionApproach | None:
        """The nearest approach of two vehicles, or None if they always keep the vertical
        separation, or if the options ask for no separation.
        """
        plan, separation = self.plan, self.options.required_separation
        if plan is None or separation is None:
            return None
        return missions_approach(
            self.missions, separation, plan.grid.region.frame, vehicle=plan.vehicle
        )

    def run(self) -> SearchEpisode:
        """Run the planned search with the missions' start times, which keep the vehicles apart."""
        problem, plan = self.problem, self.plan
        if problem is None or plan is None:
            raise InvalidInputError("missions: expected planned missions to run, got read ones")
        scheduled = self.scheduled
        if scheduled.delays.any():
            delays = tuple(scheduled.delays.tolist())
            problem = problem.replaced(delays=delays).at_place(problem.place)
        return run(problem, seed=self.seed, plan=scheduled)

    @property
    def scheduled(self) -> SearchPlan:
        """The plan with the start times and durations of the missions."""
        plan = self.plan
        assert plan is not None
        flights: list[list[tuple[float, float]]] = [[] for _ in range(len(plan.places))]
        for mission in self.missions:
            flights[mission.robot - 1].append(
                (mission.start or 0.0, mission.duration(plan.vehicle))
            )
        delays = np.array([sorties[0][0] if sorties else 0.0 for sorties in flights])
        return replace(plan, delays=delays, schedule=tuple(map(tuple, flights)))

    @property
    def cautions(self) -> tuple[str, ...]:
        """Sentences about planned missions that keep less distance than the errors of their vehicles
        need, because there is no room or because the problem asks for it.

        Near a border or a no-go zone, vehicles may cross it; with a small reserve, parts of the
        region may stay unseen.
        """
        problem, plan = self.problem, self.plan
        if problem is None or plan is None:
            return ()
        vehicle, sentences = plan.vehicle, list[str]()
        paths = [np.vstack([one.home, one.waypoints[:, :2], one.end]) for one in self.missions]
        frame = problem.place.frame
        if frame is not None:
            paths = [frame.to_metres(path) for path in paths]
        distance = distance_of(paths, vehicle.kind, problem.place)
        if distance is not None:
            sentences += cautions_about_distance(distance, vehicle)
        if vehicle.radius:
            sheets = self._sheets()
            same = [one for one in sheets if Path(one.file).suffix == Path(sheets[0].file).suffix]
            lint_sheets(same, None, Limits(vehicle=vehicle))
            sentences += [
                f"{found.file}, {found.place}, as written: {found.sentence}"
                for sheet in same
                for found in sheet.diagnostics
                if found.rule in ("turn-radius", "climb", "approach")
            ]
        if any(one.altitude_frame == "sea" and one.elevation is None for one in self.missions):
            sentences.append(
                "altitudes count from the sea, and without --terrain nobody has looked how high home"
                " and the ground lie: times, battery and separation are those of a home at the sea"
            )
        separation = self.options.required_separation
        if separation is not None:
            sentences += cautions_about_circling(self.missions, vehicle, separation.delay)
        if vehicle.cross_track - problem.row_reserve > ROUNDED:
            sentences.append(
                f"rows keep a reserve of {problem.row_reserve:.3g} m, not of"
                f" {vehicle.cross_track:.3g} m: with errors of positions and cut corners, vehicles may"
                " not see everything between two rows"
            )
        if plan.reach and vehicle.radius:
            sentences.append(
                f"images see {plan.reach:.3g} m less beyond the ends of paths than the reserve of rows:"
                " with errors of positions, vehicles may not see everything there"
            )
        if self._seen_over_ground is not None:
            over, flat, smallest = self._seen_over_ground
            if over < flat - 1e-6:
                sentences.append(
                    f"the camera sees {100 * over:.6g} % of the region over the terrain, in place of"
                    f" {100 * flat:.6g} %: {smallest}"
                )
        return tuple(sentences)

    def report(self) -> dict[str, Any]:
        """Return a summary of planned missions as JSON data."""
        plan, separation, near = self.plan, self.options.required_separation, self.approach
        assert plan is not None
        vehicle, region = plan.vehicle, plan.grid.region
        homes = (
            None
            if separation is None
            else near_homes(homes_of(self.missions), separation.horizontal, region.frame)
        )
        return {
            "sorties": len(self.missions),
            "cross_track_m": None if self.problem is None else self.problem.cross_track,
            "cautions": list(self.cautions),
            "usable_s": None if vehicle.endurance is None else vehicle.usable_seconds,
            "recharge_s": vehicle.recharge_seconds,
            "separation_m": (
                None if separation is None else [separation.horizontal, separation.vertical]
            ),
            "delay_tolerance_s": None if separation is None else separation.delay,
            "nearest_approach": None if near is None else near.report(region.frame),
            "near_homes": None if homes is None else homes.report(),
            "airspace_m": airspace_of(self.missions, region),
            "fenced": any(mission.fence is not None for mission in self.missions),
            "starts": [
                {
                    **mission.flight_report(vehicle),
                    "robot": mission.robot,
                    "sortie": mission.sortie,
                    "start_s": mission.start,
                    "altitude_m": mission.altitude,
                    "takeover_m": mission.takeover,
                }
                for mission in self.missions
            ],
        }


def _expected_find(plan: SearchPlan, problem: SearchProblem) -> float:
    """Return the expected time in seconds until vehicles find the target of the prior."""
    limit = problem.at_most * (plan.plain_seconds or 0.0) if problem.moves else None
    found = planned_success(plan, problem, limit).mean
    return inf if found is None else found


def _ending_of(missions: Sequence[Mission]) -> str | None:
    """Return how missions end, which is the same for all; None without missions."""
    if not missions:
        return None
    first = missions[0]
    return "return" if first.landing is None else "land" if first.loiter is None else "loiter"


def _add_barriers(problem: SearchProblem, options: MissionOptions) -> SearchProblem:
    """Return a problem with the margin of missions, and with exclusion polygons that the autopilot
    can store.
    """
    region = problem.with_own_margin(without_margin(problem.place), fenced=True)
    if options.fenced:
        region = region_with_barriers(
            region,
            CORNERS[options.autopilot],
            places=np.concatenate(problem.fixed_places(region)),
            wing=problem.chosen_vehicle.kind == "fixed-wing",
        )
    return problem.replaced(margin=region.margin).at_place(region)


def check_missions(
    folder: str | os.PathLike[str],
    region: SearchRegion | str | os.PathLike[str],
    footprint: float | Sequence[float] | None = None,
    **options: Any,
) -> MissionCheck:
    """Check the mission files of a folder, as ``shoal missions check`` does.

    Parameters
    ----------
    folder : path
        Folder of mission files.
    region, footprint, **options
        The fields of `CheckOptions`. Without a footprint, and without a vehicle that has a camera
        or detector, the function only lints the files.

    Raises
    ------
    InvalidInputError, UnknownNameError
        If the folder has no mission files (of the given format), if a robot has no footprint, or if
        the region is in degrees and a mission in metres, or the reverse.
    """
    checked = CheckOptions(region, footprint=footprint, **options)  # type: ignore[arg-type]
    return MissionSet.read(folder).check(checked)
