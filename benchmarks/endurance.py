"""Missions of random plans, timed and turned by other code from their files alone: python -m
benchmarks.endurance [--plans N]

Multirotors, fixed wings and rovers with random speeds, turns, batteries and wind search random
regions all over the Earth. Of each ``.plan``, read as JSON: the time of its way as a share of what
the battery allows, and legs too short for a fixed wing's turns.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import defaultdict
from pathlib import Path

from tests.properties.flights import KINDS, judged


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    shares: defaultdict[str, list[float]] = defaultdict(list)
    narrow: defaultdict[str, int] = defaultdict(int)
    refused = 0
    for seed in range(options.seed, options.seed + options.plans):
        with tempfile.TemporaryDirectory() as folder:
            found = judged(seed, Path(folder))
        kind = KINDS[seed % 3]
        if found is None:
            refused += 1
            continue
        shares[kind] += found[0]
        narrow[kind] += len(found[1])
    print(f"{options.plans} plans, {refused} of them refused")
    print(
        f"{'':<12}{'missions':>10}{'longest share':>16}{'over':>8}{'legs too short for turns':>28}"
    )
    for kind, found in shares.items():
        print(
            f"{kind:<12}{len(found):>10}{max(found):>16.6f}{sum(share > 1 for share in found):>8}{narrow[kind]:>28}"
        )


if __name__ == "__main__":
    main()
