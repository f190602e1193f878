"""python -m benchmarks.planners: planners against closest-frontier, on the same starts, with the
gap to the lower bounds.

Options: --trials N, --few-trials N (at n = 100), --counts 100,500, --maps htree:5000,retina,
--policies best,no-beam (names of policies or of VARIANTS), --tasks
mapping,coverage,subset-coverage.
"""

from __future__ import annotations

import argparse
import math
import statistics
import time

import numpy as np
from tests.golden.test_published import PUBLISHED, published_means
from tests.swarm_runs import run

from shoal import GridWorkspace, open_map
from shoal.swarm.maps.imaging import segment_vessels
from shoal.swarm.maps.imaging.samples import retina
from shoal.swarm.policies import BeamRollout, Policy, make_policy
from shoal.swarm.theory.bounds import lower_bound

COUNTS = (100, 500, 1000, 2500, 4000)
MAPS = ("htree:5000", "rectangle:50x100", "line:5000", "vessels:5000")


def variant(name: str, **changed: float) -> Policy:
    """Return beam-rollout with some numbers of its tuning changed."""
    kind = type(
        name, (BeamRollout,), {"tuning": BeamRollout.tuning._replace(**changed), "name": name}
    )
    return kind()


VARIANTS = {
    "no-beam": {"beam_leaves": 0},
    "no-variations": {"variations": 0},
    "no-runs": {"run_candidates": 0},
    "no-prediction": {"prediction_layers": 0},
    "prediction-of-12-cells": {"prediction_layers": 12, "joint_chance": 0},
    "end-always-in-sight": {"end_surprise": 2},
    "no-extrapolation": {"future_weight": 0},
    "no-learned-prior": {"learned": 0},
    "narrow-beam": {"beam_width": 4, "beam_depth": 8, "beam_leaves": 3},
    "beam-of-few": {"beam_width": 0.625, "beam_depth": 2.5},  # at n = 4000 that of n = 1000
    "many-as-few": {"end_frontier": 50, "frontier_worth": 100},  # at n = 4000
    "no-far-sight": {"far_surprise": 0, "prediction_layers": 60},
}


def policy_of(name: str) -> Policy:
    """Return a policy by name, or a variant by one of `VARIANTS`."""
    return variant(name, **VARIANTS[name]) if name in VARIANTS else make_policy(name)


def interval(ratios: list[float]) -> float:
    """Return half the width of the 95 % confidence interval of a mean (normal approximation)."""
    return 1.96 * statistics.stdev(ratios) / math.sqrt(len(ratios)) if len(ratios) > 1 else math.nan


def eye() -> GridWorkspace:
    """Return the map of ``make demo``."""
    return GridWorkspace(segment_vessels(retina()), name="retina")


def point(workspace, name: str, n: int, policy: Policy, task: str, trials: int) -> dict[str, float]:
    """Return what a policy needs at one number of particles, and what closest-frontier needs from
    the same starts.
    """
    ours, theirs, gaps, seconds = [], [], [], []
    for trial in range(trials):
        began = time.process_time()
        episode = run(workspace, particles=n, trial=trial, policy=policy, task=task)
        seconds.append((time.process_time() - began) / max(1, episode.moves))
        assert episode.status == "complete", episode
        base = run(
            workspace, start=episode.start, policy="closest-frontier", task=task, trial=trial
        )
        if task == "subset-coverage":  # the targets are drawn after the start
            base = run(workspace, particles=n, policy="closest-frontier", task=task, trial=trial)
            assert (base.targets == episode.targets).all()
        kind = "mapping" if task == "mapping" else "coverage"
        bound = lower_bound(workspace, episode.start, task=kind, targets=episode.targets)
        ours.append(episode.moves)
        theirs.append(base.moves)
        gaps.append(episode.moves / max(1, bound.moves))
    mean = statistics.fmean(ours)
    paired = mean / statistics.fmean(theirs)
    residuals = [
        (a - paired * b) / statistics.fmean(theirs) for a, b in zip(ours, theirs, strict=True)
    ]
    published = (
        published_means(PUBLISHED[name]).get(n) if task == "mapping" and name in PUBLISHED else None
    )
    return {
        "moves": mean,
        "paired": paired,
        "half": interval(residuals),
        "fraction": mean / published if published else paired,
        "gap": statistics.fmean(gaps),
        "ms": 1e3 * statistics.median(seconds),
    }


def main() -> None:
    """Print one table a task."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--few-trials", type=int, default=20, help="at n = 100")
    parser.add_argument("--counts", default=",".join(map(str, COUNTS)))
    parser.add_argument("--maps", default=",".join(MAPS))
    parser.add_argument("--policies", default="best")
    parser.add_argument("--tasks", default="mapping")
    given = parser.parse_args()
    for task in given.tasks.split(","):
        paired = "of closest-frontier, same starts"
        columns = (
            "map",
            "policy",
            "n",
            "moves",
            "of the published",
            paired,
            "times the bound",
            "ms a move",
        )
        print(f"\n{task}\n\n| {' | '.join(columns)} |")
        print("|---|---|---|---|---|---|---|---|")
        for name in given.maps.split(","):
            workspace = eye() if name == "retina" else open_map(name)
            for policy in given.policies.split(","):
                fractions, pairs = [], []
                for n in map(int, given.counts.split(",")):
                    trials = min(given.trials, given.few_trials) if n <= 100 else given.trials
                    at = point(workspace, name, n, policy_of(policy), task, trials)
                    fractions.append(at["fraction"])
                    pairs.append(at["paired"])
                    public = (
                        f"{at['fraction']:.3f}" if task == "mapping" and name in PUBLISHED else ""
                    )
                    print(
                        f"| `{name}` | {policy} | {n} | {at['moves']:.1f} | {public} |"
                        f" {at['paired']:.3f} ± {at['half']:.3f} | {at['gap']:.1f} |"
                        f" {at['ms']:.2f} |",
                        flush=True,
                    )
                means = [float(np.exp(np.mean(np.log(values)))) for values in (fractions, pairs)]
                print(
                    f"| `{name}` | {policy} | geometric mean | | {means[0]:.3f} | {means[1]:.3f}"
                    " | | |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
