"""Steering on a physical plant: python -m benchmarks.steering_rigs [--instances N] [--only closed]

Random problems in five workspaces. The plant has a relative error of 1 % and an angle of 1 degree
(standard deviations) in each input, 2 % in the gain of each particle, and a camera with an error of
.05 % of the size. A problem whose goals provably no plan reaches with the plant's friction counts
as unreachable (in convex workspaces; around obstacles no proof is known).

Closed loop (shoal.steering.driving.steer_rig), one row for each workspace, friction and what is stated:
problems, unreachable ones, arrived within 2 % of the size by the plant's true positions (plus the
error of the camera), friction named without arriving, ended otherwise, mean moves, CPU seconds.
Open loop (the planner conformant, told 90 % of the friction): how many plans end within 5 % of the
size on the plant; problems without a plan, or that are proved unreachable with the friction told,
are counted apart.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from typing import Any

import numpy as np

from shoal.rigs.physics import PlantProperties
from shoal.rigs.steering_plant import SteeringPlant
from shoal.steering import SteeringProblem, region
from shoal.steering.driving import steer_rig
from shoal.steering.planners.task import SteeringTask, why_unreachable
from shoal.steering.run import run

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
PLACES: dict[str, Any] = {
    "square": "square",
    "disk": "disk",
    "hexagon": "hexagon",
    "L": region([(0, 0), (1, 0), (1, 0.5), (0.5, 0.5), (0.5, 1), (0, 1)]),
    "obstacle": region(SQUARE, [[(0.4, 0.4), (0.6, 0.4), (0.6, 0.6), (0.4, 0.6)]]),
}
STICKING = 10.0  # friction of a plant on whose walls hardly anything slips
FRICTIONS = (0.5, 1.0, 2.0, STICKING)
STATED = {"told": 0.9, "understated": 0.5, "overstated": 2.0}
ERRORS = {"own_gain": 0.02, "pulse_error": 0.01, "direction": 1.0, "camera_error": 0.4}
CAMERA = 1e-3  # relative to the size: two standard deviations of the camera


def problem_of(name: str, seed: int, friction: float) -> tuple[SteeringProblem, bool]:
    """Return a random problem, and whether it is proved unreachable."""
    base = SteeringProblem(PLACES[name])
    start, goal = base.endpoints(seed)
    problem = SteeringProblem(base.place, start, goal)
    task = SteeringTask(
        problem.replaced(friction=friction).world(), start, goal, 0.02 * base.place.size
    )
    proved = base.place.kind != "region" and friction < STICKING and why_unreachable(task)
    return problem, bool(proved)


def plant_of(problem: SteeringProblem, friction: float, seed: int) -> SteeringPlant:
    """Return the plant of a problem."""
    about = PlantProperties.of("exact", friction=friction, **ERRORS)
    return SteeringPlant(problem.place, problem.start, about, np.random.default_rng([seed, 1]))


def closed(instances: int, names: list[str], stated: list[str], frictions: list[float]) -> None:
    """Print a row for each workspace, friction and statement."""
    for name in names:
        for friction in frictions:
            for what in stated:
                counts: Counter[str] = Counter()
                moves, begun = [], time.process_time()
                for seed in range(instances):
                    problem, proved = problem_of(name, seed, friction)
                    if proved:
                        counts["unreachable"] += 1
                        continue
                    asked = problem.replaced(friction_at_least=STATED[what] * friction)
                    plant = plant_of(problem, friction, seed)
                    result = steer_rig(asked, plant, seed=seed)
                    away = np.linalg.norm(plant.points - result.goal, axis=1).max()
                    size = float(problem.place.size)
                    if result and away <= (0.02 + CAMERA) * size:
                        counts["arrived"] += 1
                        moves.append(result.moves)
                    elif result:
                        counts["wrong"] += 1
                    elif result.estimates["slips"]:
                        counts["named"] += 1
                    else:
                        counts[str(result.status)] += 1
                used = (time.process_time() - begun) / max(1, instances - counts["unreachable"])
                mean = np.mean(moves) if moves else np.nan
                print(
                    f"closed {name} friction {friction:g} {what}: {instances} problems,"
                    f" {dict(counts)}, {mean:.1f} moves, {used:.2f} s",
                    flush=True,
                )


def open_loop(instances: int, names: list[str], frictions: list[float]) -> None:
    """Print a row for each workspace and friction."""
    for name in names:
        for friction in frictions:
            counts: Counter[str] = Counter()
            begun = time.process_time()
            for seed in range(instances):
                problem, proved = problem_of(name, seed, friction)
                if proved:
                    counts["unreachable"] += 1
                    continue
                asked = problem.replaced(
                    friction_at_least=0.9 * friction, angle_error=1.0, gain_error=0.01
                )
                plan = run(asked, seed=seed)
                if plan.status == "unreachable" or not plan.moves:
                    proved = plan.status == "unreachable"
                    counts["unreachable as told" if proved else "no plan"] += 1
                    continue
                plant = plant_of(problem, friction, seed)
                for move in plan.inputs:
                    plant.send(move)
                away = np.linalg.norm(plant.points - plan.goal, axis=1).max()
                counts["within 5 %" if away <= 0.05 * problem.place.size else "farther"] += 1
            used = (time.process_time() - begun) / instances
            print(
                f"open {name} friction {friction:g}: {instances} problems, {dict(counts)},"
                f" {used:.2f} s",
                flush=True,
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--instances", type=int, default=10)
    parser.add_argument("--only", choices=("closed", "open"))
    parser.add_argument("--places", default=",".join(PLACES))
    parser.add_argument("--stated", default=",".join(STATED))
    parser.add_argument("--frictions", default=",".join(f"{one:g}" for one in FRICTIONS))
    given = parser.parse_args()
    at = [float(one) for one in given.frictions.split(",")]
    if given.only != "open":
        closed(given.instances, given.places.split(","), given.stated.split(","), at)
    if given.only != "closed":
        open_loop(given.instances, given.places.split(","), at)
