"""The robot as a state machine: a pure function from a state and an event to a new state and
actions.

The state machine uses only data that the robot has sensed or received. The same state machine runs
in the simulation (`shoal.search.simulation`) and in the processes of live robots
(`shoal.search.simulation.live`).

A robot first listens, then divides the tour among all robots that it knows, and then searches its
own part. A robot that has searched its own part is idle. Idle robots divide the remaining cells of
silent and late robots among themselves (`shoal.search.protocol.helping`).

A robot without work waits while other robots work. A waiting robot starts to search again at the
last moment at which it can still search all unsearched cells alone before its deadline. The
deadline is the time at which the robot would finish if it searched the whole tour alone, beginning
when it first divides the tour or, if all departures are planned, when the others should have
finished. For this reason, a single surviving robot searches all cells by its deadline, even if all
messages and all other robots are lost. Paper H demands on pages 4 to 7 that the search is complete
as long as one robot is alive.

A robot that finds a blocked cell reports this cell, so that all robots avoid it. Robots leave out
cells that none of them can reach.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import ceil, inf

from shoal.search.allocation.allocate import Arc, cost_of_all, partition
from shoal.search.allocation.viewpoints import best_viewpoint
from shoal.search.cells.distances import CellDistances
from shoal.search.kernels.protocol.numbers import (
    ARRIVAL,
    AVOIDED,
    DECISIONS,
    HELLOS,
    LAG_UNIT,
    LAST_ROUND,
    LEAST,
    LOOK,
    MARK,
    MOST,
    MOST_RELAYED,
    NEWS,
    REPEATED,
    ROUND,
)
from shoal.search.kernels.protocol.numbers import (
    RELAYED as RELAYED,  # noqa: PLC0414 - of companion computers, too
)
from shoal.search.protocol.helping import cell_to_help, is_taken, leaves_to_others
from shoal.search.protocol.messages import Beacon, Heartbeat
from shoal.search.protocol.state import (
    Action,
    Begin,
    Blocked,
    Brief,
    Declare,
    Event,
    Go,
    GoHome,
    Heard,
    Obstructed,
    Peer,
    Recharged,
    Robot,
    Send,
    Sensed,
    WakeAt,
    free_cells,
    obstacles,
    own_reach,
    reachable_cells,
    settled_cells,
    silence_limit,
    step_cost,
)
from shoal.search.tours.masks import arc_bits, bits_to_array, bitset_of, next_in

Decision = tuple[Robot, Action | None, float]
"""The state of a robot, its next action or None, and the time until which the robot waits if it has
no action.
"""


def advance(
    robot: Robot, event: Event, decide: Callable[[Robot, float], Decision] | None = None
) -> tuple[Robot, list[Action]]:
    """Return the state of a robot after an event, and the actions of the robot.

    The function ``decide(robot, time)`` chooses the next action of a robot that has no target. By
    default, this function is `next_action`.

    Examples
    --------
    >>> from shoal.search import TourCost, make_tour
    >>> from shoal.search.protocol.state import Begin, Wake
    >>> brief = Brief(TourCost(make_tour("moore", (2, 2))))
    >>> robot, actions = advance(Robot(7, brief, start=3), Begin(0.0))
    >>> robot.status, [type(action).__name__ for action in actions]
    ('listening', ['Send', 'WakeAt'])
    >>> robot, actions = advance(robot, Wake(1.0))
    >>> actions[0]
    Go(cell=3, through=())
    """
    actions: list[Action] = []
    time = event.time
    match event:
        case Begin():
            robot = robot.replaced(
                began=time,
                next_beat=time,
                cell=robot.start,
                at_launch=True,
                left=robot.brief.energy,
                passed=1 << robot.start,
            )
        case Heard():
            robot = receive(robot, event.beacon, time)
        case Sensed():
            robot = _handle_sensed(robot.replaced(lag=robot.lag_at(time)), event)
        case Blocked():
            robot = _handle_blocked(robot.replaced(lag=robot.lag_at(time)), event.cell, time)
        case Obstructed():
            robot = _handle_obstructed(robot, event.cell, event.at)
        case Recharged():
            robot = robot.replaced(
                cell=robot.start,
                fresh=True,
                at_launch=True,
                target=None,
                left=robot.brief.energy,
                lag=robot.lag_at(time),
            )
    if (
        robot.status == "listening"
        and time >= robot.began + robot.brief.listening(robot.number) - 1e-9
    ):
        robot = _allot(robot, time)
    wake = inf
    if _defers_decision(robot, event):
        robot, wake = robot.replaced(unheeded=robot.unheeded + 1), robot.waits_until
    elif robot.status in ("searching", "waiting") and robot.target is None:
        robot, action, wake = (decide or next_action)(robot, time)
        if action is not None:
            actions.append(action)
        else:
            robot = robot.replaced(unheeded=0, waits_until=wake)
    if robot.status != "complete" or robot.lingering > 0:
        robot = _with_due_beacon(robot, time, actions)
        wake = min(wake, robot.next_beat)
        if robot.status == "listening":
            wake = min(wake, robot.began + robot.brief.listening(robot.number))
        actions.append(WakeAt(wake))
    return robot, actions


def _defers_decision(robot: Robot, event: Event) -> bool:
    """Return whether a waiting robot does not decide after a message, because it has decided after
    one of the messages just before.
    """
    return (
        isinstance(event, Heard)
        and robot.status == "waiting"
        and robot.target is None
        and event.time < robot.waits_until
        and (robot.unheeded + 1) * DECISIONS < len(robot.peers)
    )


def _handle_sensed(robot: Robot, event: Sensed) -> Robot:
    """Return the state of a robot after a search. All cells that the robot sees from its cell count
    as searched.
    """
    findings = dict(robot.found)
    for cell in (*((event.cell,) if event.found else ()), *event.beside):
        findings[cell] = findings.get(cell, 0) | 1 << robot.number
    searched = {**robot.searched, robot.number: robot.mine | _visible_cells(robot, event.cell)}
    stopped = _handle_stopped(robot, event.cell, robot.through, energy=robot.left - robot.cost)
    return stopped.replaced(searched=searched, found=findings, fresh=False)


def _visible_cells(robot: Robot, cell: int) -> int:
    """Return the bitset of cells that a robot sees from a cell."""
    if robot.width == 1:
        return 1 << cell
    return bitset_of(robot.brief.tour_cost.visible_cells(cell, robot.width).tolist())


def _handle_blocked(robot: Robot, cell: int, time: float) -> Robot:
    """Return the state of a robot that avoids a cell for a while, because another robot is in this
    cell.

    Otherwise, two robots could wait for each other forever.
    """
    stopped = _handle_stopped(robot, cell, robot.through, energy=robot.left - robot.cost)
    avoided = robot.avoided | 1 << cell
    return stopped.replaced(fresh=True, avoided=avoided, avoided_until=time + AVOIDED)


def _handle_obstructed(robot: Robot, cell: int, at: int) -> Robot:
    """Return the state of a robot that stops in front of an obstacle, and reports the cell of the
    obstacle as blocked.
    """
    path = robot.through[: robot.through.index(at) + 1] if at in robot.through else ()
    energy = (
        robot.left - robot.brief.tour_cost.length(robot.cell, at) - robot.launch_cost(at) - LOOK
    )
    closed = {**robot.closed, robot.number: robot.closed.get(robot.number, 0) | 1 << cell}
    fresh = robot.fresh or at != robot.cell
    return _handle_stopped(robot, at, path, energy=energy).replaced(fresh=fresh, closed=closed)


def _handle_stopped(robot: Robot, cell: int, path: tuple[int, ...], *, energy: float) -> Robot:
    """Return the state of a robot that has stopped in a cell after the cells of a path, which are
    therefore free.
    """
    distances, passed = robot.brief.tour_cost.distances, robot.passed
    if path and isinstance(distances, CellDistances):
        passed |= distances.crossed(robot.cell, path)
    return robot.replaced(
        cell=cell, at_launch=False, target=None, through=(), passed=passed, left=energy
    )


def receive(robot: Robot, beacon: Beacon, time: float) -> Robot:
    """Return the state of a robot after it has received a beacon."""
    peers, lost, received = dict(robot.peers), robot.lost, robot.received
    searched = _with_news(robot, robot.searched, beacon.searched)
    for heartbeat in beacon.heartbeats:
        peer = peers.get(heartbeat.robot)
        if (
            peer is not None and peer.heartbeat.count >= heartbeat.count
        ) or heartbeat.robot == robot.number:
            continue
        if heartbeat.robot == beacon.sender and peer is not None:
            lost, received = lost + heartbeat.count - peer.heartbeat.count - 1, received + 1
        peers[heartbeat.robot] = Peer(
            heartbeat,
            time,
            _marks(robot, peer, heartbeat.lag, time),
            *_path_of_peer(robot, peer, heartbeat, time),
        )
    closed = _with_news(robot, robot.closed, beacon.closed)
    findings = robot.found
    for cell, witnesses in beacon.found:
        if cell < len(robot.brief.tour_cost) and witnesses & ~findings.get(cell, 0):
            findings = {**findings, cell: findings.get(cell, 0) | witnesses}
    return robot.replaced(
        peers=peers, lost=lost, received=received, searched=searched, found=findings, closed=closed
    )


def _marks(
    robot: Robot, peer: Peer | None, lag: float, time: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return two pairs (time, lag of a peer), several beacon periods apart. The pairs serve to
    estimate the peer's speed.
    """
    if peer is None:
        return ((time, lag),) * 2
    if time - peer.marks[1][0] < MARK * robot.brief.beat:
        return peer.marks
    return peer.marks[1], (time, lag)


def _path_of_peer(
    robot: Robot, peer: Peer | None, heartbeat: Heartbeat, time: float
) -> tuple[float, float]:
    """Return the time at which a peer first reported its destination, and the length of its path
    there in cell sides.
    """
    before, n = (
        heartbeat.start if peer is None else peer.heartbeat.place,
        len(robot.brief.tour_cost),
    )
    if peer is not None and before == heartbeat.place:
        return peer.since, peer.distance
    return time, robot.brief.tour_cost.length(before % n, heartbeat.place % n)


def _with_news(
    robot: Robot, cells_of: Mapping[int, int], news: tuple[tuple[int, int], ...]
) -> Mapping[int, int]:
    """Return one set of cells for each robot: the set in ``cells_of``, extended by the cells that a
    beacon reports for this robot.
    """
    for other, reported in news:
        bits = cells_of.get(other, 0)
        if reported != bits and other != robot.number:
            # a bit that stands for no cell would never be settled
            more = reported & robot.brief.everything & ~bits
            if more:
                cells_of = {**cells_of, other: bits | more}
    return cells_of


def _with_due_beacon(robot: Robot, time: float, actions: list[Action]) -> Robot:
    """If it is time for the next beacon, add this beacon to the actions. Return the state of the
    robot after the beacon.
    """
    if time < robot.next_beat - 1e-9:
        return robot
    hello = robot.status == "listening" and time < robot.began + robot.brief.hello - 1e-9
    pause = min(robot.brief.beat, robot.brief.hello / HELLOS) if hello else robot.brief.beat
    robot = robot.replaced(count=robot.count + 1, next_beat=time + pause)
    if robot.status == "complete":
        robot = robot.replaced(lingering=robot.lingering - 1)
    robot, beacon = with_beacon(robot, time)
    actions.append(Send(beacon))
    return robot


def with_beacon(robot: Robot, time: float) -> tuple[Robot, Beacon]:
    """Return the state of a robot that has sent a beacon, and this beacon."""
    n, knowledge = len(robot.brief.tour_cost), (robot.searched, robot.found, robot.closed)
    before: tuple[Mapping[int, int], ...] = (
        robot.announced[0] if len(robot.announced) == REPEATED else ({}, {}, {})
    )
    window = _window(robot, n)
    findings = tuple(
        (cell, robots)
        for cell, robots in sorted(robot.found.items())
        if window >> cell & 1 or robots & ~before[1].get(cell, 0)
    )
    beacon = Beacon(
        robot.number,
        (_own_heartbeat(robot, time), *relayed_heartbeats(robot)),
        _news(robot, robot.searched, before[0], window),
        findings,
        _news(robot, robot.closed, before[2], window),
    )
    announced = (*robot.announced[-REPEATED + 1 :], knowledge)
    return robot.replaced(
        announced=announced, window=(robot.window + window.bit_count()) % n
    ), beacon


def _news(
    robot: Robot, now: Mapping[int, int], before: Mapping[int, int], window: int
) -> tuple[tuple[int, int], ...]:
    """Return, for each robot by its number, a bitset of those cells in ``now`` that are missing in
    ``before`` or lie in the bitset ``window``.

    Of more than `NEWS` other robots, successive beacons tell in turn what is missing in ``before``.
    """
    fresh = {number: bits & ~before.get(number, 0) for number, bits in now.items()}
    senders = sorted(number for number, bits in fresh.items() if bits and number != robot.number)
    if len(senders) > NEWS:
        first = robot.count * NEWS % len(senders)
        for number in (senders[first:] + senders[:first])[NEWS:]:
            fresh[number] = 0
    news = ((number, fresh[number] | bits & window) for number, bits in sorted(now.items()))
    return tuple((number, bits) for number, bits in news if bits)


def _window(robot: Robot, n: int) -> int:
    """Return the section of the tour whose facts the next beacon repeats, as a bitset.

    The section of each beacon begins where the section of the previous beacon ended. A section is
    as long as the space for facts in one beacon allows.
    """
    everything = robot.brief.everything
    total = _intervals(robot, everything)
    share = max(
        LEAST, min(ceil(total / (LAST_ROUND if robot.status == "complete" else ROUND)), MOST)
    )
    if total <= share:
        return everything
    width, window = n, everything
    while width > 1 and _intervals(robot, window) > share:
        width = ceil(width / 2)
        window = arc_bits(robot.window, width, n)
    return window


def _intervals(robot: Robot, window: int) -> int:
    """Return the approximate number of intervals in all known sets of cells, inside a window of the
    tour.
    """
    sets = [bits & window for bits in (*robot.searched.values(), *robot.closed.values())]
    return sum((bits & ~(bits << 1)).bit_count() for bits in sets) + sum(
        window >> cell & 1 for cell in robot.found
    )


def _own_heartbeat(robot: Robot, time: float) -> Heartbeat:
    place = robot.cell if robot.target is None or robot.target < 0 else robot.target
    lag = round(robot.lag_at(time) / LAG_UNIT) * LAG_UNIT
    return Heartbeat(
        robot.number, robot.count, robot.start, robot.rate, robot.status, robot.width, place, lag
    )


def relayed_heartbeats(robot: Robot) -> list[Heartbeat]:
    """Return the heartbeats of some other robots. Successive beacons relay the heartbeats of all
    other robots in turn.
    """
    peers = sorted(robot.peers)
    count = max(RELAYED, min(ceil(len(peers) / 4), MOST_RELAYED))
    first = robot.count * count % max(len(peers), 1) if count < len(peers) else 0
    return [robot.peers[number].heartbeat for number in (peers[first:] + peers[:first])[:count]]


def next_action(robot: Robot, time: float) -> Decision:
    """Return the state of a robot, its next action, and the time until which the robot waits if it
    has no action.
    """
    # the robot knows more robots than at the last division
    if robot.allotted_to <= len(robot.peers):
        robot = _allot(robot, time)
    closed_cells = settled_cells(robot, time)
    own, anyone = reachable_cells(robot, time)
    if anyone & ~closed_cells == 0:
        return robot.replaced(status="complete", next_beat=time), Declare(), inf
    remaining = own & ~closed_cells & ~robot.mine
    if time < robot.avoided_until and remaining & ~robot.avoided:
        remaining &= ~robot.avoided
    elif robot.avoided:
        robot = robot.replaced(avoided=0)
    cell, wake = _own_cell(robot, remaining), inf
    if (
        cell is None
        or is_taken(robot, cell, time)
        or (_is_apart(robot, cell) and leaves_to_others(robot, own, time))
    ):
        cell, wake = _cell_of_others(robot, remaining, own, cell, time)
    if cell is None:
        return robot.replaced(status="waiting"), None, wake
    if _is_apart(robot, cell):
        robot = robot.replaced(next_beat=time)  # other robots learn at once where this robot helps
    robot = robot.replaced(aim=cell)
    return head_for(
        robot, cell if robot.width == 1 else _stop_for(robot, cell, own, remaining, time), time
    )


def _own_cell(robot: Robot, remaining: int) -> int | None:
    """Return the next cell of ``remaining`` in the arcs that the robot must search, or None if no
    such cell remains.
    """
    for arc in _arcs_to_search(robot):
        cell = arc.next_of(remaining, len(robot.brief.tour_cost))
        if cell is not None:
            return int(cell)
    return None


def _is_apart(robot: Robot, cell: int) -> bool:
    """Return whether a cell is neither the robot's cell nor one of the two cells beside the robot's
    cell on the tour.
    """
    n = len(robot.brief.tour_cost)
    return (cell - robot.cell) % n not in (0, 1, n - 1)


def _cell_of_others(
    robot: Robot, remaining: int, own: int, mine: int | None, time: float
) -> tuple[int | None, float]:
    """Return a cell that the robot searches to help other robots, or None and the time until which
    the robot waits.

    The robot helps only if it can still search all remaining cells alone before its deadline. If
    the robot cannot wait any longer, the result is the next cell in its own arcs (``mine``) or, if
    ``mine`` is None, the next unsearched cell.
    """
    cell = cell_to_help(robot, remaining, own, time)
    if cell is not None and not (_is_apart(robot, cell) and leaves_to_others(robot, own, time)):
        need = step_cost(
            robot.brief.tour_cost, robot.cell, cell, robot.fresh, obstacles(robot)
        ) + robot.launch_cost(cell)
        need += _cost_alone(robot, remaining & ~(1 << cell), cell, False)
        if time + need / robot.rate <= robot.deadline + 1e-9:
            return cell, inf
    last = robot.deadline - _cost_alone(robot, remaining, robot.cell, robot.fresh) / robot.rate
    if remaining and time >= last - 1e-9:
        n = len(robot.brief.tour_cost)
        return next_in(remaining, robot.cell, n) if mine is None else mine, inf
    limit = silence_limit(robot) + 1e-6
    silences = [peer.heard + limit for peer in robot.peers.values()]
    return None, min(
        [last if remaining else inf, *(moment for moment in silences if moment > time)], default=inf
    )


def _stop_for(robot: Robot, cell: int, own: int, remaining: int, time: float) -> int:
    """Return the best stop for a robot with a wide footprint that wants to see a cell.

    If the robot, after the best stop, could not search all remaining cells before its deadline, the
    result is the cell itself. For this comparison, the function computes the remaining work for a
    footprint of one cell, so that the robot never plans more than it can do.
    """
    tour_cost, n, closed = robot.brief.tour_cost, len(robot.brief.tour_cost), obstacles(robot)
    part = next(part for part in robot.parts if part.bits >> cell & 1)

    def cost(stop: int) -> float:
        return step_cost(tour_cost, robot.cell, stop, robot.fresh, closed) + robot.launch_cost(stop)

    shut = (
        (robot.avoided if time < robot.avoided_until else 0)
        | robot.brief.everything & ~own
        | closed
    )
    stop = best_viewpoint(
        tour_cost,
        robot.width,
        robot.cell,
        bits_to_array(remaining & part.bits, n),
        cell,
        cost,
        shut,
    )
    unseen = remaining & ~_visible_cells(robot, stop)
    need = cost(stop) + cost_of_all(tour_cost, unseen, stop, False, closed)
    return stop if time + need / robot.rate <= robot.deadline else cell


def head_for(robot: Robot, cell: int, time: float) -> Decision:
    """Return the decision to go to a cell, or to go home and recharge if the energy is too low for
    the cell and the way home.

    A robot with a full battery always goes to the cell.
    """
    tour_cost, distances = robot.brief.tour_cost, robot.brief.tour_cost.distances
    unsure, back = 0, robot.brief.from_launch(robot.number, robot.start, cell)
    through: tuple[int, ...] = ()
    home: tuple[int, ...] = ()
    if isinstance(distances, CellDistances):
        closed = obstacles(robot)
        cost = step_cost(tour_cost, robot.cell, cell, robot.fresh, closed) + robot.launch_cost(cell)
        through = tour_cost.through(robot.cell, cell, fresh=robot.fresh, closed=closed)
        unsure = robot.brief.everything & ~free_cells(robot)
        home = distances.cells(robot.cell, robot.start, unsure)
        need = (
            2 * cost
            + LOOK
            + distances.length(robot.cell, robot.start, unsure)
            + back
            - robot.launch_cost(cell)
        )  # the robot may have to return along the same path
    else:
        cost = step_cost(tour_cost, robot.cell, cell, robot.fresh) + robot.launch_cost(cell)
        need = cost + (tour_cost.length(cell, robot.start) + back if robot.left < inf else 0.0)
    if need > robot.left and robot.left < robot.brief.energy:
        cost = tour_cost.length(robot.cell, robot.start, unsure) + robot.brief.recharge * robot.rate
        cost += robot.brief.from_launch(robot.number, robot.start, robot.cell)
        return (
            robot.replaced(status="searching", target=-1, since=time, cost=cost),
            GoHome(home),
            inf,
        )
    return (
        robot.replaced(status="searching", target=cell, through=through, since=time, cost=cost),
        Go(cell, through),
        inf,
    )


def _allot(robot: Robot, time: float) -> Robot:
    """Return the state of a robot after it has divided the tour among all robots that it knows.

    If the robot, with its new part, could not search all remaining cells alone before its deadline,
    it keeps its previous part.
    """
    brief, n = robot.brief, len(robot.brief.tour_cost)
    team = {robot.number: (robot.start, robot.rate, robot.width)}
    team |= {
        number: (peer.heartbeat.start % n, peer.heartbeat.rate, peer.heartbeat.width)
        for number, peer in robot.peers.items()
    }
    parts = partition(
        brief.tour_cost,
        brief.allocator,
        tuple((number, *team[number]) for number in sorted(team)),
    )
    own = next(index for index, part in enumerate(parts) if part.robot == robot.number)
    allotted = robot.replaced(
        parts=parts, own=own, status="searching", allotted_to=len(team), allotted_at=time
    )
    if not brief.helping:
        return allotted.replaced(deadline=inf)
    remaining = reachable_cells(allotted, -inf)[0] & ~(
        settled_cells(allotted, -inf) | allotted.mine
    )
    last = max(
        time + _cost_alone(allotted, remaining, robot.cell, robot.fresh) / robot.rate,
        _after_others(allotted, team),
    )
    if robot.status == "listening":
        return allotted.replaced(deadline=last)
    return allotted if last <= robot.deadline + 1e-9 else robot.replaced(allotted_to=len(team))


def _cost_alone(robot: Robot, remaining: int, position: int, fresh: bool) -> float:
    """Return the cost, in cells, of searching all cells in ``remaining`` alone: first the robot's
    own arcs, then all other cells.
    """
    tour_cost, n, closed = robot.brief.tour_cost, len(robot.brief.tour_cost), obstacles(robot)
    cost, away = 0.0, robot.at_launch and fresh
    for arc in _arcs_to_search(robot):
        for first, count in arc.stretches(remaining, n):
            if away:
                cost, away = robot.launch_cost(first), False
            cost += tour_cost.move_cost(
                position, first, fresh=fresh, closed=closed
            ) + tour_cost.search_cost(first, count, arc.step)
            position, fresh = (first + arc.step * (count - 1)) % n, False
        remaining &= ~arc.bits(n)
    if away and (cell := next_in(remaining, position, n)) is not None:
        cost = robot.launch_cost(cell)
    return cost + cost_of_all(tour_cost, remaining, position, fresh, closed)


def _arcs_to_search(robot: Robot) -> list[Arc]:
    """Return the arcs that a robot must search: its own arcs and, for a multiplicity above 1, the
    arcs of the next robots.
    """
    return [
        arc
        for ahead in range(min(robot.brief.multiplicity, len(robot.parts)))
        for arc in robot.parts[(robot.own + ahead) % len(robot.parts)].arcs
    ]


def _after_others(robot: Robot, team: Mapping[int, tuple[int, float, int]]) -> float:
    """Return when a robot would finish if it searched everything after all others should be done; 0
    without planned departures.

    A robot that waits for its planned departure is not dead: nobody searches its part for it as
    long as it may be on time. Cells that a robot cannot reach do not count. The mapping ``team``
    gives the start, the rate and the width of each robot.
    """
    brief, n, end, theirs = robot.brief, len(robot.brief.tour_cost), 0.0, 0
    for own, part in enumerate(robot.parts if brief.delays else ()):
        start, rate, width = team[part.robot]
        other = robot.replaced(
            number=part.robot,
            start=start,
            width=width,
            own=own,
            cell=start,
            at_launch=True,
            fresh=True,
        )
        bits = _cells_in(_arcs_to_search(other), n) & own_reach(other)
        if bits and own != robot.own:
            cost = _cost_alone(other, bits, start, True)
            end = max(
                end, robot.began + brief.listening(part.robot) + _longest_time(brief, cost, rate)
            )
            theirs |= bits
    if not theirs:
        return 0.0
    reach, position, fresh = own_reach(robot), robot.cell, True
    for arc in _arcs_to_search(robot)[-1:]:
        last = (arc.first + arc.step * (arc.count - 1)) % n
        if reach >> last & 1:
            position, fresh = last, False
    after = robot.replaced(at_launch=robot.at_launch and fresh)
    cost = max(
        _cost_alone(robot, reach, robot.cell, robot.fresh),
        _cost_alone(after, theirs & reach, position, fresh),
    )
    return end + ARRIVAL * brief.beat + cost / robot.rate


def _longest_time(brief: Brief, cost: float, rate: float) -> float:
    """Return an upper bound of the time for a cost in cells, with the flights home and the charges
    in between.
    """
    if cost == inf:  # nobody can reach the cells
        return inf
    charges = int(2 * cost // brief.energy)  # the way home is at most as long as the way so far
    return (cost + (charges * brief.energy if charges else 0.0)) / rate + charges * brief.recharge


def _cells_in(arcs: list[Arc], n: int) -> int:
    bits = 0
    for arc in arcs:
        bits |= arc.bits(n)
    return bits
