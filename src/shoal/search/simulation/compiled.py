"""Simulation of searches in compiled code: many worlds of one tour at once, equal to `SearchWorld`
event by event.

Compiled code simulates footprints of one cell. `SearchWorld` simulates wide footprints.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.search.allocation.allocate import partition
from shoal.search.cells.distances import CellDistances
from shoal.search.kernels.protocol import events
from shoal.search.kernels.protocol.numbers import (
    LINGER,
    MOST_RELAYED,
    RECORDED,
    RELAYED,
    REMEMBERED,
    REPEATED,
)
from shoal.search.kernels.protocol.worlds import (
    A_LAUNCH,
    A_LENGTH,
    A_PARTITION,
    CONTROL,
    CRASH,
    MESSAGE,
    NOWHERE,
    PAUSE,
    PEER,
    RANDOM,
    ROBOT,
    RUN,
    SEEN,
    WAITING,
    Partitions,
    Rules,
    TourTable,
    Worlds,
)
from shoal.search.problem.network import (
    Battery,
    Crash,
    Liar,
    Pause,
    Slow,
    WrongPosition,
)
from shoal.search.protocol.messages import LONGEST, longest_body
from shoal.search.simulation.scenario import Scenario

STATES = ("listening", "searching", "waiting", "complete", "paused", "dead")
_MEDIA = (
    "loss",
    "bursts",
    "range",
    "partition",
    "delay",
    "duplicates",
    "corruption",
    "replays",
    "forgeries",
)
_LATE = {"delay", "duplicates", "replays"}  # models that let messages come late, or again
_SETS, _ROWS = 64, 1 << 21  # sets of obstacles, and distances around them, that are kept
_MIX, _WORD = 0x9E3779B97F4A7C15, (1 << 64) - 1
_NONE = (
    "aim",
    "partition",
    "own",
    "searching",
    "going",
    "aimed",
    "order",
    "shown",
    "stamp",
    "shut",
)
_SLOTS = (  # arrays with an entry for each message
    *("messages", "free", "parts", "receivers", "beats", "lags", "word", "bits"),
    *("finding_word", "finding_bits", "closing_word", "closing_bits"),
)
_DRAWN = 1 << 12  # random numbers drawn at once
_EVENTS = 1 << 62


def can_compile(scenario: Scenario) -> bool:
    """Return whether compiled code can simulate a scenario."""
    cost = scenario.brief.tour_cost
    return (
        set(scenario.widths) == {1}
        and (not cost.stepwise or isinstance(cost.distances, CellDistances))
        and {medium.kind for medium in scenario.network.media} <= set(_MEDIA)
    )


@dataclass(frozen=True, eq=False)
class SearchOutcome:
    """What has happened in a simulated search.

    Parameters
    ----------
    cells, times : tuple of ndarray
        Tour indices of the cells that each robot searched (int64), and the times (float64).
    states : tuple of tuple of (float, str)
        Times and statuses of each robot.
    found : tuple of dict of int to int
        Bitset of the robots that found something in each cell, as each robot knows at the end.
    declared : dict of int to float
        Time at which each robot declared completion, by the number of the robot (from 1).
    sent, lost, takeovers : int
        As in `shoal.search.simulation.trace.SearchTrace`.
    covered_at : float
        Time at which honest robots had searched all cells that robots can reach.
    detours : tuple of tuple of tuple of int
        For each search of each robot, the cells that it passed on its way; empty unless robots move
        from cell to cell.
    obstructed : tuple of tuple of (float, int)
        Times and cells of the obstacles that each robot met.
    """

    cells: tuple[NDArray[np.int64], ...]
    times: tuple[NDArray[np.float64], ...]
    states: tuple[tuple[tuple[float, str], ...], ...]
    found: tuple[dict[int, int], ...]
    declared: dict[int, float]
    sent: int
    lost: int
    takeovers: int
    covered_at: float
    detours: tuple[tuple[tuple[int, ...], ...], ...] = ()
    obstructed: tuple[tuple[tuple[float, int], ...], ...] = ()


class CompiledSearches:
    """The simulation of several scenarios with one brief, one network and one number of robots.

    Parameters
    ----------
    scenarios : sequence of Scenario
        Scenarios that `can_compile` accepts. They differ only in their starts, rates, faults,
        targets, obstacles and seeds.
    ordered : bool
        Whether somebody else tells the robots where to go (`order`), in place of the protocol.
        Robots then start without listening, and do not divide the tour.

    Attributes
    ----------
    worlds : Worlds
        The state of all worlds; the arrays may be replaced by larger ones.
    """

    def __init__(self, scenarios: Sequence[Scenario], *, ordered: bool = False) -> None:
        self.scenario = first = scenarios[0]
        self.brief, self.ordered = first.brief, ordered
        self.n, self.m, self.count = len(first.brief.tour_cost), len(first.starts), len(scenarios)
        self._rules()
        self._tables()
        self._worlds()
        self._rngs = [np.random.default_rng(0)] * self.count
        for world, scenario in enumerate(scenarios):
            self.begin(world, scenario)

    def _rules(self) -> None:
        brief, media = self.brief, self.scenario.network.media
        copies, draws = 1, 0
        for medium in media:  # most copies of a message, and random numbers for it
            draws += 2 * copies
            if medium.kind == "duplicates":
                copies *= 2
            elif medium.kind in ("replays", "forgeries"):
                copies += 1
        draws += copies
        scenario, kinds = self.scenario, {medium.kind for medium in media}
        whole = not (scenario.signed or scenario.packet or "replays" in kinds)
        numbers = np.zeros((len(media), 2))
        for k, medium in enumerate(media):
            numbers[k, : len(medium.numbers)] = medium.numbers
        self.rules = Rules(
            brief.multiplicity,
            float(brief.hello),
            float(brief.beat),
            float(brief.energy),
            float(brief.recharge),
            int(brief.helping),
            int(bool(brief.delays)),
            int(self.ordered),
            float(self.scenario.detection),
            float(self.scenario.false_alarm),
            draws * self.m + 4,
            copies,
            0 if whole else longest_body(scenario.packet or LONGEST, signed=scenario.signed),
            int(bool(kinds & _LATE)),
            RECORDED if "replays" in kinds else 0,
            np.array([_MEDIA.index(medium.kind) for medium in media], dtype=np.int64),
            numbers,
        )

    def _tables(self) -> None:
        cost = self.brief.tour_cost
        self.tour = TourTable(
            self.n,
            float(cost.turn_cost),
            int(cost.distances is None),
            int(self.brief.launch_distances is not None),
            cost.ahead,
            np.ascontiguousarray(cost.points),
            np.zeros(0) if cost.odds is None else cost.odds_ahead,
            np.full(16, -1, dtype=np.int64),
            np.zeros(16),
            *self._steps(),
        )
        self._paths = 0
        nothing = np.zeros(0, dtype=np.int64)
        self.partitions = Partitions(
            np.zeros(1, dtype=np.int64), nothing, np.zeros(1, dtype=np.int64), *[nothing] * 3
        )
        self._divisions: dict[Any, int] = {}

    def _steps(self) -> list[Any]:
        """Return the table of steps between cells, which is empty if robots go straight."""
        cost, n = self.brief.tour_cost, self.n
        distances = cost.distances
        none, stepwise = np.zeros(0, dtype=np.int64), isinstance(distances, CellDistances)
        edges = (
            distances.steps()
            if isinstance(distances, CellDistances)
            else (none, none, none * 0.0, none.reshape(0, 2))
        )
        sets, rows = (_SETS, max(_ROWS // n, 2)) if stepwise else (1, 0)
        rows = min(rows, sets * n)
        capacity = len(edges[1]) + n + 2 if stepwise else 0
        return [
            int(stepwise),
            *edges,
            np.ascontiguousarray(cost.steps, dtype=np.float64),
            np.zeros(4, dtype=np.int64),
            np.zeros(sets, dtype=np.uint64),
            np.zeros((sets, (n + 63) // 64), dtype=np.uint64),
            np.zeros((sets if stepwise else 0, n), dtype=np.int32),
            np.zeros((rows, n)),
            np.full(1 << (2 * rows + 1).bit_length(), -1, dtype=np.int64),
            np.zeros(1 << (2 * rows + 1).bit_length(), dtype=np.int32),
            np.zeros(capacity),
            np.zeros(capacity, dtype=np.int64),
        ]

    def _worlds(self) -> None:
        b, m, n = self.count, self.m, self.n
        words, media = (n + 63) // 64, len(self.rules.media)
        bursts = "bursts" in {medium.kind for medium in self.scenario.network.media}
        relayed = min(m, 1 + max(RELAYED, min((m + 3) // 4, MOST_RELAYED)))
        facts, findings, stepwise = words + m, 1, self.tour.stepwise
        split, late = self.rules.longest > 0, self.rules.longest > 0 and self.rules.remembered
        self.worlds = Worlds(
            control=np.zeros(b, dtype=CONTROL),
            robots=np.zeros((b, m), dtype=ROBOT),
            peers=np.zeros((b, m, m), dtype=PEER),
            counts=np.zeros((b, m, m), dtype=np.int32),
            slow=np.zeros((b, m, 1, 2)),
            targets=np.zeros((b, words), dtype=np.uint64),
            done=np.zeros((b, m, words), dtype=np.uint64),
            own=np.zeros((b, m, words), dtype=np.uint64),
            avoided=np.zeros((b, m, words), dtype=np.uint64),
            claims=np.zeros((b, m, n if self.rules.multiplicity > 1 else 0), dtype=np.int32),
            goal=np.zeros((b, words), dtype=np.uint64),
            blocked=np.zeros((b, words), dtype=np.uint64),
            passed=np.zeros((b, m, words if stepwise else 0), dtype=np.uint64),
            path=np.zeros((b, m, n + 4 if stepwise else 0), dtype=np.int64),
            covered=np.zeros((b, n), dtype=np.int32),
            occupied=np.zeros((b, n), dtype=np.int32),
            owner=np.zeros((b, facts), dtype=np.int32),
            cells=np.zeros((b, 64 * facts), dtype=np.int32),
            next=np.zeros((b, 64 * facts), dtype=np.int32),
            head=np.zeros((b, n), dtype=np.int32),
            known=np.zeros((b, m, facts), dtype=np.uint64),
            before=np.zeros((b, m, REPEATED, facts), dtype=np.uint64),
            span=np.zeros((b, facts, 2), dtype=np.int32),
            after=np.zeros((b, 64 * facts), dtype=np.int32),
            linked=np.zeros((b, facts, 2), dtype=np.uint64),
            ahead=np.zeros((b, 64 * facts), dtype=np.int32),
            told=np.zeros((b, m, m), dtype=np.int64),
            begun=np.zeros((b, 64), dtype=np.int64),
            finder=np.zeros((b, 64 * findings), dtype=np.int32),
            place=np.zeros((b, 64 * findings), dtype=np.int32),
            reported=np.zeros((b, m, findings), dtype=np.uint64),
            reported_before=np.zeros((b, m, REPEATED, findings), dtype=np.uint64),
            closer=np.zeros((b, 64), dtype=np.int32),
            shut=np.zeros((b, 64), dtype=np.int32),
            closed=np.zeros((b, m, 1), dtype=np.uint64),
            closed_before=np.zeros((b, m, REPEATED, 1), dtype=np.uint64),
            times=np.zeros((b, 8 * m + 16)),
            posts=np.zeros((b, 8 * m + 16), dtype=np.int64),
            events=np.zeros((b, 8 * m + 16, 3), dtype=np.int64),
            values=np.zeros((b, 8 * m + 16)),
            messages=np.zeros((b, m + 4), dtype=MESSAGE),
            free=np.zeros((b, m + 4), dtype=np.int32),
            receivers=np.zeros((b, m + 4, m * self.rules.copies), dtype=np.int32),
            beats=np.zeros((b, m + 4, relayed, 4), dtype=np.int64),
            lags=np.zeros((b, m + 4, relayed)),
            word=np.zeros((b, m + 4, facts), dtype=np.int32),
            bits=np.zeros((b, m + 4, facts), dtype=np.uint64),
            finding_word=np.zeros((b, m + 4, findings), dtype=np.int32),
            finding_bits=np.zeros((b, m + 4, findings), dtype=np.uint64),
            closing_word=np.zeros((b, m + 4, 1), dtype=np.int32),
            closing_bits=np.zeros((b, m + 4, 1), dtype=np.uint64),
            parts=np.zeros((b, m + 4), dtype=np.int32),
            records=np.zeros((b, self.rules.recorded), dtype=np.int32),
            seen=np.zeros((b, m, m if split else 0), dtype=SEEN),
            stamps=np.zeros((b, m, m if late else 0, REMEMBERED), dtype=np.int64),
            bad=np.zeros((b, media, m, m) if bursts else (b, media, 0, 0), dtype=np.uint8),
            delays=np.zeros((b, self.rules.copies)),
            damaged=np.zeros((b, self.rules.copies), dtype=np.uint8),
            origin=np.zeros((b, self.rules.copies), dtype=np.uint8),
            random=np.zeros((b, self.rules.draws + _DRAWN)),
            visits=np.zeros((b, 64, 3), dtype=np.int64),
            visited=np.zeros((b, 64)),
            states=np.zeros((b, 8 * m + 16, 2), dtype=np.int64),
            stated=np.zeros((b, 8 * m + 16)),
            passes=np.zeros((b, 2 * n + 64 if stepwise else 1, 2), dtype=np.int64),
            stops=np.zeros((b, 4, 2), dtype=np.int64),
            stopped=np.zeros((b, 4)),
            wanted=np.zeros((b, words), dtype=np.uint64),
            left=np.zeros((b, words), dtype=np.uint64),
            settled=np.zeros((b, words), dtype=np.uint64),
            reach=np.zeros((b, words), dtype=np.uint64),
            anyone=np.zeros((b, words), dtype=np.uint64),
            members=np.zeros((b, n + m + 1), dtype=np.int64),
            ids=np.zeros((b, n + m + 1), dtype=np.int64),
            chain=np.zeros((b, facts), dtype=np.int64),
            section=np.zeros((b, facts), dtype=np.uint64),
            gathered=np.zeros((b, 64 * facts), dtype=np.int32),
            row=np.zeros((b, n)),
            offered=np.zeros((b, m), dtype=np.int64),
            others=np.zeros((b, m), dtype=np.int64),
            telling=np.zeros((b, m), dtype=np.int64),
            fronts=np.zeros((b, m, 3)),
            runs=np.zeros((b, 0 if self.ordered else n + 4 * m + 16), dtype=RUN),
        )

    def begin(self, world: int, scenario: Scenario) -> None:
        """Begin a scenario in a world."""
        w, m = self.worlds, self.m
        for array in w:
            array[world] = np.zeros((), dtype=array.dtype)
        w.counts[world], w.head[world] = -1, -1
        control, robots = w.control[world], w.robots[world]
        control.pending, control.covered_at = -1, inf
        goal = scenario.goal
        control.uncovered = goal.bit_count()
        w.goal[world], w.blocked[world] = _words(goal, self.n), _words(scenario.blocked, self.n)
        slots = w.free.shape[1]
        control.slots, w.free[world] = slots, np.arange(slots)[::-1]
        self._rngs[world] = np.random.default_rng(scenario.seed)
        w.random[world] = self._rngs[world].random(w.random.shape[1])
        robots["rate"], robots["place"] = scenario.rates, scenario.starts
        robots["start"] = scenario.starts
        robots["energy"] = robots["full"] = self.brief.energy
        robots["status"] = WAITING if self.ordered else 0
        for name in _NONE:  # -1 at first
            robots[name] = -1
        w.seen["forgotten"][world] = -1
        robots["fresh"] = robots["alive"] = 1
        robots["target"], robots["lingering"] = NOWHERE, LINGER
        robots["deadline"] = robots["left"] = robots["wake"] = robots["declared"] = inf
        robots["listening"] = [self.brief.listening(number) for number in range(1, m + 1)]
        for cell in scenario.targets:
            w.targets[world, cell >> 6] |= np.uint64(1 << (cell & 63))
        faults = self._faults(world, scenario)  # may replace arrays
        events.start(self.tour, self.worlds, world, faults)

    def _faults(self, world: int, scenario: Scenario) -> NDArray[np.float64]:
        """Write the lasting faults of a scenario to the robots, and return the events of the
        others.
        """
        robots, rows = self.worlds.robots[world], []
        slow: list[list[tuple[float, float]]] = [[] for _ in range(self.m)]
        for fault in scenario.faults:
            i = fault.robot - 1
            if isinstance(fault, Crash):
                rows.append((CRASH, i, fault.time, 0.0))
            elif isinstance(fault, Pause):
                rows.append((PAUSE, i, fault.time, fault.until))
            elif isinstance(fault, WrongPosition):
                robots["start"][i] = (scenario.starts[i] + fault.off) % self.n
            elif isinstance(fault, Battery):
                robots["energy"][i] = fault.energy
                robots["full"][i] = min(robots["full"][i], fault.energy)
            elif isinstance(fault, Liar):
                robots["liar"][i] = 1
            elif isinstance(fault, Slow):
                slow[i].append((fault.time, fault.factor))
        most = max(map(len, slow))
        if most > self.worlds.slow.shape[2]:
            self.worlds = self.worlds._replace(slow=_enlarge(self.worlds.slow, 2, most))
        self.worlds.slow[world, ..., 0], self.worlds.slow[world, ..., 1] = inf, 1.0
        for i, periods in enumerate(slow):
            for k, pair in enumerate(periods):
                self.worlds.slow[world, i, k] = pair
        self._grow(world, faults=len(rows) + self.m)
        return np.array(rows, dtype=np.float64).reshape(-1, 4)

    def run(self, world: int, until: float, *, most: int = _EVENTS) -> None:
        """Simulate all events of a world up to a time, or at most so many events."""
        self.worlds.control[world].most = most
        while not events.run(self.tour, self.rules, self.partitions, self.worlds, world, until):
            self.serve(world)

    def outcome(self, world: int) -> SearchOutcome:
        """Return what has happened in a world so far."""
        w, control = self.worlds, self.worlds.control[world]
        cells: list[list[int]] = [[] for _ in range(self.m)]
        times: list[list[float]] = [[] for _ in range(self.m)]
        states: list[list[tuple[float, str]]] = [[] for _ in range(self.m)]
        count = int(control.visits)
        for (i, cell, _), time in zip(
            w.visits[world, :count].tolist(), w.visited[world, :count].tolist(), strict=True
        ):
            cells[i].append(cell)
            times[i].append(time)
        count = int(control.states)
        for (i, state), time in zip(
            w.states[world, :count].tolist(), w.stated[world, :count].tolist(), strict=True
        ):
            states[i].append((time, STATES[state]))
        declared = w.robots[world]["declared"]
        order = np.argsort(declared, kind="stable")
        return SearchOutcome(
            tuple(np.array(entries, dtype=np.int64) for entries in cells),
            tuple(np.array(entries, dtype=np.float64) for entries in times),
            tuple(tuple(entries) for entries in states),
            tuple(self._found(world, i) for i in range(self.m)),
            {int(i) + 1: float(declared[i]) for i in order if declared[i] < inf},
            int(control.sent),
            int(control.lost),
            int(control.takeovers),
            float(control.covered_at),
            self._detours(world),
            self._obstructed(world),
        )

    def _detours(self, world: int) -> tuple[tuple[tuple[int, ...], ...], ...]:
        """Return the cells that robots passed on the way to each search."""
        if not self.tour.stepwise:
            return ()
        detours: list[list[tuple[int, ...]]] = [[] for _ in range(self.m)]
        passing: list[list[int]] = [[] for _ in range(self.m)]
        for i, cell in self.worlds.passes[world, : self.worlds.control[world].passes].tolist():
            if cell >= 0:
                passing[i].append(cell)
            else:
                detours[i].append(tuple(passing[i]))
                passing[i] = []
        return tuple(map(tuple, detours))

    def _obstructed(self, world: int) -> tuple[tuple[tuple[float, int], ...], ...]:
        """Return the times and cells of the obstacles that each robot met."""
        met: list[list[tuple[float, int]]] = [[] for _ in range(self.m)]
        w, count = self.worlds, self.worlds.control[world].stops
        for (i, cell), time in zip(
            w.stops[world, :count].tolist(), w.stopped[world, :count].tolist(), strict=True
        ):
            met[i].append((time, cell))
        return tuple(map(tuple, met))

    def _found(self, world: int, i: int) -> dict[int, int]:
        """Return the bitset of the robots that found something in each cell, as a robot knows."""
        w = self.worlds
        witnesses: dict[int, int] = {}
        for finding in range(int(self.worlds.control[world].findings)):
            if int(w.reported[world, i, finding >> 6]) >> (finding & 63) & 1:
                cell = int(w.place[world, finding])
                witnesses[cell] = witnesses.get(cell, 0) | 2 << int(w.finder[world, finding])
        return witnesses

    def serve(self, world: int) -> None:
        """Give a world what it asks for."""
        control = self.worlds.control[world]
        need, first, second = int(control.need), int(control.need_one), int(control.need_other)
        cost = self.brief.tour_cost
        if need == A_LENGTH:
            self._add_path(first * self.n + second, cost.length(first, second))
        elif need == A_LAUNCH:
            distances = self.brief.launch_distances
            has_launch = distances is not None and first + 1 in distances
            away = (
                distances.length(first + 1, second)
                if has_launch and distances is not None
                else -1.0
            )
            self._add_path((self.n + first) * self.n + second, away)
        elif need == A_PARTITION:
            self._divide(world, first)
        elif need == RANDOM:
            self._draw(world)
        else:
            self._grow(world, path=first, parts=second)

    def _draw(self, world: int) -> None:
        control = self.worlds.control[world]
        needed = int(control.need_other) * self.rules.draws
        if needed > self.worlds.random.shape[1]:
            before = self.worlds.random.shape[1]
            longer = _enlarge(self.worlds.random, 1, needed + _DRAWN)
            for other, rng in enumerate(self._rngs):
                longer[other, before:] = rng.random(longer.shape[1] - before)
            self.worlds = self.worlds._replace(random=longer)
        random = self.worlds.random[world]
        drawn = int(control.drawn)
        unused = len(random) - drawn
        random[:unused] = random[drawn:]
        random[unused:] = self._rngs[world].random(drawn)
        control.drawn = 0

    def _add_path(self, key: int, length: float) -> None:
        """Put the length of a path into the table."""
        keys, lengths = self.tour.keys, self.tour.lengths
        if 2 * (self._paths + 1) > len(keys):
            filled = keys >= 0
            old = zip(keys[filled].tolist(), lengths[filled].tolist(), strict=True)
            keys, lengths = np.full(4 * len(keys), -1, dtype=np.int64), np.zeros(4 * len(keys))
            self.tour = self.tour._replace(keys=keys, lengths=lengths)
            for old_key, away in old:
                _put(keys, lengths, old_key, away)
        _put(keys, lengths, key, length)
        self._paths += 1

    def _divide(self, world: int, i: int) -> None:
        """Give a robot the division of the tour among all robots that it knows."""
        robots = self.worlds.robots[world]
        team_members = [k for k in range(self.m) if k == i or self.worlds.counts[world, i, k] >= 0]
        starts, rates = robots["start"].tolist(), robots["rate"].tolist()
        team = tuple((k + 1, starts[k] % self.n, rates[k], 1) for k in team_members)
        number = self._divisions.get(team)
        if number is None:
            parts = partition(self.brief.tour_cost, self.brief.allocator, team)
            number = self._divisions[team] = len(self._divisions)
            old, arcs = self.partitions, [arc for part in parts for arc in part.arcs]
            ends = np.cumsum([len(part.arcs) for part in parts])
            self.partitions = Partitions(
                np.append(old.starts, len(old.robots) + len(parts)),
                np.append(old.robots, [part.robot - 1 for part in parts]),
                np.append(old.arcs, len(old.first) + ends),
                np.append(old.first, np.array([arc.first for arc in arcs], dtype=np.int64)),
                np.append(old.sizes, np.array([arc.count for arc in arcs], dtype=np.int64)),
                np.append(old.step, np.array([arc.step for arc in arcs], dtype=np.int64)),
            )
        robots["offer"][i], robots["offered_for"][i] = number, len(team_members)

    def _grow(self, world: int, *, faults: int = 0, path: int = 0, parts: int = 0) -> None:
        """Replace all arrays that are full in a world by arrays of at least twice the length; make
        room for so many more events, for paths of so many cells, and for so many messages at once.
        """
        w, control = self.worlds, self.worlds.control[world]
        changes: dict[str, Any] = {}

        def fit(axis: int, needed: int, *names: str) -> None:
            for name in names:
                array = changes.get(name, getattr(w, name))
                if needed > array.shape[axis]:
                    longer = max(2 * array.shape[axis], needed)
                    changes[name] = _enlarge(array, axis, longer)

        messages, slots = max(parts, 1), w.free.shape[1]
        events_at_once = messages * self.m * self.rules.copies + 4 + faults
        fit(1, int(control.queued) + events_at_once, "times", "posts", "events", "values")
        fit(1, slots + max(messages - int(control.slots), 0), *_SLOTS)
        words = int(control.words) + 1
        fit(1, words, "owner", "linked", "span", "chain", "section")
        fit(
            1,
            64 * len(changes.get("owner", w.owner)[world]),
            "cells",
            "next",
            "after",
            "ahead",
            "gathered",
        )
        fit(2, len(changes.get("owner", w.owner)[world]), "known", "word", "bits")
        fit(3, len(changes.get("owner", w.owner)[world]), "before")
        findings = (int(control.findings) + 64) >> 6
        fit(1, 64 * findings, "finder", "place")
        fit(2, findings, "reported", "finding_word", "finding_bits")
        fit(3, findings, "reported_before")
        closings = (int(control.closings) + 64) >> 6
        fit(1, 64 * closings, "closer", "shut")
        fit(2, closings, "closed", "closing_word", "closing_bits")
        fit(3, closings, "closed_before")
        fit(1, int(control.visits) + 1, "visits", "visited")
        fit(1, int(control.states) + 4, "states", "stated")
        fit(1, int(control.stops) + 1, "stops", "stopped")
        fit(2, path, "path")
        path_size = changes.get("path", w.path).shape[2]
        fit(1, int(control.passes) + path_size + 1, "passes")
        self.worlds = w._replace(**changes)
        slot_count = self.worlds.free.shape[1]
        for other in range(self.count if slot_count > slots else 0):
            old_slots = int(self.worlds.control[other].slots)
            self.worlds.free[other, old_slots : old_slots + slot_count - slots] = np.arange(
                slots, slot_count
            )
            self.worlds.control[other].slots = old_slots + slot_count - slots


def _words(bits: int, n: int) -> NDArray[np.uint64]:
    """Return a bitset as words of 64 bits."""
    words = (n + 63) // 64
    return np.frombuffer(bits.to_bytes(8 * words, "little"), dtype="<u8").astype(np.uint64)


def _enlarge(array: NDArray[Any], axis: int, length: int) -> NDArray[Any]:
    """Return an array that begins with another one, and is longer along an axis."""
    shape = list(array.shape)
    shape[axis] = length
    longer = np.zeros(shape, dtype=array.dtype)
    longer[tuple(slice(side) for side in array.shape)] = array
    return longer


def _put(keys: NDArray[np.int64], lengths: NDArray[np.float64], key: int, length: float) -> None:
    """Put an entry into an open hash table, in the way in which kernels look for it."""
    at = ((key * _MIX & _WORD) >> 40) & (len(keys) - 1)
    while keys[at] >= 0:
        at = (at + 1) & (len(keys) - 1)
    keys[at], lengths[at] = key, length
