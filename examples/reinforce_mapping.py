"""Learn to map vessels by trial and error, with PPO on a vector environment, and compare on maps
that were not seen.

Run: python examples/reinforce_mapping.py --plot curve.png  (needs pip install "shoal[envs]"; two minutes of one core)

The policy sees the 21 numbers of the observation `compact` and its own last command. A small
network rates each command by these numbers, turned so that the command points to the left, so that
one network serves all four. Nobody shows it what to do: it is rewarded for cells that are
classified, and pays for moves (proximal policy optimization: Schulman and others 2017). NumPy is
all that it needs.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import shoal
import shoal.envs

Floats = NDArray[np.float32]

INPUTS, HIDDEN, SECOND = 25, 64, 32  # sizes of the layers
ENVIRONMENTS, STEPS = 128, 64  # at once, and of each between two updates
EPOCHS, BATCH = 4, 1024  # passes through what was played, and states a step of the optimizer
DISCOUNT, TRACE, CLIP, ENTROPY = 0.995, 0.95, 0.2, 0.005
REWARDS = {"classified_reward": 0.05, "move_price": 0.2, "final_bonus": 2.0}
AHEAD = np.array(
    [(0, -1), (-1, 0), (0, 1), (1, 0)], dtype=np.float32
)  # row and column of l, u, r, d


def turned(seen: Floats, last: NDArray[np.int64]) -> Floats:
    """Return what the network sees of each command; float32, shape (states, 4, INPUTS).

    By command, clockwise from this one on: particles that would find something, that can move, the
    path to the frontier, the last command. Then, ahead and to its right: the way to the frontier,
    the swarm's middle and its spread. And three numbers.
    """
    by_command = [
        seen[:, :4],
        seen[:, 4:8],
        seen[:, 8:12],
        (last[:, None] == np.arange(4)).astype(np.float32),
    ]
    inputs = np.empty((len(seen), 4, INPUTS), dtype=np.float32)
    for command in range(4):
        parts = [np.roll(part, -command, axis=1) for part in by_command]
        ways = AHEAD[[command, (command + 1) % 4]].T
        parts += [
            seen[:, 13:15] @ ways,
            (seen[:, 15:17] - 0.5) @ ways,
            seen[:, 17:19] @ np.abs(ways),
            seen[:, [12, 19, 20]],
        ]
        inputs[:, command] = np.concatenate(parts, axis=1)
    return inputs


class Network:
    """Two layers; of each command a rating, and of the state, as the mean over its commands, what
    is still to come.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.weights: dict[str, Floats] = {}
        for name, (inputs, outputs, scale) in {
            "a": (INPUTS, HIDDEN, 1),
            "b": (HIDDEN, SECOND, 1),
            "c": (SECOND, 2, 0.1),
        }.items():
            self.weights[name] = (
                rng.normal(size=(inputs, outputs)) * scale / np.sqrt(inputs)
            ).astype(np.float32)
            self.weights[name + "0"] = np.zeros(outputs, dtype=np.float32)
        self.means = {name: np.zeros_like(weight) for name, weight in self.weights.items()}
        self.squares = {name: np.zeros_like(weight) for name, weight in self.weights.items()}
        self.updates = 0

    def forward(
        self, inputs: Floats, mask: NDArray[np.int8]
    ) -> tuple[Floats, Floats, tuple[Floats, ...]]:
        """Return the chances of the commands (states, 4), the values (states,), and what `slopes`
        needs.
        """
        w, x = self.weights, inputs.reshape(-1, INPUTS)
        first = np.tanh(x @ w["a"] + w["a0"])
        second = np.tanh(first @ w["b"] + w["b0"])
        out = (second @ w["c"] + w["c0"]).reshape(-1, 4, 2)
        ratings = np.where(mask > 0, out[:, :, 0], -1e9)
        chances = np.exp(ratings - ratings.max(axis=1, keepdims=True))
        return (
            chances / chances.sum(axis=1, keepdims=True),
            out[:, :, 1].mean(axis=1),
            (x, first, second),
        )

    def slopes(
        self, kept: tuple[Floats, ...], of_ratings: Floats, of_values: Floats
    ) -> dict[str, Floats]:
        """Return the slopes of all weights from those of the ratings (states, 4) and of the values
        (states,).
        """
        (x, first, second), w = kept, self.weights
        up = np.stack([of_ratings, np.repeat(of_values[:, None] / 4, 4, axis=1)], axis=2).reshape(
            -1, 2
        )
        found = {"c": second.T @ up, "c0": up.sum(axis=0)}
        up = (up @ w["c"].T) * (1 - second * second)
        found |= {"b": first.T @ up, "b0": up.sum(axis=0)}
        up = (up @ w["b"].T) * (1 - first * first)
        return found | {"a": x.T @ up, "a0": up.sum(axis=0)}

    def step(self, slopes: dict[str, Floats], rate: float) -> None:
        """Take one step of Adam, no longer than slopes of length 1/2 make it."""
        self.updates += 1
        length = np.sqrt(sum(float((slope**2).sum()) for slope in slopes.values()))
        for name, slope in slopes.items():
            cut = slope * min(1.0, 0.5 / max(length, 1e-9))
            self.means[name] += 0.1 * (cut - self.means[name])
            self.squares[name] += 0.001 * (cut * cut - self.squares[name])
            mean, square = (
                self.means[name] / (1 - 0.9**self.updates),
                self.squares[name] / (1 - 0.999**self.updates),
            )
            self.weights[name] -= (rate * mean / (np.sqrt(square) + 1e-8)).astype(np.float32)


def slopes_of_loss(
    chances: Floats,
    values: Floats,
    actions: NDArray[np.int64],
    old: Floats,
    gains: Floats,
    returns: Floats,
) -> tuple[Floats, Floats]:
    """Return the slopes of PPO's loss in the ratings and in the values: clipped gain, entropy, and
    error of the values.
    """
    states, count = np.arange(len(actions)), len(actions)
    ratio = chances[states, actions] / old
    clipped = np.where(gains > 0, ratio > 1 + CLIP, ratio < 1 - CLIP)
    of_log = np.where(clipped, 0.0, -ratio * gains)[:, None]
    chosen = np.zeros_like(chances)
    chosen[states, actions] = 1
    logs = np.log(chances + 1e-12)
    entropy = -(chances * logs).sum(axis=1, keepdims=True)
    of_ratings = of_log * (chosen - chances) + ENTROPY * chances * (logs + entropy)
    return (of_ratings / count).astype(np.float32), (0.5 * (values - returns) / count).astype(
        np.float32
    )


def drawn(chances: Floats, rng: np.random.Generator) -> NDArray[np.int64]:
    """Draw a command for each state."""
    return np.minimum((chances.cumsum(axis=1) < rng.random((len(chances), 1))).sum(axis=1), 3)


def environments(names: list[str], count: int, given: argparse.Namespace, max_moves: int) -> Any:
    """Return environments whose episodes draw one of the maps."""
    return gymnasium.make_vec(
        "shoal/Mapping-v0",
        num_envs=count,
        maps=names,
        particles=given.particles,
        max_moves=max_moves,
        observation="compact",
        autoreset_mode="SameStep",
        **REWARDS,
    )


def learn(
    network: Network, given: argparse.Namespace, rng: np.random.Generator
) -> list[tuple[int, float]]:
    """Play so many commands, and learn; return (commands so far, mean moves of the episodes that
    ended) of each update.
    """
    envs = environments(
        [f"vessels:{given.cells}:{k}" for k in range(given.maps)],
        ENVIRONMENTS,
        given,
        given.longest,
    )
    seen, infos = envs.reset(seed=given.seed)
    last, curve, begun = np.full(ENVIRONMENTS, -1), [], time.perf_counter()
    shape = (STEPS, ENVIRONMENTS)
    for played_before in range(0, given.commands, STEPS * ENVIRONMENTS):
        inputs, masks = (
            np.empty((*shape, 4, INPUTS), dtype=np.float32),
            np.empty((*shape, 4), dtype=np.int8),
        )
        actions, ended = np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.bool_)
        rewards, chance = np.empty(shape), np.empty(shape, dtype=np.float32)
        values, lengths = np.empty((STEPS + 1, ENVIRONMENTS)), []
        for step in range(STEPS):
            inputs[step], masks[step] = turned(seen, last), infos["action_mask"]
            chances, values[step], _ = network.forward(inputs[step], masks[step])
            actions[step] = last = drawn(chances, rng)
            chance[step] = np.take_along_axis(chances, last[:, None], axis=1)[:, 0]
            seen, rewards[step], terminated, truncated, infos = envs.step(last)
            ended[step] = terminated | truncated
            if ended[step].any():
                lengths += infos["final_info"]["moves"][ended[step]].tolist()
                last = np.where(ended[step], -1, last)
        values[STEPS] = network.forward(turned(seen, last), infos["action_mask"])[1]
        gains, gain = np.empty(shape), np.zeros(ENVIRONMENTS)
        for step in reversed(range(STEPS)):
            goes_on = ~ended[step]
            gain = (
                rewards[step]
                + DISCOUNT * values[step + 1] * goes_on
                - values[step]
                + DISCOUNT * TRACE * goes_on * gain
            )
            gains[step] = gain
        rate = 1e-3 * (1 - 0.95 * played_before / given.commands)
        improve(network, inputs, masks, actions, chance, gains, gains + values[:-1], rng, rate=rate)
        curve.append((played_before + STEPS * ENVIRONMENTS, float(np.mean(lengths or [np.nan]))))
        if len(curve) % 20 == 1:
            print(
                f"{curve[-1][0]:>9} commands, {time.perf_counter() - begun:4.0f} s:"
                f" {curve[-1][1]:.0f} moves per map",
                flush=True,
            )
    print(f"trained with {curve[-1][0]} commands in {time.perf_counter() - begun:.0f} s")
    return curve


def improve(
    network: Network,
    inputs: Floats,
    masks: NDArray[np.int8],
    actions: NDArray[np.int64],
    chance: Floats,
    gains: NDArray[Any],
    returns: NDArray[Any],
    rng: np.random.Generator,
    *,
    rate: float,
) -> None:
    """Go some times through what was played."""
    inputs, masks = inputs.reshape(-1, 4, INPUTS), masks.reshape(-1, 4)
    actions, chance, returns, gains = (
        actions.ravel(),
        chance.ravel(),
        returns.ravel(),
        gains.ravel(),
    )
    gains = (gains - gains.mean()) / (gains.std() + 1e-8)
    for _ in range(EPOCHS):
        for some in np.array_split(rng.permutation(len(actions)), max(1, len(actions) // BATCH)):
            chances, values, kept = network.forward(inputs[some], masks[some])
            of_loss = slopes_of_loss(
                chances, values, actions[some], chance[some], gains[some], returns[some]
            )
            network.step(network.slopes(kept, *of_loss), rate)


def played(
    network: Network, names: list[str], given: argparse.Namespace, rng: np.random.Generator
) -> list[int]:
    """Return the moves that the policy needs on each of the maps, from the starts of `shoal.run`
    with the seeds 0, 1, ...
    """
    envs = environments(names, len(names), given, given.max_moves)
    seen, infos = envs.reset(seed=0, options={"map": np.arange(len(names))})
    last, moves = np.full(len(names), -1), np.zeros(len(names), dtype=np.int64)
    while not moves.all():
        last = drawn(network.forward(turned(seen, last), infos["action_mask"])[0], rng)
        seen, _, terminated, truncated, infos = envs.step(last)
        first = (terminated | truncated) & (moves == 0)
        if first.any():
            moves[first] = infos["final_info"]["moves"][first]
    return [int(count) for count in moves]


def compare(
    network: Network, given: argparse.Namespace, rng: np.random.Generator
) -> dict[str, list[int]]:
    """Print the table of all policies on maps that were not learned from; return their moves."""
    names = [f"vessels:{given.cells}:{k}" for k in range(1000, 1000 + given.tests)]
    moves: dict[str, list[int]] = {}
    for policy in ("random-moves", "closest-frontier", "greedy-classify", "best"):
        common = {"particles": given.particles, "policy": policy, "max_moves": given.max_moves}
        moves[policy] = [shoal.run(name, seed=k, **common).moves for k, name in enumerate(names)]
    moves["learned (this script)"] = played(network, names, given, rng)
    print(
        f"\n| policy | moves, mean of {len(names)} maps | standard error | times `best` |"
        " unfinished |\n|---|---|---|---|---|"
    )
    for policy, counts in sorted(moves.items(), key=lambda each: -np.mean(each[1])):
        mean, error = (
            np.mean(counts),
            np.std(counts, ddof=min(1, len(counts) - 1)) / np.sqrt(len(counts)),
        )
        unfinished = sum(count >= given.max_moves for count in counts)
        print(
            f"| {policy} | {mean:.1f} | {error:.1f} | {mean / np.mean(moves['best']):.2f} |"
            f" {unfinished} |"
        )
    return moves


def draw(curve: list[tuple[int, float]], moves: dict[str, list[int]], path: str) -> None:
    """Draw the moves per map during learning, and the means of all policies except random-moves."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    commands, lengths = np.reshape(
        [point for point in curve if point[1] > 0], (-1, 2)
    ).T  # at first no episode has ended
    axes.plot(commands / 1e6, lengths, color="#0072b2", linewidth=1)
    means = sorted(
        (float(np.mean(counts)), policy)
        for policy, counts in moves.items()
        if policy != "random-moves"
    )
    place = 0.0
    named: dict[str, Any] = {"xycoords": ("axes fraction", "data"), "va": "center"}
    for (mean, policy), colour in zip(
        means, ["#00684b", "#8a5a00", "#0072b2", "#b24a00"], strict=True
    ):
        place = max(mean, place * 1.07)  # of the name, which stays clear of the one below
        axes.axhline(mean, color=colour, linestyle="--", linewidth=1)
        axes.annotate(f"{policy.split()[0]} {mean:.0f}", (1.02, place), color=colour, **named)
    axes.set(
        xlabel="commands, millions",
        ylabel="moves per map",
        yscale="log",
        ylim=(100, 700),
        xlim=(0, None),
    )
    axes.yaxis.set_major_formatter("{x:.0f}")
    axes.set_yticks([100, 200, 300, 400, 600])
    axes.yaxis.set_minor_formatter("")
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)


def main(arguments: list[str] | None = None) -> None:
    """Learn, compare, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cells", type=int, default=300, help="size of the maps")
    parser.add_argument("--particles", type=int, default=30)
    parser.add_argument(
        "--maps", type=int, default=60, help="maps to learn from: numbers 0, 1, ..."
    )
    parser.add_argument("--commands", type=int, default=5_000_000, help="commands to learn from")
    parser.add_argument(
        "--longest", type=int, default=600, help="moves of an episode to learn from, at most"
    )
    parser.add_argument(
        "--tests", type=int, default=50, help="maps to compare on: numbers 1000, 1001, ..."
    )
    parser.add_argument(
        "--max-moves", type=int, default=3000, help="longest episode; random moves take longer"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--plot", help="file to draw the learning curve in")
    given = parser.parse_args(arguments)
    rng = np.random.default_rng(given.seed)
    network = Network(rng)
    curve = learn(network, given, rng)
    moves = compare(network, given, rng)
    if given.plot:
        draw(curve, moves, given.plot)


if __name__ == "__main__":
    main()
