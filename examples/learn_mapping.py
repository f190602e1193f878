"""Train a small network that maps vessels by imitating the planner `best`, and compare it with
other policies on new maps.

Run: python examples/learn_mapping.py  (needs pip install "shoal[envs]"; ten minutes on one core)

The network rates each command from the cells around every particle. A patch of the map around the
particle is turned so that the command points to the left. A shared layer processes each patch. The
sum over all particles, together with a few numbers of the whole swarm, gives the rating. So one
network works for all four commands, any map and any number of particles. It first imitates `best`
in the episodes of `best`, and then in its own episodes, which contain its own mistakes (DAgger:
Ross, Gordon, Bagnell 2011). The script needs only NumPy.
"""

from __future__ import annotations

import argparse
import time
from itertools import count
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import shoal
import shoal.envs
from shoal.envs.swarm import FREE, FRONTIER, OBSTACLES, PARTICLES
from shoal.swarm import make_policy
from shoal.swarm.grid.board import LETTERS

Floats = NDArray[np.float32]

SIDE = 9  # side of a patch, in cells
REACH = 40  # largest distance from the frontier that the network distinguishes, in moves
HIDDEN, SUMS, RATERS = 48, 12, 24  # sizes of the layers
BATCH = 64  # states in each training step
SHARED = 5  # numbers of the whole swarm for each command


# Inputs of the network.


def distances(planes: NDArray[np.uint8], reach: int = REACH) -> NDArray[np.uint8]:
    """Return each cell's distance from the frontier through known free cells, in moves, at most
    ``reach``; uint8, (worlds, H, W).
    """
    free, edge = planes[:, FREE] > 0, planes[:, FRONTIER] > 0
    found = np.where(edge, np.uint8(0), np.uint8(reach))
    for step in range(1, reach):
        grown = np.zeros_like(edge)
        grown[:, 1:] |= edge[:, :-1]
        grown[:, :-1] |= edge[:, 1:]
        grown[:, :, 1:] |= edge[:, :, :-1]
        grown[:, :, :-1] |= edge[:, :, 1:]
        edge = grown & free & (found == reach)
        if not edge.any():
            break
        found[edge] = step
    return found


def features(
    planes: NDArray[np.uint8], last: NDArray[np.int64], reach: int = REACH
) -> tuple[NDArray[np.uint8], Floats]:
    """Return each particle's patch, uint8, (worlds, n, 5, SIDE, SIDE), and numbers of the swarm for
    each command, float32, (worlds, 4, SHARED); ``last`` holds the last commands, -1 for none.
    """
    worlds, half = len(planes), SIDE // 2
    far = distances(planes, reach)
    steps = np.arange(reach + 1)
    near = np.rint(255 * np.exp(steps / -6.0) * (steps < reach)).astype(np.uint8)[far]
    seen = 255 * planes[:, [FREE, OBSTACLES, FRONTIER, PARTICLES]].clip(0, 1)
    padded = np.pad(
        np.concatenate([seen, near[:, None]], axis=1), ((0, 0), (0, 0), (half, half), (half, half))
    )
    windows = np.lib.stride_tricks.sliding_window_view(padded, (SIDE, SIDE), axis=(2, 3))
    world, rows, columns = np.nonzero(planes[:, PARTICLES])
    each = (worlds, len(rows) // worlds)  # all worlds have the same number of particles
    shared = np.zeros((worlds, 4, SHARED), dtype=np.float32)
    here = far[world, rows, columns].astype(int).reshape(each)
    closest = here.min(axis=1, keepdims=True)
    for command, (down, right) in enumerate([(0, -1), (-1, 0), (0, 1), (1, 0)]):
        there = far[world, rows + down, columns + right].reshape(each)
        entered = planes[world, FRONTIER, rows + down, columns + right].reshape(each)
        goes_on = (here == closest) & (there < here)
        shared[:, command] = np.stack(
            [
                goes_on.any(axis=1) / np.maximum(1, closest[:, 0]),
                entered.mean(axis=1) * 4,
                (there < here).mean(axis=1),
                last == command,
                last == (command + 2) % 4,
            ],
            axis=1,
        )
    return windows[world, :, rows, columns].reshape(*each, 5, SIDE, SIDE), shared


# The network, with its gradients written out.


class Network:
    """The network: one layer for each particle's turned patch, a sum over the particles, and two
    more layers.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        sizes = {
            "a": (5 * SIDE * SIDE, HIDDEN),
            "b": (HIDDEN, SUMS),
            "c": (SUMS + SHARED, RATERS),
            "d": (RATERS, 1),
        }
        self.weights: dict[str, Floats] = {}
        for name, (inputs, outputs) in sizes.items():
            self.weights[name] = (rng.normal(size=(inputs, outputs)) * np.sqrt(2 / inputs)).astype(
                np.float32
            )
            self.weights[name + "0"] = np.zeros(outputs, dtype=np.float32)
        self.means = {name: np.zeros_like(weight) for name, weight in self.weights.items()}
        self.squares = {name: np.zeros_like(weight) for name, weight in self.weights.items()}
        self.updates = 0

    def forward(
        self, patches: NDArray[np.uint8], shared: Floats, *, mirrored: bool = False
    ) -> tuple[Floats, tuple[Any, ...]]:
        """Return the ratings of states, float32, (states, 4), and the data for `learn`; patches are
        (states, n, 5, SIDE, SIDE).
        """
        w, (states, n) = self.weights, patches.shape[:2]
        turned = np.stack([np.rot90(patches, k, axes=(3, 4)) for k in range(4)], axis=1)
        if mirrored:
            turned = turned[:, :, :, :, ::-1]
        x = turned.reshape(states * 4 * n, -1).astype(np.float32) / 255
        first = np.maximum(x @ w["a"] + w["a0"], 0)
        second = np.maximum(first @ w["b"] + w["b0"], 0)
        sums = second.reshape(states * 4, n, SUMS).sum(axis=1) / np.float32(np.sqrt(n))
        joined = np.concatenate([sums, shared.reshape(states * 4, SHARED)], axis=1)
        third = np.maximum(joined @ w["c"] + w["c0"], 0)
        return (third @ w["d"] + w["d0"]).reshape(states, 4), (x, first, second, joined, third, n)

    def learn(
        self,
        patches: NDArray[np.uint8],
        shared: Floats,
        labels: NDArray[np.int64],
        *,
        rate: float,
        mirrored: bool,
    ) -> float:
        """Reduce the cross entropy of the labels by one step of Adam; return the cross entropy."""
        w = self.weights
        ratings, (x, first, second, joined, third, n) = self.forward(
            patches, shared, mirrored=mirrored
        )
        chances = np.exp(ratings - ratings.max(axis=1, keepdims=True))
        chances /= chances.sum(axis=1, keepdims=True)
        states = np.arange(len(labels))
        loss = -float(np.log(chances[states, labels] + 1e-9).mean())
        chances[states, labels] -= 1
        up = (chances / len(labels)).reshape(-1, 1)
        slopes = {"d": third.T @ up, "d0": up.sum(axis=0)}
        up = (up @ w["d"].T) * (third > 0)
        slopes |= {"c": joined.T @ up, "c0": up.sum(axis=0)}
        up = np.repeat((up @ w["c"].T)[:, :SUMS] / np.float32(np.sqrt(n)), n, axis=0) * (second > 0)
        slopes |= {"b": first.T @ up, "b0": up.sum(axis=0)}
        up = (up @ w["b"].T) * (first > 0)
        slopes |= {"a": x.T @ up, "a0": up.sum(axis=0)}
        self.updates += 1
        for name, slope in slopes.items():
            self.means[name] += 0.1 * (slope - self.means[name])
            self.squares[name] += 0.001 * (slope * slope - self.squares[name])
            mean, square = (
                self.means[name] / (1 - 0.9**self.updates),
                self.squares[name] / (1 - 0.999**self.updates),
            )
            w[name] -= (rate * mean / (np.sqrt(square) + 1e-8)).astype(np.float32)
        return loss


def export(network: Network, path: str, reach: int = REACH) -> None:
    """Write the network as an ONNX file, which the policy ``model:FILE`` runs.

    The file computes the inputs of the network, too: the distances from the frontier up to
    ``reach``, step by step, and the patches. It turns the first weights in place of the patches.
    """
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    w, nodes, constants, names = network.weights, [], [], count()

    def constant(values: Any, dtype: Any = np.float32) -> str:
        constants.append(numpy_helper.from_array(np.array(values, dtype), f"constant{next(names)}"))
        return str(constants[-1].name)

    def node(kind: str, *inputs: str, **attributes: Any) -> str:
        nodes.append(helper.make_node(kind, inputs, [f"{kind}{next(names)}"], **attributes))
        return str(nodes[-1].output[0])

    def over_cells(kind: str, values: str) -> str:
        return node(kind, values, constant([2, 3], np.int64), keepdims=0)

    def plane(index: int) -> str:
        bounds = (constant([k], np.int64) for k in (index, index + 1, 1))
        return node("Slice", "planes", *bounds)

    one = constant(1.0)
    particles = node("Min", plane(PARTICLES), one)
    free, frontier = plane(FREE), plane(FRONTIER)
    near, far = frontier, node("Sub", one, frontier)
    for _ in range(1, reach):
        wide = node("MaxPool", near, kernel_shape=[1, 3], pads=[0, 1, 0, 1])
        high = node("MaxPool", near, kernel_shape=[3, 1], pads=[1, 0, 1, 0])
        near = node("Max", near, node("Mul", node("Max", wide, high), free))
        far = node("Add", far, node("Sub", one, near))
    glow = node("Mul", node("Exp", node("Mul", far, constant(-1 / 6))), constant(255.0))
    glow = node("Div", node("Round", node("Mul", glow, near)), constant(255.0))
    stack = node("Concat", free, plane(OBSTACLES), frontier, particles, glow, axis=1)
    margin = SIDE // 2
    padded = node("Pad", stack, constant([0, 0, margin, margin] * 2, np.int64))
    width = node("Gather", node("Shape", padded), constant([3], np.int64))
    cells = node("NonZero", particles)
    row, column = (node("Gather", cells, constant([axis], np.int64)) for axis in (2, 3))
    down, right = (constant(one.reshape(-1, 1), np.int64) for one in np.indices((SIDE, SIDE)))
    places = node("Mul", node("Add", row, down), width)
    places = node("Add", places, node("Add", column, right))
    flat = node("Reshape", padded, constant([5, -1], np.int64))
    patches = node("Gather", flat, places, axis=1)  # (5, SIDE * SIDE, particles)
    patches = node("Reshape", patches, constant([5 * SIDE * SIDE, -1], np.int64))
    kernel = w["a"].T.reshape(HIDDEN, 5, SIDE, SIDE)
    turned = [np.rot90(kernel, -k, axes=(2, 3)).reshape(HIDDEN, -1) for k in range(4)]
    first = node("Add", node("MatMul", constant(turned), patches), constant(w["a0"][:, None]))
    second = node("MatMul", constant(w["b"].T), node("Relu", first))
    second = node("Relu", node("Add", second, constant(w["b0"][:, None])))
    number = over_cells("ReduceSum", particles)
    sums = node("ReduceSum", second, constant([2], np.int64), keepdims=0)
    sums = node("Div", sums, node("Sqrt", number))
    shift = np.zeros((4, 1, 3, 3))
    shift[range(4), 0, [1, 0, 1, 2], [0, 1, 2, 1]] = 1
    there, edge = (node("Conv", part, constant(shift), pads=[1] * 4) for part in (far, frontier))
    absent = node("Mul", node("Sub", one, particles), constant(1e3))
    closest = node("ReduceMin", node("Add", far, absent), keepdims=1)
    nearer = node("Mul", node("Cast", node("Less", there, far), to=TensorProto.FLOAT), particles)
    nearest = node("Cast", node("Equal", far, closest), to=TensorProto.FLOAT)
    least = node("Reshape", node("Max", closest, one), constant([1, 1], np.int64))
    shared = [
        node(
            "Div", node("ReduceMax", node("Mul", nearer, nearest), axes=[2, 3], keepdims=0), least
        ),
        node(
            "Mul",
            node("Div", over_cells("ReduceSum", node("Mul", edge, particles)), number),
            constant(4.0),
        ),
        node("Div", over_cells("ReduceSum", nearer), number),
        "last",
        node("Gather", "last", constant([2, 3, 0, 1], np.int64), axis=1),
    ]
    told = node("Transpose", node("Concat", *shared, axis=0), perm=[1, 0])
    joined = node("Concat", sums, told, axis=1)
    third = node("Relu", node("Gemm", joined, constant(w["c"]), constant(w["c0"])))
    ratings = node("Gemm", third, constant(w["d"]), constant(w["d0"]))
    nodes.append(helper.make_node("Transpose", [ratings], ["ratings"], perm=[1, 0]))
    real = TensorProto.FLOAT
    graph = helper.make_graph(
        nodes,
        "mapping",
        [
            helper.make_tensor_value_info("planes", real, [1, 4, "height", "width"]),
            helper.make_tensor_value_info("last", real, [1, 4]),
        ],
        [helper.make_tensor_value_info("ratings", real, [1, 4])],
        constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, path)


# Episodes.


class Learner:
    """The network as a policy: the best rated command that changes something; a random one, by
    rating, without progress.
    """

    def __init__(self, network: Network, rng: np.random.Generator) -> None:
        self.network, self.rng = network, rng

    def choose(
        self, seen: tuple[NDArray[np.uint8], Floats], mask: NDArray[np.int8], idle: int
    ) -> int:
        """Return a command; ``idle`` is the number of moves since the last classified cell."""
        ratings = self.network.forward(*seen)[0][0].astype(float)
        ratings[mask == 0] = -np.inf
        if idle < 20:
            return int(ratings.argmax())
        chances = np.exp(ratings - ratings.max())
        return int(self.rng.choice(4, p=chances / chances.sum()))


def play(
    env: Any,
    learner: Learner | None,
    expert: Any,
    data: list[Any],
    rng: np.random.Generator,
    **reset: Any,
) -> int:
    """Run an episode of the learner (or of the expert); add pairs (input, expert's command) to
    data; return the moves.
    """
    _, info = env.reset(**reset)
    env, plan, memory, last, idle = env.unwrapped, "", None, -1, 0
    while True:
        seen = features(env.planes[None], np.array([last]))
        if learner is None:
            if not plan:
                plan, memory = expert.decide(env.view, memory, rng)
            action, plan = LETTERS.index(plan[0]), plan[1:]
            data.append((seen[0][0], seen[1][0], action))
        else:
            action = learner.choose(seen, info["action_mask"], idle)
            if expert is not None and rng.random() < 0.5:  # successive states are very similar
                label = LETTERS.index(expert.decide(env.view, None, rng)[0][0])
                data.append((seen[0][0], seen[1][0], label))
        left = info["frontier"]
        _, reward, terminated, truncated, info = env.step(action)
        last, idle = (
            action,
            0 if reward > -env.options.move_price or info["frontier"] != left else idle + 1,
        )
        if terminated or truncated:
            return int(info["moves"])


def train(
    network: Network,
    data: list[Any],
    epochs: int,
    rng: np.random.Generator,
    *,
    batch: int = 64,
    rate: float = 1e-3,
) -> float:
    """Train for a number of passes over the data; return the loss of the last pass."""
    patches, shared, labels = (np.array(part) for part in zip(*data, strict=True))
    losses: list[float] = []
    for epoch in range(epochs):
        order = rng.permutation(len(labels))
        falling = rate * (1 - 0.9 * epoch / epochs)
        losses = []
        for chosen in np.array_split(order, max(1, len(order) // BATCH)):
            mirrored = bool(rng.random() < 0.5)
            losses.append(
                network.learn(
                    patches[chosen], shared[chosen], labels[chosen], rate=falling, mirrored=mirrored
                )
            )
    return float(np.mean(losses))


def environment(names: list[str], particles: int, max_moves: int) -> Any:
    """Return an environment in which each episode draws one of the maps."""
    return gymnasium.make(
        "shoal/Mapping-v0",
        maps=names,
        particles=particles,
        max_moves=max_moves,
        observation="window",
        window=3,
    )


def evaluate(learner: Learner, cells: int, particles: int, maps: range, max_moves: int) -> str:
    """Return the table of all policies on the maps; all policies have the same starts."""
    names = [f"vessels:{cells}:{k}" for k in maps]
    env = environment(names, particles, max_moves)
    rng = np.random.default_rng(0)

    def moves_of(policy: str) -> list[int]:
        common = {"particles": particles, "policy": policy, "max_moves": max_moves}
        return [shoal.run(name, seed=k, **common).moves for k, name in enumerate(names)]

    moves = {
        policy: moves_of(policy)
        for policy in ("random-moves", "closest-frontier", "greedy-classify")
    }
    moves["learned (this script)"] = [
        play(env, learner, None, [], rng, seed=k, options={"map": k}) for k in range(len(names))
    ]
    moves["best"] = moves_of("best")
    rows = [
        (
            f"| policy | moves, mean of {len(names)} maps | standard error | times `best` |"
            " unfinished |"
        ),
        "|---|---|---|---|---|",
    ]
    for policy, counts in moves.items():
        mean, error = (
            np.mean(counts),
            np.std(counts, ddof=min(1, len(counts) - 1)) / np.sqrt(len(counts)),
        )
        share, open_ = mean / np.mean(moves["best"]), sum(count >= max_moves for count in counts)
        rows.append(f"| {policy} | {mean:.1f} | {error:.1f} | {share:.2f} | {open_} |")
    return "\n".join(
        [f"\nvessels:{cells}, {particles} particles, maps {maps.start} to {maps.stop - 1}\n", *rows]
    )


def imitate(
    *,
    seed: int,
    maps: range,
    cells: int = 300,
    particles: int = 30,
    rounds: int = 4,
    epochs: int = 5,
    longest: int = 1000,
) -> Learner:
    """Return a policy that imitates `best`: from its episodes, then from so many rounds along its
    own.
    """
    begun, rng = time.process_time(), np.random.default_rng(seed)
    network, expert, data = Network(rng), make_policy("best"), []
    learner = Learner(network, rng)
    env = environment([f"vessels:{cells}:{k}" for k in maps], particles, longest)
    for turn in range(rounds + 1):
        played = [
            play(
                env,
                learner if turn else None,
                expert,
                data,
                rng,
                seed=turn * len(maps) + k,
                options={"map": k},
            )
            for k in range(len(maps))
        ]
        loss = train(network, data, epochs * (1 if turn else 2), rng)
        who = "learner" if turn else "best"
        print(
            f"round {turn}: {who} took {np.mean(played):.0f} moves; {len(data)} states, loss"
            f" {loss:.3f}, {time.process_time() - begun:.0f} CPU s",
            flush=True,
        )
    return learner


def main(arguments: list[str] | None = None) -> None:
    """Train the network, evaluate it, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cells", type=int, default=300, help="size of the maps")
    parser.add_argument("--particles", type=int, default=30)
    parser.add_argument(
        "--maps", type=int, default=60, help="maps to learn from: numbers 0, 1, ..."
    )
    parser.add_argument("--rounds", type=int, default=4, help="rounds along own episodes")
    parser.add_argument("--epochs", type=int, default=5, help="passes through the data a round")
    parser.add_argument(
        "--tests", type=int, default=50, help="maps to compare on: numbers 1000, 1001, ..."
    )
    parser.add_argument(
        "--large", type=int, default=20, help="maps of 1000 cells with 100 particles to compare on"
    )
    parser.add_argument(
        "--max-moves", type=int, default=3000, help="longest episode; random moves take longer"
    )
    parser.add_argument(
        "--first", type=int, default=0, help="number of the first map to learn from"
    )
    parser.add_argument("--export", metavar="FILE", help="write the network as an ONNX file")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    learner = imitate(
        seed=given.seed,
        cells=given.cells,
        particles=given.particles,
        maps=range(given.first, given.first + given.maps),
        rounds=given.rounds,
        epochs=given.epochs,
        longest=min(1000, given.max_moves),
    )
    if given.export:
        export(learner.network, given.export)
    if given.tests:
        print(
            evaluate(
                learner,
                given.cells,
                given.particles,
                range(1000, 1000 + given.tests),
                given.max_moves,
            )
        )
    if given.large:
        print(evaluate(learner, 1000, 100, range(1000, 1000 + given.large), given.max_moves))


if __name__ == "__main__":
    main()
