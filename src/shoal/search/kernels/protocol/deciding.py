"""What a robot does next.

Counterpart: `next_action`, `head_for` and what they call in `shoal.search.protocol.robot`, and
`settled_cells` and `reachable_cells` in `shoal.search.protocol.state`. Footprints of one cell.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.search.kernels.protocol.bits import ALL, ONE, ZERO, holds
from shoal.search.kernels.protocol.costs import (
    add,
    ahead_of,
    arc_holds,
    cost_alone,
    from_launch,
    is_empty,
    length,
    move_cost,
    next_stretch,
    remove,
)
from shoal.search.kernels.protocol.helping import cell_to_help, is_taken, leaves_to_others
from shoal.search.kernels.protocol.knowledge import (
    is_live,
    knows,
    knows_obstacle,
    number_of_obstacles,
    silence_limit,
)
from shoal.search.kernels.protocol.numbers import ARRIVAL, LOOK
from shoal.search.kernels.protocol.steps import write_distances, write_move_path, write_path
from shoal.search.kernels.protocol.worlds import (
    A_PARTITION,
    COMPLETE,
    HOME,
    LISTENING,
    MEMORY,
    NOTHING,
    SEARCHING,
    WAITING,
)

NONE, GO, GO_HOME, DECLARE = range(4)  # actions


@in_place_kernel
def place_of(robot, i):
    """Return what `cost_alone` must know of a robot."""
    return robot.partition, robot.own, np.int64(i), robot.start, robot.at_launch


@in_place_kernel
def fill(bits, n):
    """Make a bitset that contains all cells."""
    for k in range(bits.shape[0]):
        bits[k] = ALL
    if n & 63:
        bits[n >> 6] = (ONE << np.uint64(n & 63)) - ONE


@in_place_kernel
def is_settled_by_all(w, b, i, cell, time, limit, waits):
    """Return whether all robots that a robot presumes alive have searched a cell that it has
    searched itself: no further robot can search it.
    """
    if not waits:
        return True
    lacking = 0
    for other in range(w.counts.shape[2]):
        if other != i and w.counts[b, i, other] >= 0 and is_live(w, b, i, other, time, limit):
            lacking += 1
    fact = w.head[b, cell]
    while fact >= 0:
        other = np.int64(w.owner[b, fact >> 6])
        if (
            other != i
            and w.counts[b, i, other] >= 0
            and holds(w.known[b, i], fact)
            and is_live(w, b, i, other, time, limit)
        ):
            lacking -= 1
        fact = w.next[b, fact]
    return lacking == 0


@in_place_kernel
def is_settled_by_able(tour, w, b, i, cell, time, limit, waits, closed):
    """Return what `is_settled_by_all` returns if robots find obstacles: robots that cannot reach the
    cell do not count.
    """
    for other in range(w.counts.shape[2] if waits else 0):
        if (
            other != i
            and w.counts[b, i, other] >= 0
            and is_live(w, b, i, other, time, limit)
            and tour.labels[closed, cell] == tour.labels[closed, w.robots[b, other].start]
            and not knows(w, b, i, other, cell)
            and not knows_obstacle(w, b, i, other, cell)
        ):
            return False
    return True


@in_place_kernel
def write_reachable(tour, rules, w, b, i, time):
    """Write the cells that a robot can reach, and those that a live robot can reach, to the work
    space; see `shoal.search.protocol.state.reachable_cells`. Robots never are in closed cells.
    """
    robot, own, anyone = w.robots[b, i], w.reach[b], w.anyone[b]
    if not tour.stepwise:
        return
    labels = tour.labels[number_of_obstacles(tour, rules, w, b, i, i)]
    add_part(labels, robot.cell, own)
    for k in range(own.shape[0]):
        anyone[k] = own[k]
    if rules.multiplicity > 1 and time >= 3 * robot.deadline:
        return
    limit, parts = silence_limit(robot, rules), w.left[b]
    for other in range(w.counts.shape[2]):
        start = w.robots[b, other].start
        if (
            other != i
            and w.counts[b, i, other] >= 0
            and not holds(anyone, start)
            and is_live(w, b, i, other, time, limit)
        ):
            add_part(labels, start, parts)
            for k in range(parts.shape[0]):
                anyone[k] |= parts[k]


@in_place_kernel
def add_part(labels, cell, bits):
    """Make a bitset of the cells in the connected part of a cell."""
    bits[:] = ZERO
    for other in range(labels.shape[0]):
        if labels[other] == labels[cell]:
            add(bits, other)


@in_place_kernel
def write_unsettled(tour, rules, w, b, i, time, out):
    """Write to a bitset the cells that need further search; see `settled_cells`."""
    robot = w.robots[b, i]
    fill(out, tour.cells)
    for k in range(out.shape[0]):
        out[k] &= ~w.done[b, i, k]
    if rules.multiplicity == 1:
        return
    limit = silence_limit(robot, rules)
    waits = time < 3 * robot.deadline
    closed = number_of_obstacles(tour, rules, w, b, i, i)
    for cell in range(tour.cells):
        if not holds(out, cell):
            continue
        if tour.stepwise:
            own = holds(w.own[b, i], cell) or knows_obstacle(w, b, i, i, cell)
            if own and is_settled_by_able(tour, w, b, i, cell, time, limit, waits, closed):
                remove(out, cell)
        elif holds(w.own[b, i], cell) and is_settled_by_all(w, b, i, cell, time, limit, waits):
            remove(out, cell)


@in_place_kernel
def allot(tour, rules, partitions, w, b, i, time):
    """Let a robot divide the tour among all robots that it knows; see
    `shoal.search.protocol.robot._allot`. Return False if the world needs something first.
    """
    robot, control = w.robots[b, i], w.control[b]
    if robot.offered_for != robot.peers + 1:
        control.need, control.need_one = A_PARTITION, i
        return False
    division, team_size = robot.offer, robot.peers + 1
    begin = partitions.starts[division]
    own = 0
    while partitions.robots[begin + own] != i:
        own += 1
    if not rules.helping:
        take(robot, division, own, team_size, time)
        robot.deadline = np.inf
        return True
    write_reachable(tour, rules, w, b, i, -np.inf)
    write_unsettled(tour, rules, w, b, i, -np.inf, w.left[b])
    for k in range(w.left.shape[1]):
        w.left[b, k] &= ~w.own[b, i, k]
        if tour.stepwise:
            w.left[b, k] &= w.reach[b, k]
    place = (division, own, np.int64(i), robot.start, robot.at_launch)
    closed = number_of_obstacles(tour, rules, w, b, i, i)
    alone = cost_alone(
        tour, control, rules, partitions, place, w.left[b], robot.cell, robot.fresh, closed
    )
    last = max(
        time + alone / robot.rate, after_others(tour, rules, partitions, w, b, i, division, own)
    )
    if control.need != NOTHING:
        return False
    if robot.status == LISTENING:
        robot.deadline = last
        take(robot, division, own, team_size, time)
    elif last <= robot.deadline + 1e-9:
        take(robot, division, own, team_size, time)
    else:
        robot.allotted_to = team_size
    return True


@in_place_kernel
def take(robot, division, own, team_size, time):
    """Let a robot take its part of a division."""
    robot.partition, robot.own, robot.status = division, own, SEARCHING
    robot.allotted_to, robot.allotted_at = team_size, time


@in_place_kernel
def add_arcs(partitions, division, own, multiplicity, bits, n):
    """Add the cells to a bitset that the robot with a part must search. Return the number of their
    arcs, and the last cell that it searches.
    """
    begin = partitions.starts[division]
    parts = partitions.starts[division + 1] - begin
    arcs, last = 0, 0
    for ahead in range(min(multiplicity, parts)):
        part = begin + (own + ahead) % parts
        for arc in range(partitions.arcs[part], partitions.arcs[part + 1]):
            first, count, step = (
                partitions.first[arc],
                partitions.sizes[arc],
                partitions.step[arc],
            )
            for k in range(count):
                add(bits, (first + step * k) % n)
            arcs, last = arcs + 1, (first + step * (count - 1)) % n
    return arcs, last


@in_place_kernel
def after_others(tour, rules, partitions, w, b, i, division, own):
    """Return when a robot would finish if it searched everything after all others should be done;
    see `shoal.search.protocol.robot._after_others`.
    """
    if not rules.delayed:
        return 0.0
    robot, control, n = w.robots[b, i], w.control[b], tour.cells
    begin = partitions.starts[division]
    parts = partitions.starts[division + 1] - begin
    theirs = w.wanted[b]
    theirs[:] = ZERO
    end, some = 0.0, False
    for index in range(parts):
        number = partitions.robots[begin + index]
        other = w.robots[b, number]
        bits = w.left[b]
        bits[:] = ZERO
        arcs, _ = add_arcs(partitions, division, index, rules.multiplicity, bits, n)
        if arcs == 0 or index == own:
            continue
        closed = number_of_obstacles(tour, rules, w, b, i, number)
        keep_reachable(tour, closed, other.start, bits)
        if is_empty(bits):
            continue
        place = (division, index, number, other.start, np.int64(1))
        for k in range(bits.shape[0]):
            theirs[k] |= bits[k]
        cost = cost_alone(
            tour, control, rules, partitions, place, bits, other.start, np.int64(1), closed
        )
        some = True
        end = max(end, robot.began + other.listening + longest_time(rules, cost, other.rate))
    if not some:
        return 0.0
    bits = w.left[b]
    bits[:] = ZERO
    arcs, last = add_arcs(partitions, division, own, rules.multiplicity, bits, n)
    place = (division, own, np.int64(i), robot.start, robot.at_launch)
    fill(bits, n)
    closed = number_of_obstacles(tour, rules, w, b, i, i)
    keep_reachable(tour, closed, robot.cell, bits)
    keep_reachable(tour, closed, robot.cell, theirs)
    follows = arcs > 0 and holds(bits, last)
    everything = cost_alone(
        tour, control, rules, partitions, place, bits, robot.cell, robot.fresh, closed
    )
    position = last if follows else robot.cell
    launched = np.int64(0) if follows else robot.at_launch
    place = (division, own, np.int64(i), robot.start, launched)
    theirs_cost = cost_alone(
        tour, control, rules, partitions, place, theirs, position, np.int64(not follows), closed
    )
    return end + ARRIVAL * rules.beat + max(everything, theirs_cost) / robot.rate


@in_place_kernel
def keep_reachable(tour, closed, start, bits):
    """Remove the cells from a bitset that no path around closed cells reaches."""
    if tour.stepwise:
        labels = tour.labels[closed]
        for cell in range(tour.cells):
            if labels[cell] != labels[start]:
                remove(bits, cell)


@in_place_kernel
def longest_time(rules, cost, rate):
    """Return an upper bound of the time for a cost; see
    `shoal.search.protocol.robot._longest_time`.
    """
    if cost == np.inf:
        return np.inf
    charges = np.int64(2 * cost // rules.energy) if rules.energy < np.inf else 0
    return (cost + (charges * rules.energy if charges else 0.0)) / rate + charges * rules.recharge


@in_place_kernel
def is_apart(robot, cell, n):
    """Return whether a cell is neither the robot's cell nor one beside it on the tour."""
    ahead = (cell - robot.cell) % n
    return ahead != 0 and ahead != 1 and ahead != n - 1


@in_place_kernel
def own_cell(tour, rules, partitions, robot, remaining):
    """Return the next cell of ``remaining`` in the arcs that the robot must search, or -1."""
    begin = partitions.starts[robot.partition]
    parts = partitions.starts[robot.partition + 1] - begin
    for ahead in range(min(rules.multiplicity, parts)):
        part = begin + (robot.own + ahead) % parts
        for arc in range(partitions.arcs[part], partitions.arcs[part + 1]):
            first, step = partitions.first[arc], partitions.step[arc]
            at, _ = next_stretch(remaining, first, 0, partitions.sizes[arc], step, tour.cells)
            if at >= 0:
                return (first + step * at) % tour.cells
    return -1


@in_place_kernel
def decide(tour, rules, partitions, w, b, i, time):
    """Let a robot without a target choose its next action. Return the action, its cell, and the
    time until which the robot waits; see `shoal.search.protocol.robot.next_action`.

    If the world needs something first, the robot stays as it is, and the result has no meaning.
    """
    robot, control, n = w.robots[b, i], w.control[b], tour.cells
    if rules.ordered:
        cell = robot.order
        if cell < 0:
            robot.status = WAITING
            return NONE, cell, np.inf
        action, wake = head_for(tour, rules, w, b, i, cell, time)
        if control.need == NOTHING:
            robot.order, robot.aim = -1, cell
        return action, cell, wake
    if robot.allotted_to <= robot.peers and not allot(tour, rules, partitions, w, b, i, time):
        return NONE, -1, np.inf
    remaining = w.wanted[b]
    write_reachable(tour, rules, w, b, i, time)
    write_unsettled(tour, rules, w, b, i, time, remaining)
    if tour.stepwise:
        for k in range(remaining.shape[0]):
            remaining[k] &= w.anyone[b, k]
    if is_empty(remaining):
        robot.status, robot.next_beat = COMPLETE, time
        return DECLARE, -1, np.inf
    if rules.multiplicity > 1:
        for k in range(remaining.shape[0]):
            remaining[k] &= ~w.own[b, i, k]
    if tour.stepwise:
        for k in range(remaining.shape[0]):
            remaining[k] &= w.reach[b, k]
    if robot.avoided:
        avoid(w, b, i, remaining, time)
    limit = silence_limit(robot, rules)
    cell, wake = own_cell(tour, rules, partitions, robot, remaining), np.inf
    if (
        cell < 0
        or is_taken(w, b, i, cell, time, limit)
        or (is_apart(robot, cell, n) and leaves_to_others(tour, rules, w, b, i, time, limit))
    ):
        cell, wake = cell_of_others(tour, rules, partitions, w, b, i, cell, time, limit)
    if control.need != NOTHING:
        return NONE, -1, np.inf
    if cell < 0:
        robot.status = WAITING
        return NONE, -1, wake
    apart = is_apart(robot, cell, n)
    action, wake = head_for(tour, rules, w, b, i, cell, time)
    if control.need != NOTHING:
        return NONE, -1, np.inf
    robot.aim = cell
    if apart:
        robot.next_beat = time  # other robots learn at once where this robot helps
    return action, cell, wake


@in_place_kernel
def avoid(w, b, i, remaining, time):
    """Remove the cells that a robot avoids from ``remaining`` if others remain, as long as it
    avoids them.
    """
    robot = w.robots[b, i]
    any_left = False
    for k in range(remaining.shape[0]):
        if remaining[k] & ~w.avoided[b, i, k] != ZERO:
            any_left = True
            break
    if time < robot.avoided_until and any_left:
        for k in range(remaining.shape[0]):
            remaining[k] &= ~w.avoided[b, i, k]
        return
    w.avoided[b, i, :] = ZERO
    robot.avoided = 0


@in_place_kernel
def cell_of_others(tour, rules, partitions, w, b, i, mine, time, limit):
    """Return a cell that the robot searches to help other robots, or -1 and the time until which it
    waits; see `shoal.search.protocol.robot._cell_of_others`.
    """
    robot, control, n = w.robots[b, i], w.control[b], tour.cells
    remaining, scratch = w.wanted[b], w.left[b]
    cell = cell_to_help(tour, rules, partitions, w, b, i, time, limit)
    place, closed = place_of(robot, i), number_of_obstacles(tour, rules, w, b, i, i)
    if cell >= 0 and not (
        is_apart(robot, cell, n) and leaves_to_others(tour, rules, w, b, i, time, limit)
    ):
        need = 1.0 + move_cost(tour, control, robot.cell, cell, robot.fresh, closed)
        need += from_launch(tour, control, i, robot.start, cell) if robot.at_launch else 0.0
        for k in range(scratch.shape[0]):
            scratch[k] = remaining[k]
        remove(scratch, cell)
        need += cost_alone(
            tour, control, rules, partitions, place, scratch, cell, np.int64(0), closed
        )
        if time + need / robot.rate <= robot.deadline + 1e-9:
            return cell, np.inf
    for k in range(scratch.shape[0]):
        scratch[k] = remaining[k]
    some = not is_empty(remaining)
    alone = cost_alone(
        tour, control, rules, partitions, place, scratch, robot.cell, robot.fresh, closed
    )
    last = robot.deadline - alone / robot.rate
    if some and time >= last - 1e-9:
        if mine >= 0:
            return mine, np.inf
        return (robot.cell + ahead_of(remaining, robot.cell, 0, n, n)) % n, np.inf
    wake = last if some else np.inf
    for other in range(w.counts.shape[2]):
        if other != i and w.counts[b, i, other] >= 0:
            silence = w.peers[b, i, other].heard + (limit + 1e-6)
            if silence > time:
                wake = min(wake, silence)
    return -1, wake


@in_place_kernel
def head_for(tour, rules, w, b, i, cell, time):
    """Let a robot go to a cell, or home to recharge; see `shoal.search.protocol.robot.head_for`."""
    robot, control = w.robots[b, i], w.control[b]
    if tour.stepwise:
        return head_along_steps(tour, rules, w, b, i, cell, time)
    back = from_launch(tour, control, i, robot.start, cell)
    cost = 1.0 + move_cost(tour, control, robot.cell, cell, robot.fresh, 0)
    cost += back if robot.at_launch else 0.0
    need = cost
    if robot.left < np.inf:
        need += length(tour, control, cell, robot.start) + back
    if need > robot.left and robot.left < rules.energy:
        away = length(tour, control, robot.cell, robot.start) + rules.recharge * robot.rate
        away += from_launch(tour, control, i, robot.start, robot.cell)
        if control.need == NOTHING:
            robot.status, robot.target, robot.since, robot.cost = SEARCHING, HOME, time, away
        return GO_HOME, np.inf
    if control.need == NOTHING:
        robot.status, robot.target, robot.since, robot.cost = SEARCHING, cell, time, cost
    return GO, np.inf


@in_place_kernel
def head_along_steps(tour, rules, w, b, i, cell, time):
    """Let a robot go to a cell from cell to cell, or home on cells that it knows to be free."""
    robot, control, path = w.robots[b, i], w.control[b], w.path[b, i]
    closed = number_of_obstacles(tour, rules, w, b, i, i)
    back = from_launch(tour, control, i, robot.start, cell)
    out = back if robot.at_launch else 0.0
    cost = 1.0 + move_cost(tour, control, robot.cell, cell, robot.fresh, closed) + out
    if robot.left < np.inf:  # the robot may have to return along the same path
        unsure, row = w.left[b], w.row[b]
        write_unsure(tour, rules, w, b, i, unsure)
        write_distances(tour, robot.cell, unsure, row)
        need = 2 * cost + LOOK + row[robot.start] + back - out
        if need > robot.left and robot.left < rules.energy:
            away = row[robot.start] + rules.recharge * robot.rate
            away += from_launch(tour, control, i, robot.start, robot.cell)
            count = write_path(tour, robot.cell, robot.start, unsure, row, path, 0)
            if count > path.shape[0] and control.need == NOTHING:
                control.need, control.need_one, control.need_other = MEMORY, count, 0
            if control.need == NOTHING:
                robot.status, robot.target, robot.since, robot.cost = SEARCHING, HOME, time, away
                robot.through = count
            return GO_HOME, np.inf
    free = 0.0 if robot.fresh else 1.0
    count = write_move_path(tour, robot.cell, cell, free, closed, path)
    if count > path.shape[0] and control.need == NOTHING:
        control.need, control.need_one, control.need_other = MEMORY, count, 0
    if control.need == NOTHING:
        robot.status, robot.target, robot.since, robot.cost = SEARCHING, cell, time, cost
        robot.through = count
    return GO, np.inf


@in_place_kernel
def write_unsure(tour, rules, w, b, i, unsure):
    """Write the cells that a robot does not know to be free; see
    `shoal.search.protocol.state.free_cells`.
    """
    fill(unsure, tour.cells)
    if rules.multiplicity == 1:
        for k in range(unsure.shape[0]):
            unsure[k] &= ~w.done[b, i, k]
    else:
        for cell in range(tour.cells):
            if w.claims[b, i, cell] > 0:
                remove(unsure, cell)
    for closing in range(w.control[b].closings):
        if holds(w.closed[b, i], closing):
            add(unsure, np.int64(w.shut[b, closing]))
    for k in range(unsure.shape[0]):
        unsure[k] &= ~w.passed[b, i, k]


@in_place_kernel
def takes_over(tour, rules, partitions, w, b, i, time):
    """Return whether a robot begins to search the part of another robot that it presumes dead."""
    robot = w.robots[b, i]
    if robot.partition < 0 or robot.aim < 0:
        return False
    n = tour.cells
    for part in range(partitions.starts[robot.partition], partitions.starts[robot.partition + 1]):
        contains = again = False
        for arc in range(partitions.arcs[part], partitions.arcs[part + 1]):
            first, count, step = (
                partitions.first[arc],
                partitions.sizes[arc],
                partitions.step[arc],
            )
            contains = contains or arc_holds(first, count, step, robot.aim, n)
            again = again or (robot.aimed >= 0 and arc_holds(first, count, step, robot.aimed, n))
        if contains:
            other = partitions.robots[part]
            limit = silence_limit(robot, rules)
            return not again and not is_live(w, b, i, other, time, limit)
    return False
