"""python -m benchmarks.ablation: what each mechanism of the planner brings, on the same starts with
it and without it.

One row a mechanism: moves without it over moves with it, as a geometric mean of paired trials over
all maps and numbers of particles, with its 95 % confidence interval (normal approximation, of the
logarithms), and the same for each map. Above 1 the mechanism helps.

Options: --trials N (of each mechanism, in all), --maps, --counts, --only NAMES.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from tests.swarm_runs import run

from benchmarks.planners import COUNTS, MAPS, policy_of, variant
from shoal import GridWorkspace, open_map
from shoal.swarm.policies import Policy

# What the mechanism is without: another planner, or the fields of Tuning that switch it off.
MECHANISMS: dict[str, str | dict[str, float]] = {
    "all mechanisms except the choice of the next command": "greedy-classify",
    "the extensions of rollout": "rollout",
    "prediction": {"prediction_layers": 0},
    "prediction beyond 12 layers": {"prediction_layers": 12, "joint_chance": 0},
    "joint chance": {"joint_chance": 0},
    "lattices": {"lattices": 0},
    "learned prior": {"learned": 0},
    "beam": {"beam_leaves": 0},
    "runs": {"run_candidates": 0},
    "variations": {"variations": 0},
    "careful completion": {"left_behind_cost": 0},
    "extrapolation": {"future_weight": 0},
    "higher weight of the cells that a plan classifies early while there are many surprises": {
        "surprise_weight": 0
    },
    "shorter horizon with surprises": {"surprise_shrink": 0},
    "simulation to the end if predictions are reliable": {"end_surprise": 0},
    "simulation to the end if few frontier cells are left": {"end_frontier": 0},
    "far sight": {"far_surprise": 0},
    "separate horizon of plans that are not simulated to the end": {"near_horizon": 300},
}


def moves_of(
    workspaces: dict[str, GridWorkspace], counts: list[int], policy: Policy, trials: int
) -> dict[str, list[int]]:
    """Return the moves of each trial, by map; trials take the numbers of particles by turns."""
    each = -(-trials // len(workspaces))
    return {
        name: [
            run(place, particles=counts[trial % len(counts)], trial=trial, policy=policy).moves
            for trial in range(each)
        ]
        for name, place in workspaces.items()
    }


def ratio(logarithms: list[float]) -> str:
    """Return a geometric mean with its interval."""
    half = 1.96 * float(np.std(logarithms, ddof=1)) / math.sqrt(len(logarithms))
    mean = float(np.mean(logarithms))
    return f"{math.exp(mean):.3f} [{math.exp(mean - half):.3f}, {math.exp(mean + half):.3f}]"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--maps", default=",".join(MAPS))
    parser.add_argument(
        "--counts", default="1000", help=f"for example {','.join(map(str, COUNTS))}"
    )
    parser.add_argument("--only", default=",".join(MECHANISMS))
    given = parser.parse_args()
    workspaces = {name: open_map(name) for name in given.maps.split(",")}
    counts = [int(count) for count in given.counts.split(",")]
    whole = moves_of(workspaces, counts, policy_of("best"), given.trials)
    print(f"| without | moves without / with | {' | '.join(f'`{name}`' for name in workspaces)} |")
    print(f"|---|---|{'---|' * len(workspaces)}", flush=True)
    for name in given.only.split(","):
        other = MECHANISMS[name]
        policy = policy_of(other) if isinstance(other, str) else variant("without", **other)
        without = moves_of(workspaces, counts, policy, given.trials)
        pairs = {
            place: [math.log(a / b) for a, b in zip(without[place], whole[place], strict=True)]
            for place in workspaces
        }
        every = [one for some in pairs.values() for one in some]
        print(
            f"| {name} | {ratio(every)} | {' | '.join(ratio(some) for some in pairs.values())} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
