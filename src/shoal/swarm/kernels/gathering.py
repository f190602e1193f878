"""Gathering: particles that all obey the same commands are brought together.

A cell is its number among the free cells. ``ahead[c, x]`` is the cell that a particle in x enters by
command c, or -1 for a wall. A swarm is an array with the cells of its particles, of which the first
``count`` entries count; under the rule merge, particles that share a cell are one entry.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import (
    COMPLETE,
    MERGE,
    ONE,
    RUNNING,
    TILT,
    ZERO,
    popcount,
    push,
)

FAR = 1 << 30
OPPOSITE = (2, 3, 0, 1, 5, 4)
PARTNERS = 128  # most cells with which each particle's cell is compared
EACH = 2.0  # moves that a cell with particles weighs in the estimate of a swarm
CLOSEST, FARTHEST = 0, 1  # which pair of particles is brought together


@in_place_kernel
def follow(field, rule, region, plan, at, trace, memory):
    """Send the commands of a plan from number ``at`` on, until the trace is full or all particles
    are gathered. Return the number of moves and the status.

    ``region`` is a board, or empty if the particles may gather in any cell. ``memory`` holds the
    number of cells that are left, and the number of moves in a row without effect.
    """
    remaining, played, status = memory[0], 0, RUNNING
    while played < trace.commands.shape[0] and at < plan.shape[0] and status == RUNNING:
        travelled, gathered = 0, 0
        while True:
            moves = push(field, plan[at], rule)[0]
            travelled += moves
            if moves > 0:
                before, remaining = remaining, stragglers(field.occupied, region, field.frontier)
                gathered += before - remaining
            if rule != TILT or moves == 0:
                break
        trace.commands[played] = plan[at]
        trace.classified[played] = gathered
        trace.frontier[played] = remaining
        trace.travelled[played] = travelled
        trace.scanned[played] = True
        memory[1] = 0 if travelled > 0 else memory[1] + 1
        status = COMPLETE if remaining == 0 else RUNNING
        played += 1
        at += 1
    memory[0] = remaining
    return played, status


@in_place_kernel
def stragglers(occupied, region, remaining):
    """Write to ``remaining`` the cells with particles that are not gathered yet: outside the
    region, or without a region all but the first. Return their number.
    """
    count, first = 0, region.shape[0] == 0
    for i in range(occupied.shape[0]):
        word = occupied[i]
        if region.shape[0] > 0:
            word &= ~region[i]
        elif first and word != ZERO:
            word &= word - ONE
            first = False
        remaining[i] = word
        count += popcount(word)
    return count


@in_place_kernel
def sources_of(ahead, may_stay, slides, command, cell, out):
    """Write from where a particle can have come to ``cell`` by a command. Return how many cells."""
    size = 0
    if may_stay[command, cell]:
        out[size] = cell
        size += 1
    elif slides:
        return 0
    behind = ahead[OPPOSITE[command], cell]
    while behind >= 0:
        out[size] = behind
        size += 1
        behind = ahead[OPPOSITE[command], behind] if slides else -1
    return size


@in_place_kernel
def meet_pairs(ahead, may_stay, slides, goal, fewest, queue, ends):
    """Write to ``fewest`` the smallest number of commands that bring two particles together, for
    each pair of cells: into goal cells, or without goal cells into any common cell. -1 stays where
    no commands do.

    The search goes backwards from all pairs of goal cells.
    """
    m, last = ahead.shape[1], 0
    for x in range(m):
        for y in range(m):
            ends_here = x == y
            if goal.shape[0] > 0:
                ends_here = goal[x] and goal[y]
            if ends_here:
                fewest[x * m + y] = 0
                queue[last] = x * m + y
                last += 1
    at = 0
    while at < last:
        pair = queue[at]
        at += 1
        for command in range(ahead.shape[0]):
            first_count = sources_of(ahead, may_stay, slides, command, pair // m, ends[0])
            second_count = sources_of(ahead, may_stay, slides, command, pair % m, ends[1])
            for i in range(first_count):
                for j in range(second_count):
                    before = ends[0, i] * m + ends[1, j]
                    if fewest[before] < 0:
                        fewest[before] = fewest[pair] + 1
                        queue[last] = before
                        last += 1


@in_place_kernel
def measure_paths(ahead, reached, until, steps, queue):
    """Write to ``steps`` the length of the shortest path from the first ``reached`` cells of
    ``queue`` to each cell, or FAR. The search ends early at the cell ``until``, unless it is -1.
    Return the last cell that was reached.
    """
    for cell in range(steps.shape[0]):
        steps[cell] = FAR
    for i in range(reached):
        steps[queue[i]] = 0
    at, last = 0, reached
    while at < last:
        cell = queue[at]
        at += 1
        for command in range(ahead.shape[0]):
            neighbour = ahead[command, cell]
            if neighbour >= 0 and steps[neighbour] == FAR:
                steps[neighbour] = steps[cell] + 1
                queue[last] = neighbour
                last += 1
                if neighbour == until:
                    return neighbour
    return queue[last - 1]


@in_place_kernel
def move_swarm(ahead, rule, command, swarm, count, mark, stamp):
    """Move the particles by one command. Return the number of cells with particles.

    The entries of ``mark`` must differ from ``stamp``.
    """
    if rule == MERGE:
        distinct = 0
        for i in range(count):
            target = ahead[command, swarm[i]]
            if target < 0:
                target = swarm[i]
            if mark[target] != stamp:
                mark[target] = stamp
                swarm[distinct] = target
                distinct += 1
        return distinct
    for i in range(count):
        mark[swarm[i]] = stamp
    for i in range(count):
        # a particle moves by the empty cells before the next wall, under block by one of those that
        # follow the particles right ahead
        steps, target = 0, ahead[command, swarm[i]]
        while target >= 0 and (rule == TILT or steps == 0):
            if mark[target] != stamp:
                steps += 1
            target = ahead[command, target]
        for _ in range(steps):
            swarm[i] = ahead[command, swarm[i]]
    return count


@in_place_kernel
def is_gathered(swarm, count, goal):
    """Return whether all particles are in goal cells, or without goal cells in one cell."""
    if goal.shape[0] == 0:
        return count == 1
    for i in range(count):
        if not goal[swarm[i]]:
            return False
    return True


@in_place_kernel
def estimate(swarm, count, fewest, near, rule):
    """Return the estimate of a swarm: the mean over its cells of the most commands that a particle
    there needs to meet another, plus `EACH` for each cell.

    Without a table ``fewest`` of pairs, a cell counts with its distance ``near`` from the goal, and
    where particles share no cell, `EACH` is for each cell outside the goal.
    """
    total, weighed = 0, 0
    m = near.shape[0]
    every = 1 + (count - 1) // PARTNERS
    for i in range(count):
        farthest = near[swarm[i]]
        if fewest.shape[0] > 0:
            row = swarm[i] * m
            for j in range(0, count, every):
                farthest = max(farthest, fewest[row + swarm[j]])
        total += farthest
        weighed += 1 if fewest.shape[0] > 0 or rule == MERGE or near[swarm[i]] > 0 else 0
    return total / count + EACH * weighed


@in_place_kernel
def sift(scores, order, root, size):
    """Let an entry of a heap, whose first entry has the largest score, sink to its place."""
    while 2 * root + 1 < size:
        child = 2 * root + 1
        if child + 1 < size and scores[order[child + 1]] > scores[order[child]]:
            child += 1
        if scores[order[root]] >= scores[order[child]]:
            return
        order[root], order[child] = order[child], order[root]
        root = child


@in_place_kernel
def choose_best(scores, order, size, count):
    """Write the numbers of the ``count`` smallest scores to ``order``, the smallest first; of equal
    scores the earlier. Return how many there are.
    """
    count = min(count, size)
    for i in range(count):
        order[i] = i
    for root in range(count // 2 - 1, -1, -1):
        sift(scores, order, root, count)
    for i in range(count, size):
        if scores[i] < scores[order[0]]:
            order[0] = i
            sift(scores, order, 0, count)
    for end in range(count - 1, 0, -1):
        order[0], order[end] = order[end], order[0]
        sift(scores, order, 0, end)
    return count


@in_place_kernel
def search_plan(
    ahead,
    rule,
    goal,
    fewest,
    near,
    start,
    swarms,
    counts,
    children,
    child_counts,
    scores,
    order,
    parents,
    commands,
    names,
    table,
    mark,
    patience,
    plan,
):
    """Write a plan that gathers a swarm, found by a beam search. Return its length, and whether it
    gathers the swarm.

    The search keeps as many swarms of each length of plan as ``swarms`` has rows: those with the
    smallest `estimate`, none of them met before. It ends without success after ``patience`` moves
    without a smaller estimate, or where ``parents`` has no more rows; the plan then leads to the
    swarm with the smallest estimate.
    """
    for i in range(start.shape[0]):
        swarms[0, i] = start[i]
    counts[0], size, stamp = start.shape[0], 1, 0
    least, level_of_least, slot_of_least = estimate(start, start.shape[0], fewest, near, rule), 0, 0
    for i in range(mark.shape[0]):
        mark[i] = -1
    for i in range(table.shape[0]):
        table[i] = ZERO
    level, moves = 0, ahead.shape[0]
    while level < parents.shape[0] and level - level_of_least <= patience:
        generated = 0
        for slot in range(size):
            for command in range(moves):
                child = children[generated]
                for i in range(counts[slot]):
                    child[i] = swarms[slot, i]
                count = move_swarm(ahead, rule, command, child, counts[slot], mark, stamp)
                stamp += 1
                name = ZERO
                for i in range(count):
                    name ^= names[child[i]]
                place = np.int64(name % np.uint64(table.shape[0]))
                if table[place] == name:
                    continue
                table[place] = name
                child_counts[generated] = count
                scores[generated] = estimate(child, count, fewest, near, rule)
                order[children.shape[0] + generated] = slot * moves + command
                if is_gathered(child, count, goal):
                    plan[level] = command
                    write_plan(parents, commands, level, slot, plan)
                    return level + 1, True
                generated += 1
        size = choose_best(scores, order, generated, swarms.shape[0])
        for slot in range(size):
            child = order[slot]
            origin = order[children.shape[0] + child]
            parents[level, slot], commands[level, slot] = origin // moves, origin % moves
            counts[slot] = child_counts[child]
            for i in range(counts[slot]):
                swarms[slot, i] = children[child, i]
        level += 1
        if size == 0:
            break
        if scores[order[0]] < least:
            least, level_of_least, slot_of_least = scores[order[0]], level, 0
    write_plan(parents, commands, level_of_least, slot_of_least, plan)
    return level_of_least, False


@in_place_kernel
def write_plan(parents, commands, level, slot, plan):
    """Write the commands that lead to a swarm of the beam search."""
    while level > 0:
        level -= 1
        plan[level] = commands[level, slot]
        slot = parents[level, slot]


@in_place_kernel
def unite_pair(ahead, swarm, count, goal, choice, replans, steps, queue, mark, plan):
    """Write commands that bring two particles of a swarm together, or the only particle into the
    goal cells. Return the number of commands, which is 0 if no pair can meet, and -1 if ``plan``
    has too little room.

    One particle follows a path to the other. The other obeys the same commands, and each command
    that moves it makes the path longer by one, so the path never gets longer. At the end of each
    path, or after each command if ``replans`` is true, a shorter path replaces what is left.
    """
    if count == 1:
        return walk_to_goal(ahead, swarm[0], goal, steps, queue, plan)
    mover, aim = choose_pair(ahead, swarm, count, choice, steps, queue, mark)
    if mover < 0:
        return 0
    measure_paths_from(ahead, mover, aim, steps, queue)
    if steps[aim] > plan.shape[0]:
        return -1
    # plan[first:last] is the path that is left, and `path_end` is where it ended when it was found
    first, last = 0, trace_path(ahead, aim, steps, plan, 0)
    path_end = last
    while mover != aim:
        command = plan[first]
        first += 1
        mover = ahead[command, mover]
        if ahead[command, aim] >= 0:
            aim = ahead[command, aim]
            if last == plan.shape[0]:
                return -1
            plan[last] = command
            last += 1
        if mover != aim and (replans or first == path_end):
            measure_paths_from(ahead, mover, aim, steps, queue)
            if steps[aim] < last - first:
                last = trace_path(ahead, aim, steps, plan, first)
            path_end = last
    return first


@in_place_kernel
def measure_paths_from(ahead, cell, until, steps, queue):
    """Measure the paths from one cell, as far as to the cell ``until``."""
    queue[0] = cell
    return measure_paths(ahead, 1, until, steps, queue)


@in_place_kernel
def trace_path(ahead, cell, steps, plan, at):
    """Write the path to ``cell`` that `measure_paths` has measured, from number ``at`` of the plan
    on. Return the end of the path in the plan.
    """
    end = at + steps[cell]
    for i in range(end - 1, at - 1, -1):
        for command in range(ahead.shape[0]):
            behind = ahead[OPPOSITE[command], cell]
            if behind >= 0 and steps[behind] == steps[cell] - 1:
                plan[i], cell = command, behind
                break
    return end


@in_place_kernel
def walk_to_goal(ahead, cell, goal, steps, queue, plan):
    """Write a shortest path to the nearest goal cell. Return its length."""
    measure_paths_from(ahead, cell, -1, steps, queue)
    nearest = -1
    for aim in range(goal.shape[0]):
        if goal[aim] and steps[aim] < FAR and (nearest < 0 or steps[aim] < steps[nearest]):
            nearest = aim
    if nearest < 0:
        return 0
    if steps[nearest] > plan.shape[0]:
        return -1
    return trace_path(ahead, nearest, steps, plan, 0)


@in_place_kernel
def choose_pair(ahead, swarm, count, choice, steps, queue, mark):
    """Return the cells of the pair of particles that is brought together next, or -1 twice if no
    two particles are connected.

    The closest pair has the shortest path. The farthest pair is the particle that is farthest from
    the first one, and the particle that is farthest from it.
    """
    if choice == FARTHEST:
        for first in range(count):
            particle = farthest_from(ahead, swarm, count, swarm[first], steps, queue)
            if particle != swarm[first]:
                return particle, farthest_from(ahead, swarm, count, particle, steps, queue)
        return -1, -1
    # a search from all particles at once; mark holds the particle from which a cell was reached
    for cell in range(steps.shape[0]):
        steps[cell] = FAR
    for i in range(count):
        queue[i], steps[swarm[i]], mark[swarm[i]] = swarm[i], 0, swarm[i]
    at, last = 0, count
    best, particle, partner = FAR, -1, -1
    while at < last:
        cell = queue[at]
        at += 1
        if 2 * steps[cell] >= best:
            break
        for command in range(ahead.shape[0]):
            neighbour = ahead[command, cell]
            if neighbour < 0:
                continue
            if steps[neighbour] == FAR:
                steps[neighbour], mark[neighbour] = steps[cell] + 1, mark[cell]
                queue[last] = neighbour
                last += 1
            elif mark[neighbour] != mark[cell] and steps[neighbour] + steps[cell] + 1 < best:
                best = steps[neighbour] + steps[cell] + 1
                particle, partner = mark[cell], mark[neighbour]
    return particle, partner


@in_place_kernel
def farthest_from(ahead, swarm, count, cell, steps, queue):
    """Return the particle's cell that is farthest from a cell, of those connected with it."""
    measure_paths_from(ahead, cell, -1, steps, queue)
    best = cell
    for i in range(count):
        if steps[best] < steps[swarm[i]] < FAR:
            best = swarm[i]
    return best
