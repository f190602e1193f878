"""The search for the fewest commands that classify cells of a small known map."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm.kernels import optimum as kernels
from shoal.swarm.kernels.optimum import Graph, Prices, States
from shoal.swarm.theory.small_world import SmallWorld, set_bits

MOST_PLACES = 20_000
"""Most sets of cells with particles from which the search goes on."""
MOST_MOVES = 16_384
EASY = 20_000
"""States of a search without dual prices. Most searches end before."""
DUALS, MOST_PLACES_OF_DUALS, DEAREST = 40, 2000, 12
"""Lists of dual prices, the largest graph for which they are computed, and their highest price."""


def search_optimum(
    world: SmallWorld, particles: int, remaining: int, mapping: bool, letters: str, most_states: int
) -> tuple[int, str, int]:
    """Return the fewest commands that classify the cells ``remaining``, a plan with them, and the
    number of states that the search has found.

    An A* search over places (sets of cells that hold particles) and the cells that are left. Its
    estimate comes from prices. Give each cell a price. If k commands classify the cells that are
    left, they try each of them, so they earn at least the sum of their prices. A table for each list
    of prices holds the fewest commands that earn a sum from a place, with the true moves of the
    swarm. The estimate is the largest of these numbers over all lists of prices.

    The first lists are 1 for all cells, for all cells that only some of the commands can classify,
    and for each single cell. If these are not enough, dual prices follow (`dual_prices`). Prices are
    whole numbers and tables are exact, so the optimum does not rest on the solver of the duals.

    Raises
    ------
    InvalidInputError
        Raised if no commands classify all cells, or if the search needs more than ``most_states``
        states.
    """
    if not remaining:
        return 0, "", 1
    graph, cells = explore(world, particles, remaining, mapping)
    lists = simple_prices(graph, cells)
    easy = min(EASY, most_states)
    result = _search(graph, cells, lists, easy, letters)
    if result is None and most_states > easy:
        if len(graph.ahead) <= MOST_PLACES_OF_DUALS:
            lists = np.concatenate([lists, dual_prices(graph, cells)])
        result = _search(graph, cells, lists, most_states, letters)
    if result is None:
        raise InvalidInputError(f"optimum: expected at most {most_states} states, got more")
    if not result[1]:
        raise InvalidInputError(
            "optimum: expected a task that particles can complete under the rule"
            f" {world.rule}, got none of {result[2]} states in which it is complete"
        )
    return result


def explore(world: SmallWorld, particles: int, remaining: int, mapping: bool) -> tuple[Graph, int]:
    """Return the places that particles can reach, at most `MOST_PLACES` of them explored, and the
    number of cells to classify.
    """
    index = {bit: i for i, bit in enumerate(set_bits(remaining))}
    numbers, places = {particles: 0}, [particles]
    ahead: list[list[int]] = []
    tried: list[list[int]] = []
    while len(ahead) < min(len(places), MOST_PLACES):
        current = places[len(ahead)]
        steps = [
            world.step(current, remaining, command, mapping)
            for command in range(len(world.offsets))
        ]
        for successor, _ in steps:
            if successor not in numbers:
                numbers[successor] = len(places)
                places.append(successor)
        ahead.append([numbers[successor] for successor, _ in steps])
        tried.append(
            [
                sum(1 << index[bit] for bit in set_bits(remaining & ~after & ~current))
                for _, after in steps
            ]
        )
    commands, words = len(world.offsets), max(1, -(-len(index) // 64))
    all_ahead = np.full((len(places), commands), -1, dtype=np.int32)
    all_tried = np.zeros((len(places), commands, words), dtype=np.uint64)
    all_ahead[: len(ahead)] = ahead
    raw = b"".join(cells.to_bytes(8 * words, "little") for row in tried for cells in row)
    all_tried[: len(tried)] = np.frombuffer(raw, dtype="<u8").reshape(-1, commands, words)
    alone = np.array([world.rule != "tilt" and place.bit_count() == 1 for place in places])
    return Graph(all_ahead, all_tried, alone), len(index)


def simple_prices(graph: Graph, cells: int) -> NDArray[np.int64]:
    """Return lists of prices 0 and 1 (int64, shape (lists, cells)): for each set of commands, 1 for
    the cells that no other command can classify; and for each cell, 1 for this cell only.
    """
    commands = graph.ahead.shape[1]
    by = np.array(
        [
            _bits(np.bitwise_or.reduce(cells_by_place), cells)
            for cells_by_place in graph.tried.swapaxes(0, 1)
        ]
    )
    lists = np.eye(cells, dtype=np.int64)
    for allowed in range(1, 1 << commands):
        forbidden = [command for command in range(commands) if not allowed >> command & 1]
        lists = np.vstack([lists, ~by[forbidden].any(axis=0)])
    return np.unique(lists[lists.any(axis=1)], axis=0)


def dual_prices(graph: Graph, cells: int) -> NDArray[np.int64]:
    """Return lists of whole prices (int64, shape (lists, cells)) from the duals of flows.

    The relaxation lets a flow of one unit run through the places, from a given place to any place.
    Each command costs 1 a unit, and the flow must try each cell that is left at least once. At each
    visit, a command that moves no particle is used at most once. With the price pi of each cell, a
    potential psi <= 0 of each place p, and x for the profit of a command that moves no particle, the
    dual maximizes psi of the given place plus the prices of all cells that are left, subject to::

        x[p, c] >= sum of pi over tried[p, c] - 1                         c moves no particle
        psi[p] + sum over c of x[p, c] <= 0                               the end of the flow
        psi[p] - psi[q] + sum of pi over tried[p, c] + sum of x[p] <= 1   c leads from p to q

    The lists are its solutions for the first state, and for states on the way of random commands.
    HiGHS solves it. `shoal.swarm.kernels.optimum.tabulate` then finds in whole numbers what the
    prices prove.
    """
    from scipy.optimize import linprog
    from scipy.sparse import block_array, csr_array, eye_array

    places, commands = graph.ahead.shape
    steps = places * commands
    ahead, source = graph.ahead.ravel(), np.repeat(np.arange(places), commands)
    tried = csr_array(_bits(graph.tried, cells).reshape(steps, cells), dtype=float)
    probes = np.flatnonzero((ahead == source) & (tried.sum(axis=1) > 0))
    moves = np.flatnonzero((ahead != source) & (ahead >= 0))
    at = _table(source[probes], np.arange(probes.size), (places, probes.size))
    left_by, entered = (
        _table(np.arange(moves.size), ends[moves], (moves.size, places)) for ends in (source, ahead)
    )
    rows = [
        [tried[probes], None, -eye_array(probes.size)],
        [csr_array((places, cells)), eye_array(places), at],
        [tried[moves], left_by - entered, at[source[moves]]],
    ]
    table = block_array([row for row in rows if row[0].shape[0]], format="csr")
    least = np.concatenate([np.ones(probes.size), np.zeros(places), np.ones(moves.size)])
    limits = [(0, None)] * cells + [(None, 0)] * places + [(0, None)] * probes.size
    lists = []
    for place, remaining in _samples(graph, cells):
        worth = np.zeros(table.shape[1])
        worth[:cells], worth[cells + place] = np.where(remaining, -1, 0), -1
        solution = linprog(worth, A_ub=table, b_ub=least, bounds=limits, method="highs")
        if solution.status == 0 and (prices := solution.x[:cells] * remaining).max(initial=0) > 0:
            lists.append(np.rint(DEAREST * prices / prices.max()).astype(np.int64))
    return np.array(lists).reshape(-1, cells)


def _table(rows: NDArray[Any], columns: NDArray[Any], shape: tuple[int, int]) -> Any:
    from scipy.sparse import coo_array

    return coo_array((np.ones(rows.size), (rows, columns)), shape=shape).tocsr()


def _samples(graph: Graph, cells: int) -> Iterator[tuple[int, NDArray[np.bool_]]]:
    """Yield the first state and `DUALS` - 1 states on the way of random commands, each a place and
    the mask of the cells that are left.
    """
    rng, commands = np.random.default_rng(0), graph.ahead.shape[1]
    yield 0, np.ones(cells, dtype=np.bool_)
    for number in range(1, DUALS):
        place, remaining = 0, np.ones(cells, dtype=np.bool_)
        for _ in range(1000):
            if remaining.sum() <= cells * (1 - number / DUALS) or graph.ahead[place, 0] < 0:
                break
            tried = _bits(graph.tried[place], cells) & remaining
            useful = np.flatnonzero(tried.any(axis=1))
            command = rng.choice(useful) if useful.size else rng.integers(commands)
            place, remaining = int(graph.ahead[place, command]), remaining & ~tried[command]
        yield place, remaining


def _bits(words: NDArray[np.uint64], cells: int) -> NDArray[np.bool_]:
    """Return sets of cells as masks: words of shape (..., words) as bool of shape (..., cells)."""
    octets = np.ascontiguousarray(words.astype("<u8")).view(np.uint8)
    return np.unpackbits(octets, axis=-1, bitorder="little")[..., :cells].astype(np.bool_)


def _search(
    graph: Graph, cells: int, lists: NDArray[np.int64], most_states: int, letters: str
) -> tuple[int, str, int] | None:
    """Return the moves, a plan and the number of states; a plan without commands if there is none,
    and None if the search needs more than ``most_states`` states.
    """
    commands, words = len(letters), graph.tried.shape[2]
    prices = _tabulate(graph, lists)
    progress, buffer = np.array([1, 1, 0, -1]), np.zeros(words, dtype=np.uint64)
    states = _states(min(1 << 14, most_states + commands), words)
    full = (1 << cells) - 1
    states.left[0] = np.frombuffer(full.to_bytes(8 * words, "little"), dtype="<u8")
    if (least := kernels.estimate(0, states.left[0], prices)) >= kernels.FAR:
        return 0, "", 1
    states.queued[0], states.heads[min(least, MOST_MOVES - 1)] = 0, 0
    kernels.fill_slots(states, 1)
    while (ended := kernels.search(graph, prices, states, progress, buffer)) == kernels.FULL:
        capacity = states.place.size
        if capacity >= most_states + commands:
            return None
        states = _states(min(2 * capacity, most_states + commands), words, states)
        kernels.fill_slots(states, int(progress[kernels.COUNT]))
    count = int(progress[kernels.COUNT])
    if ended == kernels.UNEXPLORED:
        raise InvalidInputError(
            f"optimum: expected at most {MOST_PLACES} sets of cells with particles, got more"
        )
    if ended == kernels.IMPOSSIBLE:
        return 0, "", count
    plan, state = "", int(progress[kernels.GOAL])
    while state:
        plan = letters[states.command[state]] + plan
        state = int(states.before[state])
    return len(plan), plan, count


def _tabulate(graph: Graph, lists: NDArray[np.int64]) -> Prices:
    """Return the prices with their tables."""
    places, commands = graph.ahead.shape
    words, bits = graph.tried.shape[2], int(lists.max(initial=1)).bit_length()
    masks = np.zeros((len(lists), bits, 64 * words), dtype=np.bool_)
    for bit in range(bits):
        masks[:, bit, : lists.shape[1]] = lists >> bit & 1
    planes = np.packbits(masks, axis=-1, bitorder="little").view("<u8").astype(np.uint64)
    sums = lists.sum(axis=1)
    ends = np.cumsum(places * (sums + 1))
    prices = Prices(planes, sums, ends - places * (sums + 1), np.empty(ends[-1], dtype=np.int16))
    earned, probes = (np.zeros((places, commands + k), dtype=np.int64) for k in (0, 1))
    best = np.zeros((commands + 2, places), dtype=np.int64)
    for i, (begin, end) in enumerate(zip(prices.offsets, ends, strict=True)):
        needed = prices.needed[begin:end]
        kernels.tabulate(graph, planes[i], int(sums[i]), earned, probes, best, needed)
    return prices


def _states(capacity: int, words: int, smaller: States | None = None) -> States:
    """Return room for states, with those of a smaller room and an empty hash table."""
    place, moves, before, command = np.zeros((4, capacity), dtype=np.int32)
    queued, following = np.full((2, 2 * capacity), -1, dtype=np.int32)
    states = States(
        place=place,
        moves=moves,
        before=before,
        command=command,
        left=np.zeros((capacity, words), dtype=np.uint64),
        expanded=np.zeros(capacity, dtype=np.bool_),
        slots=np.full(1 << (2 * capacity - 1).bit_length(), -1, dtype=np.int32),
        queued=queued,
        following=following,
        heads=np.full(MOST_MOVES, -1, dtype=np.int32),
    )
    if smaller is not None:
        for name, old in smaller._asdict().items():
            if name != "slots":
                getattr(states, name)[: len(old)] = old
    return states
