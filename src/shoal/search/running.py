"""search(): plan, let the robots run in the simulation, and say what came of it."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from shoal.errors import InvalidInputError
from shoal.search.episode import EpisodeForm, RobotLog, SearchEpisode, fault_of
from shoal.search.faults import Crash, Fault
from shoal.search.network import network_of
from shoal.search.planning import SearchPlan, plan_search, read_points
from shoal.search.projection import LocalFrame
from shoal.search.region import SearchRegion, region_of
from shoal.search.robot import Brief
from shoal.search.tours import TourMaker
from shoal.search.world import Outcome, Scenario, World
from shoal.version import __version__

SIMULATED = 1_000_000  # cells times robots: larger searches are not simulated unless asked for
_HELLO, _BEAT = 0.3, 0.05  # seconds that live robots listen, and between their beacons, at the least
_STATES = {kind: kind for kind in ("listening", "searching", "waiting", "complete")} | {
    "killed": "dead",
    "stopped": "dead",
    "failed": "dead",
}
_HORIZON = 60.0  # times the way of one robot alone


def search(
    region: SearchRegion | str | os.PathLike[str],
    *,
    robots: int,
    footprint: float,
    starts: str | ArrayLike | os.PathLike[str] = "random",
    tour: str | TourMaker = "spanning-tree",
    allocation: str = "hop",
    turn_cost: float = 0.0,
    rates: ArrayLike | None = None,
    transit: bool = False,
    loss: float = 0.0,
    network: str = "",
    faults: Sequence[Fault] = (),
    fold: int = 1,
    energy: float = inf,
    recharge: float = 0.0,
    targets: ArrayLike | int = 0,
    detection: float = 1.0,
    false_alarm: float = 0.0,
    obstacles: ArrayLike | int | str | os.PathLike[str] = 0,
    speed: float = 1.0,
    simulate: bool | None = None,
    live: float | None = None,
    seed: int = 0,
) -> SearchEpisode:
    """Search a region with robots that have no coordinator.

    Parameters
    ----------
    region, robots, footprint, starts, tour, allocation, turn_cost, rates, transit
        See `plan_search`.
    loss : float
        Probability that a message is lost.
    network : str
        See `network_of`.
    faults : sequence of Fault
        Robots are numbered from 1 on; times are those of a cell.
    fold : int
        How many robots must search each cell.
    energy : float
        Metres that a robot can go before it must be back at its start; ``recharge`` is how long that takes there, in seconds.
    targets : int or array_like of float, shape (k, 2)
        How many things to find there are in random cells, or where they are, metres.
    detection, false_alarm : float
        Probability that a robot finds what is in a cell, and what is not.
    obstacles : int, array_like of float, shape (k, 2), or path
        How many random cells cannot be entered, or where such are, metres, or a CSV file of that as for ``starts``. Robots do not
        know it until they come to them; then they go round, and tell the others. With any, robots go from cell to cell, never
        straight.
    speed : float
        Metres a second.
    simulate : bool, optional
        Whether robots and messages are simulated; by default if cells times robots are at most a million.
    live : float, optional
        Cells a second: instead of a simulation, one process a robot over real UDP (`shoal.search.live`). Of the faults only
        `Crash`, by killing the process, of the networks only ``loss``.
    seed : int

    Returns
    -------
    SearchEpisode

    Raises
    ------
    InvalidInputError
        Besides what parts refuse: if faults, loss or a network are given, but no simulation.
    UnknownNameError

    Examples
    --------
    >>> episode = search("square:100", robots=4, footprint=10, seed=1, loss=0.3)
    >>> episode.complete, episode.coverage.covered_fraction
    (True, 1.0)
    """
    began = time.perf_counter()
    _check_numbers(fold=fold, speed=speed, energy=energy, recharge=recharge, detection=detection, false_alarm=false_alarm)
    plan = plan_search(
        region,
        robots=robots,
        footprint=footprint,
        starts=starts,
        tour=tour,
        allocation=allocation,
        turn_cost=turn_cost,
        rates=rates,
        transit=transit,
        stepwise=isinstance(obstacles, str | os.PathLike) or np.size(obstacles) > 1 or bool(np.any(obstacles)),
        seed=seed,
    )
    cell_time = plan.grid.size / speed
    brief = Brief(plan.course, allocation, fold=fold, energy=energy / plan.grid.size, recharge=recharge / cell_time)
    scenario = Scenario(
        brief,
        tuple(int(start) for start in plan.starts),
        tuple(float(rate) for rate in plan.rates),
        network=network_of(network, loss=loss),
        faults=tuple(faults),
        targets=_target_cells(plan, targets, seed),
        detection=detection,
        false_alarm=false_alarm,
        obstacles=_obstacle_cells(plan, obstacles, seed),
        seed=seed,
    )
    if live is not None:
        return _lived(plan, scenario, live=live, network=network, loss=loss, speed=speed, began=began)
    wanted = len(plan.course) * robots <= SIMULATED if simulate is None else simulate
    if not wanted and (faults or loss or network or fold > 1 or energy < inf or plan.course.stepwise):
        raise InvalidInputError(
            f"search: expected at most {SIMULATED} cells times robots for loss, networks, faults, energy, fold and "
            f"obstacles, which are simulated, got {len(plan.course)} times {robots}; ask for the simulation to have it anyway"
        )
    return _played(plan, scenario, network=network, loss=loss, speed=speed, simulated=wanted, began=began)


def _played(
    plan: SearchPlan, scenario: Scenario, *, network: str, loss: float, speed: float, simulated: bool, began: float
) -> SearchEpisode:
    logs, played = _simulated(plan, scenario) if simulated else (_planned(plan), None)
    return SearchEpisode(
        plan=plan,
        scenario=scenario,
        network=network,
        loss=loss,
        speed=speed,
        simulated=simulated,
        live=None,
        robots=logs,
        covered_at=plan.allocation.makespan if played is None else played.covered_at,
        declared={} if played is None else played.declared,
        sent=0 if played is None else played.sent,
        lost=0 if played is None else played.lost,
        takeovers=0 if played is None else played.takeovers,
        seed=scenario.seed,
        seconds=time.perf_counter() - began,
        version=__version__,
    )


def _lived(
    plan: SearchPlan, scenario: Scenario, *, live: float, network: str, loss: float, speed: float, began: float
) -> SearchEpisode:
    """Let processes search; return what they reported."""
    from shoal.search.live import run_live

    kill = [fault for fault in scenario.faults if isinstance(fault, Crash)]
    if network or scenario.obstacles or len(kill) < len(scenario.faults):
        raise InvalidInputError("live: expected no network but a share of lost messages, no fault but crashes, and no obstacles")
    brief = replace(scenario.brief, hello=max(scenario.brief.hello, _HELLO * live), beat=max(scenario.brief.beat, _BEAT * live))
    outcome = run_live(
        brief,
        scenario.starts,
        rates=scenario.rates,
        loss=loss,
        kill=kill,
        targets=scenario.targets,
        speed=live,
        seed=scenario.seed,
    )
    logs, covered, covered_at = [], 0, inf
    for event in outcome.events:
        if event.kind == "searched" and event.cell is not None and covered != brief.everything:
            covered |= 1 << event.cell
            covered_at = event.time if covered == brief.everything else inf
    for number in range(1, len(scenario.starts) + 1):
        own = [event for event in outcome.events if event.robot == number]
        done = [event for event in own if event.kind == "searched" and event.cell is not None]
        states = tuple((event.time, _STATES[event.kind]) for event in own if event.kind in _STATES)
        found = tuple((int(event.cell), (number,)) for event in done if event.found and event.cell is not None)
        cells = np.array([event.cell for event in done], dtype=np.int64)
        logs.append(RobotLog(cells, np.array([event.time for event in done]), states, found))
    return SearchEpisode(
        plan=plan,
        scenario=replace(scenario, brief=brief),
        network=network,
        loss=loss,
        speed=speed,
        simulated=False,
        live=live,
        robots=tuple(logs),
        covered_at=covered_at,
        declared=outcome.declared,
        sent=outcome.heard,
        lost=outcome.lost,
        takeovers=0,
        seed=scenario.seed,
        seconds=time.perf_counter() - began,
        version=__version__,
    )


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
    energy = inf if form.energy is None else form.energy / plan.grid.size
    brief = Brief(plan.course, form.allocation, fold=form.fold, energy=energy, recharge=form.recharge * form.speed / plan.grid.size)
    scenario = Scenario(
        brief,
        tuple(int(start) for start in plan.starts),
        tuple(float(rate) for rate in plan.rates),
        network=network_of(form.network, loss=form.loss),
        faults=tuple(fault_of(entry) for entry in form.faults),
        targets=tuple(form.targets),
        detection=form.detection,
        false_alarm=form.false_alarm,
        obstacles=tuple(form.obstacles),
        seed=form.seed,
    )
    return plan, scenario


def played_again(form: EpisodeForm) -> SearchEpisode:
    """Plan and play an episode on disk again."""
    plan, scenario = _prepared(form)
    return _played(
        plan,
        scenario,
        network=form.network,
        loss=form.loss,
        speed=form.speed,
        simulated=form.simulated,
        began=time.perf_counter(),
    )


def replayed(form: EpisodeForm) -> SearchEpisode:
    """Return the episode that a file tells of, as it tells it."""
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
    return SearchEpisode(
        plan=plan,
        scenario=scenario,
        network=form.network,
        loss=form.loss,
        speed=form.speed,
        simulated=form.simulated,
        live=form.live,
        robots=logs,
        covered_at=inf if form.covered_at is None else form.covered_at,
        declared=dict(form.declared),
        sent=form.sent,
        lost=form.lost,
        takeovers=form.takeovers,
        seed=form.seed,
        seconds=form.seconds,
        version=form.version,
    )


def _check_numbers(**numbers: float) -> None:
    for name, value in numbers.items():
        whole = name == "fold"
        good = not isinstance(value, bool) and isinstance(value, int if whole else int | float | np.number) and not np.isnan(value)
        if name in ("detection", "false_alarm"):
            good, wanted = good and 0 <= value <= 1, "a probability from 0 to 1"
        elif name == "recharge":
            good, wanted = good and 0 <= value < inf, "a number of seconds, 0 or more"
        else:
            good = good and value >= 1 if whole else good and value > 0 and (name == "energy" or value < inf)
            wanted = "a whole number, 1 or more" if whole else "a number above 0"
        if not good:
            raise InvalidInputError(f"{name.replace('_', ' ')}: expected {wanted}, got {value!r}")


def _target_cells(plan: SearchPlan, targets: ArrayLike | int, seed: int) -> tuple[int, ...]:
    """Return the numbers on the tour of the cells with targets."""
    n = len(plan.course)
    if isinstance(targets, int | np.integer):
        if targets < 0 or targets > n:
            raise InvalidInputError(f"targets: expected a number from 0 to {n}, one a cell, got {targets}")
        chosen = np.random.default_rng([seed, 1]).choice(n, size=int(targets), replace=False)
        return tuple(sorted(int(cell) for cell in chosen))
    return _cells_at(plan, targets, "targets")


def _obstacle_cells(plan: SearchPlan, obstacles: ArrayLike | int | str | os.PathLike[str], seed: int) -> tuple[int, ...]:
    """Return the numbers on the tour of the cells that cannot be entered."""
    if isinstance(obstacles, str | os.PathLike):
        return _cells_at(plan, read_points(Path(obstacles), plan.grid.region, what="obstacles"), str(obstacles))
    if not isinstance(obstacles, int | np.integer):
        return _cells_at(plan, obstacles, "obstacles")
    free = np.setdiff1d(np.arange(len(plan.course)), plan.starts)
    if obstacles < 0 or obstacles > len(free):
        raise InvalidInputError(f"obstacles: expected a number from 0 to {len(free)}, none where a robot starts, got {obstacles}")
    chosen = np.random.default_rng([seed, 2]).choice(free, size=int(obstacles), replace=False)
    return tuple(sorted(int(cell) for cell in chosen))


def _cells_at(plan: SearchPlan, points: ArrayLike, what: str) -> tuple[int, ...]:
    inside = plan.grid.region.check_inside(points, what=what)
    return tuple(sorted({int(number) for number in plan.tour.position[tuple(plan.grid.cell_of(inside).T)]}))


def _simulated(plan: SearchPlan, scenario: Scenario) -> tuple[tuple[RobotLog, ...], Outcome]:
    world = World(scenario)
    outcome = world.run(until=_HORIZON * plan.course.whole * scenario.brief.fold + 1000.0)
    logs = tuple(
        RobotLog(
            cells=np.array([cell for _, cell in vehicle.visits], dtype=np.int64),
            times=np.array([moment for moment, _ in vehicle.visits]),
            states=tuple(vehicle.states),
            found=tuple(sorted((cell, tuple(_witnesses(bits))) for cell, bits in vehicle.robot.found.items())),
            detours=tuple(vehicle.detours) if any(vehicle.detours) else (),
            obstructed=tuple(vehicle.obstructed),
        )
        for vehicle in outcome.vehicles.values()
    )
    return logs, outcome


def _witnesses(bits: int) -> list[int]:
    return [number for number in range(bits.bit_length()) if bits >> number & 1]


def _planned(plan: SearchPlan) -> tuple[RobotLog, ...]:
    """Return what robots do if all goes well."""
    logs, course = [], plan.course
    for robot, sweeps in enumerate(plan.allocation.sweeps):
        cells = plan.numbers(sweeps)
        times = np.zeros(0)
        if len(cells):
            steps = np.array([1.0 + course.way(here, cell) for here, cell in pairwise(cells.tolist())])
            first = plan.route(robot, cells[:1]).length / plan.grid.size + 1.0
            times = np.cumsum(np.concatenate([[first], steps])) / plan.rates[robot]
        logs.append(RobotLog(cells, times, ((0.0, "searching"), (float(times[-1]) if len(times) else 0.0, "complete")), ()))
    return tuple(logs)
