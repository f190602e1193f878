"""search(): plan, let the robots run in the simulation, and say what came of it."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from shoal.errors import InvalidInputError
from shoal.search.allocation.plan import SearchPlan, plan_search, read_points
from shoal.search.episode import SearchEpisode
from shoal.search.live.trace import lived
from shoal.search.regions.region import SearchRegion
from shoal.search.simulation.faults import Fault
from shoal.search.simulation.scenario import Scenario, scenario_of
from shoal.search.simulation.trace import Played, as_planned, simulated
from shoal.search.tours import TourMaker
from shoal.version import __version__

SIMULATED = 1_000_000  # cells times robots: larger searches are not simulated unless asked for


def search(
    region: SearchRegion | str | os.PathLike[str],
    *,
    robots: int,
    footprint: ArrayLike,
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
        `Crash`, by killing the process, of the networks only ``loss``; vehicles meet the obstacles, robots learn of them there.
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
    stepwise = isinstance(obstacles, str | os.PathLike) or np.size(obstacles) > 1 or bool(np.any(obstacles))
    plan = plan_search(
        region, robots=robots, footprint=footprint, starts=starts, tour=tour, allocation=allocation, turn_cost=turn_cost,
        rates=rates, transit=transit, stepwise=stepwise, seed=seed,
    )  # fmt: skip
    scenario = scenario_of(
        plan,
        network=network,
        loss=loss,
        faults=tuple(faults),
        fold=fold,
        energy=energy,
        recharge=recharge,
        speed=speed,
        targets=_target_cells(plan, targets, seed),
        detection=detection,
        false_alarm=false_alarm,
        obstacles=_obstacle_cells(plan, obstacles, seed),
        seed=seed,
    )
    wanted = live is None and (len(plan.course) * robots <= SIMULATED if simulate is None else simulate)
    if live is not None:
        scenario, played = _lived(scenario, live, network, loss)
    else:
        played = simulated(plan, scenario) if wanted else _as_planned(plan, scenario)
    return SearchEpisode(
        plan=plan,
        scenario=scenario,
        network=network,
        loss=loss,
        speed=speed,
        simulated=wanted,
        live=live,
        **vars(played),
        seed=seed,
        seconds=time.perf_counter() - began,
        version=__version__,
    )


def _lived(scenario: Scenario, live: float, network: str, loss: float) -> tuple[Scenario, Played]:
    """Return what comes of a search by real processes; refuse a network that they cannot be given."""
    if network:
        raise InvalidInputError("live: expected no network but a share of lost messages")
    return lived(scenario, live=live, loss=loss)


def _as_planned(plan: SearchPlan, scenario: Scenario) -> Played:
    """Return what comes of a plan if nothing is simulated; refuse what only a simulation shows."""
    brief = scenario.brief
    if scenario.faults or scenario.network.media or brief.fold > 1 or brief.energy < inf or plan.course.stepwise:
        raise InvalidInputError(
            f"search: expected at most {SIMULATED} cells times robots for loss, networks, faults, energy, fold and obstacles, "
            f"which are simulated, got {len(plan.course)} times {len(plan.places)}; ask for the simulation to have it anyway"
        )
    return as_planned(plan)


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
