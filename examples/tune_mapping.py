"""Improve the network that imitates the planner `best` by trial and error, with PPO in PyTorch.

Run: python examples/tune_mapping.py --export tuned.onnx  (needs pip install "shoal[envs]" onnx torch)

The script first trains the network of `learn_mapping.py`, which imitates `best`. Then the network
plays in vector environments, is rewarded for cells that are classified, and pays for moves
(proximal policy optimization: Schulman and others 2017). Commands that cannot have an effect are
masked. Half of the particles are in maps of 300 cells, and half in maps of 1000 cells, so that the
network learns for swarms of different sizes.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import torch
from torch import Tensor, nn

from learn_mapping import HIDDEN, SHARED, SIDE, SUMS, Network, export, features, imitate
from shoal.envs.swarm import FREE, FRONTIER

REACH = 100  # largest distance from the frontier that the network distinguishes, in moves
STEPS, EPOCHS, BATCHES = 64, 3, 8  # of a rollout; passes through it; parts of a pass
DISCOUNT, TRACE, CLIP, ENTROPY = 0.995, 0.95, 0.2, 0.001
RATE, LENGTH = 5e-4, 0.5  # of learning; longest slope
FALL = 300_000  # commands over which the rate falls
WARM = 5  # updates at first, in which only the critic learns
SHARPER = 3.0  # ratings times this: the deployed policy sends the best rated command
REWARDS = {"classified_reward": 0.05, "move_price": 0.2, "final_bonus": 2.0}
COMMANDS = 163_840  # in 40 updates
GROUPS = ((300, 30, 48, 600), (1000, 100, 16, 900))  # cells, particles, environments, longest


class Actor(nn.Module):
    """The network of `learn_mapping.py`, whose first weights are turned in place of the patches."""

    def __init__(self, weights: dict[str, Any]) -> None:
        super().__init__()
        self.parts = nn.ParameterDict(
            {name: nn.Parameter(torch.tensor(value)) for name, value in weights.items()}
        )
        with torch.no_grad():
            self.parts["d"] *= SHARPER
            self.parts["d0"] *= SHARPER

    def forward(self, patches: Tensor, shared: Tensor) -> tuple[Tensor, Tensor]:
        """Return the ratings (states, 4), and what the critic sees, (states, 4, SUMS + SHARED)."""
        w, (states, n) = self.parts, patches.shape[:2]
        kernel = w["a"].T.reshape(HIDDEN, 5, SIDE, SIDE)
        turned = torch.cat([torch.rot90(kernel, -k, (2, 3)) for k in range(4)])
        x = patches.reshape(states * n, -1).float() / 255
        first = torch.relu(x @ turned.reshape(4 * HIDDEN, -1).T + w["a0"].repeat(4))
        second = torch.relu(first.reshape(-1, HIDDEN) @ w["b"] + w["b0"])
        sums = second.reshape(states, n, 4, SUMS).sum(dim=1) / n**0.5
        joined = torch.cat([sums, shared], dim=2)
        third = torch.relu(joined @ w["c"] + w["c0"])
        return (third @ w["d"] + w["d0"])[:, :, 0], joined

    def network(self) -> Network:
        """Return the network in the form that `learn_mapping.export` writes."""
        network = Network(np.random.default_rng(0))
        network.weights = {name: value.detach().numpy() for name, value in self.parts.items()}
        return network


class Critic(nn.Module):
    """What is still to come: from the actor's features, and from numbers of the whole map."""

    def __init__(self) -> None:
        super().__init__()
        inputs = 2 * (SUMS + SHARED) + 4
        self.layers = nn.Sequential(
            nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, 1)
        )

    def forward(self, joined: Tensor, numbers: Tensor) -> Tensor:
        """Return the value of each state, (states,)."""
        seen = joined.detach()
        inputs = torch.cat([seen.mean(dim=1), seen.amax(dim=1), numbers], dim=1)
        return self.layers(inputs)[:, 0] * 10


@dataclass
class Rollout:
    """What a group of environments showed in a rollout: states, commands, gains and returns."""

    patches: Tensor
    shared: Tensor
    numbers: Tensor
    masks: Tensor
    actions: Tensor
    likelihoods: Tensor
    gains: Tensor
    returns: Tensor


class Group:
    """Vector environments of maps of one size, and the rollouts in them."""

    def __init__(
        self, cells: int, particles: int, count: int, longest: int, maps: range, seed: int
    ) -> None:
        self.cells, self.count = cells, count
        self.envs = gymnasium.make_vec(
            "shoal/Mapping-v0",
            num_envs=count,
            maps=[f"vessels:{cells}:{k}" for k in maps],
            particles=particles,
            max_moves=longest,
            observation="planes",
            autoreset_mode="SameStep",
            **REWARDS,
        )
        self.planes, self.infos = self.envs.reset(seed=seed)
        self.last, self.lengths = np.full(count, -1), [0.0]

    def seen(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return patches, numbers of the commands, numbers of the map, and masks."""
        patches, shared = features(self.planes, self.last, REACH)
        free, edge = ((self.planes[:, k] > 0).sum(axis=(1, 2)) for k in (FREE, FRONTIER))
        numbers = np.stack(
            [
                free / self.cells,
                edge / self.cells,
                edge / 100,
                np.full(self.count, self.cells / 1e3),
            ],
            axis=1,
        )
        arrays = patches, shared, numbers.astype(np.float32), self.infos["action_mask"] == 0
        return tuple(torch.from_numpy(np.ascontiguousarray(array)) for array in arrays)  # type: ignore[return-value]

    def play(self, actor: Actor, critic: Critic) -> Rollout:
        """Play a rollout with commands drawn by the ratings."""
        rows: list[tuple[Tensor, ...]] = []
        values, rewards, ended = [], [], []
        self.lengths = []
        for _ in range(STEPS):
            *state, blocked = self.seen()
            with torch.no_grad():
                policy, value = judge(actor, critic, *state, blocked)
                action = policy.sample()
            rows.append((*state, blocked, action, policy.log_prob(action)))
            self.last = action.numpy()
            self.planes, reward, terminated, truncated, self.infos = self.envs.step(self.last)
            over = terminated | truncated
            if over.any():
                self.lengths += self.infos["final_info"]["moves"][over].tolist()
                self.last = np.where(over, -1, self.last)
            values.append(value.numpy())
            rewards.append(reward)
            ended.append(over)
        with torch.no_grad():
            values.append(judge(actor, critic, *self.seen())[1].numpy())
        gains, gain = np.empty((STEPS, self.count), np.float32), np.zeros(self.count)
        for step in reversed(range(STEPS)):
            goes_on = DISCOUNT * ~ended[step]
            gain = rewards[step] + goes_on * (values[step + 1] + TRACE * gain) - values[step]
            gains[step] = gain
        returns = gains + np.stack(values[:-1])
        parts = [torch.cat(part) for part in zip(*rows, strict=True)]
        return Rollout(*parts, torch.from_numpy(gains.ravel()), torch.from_numpy(returns.ravel()))


def judge(
    actor: Actor, critic: Critic, patches: Tensor, shared: Tensor, numbers: Tensor, blocked: Tensor
) -> tuple[torch.distributions.Categorical, Tensor]:
    """Return the distribution of the commands, and the values."""
    ratings, joined = actor(patches, shared)
    ratings = ratings.masked_fill(blocked, -1e9)
    return torch.distributions.Categorical(logits=ratings), critic(joined, numbers)


def improve(
    actor: Actor, critic: Critic, optimizer: Any, rollouts: list[Rollout], *, warm: bool
) -> float:
    """Go through the rollouts, and return how far the policy went from the old one (KL
    divergence, nats); while ``warm``, only the critic learns.
    """
    far: list[float] = []
    for one in rollouts:
        one.gains = (one.gains - one.gains.mean()) / (one.gains.std() + 1e-8)
    for _ in range(EPOCHS):
        orders = [torch.randperm(len(one.actions)).chunk(BATCHES) for one in rollouts]
        for parts in zip(*orders, strict=True):
            optimizer.zero_grad()
            total = sum(len(part) for part in parts)
            for one, part in zip(rollouts, parts, strict=True):
                state = one.patches[part], one.shared[part], one.numbers[part], one.masks[part]
                policy, value = judge(actor, critic, *state)
                logs = policy.log_prob(one.actions[part]) - one.likelihoods[part]
                ratio, gains = logs.exp(), one.gains[part]
                gain = torch.min(ratio * gains, ratio.clamp(1 - CLIP, 1 + CLIP) * gains).mean()
                error = (value - one.returns[part]).square().mean() / 10
                loss = error if warm else error - gain - ENTROPY * policy.entropy().mean()
                (loss * len(part) / total).backward()
                far.append(float((ratio - 1 - logs).mean().detach()))
            nn.utils.clip_grad_norm_([*actor.parameters(), *critic.parameters()], LENGTH)
            optimizer.step()
    return float(np.mean(far[-len(rollouts) * BATCHES :]))


def tune(network: Network, *, commands: int, maps: range, seed: int) -> Network:
    """Return the network after so many commands of trial and error."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    actor, critic = Actor(network.weights), Critic()
    optimizer = torch.optim.Adam([*actor.parameters(), *critic.parameters()], lr=RATE, eps=1e-5)
    groups = [Group(*group, maps=maps, seed=seed) for group in GROUPS]
    each, begun = STEPS * sum(group.count for group in groups), time.process_time()
    for played in range(0, commands, each):
        for setting in optimizer.param_groups:
            setting["lr"] = RATE * max(0.05, 1 - 0.95 * played / FALL)
        rollouts = [group.play(actor, critic) for group in groups]
        far = improve(actor, critic, optimizer, rollouts, warm=played < WARM * each)
        told = " and ".join(
            f"{np.mean(group.lengths or [np.nan]):.0f} of {group.cells} cells" for group in groups
        )
        seconds = time.process_time() - begun
        print(
            f"{played + each:>8} commands, {seconds:5.0f} CPU s: moves of a map: {told}; KL {far:.4f}",
            flush=True,
        )
    return actor.network()


def main(arguments: list[str] | None = None) -> None:
    """Train the network, and write it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--commands", type=int, default=COMMANDS, help="of trial and error")
    parser.add_argument("--first", type=int, default=2000, help="number of the first map")
    parser.add_argument("--maps", type=int, default=200, help="maps of each size")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--export", metavar="FILE", required=True, help="ONNX file to write")
    given = parser.parse_args(arguments)
    begun = time.process_time()
    learner = imitate(seed=given.seed, maps=range(given.first, given.first + 60))
    maps = range(given.first, given.first + given.maps)
    network = tune(learner.network, commands=given.commands, maps=maps, seed=given.seed)
    export(network, given.export, reach=REACH)
    print(f"trained in {time.process_time() - begun:.0f} CPU s")


if __name__ == "__main__":
    main()
