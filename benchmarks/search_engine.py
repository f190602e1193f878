"""The search protocol at scale: python -m benchmarks.search_engine [--steps] [--sizes] [--beacons]
[--searches N [--plain N] [--file FILE] [--seconds S]] [--largest]

--steps: steps of the environments a CPU second, by the number of robots, in a square of 400 cells;
agents choose at random what their masks allow. --sizes: CPU seconds of simulated searches, compiled
and plain (state machine in Python, up to a size). --largest: 1,000 robots on 100,000 cells.
--beacons: the lengths of signed beacons by the number of robots. --searches N: random searches of
`tests.properties.search_scenarios` on the compiled protocol: as long as one robot lives, nothing
that it can reach is left out, each robot that lives finds that out, nobody declares it too early,
and nobody sends more beacons than the protocol allows. --plain N: so many of them, spread evenly,
are simulated by the plain state machine, too, with all its invariants, and the traces must be equal. --file: goes
on with the counts of a file, and writes them to it; --seconds: ends after so many CPU seconds.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from math import inf
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from tests.properties.search_invariants import Checker, InvariantError, check_outcome
from tests.properties.search_scenarios import random_scenario

import shoal.envs
from shoal.envs import search_v0
from shoal.search import TourCost, make_tour
from shoal.search.kernels.protocol.numbers import HELLOS, LINGER
from shoal.search.problem.network import Battery, Crash, Liar, Pause, Slow, network_of
from shoal.search.protocol.messages import Sender
from shoal.search.protocol.state import Brief
from shoal.search.simulation.compiled import CompiledSearches, SearchOutcome, can_compile
from shoal.search.simulation.scenario import Scenario
from shoal.search.simulation.world import SearchWorld
from shoal.search.tours.masks import bits_to_array

SIZES = ((8, 20), (32, 20), (128, 20), (8, 100), (10, 316), (100, 316))
PLAIN_EVENTS = 200_000  # messages of the largest search that the plain state machine simulates
SECONDS = 4.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("steps", "sizes", "largest", "beacons"):
        parser.add_argument(f"--{name}", action="store_true")
    parser.add_argument("--searches", type=int, default=0)
    parser.add_argument("--plain", type=int, default=0)
    parser.add_argument("--file", type=Path)
    parser.add_argument("--seconds", type=float, default=inf)
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
    if not given.searches:
        return 0
    return random_searches(given.searches, given.plain, given.file, given.seconds)


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


def random_searches(count: int, plain: int, file: Path | None, seconds: float) -> int:
    """Simulate random searches, and return 1 if one breaks a promise or differs from the plain
    state machine, else 0.
    """
    state = {"done": 0, "plain": 0, "left": 0, "messages": 0, "robots": 0, "spent": 0.0}
    state |= {"wrong": [], "most": 0.0}
    if file is not None and file.exists():
        state |= json.loads(file.read_text())
    before, began = state["spent"], time.process_time()
    number = state["done"] + state["left"]
    while state["done"] < count and state["spent"] - before < seconds:
        play(random_scenario(number), state, plain / count)
        number += 1
        state["spent"] = before + time.process_time() - began
        if number % 200 == 0 and file is not None:
            file.write_text(json.dumps(state))
        if number % 1000 == 0:
            print(
                f"{state['done']} searches, {state['plain']} plain, {len(state['wrong'])} wrong,"
                f" {state['spent']:.0f} CPU s",
                flush=True,
            )
    if file is not None:
        file.write_text(json.dumps(state))
    wrong = state["wrong"]
    print(
        f"{state['done']} random searches of {state['robots']} robots with {state['messages']}"
        f" messages on the compiled protocol ({state['left']} others need the plain one),"
        f" {state['plain']} also on the plain one: {len(wrong)} wrong"
        f"{': seeds ' + ', '.join(map(str, wrong[:10])) if wrong else ''}; at most"
        f" {state['most']:.3f} of the beacons that the protocol allows; {state['spent']:.0f} CPU s"
    )
    return int(bool(wrong))


def play(scenario: Scenario, state: dict[str, Any], plain: float) -> None:
    """Simulate a search in compiled code, and a share of them in the plain state machine, too."""
    if not can_compile(scenario):
        state["left"] += 1
        return
    until = 60 * scenario.brief.tour_cost.whole * scenario.brief.multiplicity + 1000
    searches = CompiledSearches([scenario])
    searches.run(0, until)
    outcome = searches.outcome(0)
    state["done"] += 1
    state["robots"] += len(scenario.starts)
    state["messages"] += outcome.sent
    share = share_of_beacons(scenario, searches, outcome)
    state["most"] = max(state["most"], share)
    good = promises_hold(scenario, searches, outcome) and share <= 1
    if good and state["plain"] < plain * state["done"]:
        good = equals_plain(scenario, outcome, until)
        state["plain"] += 1
    if not good:
        state["wrong"].append(scenario.seed)


def share_of_beacons(
    scenario: Scenario, searches: CompiledSearches, outcome: SearchOutcome
) -> float:
    """Return the largest number of beacons of a robot, divided by the number that the protocol
    allows: one in each period, at first more often, one for each way that it sets out on, and some
    at the end.
    """
    brief, largest = scenario.brief, 0.0
    robots, end = searches.worlds.robots[0], float(searches.worlds.control[0].time)
    for i in range(len(scenario.starts)):
        if robots[i].waited or brief.energy < inf:  # it has set out more often
            continue
        ways = len(outcome.cells[i]) + len(outcome.obstructed[i]) + 2
        allowed = end / brief.beat + ways + HELLOS * (1 + brief.hello) + LINGER
        largest = max(largest, float(robots[i]["count"]) / allowed)
    return largest


def promises_hold(scenario: Scenario, searches: CompiledSearches, outcome: SearchOutcome) -> bool:
    """Return whether all cells that good robots can reach were searched by robots that do not lie,
    each good robot knows that, and nobody declared it too early.
    """
    failing = {
        fault.robot
        for fault in scenario.faults
        if isinstance(fault, Crash | Pause | Slow | Battery | Liar)
    }
    liars = {fault.robot for fault in scenario.faults if isinstance(fault, Liar)}
    searched_at = np.full(len(scenario.brief.tour_cost), inf)
    for i, (cells, times) in enumerate(zip(outcome.cells, outcome.times, strict=True)):
        if i + 1 not in liars:
            np.minimum.at(searched_at, cells, times)
    alive = searches.worlds.robots[0]["alive"]
    for number in range(1, len(scenario.starts) + 1):
        reach = bits_to_array(scenario.reach(number), len(searched_at))
        last, declared = float(searched_at[reach].max()), outcome.declared.get(number)
        if number not in liars and declared is not None and declared < last:
            return False
        if number not in failing and alive[number - 1] and (declared is None or last == inf):
            return False
    return True


def equals_plain(scenario: Scenario, outcome: SearchOutcome, until: float) -> bool:
    """Return whether the plain state machine keeps all invariants, and leaves the same trace."""
    try:
        world = SearchWorld(scenario, check=Checker(scenario)).run(until=until)
        check_outcome(scenario, world)
    except InvariantError as error:
        print(error)
        return False
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
