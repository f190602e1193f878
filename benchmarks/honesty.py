"""What the model of the grid leaves out, and what a physical plant shows of it:
python -m benchmarks.honesty [--seeds N] [--map NAME] [--particles N]

Each row changes one property of the plant of the kind roll (docs/concepts/physics.md), and drives
it as the first row: told slip, misplace and miss as the command `shoal drive` tells them. A row shows
the share of cells classified rightly, walls called free, moves over those of the first row, drives
that are complete, and the alarms other than those of rates.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np

from shoal import open_map
from shoal.rigs import drive
from shoal.rigs.physics import TOLD, PhysicsRig, PlantProperties
from shoal.swarm.grid.board import noise_rng, trial_rng
from shoal.swarm.grid.tasks import place
from shoal.swarm.noise import MapErrors

ROWS: tuple[tuple[str, str], ...] = (
    ("the usual plant", ""),
    ("flow: .1 cell a command", "flow_x=.5"),
    ("flow: .4 cell a command", "flow_x=2"),
    ("adhesion: walls hold below .3 of the speed", "adhesion=.3"),
    ("adhesion: walls hold below .9 of the speed", "adhesion=.9"),
    ("clumping: attraction of a tenth of the speed", "attraction=1.2"),
    ("clumping: attraction of the speed", "attraction=12"),
    ("width: diameter .98 of the vessel", "radius=.49"),
    ("width: diameter .3 of the vessel", "radius=.15"),
    ("width: diameter .1 of the vessel", "radius=.05"),
    ("gradient: .5 to 1.5 of the middle", "weakest=.5,strongest=1.5"),
    ("heading: up to 15 degrees askew", "heading=15"),
    ("coils: gains not calibrated", "coil_gain=.15"),
    ("own gains: 25 %", "own_gain=.25"),
    ("spin: .2 of the speed along walls", "spin=.2"),
    ("spin: .6 of the speed along walls", "spin=.6"),
    ("resolution: 3 pixels a cell", "pixels=3"),
    ("resolution: particles nearer than a cell are one", "blur=20"),
    ("camera: misses 10 %", "miss=.1"),
    ("camera: sees 5 % twice", "double=.05"),
    ("camera: 3 ghosts a picture", "ghosts=3"),
    ("camera: shows the picture before the command", "late=.25"),
)
HEADER = "| what | properties | right | walls called free | moves | complete | alarms |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--map", default="vessels:300")
    parser.add_argument("--particles", type=int, default=20)
    given = parser.parse_args()
    vessel, usual = open_map(given.map), 0.0
    print(HEADER + "\n" + "|---" * (HEADER.count("|") - 1) + "|", flush=True)
    for what, values in ROWS:
        apparatus = PlantProperties.parse("roll" + f",{values}" * bool(values))
        right, false_free, moves, complete = [], 0, [], 0
        alarms: Counter[str] = Counter()
        for seed in range(given.seeds):
            start = place(vessel, given.particles, "uniform", trial_rng(seed))
            rig = PhysicsRig(vessel, start, apparatus, noise_rng(seed))
            result = drive(rig, policy="closest-frontier", max_moves=3000, **TOLD)
            errors = MapErrors.of(vessel, start, result.belief)
            right.append(errors.right)
            false_free += errors.false_free
            moves.append(result.moves)
            complete += bool(result)
            alarms.update({alarm.kind for alarm in result.alarms} - {"rates"})
        mean = float(np.mean(moves))
        usual = usual or mean
        said = ", ".join(f"{kind} {n}" for kind, n in sorted(alarms.items())) or "none"
        print(
            f"| {what} | `{values or 'roll'}` | {np.mean(right):.3f} | {false_free} |"
            f" {mean / usual:.2f} | {complete} of {given.seeds} | {said} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
