"""Steering on a physical plant: python -m benchmarks.steering_rigs FILE [--instances N] [--table]

Random problems in five workspaces. The plant has a relative error of 1 % and an angle of 1 degree
(standard deviations) in each input, 2 % in the gain of each particle, and a camera with an error of
.05 % of the size. Each result is a line of FILE at once, and a second call goes on from there.

closed: `shoal.steering.driving.steer_rig` is told 90 %, half, or twice of the plant's friction, or
nothing, and makes at most 300 inputs. `arrived` is judged by the plant's true positions: within 2 %
of the size; `wrong` said so although they are farther; `named` did not, but named the friction:
that the walls hold less, or more, than was stated. Told 90 %, either is a false alarm, which
--table counts among all drives.
open: the plan of the planner conformant, told 90 % of the friction; `arrived` ends within 5 %.

What was not solved is judged (benchmarks.steering_reach): `proved` unreachable with the plant's
friction (in open loop: the friction told), `exhausted` by the search, or reachable, with the number
of presses in a row, and `narrow` if not with a friction cone smaller by the 1 degree of the errors,
and `more` if not with the 90 % of the friction that a drive was told.
--table prints a row of FILE for each statement and friction, and for all frictions, with the interval of Wilson (95 %) of
the share of reachable problems that arrived, and all problems that were not solved.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.steering_reach import reach_of
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
FRICTIONS = (0.5, 1.0, 1.5, 2.0, STICKING)
STATED = {"told": 0.9, "understated": 0.5, "overstated": 2.0, "not-told": None, "open": 0.9}
ERRORS = {"own_gain": 0.02, "pulse_error": 0.01, "direction": 1.0, "camera_error": 0.4}
WITHIN = {"closed": 0.02, "open": 0.05}  # relative to the size
MOVES = 300


def problem_of(name: str, seed: int) -> SteeringProblem:
    """Return a random problem."""
    base = SteeringProblem(PLACES[name])
    start, goal = base.endpoints(seed)
    return SteeringProblem(base.place, start, goal)


def plant_of(problem: SteeringProblem, friction: float, seed: int) -> SteeringPlant:
    """Return the plant of a problem."""
    about = PlantProperties.of("exact", friction=friction, **ERRORS)
    return SteeringPlant(problem.place, problem.start, about, np.random.default_rng([seed, 1]))


def is_proved(problem: SteeringProblem, friction: float, within: float) -> bool:
    """Return whether no plan provably leads within a distance of the goals, relative to the size; in
    workspaces that are not convex, no proof is known.
    """
    start, goal = problem.endpoints(0)
    if problem.place.kind == "region":
        return False
    world = problem.replaced(friction=friction).world()
    task = SteeringTask(world, start, goal, within * problem.place.size)
    return why_unreachable(task) is not None


def solve(name: str, friction: float, stated: str, seed: int) -> dict[str, Any]:
    """Return what became of one problem."""
    problem, told = problem_of(name, seed), STATED[stated]
    size, within = float(problem.place.size), WITHIN["open" if stated == "open" else "closed"]
    least = friction * 0.9 if stated == "open" else friction
    line = {"place": name, "friction": friction, "stated": stated, "seed": seed}
    if is_proved(problem, least, within):
        return {**line, "ended": "proved"}
    plant, begun = plant_of(problem, friction, seed), time.process_time()
    own = {} if told is None else {"friction_at_least": told * friction}
    if stated == "open":
        plan = run(problem.replaced(**own, angle_error=1.0, gain_error=0.01), seed=seed)
        goal, moves = plan.goal, len(plan.inputs)
        for move in plan.inputs:
            plant.send(move)
        ended = str(plan.status) if plan.status == "unreachable" or not moves else "farther"
    else:
        drive = steer_rig(problem.replaced(**own, max_moves=MOVES), plant, seed=seed)
        goal, moves, ended = drive.goal, drive.moves, str(drive.status)
        named = [name for name in ("slips", "holds") if drive.estimates[name]]
        ended = "wrong" if drive else "named" if named else ended
        line["says"] = named
    line |= {"moves": moves, "seconds": round(time.process_time() - begun, 2)}
    away = float(np.linalg.norm(plant.points - goal, axis=1).max()) / size
    if away <= within and (stated == "open" or drive):
        return {**line, "ended": "arrived"}
    if ended == "wrong":
        return {**line, "ended": "wrong", "away": round(away, 4), "presses": -1}
    reach, cone = reach_of(problem, least, within), np.arctan(least) - np.radians(1)
    line |= {"away": round(away, 3), "presses": reach.presses, "least": round(reach.least, 4)}
    if reach.presses >= 0:
        line["narrow"] = reach_of(problem, float(np.tan(cone)), within).presses < 0
    if stated == "told":
        line["more"] = reach_of(problem, told * friction, within).presses < 0
    return {**line, "ended": ended if reach.presses >= 0 else "exhausted", "status": ended}


def print_table(path: Path) -> None:
    """Print a row for each statement and friction, and what was not solved."""
    lines = [json.loads(text) for text in path.read_text().splitlines()]
    rows: dict[tuple[str, float], list[dict[str, Any]]] = {}
    for line in lines:
        for friction in (line["friction"], 0.0):  # 0 stands for all
            rows.setdefault((line["stated"], friction), []).append(line)
    print(
        "| stated | friction | problems | proved | exhausted | reachable | arrived | named | neither"
        " | wrong | says | moves | CPU s |\n" + "|---" * 13 + "|"
    )
    for stated, friction in sorted(rows, key=lambda key: (list(STATED).index(key[0]), -key[1])):
        own = rows[stated, friction]
        counts = Counter(line["ended"] for line in own)
        good, named, wrong = counts["arrived"], counts["named"], counts["wrong"]
        reachable = len(own) - counts["proved"] - counts["exhausted"]
        said = sum(bool(line.get("says")) for line in own)
        share = binomtest(good, max(1, reachable)).proportion_ci(method="wilson")
        moves = [line["moves"] for line in own if line["ended"] == "arrived"]
        used = [line["seconds"] for line in own if "seconds" in line]
        cells = (
            *(
                stated,
                f"{friction:g}" if friction else "all",
                len(own),
                counts["proved"],
                counts["exhausted"],
                reachable,
            ),
            f"{good} ({100 * share.low:.0f} to {100 * share.high:.0f} %)",
            *(named, reachable - good - named - wrong, wrong, said),
            *(f"{np.mean(moves or [0]):.0f}", f"{np.mean(used or [0]):.1f}"),
        )
        print("| " + " | ".join(map(str, cells)) + " |")
    for line in lines:
        if line["ended"] not in ("arrived", "proved", "exhausted"):
            print(
                f"{line['stated']}, friction {line['friction']:g}, {line['place']} {line['seed']}:"
                f" {line['ended']}, {line['presses']} presses"
                + (", unreachable with a cone smaller by 1 degree" if line.get("narrow") else "")
                + (", unreachable with the friction told" if line.get("more") else "")
            )


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--instances", default="10", help="N, or FIRST-LAST")
    parser.add_argument("--places", default=",".join(PLACES))
    parser.add_argument("--stated", default=",".join(STATED))
    parser.add_argument("--frictions", default=",".join(f"{one:g}" for one in FRICTIONS))
    given = parser.parse_args()
    if given.table:
        return print_table(given.file)
    first, _, last = given.instances.rpartition("-")
    names, stated = given.places.split(","), given.stated.split(",")
    done = set()
    if given.file.exists():
        for text in given.file.read_text().splitlines():
            line = json.loads(text)
            done.add((line["place"], line["friction"], line["stated"], line["seed"]))
    with given.file.open("a", encoding="utf-8") as file:
        for seed in range(int(first or 0), int(last)):
            for what in stated:
                for friction in map(float, given.frictions.split(",")):
                    for name in names:
                        if (name, friction, what, seed) not in done:
                            file.write(json.dumps(solve(name, friction, what, seed)) + "\n")
                            file.flush()
    return None


if __name__ == "__main__":
    main()
