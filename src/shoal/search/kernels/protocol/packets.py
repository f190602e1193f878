"""Beacons as messages of limited length: how a beacon is divided, and which messages a robot opens.

Counterparts: `encode_beacon`, `Sender` and `Receiver` in `shoal.search.protocol.messages`. Messages
hold facts instead of bytes; only the lengths of their bytes are computed.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.search.kernels.protocol.bits import ONE, ZERO, lowest
from shoal.search.kernels.protocol.costs import add, end_of_run, next_in_line
from shoal.search.kernels.protocol.knowledge import fact_of
from shoal.search.kernels.protocol.numbers import (
    FULL_PIECE,
    LAG_UNIT,
    REMEMBERED,
    SHARE,
    STAMPS_APART,
)

SEARCHED, FOUND, CLOSED = range(3)  # kinds of facts


@in_place_kernel
def length_of(number):
    """Return how many bytes encode a whole number."""
    length = 1
    while number > 0x7F:
        number >>= 7
        length += 1
    return length


@in_place_kernel
def length_of_heartbeat(w, b, slot, k):
    """Return how many bytes encode a heartbeat of a message."""
    other, beat = w.beats[b, slot, k, 0], w.beats[b, slot, k]
    robot = w.robots[b, other]
    lag = np.int64(np.rint(w.lags[b, slot, k] / LAG_UNIT))
    length = 2 + length_of(other + 1) + length_of(beat[1])  # with the kind and the flags
    length += length_of(robot.start) + length_of(beat[3]) + length_of(lag)
    return length + 8 if robot.rate != 1.0 else length


@in_place_kernel
def fit(used, part, size, longest):
    """Return how many bytes of which message are used after a piece of so many bytes."""
    return (used + size, part) if used + size <= longest or used == 0 else (size, part + 1)


@in_place_kernel
def divide(w, b, slot, longest, writes):
    """Return the number of messages into which the beacon of a message is divided. If ``writes``,
    write these messages, whose places are in ``parts``.
    """
    message, used, part = w.messages[b, slot], 0, 0
    for k in range(message.heartbeats):
        used, part = fit(used, part, length_of_heartbeat(w, b, slot, k), longest)
        if writes:
            own = w.parts[b, part]
            at = w.messages[b, own].heartbeats
            w.messages[b, own].heartbeats += 1
            w.lags[b, own, at] = w.lags[b, slot, k]
            for column in range(4):
                w.beats[b, own, at, column] = w.beats[b, slot, k, column]
    used, part = divide_searched(w, b, slot, longest, writes, used, part)
    used, part = divide_found(w, b, slot, longest, writes, used, part)
    return divide_closed(w, b, slot, longest, writes, used, part)[1] + 1


@in_place_kernel
def divide_searched(w, b, slot, longest, writes, used, part):
    """Divide what a beacon tells about searched cells."""
    message, cells, last, chain = w.messages[b, slot], w.left[b], w.telling[b], w.chain[b]
    last[:] = -1
    for k in range(message.words):
        owner = w.owner[b, w.word[b, slot, k]]
        chain[k], last[owner] = last[owner], k
    for other in range(last.shape[0]):
        if last[other] < 0:
            continue
        cells[:] = ZERO
        k = last[other]
        while k >= 0:
            word, bits = np.int64(w.word[b, slot, k]), w.bits[b, slot, k]
            while bits != ZERO:
                add(cells, np.int64(w.cells[b, (word << 6) + lowest(bits)]))
                bits &= bits - ONE
            k = np.int64(chain[k])
        count = write_members(w, b, cells, w.head.shape[1])
        for k in range(count):
            w.ids[b, k] = fact_of(w, b, other, w.members[b, k])
        head = 1 + length_of(other + 1)
        used, part = divide_set(w, b, SEARCHED, head, count, longest, writes, used, part)
    return used, part


@in_place_kernel
def divide_found(w, b, slot, longest, writes, used, part):
    """Divide what a beacon tells about findings."""
    message, cells, finder = w.messages[b, slot], w.left[b], w.telling[b]
    if message.findings == 0:
        return used, part
    cells[:] = ZERO
    for k in range(message.findings):
        word, bits = np.int64(w.finding_word[b, slot, k]), w.finding_bits[b, slot, k]
        while bits != ZERO:
            add(cells, np.int64(w.place[b, (word << 6) + lowest(bits)]))
            bits &= bits - ONE
    cell = next_in_line(cells, 0, w.head.shape[1])
    while cell >= 0:
        finder[:] = -1
        for k in range(message.findings):
            word, bits = np.int64(w.finding_word[b, slot, k]), w.finding_bits[b, slot, k]
            while bits != ZERO:
                finding = (word << 6) + lowest(bits)
                if w.place[b, finding] == cell:
                    finder[w.finder[b, finding]] = finding
                bits &= bits - ONE
        count = 0
        for robot in range(finder.shape[0]):
            if finder[robot] >= 0:
                w.members[b, count], w.ids[b, count] = robot + 1, finder[robot]
                count += 1
        head = 1 + length_of(cell)
        used, part = divide_set(w, b, FOUND, head, count, longest, writes, used, part)
        cell = next_in_line(cells, cell + 1, w.head.shape[1])
    return used, part


@in_place_kernel
def divide_closed(w, b, slot, longest, writes, used, part):
    """Divide what a beacon tells about obstacles."""
    message, cells, robots = w.messages[b, slot], w.left[b], w.telling[b]
    if message.closings == 0:
        return used, part
    robots[:] = 0
    for k in range(message.closings):
        word, bits = np.int64(w.closing_word[b, slot, k]), w.closing_bits[b, slot, k]
        while bits != ZERO:
            robots[w.closer[b, (word << 6) + lowest(bits)]] = 1
            bits &= bits - ONE
    for other in range(robots.shape[0]):
        if not robots[other]:
            continue
        cells[:] = ZERO
        for k in range(message.closings):
            word, bits = np.int64(w.closing_word[b, slot, k]), w.closing_bits[b, slot, k]
            while bits != ZERO:
                closing = (word << 6) + lowest(bits)
                if w.closer[b, closing] == other:
                    add(cells, np.int64(w.shut[b, closing]))
                bits &= bits - ONE
        count = write_members(w, b, cells, w.head.shape[1])
        for k in range(count):
            for closing in range(w.control[b].closings):
                if w.closer[b, closing] == other and w.shut[b, closing] == w.members[b, k]:
                    w.ids[b, k] = closing
        head = 1 + length_of(other + 1)
        used, part = divide_set(w, b, CLOSED, head, count, longest, writes, used, part)
    return used, part


@in_place_kernel
def write_members(w, b, bits, n):
    """Write the members of a bitset to the work space in increasing order, and return their number."""
    count, cell = 0, next_in_line(bits, 0, n)
    while cell >= 0:
        for other in range(cell, end_of_run(bits, cell, n)):
            w.members[b, count] = cell = other
            count += 1
        cell = next_in_line(bits, cell + 1, n)
    return count


@in_place_kernel
def divide_set(w, b, kind, head, count, longest, writes, used, part):
    """Divide a set of so many members; see `shoal.search.protocol.messages._pieces`."""
    members, k, begin, end, body = w.members[b], 0, 0, 0, 0
    while k < count:
        if body > FULL_PIECE:
            used, part = fit(used, part, head + 1 + body, longest)
            add_facts(w, b, kind, begin, k, part, writes)
            begin, end, body = k, 0, 0
        first = members[k]
        k += 1
        while k < count and members[k] == members[k - 1] + 1:
            k += 1
        length = members[k - 1] + 1 - first
        body += length_of(first - end) + length_of(length)
        end = first + length
    used, part = fit(used, part, head + 1 + body, longest)
    add_facts(w, b, kind, begin, k, part, writes)
    return used, part


@in_place_kernel
def add_facts(w, b, kind, first, last, part, writes):
    """Add facts to a part of a beacon."""
    if not writes:
        return
    own = w.parts[b, part]
    message = w.messages[b, own]
    for k in range(first, last):
        fact = w.ids[b, k]
        if kind == SEARCHED:
            message.words = add_fact(w.word[b, own], w.bits[b, own], message.words, fact)
        elif kind == FOUND:
            message.findings = add_fact(
                w.finding_word[b, own], w.finding_bits[b, own], message.findings, fact
            )
        else:
            message.closings = add_fact(
                w.closing_word[b, own], w.closing_bits[b, own], message.closings, fact
            )


@in_place_kernel
def add_fact(words, bits, count, fact):
    """Add a fact to the words of a message, and return their number."""
    at = count - 1
    while at >= 0 and words[at] != fact >> 6:
        at -= 1
    if at < 0:
        at, count = count, count + 1
        words[at], bits[at] = fact >> 6, ZERO
    bits[at] |= ONE << np.uint64(fact & 63)
    return count


@in_place_kernel
def stamp(robot, time):
    """Return the stamp of a robot's next message."""
    robot.stamp = max(robot.stamp + 1, np.int64(1000 * time))
    return robot.stamp


@in_place_kernel
def opens(w, b, i, slot, time, rules):
    """Return whether a robot opens a message that is not damaged; see
    `shoal.search.protocol.messages.Receiver`.
    """
    message = w.messages[b, slot]
    history, now = w.seen[b, i, message.sender], np.int64(1000 * time)
    if abs(message.stamp - now) > STAMPS_APART:
        return False
    if rules.remembered and is_old(history, w.stamps[b, i, message.sender], message.stamp):
        return False
    if history.second != now // 1000:
        history.second, history.messages = now // 1000, 0
    history.messages += 1
    if history.messages > SHARE:
        return False
    if rules.remembered:
        remember(history, w.stamps[b, i, message.sender], message.stamp)
    return True


@in_place_kernel
def is_old(history, stamps, own):
    """Return whether a robot has opened a message with a stamp, or a much later one."""
    if own <= history.forgotten:
        return True
    for k in range(history.count):
        if stamps[k] == own:
            return True
    return False


@in_place_kernel
def remember(history, stamps, own):
    """Let a robot remember a stamp, and forget the earliest of too many."""
    if history.count < REMEMBERED:
        stamps[history.count] = own
        history.count += 1
        return
    oldest = 0
    for k in range(1, history.count):
        if stamps[k] < stamps[oldest]:
            oldest = k
    if own < stamps[oldest]:
        history.forgotten = own
    else:
        history.forgotten, stamps[oldest] = stamps[oldest], own
