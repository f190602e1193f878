"""Episodes that must not change: number of moves and a digest of the commands, for every policy,
rule and task.

A change of the kernels, of a policy or of how random numbers are drawn shows here. If it is meant,
store them anew: ``python -m tests.golden.test_episodes``, and say so in the changelog.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from pathlib import Path

import pytest
from tests.swarm_runs import run

from shoal import open_map
from shoal.swarm import POLICIES
from shoal.swarm.noise import Noise

FILE = Path(__file__).parent / "episodes.json"
MAPS = ("line:200", "rectangle:12x70", "htree:400", "maze:31x21:4")
EPISODES = {
    "closest-frontier": ("block", "merge", "tilt"),
    "closest-frontier:ties=row-major,neighbours=dlur": ("block",),
    "elect-particle": ("block", "merge"),
    "random-moves": ("block",),
    "depth-first": ("block",),
    "sweep": ("block", "tilt"),
}
CASES = [
    (name, task, policy, rule)
    for name, task in itertools.product(MAPS, ("mapping", "coverage", "subset-coverage"))
    for policy, rules in EPISODES.items()
    for rule in rules
]


def played(name: str, task: str, policy: str, rule: str) -> list[object]:
    """Return [moves, status, digest of the commands, cells travelled]."""
    episode = run(
        open_map(name), task=task, policy=policy, rule=rule, particles=20, seed=5, max_moves=20_000
    )
    digest = hashlib.sha256(episode.commands.encode()).hexdigest()[:16]
    return [episode.moves, episode.status, digest, episode.distance]


def test_every_policy_has_an_episode():
    """The planners have their own tests, as have policies without decisions of their own."""
    others = {"best", "beam-rollout", "greedy-classify", "offline", "manual", "model"}
    others |= {policy.partition(":")[0] for _, policy in GATHERINGS}
    assert {name.partition(":")[0] for name in EPISODES} | others == {*POLICIES}


@pytest.mark.parametrize("case", CASES, ids=" ".join)
def test_episode(case):
    assert played(*case) == json.loads(FILE.read_text())[" ".join(case)]


GATHERINGS = [*itertools.product(MAPS, ("pairwise", "pairwise:pair=farthest", "gather-beam"))]


@pytest.mark.parametrize("case", GATHERINGS, ids=" ".join)
def test_gathering(case):
    assert (
        played(case[0], "gathering", case[1], "merge")
        == json.loads(FILE.read_text())[" ".join(("gathering", *case))]
    )


NOISY = [
    (name, policy, every)
    for name in ("maze:31x21:4", "vessels3d:300")
    for policy, steps in (("closest-frontier", "14"), ("elect-particle", "1"))
    for every in steps
]


def played_with_noise(name: str, policy: str, every: str) -> list[object]:
    """Return [moves, status, digest of the commands, scans, cells travelled]."""
    noise = Noise(slip=0.1, misplace=0.05, miss=0.05)
    episode = run(
        open_map(name), policy=policy, particles=20, seed=5, noise=noise, scan_every=every
    )
    digest = hashlib.sha256(episode.commands.encode()).hexdigest()[:16]
    return [episode.moves, episode.status, digest, episode.scans, episode.distance]


@pytest.mark.parametrize("case", NOISY, ids=" ".join)
def test_episode_with_noise(case):
    assert played_with_noise(*case) == json.loads(FILE.read_text())[" ".join(("noise", *case))]


if __name__ == "__main__":
    rows = [f" {json.dumps(' '.join(case))}: {json.dumps(played(*case))}" for case in CASES]
    rows += [
        f" {json.dumps(' '.join(('gathering', *case)))}:"
        f" {json.dumps(played(case[0], 'gathering', case[1], 'merge'))}"
        for case in GATHERINGS
    ]
    rows += [
        f" {json.dumps(' '.join(('noise', *case)))}: {json.dumps(played_with_noise(*case))}"
        for case in NOISY
    ]
    FILE.write_text("{\n" + ",\n".join(rows) + "\n}\n")
