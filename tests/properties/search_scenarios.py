"""Random scenarios: regions, robots, networks and faults of all kinds, from one number each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.search.allocation.costs import TourCost
from shoal.search.cells.distances import CellDistances
from shoal.search.problem.network import (
    Battery,
    Crash,
    Fault,
    Liar,
    Pause,
    RadioNetwork,
    Slow,
    WrongPosition,
    network_of,
)
from shoal.search.protocol.state import Brief
from shoal.search.simulation.scenario import Scenario
from shoal.search.tours import make_tour

TOURS = ("hilbert", "moore", "hilbert-rectangle", "comb", "spanning-tree", "open-hilbert")
ALLOCATORS = ("stay", "common-shift", "individual-shift", "two-way", "hop")
_STEPWISE = 0.3  # share of scenarios in which robots go from cell to cell and meet obstacles
_PRIORS = 0.3  # share of scenarios in which robots know where a target is likely
_VOLUMES = 0.15  # share of scenarios in several layers
_LARGEST = 7  # rows and columns
_MOST_ROBOTS = 16


def random_scenario(seed: int, *, wide: bool = False) -> Scenario:
    """Return the scenario of a number; if ``wide``, with footprints of 1 to 5 cells' width and
    parts shared by real ways.

    Examples
    --------
    >>> random_scenario(7).starts == random_scenario(7).starts
    True
    """
    rng = np.random.default_rng(seed)
    tour = make_tour(
        str(rng.choice(TOURS)), volume_of(random_mask(rng), np.random.default_rng([seed, 3]))
    )
    distances = CellDistances(tour) if rng.random() < _STEPWISE else None
    tour_cost = TourCost(
        tour,
        turn_cost=float(rng.choice([0.0, 0.0, 0.5, 1.0])),
        distances=distances,
        reckoned=wide,
        **random_prior(np.random.default_rng([seed, 4]), len(tour)),
    )
    n, m = (
        len(tour_cost),
        int(
            rng.integers(1, _MOST_ROBOTS + 1)
            if rng.random() < 0.1
            else min(rng.geometric(0.18), _MOST_ROBOTS)
        ),
    )
    whole = tour_cost.whole
    multiplicity = int(rng.choice([1, 1, 1, 2, 3]))
    energy = float(rng.choice([inf, inf, inf, 1.0])) * (whole / 2 + 3 * _LARGEST)
    brief = Brief(
        tour_cost,
        str(rng.choice(ALLOCATORS)),
        multiplicity=multiplicity,
        hello=float(rng.choice([0.5, 1.0, 3.0])),
        beat=float(rng.choice([1.0, 2.0, 4.0, 6.0])),
        energy=energy,
        recharge=float(rng.integers(0, 5)),
    )
    starts = _starts(rng, n, m)
    brief = with_launches(brief, starts, np.random.default_rng([seed, 3]))
    air = np.random.default_rng([seed, 2])
    signed, packet = air.random() < 0.2, int(air.choice([0, 0, 0, 0, 64, 100, 1200]))
    rates = (
        (1.0,) * m
        if rng.random() < 0.6
        else tuple(float(rate) for rate in rng.uniform(0.5, 2.0, size=m))
    )
    return Scenario(
        brief,
        starts,
        rates,
        network=attacked(random_network(rng, whole), air, signed=signed),
        faults=random_faults(
            rng, m, whole, liars=multiplicity - 1, energy=energy, lost=distances is None
        ),
        targets=tuple(int(cell) for cell in rng.integers(0, n, size=rng.integers(0, 4))),
        detection=float(rng.choice([1.0, 0.8])),
        false_alarm=float(rng.choice([0.0, 0.02])),
        obstacles=() if distances is None else random_obstacles(rng, n, starts),
        widths=tuple(
            int(width) for width in np.random.default_rng([seed, 1]).choice([1, 1, 3, 5], size=m)
        )
        if wide
        else (),
        signed=signed,
        packet=packet,
        seed=seed,
    )


@dataclass(frozen=True)
class FarLaunches:
    """Launch points outside, as `LaunchDistances` tells of them: each so far from the cell in which
    its robot starts, by number.
    """

    away: dict[int, float]
    starts: tuple[int, ...]
    tour_cost: TourCost

    def __contains__(self, number: int) -> bool:
        return number in self.away

    def length(self, number: int, cell: int) -> float:
        return self.away[number] + self.tour_cost.length(self.starts[number - 1], cell)


def with_launches(brief: Brief, starts: tuple[int, ...], rng: Generator) -> Brief:
    """Return a brief in which, now and then, robots set out late, or outside; not where that could
    take all of their energy.
    """
    delays, away = (
        np.round(rng.exponential(20.0, len(starts)), 2),
        rng.exponential(10.0, len(starts)),
    )
    late, outside = rng.random(2) < 0.2
    far = FarLaunches(
        {k + 1: float(away[k]) for k in range(0, len(starts), 2)}, starts, brief.tour_cost
    )
    return replace(
        brief,
        delays=tuple(delays.tolist()) if late else (),
        launch_distances=far if outside and brief.energy == inf else None,
    )  # type: ignore[arg-type]  # it is asked for nothing else


def random_prior(rng: Generator, n: int) -> dict[str, Any]:
    """Return the arguments of a tour cost for a search with a prior, in some scenarios."""
    if rng.random() > _PRIORS:
        return {}
    odds = rng.exponential(size=n) * (rng.random(n) < 0.7)
    if not odds.any():
        odds[int(rng.integers(n))] = 1.0
    return {"odds": odds / odds.sum(), "at_most": float(rng.choice([1.0, 1.1, 1.5]))}


def random_mask(rng: Generator) -> NDArray[np.bool_]:
    """Return a random region, bool, shape (H, W): a whole rectangle, one with holes, or one full of
    gaps; at least one cell.
    """
    shape = tuple(int(side) for side in rng.integers(1, _LARGEST + 1, size=2))
    mask = np.ones(shape, dtype=np.bool_)
    kind = rng.integers(3)
    if kind == 1:
        for _ in range(int(rng.integers(1, 4))):
            low = rng.integers(0, shape)
            high = low + rng.integers(1, 5, size=2)
            mask[low[0] : high[0], low[1] : high[1]] = False
    elif kind == 2:
        mask = rng.random(shape) < rng.uniform(0.4, 0.95)
    if not mask.any():
        mask[rng.integers(shape[0]), rng.integers(shape[1])] = True
    return mask


def volume_of(mask: NDArray[np.bool_], rng: Generator) -> NDArray[np.bool_]:
    """Return a mask, or as often as `_VOLUMES` says a few layers of up to four rows and columns
    that differ in some cells.
    """
    if rng.random() >= _VOLUMES:
        return mask
    layer = mask[:4, :4]
    volume = layer & (rng.random((int(rng.integers(2, 4)), *layer.shape)) < rng.choice([0.7, 1.0]))
    if not volume.any():
        volume.flat[int(rng.integers(volume.size))] = True
    return np.asarray(volume)


def random_network(rng: Generator, whole: float) -> RadioNetwork:
    """Return a random network: all is lost, nothing, or up to three models together."""
    kind = rng.integers(8)
    if kind == 0:
        return network_of(loss=1.0)
    if kind == 1:
        return RadioNetwork()
    since, until = np.sort(rng.random(2) * whole)
    models = [
        f"loss:{rng.random():.3f}",
        f"bursts:{rng.uniform(0.01, 0.5):.3f}:{rng.uniform(0.01, 0.5):.3f}",
        f"range:{rng.uniform(1, _LARGEST):.2f}",
        f"partition:{since:.2f}:{until:.2f}",
        f"delay:{rng.uniform(0.01, 4):.3f}",
        f"duplicates:{rng.random() / 2:.3f}",
        f"corruption:{rng.random() / 2:.3f}",
    ]
    return network_of(",".join(rng.choice(models, size=rng.integers(1, 4), replace=False)))


def attacked(network: RadioNetwork, rng: Generator, *, signed: bool) -> RadioNetwork:
    """Return a network with somebody in it who sends what he has recorded, and forges, if messages
    are signed.
    """
    attacks = (
        network_of(f"replays:{rng.random()}").media
        if rng.random() < (0.5 if signed else 0.05)
        else ()
    )
    forged = network_of(f"forgeries:{rng.random()}").media if signed and rng.random() < 0.5 else ()
    return RadioNetwork(attacks + forged + network.media)


def random_obstacles(rng: Generator, n: int, starts: tuple[int, ...]) -> tuple[int, ...]:
    """Return cells that cannot be entered: none to two fifths of all, but no starts."""
    drawn = rng.permutation(n)[: int(rng.uniform(0, 0.4) * n)]
    return tuple(int(cell) for cell in drawn if cell not in starts)


def random_faults(
    rng: Generator, robots: int, whole: float, *, liars: int, energy: float, lost: bool
) -> tuple[Fault, ...]:
    """Return random faults; at most so many liars, wrong positions if ``lost``, and every fourth
    time all robots but one die.
    """
    found: list[Fault] = []
    numbers = [int(number) for number in 1 + rng.permutation(robots)]
    if rng.random() < 0.25:
        early = rng.random() < 0.5
        return tuple(
            Crash(number, 0.0 if early else float(rng.random() * whole / 2))
            for number in numbers[1:]
        )
    for number in numbers[1:]:
        kind = rng.integers(16)
        time = float(rng.random() * whole / 2)
        if kind in (0, 1):
            found.append(Crash(number, time))
        elif kind == 2:
            found.append(Pause(number, time, time + float(rng.random() * whole)))
        elif kind in (3, 7):
            found.append(Slow(number, float(rng.uniform(1.5, 5 if kind == 3 else 40)), time))
        elif kind == 4:
            found.append(Battery(number, float(rng.random()) * min(energy, whole)))
        elif kind == 5 and lost:
            found.append(WrongPosition(number, int(rng.integers(1, 50))))
        elif kind == 6 and liars > 0:
            found.append(Liar(number))
            liars -= 1
    return tuple(found)


def _starts(rng: Generator, n: int, robots: int) -> tuple[int, ...]:
    """Return random starts: anywhere, close together, or all in one cell."""
    kind = rng.integers(4)
    if kind == 0:
        return (int(rng.integers(n)),) * robots
    if kind == 1:
        return tuple(
            int(cell) % n for cell in rng.integers(n) + rng.integers(0, max(2, n // 8), size=robots)
        )
    return tuple(int(cell) for cell in rng.integers(0, n, size=robots))
