"""Compile what most kinds of runs need, before several processes would do it at once: play each
kind of run once, each quick.

python -m benchmarks.first_calls [swarm steering search views lab jit] [--archives]

With ``--archives`` (``make kernels``), all kinds are played, and the archives of lowered kernels,
``src/shoal/*/kernels/lowered.zip``, get what they miss and lose what no first call needs.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os

import numpy as np

RING = "POLYGON_((0_0,_4_0,_4_4,_0_4,_0_0),_(1_1,_2_1,_2_2,_1_2,_1_1))"
SMALL = "map rectangle:9x9 --particles 3"
COMMANDS = {
    "jit": ["tour spanning-tree cave:20x15"],
    "views": [],
    "lab": [],
    "swarm": [
        *(
            f"{SMALL} --policy {policy}"
            for policy in ("best", "closest-frontier", "elect-particle", "depth-first", "sweep")
        ),
        f"{SMALL} --rule tilt --policy closest-frontier",
        f"{SMALL} --scan-every adaptive --scan-cost 2",
        f"{SMALL} --slip 0.1 --policy closest-frontier",
        "map rectangle:9x9 --particles 3 --placement flood-fill --policy closest-frontier",
        "cover rectangle:9x9 --particles 3",
        "cover rectangle:9x9 --particles 3 --policy offline",
        "gather rectangle:5x5 --particles 3",
        "gather rectangle:5x5 --particles 3 --rule merge --policy pairwise",
        *(
            f"drive rectangle:5x5 --particles 2 {how}"
            for how in ("", "--scan-every adaptive", "--slip 0.1")
        ),
        "drive rectangle:5x5 --particles 2 --rule tilt --policy closest-frontier",
        "line --cells 50 --particles 5 --monte-carlo 100",
    ],
    "steering": [
        *(
            f"steer {place} --start 0.1,0.2_0.3,0.4 --goal 0.4,0.3_0.2,0.1 --planner {planner}"
            for place, planner in (
                ("square", "shortest"),
                ("disk", "greedy"),
                ("square", "fewest-moves"),
                ("square", "sampling"),
            )
        ),
        (
            "steer square --start 0.1,0.2_0.3,0.4 --goal 0.4,0.3_0.2,0.1 --tolerance 0.1"
            " --execution 0.02 --measurement 0.01"
        ),
        (
            "steer square --start 0.1,0.2_0.3,0.4 --goal 0.4,0.3_0.2,0.1 --tolerance 0.02"
            " --execution 0.001 --measurement 0.001"
        ),
        f"steer {RING} --start 0.1,0.2_0.3,0.4 --goal 3,3_3,2",
        "steer square --start 0.2,0.3_0.5,0.35 --goal 0.6,0.2_0.7,0.4 --friction-at-least 1",
        "steer square --start 0.2,0.3_0.5,0.35 --goal 0.3,0.4_0.6,0.45 --friction-at-least 1",
        "steer regular:5 --start=-0.1,0_0.1,0.1 --goal=0.3,0.1_-0.2,-0.3 --friction 1",
        "steer square --start 0.1,0.3_0.2,0.35 --goal 0.3,0.2_0.6,0.9 --planner fewest-moves",
        "reach square --start 0.4,0.5_0.6,0.6 --moves 6",
    ],
    "search": [
        "search rectangle:60x40 --robots 3 --footprint 5",
        "search circle:40 --robots 2 --footprint 6 --angle auto",
        "search ring:60x40 --robots 2 --footprint 5",
        "search square:40 --robots 2 --footprint 10 --prior ring:20,20:0.5=10",
        "search rectangle:600x400 --robots 2 --footprint 50 --vehicle fixed-wing",
        "search rectangle:540x540 --robots 8 --footprint 10",  # large enough for compiled simulation
        *(
            f"tour {name} cave:20x15"
            for name in ("hilbert", "moore", "hilbert-rectangle", "comb", "spanning-tree")
        ),
        "tour boustrophedon maze:9x7",
        "tour hilbert 3x3x3",
    ],
}


def play(parts: list[str]) -> None:
    """Run commands in this process, so that each kernel is compiled once."""
    from shoal.cli import run

    for command in (command for part in parts for command in COMMANDS[part]):
        # an underscore is a blank within a word
        words = [word.replace("_", " ") for word in command.split()]
        with contextlib.redirect_stdout(io.StringIO()):
            code = run([*words, "--json"])
        if code > 1:  # some tasks are not completed
            raise SystemExit(f"shoal {command}: exit code {code}")
    if "steering" in parts:
        from shoal.rigs.physics import PlantProperties
        from shoal.rigs.steering_plant import SteeringPlant
        from shoal.steering import SteeringProblem
        from shoal.steering.driving import steer_rig

        start, goal = [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)]
        problem = SteeringProblem("square", start, goal, friction_at_least=1.0, max_moves=5)
        about = PlantProperties.of("exact", friction=1.0)
        steer_rig(problem, SteeringPlant(problem.place, start, about, np.random.default_rng(1)))
    if "views" in parts:
        from shoal.views.drawing.encoding import VideoPlanes

        frame = np.zeros((2, 2, 3), np.uint8)
        VideoPlanes(2, 2).show(frame)
        frame.flags.writeable = False  # as frames of Pillow are
        VideoPlanes(2, 2).show(frame)
    if "lab" in parts:
        from shoal.lab.store import ResultTexts, trial_numbers

        results = ResultTexts('["done",1.5]', [0, 1], 1, 2, where="a row")
        results.is_any(0, ["done"])
        results.column(1)
        trial_numbers("1,2", where="some trials")
    if "swarm" in parts:
        play_batch()
    if "steering" in parts:
        play_steering_batch()
    if "search" in parts:
        play_search_batch()


def play_batch() -> None:
    """Step some worlds, and look at them in all ways."""
    from shoal.swarm import SwarmProblem
    from shoal.swarm.batch import PLANES, WorldBatch

    batch = WorldBatch(SwarmProblem("rectangle:9x9", particles=3), 2)
    batch.step("ll")
    batch.planes()
    batch.action_masks()
    batch.measures()
    batch.windows(PLANES, batch.nearest_frontier()[2], 3)


def play_steering_batch() -> None:
    """Move some particles in many worlds at once, between walls and in a region."""
    from shoal.steering import SteeringProblem, region
    from shoal.steering.simulation import SteeringBatch

    square, hole = (
        [(0, 0), (1, 0), (1, 1), (0, 1)],
        [(0.4, 0.4), (0.6, 0.4), (0.6, 0.6), (0.4, 0.6)],
    )
    for workspace in ("square", region(square, [hole])):
        batch = SteeringBatch(SteeringProblem(workspace), 2)
        batch.reset(seed=0)
        batch.send(np.zeros((2, 2)))


def play_search_batch() -> None:
    """Send robots in many worlds at once, and look at what they know."""
    from shoal.search import SearchProblem
    from shoal.search.simulation.agents import SearchBatch

    batch = SearchBatch(SearchProblem("square:20", robots=2, footprint=5), 2)
    batch.reset(seed=0)
    batch.step(batch.masks().argmax(axis=-1))
    batch.observed()


def write_archives() -> None:
    """Play everything, and write the archives that do not fit it."""
    for name in [name for name in os.environ if name.startswith("NUMBA_")]:
        del os.environ[name]  # archives hold what Numba compiles without settings
    from shoal.jit.lowered import record_kernels

    with record_kernels() as changes:
        play(list(COMMANDS))
    for file, (added, removed) in sorted(changes.items()):
        size = file.stat().st_size // 1024
        print(f"{file}: {added} kernels added, {removed} removed, {size} KiB")
    if not changes:
        print("all archives fit")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("parts", nargs="*", metavar="part", help=", ".join(COMMANDS))
    parser.add_argument("--archives", action="store_true")
    options = parser.parse_args()
    if options.archives:
        write_archives()
    else:
        play(options.parts or list(COMMANDS))


if __name__ == "__main__":
    main()
