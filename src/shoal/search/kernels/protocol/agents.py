"""Searches in which agents tell the robots where to go: steps, rewards and observations.

Counterpart: `shoal.envs.search_v0`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.search.kernels.protocol.bits import ONE, ZERO, holds, lowest
from shoal.search.kernels.protocol.events import post, run
from shoal.search.kernels.protocol.worlds import NOWHERE, PROMPT


class Lattice(NamedTuple):
    """Where the cells of a tour lie: ``flat`` is the place of each cell in a plane, int64, shape
    (N,), and ``beside`` is the cell that each direction leads to, or -1; int64, shape (N, actions).
    """

    flat: NDArray[np.int64]
    beside: NDArray[np.int64]


class Agents(NamedTuple):
    """What the agents of B worlds with m robots have reached."""

    steps: NDArray[np.int64]  # (B,)
    scored: NDArray[np.int32]  # (B, N): number of robots rewarded for each cell
    left: NDArray[np.int64]  # (B,): cells that too few robots have searched
    new: NDArray[np.int64]  # (B, m): cells searched anew in the latest step
    present: NDArray[np.uint8]  # (B, m): whether the robot lived before the latest step


class Views(NamedTuple):
    """What the robots see, know, and can do."""

    planes: NDArray[np.uint8]  # (B, m, 5, places)
    shown: NDArray[np.uint64]  # (B, m, W): cells that the planes show as searched
    cells: NDArray[np.int64]  # (B, m): where the robots are
    left: NDArray[np.float64]  # (B, m): energy
    heard: NDArray[np.float32]  # (B, m, m): how long ago each other was heard, in steps, or -1
    masks: NDArray[np.int8]  # (B, m, actions)


@in_place_kernel
def cell_of(lattice, robot, choice):
    """Return the cell that an action other than 0 selects, or -1."""
    if lattice.beside.shape[1] == 0:
        return choice - 1
    return lattice.beside[robot.cell, choice - 1]


@in_place_kernel
def may_go(robot, time):
    """Return whether a robot can be sent to a cell."""
    return robot.alive and robot.target == NOWHERE and robot.paused_until <= time


@in_place_kernel
def step(tour, rules, partitions, lattice, w, agents, views, chosen, actions, length, first, begun):
    """Let the worlds ``chosen[first:]`` advance by a step with the actions of their robots. Return
    the number of worlds that are done; the next world needs something first, and has ``begun``.
    """
    for k in range(first, chosen.shape[0]):
        b = chosen[k]
        if not (begun and k == first):
            send_orders(lattice, w, agents, b, actions[b], length)
        if not run(tour, rules, partitions, w, b, agents.steps[b] * length + 1e-9):
            return k
        count_new(rules, w, agents, b)
        look_around(lattice, w, agents, views, b, length)
    return chosen.shape[0]


@in_place_kernel
def send_orders(lattice, w, agents, b, actions, length):
    """Tell the robots of a world where to go, and begin a step."""
    control, time = w.control[b], agents.steps[b] * length
    control.visits = control.states = 0
    control.most = 1 << 62
    for i in range(w.robots.shape[1]):
        robot = w.robots[b, i]
        agents.present[b, i] = robot.alive
        if actions[i] and may_go(robot, time):
            cell = cell_of(lattice, robot, actions[i])
            if cell >= 0:
                robot.order = cell
                post(w, b, time, PROMPT, i, 0, 0.0)
    agents.steps[b] += 1


@in_place_kernel
def count_new(rules, w, agents, b):
    """Count for each robot, in their order, the cells that it searched in the latest step and that
    too few robots had searched before.
    """
    for i in range(w.robots.shape[1]):
        agents.new[b, i] = 0
        for visit in range(w.control[b].visits):
            if w.visits[b, visit, 0] != i or not w.visits[b, visit, 2]:
                continue
            cell = w.visits[b, visit, 1]
            agents.scored[b, cell] += 1
            agents.new[b, i] += agents.scored[b, cell] <= rules.multiplicity
            agents.left[b] -= agents.scored[b, cell] == rules.multiplicity


@in_place_kernel
def look(lattice, w, agents, views, chosen, length):
    """Write what the robots of worlds see, know, and can do."""
    for k in range(chosen.shape[0]):
        look_around(lattice, w, agents, views, chosen[k], length)


@in_place_kernel
def look_around(lattice, w, agents, views, b, length):
    """Write what the robots of a world see, know, and can do."""
    for i in range(w.robots.shape[1]):
        robot, mask = w.robots[b, i], views.masks[b, i]
        write_planes(lattice, w, views, b, i)
        views.cells[b, i], views.left[b, i] = robot.cell, robot.left
        free = may_go(robot, agents.steps[b] * length)
        mask[0] = 1
        for choice in range(1, mask.shape[0]):
            mask[choice] = free and cell_of(lattice, robot, choice) >= 0
        heard, counts = views.heard[b, i], w.counts[b, i]
        for other in range(w.robots.shape[1]):
            heard[other] = -1.0
            if counts[other] >= 0:
                steps = agents.steps[b] - w.peers[b, i, other].heard / length
                heard[other] = max(steps, -1.0)
        heard[i] = 0.0


@in_place_kernel
def write_planes(lattice, w, views, b, i):
    """Write the planes of a robot: where it is, and the cells that it has learnt to be searched, or
    to hold something.
    """
    planes, shown, searched = views.planes[b, i], views.shown[b, i], w.done[b, i]
    planes[1, lattice.flat[views.cells[b, i]]] = 0
    planes[1, lattice.flat[w.robots[b, i].cell]] = 1
    for k in range(shown.shape[0]):
        new = searched[k] & ~shown[k]
        shown[k] = searched[k]
        while new != ZERO:
            planes[2, lattice.flat[(k << 6) + lowest(new)]] = 1
            new &= new - ONE
    for finding in range(w.control[b].findings):
        if holds(w.reported[b, i], finding):
            planes[4, lattice.flat[w.place[b, finding]]] = 1
