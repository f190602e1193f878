"""What a robot learns from a beacon, and what its own beacons tell.

Counterparts: `receive`, `with_beacon` and what they call in `shoal.search.protocol.robot`, and the
failure detector of `shoal.search.protocol.state`.
"""

from __future__ import annotations

from math import log

import numpy as np

from shoal.jit import in_place_kernel
from shoal.search.kernels.protocol.bits import ONE, ZERO, highest, holds, lowest
from shoal.search.kernels.protocol.costs import (
    add,
)
from shoal.search.kernels.protocol.numbers import (
    BEATS,
    CRAWL,
    FALSE_POSITIVE_RATE,
    HELLOS,
    LAG_UNIT,
    LAST_ROUND,
    LEAST,
    LONGEST_SILENCE,
    MARK,
    MOST,
    MOST_RELAYED,
    NEWS,
    RELAYED,
    RELUCTANCE,
    REPEATED,
    ROUND,
    SHORTEST_SILENCE,
    TOLERATED,
)
from shoal.search.kernels.protocol.steps import VERSION, number_of_set
from shoal.search.kernels.protocol.worlds import COMPLETE, LISTENING


@in_place_kernel
def fact_of(w, b, other, cell):
    """Return the fact that a robot claims to have searched a cell, or -1 if it does not."""
    fact = np.int64(w.head[b, cell])
    while fact >= 0 and w.owner[b, fact >> 6] != other:
        fact = np.int64(w.next[b, fact])
    return fact


@in_place_kernel
def knows(w, b, i, other, cell):
    """Return whether a robot knows that another robot claims to have searched a cell."""
    fact = fact_of(w, b, other, cell)
    return fact >= 0 and holds(w.known[b, i], fact)


@in_place_kernel
def learn(w, b, i, word, new, rules):
    """Let a robot learn the facts of a word that it does not know."""
    robot, facts, owner = w.robots[b, i], w.known[b, i], w.owner[b, word]
    while new != ZERO:
        fact = (word << 6) + lowest(new)
        before, behind = w.after[b, fact], w.ahead[b, fact]
        facts[word] |= ONE << np.uint64(fact & 63)
        robot.learned += 1
        robot.intervals += 1
        if before >= 0 and holds(facts, before):
            robot.intervals -= 1
        if behind >= 0 and holds(facts, behind):
            robot.intervals -= 1
        w.told[b, i, owner] += 1
        settle(w, b, i, np.int64(w.cells[b, fact]), rules)
        new &= new - ONE


@in_place_kernel
def settle(w, b, i, cell, rules):
    """Let a robot know that one more robot has searched a cell, or found an obstacle in it."""
    if rules.multiplicity == 1:
        add(w.done[b, i], cell)
        return
    w.claims[b, i, cell] += 1
    if w.claims[b, i, cell] == rules.multiplicity:
        add(w.done[b, i], cell)


@in_place_kernel
def report_obstacle(w, b, i, cell, rules):
    """Let a robot report that a cell contains an obstacle."""
    control = w.control[b]
    for closing in range(control.closings):
        if w.shut[b, closing] == cell and w.closer[b, closing] == i:
            return
    closing = control.closings
    w.shut[b, closing], w.closer[b, closing] = cell, i
    control.closings += 1
    learn_obstacles(w, b, i, closing >> 6, ONE << np.uint64(closing & 63), rules)


@in_place_kernel
def learn_obstacles(w, b, i, word, new, rules):
    """Let a robot learn the obstacles of a word that it does not know."""
    w.closed[b, i, word] |= new
    w.robots[b, i].shut = -1
    while new != ZERO:
        settle(w, b, i, np.int64(w.shut[b, (word << 6) + lowest(new)]), rules)
        new &= new - ONE


@in_place_kernel
def knows_obstacle(w, b, i, other, cell):
    """Return whether a robot knows that another one reports an obstacle in a cell."""
    for closing in range(w.control[b].closings):
        if (
            w.shut[b, closing] == cell
            and w.closer[b, closing] == other
            and holds(w.closed[b, i], closing)
        ):
            return True
    return False


@in_place_kernel
def number_of_obstacles(tour, rules, w, b, i, number):
    """Return the number of the set of obstacles that a robot knows, if it were the robot
    ``number``: those that this one reports, or enough robots; see
    `shoal.search.protocol.state.obstacles`. The number is valid until the next call.
    """
    if not tour.stepwise:
        return 0
    robot, count, bits = w.robots[b, i], w.control[b].closings, w.settled[b]
    if number == i and robot.shut >= 0 and robot.shut_version == tour.counters[VERSION]:
        return robot.shut
    bits[:] = ZERO
    for closing in range(count):
        if not holds(w.closed[b, i], closing):
            continue
        cell, reports = w.shut[b, closing], 0
        for other in range(count):
            reports += w.shut[b, other] == cell and holds(w.closed[b, i], other)
        if w.closer[b, closing] == number or reports >= rules.multiplicity:
            add(bits, np.int64(cell))
    set_number = number_of_set(tour, bits)
    if number == i:
        robot.shut, robot.shut_version = set_number, tour.counters[VERSION]
    return set_number


@in_place_kernel
def claim(w, b, i, cell, rules):
    """Let a robot claim to have searched a cell."""
    robot, control = w.robots[b, i], w.control[b]
    if holds(w.own[b, i], cell):
        return
    if robot.facts & 63 == 0:
        w.owner[b, control.words] = i
        robot.word = control.words
        control.words += 1
        w.span[b, robot.word, 0] = w.span[b, robot.word, 1] = cell
    fact = (robot.word << 6) + (robot.facts & 63)
    w.span[b, robot.word, 0] = min(w.span[b, robot.word, 0], cell)
    w.span[b, robot.word, 1] = max(w.span[b, robot.word, 1], cell)
    robot.facts += 1
    w.cells[b, fact] = cell
    w.after[b, fact] = w.ahead[b, fact] = -1
    if cell > 0:
        link(w, b, fact, fact_of(w, b, i, cell - 1))
    if cell + 1 < w.head.shape[1]:
        link(w, b, fact_of(w, b, i, cell + 1), fact)
    w.next[b, fact] = w.head[b, cell]
    w.head[b, cell] = fact
    add(w.own[b, i], cell)
    learn(w, b, i, fact >> 6, ONE << np.uint64(fact & 63), rules)


@in_place_kernel
def link(w, b, fact, before):
    """Note that a robot claims a cell with one fact, and the cell before with another one."""
    if fact < 0 or before < 0:
        return
    w.after[b, fact], w.ahead[b, before] = before, fact
    if fact >> 6 == before >> 6:
        bit = ONE << np.uint64(fact & 63)
        if before == fact - 1:
            w.linked[b, fact >> 6, 0] |= bit
        elif before == fact + 1:
            w.linked[b, fact >> 6, 1] |= bit


@in_place_kernel
def find(w, b, i, cell):
    """Let a robot report that it found something in a cell."""
    control = w.control[b]
    for finding in range(control.findings):
        if w.place[b, finding] == cell and w.finder[b, finding] == i:
            return
    finding = control.findings
    w.place[b, finding], w.finder[b, finding] = cell, i
    control.findings += 1
    add(w.reported[b, i], finding)


@in_place_kernel
def hear(w, b, i, slot, time, rules):
    """Let a robot hear a beacon."""
    robot, message = w.robots[b, i], w.messages[b, slot]
    facts, words, bits = w.known[b, i], w.word[b, slot], w.bits[b, slot]
    beats, counts = w.beats[b, slot], w.counts[b, i]
    for k in range(message.words):
        word = words[k]
        new = bits[k] & ~facts[word]
        if new != ZERO:
            learn(w, b, i, word, new, rules)
    for k in range(message.heartbeats):
        other, count = beats[k, 0], beats[k, 1]
        before = np.int64(counts[other])
        if other == i or before >= count:
            continue
        peer = w.peers[b, i, other]
        place, lag = w.beats[b, slot, k, 3], w.lags[b, slot, k]
        if before < 0:
            robot.peers += 1
            peer.origin, peer.place, peer.since = w.robots[b, other].start, place, time
            peer.then, peer.lag_then, peer.later, peer.lag_later = time, lag, time, lag
        else:
            if other == message.sender:
                robot.lost += count - before - 1
                robot.received += 1
            if time - peer.later >= MARK * rules.beat:
                peer.then, peer.lag_then = peer.later, peer.lag_later
                peer.later, peer.lag_later = time, lag
            if peer.place != place:
                peer.origin, peer.place, peer.since = peer.place, place, time
        w.counts[b, i, other] = count
        peer.status, peer.lag, peer.heard = w.beats[b, slot, k, 2], lag, time
    for k in range(message.findings):
        word = w.finding_word[b, slot, k]
        w.reported[b, i, word] |= w.finding_bits[b, slot, k]
    for k in range(message.closings):
        word = w.closing_word[b, slot, k]
        new = w.closing_bits[b, slot, k] & ~w.closed[b, i, word]
        if new != ZERO:
            learn_obstacles(w, b, i, word, new, rules)


# Beacons


@in_place_kernel
def width_of_window(w, b, i, n):
    """Return how many cells from the cell ``window`` on the next beacon repeats facts of: the half,
    quarter, ... of the tour in which few enough intervals of facts begin; see
    `shoal.search.protocol.robot._window`. Return the number of facts, too, if they have been
    gathered, or else -1.
    """
    robot, begun, first = w.robots[b, i], w.begun[b], w.robots[b, i].window
    begun[:] = 0
    cut = 0  # intervals of obstacles that the beginning of the section cuts
    for k in range((w.control[b].findings + 63) >> 6):
        bits = w.reported[b, i, k]
        while bits != ZERO:
            finding = (k << 6) + lowest(bits)
            bits &= bits - ONE
            if is_first_finding(w, b, i, finding):
                begun[level_of((w.place[b, finding] - first) % n, n)] += 1
    for closing in range(w.control[b].closings):
        if not holds(w.closed[b, i], closing):
            continue
        cell = np.int64(w.shut[b, closing])
        if cell == 0 or not knows_obstacle(w, b, i, w.closer[b, closing], cell - 1):
            begun[level_of((cell - first) % n, n)] += 1
        elif cell == first:
            cut += 1
    begun_total = np.int64(0)
    for k in range(begun.shape[0]):
        begun_total += begun[k]
    total = robot.intervals + begun_total
    rounds = LAST_ROUND if robot.status == COMPLETE else ROUND
    share = max(LEAST, min((total + rounds - 1) // rounds, MOST))
    if total <= share:
        return n, -1
    # count in longer and longer sections, or in all words
    words = w.control[b].words
    if 4 * robot.learned * share < total * (2 * words + 12 * robot.intervals):
        levels, count, covered, gathered = level_of(0, n), cut, 0, 0
        for level in range(levels, -1, -1):
            width = width_at(level, n)
            count += begun[level]
            more, facts = gather(w, b, i, first, covered, width, gathered, share - count)
            count += more
            if count > share and covered:
                break
            covered, gathered = width, facts
            if count > share:
                break
        return covered, gathered
    total += cut + count_by_level(w, b, i, first, n)
    width, level = n, 0
    while width > 1 and total > share:
        total -= begun[level]
        width, level = (width + 1) // 2, level + 1
    return width, -1


@in_place_kernel
def count_by_level(w, b, i, first, n):
    """Count the intervals of known facts by the level of the cell in which they begin, and return
    the number of intervals that the beginning of the section cuts.
    """
    begun, facts, afters, cells = w.begun[b], w.known[b, i], w.after[b], w.cells[b]
    cut = 0
    for k in range(w.control[b].words):
        bits = facts[k]
        if not w.span[b, k, 0] <= first <= w.span[b, k, 1]:
            bits &= ~((bits << ONE) & w.linked[b, k, 0] | (bits >> ONE) & w.linked[b, k, 1])
        while bits != ZERO:
            fact = (k << 6) + lowest(bits)
            bits &= bits - ONE
            after, ahead = afters[fact], cells[fact] - first
            if after < 0 or not holds(facts, after):
                begun[level_of(ahead + n if ahead < 0 else ahead, n)] += 1
            elif ahead == 0:
                cut += 1
    return cut


@in_place_kernel
def width_at(level, n):
    """Return the width of a section after so many halvings."""
    for _ in range(level):
        n = (n + 1) // 2
    return n


@in_place_kernel
def gather(w, b, i, first, begin, width, gathered, most):
    """Append the known facts of a section, from ``begin`` cells ahead of its first one on, to those
    ``gathered``. Return the number of intervals that begin there, and of gathered facts; stop at
    the cell with the first interval above ``most``.
    """
    learnt, facts, n, count = w.known[b, i], w.gathered[b], w.head.shape[1], 0
    for ahead in range(begin, width):
        cell = first + ahead
        fact = np.int64(w.head[b, cell - n if cell >= n else cell])
        while fact >= 0:
            if holds(learnt, fact):
                facts[gathered] = fact
                gathered += 1
                before = np.int64(w.after[b, fact])
                count += ahead == 0 or before < 0 or not holds(learnt, before)
            fact = np.int64(w.next[b, fact])
        if count > most:
            break
    return count, gathered


@in_place_kernel
def level_of(ahead, n):
    """Return how often the width of a section of n cells is halved as long as it contains a cell
    so far ahead: a section of ceil(n / 2^k) cells contains it if 2^k times ``ahead`` is below n.
    """
    if n == 1:
        return 0
    last = np.uint64(n - 1)
    if ahead == 0:
        return highest(last) + 1
    level = highest(last) - highest(np.uint64(ahead))
    return level - (np.int64(ahead) << level >= n)


@in_place_kernel
def is_first_finding(w, b, i, finding):
    """Return whether no earlier finding in the same cell is known to a robot."""
    for other in range(finding):
        if w.place[b, other] == w.place[b, finding] and holds(w.reported[b, i], other):
            return False
    return True


@in_place_kernel
def choose_news(w, b, i, turn):
    """Mark the robots of which the next beacon tells what is new: the robot itself, and of the
    others with news as many as fit, in turn.
    """
    telling = w.telling[b]
    telling[:] = 0
    for k in range(w.control[b].words):
        if w.known[b, i, k] & ~w.before[b, i, turn, k] != ZERO:
            telling[w.owner[b, k]] = 1
    choose_in_turn(w, b, i)


@in_place_kernel
def choose_in_turn(w, b, i):
    """Keep of the marked robots those of which the next beacon tells what is new."""
    telling = w.telling[b]
    telling[i] = 0
    count = 0
    for other in range(telling.shape[0]):
        count += telling[other]
    first = w.robots[b, i].count * NEWS % count if count > NEWS else 0
    order = 0
    for other in range(telling.shape[0]):
        if telling[other]:
            telling[other] = (order - first) % count < NEWS
            order += 1
    telling[i] = 1


@in_place_kernel
def facts_in(w, b, word, bits, first, width, n):
    """Return those facts of a word whose cells are in a section of the tour."""
    low, size = np.int64(w.span[b, word, 0]), w.span[b, word, 1] - w.span[b, word, 0]
    at = (low - first) % n
    if at + size < width:
        return bits
    if at >= width and at + size < n:
        return ZERO
    inside, remaining, cells = ZERO, bits, w.cells[b]
    while remaining != ZERO:
        bit = lowest(remaining)
        ahead = cells[(word << 6) + bit] - first
        if (ahead + n if ahead < 0 else ahead) < width:
            inside |= ONE << np.uint64(bit)
        remaining &= remaining - ONE
    return inside


@in_place_kernel
def in_window(first, width, cell, n):
    """Return whether a cell is in a section of the tour."""
    return (cell - first) % n < width


@in_place_kernel
def write_beacon(w, b, i, slot, time, n):
    """Write the next beacon of a robot to a free message; see
    `shoal.search.protocol.robot.with_beacon`.
    """
    robot, message = w.robots[b, i], w.messages[b, slot]
    message.sender = i
    write_heartbeats(w, b, i, slot, time)
    width, gathered = width_of_window(w, b, i, n)
    turn, section = robot.announced % REPEATED, w.section[b]
    facts, before = w.known[b, i], w.before[b, i, turn]
    count = w.control[b].words
    message.words = 0
    bounded = w.counts.shape[2] > NEWS + 1
    if bounded:
        choose_news(w, b, i, turn)
    for k in range(count if gathered >= 0 else 0):
        section[k] = ZERO
    for k in range(gathered):
        fact = w.gathered[b, k]
        section[fact >> 6] |= ONE << np.uint64(fact & 63)
    for k in range(count):
        bits = facts[k]
        if bits != ZERO and width < n:
            is_told = not bounded or w.telling[b, w.owner[b, k]]
            new = bits & ~before[k] if is_told else ZERO
            if gathered >= 0:
                bits = new | section[k]
            else:
                bits = new | facts_in(w, b, k, bits & ~new, robot.window, width, n)
        if bits != ZERO:
            w.word[b, slot, message.words], w.bits[b, slot, message.words] = k, bits
            message.words += 1
    write_findings(w, b, i, slot, width, turn, n)
    write_obstacles(w, b, i, slot, width, turn, n)
    for k in range(count):
        before[k] = facts[k]
    robot.announced += 1
    robot.window = (robot.window + width) % n


@in_place_kernel
def write_findings(w, b, i, slot, width, turn, n):
    """Write to a beacon all that is known of the cells with news, or in the section to repeat."""
    robot, message = w.robots[b, i], w.messages[b, slot]
    findings, before = w.reported[b, i], w.reported_before[b, i, turn]
    message.findings = 0
    words = (w.control[b].findings + 63) >> 6
    for k in range(words):
        bits, reported = findings[k], ZERO
        while bits != ZERO:
            finding = (k << 6) + lowest(bits)
            cell = w.place[b, finding]
            if in_window(robot.window, width, cell, n) or has_news(w, b, i, turn, cell):
                reported |= ONE << np.uint64(finding & 63)
            bits &= bits - ONE
        if reported != ZERO:
            w.finding_word[b, slot, message.findings] = k
            w.finding_bits[b, slot, message.findings] = reported
            message.findings += 1
    for k in range(words):
        before[k] = findings[k]


@in_place_kernel
def write_obstacles(w, b, i, slot, width, turn, n):
    """Write to a beacon the known obstacles that are new, or in the section to repeat."""
    robot, message, count = w.robots[b, i], w.messages[b, slot], w.control[b].closings
    closings, before, telling = w.closed[b, i], w.closed_before[b, i, turn], w.telling[b]
    message.closings = 0
    telling[:] = 0
    for closing in range(count):
        if holds(closings, closing) and not holds(before, closing):
            telling[w.closer[b, closing]] = 1
    choose_in_turn(w, b, i)
    for k in range((count + 63) >> 6):
        bits, reported = closings[k], ZERO
        while bits != ZERO:
            closing = (k << 6) + lowest(bits)
            new = telling[w.closer[b, closing]] and not holds(before, closing)
            if new or in_window(robot.window, width, np.int64(w.shut[b, closing]), n):
                reported |= ONE << np.uint64(closing & 63)
            bits &= bits - ONE
        if reported != ZERO:
            w.closing_word[b, slot, message.closings] = k
            w.closing_bits[b, slot, message.closings] = reported
            message.closings += 1
        before[k] = closings[k]


@in_place_kernel
def has_news(w, b, i, turn, cell):
    """Return whether a robot knows a finding in a cell that was missing in the oldest snapshot."""
    for finding in range(w.control[b].findings):
        if (
            w.place[b, finding] == cell
            and holds(w.reported[b, i], finding)
            and not holds(w.reported_before[b, i, turn], finding)
        ):
            return True
    return False


@in_place_kernel
def write_heartbeats(w, b, i, slot, time):
    """Write the robot's own heartbeat and those that it relays; see
    `shoal.search.protocol.robot.relayed_heartbeats`.
    """
    robot, message = w.robots[b, i], w.messages[b, slot]
    beats, lags = w.beats[b, slot], w.lags[b, slot]
    beats[0, 0], beats[0, 1], beats[0, 2] = i, robot.count, robot.status
    beats[0, 3] = robot.cell if robot.target < 0 else robot.target
    lags[0] = np.rint(lag_at(robot, time) / LAG_UNIT) * LAG_UNIT
    message.heartbeats = 1
    count = relayed_of(robot.peers)
    first = robot.count * count % max(robot.peers, 1) if count < robot.peers else 0
    count = min(count, robot.peers)
    order = 0  # of a peer among those that the robot knows
    for other in range(w.counts.shape[2]):
        if other == i or w.counts[b, i, other] < 0:
            continue
        at = (order - first) % robot.peers
        order += 1
        if at < count:
            peer = w.peers[b, i, other]
            beats[1 + at, 0], beats[1 + at, 1] = other, w.counts[b, i, other]
            beats[1 + at, 2], beats[1 + at, 3] = peer.status, peer.place
            lags[1 + at] = peer.lag
    message.heartbeats = 1 + count


@in_place_kernel
def relayed_of(peers):
    """Return how many heartbeats of others a beacon relays."""
    return max(RELAYED, min((peers + 3) // 4, MOST_RELAYED))


@in_place_kernel
def pause_before_beacon(robot, time, rules):
    """Return the time from a beacon to the next."""
    hello = robot.status == LISTENING and time < robot.began + rules.hello - 1e-9
    return min(rules.beat, rules.hello / HELLOS) if hello else rules.beat


# Beliefs


@in_place_kernel
def lag_at(robot, time):
    """Return the robot's lag behind its declared speed; see `Robot.lag_at`."""
    if robot.target == -2:
        return robot.lag
    return robot.lag + max(time - robot.since - robot.cost / robot.rate, 0.0)


@in_place_kernel
def silence_limit(robot, rules):
    """Return the silence after which a robot presumes another dead."""
    share = robot.lost / (robot.lost + robot.received) if robot.received else 0.5
    beats = log(FALSE_POSITIVE_RATE) / log(share) if 0 < share < 1 else 0.0
    return rules.beat * (min(max(SHORTEST_SILENCE, beats), LONGEST_SILENCE) + 0.5)


@in_place_kernel
def is_live(w, b, i, other, time, limit):
    """Return whether a robot presumes that another is alive. ``limit`` is its `silence_limit`."""
    return other == i or (w.counts[b, i, other] >= 0 and time - w.peers[b, i, other].heard <= limit)


@in_place_kernel
def can_come(tour, w, b, i, other, time, limit):
    """Return whether a robot presumes that another is alive and can reach the cells ``reach``."""
    return is_live(w, b, i, other, time, limit) and (
        other == i or not tour.stepwise or holds(w.reach[b], w.robots[b, other].start)
    )


@in_place_kernel
def tolerance(robot, time, rules):
    """Return the lag that robots tolerate."""
    return TOLERATED * max(time - robot.allotted_at, 0.0) + BEATS * rules.beat


@in_place_kernel
def is_late(w, b, i, other, time, rules):
    """Return whether a robot lags so far behind that others should help it."""
    if not rules.helping:
        return False
    robot = w.robots[b, i]
    if other == i:
        return lag_at(robot, time) > RELUCTANCE * tolerance(robot, time, rules)
    peer = w.peers[b, i, other]
    return w.counts[b, i, other] >= 0 and peer.lag > tolerance(robot, peer.heard, rules)


@in_place_kernel
def speed_of(w, b, i, other, time, rules):
    """Return the estimated speed of a robot, at which it also searches."""
    robot = w.robots[b, i]
    if other == i:
        gone, behind = time - robot.allotted_at, lag_at(robot, time)
    else:
        peer = w.peers[b, i, other]
        gone, behind = peer.heard - peer.then, peer.lag - peer.lag_then
    rate = w.robots[b, other].rate
    if gone >= MARK * rules.beat:
        rate *= min(max(1.0 - behind / gone, CRAWL), 1.0)
    return rate
