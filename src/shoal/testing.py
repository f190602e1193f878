"""Conformance checks for what people add to Shoal, from policies to rigs and vehicles.

There are checks for worlds, tasks, policies, tours, planners, allocators, map formats, mission
formats, rigs, actuators and sensors, and for the vehicles, radios and sensors of search robots.
Shoal's own pass them all.

Each check runs the tested object on small random input. At the first violation of the object's
contract, a check raises ``AssertionError`` with one sentence. Call the checks from your own tests:

    from shoal.testing import check_policy

    def test_my_policy():
        check_policy(MyPolicy())
"""

from __future__ import annotations

import copy
import select
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from shoal.core.errors import InvalidInputError, RigError
from shoal.core.registry import configured
from shoal.missions.diagnostics import Sheet
from shoal.missions.files import mission_of
from shoal.missions.formats import FORMATS as MISSION_FORMATS
from shoal.missions.formats import MissionFormat
from shoal.missions.mission import KINDS, Mission
from shoal.rigs import Actuator, Frame, Rig, Sensor
from shoal.rigs.ports import check_pulses
from shoal.search import TourMaker, components, make_tour
from shoal.search.allocation.allocate import ALLOCATORS, Allocator, Team, numbers_of
from shoal.search.allocation.costs import TourCost
from shoal.search.protocol.messages import SHORTEST
from shoal.search.simulation.live.ports import CellFinding, Leg, Radio, RobotVehicle, SearchSensor
from shoal.search.tours import find_tour_maker
from shoal.steering import ContactWorld, Planner, SteeringTask, make_planner, polygon
from shoal.swarm import (
    Gathering,
    GridWorkspace,
    GridWorld,
    Policy,
    SwarmProblem,
    Task,
    View,
    make_policy,
    make_task,
)
from shoal.swarm.grid.board import Board, letters_of
from shoal.swarm.maps.files import FORMATS as MAP_FORMATS
from shoal.swarm.maps.files import read_map, write_map
from shoal.swarm.run import run
from shoal.swarm.simulation.loop import decided

__all__ = [
    "check_actuator",
    "check_allocator",
    "check_map_format",
    "check_mission_format",
    "check_planner",
    "check_policy",
    "check_radio",
    "check_rig",
    "check_search_sensor",
    "check_sensor",
    "check_task",
    "check_tour_maker",
    "check_vehicle",
    "check_world",
    "sample_workspaces",
]

ALL_RULES = ("block", "merge", "tilt")
ALL_DIMENSIONS = (2, 3)


def sample_workspaces(rng: Generator, *, count: int = 12) -> Iterator[GridWorkspace]:
    """Yield small random workspaces: corridors, rooms, caves, 3-D maps, and maps about as wide as a
    machine word (64 cells).
    """
    shapes: Sequence[tuple[int, ...]] = [
        (1, 9),
        (7, 1),
        (5, 6),
        (9, 12),
        (3, 63),
        (2, 64),
        (3, 65),
        (2, 3, 4),
        (6, 6),
    ]
    for index in range(count):
        shape = shapes[index % len(shapes)]
        free = rng.random(shape) < rng.choice([0.6, 0.85, 1.0])
        free.flat[int(rng.integers(free.size))] = True
        yield GridWorkspace(free, name=f"sample {index}").largest_component()


def _starts(workspace: GridWorkspace, rng: Generator) -> Any:
    n = int(rng.integers(1, workspace.n_free + 1))
    return workspace.cells[rng.choice(workspace.n_free, size=n, replace=False)]


def check_world(
    world_type: Any = GridWorld, *, rules: Sequence[str] = ALL_RULES, seed: int = 0
) -> None:
    """Check a world's methods ``initial`` and ``step`` against the contract of
    `shoal.swarm.GridWorld`.

    The check of a world tests five properties. A step never adds or removes particles, and never
    moves a particle into a wall. A step changes none of its arguments. A repetition of a step gives
    an equal result. Except under the move rule ``tilt``, a step displaces the mean position of the
    particles by at most one cell. Mirrored commands on a mirrored map give mirrored states.

    Parameters
    ----------
    world_type : callable
        A class or function that is called with a workspace and a move rule and returns a world.
    rules : sequence of str
    seed : int
    """
    rng = np.random.default_rng(seed)
    for workspace in sample_workspaces(rng):
        for rule in rules:
            world, start = world_type(workspace, rule), _starts(workspace, rng)
            flipped = world_type(GridWorkspace(workspace.free[..., ::-1]), rule)
            state, mirror = world.initial(start), flipped.initial(_mirrored(start, workspace))
            for command in rng.choice(list(letters_of(workspace.ndim)), size=25):
                before = state.cells.copy()
                after = world.step(state, command)
                assert np.array_equal(state.cells, before), f"{rule}: step changed its argument"
                assert world.step(state, command) == after, (
                    f"{rule}: the same step gave two results"
                )
                assert after.n_particles == len(start), (
                    f"{rule}: {len(start)} particles became {after.n_particles}"
                )
                assert workspace.free[tuple(after.cells.T)].all(), (
                    f"{rule}: a particle is in a wall"
                )
                if rule != "tilt":
                    moved = np.abs(after.cells.sum(axis=0) - before.sum(axis=0)).sum()
                    assert moved <= len(start), (
                        f"{rule}: {len(start)} particles travelled {moved} cells in one move"
                    )
                mirror = flipped.step(mirror, {"l": "r", "r": "l"}.get(command, command))
                expected = _mirrored(after.cells, workspace)
                assert sorted(map(tuple, mirror.cells.tolist())) == sorted(
                    map(tuple, expected.tolist())
                ), f"{rule}: the mirrored map and command gave another state"
                state = after


def _mirrored(cells: Any, workspace: GridWorkspace) -> Any:
    flipped = np.array(cells)
    flipped[:, -1] = workspace.shape[-1] - 1 - flipped[:, -1]
    return flipped


def check_task(task: str | Task, *, seed: int = 0) -> None:
    """Check a task: known cells agree with the true map, known cells stay known, and ``update``
    changes no argument.

    Parameters
    ----------
    task : str or Task
    seed : int
    """
    todo = make_task(task)
    rng = np.random.default_rng(seed)
    for workspace in sample_workspaces(rng):
        gathers = isinstance(todo, Gathering)
        world = GridWorld(workspace, "merge" if gathers else "block")
        state = world.initial(_starts(workspace, rng)[: 1 if gathers else None])
        belief = todo.begin(world, state, todo.choose_targets(workspace, rng))
        for command in rng.choice(list(letters_of(workspace.ndim)), size=25):
            after = world.step(state, command)
            updated = todo.update(belief, command, state.occupied, after.occupied)
            assert todo.update(belief, command, state.occupied, after.occupied) == updated, (
                "update is not repeatable"
            )
            assert updated.open <= world.free, "a wall is believed to be free"
            assert not (updated.obstacles & world.free), "a free cell is believed to be an obstacle"
            assert belief.open <= updated.open, "a cell known to be free was forgotten"
            assert belief.known <= updated.known, "a known cell was forgotten"
            # the frontier cells of a gathering hold particles
            assert isinstance(todo, Gathering) or not (updated.frontier & after.occupied), (
                "a cell with a particle still counts as unclassified"
            )
            state, belief = after, updated


def check_policy(
    policy: str | Policy,
    *,
    rules: Sequence[str] | None = None,
    dimensions: Sequence[int] | None = None,
    max_moves: int = 20_000,
    seed: int = 0,
) -> None:
    """Check a policy: it must end every episode, send valid commands, store no data in itself, and
    act equally in equal trials.

    A policy with the attribute ``gathers = True`` gathers the particles, in a region of all cells
    but one or, under the rule merge, in one cell. Other policies map.

    Parameters
    ----------
    policy : str or Policy
    rules : sequence of str, optional
        Move rules to test. The default is ``policy.rules``. For a policy without the attribute
        ``rules``, the default is all move rules.
    dimensions : sequence of int, optional
        Numbers of dimensions of the tested maps. The default is ``policy.dimensions``. For a policy
        without the attribute ``dimensions``, the default is 2 and 3.
    max_moves : int
        Maximum number of moves. An episode with more than ``max_moves`` moves is a violation of the
        contract.
    seed : int
    """
    chosen = make_policy(policy)
    rng = np.random.default_rng(seed)
    tested_rules: Sequence[str] = rules or sorted(getattr(chosen, "rules", ALL_RULES))
    tested_dimensions: Sequence[int] = dimensions or tuple(
        getattr(chosen, "dimensions", ALL_DIMENSIONS)
    )
    for workspace in sample_workspaces(rng):
        if workspace.ndim not in tested_dimensions:
            continue
        for rule in tested_rules:
            fields: dict[str, Any] = {"rule": rule, "max_moves": max_moves}
            place = workspace
            if getattr(chosen, "gathers", None):
                place = workspace.largest_component()
                fields["task"] = "gathering"
                if rule != "merge":
                    fields["region"] = place.cells[: max(1, place.n_free - 1)].tolist()
            start, trial = _starts(place, rng), int(rng.integers(1000))
            if len(start) > len(fields.get("region", place.cells)):
                start = start[1:]
            problem = SwarmProblem(place, policy=chosen, start=start, **fields)
            try:
                _check_episodes(problem, trial)
            except InvalidInputError as error:
                raise AssertionError(f"{error}, {_place(workspace, rule)}") from None


def _place(workspace: GridWorkspace, rule: str) -> str:
    return f"on a {'two' if workspace.ndim == 2 else 'three'}-dimensional map under rule {rule}"


def _check_episodes(problem: SwarmProblem, trial: int) -> None:
    """Check the first decision of a problem's policy, and check that three runs of one trial end
    and send equal commands.
    """
    policy = problem.setup.policy
    place = _place(problem.place, problem.rule)
    limit = problem.max_moves
    _check_view(problem)
    changed = problem.replaced(policy=copy.deepcopy(policy))
    first, *others = (
        run(one, trial=trial, stepwise=s)
        for one, s in ((problem, True), (problem, True), (changed, False))
    )
    assert first.status != "limit", (
        f"{policy.name}: no end after {limit} moves {place}:\n{problem.place}"
    )
    for other in others:
        assert other.commands == first.commands, (
            f"{policy.name}: the same trial gave two episodes {place}"
        )
    assert first.verify(), f"{policy.name}: {first.verify().message} {place}"


def _check_view(problem: SwarmProblem) -> None:
    """Check that one decision of a policy changes neither the policy nor the arguments of the
    decision.
    """
    policy, workspace, rule = problem.setup.policy, problem.place, problem.rule
    world = GridWorld(workspace, rule)
    start, targets = problem.setup.draw_start(np.random.default_rng(0))
    state = world.initial(start)
    region = None if targets is None else Board.of_mask(targets)
    belief = problem.setup.task.begin(world, state, targets)
    words = [
        board.words.copy() for board in (state.occupied, belief.open, belief.known, belief.frontier)
    ]
    own = copy.deepcopy(vars(policy)) if hasattr(policy, "__dict__") else {}
    commands, _ = decided(
        policy,
        View(belief, state.occupied, rule, problem.setup.mapping, targets=region),
        None,
        np.random.default_rng(0),
    )
    assert (vars(policy) if own else own) == own, (
        f"{policy.name}: a decision changed the policy object itself"
    )
    letters = letters_of(workspace.ndim)
    assert set(commands) <= set(letters), (
        f"{policy.name}: expected commands of the letters {letters} {_place(workspace, rule)}, got"
        f" {commands!r}"
    )
    same = (state.occupied, belief.open, belief.known, belief.frontier)
    for board, before in zip(same, words, strict=True):
        assert np.array_equal(board.words, before), (
            f"{policy.name}: a decision changed its arguments"
        )


def check_tour_maker(maker: str | TourMaker, *, seed: int = 0) -> None:
    """Check a tour maker, which makes a tour of the True cells of a mask.

    Each tour must visit every True cell once, and all cells of one component before the next
    component. Equal masks must give equal tours.

    Parameters
    ----------
    maker : str or TourMaker
    seed : int

    Raises
    ------
    AssertionError, InvalidInputError
        InvalidInputError is raised if a tour leaves out a True cell or visits a False cell, and
        AssertionError for any other violation.
    """
    rng = np.random.default_rng(seed)
    shapes = [(1, 1), (1, 9), (7, 1), (2, 2), (3, 3), (5, 6), (8, 8), (9, 12), (3, 65), (24, 31)]
    flat = [rng.random(shape) < share for shape in shapes for share in (0.3, 0.7, 0.95, 1.0)]
    for mask in flat:
        mask.flat[int(rng.integers(mask.size))] = True
    chosen = find_tour_maker(maker)
    for mask in [*flat, *(workspace.free for workspace in sample_workspaces(rng))]:
        if mask.ndim not in chosen.dimensions:
            continue
        given = mask.copy()
        tour = make_tour(chosen, given)
        assert np.array_equal(given, mask), f"{tour.name}: the mask was changed"
        labels = components(mask)
        changes = np.count_nonzero(np.diff(labels[tuple(tour.cells.T)]))
        assert changes == labels.max() - 1, (
            f"{tour.name}: {labels.max()} components, entered {changes + 1} times"
        )
        assert np.array_equal(make_tour(chosen, mask).cells, tour.cells), (
            f"{tour.name}: the same mask gave two tours"
        )


def check_planner(planner: str | Planner, *, seed: int = 0) -> None:
    """Check a planner of steering, on two particles in a square.

    A plan is None or an array of finite moves, at most ``task.max_moves``. A planner changes
    neither the task nor itself, and repeats its plan for an equal task. It reaches goals that one
    move without a touch reaches.

    Parameters
    ----------
    planner : str or Planner
    seed : int
    """
    chosen, rng = make_planner(planner), np.random.default_rng(seed)
    name, world = chosen.name, ContactWorld(polygon([(0, 0), (1, 0), (1, 1), (0, 1)]))
    for number in range(6):
        start = rng.uniform(0.2, 0.8, (2, 2))
        shifted = number < 3  # one move from the start, and no wall on the way
        goal = start + rng.uniform(-0.15, 0.15, 2) if shifted else rng.uniform(0.2, 0.8, (2, 2))
        task = SteeringTask(world, start, goal, 0.01, max_moves=40, seed=number)
        given, own = (start.copy(), goal.copy()), copy.deepcopy(vars(chosen))
        moves = chosen.plan(task)
        assert np.array_equal(start, given[0]), f"{name}: the planner changed the start"
        assert np.array_equal(goal, given[1]), f"{name}: the planner changed the goal"
        assert vars(chosen) == own, f"{name}: the planner changed itself"
        again = chosen.plan(replace(task))
        if moves is None:
            assert again is None, f"{name}: the same task gave two plans"
        else:
            array = np.asarray(moves)
            assert array.ndim == 2, f"{name}: expected moves of shape (k, 2), got {array.shape}"
            assert array.shape[1] == 2, f"{name}: expected moves of shape (k, 2), got {array.shape}"
            assert np.isfinite(array.astype(np.float64)).all(), f"{name}: a move is not finite"
            assert len(array) <= task.max_moves, f"{name}: {len(array)} moves of {task.max_moves}"
            assert np.array_equal(array, np.asarray(again)), f"{name}: the same task gave two plans"
        if shifted:
            assert moves is not None, f"{name}: no plan for goals that one move reaches"
            assert task.reaches_goal(moves), f"{name}: the plan misses goals that one move reaches"


def check_allocator(allocator: str | Allocator, *, seed: int = 0) -> None:
    """Check an allocator: it gives every cell of the tour to exactly one robot.

    The check uses tours of several shapes, and robots of different speeds, also several robots in
    one cell. An allocator changes none of its arguments, and repeats its answer.

    Parameters
    ----------
    allocator : str or callable
    seed : int
    """
    share = configured(ALLOCATORS, allocator) if isinstance(allocator, str) else allocator
    name = allocator if isinstance(allocator, str) else getattr(share, "__name__", str(share))
    rng = np.random.default_rng(seed)
    for shape in [(1, 1), (1, 9), (5, 6), (8, 8), (3, 65)]:
        cost = TourCost(make_tour("hilbert-rectangle", shape))
        n = len(cost)
        for robots in (1, 2, 5):
            starts = np.sort(rng.integers(n, size=robots))
            rates = rng.choice([0.5, 1.0, 2.0], size=robots)
            team = Team(starts, rates, cost.points[starts], np.ones(robots), cost.far(starts))
            before = copy.deepcopy(team)
            parts = [list(part) for part in share(cost, team)]
            what = f"{name}: {robots} robots on a tour of {n} cells"
            for array, old in zip(team, before, strict=True):
                assert np.array_equal(array, old), f"{what}: the team was changed"
            assert len(parts) == robots, f"{what}: arcs for {len(parts)} robots"
            for arc in (arc for part in parts for arc in part):
                assert arc.step in (1, -1), f"{what}: {arc}: expected the step 1 or -1"
                assert 0 <= arc.count <= n, f"{what}: {arc}: expected 0 to {n} cells"
            times = np.zeros(n, dtype=np.int64)
            for part in parts:
                np.add.at(times, numbers_of(part, n), 1)
            assert times.min() > 0, f"{what}: no robot searches cell {int(times.argmin())}"
            assert times.max() == 1, f"{what}: several robots search cell {int(times.argmax())}"
            again = [list(part) for part in share(cost, team)]
            assert again == parts, f"{what}: the same team gave two allocations"


def check_map_format(suffix: str, *, examples: Sequence[str | Path] = (), seed: int = 0) -> None:
    """Check a registered map format: what it writes, it reads, and it refuses damaged files in one
    sentence.

    Parameters
    ----------
    suffix : str
        Key of the format in `shoal.swarm.maps.files.FORMATS`, such as ".csv".
    examples : sequence of path
        Map files of the format. A format that Shoal only reads needs at least one.
    seed : int
    """
    form = MAP_FORMATS.get(suffix)
    assert form is not None, f"{suffix}: expected a registered map format"
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(example) for example in examples]
        if form.encode is not None:
            for number, workspace in enumerate(sample_workspaces(rng)):
                if workspace.ndim not in form.dimensions:
                    continue
                files.append(Path(folder, f"map{number}{suffix}"))
                write_map(workspace, files[-1])
                read = read_map(files[-1]).free
                assert np.array_equal(read, workspace.free), (
                    f"{suffix}: expected the written map, got another:\n{workspace}"
                )
        assert files, f"{suffix}: expected examples, because the format is only read"
        damaged = Path(folder, f"damaged{suffix}")
        for content in (file.read_bytes() for file in files[:4]):
            cuts = rng.integers(1, max(2, len(content)), size=6)
            flips = rng.integers(len(content), size=6)
            changed = [bytes([*content[:k], content[k] ^ 0x15, *content[k + 1 :]]) for k in flips]
            for bad in [*(content[:cut] for cut in cuts), *changed]:
                damaged.write_bytes(bad)
                try:
                    read_map(damaged)
                except InvalidInputError as error:
                    one_line = "\n" not in str(error)
                    assert one_line, f"{suffix}: expected one sentence, got {error}"  # noqa: PT017
                except Exception as error:
                    raise AssertionError(
                        f"{suffix}: a damaged file raised {type(error).__name__}: {error}"
                    ) from error


def check_mission_format(form: str | MissionFormat, *, seed: int = 0) -> None:
    """Check a mission format: what it writes, it reads, and its reader raises no error.

    Positions keep at least six decimals of a degree (about 0.1 m), or centimetres of a metre. Each
    waypoint has a place and an altitude, and a rover stays a rover. What is wrong in a damaged file
    is a diagnostic of the sheet, never an exception.

    Parameters
    ----------
    form : str or MissionFormat
    seed : int
    """
    chosen = MISSION_FORMATS.get(form) if isinstance(form, str) else form
    name, rng = chosen.suffix, np.random.default_rng(seed)
    for number in range(12):
        geographic = not (chosen.metres and number % 2)
        points = np.array([8.5, 47.4]) + rng.uniform(-0.002, 0.002, (1 + 3 * number, 2))
        if not geographic:
            points = (points - (8.5, 47.4)) * 1e5
        mission: Any = Mission(
            points,
            tuple(points[0].tolist()),
            robot=1 + number,
            kind=KINDS[number % len(KINDS)],  # type: ignore[arg-type]
            altitude=0.0 if KINDS[number % len(KINDS)] == "rover" else 40.0,
            geographic=geographic,
        )
        text = chosen.write(mission)
        assert isinstance(text, str), f"{name}: expected a text, got {type(text).__name__}"
        assert chosen.write(mission) == text, f"{name}: the same mission gave two files"
        sheet = Sheet(f"robot-{number}{name}")
        chosen.scan(text, sheet)
        assert (sheet.kind == "rover") == (mission.kind == "rover"), (
            f"{name}: a {mission.kind} became {sheet.kind or 'a vehicle without a kind'}"
        )
        try:
            read = mission_of(sheet, sheet.file)
        except InvalidInputError as error:
            raise AssertionError(f"{name}: its own file cannot be read: {error}") from None
        near = 1e-6 if geographic else 0.01
        assert len(read.waypoints) == len(points), (
            f"{name}: {len(points)} waypoints became {len(read.waypoints)}"
        )
        for what, entries in (("places", sheet.places), ("altitudes", sheet.altitudes)):
            assert len(entries) == len(points), (
                f"{name}: {len(points)} waypoints have {len(entries)} {what}"
            )
        assert abs(read.altitude - mission.altitude) <= 0.01, (
            f"{name}: the altitude {mission.altitude} m became {read.altitude} m"
        )
        assert np.abs(read.waypoints - points).max() <= near, f"{name}: a waypoint moved"
        assert np.abs(np.subtract(read.home, mission.home)).max() <= near, f"{name}: home moved"
        for cut in rng.integers(len(text), size=6):
            try:
                chosen.scan(text[:cut], Sheet("damaged"))
            except Exception as error:
                raise AssertionError(
                    f"{name}: a damaged file raised {type(error).__name__}: {error}"
                ) from error


def check_rig(rig: Rig, *, exact: bool = True, moves: int = 40, seed: int = 0) -> None:
    """Check a rig: its attributes, its answers to commands, and that it stops.

    The check moves the particles of the rig, and stops it at the end. It does not know the map.

    Parameters
    ----------
    rig : Rig
    exact : bool
        Whether the rig sees every particle in its cell. If false, numbers and positions of
        particles may change from one observation to the next, and particles may appear in the rim,
        one cell outside the shape.
    moves : int
        Number of random commands.
    seed : int
    """
    assert isinstance(rig, Rig), f"expected the attributes and methods of Rig, got {rig!r}"
    name, shape, rule = rig.name, tuple(rig.shape), rig.rule
    assert isinstance(name, str), f"expected a text as name, got {name!r}"
    assert len(shape) in (2, 3), f"{name}: expected a shape of 2 or 3 sides, got {shape}"
    assert min(shape) >= 1, f"{name}: expected sides of one cell or more, got {shape}"
    assert rule in ALL_RULES, f"{name}: expected a rule of {', '.join(ALL_RULES)}, got {rule!r}"
    rng, letters = np.random.default_rng(seed), letters_of(len(shape))
    before = _observed(rig, exact)
    for command in rng.choice(list(letters), size=moves):
        if exact:
            again = _observed(rig, exact)
            assert np.array_equal(again, before), f"{name}: particles moved without a command"
        rig.send(str(command))
        after = _observed(rig, exact)
        if exact and rule != "merge":
            assert len(after) == len(before), f"{name}: {len(before)} particles became {len(after)}"
        if exact and rule == "block":
            moved = np.abs(after.sum(axis=0) - before.sum(axis=0)).sum()
            assert moved <= len(before), (
                f"{name}: {len(before)} particles travelled {moved} cells in one move"
            )
        before = after
    rig.stop()
    try:
        rig.send(letters[0])
    except RigError:
        return
    except Exception as error:
        raise AssertionError(
            f"{name}: expected RigError for a command after stop(), got {type(error).__name__}"
        ) from error
    raise AssertionError(f"{name}: expected RigError for a command after stop(), got none")


def _observed(rig: Rig, exact: bool) -> Any:
    """Return the observed cells in a fixed order, after checking that they are cells of the rig."""
    cells, rim = np.asarray(rig.observe()), 0 if exact else 1
    sides = len(rig.shape)
    assert cells.ndim == 2, f"{rig.name}: expected cells of shape (n, {sides}), got {cells.shape}"
    assert cells.shape[1] == sides, (
        f"{rig.name}: expected cells of shape (n, {sides}), got {cells.shape}"
    )
    assert cells.dtype.kind in "iu", f"{rig.name}: expected whole numbers, got {cells.dtype}"
    assert ((cells >= -rim) & (cells < np.add(rig.shape, rim))).all(), (
        f"{rig.name}: a particle is outside the shape {tuple(rig.shape)}"
    )
    return cells[np.lexsort(cells.T[::-1])]


def check_actuator(actuator: Actuator, *, seconds: float = 0.01) -> None:
    """Check an actuator: its attributes, its pushes, and that it stops.

    The check pushes the particles in eight directions, or carries out each command of
    ``actuator.pulses`` if it refuses these. It stops and closes the actuator at the end.

    Parameters
    ----------
    actuator : Actuator
    seconds : float
        Time of a push.
    """
    assert isinstance(actuator, Actuator), (
        f"expected the attributes and methods of Actuator, got {actuator!r}"
    )
    name = actuator.name
    assert isinstance(name, str), f"expected a text as name, got {name!r}"
    pulses = getattr(actuator, "pulses", None)
    if pulses is not None:
        try:
            check_pulses(pulses, name)
        except (InvalidInputError, TypeError, ValueError) as error:
            raise AssertionError(f"{name}: {error}") from error
    pushes = [(45.0 * turn, seconds) for turn in range(8)]
    try:
        for push in pushes:
            _push(actuator, *push)
    except InvalidInputError as error:  # whole commands only
        if pulses is None:
            raise AssertionError(f"{name}: refused a push, and has no pulses: {error}") from error
        pushes = list(pulses.values())
        for push in pushes:
            _push(actuator, *push)
    for push in ((float("nan"), seconds), (0.0, -1.0), (0.0, float("inf"))):
        _refuses(actuator, push, InvalidInputError, f"push{push}")
    actuator.stop()
    actuator.stop()
    _refuses(actuator, pushes[0], RigError, "a push after stop()")
    actuator.close()
    actuator.close()
    _refuses(actuator, pushes[0], RigError, "a push after close()")


def _push(actuator: Actuator, angle: float, seconds: float) -> None:
    returned: Any = actuator.push(angle, seconds)  # type: ignore[func-returns-value]
    assert returned is None, f"{actuator.name}: expected None from push(), got {returned!r}"


def _refuses(
    actuator: Actuator, push: tuple[float, float], kind: type[Exception], what: str
) -> None:
    try:
        actuator.push(*push)
    except kind:
        return
    except Exception as error:
        raise AssertionError(
            f"{actuator.name}: expected {kind.__name__} for {what}, got {type(error).__name__}"
        ) from error
    raise AssertionError(f"{actuator.name}: expected {kind.__name__} for {what}, got none")


def check_sensor(sensor: Sensor, *, frames: int = 20) -> None:
    """Check a sensor: its attributes and its frames. The check closes the sensor at the end.

    Parameters
    ----------
    sensor : Sensor
    frames : int
        Number of frames to look at.
    """
    assert isinstance(sensor, Sensor), (
        f"expected the attributes and methods of Sensor, got {sensor!r}"
    )
    name = sensor.name
    assert isinstance(name, str), f"expected a text as name, got {name!r}"
    before: Frame | None = None
    copied = np.zeros((0, 2))
    for _ in range(frames):
        frame = sensor.observe()
        _check_frame(frame, name)
        if before is not None:
            assert np.array_equal(before.points, copied), f"{name}: a frame changed afterwards"
            assert frame.number >= before.number, (
                f"{name}: picture {before.number} was followed by picture {frame.number}"
            )
            assert frame.points.shape[1] == before.points.shape[1], (
                f"{name}: points of {before.points.shape[1]} numbers became points of"
                f" {frame.points.shape[1]}"
            )
            if frame.number == before.number:
                assert np.array_equal(frame.points, before.points), (
                    f"{name}: picture {frame.number} came twice, with other points"
                )
            else:
                assert frame.time >= before.time, (
                    f"{name}: picture {frame.number} arrived before picture {before.number}"
                )
        before, copied = frame, frame.points.copy()
    sensor.close()
    sensor.close()


def _check_frame(frame: Any, name: str) -> None:
    assert isinstance(frame, Frame), f"{name}: expected a Frame, got {type(frame).__name__}"
    points = frame.points
    assert isinstance(points, np.ndarray), (
        f"{name}: expected an array of points, got {type(points).__name__}"
    )
    assert points.dtype == np.float64, f"{name}: expected points as float64, got {points.dtype}"
    assert points.ndim == 2, f"{name}: expected points of shape (n, 2), got {points.shape}"
    assert points.shape[1] in (2, 3), f"{name}: expected points of shape (n, 2), got {points.shape}"
    assert np.isfinite(points).all(), f"{name}: expected finite points, got {points.tolist()}"
    assert isinstance(frame.number, int), f"{name}: expected a whole number, got {frame.number!r}"
    assert isinstance(frame.time, float), f"{name}: expected a time in seconds, got {frame.time!r}"
    assert frame.time <= time.monotonic(), (
        f"{name}: a frame arrived {frame.time - time.monotonic():.3g} s from now: expected the"
        " monotonic clock of this computer"
    )


def check_vehicle(
    vehicle: RobotVehicle,
    cell: int,
    goal: Sequence[float],
    *,
    near: float = 0.5,
    clock: Callable[[], float] | None = None,
    most: float = 1000.0,
) -> None:
    """Check the vehicle of a search robot: it halts one cell before the end of a leg, goes on when
    it may, and then stays where it is.

    Parameters
    ----------
    vehicle : RobotVehicle
    cell : int
        A cell more than 1.5 cell sides from the vehicle.
    goal : sequence of float
        Centre of the cell in cell sides.
    near : float
        Largest distance in cell sides from a place at which a vehicle is there.
    clock : callable, optional
        Function that returns the time. By default, time passes from one `due` to the next at once.
    most : float
        Time within which each half of the leg must end.
    """
    name = type(vehicle).__name__
    aim = tuple(float(value) for value in goal)
    start = _checked_place(vehicle, len(aim))
    length = float(np.linalg.norm(np.subtract(aim, start)))
    assert length > 1.5, f"{name}: expected a goal more than 1.5 cell sides away, got {length:g}"
    now = 0.0 if clock is None else clock()
    assert vehicle.fault == "", f"{name}: expected no fault, got {vehicle.fault!r}"
    left = vehicle.left()
    assert left is None or 0 <= left <= 1, f"{name}: expected a left fraction or None, got {left!r}"
    assert vehicle.step(now) is False, f"{name}: expected False without a leg"
    vehicle.go(Leg(cell, aim, length, length), now)
    now = _drive(vehicle, now, clock, most, name, "halted one cell before the end of its leg")
    away = float(np.linalg.norm(np.subtract(aim, _checked_place(vehicle, len(aim)))))
    assert 1 - near <= away <= 1 + near, (
        f"{name}: expected a halt one cell before the goal, got {away:g} cell sides before it"
    )
    vehicle.enter()
    now = _drive(vehicle, now, clock, most, name, "reached the end of its leg")
    away = float(np.linalg.norm(np.subtract(aim, _checked_place(vehicle, len(aim)))))
    assert away <= near, f"{name}: expected the goal, got a place {away:g} cell sides from it"
    vehicle.stop(now)
    for _ in range(20):
        now = now + 0.1 if clock is None else max(now, clock())
        vehicle.step(now)
    moved = float(np.linalg.norm(np.subtract(aim, _checked_place(vehicle, len(aim)))))
    assert moved <= 2 * near, f"{name}: expected that it stays, got {moved:g} cell sides away"
    vehicle.secure()
    vehicle.secure()


def _checked_place(vehicle: RobotVehicle, ndim: int) -> tuple[float, ...]:
    place = vehicle.where()
    right = len(place) == ndim and bool(np.isfinite(place).all())
    assert right, f"{type(vehicle).__name__}: expected {ndim} finite coordinates, got {place!r}"
    return place


def _drive(
    vehicle: RobotVehicle,
    now: float,
    clock: Callable[[], float] | None,
    most: float,
    name: str,
    what: str,
) -> float:
    """Let a vehicle go on until it says that it is where it may go, and return the time then."""
    end = now + most
    while now < end:
        if vehicle.step(now):
            return now
        due = vehicle.due(now)
        assert due >= now or clock is not None, f"{name}: expected a time to come, got {due!r}"
        if clock is None:
            now = min(max(due, now + 0.01), now + 1.0)
        else:
            time.sleep(0.005)
            now = clock()
        assert vehicle.fault == "", f"{name}: expected no fault, got {vehicle.fault!r}"
    raise AssertionError(f"{name}: expected that it {what} within {most:g}")


def check_radio(one: Radio, other: Radio, *, tries: int = 50, seconds: float = 0.2) -> None:
    """Check two radios of search robots that hear each other. They may lose messages.

    Parameters
    ----------
    one, other : Radio
    tries : int
        Number of times that a message is sent until it must have come.
    seconds : float
        Time for which a message is waited for.
    """
    for way, (sender, receiver) in enumerate(((one, other), (other, one))):
        name = type(sender).__name__
        assert sender.most >= SHORTEST, (
            f"{name}: expected messages of {SHORTEST} bytes or more, got {sender.most}"
        )
        assert sender.rate > 0, f"{name}: expected a rate above 0, got {sender.rate!r}"
        assert sender.fault == "", f"{name}: expected no fault, got {sender.fault!r}"
        for size in (1, SHORTEST, min(sender.most, 1200)):
            message = bytes(range(256)) * 5
            message = message[way : way + size]  # late copies of the other way are no echo
            for _ in range(tries):
                refused = sender.broadcast(message)
                right = isinstance(refused, int) and refused >= 0
                assert right, (
                    f"{name}: expected the number of copies that were not sent, got {refused!r}"
                )
                if message in _messages_of(receiver, seconds):
                    break
            else:
                raise AssertionError(
                    f"{name}: expected that a message of {size} bytes comes unchanged within"
                    f" {tries} tries, got none"
                )
            echo = message in _messages_of(sender, 0.0)
            assert not echo, f"{name}: expected no message of its own, got one"
        _messages_of(receiver, 0.0)
        assert receiver.receive() is None, f"{name}: expected None without a message"


def _messages_of(radio: Radio, seconds: float) -> list[bytes]:
    """Return the messages that come to a radio, as soon as there are some."""
    select.select([radio], [], [], seconds)
    found: list[bytes] = []
    while (came := radio.receive()) is not None:
        right = isinstance(came, tuple) and len(came) == 2 and isinstance(came[0], bytes)
        assert right, (
            f"{type(radio).__name__}: expected a message and where it came from, got {came!r}"
        )
        found.append(came[0])
    return found


def check_search_sensor(
    sensor: SearchSensor, cells: Sequence[int], *, through: Sequence[int] = ()
) -> None:
    """Check the sensor of a search robot.

    Parameters
    ----------
    sensor : SearchSensor
    cells : sequence of int
        Two or more cells that are free of other robots.
    through : sequence of int
        The cells of a path from the first of ``cells``.
    """
    name = type(sensor).__name__
    for cell in cells:
        assert sensor.enter(cell) is True, f"{name}: expected that the free cell {cell} is free"
        assert sensor.enter(cell) is True, f"{name}: expected that a robot may stay in its own cell"
        finding = sensor.search(cell)
        assert isinstance(finding, CellFinding), f"{name}: expected a CellFinding, got {finding!r}"
        assert isinstance(finding.found, bool), (
            f"{name}: expected True or False, got {finding.found!r}"
        )
        assert cell not in finding.around, (
            f"{name}: expected other cells than {cell} in around, got {finding.around}"
        )
        assert {*finding.beside} <= {*finding.around}, (
            f"{name}: expected in beside cells of around {finding.around}, got {finding.beside}"
        )
        sensor.leave(cell)
    assert sensor.obstacle_on(cells[0], ()) == (None, 0), (
        f"{name}: expected no obstacle on a path without cells"
    )
    obstacle, free = sensor.obstacle_on(cells[0], tuple(through))
    assert 0 <= free <= len(through), f"{name}: expected 0 to {len(through)} cells, got {free}"
    assert (obstacle is None) == (free == len(through)), (
        f"{name}: expected an obstacle after the free cells of a path alone, got {obstacle} after"
        f" {free} of {len(through)}"
    )
