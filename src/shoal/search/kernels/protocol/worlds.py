"""The arrays of simulated searches: what robots know, what is on the air, and what comes next.

Robots are counted from 0. A set of cells is a bitset in words of 64 bits. What a robot claims to
have searched is a *fact*: each claim of a robot for a cell is one fact, whoever hears of it. The
facts of a robot lie in words of their own, in the order in which the robot made them. So a set of
facts that a robot knows or sends is a few words, however many robots and cells there are.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

LISTENING, SEARCHING, WAITING, COMPLETE, PAUSED, DEAD = 0, 1, 2, 3, 4, 5
"""Status of a robot, in the order of `shoal.search.protocol.messages.Status`, and of a vehicle."""

NOWHERE, HOME = -2, -1  # no target, and the target of a robot that goes home to recharge

# kinds of events in the queue of a world
BEGIN, PROMPT, WAKE, HEARD, DELIVERY, ENTER, SENSE, ARRIVE_HOME, CRASH, PAUSE, OBSTRUCTED = range(
    11
)

# models of networks, in the order of `shoal.search.problem.network`
LOSS, BURSTS, RANGE, PARTITION, DELAY, DUPLICATES, CORRUPTION, REPLAYS, FORGERIES = range(9)

# what a world needs before it can go on
NOTHING, A_LENGTH, A_LAUNCH, A_PARTITION, MEMORY, RANDOM = range(6)


def record(**kinds: str) -> np.dtype[Any]:
    """Return the type of a record whose fields compiled and plain code read as attributes."""
    return np.dtype((np.record, np.dtype(list(kinds.items()), align=True)))


ROBOT = record(
    **dict.fromkeys(
        (
            "start status cell fresh at_launch target aim partition own count allotted_to lost"
            " received window lingering avoided announced word facts peers place alive"
            " liar searching going aimed tries offer offered_for order shown unheeded stamp through"
            " shut shut_version intervals learned"
        ).split(),
        "i8",
    ),
    **dict.fromkeys(
        (
            "rate cost next_beat allotted_at began deadline left since lag avoided_until listening"
            " energy full paused_until wake travelled waited declared"
            " waits_until"
        ).split(),
        "f8",
    ),
)
"""A robot as its own state machine sees it (`shoal.search.protocol.state.Robot`), and its vehicle."""

PEER = record(
    **dict.fromkeys("status place origin".split(), "i8"),
    **dict.fromkeys("lag heard then lag_then later lag_later since".split(), "f8"),
)
"""What a robot knows about another (`shoal.search.protocol.state.Peer`). The path of the peer to
its destination ``place`` begins in the cell ``origin``.
"""

MESSAGE = record(
    **dict.fromkeys(
        "sender references cursor receivers heartbeats words findings closings stamp".split(), "i8"
    )
)
"""A beacon on the air: the numbers of entries in the arrays of `Air`."""

SEEN = record(**dict.fromkeys("count forgotten second messages".split(), "i8"))
"""What a receiver remembers of a sender, beside the stamps of its messages."""

CONTROL = record(
    **dict.fromkeys(
        (
            "posted queued words findings visits states slots drawn pending stage need need_one"
            " need_other sent lost takeovers uncovered action cell heard last most parts recorded"
            " closings passes stops"
        ).split(),
        "i8",
    ),
    **dict.fromkeys("time covered_at waking".split(), "f8"),
)
"""Counters of a world, and what it waits for."""

RUN = record(first="i8", count="i8", step="i8", pace="f8", late="f8")
"""Cells that remain in an arc (`shoal.search.protocol.helping.Run`)."""


class TourTable(NamedTuple):
    """The tour of all worlds, and the lengths of those paths that were asked for.

    Parameters
    ----------
    ahead : ndarray of float64, shape (4 N + 1,)
        As in `shoal.search.allocation.costs.TourCost`.
    points : ndarray of float64, shape (N, d)
    likely : ndarray of float64, shape (2 N + 1,) or (0,)
        As `TourCost.odds_ahead`, or empty without probabilities.
    keys : ndarray of int64, shape (K,)
        Open hash table of paths: N a + b for the path from cell a to a larger cell b, and
        N (N + i) + b for the path from the launch point of robot i to cell b; -1 if free.
    lengths : ndarray of float64, shape (K,)
        Length of each path, in cell sides.
    """

    cells: int
    turn_cost: float
    straight: int
    launched: int  # whether robots may start outside
    ahead: NDArray[np.float64]
    points: NDArray[np.float64]
    likely: NDArray[np.float64]
    keys: NDArray[np.int64]
    lengths: NDArray[np.float64]
    stepwise: int  # whether robots move from cell to cell; then the following arrays are in use
    edges: NDArray[np.int64]  # (N + 1,): the first step from each cell
    ends: NDArray[np.int64]  # (E,): where each step leads to
    weights: NDArray[np.float64]  # (E,)
    beside: NDArray[np.int64]  # (E, 2): cells that must be open, too, or -1
    steps: NDArray[np.float64]  # (N,): as in `TourCost`
    counters: NDArray[np.int64]  # (4,): see `shoal.search.kernels.protocol.steps`
    codes: NDArray[np.uint64]  # (S,): hash codes of sets of closed cells
    sets: NDArray[np.uint64]  # (S, W)
    labels: NDArray[np.int32]  # (S, N): connected parts of the open cells
    rows: NDArray[np.float64]  # (R, N): distances from a cell around a set of closed cells
    row_keys: NDArray[np.int64]  # (H,): open hash table: N s + a for set s and cell a; -1 if free
    row_numbers: NDArray[np.int32]  # (H,)
    heap: NDArray[np.float64]  # (E + N + 2,): work space
    nodes: NDArray[np.int64]  # (E + N + 2,)


class Rules(NamedTuple):
    """What is the same for all robots of all worlds (`shoal.search.protocol.state.Brief`), and the
    network.
    """

    multiplicity: int
    hello: float
    beat: float
    energy: float
    recharge: float
    helping: int
    delayed: int
    ordered: int  # whether somebody else tells robots where to go
    detection: float
    false_alarm: float
    draws: int  # most random numbers of an event
    copies: int  # most copies of a message
    longest: int  # maximum length of a message's body in bytes; 0 if messages are not bytes
    remembered: int  # whether receivers must refuse messages that they have opened
    recorded: int  # number of messages that an attacker has at most
    media: NDArray[np.int64]  # (K,)
    numbers: NDArray[np.float64]  # (K, 2)


class Partitions(NamedTuple):
    """Divisions of the tour (`shoal.search.allocation.allocate.partition`): the parts of division
    d are ``starts[d]`` to ``starts[d + 1]``, and the arcs of part p are ``arcs[p]`` to
    ``arcs[p + 1]``.
    """

    starts: NDArray[np.int64]
    robots: NDArray[np.int64]
    arcs: NDArray[np.int64]
    first: NDArray[np.int64]
    sizes: NDArray[np.int64]
    step: NDArray[np.int64]


class Worlds(NamedTuple):
    """The state of B worlds with m robots on N cells."""

    control: Any  # (B,) of CONTROL
    robots: Any  # (B, m) of ROBOT
    peers: Any  # (B, m, m) of PEER
    counts: NDArray[np.int32]  # (B, m, m): beacons of the other, by its latest heartbeat; -1
    slow: NDArray[np.float64]  # (B, m, S, 2): times and factors
    targets: NDArray[np.uint64]  # (B, W)
    # what was searched
    done: NDArray[np.uint64]  # (B, m, W): cells known to be searched by enough robots
    own: NDArray[np.uint64]  # (B, m, W): cells that the robot has searched
    avoided: NDArray[np.uint64]  # (B, m, W)
    claims: NDArray[np.int32]  # (B, m, N) if the multiplicity is above 1
    goal: NDArray[np.uint64]  # (B, W): cells that robots can reach
    blocked: NDArray[np.uint64]  # (B, W): obstacles
    passed: NDArray[np.uint64]  # (B, m, W): cells that a robot knows to be free
    path: NDArray[np.int64]  # (B, m, P): cells through which a robot goes
    covered: NDArray[np.int32]  # (B, N): number of honest robots that searched the cell
    occupied: NDArray[np.int32]  # (B, N): number of robots that search in the cell
    # facts
    owner: NDArray[np.int32]  # (B, F): robot of each word of facts
    cells: NDArray[np.int32]  # (B, 64 F)
    next: NDArray[np.int32]  # (B, 64 F): the next fact of the same cell, or -1
    head: NDArray[np.int32]  # (B, N): the latest fact of each cell, or -1
    known: NDArray[np.uint64]  # (B, m, F)
    before: NDArray[np.uint64]  # (B, m, REPEATED, F): known at the latest beacons
    span: NDArray[np.int32]  # (B, F, 2): the smallest and the largest cell of each word of facts
    after: NDArray[np.int32]  # (B, 64 F): the fact of the same robot for the cell before, or -1
    linked: NDArray[np.uint64]  # (B, F, 2): facts with ``after`` just before, and just behind
    ahead: NDArray[np.int32]  # (B, 64 F): the fact of the same robot for the next cell, or -1
    told: NDArray[np.int64]  # (B, m, m): number of known facts of each robot
    begun: NDArray[np.int64]  # (B, 64): work space
    # findings, as facts: a robot that found something in a cell
    finder: NDArray[np.int32]  # (B, 64 G)
    place: NDArray[np.int32]  # (B, 64 G)
    reported: NDArray[np.uint64]  # (B, m, G)
    reported_before: NDArray[np.uint64]  # (B, m, REPEATED, G)
    # obstacles, as findings: a robot that found an obstacle in a cell
    closer: NDArray[np.int32]  # (B, 64 C)
    shut: NDArray[np.int32]  # (B, 64 C)
    closed: NDArray[np.uint64]  # (B, m, C)
    closed_before: NDArray[np.uint64]  # (B, m, REPEATED, C)
    # the queue, a heap by time and number
    times: NDArray[np.float64]  # (B, Q)
    posts: NDArray[np.int64]  # (B, Q)
    events: NDArray[np.int64]  # (B, Q, 3): kind, robot, and cell or message
    values: NDArray[np.float64]  # (B, Q): the time that a robot asked for, or the end of a pause
    # the air
    messages: Any  # (B, M) of MESSAGE
    free: NDArray[np.int32]  # (B, M): free messages
    receivers: NDArray[np.int32]  # (B, M, R)
    beats: NDArray[np.int64]  # (B, M, H, 4): robot, count, status, place
    lags: NDArray[np.float64]  # (B, M, H)
    word: NDArray[np.int32]  # (B, M, F)
    bits: NDArray[np.uint64]  # (B, M, F)
    finding_word: NDArray[np.int32]  # (B, M, G)
    finding_bits: NDArray[np.uint64]  # (B, M, G)
    closing_word: NDArray[np.int32]  # (B, M, C)
    closing_bits: NDArray[np.uint64]  # (B, M, C)
    parts: NDArray[np.int32]  # (B, M): the messages of one beacon
    records: NDArray[np.int32]  # (B, RECORDED): messages that an attacker has
    seen: Any  # (B, m, m) of SEEN
    stamps: NDArray[np.int64]  # (B, m, m, REMEMBERED)
    bad: NDArray[np.uint8]  # (B, K, m, m): links that are bad at present
    delays: NDArray[np.float64]  # (B, C): copies of one message
    damaged: NDArray[np.uint8]  # (B, C)
    origin: NDArray[np.uint8]  # (B, C): 0, or the model of an attacker who sends the copy
    random: NDArray[np.float64]  # (B, D): random numbers to come
    # logs
    visits: NDArray[np.int64]  # (B, V, 3): robot, cell, and whether it is searched anew
    visited: NDArray[np.float64]  # (B, V)
    states: NDArray[np.int64]  # (B, L, 2): robot and status
    stated: NDArray[np.float64]  # (B, L)
    passes: NDArray[np.int64]  # (B, P, 2): robots and the cells passed; -1 for a search
    stops: NDArray[np.int64]  # (B, O, 2): robots and the obstacles found
    stopped: NDArray[np.float64]  # (B, O)
    # work space
    wanted: NDArray[np.uint64]  # (B, W)
    left: NDArray[np.uint64]  # (B, W)
    settled: NDArray[np.uint64]  # (B, W)
    reach: NDArray[np.uint64]  # (B, W): cells that the robot can reach
    anyone: NDArray[np.uint64]  # (B, W): cells that a live robot can reach
    members: NDArray[np.int64]  # (B, N + m + 1)
    ids: NDArray[np.int64]  # (B, N + m + 1)
    chain: NDArray[np.int64]  # (B, F)
    section: NDArray[np.uint64]  # (B, F)
    gathered: NDArray[np.int32]  # (B, 64 F)
    row: NDArray[np.float64]  # (B, N)
    offered: NDArray[np.int64]  # (B, m)
    others: NDArray[np.int64]  # (B, m)
    telling: NDArray[np.int64]  # (B, m)
    fronts: NDArray[np.float64]  # (B, m, 3): cell, pace and lateness
    runs: Any  # (B, N + 4 m + 16) of RUN
