"""The search protocol at scale: python -m benchmarks.search_engine [--steps] [--sizes] [--beacons]
[--searches N] [--plain N] [--largest]

--steps: steps of the environments a CPU second, by the number of robots, in a square of 400 cells;
agents choose at random what their masks allow. --sizes: CPU seconds of simulated searches, compiled
and plain (state machine in Python, up to a size). --largest: 1,000 robots on 100,000 cells.
--beacons: the lengths of signed beacons by the number of robots. --searches N: random searches of
`tests.properties.search_scenarios` on the compiled protocol, of those that it simulates: as long as
one robot lives, nothing is left out, and each robot that lives finds that out. --plain N: the first
of these are simulated by the plain state machine, too, with all its invariants, and the traces must
be equal.
"""

from __future__ import annotations

import argparse
import sys
import time
from math import inf

import gymnasium
import numpy as np
from tests.properties.search_invariants import Checker, InvariantError, check_outcome
from tests.properties.search_scenarios import random_scenario

import shoal.envs
from shoal.envs import search_v0
from shoal.search import TourCost, make_tour
from shoal.search.problem.network import Battery, Crash, Liar, Pause, Slow, network_of
from shoal.search.protocol.messages import Sender
from shoal.search.protocol.state import Brief
from shoal.search.simulation.compiled import CompiledSearches, can_compile
from shoal.search.simulation.scenario import Scenario
from shoal.search.simulation.world import SearchWorld

SIZES = ((8, 20), (32, 20), (128, 20), (8, 100), (10, 316), (100, 316))
PLAIN_EVENTS = 200_000  # messages of the largest search that the plain state machine simulates
SECONDS = 4.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("steps", "sizes", "largest", "beacons"):
        parser.add_argument(f"--{name}", action="store_true")
    parser.add_argument("--searches", type=int, default=0)
    parser.add_argument("--plain", type=int, default=0)
    parser.add_argument("--loss", type=float, default=0.1)
    given = parser.parse_args()
    if given.steps:
        steps()
    if given.sizes:
        sizes(SIZES, given.loss)
    if given.largest:
        sizes([(1000, 316)], 0.0)
    if given.beacons:
        beacons()
    return random_searches(given.searches, given.plain) if given.searches else 0


def steps() -> None:
    """Print steps a CPU second."""
    print("robots  PettingZoo  one world  32 worlds  (steps a CPU second)")
    for robots in (2, 8, 32, 128):
        options = {"region": "square:200", "robots": robots}
        rates = [agents_rate(options), *(vector_rate(options, worlds) for worlds in (1, 32))]
        print(f"{robots:>6}" + "".join(f"{rate:>12.0f}" for rate in rates), flush=True)


def agents_rate(options: dict[str, object]) -> float:
    env, rng = search_v0.parallel_env(**options), np.random.default_rng(0)
    _, infos = env.reset(seed=1)
    spent, count = 0.0, 0
    while spent < SECONDS:
        actions = {
            agent: int(rng.choice(np.flatnonzero(infos[agent]["action_mask"])))
            for agent in env.agents
        }
        began = time.process_time()
        *_, infos = env.step(actions)
        if not env.agents:
            _, infos = env.reset(seed=count)
        spent, count = spent + time.process_time() - began, count + 1
    return count / spent


def vector_rate(options: dict[str, object], worlds: int) -> float:
    envs = gymnasium.make_vec("shoal/Search-v0", num_envs=worlds, **options)
    _, infos = envs.reset(seed=1)
    envs.step(np.zeros(envs.action_space.shape, dtype=np.int64))  # compiles
    rng, spent, count = np.random.default_rng(0), 0.0, 0
    while spent < SECONDS:
        mask = infos["action_mask"]
        actions = (rng.random(mask.shape) * mask).argmax(axis=-1)
        began = time.process_time()
        *_, infos = envs.step(actions)
        spent, count = spent + time.process_time() - began, count + worlds
    return count / spent


def scenario_of(robots: int, side: int, loss: float) -> Scenario:
    tour_cost = TourCost(make_tour("hilbert-rectangle", (side, side)))
    starts = tuple(np.random.default_rng(1).integers(0, side * side, robots).tolist())
    return Scenario(Brief(tour_cost), starts, network=network_of(loss=loss), seed=1)


def sizes(wanted: object, loss: float) -> None:
    """Print CPU seconds of simulated searches."""
    CompiledSearches([scenario_of(3, 5, loss)]).run(0, inf)  # compiles
    print(f"robots   cells  messages (loss {loss:g})  searched at  compiled, CPU s  plain, CPU s")
    for robots, side in wanted:
        scenario = scenario_of(robots, side, loss)
        began = time.process_time()
        searches = CompiledSearches([scenario])
        searches.run(0, inf)
        spent = time.process_time() - began
        outcome, plain = searches.outcome(0), ""
        if outcome.sent < PLAIN_EVENTS:
            began = time.process_time()
            world = SearchWorld(scenario).run()
            plain = f"{time.process_time() - began:.2f}"
            assert (world.covered_at, world.air.sent) == (outcome.covered_at, outcome.sent)
        print(
            f"{robots:>6}{side * side:>8}{outcome.sent:>21}{outcome.covered_at:>13.1f}"
            f"{spent:>17.3f}{plain:>14}",
            flush=True,
        )


def beacons() -> None:
    """Print the lengths of beacons while many robots search, by the number of robots."""
    print("robots  cells  mean bytes  longest beacon, bytes")
    for robots in (8, 32, 100, 200):
        side = round((25 * robots) ** 0.5)
        scenario = scenario_of(robots, side, 0.1)
        senders = {number: Sender(number, b"key") for number in range(1, robots + 1)}
        world, lengths = SearchWorld(scenario), []
        messages = world.air.messages

        def measured(sender: int, beacon: object, clock: float) -> object:
            told = senders[sender].messages(beacon, int(1000 * clock))  # noqa: B023
            lengths.append(sum(map(len, told)))  # noqa: B023
            return messages(sender, beacon, clock)  # noqa: B023

        world.air.messages = measured  # type: ignore[method-assign]
        world.run(until=20.0)
        print(f"{robots:>6}{side * side:>7}{np.mean(lengths):>12.0f}{max(lengths):>12}", flush=True)


def random_searches(count: int, plain: int) -> int:
    """Simulate random searches, and return 1 if one breaks a promise or differs from the plain
    state machine, else 0.
    """
    done, number, left, messages, wrong, began = 0, 0, 0, 0, [], time.process_time()
    while done < count:
        scenario = random_scenario(number)
        number += 1
        if not can_compile(scenario):
            left += 1
            continue
        until = 60 * scenario.brief.tour_cost.whole * scenario.brief.multiplicity + 1000
        searches = CompiledSearches([scenario])
        searches.run(0, until)
        outcome = searches.outcome(0)
        messages += outcome.sent
        if not promises_hold(scenario, searches):
            wrong.append(scenario.seed)
        if done < plain and not equals_plain(scenario, searches, until):
            wrong.append(scenario.seed)
        done += 1
        if done % 10_000 == 0:
            spent = time.process_time() - began
            print(f"{done} searches, {len(wrong)} wrong, {spent:.0f} CPU s", flush=True)
    print(
        f"{done} random searches with {messages} messages on the compiled protocol ({left} others"
        f" need the plain one), {min(plain, done)} also on the plain one: {len(wrong)} wrong"
        f"{': seeds ' + ', '.join(map(str, wrong[:10])) if wrong else ''}"
    )
    return int(bool(wrong))


def promises_hold(scenario: Scenario, searches: CompiledSearches) -> bool:
    """Return whether all cells were searched by robots that do not lie, and each good robot knows
    that, if there is a good robot.
    """
    failing = {
        fault.robot
        for fault in scenario.faults
        if isinstance(fault, Crash | Pause | Slow | Battery | Liar)
    }
    outcome, robots = searches.outcome(0), searches.worlds.robots[0]
    good = [
        number
        for number in range(1, len(scenario.starts) + 1)
        if number not in failing and robots["alive"][number - 1]
    ]
    liars = {fault.robot for fault in scenario.faults if isinstance(fault, Liar)}
    early = any(
        when < outcome.covered_at - 1e-9
        for number, when in outcome.declared.items()
        if number not in liars
    )
    finished = all(number in outcome.declared for number in good)
    return not early and (not good or (outcome.covered_at < inf and finished))


def equals_plain(scenario: Scenario, searches: CompiledSearches, until: float) -> bool:
    """Return whether the plain state machine keeps all invariants, and leaves the same trace."""
    try:
        world = SearchWorld(scenario, check=Checker(scenario)).run(until=until)
        check_outcome(scenario, world)
    except InvariantError as error:
        print(error)
        return False
    outcome = searches.outcome(0)
    moves = [
        list(zip(times.tolist(), cells.tolist(), strict=True))
        for cells, times in zip(outcome.cells, outcome.times, strict=True)
    ]
    vehicles = world.vehicles.values()
    return (
        moves == [vehicle.visits for vehicle in vehicles]
        and [list(states) for states in outcome.states] == [one.states for one in vehicles]
        and list(outcome.found) == [dict(one.robot.found) for one in vehicles]
        and (outcome.declared, outcome.covered_at, outcome.sent, outcome.lost, outcome.takeovers)
        == (world.declared, world.covered_at, world.air.sent, world.air.lost, world.takeovers)
    )


if __name__ == "__main__":
    assert shoal.envs.REGISTERED
    sys.exit(main())
