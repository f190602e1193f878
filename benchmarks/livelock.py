"""make soak: elect-particle never cycles for ever, in 10,000 episodes on maps of every kind."""

from __future__ import annotations

import argparse
import sys
from collections import Counter

from tests.swarm_runs import run_trials

from shoal import open_map

# Maps and particle counts; each pair is played in as many trials as gives 10,000 in all.
MAPS = (
    "vessels:5000",
    "line:5000",
    "rectangle:50x100",
    "htree:5000",
    "maze:61x41",
    "maze:101x71:3",
    "vessels:1000:2",
    "cave:60x50",
)
COUNTS = (2, 10, 50, 100, 300)
EPISODES = 10_000


def main() -> int:
    trials = EPISODES // (len(MAPS) * len(COUNTS))
    statuses: Counter[str] = Counter()
    for name in MAPS:
        workspace = open_map(name)
        longest = 0
        for n in COUNTS:
            episodes = run_trials(
                workspace, trials=trials, particles=n, policy="elect-particle", seed=n
            )
            statuses.update(episode.status for episode in episodes)
            longest = max(longest, *(episode.moves for episode in episodes))
        print(
            f"{name:<18} {trials * len(COUNTS)} episodes, longest {longest} moves, so far"
            f" {dict(statuses)}",
            flush=True,
        )
    return 0 if statuses == {"complete": EPISODES} else 1


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    sys.exit(main())
