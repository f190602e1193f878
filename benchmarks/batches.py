"""Batches of worlds against loops in Python, Gymnasium's loop and POGEMA, all in one run.

python -m benchmarks.batches [--pogema PYTHON]

POGEMA needs older versions of NumPy, Gymnasium and Pydantic than Shoal takes, so it gets a virtual
environment of its own, whose Python is named: ``python -m venv pogema && pogema/bin/pip install
pogema==1.4.0``, then ``--pogema pogema/bin/python``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import time
from collections.abc import Callable

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv

import shoal.envs  # noqa: F401 - registers the environments
from benchmarks.timing import best_seconds, row
from shoal.core.version import count_processors
from shoal.swarm import GridWorld, SwarmProblem
from shoal.swarm.batch import WorldBatch
from shoal.swarm.grid.board import LETTERS, trial_rng

SMALL = {"map": "vessels:1000", "particles": 100}
LARGE = {"map": "vessels:5000", "particles": 1000}
WORLDS, MOVES = 1024, 1000  # the environments' own limit of moves
POGEMA = """
import json, sys, time
import numpy as np
from pogema import GridConfig, pogema_v0
told = json.load(sys.stdin)
env = pogema_v0(GridConfig(map=told["map"], num_agents=told["agents"], on_target="nothing", seed=0, max_episode_steps=10**6))
env.reset(seed=0)
actions = np.random.default_rng(0).integers(0, 5, (told["moves"] + 5, told["agents"]))
best = float("inf")
for _ in range(3):
    env.reset(seed=0)
    for action in actions[:5]:
        env.step(action)
    began = time.process_time()
    for action in actions[5:]:
        env.step(action)
    best = min(best, time.process_time() - began)
print(json.dumps(told["moves"] / best))
"""


def problem_of(fields: dict, **more: object) -> SwarmProblem:
    return SwarmProblem(**fields, policy="closest-frontier", **more)


def speed_of_batch(
    fields: dict,
    *,
    worlds: int,
    planes: bool,
    threads: int | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """Return world-steps a second of random commands from the start on, with belief, ends and
    resets of what has ended.

    ``clock`` tells the seconds; those of `time.process_time` are of one processor, whatever else
    the machine does.
    """
    batch = WorldBatch(problem_of(fields), worlds, threads=threads)
    commands = np.random.default_rng(0).integers(0, 4, (MOVES, worlds))
    out = np.empty((worlds, 4, *batch.layout.window), dtype=np.uint8) if planes else None
    best = float("inf")
    for _ in range(3):
        batch.reset(seed=0)
        began = clock()
        for command in commands:
            batch.step(command)
            batch.reset(batch.terminated | batch.truncated)
            if planes:
                batch.planes(out=out)
        best = min(best, clock() - began)
    return worlds * MOVES / best


def speed_of_loop(fields: dict, *, planes: bool, worlds: int = 2) -> float:
    """Return world-steps a second of the same in Python: `GridWorld.step`, `Task.update`, and
    planes from boards.
    """
    problem = problem_of(fields)
    world, task = GridWorld(problem.place, problem.rule), problem.setup.task
    starts = [world.initial(problem.setup.draw_start(trial_rng(seed))[0]) for seed in range(worlds)]
    commands = np.random.default_rng(0).integers(0, 4, (MOVES, worlds))
    out = np.empty((worlds, 4, *world.layout.window), dtype=np.uint8)

    def play() -> None:
        states, beliefs = list(starts), [task.begin(world, state) for state in starts]
        for row_of_commands in commands:
            for i, command in enumerate(row_of_commands):
                after = world.step(states[i], LETTERS[command])
                beliefs[i] = task.update(
                    beliefs[i], LETTERS[command], states[i].occupied, after.occupied
                )
                states[i] = after
                assert not beliefs[i].complete
                if planes:
                    belief = beliefs[i]
                    out[i, 0], out[i, 1] = after.occupied.mask, belief.open.mask
                    out[i, 2], out[i, 3] = belief.obstacles.mask, belief.frontier.mask

    return worlds * MOVES / best_seconds(play, repeat=3)


def speed_of_vector(make: Callable[[], gymnasium.vector.VectorEnv], moves: int) -> float:
    """Return environment steps a second of a vector of environments."""
    envs = make()
    envs.action_space.seed(0)
    actions = [envs.action_space.sample() for _ in range(moves)]

    def play() -> None:
        envs.reset(seed=0)
        for action in actions:
            envs.step(action)

    return envs.num_envs * moves / best_seconds(play, repeat=3)


def bench_batches() -> None:
    steps, seen = (speed_of_batch(SMALL, worlds=WORLDS, planes=planes) for planes in (False, True))
    loop, seen_loop = (speed_of_loop(SMALL, planes=planes) for planes in (False, True))
    cpu = speed_of_batch(SMALL, worlds=WORLDS, planes=False, threads=1, clock=time.process_time)
    large = (
        speed_of_batch(LARGE, worlds=256, planes=False, threads=1, clock=time.process_time)
        * LARGE["particles"]
    )
    print(f"load of the machine in the last minute: {os.getloadavg()[0]:.1f}")
    what = (
        f"{WORLDS} worlds of {SMALL['map']}, {SMALL['particles']} particles, {count_processors()}"
        " processors"
    )
    row(what, f"{steps:,.0f} world-steps/s", "1,000,000 and more", steps >= 1e6)
    row("  in a CPU second", f"{cpu:,.0f} world-steps", "", True)
    row(
        "  with planes of all cells",
        f"{seen:,.0f} world-steps/s",
        "150,000 and more",
        seen >= 150_000,
    )
    row(
        f"  a loop in Python: {loop:,.0f} world-steps/s",
        f"{steps / loop:.0f} times",
        "100 times",
        steps >= 100 * loop,
    )
    row(f"  the same with planes: {seen_loop:,.0f}", f"{seen / seen_loop:.0f} times", "", True)
    row(
        f"{LARGE['map']}, {LARGE['particles']} particles, in a CPU second",
        f"{large:.2e} particle-steps",
        "1e9",
        large >= 1e9,
    )
    for fields in (SMALL, LARGE):
        few, many = (WorldBatch(problem_of(fields), worlds).memory for worlds in (1, 101))
        row(f"  memory of a world of {fields['map']}", f"{(many - few) / 100:,.0f} bytes", "", True)
    batch = WorldBatch(problem_of(SMALL), WORLDS)
    row("  beginning an episode", f"{best_seconds(batch.reset) / WORLDS * 1e6:.0f} µs", "", True)


def bench_environments() -> None:
    name, steering = "shoal/Mapping-v0", "shoal/Steering-v0"
    ours = speed_of_vector(lambda: gymnasium.make_vec(name, num_envs=WORLDS, **SMALL), 100)
    shared = speed_of_vector(
        lambda: gymnasium.make_vec(name, num_envs=WORLDS, copy=False, **SMALL), 100
    )
    theirs = speed_of_vector(
        lambda: SyncVectorEnv([lambda: gymnasium.make(name, **SMALL)] * 8), 100
    )
    row(f"gymnasium.make_vec, {WORLDS} environments", f"{ours:,.0f} steps/s", "", True)
    row("  with copy=False", f"{shared:,.0f} steps/s", "", True)
    row(
        f"  Gymnasium's loop over single ones: {theirs:,.0f} steps/s",
        f"{ours / theirs:.0f} times",
        "",
        True,
    )
    ours = speed_of_vector(lambda: gymnasium.make_vec(steering, num_envs=WORLDS), 100)
    theirs = speed_of_vector(lambda: SyncVectorEnv([lambda: gymnasium.make(steering)] * 8), 100)
    row(f"gymnasium.make_vec of steering, {WORLDS} environments", f"{ours:,.0f} steps/s", "", True)
    row(
        f"  Gymnasium's loop over single ones: {theirs:,.0f} steps/s",
        f"{ours / theirs:.0f} times",
        "",
        True,
    )


def bench_pogema(python: str) -> None:
    """One world on one thread against one world on one thread, each with its own observations."""
    place = problem_of(SMALL).place
    agents = SMALL["particles"]
    told = {"map": str(place), "agents": agents, "moves": 50}
    done = subprocess.run(
        [python, "-c", POGEMA], input=json.dumps(told), capture_output=True, text=True, check=True
    )
    theirs = float(json.loads(done.stdout.splitlines()[-1]))
    env = gymnasium.make("shoal/Mapping-v0", **SMALL)
    commands = np.random.default_rng(0).integers(0, 4, 300)  # three times under the limit of moves
    env.reset(seed=0)
    ours = len(commands) / best_seconds(
        lambda: [env.step(command) for command in commands], repeat=3, clock=time.process_time
    )
    batch = speed_of_batch(SMALL, worlds=WORLDS, planes=True, threads=1, clock=time.process_time)
    print(f"{agents} agents or particles on {SMALL['map']}, in a CPU second of one thread")
    row("  POGEMA: actions, one for each agent", f"{theirs * agents:,.0f}", "", True)
    row("  POGEMA: steps, with a window of 11 x 11 for each agent", f"{theirs:,.0f}", "", True)
    row("  one environment: steps of one action, with planes", f"{ours:,.0f}", "", True)
    row(f"  batch of {WORLDS}: steps of one action, with planes", f"{batch:,.0f}", "", True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--pogema", metavar="PYTHON", help="Python of a virtual environment that has POGEMA"
    )
    given = parser.parse_args()
    bench_batches()
    bench_environments()
    if given.pogema:
        bench_pogema(given.pogema)
    else:
        print("POGEMA is not measured: name a Python that has it with --pogema")


if __name__ == "__main__":
    main()
