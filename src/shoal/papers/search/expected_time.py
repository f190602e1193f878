"""Paper H, exhaustive search along a space-filling curve (1998): reproduction of figure 5."""

from __future__ import annotations

import numpy as np

from shoal.lab.statistics import summarise
from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.claims import claim
from shoal.papers.recipe import NO_DATA, Outcome, Recipe, Settings, Table, capital, curve_of
from shoal.search.allocation.costs import stay_share
from shoal.views.drawing.curves import Curve, Labels, Published, mean_curves

ROBOTS = (1, 2, 3, 5, 7, 10, 15, 20, 30, 40, 50)
CELLS = 1024  # 32 cells per side of 10 m each; a robot needs a second per cell


def _fig5_sweeps(settings: Settings) -> list[Sweep]:
    problem = {
        "kind": "search",
        "region": "square:320",
        "footprint": 10.0,
        "vehicle": "ideal,cruise_speed=10",
        "tour": "moore",
        "allocation": "stay",
        "simulate": False,
    }
    return [
        Sweep(
            name="h-fig5",
            problem=problem,
            axes={"robots": [*ROBOTS]},
            trials=settings.of(400, 60),
            seed=settings.seed,
        )
    ]


def _fig5(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    rows = summarise(store, sweeps[0].name, "planned")
    curve = curve_of("", rows, "robots")
    share = Curve(
        "robots that stay: T$_E$",
        curve.x,
        100 * curve.mean / CELLS,
        100 * curve.low / CELLS,
        100 * curve.high / CELLS,
        Published(np.array([20.0]), np.array([20.0]), points=True),
    )
    theory = np.array([100 * stay_share(int(m)) for m in ROBOTS])
    least = 100 / np.array(ROBOTS)
    flat = [
        Curve(label, curve.x, values, values, values)
        for label, values in (("theory: H$_m$/m", theory), ("no search is faster: 1/m", least))
    ]
    at, last = ROBOTS.index(20), len(ROBOTS) - 1
    table = Table(
        "T_E as % of T_UB",
        ["robots", "ours", "95 % interval", "H_m/m", "bound 1/m"],
        [
            [m, round(mean, 2), f"{low:.2f} to {high:.2f}", round(expected, 2), round(bound, 2)]
            for m, mean, low, high, expected, bound in zip(
                ROBOTS, share.mean, share.low, share.high, theory, least, strict=True
            )
        ],
    )
    there, beyond = (
        np.array([share.mean[k], share.low[k], share.high[k]]) * ROBOTS[k] for k in (at, last)
    )
    half = np.hypot(*((high - low) / 2 / mean for mean, low, high in (there, beyond)))
    growth = float(beyond[0] / there[0])
    claims = (
        claim(
            "% of one robot's time with 20 robots",
            "below 20",
            (share.mean[at], share.low[at], share.high[at]),
            within=(0, 20),
        ),
        claim(
            "m T_E with 50 robots by that with 20",
            "1: reciprocal",
            (growth, growth * (1 - half), growth * (1 + half)),
            within=(0.95, 1.05),
            why="T_E as the reciprocal of m leaves m T_E as it is",
        ),
    )
    sentence = (
        f"Ours are within {100 * np.max(np.abs(share.mean / theory - 1)):.1f} % of H_m/m, so m T_E"
        f" grows as ln m does. {capital(NO_DATA)} but the words about 20 robots."
    )
    labels = Labels(
        "Searching from random starts",
        "robots m",
        "% of one robot's time",
        "printed: less than that",
        note=f"{CELLS} cells, Moore's tour; {NO_DATA}",
    )
    figure = mean_curves([share, *flat], labels, log_y=False)
    return Outcome(figure, claims, sentence, (table,))


RECIPES = (
    Recipe(
        "h-fig5",
        "paper H, Fig. 5",
        "Expected time of a search by the number of robots",
        _fig5_sweeps,
        _fig5,
    ),
)
