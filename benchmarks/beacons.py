"""How long beacons are, and how far strangers slow a live search: python -m benchmarks.beacons
[--floods] [--seed S]

For each search the beacons of all its robots are made as the radio sends them, signed; a beacon is
as long as all its messages. With --floods a process sends, while a live search runs, 20,000
messages under robots' numbers, or 2,000 of 60,000 bytes, to its port within a second; each search
is run some times without and with it, in turn.
"""

from __future__ import annotations

import argparse
import multiprocessing
import socket
import time

import numpy as np

from shoal.search import SearchProblem, TourCost, make_tour, plan_search
from shoal.search.protocol.messages import LONGEST, Beacon, Heartbeat, Sender
from shoal.search.protocol.state import Brief
from shoal.search.simulation.live import radio, run_live
from shoal.search.simulation.scenario import Scenario, scenario_of
from shoal.search.simulation.world import SearchWorld

WIDE = (10, 10, 10, 30, 30, 50)
SEARCHES = (
    ("", {"region": "ring:200x150", "robots": 6, "footprint": 10}),
    ("", {"region": "ring:200x150", "robots": 6, "footprint": 10, "packet": 64}),
    ("40 obstacles", {"region": "ring:200x150", "robots": 6, "footprint": 10, "obstacles": 40}),
    ("footprints of 10, 30, 50", {"region": "ring:200x150", "robots": 6, "footprint": WIDE}),
    ("", {"region": "square:1420", "robots": 12, "footprint": 10, "packet": 64}),
    ("", {"region": "square:1500", "robots": 12, "footprint": 10}),
    ("200 findings", {"region": "square:1500", "robots": 12, "footprint": 10, "targets": 200}),
)
COLUMNS = (
    "cells",
    "robots",
    "with",
    "loss",
    "messages of at most",
    "mean",
    "99 %",
    "longest",
    "messages a beacon",
)
GHOSTS, LONG = 20_000, 60_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--time", type=float, default=400.0, help="of a cell, that is simulated at the most"
    )
    parser.add_argument("--floods", action="store_true")
    parser.add_argument("--runs", type=int, default=4)
    options = parser.parse_args()
    if options.floods:
        floods(options.runs, options.seed)
        return
    print("| " + " | ".join(COLUMNS) + " |\n" + "|---" * len(COLUMNS) + "|")
    for what, fields in SEARCHES:
        for loss in (0.0, 0.3):
            problem = SearchProblem(**fields, loss=loss)
            plan = plan_search(problem, seed=options.seed)
            row(scenario_of(problem, plan, options.seed), what, loss, options.time)
    million(options.time)


def row(scenario: Scenario, what: str, loss: float, until: float) -> None:
    """Print the lengths of the beacons of a search."""
    robots, cells, packet = (
        len(scenario.starts),
        len(scenario.brief.tour_cost),
        scenario.packet or LONGEST,
    )
    senders = {number: Sender(number, b"key", packet) for number in range(1, robots + 1)}
    lengths, counts = [], []
    world = SearchWorld(scenario)
    messages = world.air.messages

    def measured(sender: int, beacon: Beacon, clock: float) -> object:
        told = senders[sender].messages(beacon, int(1000 * clock))
        lengths.append(sum(map(len, told)))
        counts.append(len(told))
        return messages(sender, beacon, clock)

    world.air.messages = measured
    world.run(until=until)
    values = [
        cells,
        robots,
        what,
        f"{loss:g}",
        packet,
        f"{np.mean(lengths):.0f}",
        f"{np.percentile(lengths, 99):.0f}",
    ]
    print(
        "| " + " | ".join(map(str, [*values, max(lengths), f"{np.mean(counts):.1f}"])) + " |",
        flush=True,
    )


def million(until: float) -> None:
    """Print the row of a million cells."""
    brief = Brief(TourCost(make_tour("hilbert-rectangle", (1000, 1000))), "stay")
    starts = tuple(int(start) for start in np.random.default_rng(1).integers(0, 1_000_000, 12))
    row(Scenario(brief, starts), "", 0.0, min(until, 30.0))


def flood(port: int, kind: str, seconds: float) -> None:
    """Send messages that no robot has signed."""
    lie = Beacon(2, (Heartbeat(2, 1 << 30, 0, 1.0, "complete"),), ((1, (1 << 400) - 1),))
    senders = [Sender(number, b"another key") for number in range(1, 7)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mouth:
        mouth.setsockopt(
            socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(radio.LOOPBACK)
        )
        count = GHOSTS if kind == "ghosts" else GHOSTS // 10
        ghosts = [
            senders[k % 6].messages(lie, time.time_ns() // 1_000_000 + k % 1000)[0]
            for k in range(min(count, 1000))
        ]
        for k in range(count):
            mouth.sendto(
                ghosts[k % len(ghosts)] if kind == "ghosts" else bytes([2]) * LONG,
                (radio.GROUP, port),
            )
            if k % 100 == 0:
                time.sleep(100 * seconds / count)


def floods(runs: int, seed: int) -> None:
    """Print how long a live search takes with and without strangers who flood its port."""
    brief = Brief(TourCost(make_tour("hilbert-rectangle", (20, 20))), "stay", hello=6.0, beat=1.0)
    starts = np.random.default_rng(seed).integers(0, 400, 6).tolist()
    times: dict[str, list[float]] = {}
    for run in range(runs):
        for kind in ("nobody", "ghosts", "long messages"):
            kept = radio.reserve()
            assert kept is not None
            port = int(kept.getsockname()[1])
            kept.close()
            process = multiprocessing.Process(target=flood, args=(port, kind, 1.0))
            begun = []

            def begin(
                event: object,
                *,
                process: multiprocessing.Process = process,
                begun: list[int] = begun,
                kind: str = kind,
            ) -> None:
                if not begun and kind != "nobody":
                    begun.append(1)
                    process.start()

            outcome = run_live(
                Scenario(brief, tuple(starts), seed=run), speed=20.0, port=port, on_event=begin
            )
            if begun:
                process.join()
            times.setdefault(kind, []).append(max(outcome.declared.values()))
            print(
                f"{kind}: {times[kind][-1]:.1f}, {outcome.dropped} dropped of"
                f" {outcome.heard + outcome.dropped}",
                flush=True,
            )
    print(
        ", ".join(
            f"{kind}: {np.mean(found):.1f} cells' time (mean of {runs})"
            for kind, found in times.items()
        )
    )


if __name__ == "__main__":
    main()
