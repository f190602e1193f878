"""What a robot learns from a beacon, and what its own beacons tell.

Counterparts: `heard`, `with_beacon` and what they call in `shoal.search.protocol.robot`, and the
failure detector of `shoal.search.protocol.state`.
"""

from __future__ import annotations

from math import log

import numpy as np

from shoal.jit import in_place_kernel
from shoal.search.kernels.protocol.bits import ONE, ZERO, lowest
from shoal.search.kernels.protocol.costs import add, holds
from shoal.search.kernels.protocol.worlds import COMPLETE, LISTENING
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
    RELAYED,
    RELUCTANCE,
    REPEATED,
    ROUND,
    SHORTEST_SILENCE,
    TOLERATED,
)


@in_place_kernel
def knows(w, b, i, other, cell):
    """Return whether a robot knows that another robot claims to have searched a cell."""
    fact = w.head[b, cell]
    while fact >= 0:
        if w.owner[b, fact >> 6] == other:
            return holds(w.known[b, i], fact)
        fact = w.next[b, fact]
    return False


@in_place_kernel
def has_claimed(w, b, i, cell):
    """Return whether a robot itself has searched a cell."""
    return holds(w.own[b, i], cell)


@in_place_kernel
def learn(w, b, i, fact, rules):
    """Let a robot learn one fact that it does not know."""
    robot = w.robots[b, i]
    other, cell = np.int64(w.owner[b, fact >> 6]), np.int64(w.cells[b, fact])
    before = cell > 0 and knows(w, b, i, other, cell - 1)
    after = cell + 1 < w.head.shape[1] and knows(w, b, i, other, cell + 1)
    robot.intervals += 1 - before - after
    w.told[b, i, other] += 1
    add(w.known[b, i], fact)
    if rules.multiplicity == 1:
        add(w.done[b, i], cell)
        return
    w.claims[b, i, cell] += 1
    if w.claims[b, i, cell] == rules.multiplicity:
        add(w.done[b, i], cell)


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
    fact = (robot.word << 6) + (robot.facts & 63)
    robot.facts += 1
    w.cells[b, fact] = cell
    w.next[b, fact] = w.head[b, cell]
    w.head[b, cell] = fact
    add(w.own[b, i], cell)
    learn(w, b, i, fact, rules)


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
    w.robots[b, i].findings += not has_finding(w, b, i, cell)
    add(w.reported[b, i], finding)


@in_place_kernel
def has_finding(w, b, i, cell):
    """Return whether a robot knows that something was found in a cell."""
    for finding in range(w.control[b].findings):
        if w.place[b, finding] == cell and holds(w.reported[b, i], finding):
            return True
    return False


@in_place_kernel
def hear(w, b, i, slot, time, rules):
    """Let a robot hear a beacon."""
    robot, message = w.robots[b, i], w.messages[b, slot]
    known = w.known[b, i]
    for k in range(message.words):
        word = w.word[b, slot, k]
        new = w.bits[b, slot, k] & ~known[word]
        while new != ZERO:
            learn(w, b, i, (word << 6) + lowest(new), rules)
            new &= new - ONE
    for k in range(message.heartbeats):
        other, count = w.beats[b, slot, k, 0], w.beats[b, slot, k, 1]
        before = np.int64(w.counts[b, i, other])
        if other == i or before >= count:
            continue
        peer = w.peers[b, i, other]
        place, lag = w.beats[b, slot, k, 3], w.lags[b, slot, k]
        if before < 0:
            robot.peers += 1
            peer.origin, peer.place, peer.since = w.robots[b, other].start, place, time
            peer.then, peer.lag_then, peer.later, peer.lag_later = time, lag, time, lag
        else:
            if k == 0:
                robot.lost += count - before - 1
                robot.got += 1
            if time - peer.later >= MARK * rules.beat:
                peer.then, peer.lag_then = peer.later, peer.lag_later
                peer.later, peer.lag_later = time, lag
            if peer.place != place:
                peer.origin, peer.place, peer.since = peer.place, place, time
        w.counts[b, i, other] = count
        peer.status, peer.lag, peer.heard = w.beats[b, slot, k, 2], lag, time
    for k in range(message.findings):
        word = w.finding_word[b, slot, k]
        new = w.finding_bits[b, slot, k] & ~w.reported[b, i, word]
        while new != ZERO:
            finding = (word << 6) + lowest(new)
            robot.findings += not has_finding(w, b, i, w.place[b, finding])
            add(w.reported[b, i], finding)
            new &= new - ONE


# Beacons


@in_place_kernel
def width_of_window(w, b, i, n):
    """Return how many cells from the cell ``window`` on the next beacon repeats facts of; see
    `shoal.search.protocol.robot._window`.
    """
    robot = w.robots[b, i]
    total = robot.intervals + robot.findings
    rounds = LAST_ROUND if robot.status == COMPLETE else ROUND
    share = max(LEAST, min((total + rounds - 1) // rounds, MOST))
    if total <= share:
        return n
    # the more cells a section has, the more intervals it has: one pass finds how many cells fit
    intervals, fitting = 0, n
    for k in range(n):
        cell = (robot.window + k) % n
        fact = w.head[b, cell]
        while fact >= 0:
            if holds(w.known[b, i], fact):
                other = np.int64(w.owner[b, fact >> 6])
                joins = k > 0 and cell > 0 and knows(w, b, i, other, cell - 1)
                # the section has come round to the cell before its first
                joins_next = (
                    k == n - 1 and cell + 1 < n and n > 1 and knows(w, b, i, other, cell + 1)
                )
                intervals += 1 - joins - joins_next
            fact = w.next[b, fact]
        if robot.findings and has_finding(w, b, i, cell):
            intervals += 1
        if intervals > share:
            fitting = k
            break
    width = n
    while width > 1 and width > fitting:
        width = (width + 1) // 2
    return width


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
    width, turn = width_of_window(w, b, i, n), robot.announced % REPEATED
    known, before = w.known[b, i], w.before[b, i, turn]
    count = w.control[b].words
    repeated = w.repeated[b]
    if width < n:
        for k in range(width):
            fact = w.head[b, (robot.window + k) % n]
            while fact >= 0:
                add(repeated, fact)
                fact = w.next[b, fact]
    message.words = 0
    for k in range(count):
        bits = known[k] if width == n else known[k] & (~before[k] | repeated[k])
        repeated[k] = ZERO
        if bits != ZERO:
            w.word[b, slot, message.words], w.bits[b, slot, message.words] = k, bits
            message.words += 1
    write_findings(w, b, i, slot, width, turn, n)
    for k in range(count):
        before[k] = known[k]
    robot.announced += 1
    robot.window = (robot.window + width) % n


@in_place_kernel
def write_findings(w, b, i, slot, width, turn, n):
    """Write to a beacon all that is known of the cells with news, or in the section to repeat."""
    robot, message = w.robots[b, i], w.messages[b, slot]
    known, before = w.reported[b, i], w.reported_before[b, i, turn]
    message.findings = 0
    words = (w.control[b].findings + 63) >> 6
    for k in range(words):
        bits, told = known[k], ZERO
        while bits != ZERO:
            finding = (k << 6) + lowest(bits)
            cell = w.place[b, finding]
            if in_window(robot.window, width, cell, n) or has_news(w, b, i, turn, cell):
                told |= ONE << np.uint64(finding & 63)
            bits &= bits - ONE
        if told != ZERO:
            w.finding_word[b, slot, message.findings] = k
            w.finding_bits[b, slot, message.findings] = told
            message.findings += 1
    for k in range(words):
        before[k] = known[k]


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
    `shoal.search.protocol.robot.relayed`.
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
    return max(RELAYED, (peers + 3) // 4)


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
    share = robot.lost / (robot.lost + robot.got) if robot.got else 0.5
    beats = log(FALSE_POSITIVE_RATE) / log(share) if 0 < share < 1 else 0.0
    return rules.beat * (min(max(SHORTEST_SILENCE, beats), LONGEST_SILENCE) + 0.5)


@in_place_kernel
def is_live(w, b, i, other, time, limit):
    """Return whether a robot presumes that another is alive. ``limit`` is its `silence_limit`."""
    return other == i or (
        w.counts[b, i, other] >= 0 and time - w.peers[b, i, other].heard <= limit
    )


@in_place_kernel
def tolerated(robot, time, rules):
    """Return the lag that robots tolerate."""
    return TOLERATED * max(time - robot.allotted_at, 0.0) + BEATS * rules.beat


@in_place_kernel
def is_late(w, b, i, other, time, rules):
    """Return whether a robot lags so far behind that others should help it."""
    if not rules.helping:
        return False
    robot = w.robots[b, i]
    if other == i:
        return lag_at(robot, time) > RELUCTANCE * tolerated(robot, time, rules)
    peer = w.peers[b, i, other]
    return w.counts[b, i, other] >= 0 and peer.lag > tolerated(robot, peer.heard, rules)


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
