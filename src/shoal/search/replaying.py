"""Episodes on disk: as they were told, and played again."""

from __future__ import annotations

from math import inf

import numpy as np

from shoal.errors import InvalidInputError
from shoal.search.episode import EpisodeForm, RobotLog, SearchEpisode, fault_of
from shoal.search.planning import SearchPlan, plan_search
from shoal.search.played import Played, as_planned, simulated
from shoal.search.projection import LocalFrame
from shoal.search.region import region_of
from shoal.search.running import scenario_of
from shoal.search.scenario import Scenario


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
