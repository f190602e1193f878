"""python -m benchmarks.learned_prior train | report: the planners' learned prior, and how well it
foretells beside the counts.

Data: frontier cells at states that episodes visit, on generated maps of all kinds, with any share
of particles; most of the states are looked at after some layers were revealed, as predictions go on
behind the frontier. In goes what is known around a cell, turned so that the way in is below; out
comes whether the cell is free. NumPy alone, one core, some ten minutes. No map is one that is
benchmarked: seeds begin at FIRST_SEED, H-trees have other sizes.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.ndimage import binary_dilation, uniform_filter
from tests.swarm_runs import run

from shoal import open_map
from shoal.swarm import GridWorkspace, make_policy
from shoal.swarm.grid.scans import Trace
from shoal.swarm.grid.tasks import make_task
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.kernels.planning.learned_prior import (
    KINDS,
    MOST_ODDS,
    ODDS,
    RADIUS,
    SHIFT,
    SPAN,
    learn_bias,
    learned_chance,
)
from shoal.swarm.kernels.planning.prediction import LEARNED, around, learn, steps_of, weigh
from shoal.swarm.maps.generators import vessels
from shoal.swarm.policies import BeamRollout
from shoal.swarm.policies.planners.learned_weights import CHANCES, TURNS, WEIGHTS
from shoal.swarm.policies.planners.state import new_prior
from shoal.swarm.simulation.compiled import PlannerGame

FIRST_SEED, UNSEEN_SEED = 100_000, 910_000
MAPS, STOPS, CELLS = 1120, 14, 220  # maps; states of each, at most; cells of each state, at most
HIDDEN, SECOND, EPOCHS, BATCH, RATE = 64, 32, 25, 1024, 2e-3
SIZES = {"first": (KINDS * SPAN * SPAN, HIDDEN), "second": (HIDDEN, SECOND), "last": (SECOND, 1)}
# variances of the weights at first: 80 cells are known or so
SPREADS = {"first": 1 / 80, "second": 2 / HIDDEN, "last": 1 / SECOND}
UNKNOWN, FREE, WALL = 0, 1, 2
SIDES = ((0, 1), (1, 0), (0, -1), (-1, 0))  # where the way in is, for l, u, r, d
HTREES = (300, 700, 1200, 2000, 3100, 4000, 7000, 9000)
# of odd vessels
WIDTHS = {"AREA_PER_CELL": (1.2, 2.4), "TIP_WIDTH": (1.0, 1.9), "TRUNK_WIDTH": (2.2, 6.5)}


def draw_odd_vessels(rng, seed, share=1.0):
    """Return vessels of another density and other widths than the generator's own."""
    kept = {name: getattr(vessels, name) for name in WIDTHS}
    try:
        for name, (low, high) in WIDTHS.items():
            setattr(vessels, name, rng.uniform(low, high))
        return vessels.draw_vessels(
            max(600, int(share * np.exp(rng.uniform(np.log(600), np.log(9000))))), seed=seed
        )
    finally:
        for name, value in kept.items():
            setattr(vessels, name, value)


def draw_wide_vessels(rng, seed):
    """Return odd vessels, twice as large and smoothed."""
    free = np.kron(draw_odd_vessels(rng, seed, 1 / 3), np.ones((2, 2))) > 0
    for _ in range(2):
        free = uniform_filter(free.astype(float), 3, mode="constant") > 0.5
    return free


def draw_rooms(rng, seed):
    """Return a rectangle that walls with doors of two cells divide again and again."""
    free = np.ones(rng.integers(20, 90, 2), dtype=bool)
    parts = [(0, free.shape[0], 0, free.shape[1])]
    while parts:
        top, bottom, left, right = parts.pop()
        height, width = bottom - top, right - left
        if max(height, width) < 9 or rng.random() < 0.1:
            continue
        if height >= width:
            at, door = int(rng.integers(top + 4, bottom - 4)), int(rng.integers(left, right - 1))
            free[at, left:right] = False
            free[at, door : door + 2] = True
            parts += [(top, at, left, right), (at + 1, bottom, left, right)]
        else:
            at, door = int(rng.integers(left + 4, right - 4)), int(rng.integers(top, bottom - 1))
            free[top:bottom, at] = False
            free[door : door + 2, at] = True
            parts += [(top, bottom, left, at), (top, bottom, at + 1, right)]
    return free


def named(name):
    """Return what draws the map of a name in which numbers are drawn."""
    return lambda rng, seed: open_map(name(rng, seed)).free


VESSELS = named(
    lambda rng, seed: f"vessels:{rng.choice([1000, 2500, 5000, 5000, 5000, 8000])}:{seed}"
)
KINDS_OF_MAPS = {  # what draws them, and how often
    "vessels": (VESSELS, 10),
    "odd vessels": (draw_odd_vessels, 6),
    "wide vessels": (draw_wide_vessels, 2),
    "caves": (
        named(lambda rng, seed: f"cave:{rng.integers(30, 130)}x{rng.integers(30, 100)}:{seed}"),
        2,
    ),
    "mazes": (
        named(
            lambda rng, seed: (
                f"maze:{2 * rng.integers(7, 60) + 1}x{2 * rng.integers(7, 40) + 1}:{seed}"
            )
        ),
        2,
    ),
    "H-trees": (named(lambda rng, seed: f"htree:{rng.choice(HTREES)}"), 2),
    "rooms": (draw_rooms, 2),
    "rectangles": (lambda rng, seed: np.ones(rng.integers(8, 90, 2), dtype=bool), 1),
    "lines": (lambda rng, seed: np.ones((1, rng.integers(100, 4000)), dtype=bool), 1),
}


class Counting(BeamRollout):
    """The planner without what is trained here."""

    tuning = BeamRollout.tuning._replace(learned=0)


def game_on(free, rng):
    """Return (an episode that has not begun, its cells that are free), with any share
    of particles.
    """
    free = np.rot90(free[:, ::-1] if rng.random() < 0.5 else free, rng.integers(4))
    workspace = GridWorkspace(np.ascontiguousarray(free)).largest_component()
    n = max(2, int(np.exp(rng.uniform(np.log(0.01), np.log(0.85))) * workspace.n_free))
    world = GridWorld(workspace)
    state = world.initial(workspace.cells[rng.choice(workspace.n_free, size=n, replace=False)])
    belief = make_task("mapping").begin(world, state, None)
    policy = Counting(budget=30)
    game = PlannerGame(policy, world.free, state, belief, rule="block", mapping=True, rng=rng)
    return game, world.layout, world.layout.unpack(world.free.words)


def revealed(known, truth, rng):
    """Return what would be known some layers behind the frontier, or within one; a quarter is left
    as it is.
    """
    kind = rng.integers(4)
    for _ in range(0 if kind == 0 else rng.integers(9)):
        known = known | binary_dilation(known & truth)
    if kind >= 2:
        known = known | (binary_dilation(known & truth) & (rng.random(known.shape) < rng.random()))
    return known


def windows(known, truth, rng):
    """Return the windows of some frontier cells, turned, shape (cells, SPAN * SPAN), and whether
    each cell is free.
    """
    rim = np.pad(np.zeros([size - 2 for size in known.shape], dtype=bool), 1, constant_values=True)
    known, opened = known | rim, known & truth
    cells = rng.permutation(np.argwhere(binary_dilation(opened) & ~known))[:CELLS]
    states = np.pad(
        np.where(known, np.where(truth, FREE, WALL), UNKNOWN).astype(np.int8),
        RADIUS,
        constant_values=WALL,
    )
    seen = []
    for row, column in cells:
        sides = [
            side for side, (down, right) in enumerate(SIDES) if opened[row + down, column + right]
        ]
        window = states[row : row + SPAN, column : column + SPAN]
        seen.append(np.rot90(window, TURNS[sides[rng.integers(len(sides))]]).ravel())
    return np.array(seen, dtype=np.int8).reshape(len(seen), SPAN * SPAN), truth[tuple(cells.T)]


def gather(first, maps):
    """Return (windows, whether the cell is free, kind of map) of all cells looked at on so many
    maps.
    """
    kinds = [kind for kind, (_, often) in KINDS_OF_MAPS.items() for _ in range(often)]
    parts = []
    for number in range(maps):
        kind, rng = kinds[number % len(kinds)], np.random.default_rng([77, first + number])
        game, layout, truth = game_on(KINDS_OF_MAPS[kind][0](rng, first + number), rng)
        gap, ended = int(rng.integers(1, 4)), False
        for _ in range(STOPS):
            known = layout.unpack(game.field.known.reshape(layout.words))
            seen, free = windows(revealed(known, truth, rng), truth, rng)
            parts.append((seen, free, np.full(len(free), list(KINDS_OF_MAPS).index(kind))))
            if ended:
                break
            ended = game.play_on(Trace.empty(gap), gap)[1] != 0
            gap = max(gap + 1, int(1.6 * gap))
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


def layers_of(weights, seen):
    """Return what goes into the network, and what comes out of each layer; the last are log-odds,
    in nats.
    """
    out = [np.concatenate([seen == FREE, seen == WALL], axis=1).astype(np.float32)]
    for name in SIZES:
        out.append(out[-1] @ weights[name] + weights[f"{name}_bias"])
        if name != "last":
            np.maximum(out[-1], 0, out=out[-1])
    return out


def gradients(weights, seen, free):
    """Return the slope of the log loss of a batch along each weight."""
    layers, slopes = layers_of(weights, seen), {}
    back = (1 / (1 + np.exp(-layers[-1])) - free[:, None]) / len(free)
    for at, name in reversed(list(enumerate(SIZES))):
        slopes[name], slopes[f"{name}_bias"] = layers[at].T @ back, back.sum(axis=0)
        back = (back @ weights[name].T) * (layers[at] > 0)
    return slopes


def fit(seen, free):
    """Return weights, by Adam with a rate that falls along a cosine; every other batch is seen in a
    mirror.
    """
    rng, step, began = np.random.default_rng(0), 0, time.time()
    weights = {
        name: rng.normal(scale=SPREADS[name] ** 0.5, size=size).astype(np.float32)
        for name, size in SIZES.items()
    }
    weights |= {f"{name}_bias": np.zeros(size[1], dtype=np.float32) for name, size in SIZES.items()}
    mean, square = (
        {name: np.zeros_like(value) for name, value in weights.items()} for _ in range(2)
    )
    mirror = np.arange(SPAN * SPAN).reshape(SPAN, SPAN)[:, ::-1].ravel()
    steps = EPOCHS * (len(seen) // BATCH)
    for epoch in range(EPOCHS):
        order = rng.permutation(len(seen))
        for begin in range(0, len(order) - BATCH + 1, BATCH):
            batch, step = order[begin : begin + BATCH], step + 1
            slopes = gradients(
                weights, seen[batch][:, mirror] if step % 2 else seen[batch], free[batch]
            )
            rate = RATE * min(1, step / 200) * (1 + np.cos(np.pi * step / steps)) / 2
            for name, slope in slopes.items():
                mean[name] += 0.1 * (slope - mean[name])
                square[name] += 0.001 * (slope**2 - square[name])
                downhill = (
                    mean[name]
                    / (1 - 0.9**step)
                    / (np.sqrt(square[name] / (1 - 0.999**step)) + 1e-8)
                )
                weights[name] = np.clip(weights[name] - rate * downhill, -8, 8).astype(np.float32)
        print(f"epoch {epoch}: {time.time() - began:.0f} s", flush=True)
    return weights


def store(weights):
    """Write the weights in whole numbers, as kernels want them."""
    one = 2.0**SHIFT
    odds = (np.arange(2 * ODDS * MOST_ODDS) + 0.5) / ODDS - MOST_ODDS
    np.savez_compressed(
        WEIGHTS,
        first=np.rint(one * weights["first"]).astype(np.int16),
        first_bias=np.rint(one * weights["first_bias"]).astype(np.int32),
        second=np.rint(one * weights["second"].T).astype(np.int16),
        second_bias=np.rint(one**2 * weights["second_bias"]).astype(np.int32),
        last=np.rint(one * weights["last"][:, 0]).astype(np.int32),
        last_bias=np.rint(one**2 * weights["last_bias"]).astype(np.int32),
        chances=np.rint(CHANCES / (1 + np.exp(-odds))).astype(np.int32),
    )


def foretold(name, n, trial):
    """Return, of each cell that an episode classifies, what each expert and the mixture had told,
    and whether it was free.
    """
    workspace = open_map(name)
    world = GridWorld(workspace)
    state = world.initial(run(workspace, particles=n, trial=trial).start)
    belief = make_task("mapping").begin(world, state, None)
    game = PlannerGame(
        make_policy("best"),
        world.free,
        state,
        belief,
        rule="block",
        mapping=True,
        rng=np.random.default_rng(trial),
    )
    prior, field, learned, rows = game.planner.prior, game.field, game.planner.learned, []
    fresh = new_prior(world.layout, learned=True)
    ended = False
    while not ended:
        before, bias, trace = field.known.copy(), learned.bias[0], Trace.empty(1)
        ended = game.play_on(trace, 1)[1] != 0
        step, side = steps_of(prior.rows, prior.width, trace.commands[0])
        learned.bias[0] = bias  # each cell is foretold before its outcome is learned
        for word in np.flatnonzero(field.known & ~before):
            new = int(field.known[word] & ~before[word])
            for bit in (bit for bit in range(64) if new >> bit & 1):
                cell, free = np.int64(64 * word + bit), bool(int(field.open[word]) >> bit & 1)
                weights = fresh.weights.copy()
                fresh.forecasts[LEARNED] = learned_chance(
                    learned, field.open, before, cell, np.int64(trace.commands[0])
                )
                learn_bias(learned, fresh.forecasts[LEARNED], free)
                learn(fresh, around(field.open, before, cell, step, side), free)
                rows.append((*fresh.forecasts, weights @ fresh.forecasts, free))
                weigh(fresh, free)
    return rows


def report(given):
    """Print log loss, area under the curve and expected calibration error of each expert and of the
    mixture.
    """
    names = ["counts", "learned", "mixture"]
    print(
        "| map | expert | log loss, nats | area under the curve | calibration error"
        " |\n|---|---|---|---|---|"
    )
    for name in given.maps.split(","):
        rows = np.array(
            [
                row
                for n in given.counts
                for trial in range(given.trials)
                for row in foretold(name, n, trial)
            ]
        )
        free = rows[:, -1]
        for expert, told in zip(names, rows.T, strict=False):
            loss = -np.mean(np.log(np.where(free > 0, told, 1 - told)))
            ranks, ones = np.argsort(np.argsort(told)), free.sum()
            area = (ranks[free > 0].sum() - ones * (ones - 1) / 2) / (ones * (len(free) - ones))
            tenths = np.minimum((10 * told).astype(int), 9)
            error = sum(abs(np.sum((free - told)[tenths == tenth])) for tenth in range(10)) / len(
                free
            )
            print(f"| `{name}` | {expert} | {loss:.3f} | {area:.3f} | {error:.3f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("train", "report"))
    parser.add_argument(
        "--maps",
        default=",".join(f"vessels:5000:{UNSEEN_SEED + number}" for number in range(3)),
        help="of the report",
    )
    parser.add_argument("--counts", type=int, nargs="+", default=[100, 500, 2500])
    parser.add_argument("--trials", type=int, default=2)
    given = parser.parse_args()
    if given.what == "report":
        report(given)
        return
    seen, free, _ = gather(FIRST_SEED, MAPS)
    print(f"{len(seen)} cells", flush=True)
    store(fit(seen, free))


if __name__ == "__main__":
    main()
