"""The cell that an idle robot searches next, in its own part or in the part of a dead or late
robot.

Counterpart: `shoal.search.protocol.helping`.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.search.kernels.protocol.bits import holds
from shoal.search.kernels.protocol.costs import (
    length,
    next_stretch,
)
from shoal.search.kernels.protocol.knowledge import can_come, is_late, knows, speed_of
from shoal.search.kernels.protocol.numbers import WORTH
from shoal.search.kernels.protocol.worlds import SEARCHING, WAITING


@in_place_kernel
def cell_to_help(tour, rules, partitions, w, b, i, time, limit):
    """Return the cell that an idle robot searches next, or -1 if no such cell remains, or if the
    robot would save no time there.
    """
    robot, n = w.robots[b, i], tour.cells
    begin = partitions.starts[robot.partition]
    parts = partitions.starts[robot.partition + 1] - begin
    offered = offered_parts(tour, rules, partitions, w, b, i, time, limit)
    if offered == 0:
        return -1
    helpers = 0
    for part in range(begin, begin + parts):
        other = partitions.robots[part]
        if other != i and can_come(tour, w, b, i, other, time, limit):
            w.others[b, helpers] = other
            helpers += 1
    runs = 0
    for k in range(offered):
        part = begin + w.offered[b, k]
        for arc in range(partitions.arcs[part], partitions.arcs[part + 1]):
            runs = add_runs(tour, rules, partitions, w, b, i, arc, helpers, runs, time)
    for k in range(runs):
        run = w.runs[b, k]
        if run.pace == 0.0 and run.first == (robot.cell + run.step) % n:
            return run.first  # the robot continues
    for back in range(1, parts + 1):
        other = partitions.robots[begin + (w.offered[b, 0] - back) % parts]
        if other == i:
            speed = speed_of(w, b, i, i, time, rules)
            best, ahead = best_run(tour, w, b, speed, robot.cell, runs)
            if best < 0:
                return -1
            return (w.runs[b, best].first + w.runs[b, best].step * ahead) % n
        if (
            can_come(tour, w, b, i, other, time, limit)
            and w.peers[b, i, other].status == WAITING
            and not is_late(w, b, i, other, time, rules)
        ):
            speed = speed_of(w, b, i, other, time, rules)
            best, ahead = best_run(tour, w, b, speed, w.peers[b, i, other].place, runs)
            if best >= 0:
                runs = give(w, b, best, ahead, speed, runs, n)
    return -1


@in_place_kernel
def offered_parts(tour, rules, partitions, w, b, i, time, limit):
    """Write the indices of the parts with cells to search for others to the work space, and return
    their number.
    """
    division = w.robots[b, i].partition
    begin = partitions.starts[division]
    parts = partitions.starts[division + 1] - begin
    offered = 0
    for index in range(parts):
        left = False
        for back in range(min(rules.multiplicity, parts)):
            other = partitions.robots[begin + (index - back) % parts]
            if (
                other == i
                or not can_come(tour, w, b, i, other, time, limit)
                or is_late(w, b, i, other, time, rules)
            ):
                left = True
                break
        if not left:
            continue
        for arc in range(partitions.arcs[begin + index], partitions.arcs[begin + index + 1]):
            at, _ = next_stretch(
                w.wanted[b],
                partitions.first[arc],
                0,
                partitions.sizes[arc],
                partitions.step[arc],
                tour.cells,
            )
            if at >= 0:
                w.offered[b, offered] = index
                offered += 1
                break
    return offered


@in_place_kernel
def add_runs(tour, rules, partitions, w, b, i, arc, helpers, runs, time):
    """Add the runs of remaining cells in an arc, in the order of the search, and return the number
    of runs. A new run begins where another robot searches.
    """
    first, size, step = partitions.first[arc], partitions.sizes[arc], partitions.step[arc]
    fronts = find_fronts(tour, rules, w, b, i, first, size, step, helpers, time)
    offset, n = 0, tour.cells
    while offset < size:
        at, count = next_stretch(w.wanted[b], first, offset, size, step, n)
        if at < 0:
            return runs
        run = w.runs[b, runs]
        run.first, run.count, run.step = (first + step * at) % n, count, step
        run.pace, run.late = 0.0, 0.0
        runs += 1
        for k in range(fronts):  # in the order of the search
            ahead = np.int64(w.fronts[b, k, 0]) - at
            if not 0 <= ahead < count:
                continue
            run = w.runs[b, runs - 1]
            front = ahead - (run.first - (first + step * at)) * step % n
            if front == 0:  # the robot searches all of the run
                run.pace, run.late = w.fronts[b, k, 1], w.fronts[b, k, 2]
                continue
            tail = w.runs[b, runs]
            tail.first, tail.count = (run.first + step * front) % n, run.count - front
            tail.step, tail.pace, tail.late = step, w.fronts[b, k, 1], w.fronts[b, k, 2]
            run.count = front
            runs += 1
        offset = at + count
    return runs


@in_place_kernel
def find_fronts(tour, rules, w, b, i, first, size, step, helpers, time):
    """Write to the work space where other robots search in an arc: how far along the arc, in
    increasing order, with which pace, and when they arrive. Return the number of these places.
    """
    fronts, n = 0, tour.cells
    for k in range(helpers):
        other = w.others[b, k]
        peer = w.peers[b, i, other]
        if peer.status != SEARCHING or (peer.place - first) * step % n >= size:
            continue
        cell = peer.place
        pace = speed_of(w, b, i, other, time, rules)
        late = 0.0
        if left_in_arc(w, b, first, size, step, cell, n):
            distance = length(tour, w.control[b], peer.origin, peer.place)
            late = max(peer.since + distance / pace - time, 0.0)
        passed = 0  # the peer has searched these cells since it reported its position
        while (
            passed < n
            and knows(w, b, i, other, cell)
            and not left_in_arc(w, b, first, size, step, cell, n)
        ):
            cell = (cell + step) % n
            passed += 1
        if not left_in_arc(w, b, first, size, step, cell, n):
            continue
        fronts = insert_front(w.fronts[b], fronts, (cell - first) * step % n, pace, late)
    return fronts


@in_place_kernel
def insert_front(fronts, count, ahead, pace, late):
    """Insert a place into the sorted places, and return their number. Of two robots in one cell,
    the faster counts, or the later of two equally fast ones.
    """
    at = count
    while at > 0 and fronts[at - 1, 0] > ahead:
        at -= 1
    if at > 0 and fronts[at - 1, 0] == ahead:
        same = fronts[at - 1]
        if pace > same[1] or (pace == same[1] and late > same[2]):
            same[1], same[2] = pace, late
        return count
    for k in range(count, at, -1):
        fronts[k, 0], fronts[k, 1], fronts[k, 2] = (
            fronts[k - 1, 0],
            fronts[k - 1, 1],
            fronts[k - 1, 2],
        )
    fronts[at, 0], fronts[at, 1], fronts[at, 2] = ahead, pace, late
    return count + 1


@in_place_kernel
def left_in_arc(w, b, first, size, step, cell, n):
    """Return whether a cell of an arc remains."""
    return holds(w.wanted[b], cell) and (cell - first) * step % n < size


@in_place_kernel
def best_run(tour, w, b, speed, at, runs):
    """Return the index of the run in which a helper saves the most time, or with probabilities
    finds the target most probably in each unit of time, or -1; and the number of cells that the
    helper skips at the front of the run.
    """
    longest = (tour.ahead[tour.cells] + tour.cells) / speed
    least = WORTH / speed
    best, skipped, most = -1, 0, -1.0
    for k in range(runs):
        run = w.runs[b, k]
        travel = length(tour, w.control[b], at, run.first) / speed
        alone = min(run.late + run.count / run.pace, longest) if run.pace != 0.0 else 2 * longest
        ahead = cells_to_skip(run, travel, speed)
        # the time without the helper, minus the time until the helper has searched its cells
        work = (run.count - ahead) / speed
        gain = alone - travel - work
        if ahead >= run.count or gain <= least:
            continue
        value = gain
        if tour.likely.shape[0] > 0:
            value = likelihood(tour, run, ahead) / (travel + work)
        if value > most:
            best, skipped, most = k, ahead, value
    return best, skipped


@in_place_kernel
def likelihood(tour, run, ahead):
    """Return the probability that the target is in a run behind its first ``ahead`` cells."""
    count = run.count - ahead
    low = (run.first + ahead if run.step > 0 else run.first - run.count + 1) % tour.cells
    return tour.likely[low + count] - tour.likely[low]


@in_place_kernel
def cells_to_skip(run, travel, pace):
    """Return the number of cells that a helper skips at the front of a run."""
    # a slow robot may not yet have reached the last cell
    if run.pace == 0.0 or run.count == 1:
        return 0
    share = np.ceil((travel - run.late + run.count / pace) / (1 / run.pace + 1 / pace))
    return max(np.int64(share), np.int64(run.late <= travel))


@in_place_kernel
def give(w, b, best, ahead, pace, runs, n):
    """Split a run after its first ``ahead`` cells, and give the rest to a helper; both go to the
    end. Return the number of runs.
    """
    chosen = w.runs[b, best]
    first, count, step, own, late = (
        chosen.first,
        chosen.count,
        chosen.step,
        chosen.pace,
        chosen.late,
    )
    for k in range(best, runs - 1):
        run, after = w.runs[b, k], w.runs[b, k + 1]
        run.first, run.count, run.step = after.first, after.count, after.step
        run.pace, run.late = after.pace, after.late
    runs -= 1
    if ahead > 0:
        run = w.runs[b, runs]
        run.first, run.count, run.step, run.pace, run.late = first, ahead, step, own, late
        runs += 1
    if count > ahead:
        run = w.runs[b, runs]
        run.first, run.count, run.step = (first + step * ahead) % n, count - ahead, step
        run.pace, run.late = pace, 0.0
        runs += 1
    return runs


@in_place_kernel
def is_taken(w, b, i, cell, time, limit):
    """Return whether another live robot is searching a cell or moving to it."""
    for other in range(w.counts.shape[2]):
        if w.counts[b, i, other] >= 0 and other != i:
            peer = w.peers[b, i, other]
            if peer.place == cell and peer.status == SEARCHING and time - peer.heard <= limit:
                return True
    return False


@in_place_kernel
def leaves_to_others(tour, rules, w, b, i, time, limit):
    """Return whether the robot is late, and another robot is idle and not late."""
    if not is_late(w, b, i, i, time, rules):
        return False
    for other in range(w.counts.shape[2]):
        if (
            other != i
            and w.counts[b, i, other] >= 0
            and w.peers[b, i, other].status == WAITING
            and not is_late(w, b, i, other, time, rules)
            and can_come(tour, w, b, i, other, time, limit)
        ):
            return True
    return False
