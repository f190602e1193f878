"""Lower bounds that follow from the commands that all particles share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.grid.pairs import moves_of
from shoal.swarm.theory.small_world import SmallWorld

MOST_SETS = 300_000
MOST_CELLS = 3000


def fewest_commands(
    free: NDArray[np.bool_],
    offsets: NDArray[np.int64],
    required: NDArray[np.bool_],
    particles: NDArray[np.bool_],
    n: int,
    *,
    slides: bool = False,
    most_sets: int = MOST_SETS,
) -> int:
    """Return a lower bound on the number of commands, from the sets of commands with repetition.

    Let v be the numbers of commands of each direction in a plan, in any order, and R(v) all cells
    with a path from a particle that has at most v steps of each direction. Let F(v) be the largest
    number of required cells that a plan with these commands can classify. With e_i for one command
    i and n for the number of particles::

        R(v) = R(v - e_i) and the cells beside R(v - e_i) in direction i, for all i
        F(v) <= max over i of F(v - e_i) + min(n, required cells beside R(v - e_i) in direction i)
        F(v) <= required cells in R(v)

    The bound is the smallest number of commands with an F(v) of all required cells.

    Parameters
    ----------
    free, required, particles : ndarray of bool, shape (size,)
        Flat masks with a rim, as `shoal.swarm.theory.bounds.flat_cells` returns. Required cells may
        be walls.
    offsets : ndarray of int64
        The index offset of each command.
    n : int
        Number of particles.
    slides : bool
        Whether one command moves a particle until something stops it (the rule tilt).
    most_sets : int
        Maximum number of sets of commands. The search ends before the first number of commands that
        would exceed it; the bound is then weaker, but valid.
    """
    number, shifted = SmallWorld.number, SmallWorld.shifted
    inside, goal = number(free), number(required)
    enterable, total = inside | goal, int(np.count_nonzero(required))
    most = n * (longest_run(free, offsets) if slides else 1)  # cells classified by one command
    level = {0: (number(particles), 0)}
    commands, sets = 0, 1
    while all(classified < total for _, classified in level.values()):
        following: dict[int, tuple[int, int]] = {}
        for key, (reached, classified) in level.items():
            for command, offset in enumerate(offsets.tolist()):
                entered = ahead = shifted(reached & inside, offset) & enterable
                while slides and ahead:
                    ahead = shifted(ahead & inside, offset) & enterable
                    entered |= ahead
                gained = classified + min(most, (entered & goal).bit_count())
                new = key + (1 << 16 * command)
                before, at_most = following.get(new, (0, 0))
                following[new] = before | reached | entered, max(at_most, gained)
        level = {
            key: (reached, min(gained, (reached & goal).bit_count()))
            for key, (reached, gained) in following.items()
        }
        commands, sets = commands + 1, sets + len(level)
        if sets > most_sets:
            break
    return commands + (1 if all(classified < total for _, classified in level.values()) else 0)


def longest_run(free: NDArray[np.bool_], offsets: NDArray[np.int64]) -> int:
    """Return the largest number of free cells in a straight line."""
    longest = 0
    for offset in offsets[1:3].tolist() + offsets[4:5].tolist():
        run, length = free.copy(), 0
        while run.any():
            length += 1
            run &= np.roll(run, offset)
        longest = max(longest, length)
    return longest


def fewest_for_pairs(
    free: NDArray[np.bool_],
    offsets: NDArray[np.int64],
    required: NDArray[np.bool_],
    particles: NDArray[np.bool_],
    n: int,
    *,
    rule: str = "block",
    most_cells: int = MOST_CELLS,
) -> int:
    """Return a lower bound on the number of commands, from the pairs of required cells: the largest
    number of commands that two particles need to reach two required cells.

    The two particles start in any two particles' cells, or are the same particle, and each command
    moves both. A particle may stay where others can stop it: under the rule block, if there are
    fewer free cells ahead of it than other particles; under the rule merge, only at a wall. A
    breadth-first search over the pairs of cells therefore finds at most as many commands as a plan
    for all required cells has.

    Return 0 for a workspace with more than ``most_cells`` cells, whose pairs would take too much
    memory. The other arguments are those of `fewest_commands`.
    """
    from shoal.swarm.kernels.theory import reach_pairs

    cells = np.flatnonzero(free | required)
    if cells.size > most_cells or not required.any():
        return 0
    ahead, may_stay = moves_of(free, offsets, cells, n, rule)
    inner, starts = free[cells], np.searchsorted(cells, np.flatnonzero(particles))
    size = cells.size**2
    fewest = np.full(size, -1, dtype=np.int32)
    ends = np.zeros((2, 2 * cells.size + 2), dtype=np.int64)
    reach_pairs(
        ahead,
        may_stay,
        inner,
        required[cells],
        starts,
        n > 1,
        rule == "tilt",
        np.zeros(2 * size, dtype=np.bool_),
        np.zeros(2 * size, dtype=np.int32),
        ends,
        fewest,
    )
    return max(0, int(fewest.max()))


def fewest_by_flow(
    free: NDArray[np.bool_],
    offsets: NDArray[np.int64],
    required: NDArray[np.bool_],
    particles: NDArray[np.bool_],
    n: int,
    *,
    rule: str = "block",
    least: int = 0,
    most_nodes: int = 100,
) -> int:
    """Return a lower bound on the number of commands, from flows of particles through time.

    For a number of moves T, let u[t, c] be 1 if command number t is c, y[t, x] the particles in
    cell x before it, f[t, x, c] those that leave x by it, and a[t, x, c] those that try to enter a
    wall from x. Each plan of T moves gives a solution of::

        sum over c of u[t, c] = 1,    y[0, x] = particles in x,    y <= 1 (under merge: n)
        y[t + 1, x] = y[t, x] - sum over c of f[t, x, c] + particles that enter x
        f[t, x, c] <= y[t, x],    f[t, x, c] <= n u[t, c]  (under block: u[t, c])
        f[t, x, c] >= y[t, x] - n (1 - u[t, c])  where no other particle can stop one in x
        a[t, x, c] <= y[t, x],    a[t, x, c] <= u[t, c]
        sum of all f and a into each required cell >= 1

    The bound is one more than the largest T for which HiGHS proves that there is no solution with
    whole u, with branch and bound over at most ``most_nodes`` nodes.

    Parameters
    ----------
    rule : str
        "block" or "merge".
    least : int
        A lower bound that is known already.
    most_nodes : int
        Maximum number of nodes for each T. The search ends at the first T without a proof.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import coo_array

    cells = np.flatnonzero(free | required)
    ahead, may_stay = moves_of(free, offsets, cells, n, rule)
    inner, goals, start = free[cells], required[cells], particles[cells]
    k, m, most = offsets.size, cells.size, n if rule == "merge" else 1
    bound = least
    while goals.any():
        step = k + m + m * k  # variables of one move: u, y, and f or a
        rows: list[tuple[list[tuple[int, float]], float, float]] = []
        entering: list[list[int]] = [[] for _ in range(m)]
        for t in range(bound):
            u, y, f = t * step, t * step + k, t * step + k + m
            rows.append(([(u + c, 1) for c in range(k)], 1, 1))
            flows: list[list[tuple[int, float]]] = [[(y + x, 1)] for x in range(m)]
            for x in np.flatnonzero(inner).tolist():
                for c in range(k):
                    successor, flow = int(ahead[c, x]), f + x * k + c
                    if successor < 0:
                        continue
                    entering[successor].append(flow)
                    rows.append(([(flow, 1), (y + x, -1)], -np.inf, 0))
                    rows.append(([(flow, 1), (u + c, -most)], -np.inf, 0))
                    if inner[successor]:
                        flows[x].append((flow, -1))
                        flows[successor].append((flow, 1))
                        if not may_stay[c, x]:
                            rows.append(([(flow, 1), (y + x, -1), (u + c, -most)], -most, np.inf))
            after = (t + 1) * step + k
            rows.extend(([*flows[x], (after + x, -1)], 0, 0) for x in range(m))
        wanted_flows = [entering[x] for x in np.flatnonzero(goals)]
        rows.extend(([(flow, 1) for flow in into], 1, np.inf) for into in wanted_flows)
        size = bound * step + k + m
        upper = np.full(size, float(most))
        lower, integrality = np.zeros(size), np.zeros(size)
        for t in range(bound):
            upper[t * step : t * step + k] = 1
            integrality[t * step : t * step + k] = 1
        lower[k : k + m] = upper[k : k + m] = start
        entries = [(i, j, value) for i, row in enumerate(rows) for j, value in row[0]]
        table = np.array(entries, dtype=float).reshape(-1, 3).T
        matrix = coo_array(
            (table[2], (table[0].astype(int), table[1].astype(int))), shape=(len(rows), size)
        ).tocsr()
        solution = milp(
            np.zeros(size),
            integrality=integrality,
            bounds=Bounds(lower, upper),
            constraints=LinearConstraint(
                matrix, [row[1] for row in rows], [row[2] for row in rows]
            ),
            options={"node_limit": most_nodes},
        )
        if solution.status != 2:  # anything but a proof that there is no solution
            return bound
        bound += 1
    return bound
