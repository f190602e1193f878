"""The kernels give the same episodes with the compiler off, where a shift or an overflow might
behave otherwise.
"""

from __future__ import annotations

import json

import pytest
from tests import without_compiler

SCRIPT = """
import numpy as np
from shoal.swarm import GridWorkspace
from tests.swarm_runs import run
np.seterr(over="ignore")  # words wrap around on purpose
rng = np.random.default_rng(21)
for width in (1, 5, 62, 63, 64, 65, 126, 128):
    for shape in ((3, width), (2, 2, min(width, 65))):
        free = rng.random(shape) < 0.75
        free.flat[0] = True
        cells = np.argwhere(free)
        start = cells[rng.choice(len(cells), size=max(1, len(cells) // 4), replace=False)]
        for rule in ("block", "merge", "tilt"):
            for policy in ("closest-frontier", "elect-particle", "depth-first", "random-moves"):
                if rule == "tilt" and policy in ("elect-particle", "depth-first"):
                    continue
                for task in ("mapping", "subset-coverage:fraction=1"):
                    if task != "mapping" and len(start) < len(cells) and GridWorkspace(free).components.max() > 1:
                        continue
                    e = run(GridWorkspace(free), task=task, policy=policy, start=start, rule=rule, max_moves=15)
                    if policy == "closest-frontier" and rule != "tilt":
                        for every in ("3", "doubling", "hyper", "adaptive"):
                            scans = run(GridWorkspace(free), task=task, start=start, rule=rule, max_moves=12, scan_every=every)
                            print(every, scans.commands, scans.status, scans.trace.scanned.tolist())
                    print(width, rule, policy, task, e.commands, e.status, e.trace.classified.tolist(), e.trace.travelled.tolist())
"""

PLANNERS = """
import numpy as np
from shoal.swarm import GridWorkspace
from tests.swarm_runs import run
from shoal.swarm.policies.planners.offline import plan_coverage
from shoal.swarm.policies import BeamRollout
np.seterr(over="ignore")  # words wrap around on purpose
rng = np.random.default_rng(22)
class Quick(BeamRollout):
    tuning = BeamRollout.tuning._replace(
        beam_width=2, beam_depth=2, beam_leaves=1,
        horizon=6, prediction_layers=2, force_after=4,
    )
class First(BeamRollout):
    tuning = Quick.tuning._replace(end_frontier=3)
for shape in ((3, 5), (1, 9), (2, 63), (3, 64), (2, 65), (2, 126), (2, 2, 4)):
    free = rng.random(shape) < 0.8
    free.flat[0] = True
    space = GridWorkspace(free).largest_component()
    start = space.cells[rng.choice(space.n_free, size=max(1, space.n_free // 4), replace=False)]
    for rule in ("block", "merge"):
        # In a single move of the wide ones the two plan the same.
        for policy in (Quick(), First(), "greedy-classify") if space.n_free < 50 else (Quick(), "greedy-classify"):
            for task in ("mapping", "coverage"):
                e = run(space, task=task, policy=policy, start=start, rule=rule, max_moves=2 if space.n_free < 50 else 1)
                print(shape, rule, task, e.commands, e.status, e.trace.classified.tolist())
        if space.n_free < 20:
            print(shape, rule, plan_coverage(space, start, rule=rule, budget=4))
"""


STEERING = """
import numpy as np
from shoal.steering import SteeringProblem, SteeringTask, cylinder, disk, polygon_reach, prism, regular_polygon
from shoal.steering.run import run
from shoal.steering.planners import fewest_moves
from shoal.steering.planners import improvement
from shoal.steering.contact import friction as friction_limits
from shoal.steering.planners import chain_search
friction_limits._ANGLES = 30
improvement.TRIES, improvement.CYCLES = 2, (1, 2)
chain_search.MAPS = ((8, 14, 1.05, 8),)
fewest_moves.DIRECTIONS = {2: 8, 3: 8}
fewest_moves.DENSE = 1
fewest_moves.REPAIRS = {4: (2, 3), 5: (1, 2), 6: (1, 2)}
pair = [(-0.1, 0.0), (0.1, 0.1)], [(0.3, 0.1), (-0.2, -0.3)]
high = [(-0.1, 0.0, 0.2), (0.1, 0.1, 0.5)], [(0.3, 0.1, 0.4), (-0.2, -0.3, 0.1)]
for space in (regular_polygon(3, radius=0.8), disk(0.5), prism(regular_polygon(4), 0.7), cylinder(0.5, 0.7)):
    where = pair if space.dimensions == 2 else high
    # The planner of fewest moves starts from the shortest plan.
    for planner in ("greedy", "fewest-moves")[: 2 if space.kind == "polygon" else 1]:
        e = run(SteeringProblem(space, *where, planner=planner))
        print(space.kind, planner, e.status, e.moves, np.round(e.inputs, 6).tolist())
for space, goal in ((regular_polygon(3, radius=0.8), pair[1]), (disk(0.5), pair[1]), (prism(regular_polygon(4), 0.7), high[1])):
    start = (pair if space.dimensions == 2 else high)[0]
    task = SteeringTask(SteeringProblem(space, start, goal).world(), np.array(start), np.array(goal), 1e-6)
    for count in (3, 4, 5):
        plan = fewest_moves.shooting_plan(task, count)
        print(space.kind, count, None if plan is None else np.round(plan, 5).tolist())
noise = dict(execution=1e-3, measurement=1e-3, gain=0.2)
e = run(SteeringProblem(regular_polygon(5), *pair, 0.01, planner="robust", max_moves=6, **noise))
print(e.status, np.round(e.inputs, 6).tolist())
near = pair[0], [(-0.15, -0.05), (0.05, 0.1)]
e = run(SteeringProblem(regular_polygon(5), *near, planner="greedy", friction=3.0, max_moves=20))
print(e.status, e.moves, np.round(e.final, 5).tolist())
for space in (regular_polygon(5), disk(0.5)):
    task = SteeringTask(SteeringProblem(space, *pair, friction=1.0).world(), np.array(pair[0]), np.array(pair[1]), 1e-6)
    chain = chain_search.roadmap_chain(task.chain_query(), maps=chain_search.MAPS)
    print(None if chain is None else (chain.touchers.tolist(), chain.walls.tolist(), np.round(chain.unknowns, 5).tolist()))
    print(friction_limits.friction_limit(space, 0.2, task.before, task.after))
print([round(r.fraction(), 3) for r in polygon_reach(regular_polygon(3), (0.2, 0.1), moves=4, contacts=5)])
"""


CLEARANCES = """
from math import inf
import numpy as np
from shoal.steering import ContactWorld, disk, region, regular_polygon
from shoal.steering.contact.world import RegionWorld
from shoal.steering.kernels import annealing, sampling
from shoal.steering.planners.sampling import world_of
from shoal.steering.planners.task import SteeringTask
rng = np.random.default_rng(9)
yard = region([(-1, -1), (1, -1), (1, 1), (-1, 1)], [[(-0.2, -0.2), (0.3, -0.2), (0.3, 0.3), (-0.2, 0.3)]])
for world in (RegionWorld(yard), ContactWorld(regular_polygon(3)), ContactWorld(disk(0.5)), ContactWorld(disk(0.5), friction=1.0)):
    for number in range(8):
        points = np.array([(-0.15, -0.1), (0.1, 0.12), (-0.1, 0.15), (0.02, -0.15)]) * (3 if number < 4 else 1)
        points = points if all(world.workspace.contains(p) for p in points) else points / 3
        moves = rng.normal(scale=0.3, size=(4, 2))
        task = SteeringTask(world, points[:2], points[2:], 1e-6, clearance=1e-3, margin=1e-3)
        wide = world_of(world, task)
        state, made = world.final(task.start, moves), np.zeros((8, 2))
        print(np.round(state, 9).tolist(), sampling.keeps_clear(task.start.copy(), moves, 4, wide))
        print(sampling.is_blocked(state, *moves[0], wide), sampling.passes_corner(*points[0], *state[0], wide))
        count = sampling.translate(state, *moves[0], wide, made, 0, True)
        print(count, np.round(state, 9).tolist(), np.round(made, 9).tolist())
        steps = annealing.Steps(np.array([0, 0, 1, 2]), np.array([0, 1, 1, 0]), *np.zeros((3, 4, 2)))
        steps.targets[:2] = points[:2] + moves[:2]
        print(round(annealing.play(steps, 4, annealing.PlanTask(task.start, task.goal, 0.3, 4), inf, wide, state), 9), np.round(state, 6).tolist())
"""

TOURS = """
import numpy as np
from shoal.search import hilbert_decode, hilbert_encode, make_tour, moore_decode, moore_encode
from shoal.search.tours import TOURS
rng = np.random.default_rng(5)
for order in (0, 1, 4, 5, 6, 10, 15, 16, 30, 31):
    indices = rng.integers(0, 4**order, 20)
    for encode, decode in ((hilbert_encode, hilbert_decode), (moore_encode, moore_decode)):
        cells = decode(indices, order=order)
        print(order, cells.tolist(), encode(cells, order=order).tolist() == indices.tolist())
for order in (0, 1, 2, 3, 4, 19, 20):
    cells = hilbert_decode(rng.integers(0, 8**order, 20), order=order, dimensions=3)
    print(order, cells.tolist(), hilbert_encode(cells, order=order).tolist())
for name in TOURS:
    # Rows are put in order by many random exchanges, which take long without the compiler.
    for shape in ((1, 9), (2, 9), (3, 6), (4, 5)) if name in ("boustrophedon", "strips", "headland") else ((1, 9), (5, 7), (16, 16), (17, 30)):
        for share in (1.0, 0.9, 0.5):
            mask = rng.random(shape) < share
            mask.flat[0] = True
            tour = make_tour(name, mask)
            print(name, shape, share, tour.cells.tolist(), tour.metrics())
for name in ("hilbert", "hilbert-rectangle"):
    tour = make_tour(name, (4, 5, 6))
    print(name, tour.cells.tolist(), tour.metrics())
"""


ALLOCATIONS = """
import numpy as np
from shoal.search import TourCost, allocate, make_tour
rng = np.random.default_rng(6)
for number in range(12):
    tour = TourCost(make_tour("comb", (4, 3 + number)), turn_cost=0.5 * (number % 2))
    m = 1 + number % 4
    starts = rng.integers(0, len(tour), size=m)
    rates = rng.uniform(0.5, 2, size=m) if number % 3 == 0 else None
    for allocator in ("stay", "common-shift", "individual-shift", "two-way", "hop"):
        found = allocate(tour, starts, allocator=allocator, rates=rates)
        print(number, allocator, found.arcs, found.times.round(6).tolist())
"""


NOISE = """
import numpy as np
from shoal.swarm import GridWorkspace
from tests.swarm_runs import run
from shoal.swarm.noise import Noise
np.seterr(over="ignore")
rng = np.random.default_rng(8)
for shape in ((3, 5), (6, 64), (2, 3, 4)):
    free = rng.random(shape) < 0.75
    free.flat[0] = True
    cells = np.argwhere(free)
    start = cells[rng.choice(len(cells), size=max(1, len(cells) // 4), replace=False)]
    for noise, every in ((Noise(0.1, 0.05, 0.1), 1), (Noise(0.0, 0.0, 0.05), 2), (Noise(0.0, 0.2, 0.0), 5)):
        e = run(GridWorkspace(free), start=start, noise=noise, scan_every=every, max_moves=30 if free.size < 50 else 10)
        print(shape, e.commands, e.status, e.trace.classified.tolist(), e.trace.frontier.tolist(), e.trace.travelled.tolist())
        print(e.trace.scanned.tolist(), e.probability.round(9).tolist(), e.errors)
"""


BATCHES = """
import numpy as np
np.seterr(over="ignore")  # words wrap around on purpose
from shoal.swarm import SwarmProblem, GridWorkspace
from shoal.swarm.batch import PLANES, WorldBatch
rng = np.random.default_rng(23)
for shape in ((3, 5), (2, 64), (2, 2, 5)):
    free = rng.random(shape) < 0.8
    free.flat[0] = True
    place = GridWorkspace(free).largest_component()
    for rule in ("block", "merge", "tilt"):
        for task in ("mapping", "coverage"):
            problem = SwarmProblem(place, particles=3, rule=rule, task=task, policy="closest-frontier", max_moves=20)
            batch = WorldBatch(problem, 3, threads=1)
            for commands in rng.integers(0, 2 * len(shape), (12, 3)):
                trace = batch.step(commands, repeat=2)
                told = (*trace, *batch.boards, batch.planes(PLANES), batch.action_masks(), *batch.measures())
                told = (*told, *batch.nearest_frontier(), batch.windows(PLANES, batch.nearest_frontier()[2], 3))
                print(shape, rule, task, *(column.tolist() for column in told))
                batch.reset(batch.terminated | batch.truncated)
"""


GATHERINGS = """
import numpy as np
from shoal.swarm import GridWorkspace
from shoal.swarm.theory.bounds import lower_bound, optimum
from tests.swarm_runs import run
np.seterr(over="ignore")  # words wrap around on purpose
rng = np.random.default_rng(24)
for shape in ((3, 4), (1, 8), (2, 65)):
    free = rng.random(shape) < 0.9
    free.flat[0] = True
    space = GridWorkspace(free).largest_component()
    start = space.cells[rng.choice(space.n_free, size=3, replace=False)]
    for rule in ("block", "merge", "tilt"):
        region = None if rule == "merge" else space.cells[: max(3, space.n_free // 2)].tolist()
        for policy in ("gather-beam:width=2", "random-moves", "pairwise") if rule == "merge" else ("gather-beam:width=2", "random-moves"):
            e = run(space, task="gathering", policy=policy, start=start, rule=rule, region=region, max_moves=40)
            print(shape, rule, policy, e.commands, e.status, *(column.tolist() for column in e.trace))
        if space.n_free < 20:
            mask = None if region is None else np.isin(np.arange(free.size), np.ravel_multi_index(tuple(np.array(region).T), shape)).reshape(shape)
            about = {"task": "gathering", "targets": mask, "rule": rule}
            print(lower_bound(space, start, **about), lower_bound(space, start, rule=rule))
            print(optimum(space, start, **about))
            if rule != "tilt":
                print(optimum(space, start, rule=rule))
"""


FLIGHTS = """
import numpy as np
import shapely
from shoal.search.flight.dubins import Airspace, NoRoomError, plan_dubins_path
rng = np.random.default_rng(25)
for number in range(8):
    ys = np.repeat(np.arange(4) * 20.0, 2)
    xs = np.tile([0.0, 300.0, 300.0, 0.0], 2)
    path = np.vstack([rng.uniform(-200, 0, 2), np.column_stack([xs, ys]), rng.uniform(-200, 0, 2)])
    blocked = shapely.box(*rng.uniform([-150, -150], [-60, 150]), -50, 200) if number % 2 else None
    for airspace in (None, Airspace(blocked=blocked)):
        try:
            pieces = plan_dubins_path(path, 40.0, link=25.0, airspace=airspace, cuts=[4] if number % 3 else [])
            print(number, [(np.round(piece, 6) + 0.0).tolist() for piece in pieces])
        except NoRoomError as error:
            print(number, error)
"""


SCRIPTS = {
    "flights": FLIGHTS,
    "gatherings": GATHERINGS,
    "episodes": SCRIPT,
    "planners": PLANNERS,
    "plans": STEERING,
    "clearances": CLEARANCES,
    "tours": TOURS,
    "allocations": ALLOCATIONS,
    "noise": NOISE,
    "batches": BATCHES,
}
LINES = {
    "flights": 8 * 2,
    "gatherings": 3 * 7 + 2 * 3 * 2 + 2 * 2,
    "planners": 4 * 2 * 3 * 2 + 3 * 2 * 2 * 2 + 6,  # and the plans of the small ones
    "plans": 12 + 9,
    "clearances": 4 * 8 * 4,
    "tours": 20 + 7 + 10 * 12 + 2,
    "allocations": 12 * 5,
    "noise": 18,
    "batches": 3 * 3 * 2 * 12,
}
ALL = """
import contextlib, io, json, sys, traceback
printed = {}
for name, script in json.load(sys.stdin).items():
    with contextlib.redirect_stdout(io.StringIO()) as out:
        try:
            exec(script, {"__name__": name})
        except Exception:
            out.write(traceback.format_exc())
    printed[name] = out.getvalue()
print(json.dumps(printed))
"""


@pytest.fixture(scope="module")
def printed():
    """What all scripts print, with the compiler and without it: one process each, as starting one
    takes longer than most.
    """
    given = json.dumps(SCRIPTS)
    return [
        json.loads(without_compiler.printed(ALL, compiled=compiled, given=given))
        for compiled in (True, False)
    ]


@pytest.mark.parametrize("script", SCRIPTS)
def test_the_same_with_the_compiler_off(printed, script):
    compiled, plain = (one[script] for one in printed)
    lines = len(compiled.splitlines())
    assert "Traceback" not in compiled
    assert lines > 60 if script == "episodes" else lines == LINES[script]
    assert plain == compiled
