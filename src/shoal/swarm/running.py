"""run(): play a policy on a task in a world. Built-ins run whole in compiled code, all others step by step."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from shoal.errors import InvalidInputError
from shoal.swarm.episode import Episode
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.fields import board_of, field_of, state_of
from shoal.swarm.grid.placements import Placement, place
from shoal.swarm.grid.scans import MOVE_COST, SCAN_COST, ScanRule
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.tasks import Coverage, Mapping, Task, make_task
from shoal.swarm.grid.world import GridWorld, check_start
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.policies import Compiled, Manual, PlannerPolicy, Policy, make_policy
from shoal.swarm.policies.compiled import check_scanning
from shoal.swarm.stepwise import OnMoves, play_stepwise
from shoal.version import __version__

if TYPE_CHECKING:
    from shoal.swarm.noise.model import Noise

MAX_MOVES = 1_000_000


def trial_rng(seed: int, trial: int = 0) -> Generator:
    """Return the generator of one trial: it depends on nothing but (seed, trial)."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial,)))


def run(
    workspace: GridWorkspace,
    *,
    task: str | Task = "mapping",
    policy: str | Policy = "closest-frontier",
    particles: int | None = None,
    placement: str | Placement = "uniform",
    start: ArrayLike | None = None,
    rule: str = "block",
    seed: int = 0,
    trial: int = 0,
    max_moves: int = MAX_MOVES,
    scan_every: str | int = 1,
    scan_cost: float = SCAN_COST,
    move_cost: float = MOVE_COST,
    noise: Noise | None = None,
    confidence: float = 0.99,
    stepwise: bool = False,
    on_moves: OnMoves | None = None,
) -> Episode:
    """Play one episode.

    Parameters
    ----------
    workspace : GridWorkspace
    task : str or Task
        "mapping", "coverage", "subset-coverage", ...; see `shoal.swarm.grid.tasks.make_task`.
    policy : str or Policy
        "closest-frontier", ...; see `shoal.swarm.policies.make_policy`.
    particles : int, optional
        How many to place. Needed unless ``start`` is given.
    placement : str or callable
        See `shoal.swarm.grid.placements.place`.
    start : array_like of int, shape (n, ndim), optional
        Cells of the particles; then nothing is placed.
    rule : str
        "block", "merge" or "tilt".
    seed, trial : int
        Not negative. The same pair gives the same episode, whatever else runs.
    max_moves : int
        The episode ends as "limit" there.
    scan_every : str or int
        Equal commands before each scan: a number, "doubling", "hyper" or "adaptive"; see `shoal.swarm.grid.scans.ScanRule`.
    scan_cost, move_cost : float
        Prices, which an adaptive policy weighs.
    noise : Noise, optional
        Particles slip and are seen wrongly; then the episode is a `shoal.swarm.noise.NoisyEpisode`. Task mapping, rule block,
        ``scan_every`` a number: so many commands of a plan, or fewer where it ends, are sent before each scan.
    confidence : float
        With noise: the probability from which a cell counts as settled.
    stepwise : bool
        Play a built-in policy step by step, too, as third parties' are; the episode is the same.
    on_moves : callable, optional
        Told the progress.

    Returns
    -------
    Episode

    Raises
    ------
    InvalidInputError, UnknownNameError
        For arguments that do not fit.

    Examples
    --------
    >>> episode = run(GridWorkspace([[1, 1, 1, 1]]), particles=4)
    >>> episode.status, episode.commands
    ('complete', 'ludr')
    """
    world, chosen, todo = GridWorld(workspace, rule), make_policy(policy), make_task(task)
    if not isinstance(chosen, Policy):
        raise InvalidInputError(f"policy: expected an object with a name and a method decide, got {chosen!r}")
    check_numbers(seed=seed, trial=trial, max_moves=max_moves)
    scanning = ScanRule.parse(scan_every, scan_cost=scan_cost, move_cost=move_cost)
    if isinstance(chosen, Compiled):
        chosen.check(world.layout, rule)
    check_scanning(scanning, chosen, rule)
    rng = trial_rng(seed, trial)
    if start is not None:
        cells, placed = check_start(workspace, start, rule=rule), "given"
    elif particles is None:
        raise InvalidInputError("expected a number of particles or their start cells, got neither")
    elif isinstance(particles, bool) or not isinstance(particles, int | np.integer):
        raise InvalidInputError(f"particles: expected a whole number, got {particles!r}")
    else:
        cells = place(workspace, particles, placement, rng)
        placed = placement if isinstance(placement, str) else getattr(placement, "__name__", "custom")
    targets = todo.choose_targets(workspace, rng)
    blank = Episode(
        workspace, cells, np.zeros(0, np.int8), rule, todo.name, chosen.name, placed, targets, seed, trial, "limit", 0,
        np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0, np.int64), 0.0, __version__, scanning,
    )  # fmt: skip
    if noise is not None:
        from shoal.swarm.noise.running import check_noisy, play_noisy

        check_noisy(noise, confidence, rule=rule, task=todo, scanning=scanning)
        return play_noisy(blank, chosen, noise, confidence, rng, max_moves, stepwise=stepwise, on_moves=on_moves)
    state = world.initial(cells)
    belief = todo.begin(world, state, targets)
    blank = replace(blank, first_frontier=len(belief.frontier))
    compiled = isinstance(chosen, Compiled) and isinstance(todo, Mapping | Coverage) and not stepwise
    compiled &= (
        scanning.every_move or getattr(chosen, "kind", "") != "random-moves"
    )  # its commands are drawn beforehand, one a move
    player = play_compiled if compiled else play_stepwise
    if compiled:
        from shoal.swarm.engine import load_kernels

        load_kernels()  # so that it is not counted as time of this episode
        if isinstance(chosen, PlannerPolicy):
            from shoal.swarm import planning

            planning.load_kernels()
    began = time.perf_counter()
    episode, *_ = player(blank, world, chosen, todo, state, belief, rng, max_moves, on_moves)
    return replace(episode, seconds=time.perf_counter() - began)


def check_numbers(**numbers: Any) -> None:
    """Refuse what is no whole number, 0 or more."""
    for name, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
            raise InvalidInputError(f"{name}: expected a whole number, 0 or more, got {value!r}")


def play_compiled(
    blank: Episode,
    world: GridWorld,
    policy: Any,
    task: Any,
    state: SwarmState,
    belief: Belief,
    rng: Generator,
    max_moves: int,
    on_moves: OnMoves | None = None,
    *,
    given: NDArray[np.bool_] | None = None,
) -> tuple[Episode, SwarmState, Belief]:
    """Play a built-in policy in compiled code, in pieces of a fraction of a second; ``given`` are the scans of a replay."""
    from shoal.swarm import engine

    layout = world.layout
    field = field_of(world.free.words, state, belief)
    game = _game(world, policy, task, state, belief, rng, blank.scanning if given is None else None)
    largest = int(np.clip(2**25 // field.free.size, 64, 2**16))
    room, moves, status = min(2048, largest), 0, "limit"
    pieces: list[tuple[NDArray[Any], ...]] = []
    if belief.complete:
        max_moves, status = 0, "complete"
    while moves < max_moves:
        log = engine.new_log(min(room, max_moves - moves))
        if given is not None:
            log.scanned[:] = given[moves : moves + len(log.scanned)]
        played, ended = game.play_on(field, log)
        pieces.append(tuple(column[:played] for column in log))
        moves, room = moves + played, min(2 * room, largest)
        if on_moves is not None:
            on_moves(moves, game.remaining)
        if ended != engine.RUNNING:
            status = "complete" if ended == engine.COMPLETE else "stalled"
            break
    if status == "limit" and given is None and game.cut_within_run:
        pieces[-1][-1][-1] = True  # the run was cut short, and its end is looked at
        status = "limit" if game.remaining else "complete"
    final = Belief(*(board_of(layout, words) for words in (field.open, field.known, field.frontier)))
    after = state_of(layout, field)
    columns: list[NDArray[Any]] = (
        [np.concatenate(column) for column in zip(*pieces, strict=True)] if pieces else list(engine.new_log(0))
    )
    codes, done, frontier, travelled, scanned = columns
    return (
        replace(blank, codes=codes, done=done, frontier=frontier, travelled=travelled, scanned=scanned, status=status),
        after,
        final,
    )


def _game(
    world: GridWorld, policy: Any, task: Any, state: SwarmState, belief: Belief, rng: Generator, scanning: ScanRule | None
) -> Any:
    """Return what plays a built-in policy in pieces: `engine.Game` or `planning.Game`."""
    if isinstance(policy, PlannerPolicy):
        from shoal.swarm import planning

        return planning.Game(policy, state, belief, rule=world.rule, mapping=task.mapping, rng=rng)
    from shoal.swarm import engine

    mind = engine.mind_of(
        world.layout,
        world.workspace.n_free,
        belief,
        rule=world.rule,
        ties=getattr(policy, "ties", "column-major"),
        neighbours=getattr(policy, "neighbours", "lurd"),
        plan=getattr(policy, "commands", ""),
        scanning=scanning,
    )
    if not belief.complete:
        engine.choose_driven(policy.code, state, mind, rng)
    return engine.Game(policy.code, mind, engine.scout_of(world.layout, scanning), rule=world.rule, mapping=task.mapping, rng=rng)


def replay(episode: Episode) -> tuple[SwarmState, Belief, Episode]:
    """Play an episode's commands again; return the last state and belief, and the episode as replayed."""
    world, task = GridWorld(episode.workspace, episode.rule), make_task(episode.task)
    state = world.initial(episode.start)
    belief = task.begin(world, state, episode.targets)
    blank = replace(episode, first_frontier=len(belief.frontier))
    player = play_compiled if isinstance(task, Mapping | Coverage) else play_stepwise
    manual, rng = Manual(commands=episode.commands), trial_rng(0)
    again, state, belief = player(blank, world, manual, task, state, belief, rng, episode.moves, given=episode.scanned)
    return state, belief, again
