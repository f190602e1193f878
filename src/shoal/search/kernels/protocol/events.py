"""The simulated world: its queue of events, its radio, and the vehicles of the robots.

Counterpart: `shoal.search.simulation.world`, and `advance` in `shoal.search.protocol.robot`.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.search.kernels.protocol.bits import holds
from shoal.search.kernels.protocol.costs import add as add_cell
from shoal.search.kernels.protocol.costs import between, from_launch, length, move_cost
from shoal.search.kernels.protocol.deciding import (
    DECLARE,
    GO,
    GO_HOME,
    NONE,
    allot,
    decide,
    takes_over,
)
from shoal.search.kernels.protocol.knowledge import (
    claim,
    find,
    hear,
    lag_at,
    pause_before_beacon,
    report_obstacle,
    write_beacon,
)
from shoal.search.kernels.protocol.numbers import AVOIDED, DECISIONS, LOOK, RECORDED, RETRY, TRIES
from shoal.search.kernels.protocol.packets import divide, opens, stamp
from shoal.search.kernels.protocol.steps import (
    OPEN,
    SETS,
    add_crossed,
    label_components,
    length_around,
    length_through,
    obstacle_on,
)
from shoal.search.kernels.protocol.worlds import (
    ARRIVE_HOME,
    BEGIN,
    BURSTS,
    COMPLETE,
    CORRUPTION,
    CRASH,
    DEAD,
    DELAY,
    DELIVERY,
    DUPLICATES,
    ENTER,
    FORGERIES,
    HEARD,
    LISTENING,
    LOSS,
    MEMORY,
    NOTHING,
    NOWHERE,
    OBSTRUCTED,
    PARTITION,
    PAUSE,
    PAUSED,
    RANDOM,
    RANGE,
    REPLAYS,
    SEARCHING,
    SENSE,
    WAITING,
    WAKE,
)

# The queue: a heap by time and number


@in_place_kernel
def comes_before(w, b, first, second):
    """Return whether an entry of the heap comes before another."""
    if w.times[b, first] != w.times[b, second]:
        return w.times[b, first] < w.times[b, second]
    return w.posts[b, first] < w.posts[b, second]


@in_place_kernel
def swap(w, b, first, second):
    """Exchange two entries of the heap."""
    w.times[b, first], w.times[b, second] = w.times[b, second], w.times[b, first]
    w.posts[b, first], w.posts[b, second] = w.posts[b, second], w.posts[b, first]
    w.values[b, first], w.values[b, second] = w.values[b, second], w.values[b, first]
    for k in range(3):
        w.events[b, first, k], w.events[b, second, k] = (
            w.events[b, second, k],
            w.events[b, first, k],
        )


@in_place_kernel
def post(w, b, time, kind, robot, payload, value):
    """Put an event into the queue. Of events at the same time, the one posted first comes first."""
    control = w.control[b]
    at = control.queued
    control.queued += 1
    control.posted += 1
    w.times[b, at], w.posts[b, at], w.values[b, at] = time, control.posted, value
    w.events[b, at, 0], w.events[b, at, 1], w.events[b, at, 2] = kind, robot, payload
    while at > 0 and comes_before(w, b, at, (at - 1) >> 1):
        swap(w, b, at, (at - 1) >> 1)
        at = (at - 1) >> 1


@in_place_kernel
def drop_first(w, b):
    """Remove the first event from the queue."""
    control = w.control[b]
    control.queued -= 1
    last = control.queued
    swap(w, b, 0, last)
    at = 0
    while True:
        child = 2 * at + 1
        if child >= last:
            return
        if child + 1 < last and comes_before(w, b, child + 1, child):
            child += 1
        if not comes_before(w, b, child, at):
            return
        swap(w, b, at, child)
        at = child


@in_place_kernel
def draw_number(w, b):
    """Return the next random number of a world."""
    control = w.control[b]
    control.drawn += 1
    return w.random[b, control.drawn - 1]


# Vehicles


@in_place_kernel
def occupy(w, b, i, cell):
    """Let a robot search in a cell, or with -1 in none. Other robots do not enter this cell."""
    robot = w.robots[b, i]
    if robot.searching >= 0:
        w.occupied[b, robot.searching] -= 1
    robot.searching = cell
    if cell >= 0:
        w.occupied[b, cell] += 1


@in_place_kernel
def note_state(w, b, i, state):
    """Write a new status of a robot to the log."""
    control = w.control[b]
    w.states[b, control.states, 0], w.states[b, control.states, 1] = i, state
    w.stated[b, control.states] = control.time
    control.states += 1
    w.robots[b, i].shown = state


@in_place_kernel
def die(w, b, i):
    """Let a robot stop for ever."""
    occupy(w, b, i, -1)
    w.robots[b, i].alive = 0
    note_state(w, b, i, DEAD)


@in_place_kernel
def true_rate(w, b, i):
    """Return the present speed of a robot."""
    rate = w.robots[b, i].rate
    for k in range(w.slow.shape[2]):
        if w.control[b].time >= w.slow[b, i, k, 0]:
            rate /= w.slow[b, i, k, 1]
    return rate


@in_place_kernel
def spend(w, b, i, cost):
    """Consume energy of a robot, and return whether the energy was enough."""
    robot = w.robots[b, i]
    robot.energy -= cost
    robot.travelled += cost
    if robot.energy >= -1e-9:
        return True
    die(w, b, i)
    return False


@in_place_kernel
def enter(tour, w, b, i, cell):
    """Let a robot enter a cell and search it, or wait in front of it. Return whether the robot
    gives up, and decides again.
    """
    robot, time = w.robots[b, i], w.control[b].time
    rate = true_rate(w, b, i)
    if w.occupied[b, cell] > (robot.searching == cell):
        occupy(w, b, i, -1)
        if robot.tries < TRIES:
            robot.tries += 1
            robot.waited += RETRY / rate
            post(w, b, time + RETRY / rate, ENTER, i, cell, 0.0)
            return False
        robot.place, robot.going = cell, -1
        note_passed(tour, w, b, i, robot.through)
        robot.lag = lag_at(robot, time)
        stop(tour, w, b, i, cell, robot.through, robot.left - robot.cost)
        robot.fresh, robot.avoided, robot.avoided_until = 1, 1, time + AVOIDED
        add_cell(w.avoided[b, i], cell)
        return True
    occupy(w, b, i, cell)
    robot.place = cell
    post(w, b, time + 1.0 / rate, SENSE, i, cell, 0.0)
    return False


@in_place_kernel
def stop(tour, w, b, i, cell, count, left):
    """Let a robot stop in a cell, on its path through so many cells, with so much energy."""
    robot = w.robots[b, i]
    if tour.stepwise:
        add_crossed(tour, robot.cell, w.path[b, i], count, w.passed[b, i])
        robot.through = 0
    robot.left = left
    robot.cell, robot.at_launch, robot.target = cell, 0, NOWHERE


@in_place_kernel
def note_passed(tour, w, b, i, count):
    """Write the first cells of a robot's path to the log."""
    control = w.control[b]
    for k in range(count if tour.stepwise else 0):
        w.passes[b, control.passes, 0], w.passes[b, control.passes, 1] = i, w.path[b, i, k]
        control.passes += 1


@in_place_kernel
def meet_obstacle(tour, rules, w, b, i, cell, at):
    """Let a robot report an obstacle in a cell, and stop in the last cell before it."""
    robot, control, path = w.robots[b, i], w.control[b], w.path[b, i]
    robot.place, robot.going = at, -1
    w.stops[b, control.stops, 0], w.stops[b, control.stops, 1] = i, cell
    w.stopped[b, control.stops] = control.time
    control.stops += 1
    count = 0
    for k in range(robot.through):
        if path[k] == at:
            count = k + 1
            break
    out = from_launch(tour, control, i, robot.start, at) if robot.at_launch else 0.0
    left = robot.left - length_around(tour, robot.cell, at, OPEN) - out - LOOK
    if at != robot.cell:
        robot.fresh = 1
    stop(tour, w, b, i, at, count, left)
    report_obstacle(w, b, i, cell, rules)


@in_place_kernel
def sense(tour, w, b, i, cell, rules):
    """Let a robot search its cell."""
    robot, control = w.robots[b, i], w.control[b]
    chance = rules.detection if holds(w.targets[b], cell) else rules.false_alarm
    if robot.liar:
        chance = 0.5
    if chance > 0 and draw_number(w, b) < chance:
        find(w, b, i, cell)
    new = not holds(w.own[b, i], cell)
    if new and not robot.liar:
        if w.covered[b, cell] == 0 and holds(w.goal[b], cell):
            control.uncovered -= 1
            if control.uncovered == 0:
                control.covered_at = control.time
        w.covered[b, cell] += 1
    w.visits[b, control.visits, 0], w.visits[b, control.visits, 1] = i, cell
    w.visits[b, control.visits, 2] = new and not robot.liar
    w.visited[b, control.visits] = control.time
    control.visits += 1
    if tour.stepwise:
        note_passed(tour, w, b, i, max(robot.through - 1, 0))
        w.passes[b, control.passes, 0], w.passes[b, control.passes, 1] = i, -1
        control.passes += 1
    robot.going, robot.aimed = -1, robot.aim
    robot.lag = lag_at(robot, control.time)
    claim(w, b, i, cell, rules)
    stop(tour, w, b, i, cell, robot.through, robot.left - robot.cost)
    robot.fresh = 0


# Radio


@in_place_kernel
def broadcast(tour, rules, w, b, i, slot):
    """Send a beacon to all other robots. Copies without delay arrive in one event."""
    message, control = w.messages[b, slot], w.control[b]
    message.receivers, message.cursor, message.references = 0, 0, 0
    for other in range(w.robots.shape[1]):
        if other == i:
            continue
        control.sent += 1
        copies = carry_to(tour, rules, w, b, i, other)
        lost = True
        for k in range(copies):
            if w.damaged[b, k]:  # the receiver refuses the copy
                continue
            lost = False
            arrival = control.time + w.delays[b, k]
            if arrival > control.time:
                message.references += 1
                post(w, b, arrival, HEARD, other, slot, 0.0)
            else:
                if message.receivers == 0:
                    message.references += 1
                    post(w, b, control.time, DELIVERY, i, slot, 0.0)
                w.receivers[b, slot, message.receivers] = other
                message.receivers += 1
        control.lost += lost
    if message.references == 0:
        release(w, b, slot)


@in_place_kernel
def broadcast_parts(tour, rules, w, b, i, count):
    """Send the messages of a beacon to all other robots, one event for each copy that they open."""
    control = w.control[b]
    for k in range(count):
        message = w.messages[b, w.parts[b, k]]
        message.stamp, message.references = stamp(w.robots[b, i], control.time), 1
        if rules.recorded:
            message.references += 1
            record_message(w, b, w.parts[b, k])
    for other in range(w.robots.shape[1]):
        if other == i:
            continue
        for k in range(count):
            control.sent += 1
            copies = carry_to(tour, rules, w, b, i, other)
            lost = True
            for copy in range(copies):
                slot = np.int64(w.parts[b, k])
                if w.origin[b, copy] == REPLAYS:
                    records = min(control.recorded, RECORDED)
                    chosen = np.int64(draw_number(w, b) * records)
                    slot = np.int64(w.records[b, (control.recorded - records + chosen) % RECORDED])
                elif w.origin[b, copy] == 0 and not w.damaged[b, copy]:
                    lost = False
                # nobody opens a damaged message, or one without the key
                if not w.damaged[b, copy] and w.origin[b, copy] != FORGERIES:
                    w.messages[b, slot].references += 1
                    post(w, b, control.time + w.delays[b, copy], HEARD, other, slot, 0.0)
            control.lost += lost
    for k in range(count):
        drop_reference(w, b, np.int64(w.parts[b, k]))


@in_place_kernel
def record_message(w, b, slot):
    """Let an attacker record a message, in place of the oldest of many."""
    control = w.control[b]
    at = control.recorded % RECORDED
    if control.recorded >= RECORDED:
        drop_reference(w, b, np.int64(w.records[b, at]))
    w.records[b, at] = slot
    control.recorded += 1


@in_place_kernel
def drop_reference(w, b, slot):
    """Free the place of a message if nobody will receive or record it any more."""
    w.messages[b, slot].references -= 1
    if w.messages[b, slot].references == 0:
        release(w, b, slot)


@in_place_kernel
def carry_to(tour, rules, w, b, i, other):
    """Return how many copies of a message arrive at another robot, and write what is known of each
    to the work space.
    """
    if not w.robots[b, other].alive:
        return 0
    away = 0.0
    for k in range(rules.media.shape[0]):
        if rules.media[k] == RANGE:
            away = between(tour, w.robots[b, i].place, w.robots[b, other].place)
    return carry(rules, w, b, i, other, away)


@in_place_kernel
def carry(rules, w, b, sender, receiver, away):
    """Send a message through all models of the network, write the delay of each copy that arrives,
    whether it is damaged and which attacker sends it to the work space, and return the number of
    copies.
    """
    delays, damaged, origin, copies = w.delays[b], w.damaged[b], w.origin[b], 1
    delays[0], damaged[0], origin[0] = 0.0, 0, 0
    for k in range(rules.media.shape[0]):
        kind, number = rules.media[k], rules.numbers[k]
        if kind == LOSS:
            arriving = 0
            for copy in range(copies):
                if draw_number(w, b) >= number[0]:
                    delays[arriving], damaged[arriving] = delays[copy], damaged[copy]
                    origin[arriving] = origin[copy]
                    arriving += 1
            copies = arriving
        elif kind == BURSTS:
            bad = w.bad[b, k]
            if bad[sender, receiver]:
                bad[sender, receiver] = draw_number(w, b) >= number[1]
            else:
                bad[sender, receiver] = draw_number(w, b) < number[0]
            if bad[sender, receiver]:
                copies = 0
        elif kind == RANGE:
            if away > number[0]:
                copies = 0
        elif kind == PARTITION:
            if (sender - receiver) % 2 and number[0] <= w.control[b].time < number[1]:
                copies = 0
        elif kind == DELAY:
            for copy in range(copies):
                delays[copy] += 2 * number[0] * draw_number(w, b)
        elif kind == DUPLICATES:
            again = copies
            for copy in range(copies):
                if draw_number(w, b) < number[0]:
                    delays[again] = delays[copy] + draw_number(w, b)
                    damaged[again], origin[again] = damaged[copy], origin[copy]
                    again += 1
            copies = again
        elif kind == CORRUPTION:
            for copy in range(copies):
                if not damaged[copy]:
                    damaged[copy] = draw_number(w, b) < number[0]
        elif draw_number(w, b) < number[0]:  # replays and forgeries
            delays[copies], damaged[copies], origin[copies] = 0.0, 0, kind
            copies += 1
        if copies == 0:
            break
    return copies


@in_place_kernel
def release(w, b, slot):
    """Free the place of a message that no robot will receive any more."""
    control = w.control[b]
    w.free[b, control.slots] = slot
    control.slots += 1


# Events


@in_place_kernel
def is_ready(rules, w, b):
    """Return whether there is room for all that one event may make; otherwise, the world asks for
    it.
    """
    control, robots = w.control[b], w.robots.shape[1]
    if (
        control.queued + robots * rules.copies + 4 > w.times.shape[1]
        or control.slots == 0
        or control.words + 1 > w.owner.shape[1]
        or control.findings + 1 > w.finder.shape[1]
        or control.visits + 1 > w.visited.shape[1]
        or control.states + 4 > w.stated.shape[1]
        or control.closings + 1 > w.closer.shape[1]
        or control.stops + 1 > w.stopped.shape[1]
        or control.passes + w.path.shape[2] + 1 > w.passes.shape[1]
    ):
        control.need, control.need_one, control.need_other = MEMORY, 0, 0
    elif control.drawn + rules.draws > w.random.shape[1]:
        control.need, control.need_other = RANDOM, 0
    return control.need == NOTHING


@in_place_kernel
def advance(tour, rules, partitions, w, b):
    """Let the robot that an event has reached decide and act. Return False if the world needs
    something first; then the next call continues at the same point.
    """
    control = w.control[b]
    i, time = control.pending, control.time
    robot = w.robots[b, i]
    if control.stage == 0:
        if robot.status == LISTENING and time >= robot.began + robot.listening - 1e-9:
            if not allot(tour, rules, partitions, w, b, i, time):
                return False
        action, cell, wake = NONE, np.int64(-1), np.inf
        if (robot.status == SEARCHING or robot.status == WAITING) and robot.target == NOWHERE:
            if (
                control.heard
                and robot.status == WAITING
                and time < robot.waits_until
                and (robot.unheeded + 1) * DECISIONS < robot.peers
            ):
                robot.unheeded += 1
                wake = robot.waits_until
            else:
                action, cell, wake = decide(tour, rules, partitions, w, b, i, time)
                if control.need != NOTHING:
                    return False
                if action == NONE or action == DECLARE:
                    robot.unheeded, robot.waits_until = 0, wake
        control.action, control.cell, control.waking = action, cell, wake
        if robot.shown != robot.status:
            note_state(w, b, i, robot.status)
        if robot.status == WAITING or robot.status == COMPLETE:
            occupy(w, b, i, -1)  # the robot stands aside
        control.stage = 1
    if control.stage == 1:
        if not act(tour, rules, partitions, w, b, i):
            return False
        control.stage = 2
    if robot.status != COMPLETE or robot.lingering > 0 or control.stage == 3:
        if control.stage == 2 and time >= robot.next_beat - 1e-9:
            make_beacon(tour, rules, w, b, i)
            control.stage = 3
        if control.stage == 3:
            if rules.longest == 0:
                broadcast(tour, rules, w, b, i, control.last)
            elif not send_parts(tour, rules, w, b, i):
                return False
            control.stage = 4
    if control.stage == 4 or robot.status != COMPLETE or robot.lingering > 0:
        wake = min(control.waking, robot.next_beat)
        if robot.status == LISTENING:
            wake = min(wake, robot.began + robot.listening)
        if wake < np.inf and wake != robot.wake:
            post(w, b, max(wake, time), WAKE, i, 0, wake)
        robot.wake = wake
    control.pending = -1
    return True


@in_place_kernel
def act(tour, rules, partitions, w, b, i):
    """Let a vehicle do what its robot has decided. Return False if the world needs something
    first.
    """
    control, robot = w.control[b], w.robots[b, i]
    if control.action == GO:
        cell = control.cell
        if tour.stepwise and robot.through > 0:
            cost = robot.cost
        else:
            cost = 1.0 + move_cost(tour, control, robot.place, cell, robot.fresh, OPEN)
            if robot.at_launch:
                cost += from_launch(tour, control, i, robot.place, cell)
        if control.need != NOTHING:
            return False
        control.takeovers += takes_over(tour, rules, partitions, w, b, i, control.time)
        robot.going, robot.tries = cell, 0
        if tour.stepwise and stops_before(tour, w, b, i):
            return True
        if spend(w, b, i, cost):
            if cost > 1.0 + 1e-12:
                occupy(w, b, i, -1)  # during the motion the robot occupies no cell
            rate = true_rate(w, b, i)
            post(w, b, control.time + (cost - 1.0) / rate, ENTER, i, cell, 0.0)
    elif control.action == GO_HOME:
        if tour.stepwise and robot.through > 0:
            away = length_through(tour, robot.place, w.path[b, i], robot.through)
        else:
            away = length(tour, control, robot.place, robot.start)
        away += from_launch(tour, control, i, robot.start, robot.place)
        if control.need != NOTHING:
            return False
        occupy(w, b, i, -1)
        note_passed(tour, w, b, i, robot.through)
        robot.through = 0
        if spend(w, b, i, away):
            time = control.time + away / true_rate(w, b, i) + rules.recharge
            post(w, b, time, ARRIVE_HOME, i, 0, 0.0)
    elif control.action == DECLARE:
        robot.declared = control.time
    return True


@in_place_kernel
def stops_before(tour, w, b, i):
    """Let a robot go to the last cell before an obstacle on its path, and return whether there is
    an obstacle.
    """
    robot, control, path = w.robots[b, i], w.control[b], w.path[b, i]
    cell, free = obstacle_on(tour, robot.place, path, robot.through, w.blocked[b])
    if cell < 0:
        return False
    out = from_launch(tour, control, i, robot.start, robot.place) if robot.at_launch else 0.0
    cost = length_through(tour, robot.place, path, free) + LOOK + out
    occupy(w, b, i, -1)
    if spend(w, b, i, cost):
        at = path[free - 1] if free else robot.place
        note_passed(tour, w, b, i, free)
        time = control.time + cost / true_rate(w, b, i)
        post(w, b, time, OBSTRUCTED, i, np.int64(cell), float(at))
    return True


@in_place_kernel
def make_beacon(tour, rules, w, b, i):
    """Let a robot write its beacon."""
    robot, control = w.robots[b, i], w.control[b]
    pause = pause_before_beacon(robot, control.time, rules)
    robot.count += 1
    robot.next_beat = control.time + pause
    if robot.status == COMPLETE:
        robot.lingering -= 1
    control.slots -= 1
    slot = np.int64(w.free[b, control.slots])
    control.last = slot
    write_beacon(w, b, i, slot, control.time, tour.cells)


@in_place_kernel
def send_parts(tour, rules, w, b, i):
    """Let a robot send the messages into which its beacon is divided. Return False if the world
    needs room for them first.
    """
    control = w.control[b]
    whole = control.last
    count = divide(w, b, whole, rules.longest, False)
    events = count * rules.copies * w.robots.shape[1]
    if (
        control.slots < count
        or count > w.parts.shape[1]
        or control.queued + events + 4 > w.times.shape[1]
    ):
        control.need, control.need_one, control.need_other = MEMORY, 0, count
        return False
    if control.drawn + count * rules.draws > w.random.shape[1]:
        control.need, control.need_other = RANDOM, count
        return False
    for k in range(count):
        control.slots -= 1
        slot = np.int64(w.free[b, control.slots])
        w.parts[b, k] = slot
        message = w.messages[b, slot]
        message.sender = i
        message.heartbeats = message.words = message.findings = message.closings = 0
    divide(w, b, whole, rules.longest, True)
    broadcast_parts(tour, rules, w, b, i, count)
    release(w, b, whole)
    return True


@in_place_kernel
def play_next(tour, rules, w, b):
    """Let the next event of the queue happen."""
    control = w.control[b]
    kind, i, payload = w.events[b, 0, 0], w.events[b, 0, 1], w.events[b, 0, 2]
    value = w.values[b, 0]
    control.time = w.times[b, 0]
    if kind == DELIVERY:
        deliver_next(rules, w, b, payload)
        return
    drop_first(w, b)
    robot, time = w.robots[b, i], control.time
    if kind == HEARD:
        if (
            robot.alive
            and time >= robot.paused_until
            and (rules.longest == 0 or opens(w, b, i, payload, time, rules))
        ):
            hear(w, b, i, payload, time, rules)
            control.pending, control.stage, control.heard = i, 0, 1
        drop_reference(w, b, payload)
        return
    if not robot.alive:
        return
    if kind == CRASH:
        die(w, b, i)
        return
    if kind == PAUSE:
        occupy(w, b, i, -1)
        robot.paused_until = max(robot.paused_until, value)
        note_state(w, b, i, PAUSED)
        return
    if time < robot.paused_until:
        post(w, b, robot.paused_until, kind, i, payload, value)
        return
    decides = True
    if kind == BEGIN:
        robot.began = robot.next_beat = time
        robot.cell, robot.at_launch, robot.left = robot.start, 1, rules.energy
        if tour.stepwise:
            add_cell(w.passed[b, i], robot.start)
    elif kind == WAKE:
        decides = value == robot.wake  # the robot has made no newer request
        if decides:
            robot.wake = np.inf
    elif kind == ENTER:
        decides = enter(tour, w, b, i, payload)
    elif kind == OBSTRUCTED:
        meet_obstacle(tour, rules, w, b, i, payload, np.int64(value))
    elif kind == SENSE:
        if robot.searching == payload:
            sense(tour, w, b, i, payload, rules)
        else:  # a pause has interrupted the search, so the robot must enter the cell again
            decides = enter(tour, w, b, i, payload)
    elif kind == ARRIVE_HOME:
        robot.place, robot.energy = robot.start, robot.full
        robot.lag = lag_at(robot, time)
        robot.cell, robot.fresh, robot.at_launch = robot.start, 1, 1
        robot.target, robot.left = NOWHERE, rules.energy
    if decides:
        control.pending, control.stage, control.heard = i, 0, 0


@in_place_kernel
def is_busy(robot, time):
    """Return whether a robot only goes on after a message: it is on its way, and waits for nothing
    but its next beacon.
    """
    return (
        robot.status == SEARCHING
        and robot.shown == SEARCHING
        and robot.target != NOWHERE
        and time < robot.next_beat - 1e-9
        and robot.wake == robot.next_beat
    )


@in_place_kernel
def deliver_next(rules, w, b, slot):
    """Let the next receivers of a message hear it, up to one that decides what it does."""
    control, message, receivers = w.control[b], w.messages[b, slot], w.receivers[b, slot]
    time = control.time
    while message.cursor < message.receivers and control.pending < 0:
        i = np.int64(receivers[message.cursor])
        message.cursor += 1
        robot = w.robots[b, i]
        if robot.alive and time >= robot.paused_until:
            hear(w, b, i, slot, time, rules)
            if not is_busy(robot, time):
                control.pending, control.stage, control.heard = i, 0, 1
    if message.cursor == message.receivers:
        drop_first(w, b)
        message.references -= 1
        if message.references == 0:
            release(w, b, slot)


@in_place_kernel
def start(tour, w, b, faults):
    """Switch on all robots of a world. The rows of ``faults`` are kinds, robots, times, and ends of
    pauses.
    """
    if tour.stepwise and tour.counters[SETS] == 0:  # the empty set
        tour.counters[SETS] = 1
        label_components(tour, tour.sets[OPEN], tour.labels[OPEN])
    for k in range(faults.shape[0]):
        kind, i = np.int64(faults[k, 0]), np.int64(faults[k, 1])
        post(w, b, faults[k, 2], kind, i, 0, faults[k, 3])
    for i in range(w.robots.shape[1]):
        post(w, b, 0.0, BEGIN, i, 0, 0.0)


@in_place_kernel
def run(tour, rules, partitions, w, b, until):
    """Simulate a world up to the time ``until``, at most ``control.most`` events. Return False if the world
    needs something first (``control.need``).
    """
    control = w.control[b]
    control.need = NOTHING
    while True:
        if control.pending >= 0 and not advance(tour, rules, partitions, w, b):
            return False
        if control.queued == 0 or w.times[b, 0] > until or control.most == 0:
            return True
        if not is_ready(rules, w, b):
            return False
        control.most -= 1
        play_next(tour, rules, w, b)
