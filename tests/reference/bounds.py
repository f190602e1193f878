"""Bounds and optima of the swarm on small maps in plain Python: sets of cells, dictionaries and
breadth-first searches.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from tests.reference import plain

Cell = tuple[int, ...]


def fewest_moves(
    free: np.ndarray,
    start: np.ndarray,
    *,
    rule: str,
    task: str,
    targets: np.ndarray | None = None,
    most_states: int = 200_000,
) -> int | None:
    """Return the fewest commands with which the task is complete, by a breadth-first search over
    plain states. Return None if there is no such plan, or if it takes too many states.
    """
    world = plain.make_world(free, start, rule=rule, task=task, targets=targets)
    kind, goal = plain.RULES.index(rule), plain.TASKS.index(task)
    wave, moves = [world], 0
    seen = {b"".join(part.tobytes() for part in world)}
    while wave:
        if any(not here.frontier.any() for here in wave):
            return moves
        following = []
        for here in wave:
            for command in range(plain.directions(here.free)):
                there = plain.World(*(part.copy() for part in here))
                plain.step(*there, command, kind, goal)
                key = b"".join(part.tobytes() for part in there)
                if key not in seen:
                    seen.add(key)
                    following.append(there)
        if len(seen) > most_states:
            return None
        wave, moves = following, moves + 1
    return None


def neighbour(cell: Cell, command: int) -> Cell:
    """Return the cell that a command leads to."""
    axis, step = ((1, -1), (0, -1), (1, 1), (0, 1))[command]
    return tuple(at + step * (k == axis) for k, at in enumerate(cell))


def cells_of(free: np.ndarray, start: np.ndarray, *, rule: str, task: str, targets=None):
    """Return the free cells, the particles' cells and the cells to classify, each as a set."""
    inside = {tuple(cell) for cell in np.argwhere(free).tolist()}
    particles = {tuple(cell) for cell in np.asarray(start).tolist()}
    reached, todo = set(particles), list(particles)
    while todo:
        cell = todo.pop()
        for there in (neighbour(cell, command) for command in range(4)):
            if there in inside and there not in reached:
                reached.add(there)
                todo.append(there)
    if task == "mapping":
        wanted = reached | {neighbour(cell, command) for cell in reached for command in range(4)}
    else:
        chosen = free if targets is None else targets
        wanted = reached & {tuple(cell) for cell in np.argwhere(chosen).tolist()}
    return inside, particles, wanted - particles


def ends(inside, wanted, cell, command, n, rule):
    """Return the set of (cell, whether it classified its wanted cell) after one command."""
    room, there = 0, neighbour(cell, command)
    while there in inside:
        room, there = room + 1, neighbour(there, command)
    line = [cell]
    for _ in range(room + 1 if rule == "tilt" else 1):
        line.append(neighbour(line[-1], command))
    found = set()
    for steps, there in enumerate(line):
        stops = room - steps < (1 if rule == "merge" else n)
        if there in inside and (stops or (steps == 1 and rule != "tilt")):
            found.add((there, False))
        if steps and there in wanted:
            found.add((there, True))
    return found


def fewest_for_pairs(free, start, *, rule, task, targets=None) -> int:
    """Return the bound of the same name, by a search over pairs of (cell, done)."""
    inside, particles, wanted = cells_of(free, start, rule=rule, task=task, targets=targets)
    if len(particles) > 1:
        wave = {((one, False), (other, False)) for one, other in product(particles, repeat=2)}
    else:
        wave = {((one, False), (one, False)) for one in particles}
    seen, fewest, moves = set(wave), {}, 0
    while wave:
        moves += 1
        following = set()
        for one, other in wave:
            for command in range(4):
                options = [
                    {at} if at[1] else ends(inside, wanted, at[0], command, len(particles), rule)
                    for at in (one, other)
                ]
                following |= set(product(*options))
        wave = following - seen
        seen |= wave
        for one, other in wave:
            if one[1] and other[1]:
                fewest.setdefault((one[0], other[0]), moves)
        wave = {(one, other) for one, other in wave if not (one[1] and other[1])}
    return max(fewest.values(), default=0)


def fewest_commands(free, start, *, rule, task, targets=None) -> int:
    """Return the bound of the same name, by sets of cells for each tuple of numbers of commands."""
    inside, particles, wanted = cells_of(free, start, rule=rule, task=task, targets=targets)
    most = len(particles)
    if rule == "tilt":
        lines = [
            len(line)
            for space in (free, free.T)
            for row in space
            for line in "".join("x" if cell else " " for cell in row).split()
        ]
        most *= max(lines)
    level, commands = {(0, 0, 0, 0): (particles, 0)}, 0
    while max(classified for _, classified in level.values()) < len(wanted):
        following: dict[tuple[int, ...], tuple[set, int]] = {}
        for key, (reached, classified) in level.items():
            for command in range(4):
                moved, ahead = set(), reached & inside
                while ahead:
                    ahead = {neighbour(cell, command) for cell in ahead} & (inside | wanted)
                    moved |= ahead
                    ahead = ahead & inside if rule == "tilt" else set()
                new = tuple(count + (k == command) for k, count in enumerate(key))
                before, at_most = following.get(new, (set(), 0))
                gained = classified + min(most, len(moved & wanted))
                following[new] = before | reached | moved, max(at_most, gained)
        commands += 1
        level = {
            key: (reached, min(gained, len(reached & wanted)))
            for key, (reached, gained) in following.items()
        }
    return commands
