"""Steps of environments in a CPU second, by environment, observation and client.

python -m benchmarks.environments [--seconds SECONDS] [--learn]

The agents act at random. The columns are a single environment of Gymnasium, a vector of 64 of
them, and the robots of PettingZoo (a step is one of all robots). If Stable-Baselines3 is
installed, more columns follow: 8 single environments in its own vector (DummyVecEnv with
Monitor, as ``PPO("MlpPolicy", "shoal/Mapping-v0")`` makes it), 64 in SB3VecEnv, and how many times
more steps SB3VecEnv makes. If TorchRL is installed, a column has 64 in its GymWrapper. All libraries
lie in the folder .venv-clients that ``make test-clients`` makes.

--learn: PPO of Stable-Baselines3 in place of random agents, with both vectors.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import gymnasium
import numpy as np

from shoal.envs import SB3VecEnv, search_v0

COUNT, FEW = 64, 8
SMALL = {"map": "vessels:300", "particles": 30}
LARGE: dict[str, Any] = {}  # the options of the ids
ROWS: list[tuple[str, str, dict[str, Any]]] = [
    *(
        ("Mapping", observation, SMALL)
        for observation in ("planes", "image", "flat", "window", "compact")
    ),
    *(
        ("Mapping", observation, LARGE)
        for observation in ("planes", "image", "flat", "window", "compact")
    ),
    ("Coverage", "planes", SMALL),
    ("Coverage", "compact", SMALL),
    ("Steering", "dict", {}),
    ("Steering", "flat", {}),
    *(("Search", observation, {"robots": 4}) for observation in ("dict", "image", "flat")),
]


def rate(step: Callable[[Any], Any], actions: list[Any], count: int, seconds: float) -> float:
    """Return the steps of ``count`` environments in a CPU second, the best of three runs."""
    best = 0.0
    for action in actions[:5]:
        step(action)
    for _ in range(3):
        steps, began = 0, time.process_time()
        while (spent := time.process_time() - began) < seconds / 3:
            step(actions[steps % len(actions)])
            steps += 1
        best = max(best, steps * count / spent)
    return best


def of_single(name: str, options: dict[str, Any], seconds: float) -> float:
    env = gymnasium.make(f"shoal/{name}-v0", **options)
    env.reset(seed=1)

    def step(action: Any) -> None:
        *_, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()

    return rate(step, [env.action_space.sample() for _ in range(50)], 1, seconds)


def of_vector(name: str, options: dict[str, Any], seconds: float) -> float:
    envs = gymnasium.make_vec(f"shoal/{name}-v0", num_envs=COUNT, **options)
    envs.reset(seed=1)
    return rate(envs.step, [envs.action_space.sample() for _ in range(50)], COUNT, seconds)


def of_agents(name: str, options: dict[str, Any], seconds: float) -> float | None:
    if name != "Search":
        return None
    env = search_v0.parallel_env(**options)
    env.reset(seed=1)

    def step(actions: dict[str, Any]) -> None:
        env.step({agent: actions[agent] for agent in env.agents})
        if not env.agents:
            env.reset()

    sampled = [
        {agent: env.action_space(agent).sample() for agent in env.possible_agents}
        for _ in range(50)
    ]
    return rate(step, sampled, 1, seconds)


def dummy(name: str, options: dict[str, Any]) -> Any:
    """Return single environments in the vector that Stable-Baselines3 makes."""
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    return DummyVecEnv([lambda: Monitor(gymnasium.make(f"shoal/{name}-v0", **options))] * FEW)


def joint(name: str, options: dict[str, Any]) -> Any:
    return SB3VecEnv(f"shoal/{name}-v0", num_envs=COUNT, **options)


def of_sb3(envs: Any, seconds: float) -> float:
    envs.seed(1)
    envs.reset()
    count = envs.num_envs
    actions = [np.array([envs.action_space.sample() for _ in range(count)]) for _ in range(50)]
    return rate(envs.step, actions, count, seconds)


def of_torchrl(name: str, options: dict[str, Any], seconds: float) -> float:
    from torchrl.envs import GymWrapper

    envs = gymnasium.make_vec(
        f"shoal/{name}-v0", num_envs=COUNT, autoreset_mode="Disabled", **options
    )
    env = GymWrapper(envs)
    env.set_seed(1)
    env.rollout(5, break_when_any_done=False)
    steps, began = 0, time.process_time()
    while (spent := time.process_time() - began) < seconds:
        env.rollout(20, break_when_any_done=False)
        steps += 20
    return steps * COUNT / spent


def learnt(envs: Any, seconds: float) -> float:
    """Return the steps of PPO in a CPU second, training included."""
    from stable_baselines3 import PPO

    dicts = isinstance(envs.observation_space, gymnasium.spaces.Dict)
    policy = "MultiInputPolicy" if dicts else "MlpPolicy"
    model = PPO(policy, envs, n_steps=512 // envs.num_envs, n_epochs=1, batch_size=256)
    model.learn(512)
    began, steps = time.process_time(), 0
    while (spent := time.process_time() - began) < seconds:
        model.learn(512, reset_num_timesteps=False)
        steps += 512
    return steps / spent


def print_row(*texts: str) -> None:
    print(f"| {' | '.join(texts)} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=1.0, help="CPU seconds for each figure")
    parser.add_argument("--learn", action="store_true", help="PPO in place of random agents")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    sb3, torchrl = (find_spec(name) is not None for name in ("stable_baselines3", "torchrl"))
    if given.learn and not sb3:
        parser.error(
            "--learn: expected Stable-Baselines3, got none (make test-clients installs it)"
        )
    columns = ["single", "vector", "PettingZoo"] if not given.learn else []
    columns += ["DummyVecEnv", "SB3VecEnv", "times"] * sb3
    columns += ["TorchRL"] * (torchrl and not given.learn)
    print_row("environment", "observation", "map", *columns)
    for name, observation, fields in ROWS:
        options, figures = {**fields, "observation": observation}, []
        if not given.learn:
            figures += [
                measure(name, options, given.seconds)
                for measure in (of_single, of_vector, of_agents)
            ]
        if sb3:
            measure = learnt if given.learn else of_sb3
            two = [measure(make(name, options), given.seconds) for make in (dummy, joint)]
            figures += [*two, two[1] / two[0]]
        if torchrl and not given.learn:
            figures.append(of_torchrl(name, options, given.seconds))
        texts = [
            "" if figure is None else f"{figure:,.{1 if column == 'times' else 0}f}"
            for column, figure in zip(columns, figures, strict=True)
        ]
        place = fields.get("map", "vessels:1000" if name in ("Mapping", "Coverage") else "")
        print_row(name, observation, place, *texts)


if __name__ == "__main__":
    main()
