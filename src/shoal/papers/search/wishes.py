"""Paper H: marker objects in place of messages, and a region from energy and the extreme robots."""

from __future__ import annotations

from functools import cache
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.claims import claim
from shoal.papers.recipe import Outcome, Recipe, Settings, Table
from shoal.search import TourCost, affordable_rectangle, make_tour, marker_rule
from shoal.search.allocation.costs import stay_share
from shoal.search.problem.network import Crash
from shoal.search.protocol.state import Brief
from shoal.search.simulation.scenario import Scenario
from shoal.search.simulation.world import SearchWorld
from shoal.views.drawing.charts import BLUE, MUTED, ORANGE, bare_axes, padded_figure, set_title
from shoal.views.drawing.curves import Curve, Labels, mean_curves

SIDE = 16  # cells per side
ROBOTS = (2, 3, 5, 8, 12, 20)


@cache
def _square() -> TourCost:
    """Return the tour of the square. A kernel makes it, which an import should not compile."""
    return TourCost(make_tour("moore", (SIDE, SIDE)))


def without_messages(
    starts: NDArray[np.int64], *, stop: bool, dead: int = 0
) -> tuple[float, float, float]:
    """Simulate a search of a square without any message, with a marker at each start.

    Parameters
    ----------
    starts : ndarray of int, shape (m,)
        Tour indices of the robots' starts.
    stop : bool
        Whether robots stop at markers.
    dead : int
        Number of robots, the first ones, that fail before their first move.

    Returns
    -------
    tuple of float
        The time until all cells were searched (infinite if some were not), the time at which the
        last robot stopped, and the share of searched cells; times by that of one robot.
    """
    cells = SIDE * SIDE
    scenario = Scenario(
        Brief(_square(), beat=10.0 * cells),  # nobody listens
        tuple(starts.tolist()),
        faults=tuple(Crash(number, 0.0) for number in range(1, dead + 1)),
    )
    world = SearchWorld(scenario, decide=marker_rule(scenario.starts, stop=stop))
    world.run(until=3.0 * cells)
    last = max(world.declared.values(), default=inf)
    return world.covered_at / cells, last / cells, world.covered.bit_count() / cells


def _markers(_store: Store, _sweeps: list[Sweep], settings: Settings) -> Outcome:
    trials, rng = settings.of(60, 2), np.random.default_rng(settings.seed)
    measured = []
    for m in ROBOTS:
        for _ in range(trials):
            starts = rng.choice(SIDE * SIDE, m, replace=False)
            arcs = np.diff(np.sort(starts), append=np.sort(starts)[0] + SIDE * SIDE)
            stopped = without_messages(starts, stop=True)
            ignoring = without_messages(starts, stop=False)
            lost = without_messages(starts, stop=True, dead=1)
            saved = without_messages(starts, stop=False, dead=1)
            longest = float(arcs.max()) / (SIDE * SIDE)
            measured.append(
                (m, *stopped[:2], ignoring[1], lost[2], saved[2], abs(stopped[1] - longest))
            )
    table = np.array(measured)
    means = np.array([table[table[:, 0] == m].mean(axis=0) for m in ROBOTS])
    claims = (
        claim(
            "time until all robots have stopped at markers, less the longest arc, most",
            "0: no message is needed",
            float(table[:, 6].max()),
            within=(0, 1e-9),
            why="with messages robots that stay need the longest arc, too",
        ),
        claim(
            "without markers and messages: time of the last robot by T_UB",
            "1: the entire space",
            float(table[:, 3].mean()),
            within=(1 - 1e-9, 1.05),
            why="robots that meet wait for each other",
        ),
        claim(
            "share of cells searched by markers if one robot is dead, least",
            "1: guaranteed",
            float(table[:, 4].min()),
            within=(1, 1),
            why="the paper guarantees completion while one robot lives; a dead robot's marker stands",
        ),
    )
    x = means[:, 0]
    theory = np.array([stay_share(int(m)) for m in ROBOTS])
    curves = [
        Curve(name, x, 100 * values, 100 * values, 100 * values)
        for name, values in (
            ("stop at markers: last robot", means[:, 2]),
            ("theory: H$_m$/m", theory),
            ("ignore markers: last robot", means[:, 3]),
            ("searched, markers, one robot dead", means[:, 4]),
        )
    ]
    rows = [
        [int(row[0]), *np.round(row[1:6], 4).tolist(), round(float(h), 4)]
        for row, h in zip(means, theory, strict=True)
    ]
    labels = Labels(
        "Markers in place of messages",
        "robots m",
        "% of one robot's time, or of the cells",
        note=f"{SIDE} by {SIDE} cells, Moore's tour; the paper has no figure of it",
    )
    sentence = (
        "Markers spare the messages at the start, as footnote 7 says, but not those of a dead"
        f" neighbour: with one robot dead, {100 * (1 - float(means[0, 4])):.0f} % of the cells are"
        f" missed by {ROBOTS[0]} robots and {100 * (1 - float(means[-1, 4])):.0f} % by"
        f" {ROBOTS[-1]}. Robots that ignore the markers search all in each trial."
    )
    assert table[:, 5].min() == 1
    columns = [
        "robots",
        "all searched",
        "last stops at a marker",
        "last without markers",
        "searched, one dead",
        "the same without markers",
        "H_m/m",
    ]
    return Outcome(
        mean_curves(curves, labels, log_x=True, log_y=False),
        claims,
        sentence,
        (Table("without messages", columns, rows),),
    )


def _region(_store: Store, _sweeps: list[Sweep], settings: Settings) -> Outcome:
    """Choose regions for random clusters, and count what a tour of their cells costs."""
    rng, side = np.random.default_rng(settings.seed), 10.0
    used: list[float] = []
    larger: list[float] = []
    rows: list[list[Any]] = []
    drawn = None
    while len(rows) < settings.of(300, 40):
        m = int(rng.integers(1, 9))
        starts = rng.uniform(0, 200, (m, 2))
        ranges = rng.uniform(1000, 6000, m)
        losses = int(rng.integers(m))
        try:
            low, high = affordable_rectangle(starts, ranges, footprint=side, losses=losses)
        except InvalidInputError:
            continue  # the smallest rectangle is too large: said in one sentence
        spare = [_spare(low, high, side, np.sort(ranges)[: m - losses], extra) for extra in (0, 1)]
        used.append(spare[0])
        larger.append(spare[1])
        rows.append([m, losses, *np.round([*low, *high], 1).tolist(), round(spare[0], 1)])
        drawn = (starts, low, high) if drawn is None or m > len(drawn[0]) else drawn
    claims = (
        claim(
            f"metres left over in {len(rows)} regions, least",
            "within the energy",
            min(used),
            within=(0, inf),
            why="of the tour that Shoal makes, with the ways out and home",
        ),
        claim(
            "metres left over with half a cell more on each side, most",
            "largest region",
            max(larger),
            within=(-inf, side),
            why="no larger margin is affordable, up to the step of a tour with odd sides",
        ),
    )
    assert drawn is not None
    starts, low, high = drawn
    figure = padded_figure(5.2, 4.6)
    axes = figure.add_subplot()
    corners = np.array([low, (high[0], low[1]), high, (low[0], high[1]), low])
    extreme = np.array([starts.min(axis=0), starts.max(axis=0)])
    inner = np.array(
        [
            extreme[0],
            (extreme[1, 0], extreme[0, 1]),
            extreme[1],
            (extreme[0, 0], extreme[1, 1]),
            extreme[0],
        ]
    )
    axes.plot(*corners.T, color=BLUE, lw=1.8, label="affordable region")
    axes.plot(*inner.T, "--", color=MUTED, lw=1.2, label="extreme robots")
    axes.plot(*starts.T, "s", color=ORANGE, ms=7, label="robots")
    axes.legend(frameon=False, fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.06), ncols=3)
    bare_axes(axes)
    set_title(axes, "an affordable region, in metres")
    columns = ["robots", "losses", "left", "bottom", "right", "top", "metres left over"]
    sentence = "Clusters whose energy is too small for the rectangle around them are drawn anew."
    return Outcome(
        figure,
        claims,
        sentence,
        (Table("regions", columns, rows),),
        "the paper asks for a region from energy stores and extreme robots, and gives no rule",
    )


def _spare(
    low: tuple[float, float], high: tuple[float, float], side: float, ranges: object, extra: int
) -> float:
    """Return how many metres robots with given ranges have left over after a real tour of the cells
    of a rectangle, ``extra`` half cells larger on each side.
    """
    size = np.subtract(high, low) + extra * side
    columns, rows = (max(1, int(np.ceil(length / side - 1e-9))) for length in size)
    tour = make_tour("hilbert-rectangle", (rows, columns)).metrics().length * side
    able = np.maximum(np.asarray(ranges) - 2 * float(np.hypot(*size)), 0)
    return float(able.sum() - tour)


RECIPES = (
    Recipe(
        "h-markers",
        "paper H, footnote 7",
        "Markers in place of messages",
        lambda _: [],
        _markers,
    ),
    Recipe(
        "h-region",
        "paper H, section Further Research",
        "A region from energy and the extreme robots",
        lambda _: [],
        _region,
    ),
)
