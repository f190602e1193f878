"""Options, observations and pictures that all environments share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar, TypeVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer, shortened, suggestion
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.core.problem import Problem, option
from shoal.swarm.batch import WorldBatch

P = TypeVar("P", bound=Problem)
O = TypeVar("O", bound="EnvOptions")  # noqa: E741 - an option

SEEDS = 2**31
"""Exclusive upper limit of random seeds for episodes."""

OBSERVATIONS = ("planes", "window", "compact")
CENTERS = ("particles", "frontier")


class OptionError(InvalidInputError, gymnasium.error.Error):
    """The error for an invalid option of an environment or of its method ``reset``.

    OptionError is a subclass of ValueError and of gymnasium.error.Error.
    """


@dataclass(frozen=True, eq=False)
class EnvOptions(Problem):
    """Base class for the options that an environment has in addition to the fields of
    its problem.
    """

    decided: ClassVar[tuple[str, ...]] = ()
    """Fields of the problem that the environment leaves out, because the user's actions take their
    place.
    """


def _check_maps(given: Any) -> tuple[str, ...]:
    if isinstance(given, str) or not all(isinstance(name, str) for name in given):
        raise InvalidInputError(f"maps: expected a list of names or paths, got {shortened(given)}")
    return tuple(given)


def _check_window(given: Any) -> int:
    side = check_integer(given, what="window", least=3)
    if side % 2 == 0:
        raise InvalidInputError(
            "window: expected an odd number of cells, so that one cell is in the middle, got"
            f" {side}"
        )
    return side


@dataclass(frozen=True, eq=False)
class SwarmEnvOptions(EnvOptions):
    """Additional fields of the swarm environments, for observations and rewards."""

    part: ClassVar[str] = "swarm-environment"
    decided: ClassVar[tuple[str, ...]] = ("policy", "budget", "time_per_move")

    maps: tuple[str, ...] = option(
        (),
        help=(
            "List of maps, in place of MAP. Each episode draws one map of the list at random. All"
            " observations have the size of the largest map."
        ),
        metavar="MAP ...",
        check=_check_maps,
        dump=list,
    )
    observation: str = option(
        "planes",
        help=(
            "Kind of observation: planes (all cells), window (the cells around one place) or"
            " compact (a vector of numbers)."
        ),
        choices=OBSERVATIONS,
    )
    window: int = option(
        33,
        help="Side of the square that the observation window shows.",
        unit="cells",
        least=3,
        check=_check_window,
    )
    center: str = option(
        "particles",
        help=(
            "Centre of the observation window: the mean position of the particles, or the frontier"
            " cell nearest to a particle."
        ),
        choices=CENTERS,
    )
    classified_reward: float = option(
        1.0,
        help="Reward for each cell that becomes known; in coverage, for each newly visited cell.",
    )
    move_price: float = option(1.0, help="Penalty for each command, subtracted from the reward.")
    final_bonus: float = option(100.0, help="Reward at the completion of the task.")


@dataclass(frozen=True, eq=False)
class SteeringEnvOptions(EnvOptions):
    """Additional fields of the steering environments, for inputs and rewards."""

    part: ClassVar[str] = "steering-environment"
    decided: ClassVar[tuple[str, ...]] = ("planner", "time")

    longest_move: float = option(
        1.0,
        help="Length of the move for an action of 1, divided by the size of the workspace.",
        above=0,
    )
    progress_reward: float = option(
        1.0,
        help=(
            "Reward for a progress of 1. The progress of a move is the decrease of the largest"
            " distance between a particle and its goal, divided by the size of the workspace."
        ),
    )
    move_price: float = option(0.01, help="Penalty for each move, subtracted from the reward.")
    final_bonus: float = option(1.0, help="Reward when all particles are at their goals.")


@dataclass(frozen=True, eq=False)
class SearchEnvOptions(EnvOptions):
    """Additional fields of the search environment, for actions, rewards and the maximum number of
    steps.
    """

    part: ClassVar[str] = "search-environment"
    decided: ClassVar[tuple[str, ...]] = ("allocation", "simulate", "live")

    action: str = option(
        "direction",
        help="Kind of action: direction (move one cell, or stay) or cell (move to any cell).",
        choices=("direction", "cell"),
    )
    reward: str = option(
        "shared",
        help="Reward of each agent: shared (the mean of the rewards of all agents) or own.",
        choices=("shared", "own"),
    )
    searched_reward: float = option(
        1.0, help="Reward for each cell that no robot had searched before."
    )
    step_price: float = option(
        0.1, help="Penalty for each step, subtracted from an agent's reward."
    )
    final_bonus: float = option(
        10.0, help="Reward of each active agent when all cells are searched."
    )
    max_steps: int = option(
        10_000,
        help=(
            "Maximum number of steps of an episode. A step takes the time in which the fastest"
            " robot searches one cell."
        ),
        least=1,
    )


ENVIRONMENTS: tuple[type[EnvOptions], ...] = (SwarmEnvOptions, SteeringEnvOptions, SearchEnvOptions)


def split_fields(fields: Mapping[str, Any], problem: type[P], options: type[O]) -> tuple[P, O]:
    """Return the problem and the environment options that the keyword arguments of an environment
    describe.

    Raises
    ------
    OptionError
        If a field is unknown or invalid.
    """
    offered = [name for name in problem.declarations() if name not in options.decided] + list(
        options.declarations()
    )
    for name, value in fields.items():
        if name in options.decided:
            raise OptionError(
                f"{name}: expected no such option, because the actions replace it, got"
                f" {shortened(value)}"
            )
        if name not in offered:
            raise OptionError(
                f"{name}: expected no such option, got"
                f" {shortened(value)}{suggestion(name, offered)}"
            )
    own = options.declarations()
    with option_errors():
        made = options(**{name: value for name, value in fields.items() if name in own})
        return problem(**{name: value for name, value in fields.items() if name not in own}), made


@contextmanager
def option_errors() -> Iterator[None]:
    """Convert all errors of Shoal inside the ``with`` block to `OptionError`."""
    try:
        yield
    except ShoalError as error:
        raise OptionError(str(error)) from None


def check_no_options(options: Mapping[str, Any] | None, known: tuple[str, ...] = ()) -> None:
    """Raise OptionError for an unknown option of the method ``reset`` of an environment."""
    for name in options or {}:
        if name not in known:
            offered = f"one of {', '.join(known)}" if known else "no option"
            raise OptionError(f"reset: options: expected {offered}, got {shortened(name)}")


def check_render_mode(render_mode: str | None, known: list[str]) -> str | None:
    """Return the given render mode. An unknown render mode raises UnsupportedMode, as
    in Gymnasium.
    """
    if render_mode is not None and render_mode not in known:
        raise gymnasium.error.UnsupportedMode(
            f"render_mode: expected one of {', '.join(known)}, got {shortened(render_mode)}"
        )
    return render_mode


def check_running(running: bool) -> None:
    """Raise ResetNeeded if ``running`` is false, that is, before the first reset or after the end
    of an episode.
    """
    if not running:
        raise gymnasium.error.ResetNeeded(
            "step: expected a reset first, because no episode is running, got an action"
        )


PLANES = ("particles", "free", "obstacles", "frontier")
"""Planes of an observation: particles per cell; known free cells; known obstacles; frontier cells.

In mapping, frontier cells are unknown cells beside known free cells. In coverage, frontier cells
are cells not yet visited.
"""

PARTICLES, FREE, OBSTACLES, FRONTIER = range(4)


def observation_space(
    window: tuple[int, ...], options: SwarmEnvOptions, *, rule: str
) -> gymnasium.spaces.Box:
    """Return the observation space of one simulated world.

    The parameter ``window`` is the shape of the map with a rim of one cell on each side. If the
    option ``observation`` is "planes", each plane of an observation has the shape ``window``.
    """
    if options.observation == "compact":
        count = 3 * 2 * len(window) + 3 + 3 * len(window)
        return gymnasium.spaces.Box(-1.0, 1.0, (count,), np.float32)
    shape = window if options.observation == "planes" else (options.window,) * len(window)
    return gymnasium.spaces.Box(0, 255 if rule == "merge" else 1, (len(PLANES), *shape), np.uint8)


def observed(
    batch: WorldBatch,
    options: SwarmEnvOptions,
    where: NDArray[np.bool_] | None = None,
    out: Any = None,
) -> NDArray[Any]:
    """Return the observation of each world, in the form that the option ``observation`` selects.

    If the form is "planes" and the array ``out`` is given, the function writes the observations
    into ``out``.
    """
    if options.observation == "planes":
        return batch.planes(PLANES, where=where, out=out)
    if options.observation == "compact":
        return compact_of(batch, where)
    if options.center == "particles":
        centers = np.rint(batch.measures(where=where).middle).astype(np.int64)
    else:
        centers = batch.nearest_frontier(where=where)[2]
    return batch.windows(PLANES, centers, options.window, where=where)


def compact_of(batch: WorldBatch, where: NDArray[np.bool_] | None = None) -> NDArray[np.float32]:
    """Return the compact observation of each world: for a map with ndim dimensions, 9 ndim + 3
    numbers from -1 to 1.

    Returns
    -------
    ndarray of float32, shape (worlds, 9 ndim + 3)
        The values of a world form nine groups. Group 1 holds, for each command, the fraction of
        particles that would enter a frontier cell. Group 2 holds, for each command, the fraction of
        particles whose next cell is neither a known obstacle nor occupied. Group 3 holds 1 for the
        command that begins the shortest path to the frontier, and 0 for all other commands. Group 4
        is 1 divided by the length of the shortest path to the frontier, in cells. Without a path to
        the frontier, groups 3 to 5 are 0. Group 5 is the vector from the particles' mean position
        to the frontier cell at the end of the shortest path. Group 6 is the particles' mean
        position, and group 7 is the standard deviation of their positions along each axis. Groups 5
        to 7 are divided by the size of the map with its rim. Group 8 is the number of frontier
        cells divided by the number of known or frontier cells. Group 9 is the used fraction of the
        maximum number of moves.
    """
    sums, (lengths, commands, ends) = (
        batch.measures(where=where),
        batch.nearest_frontier(where=where),
    )
    size, count = (
        np.array(batch.layout.window, dtype=np.float64),
        np.maximum(sums.particles, 1)[:, None],
    )
    first = (np.arange(sums.probing.shape[1]) == commands[:, None]) & (lengths[:, None] > 0)
    moves = batch.moves if where is None else batch.moves[where]
    limits = np.maximum(1, batch.limits if where is None else batch.limits[where])
    parts = [
        sums.probing / count,
        sums.moving / count,
        first,
        np.where(lengths > 0, 1 / np.maximum(lengths, 1), 0)[:, None],
        np.where(lengths[:, None] > 0, (ends - sums.middle) / size, 0),
        sums.middle / size,
        sums.spread / size,
        (sums.frontier / np.maximum(sums.known, 1))[:, None],
        np.minimum(1.0, moves / limits)[:, None],
    ]
    return np.concatenate(parts, axis=1, dtype=np.float32).clip(-1, 1)


def rewards_of(
    classified: NDArray[Any], moves: NDArray[Any], done: NDArray[np.bool_], options: SwarmEnvOptions
) -> NDArray[np.float64]:
    """Return the reward of each world for one step.

    The reward is the number of newly classified cells times ``classified_reward``, minus
    ``move_price`` for each sent command. In the step that completes the task, the reward increases
    by ``final_bonus``.
    """
    return np.asarray(
        options.classified_reward * classified
        - options.move_price * moves
        + options.final_bonus * done
    )


Picture = NDArray[np.uint8]

MODES = ["rgb_array", "ansi", "human"]
SIDE = 480
"""Approximate length in pixels of a picture's larger side."""


def rendered(env: Any, picture: Callable[[], Picture], text: Callable[[], str]) -> Any:
    """Return the result of ``env.render()`` for the render mode of the environment.

    In the render mode "human", the function shows the picture in a window and returns None.

    Raises
    ------
    gymnasium.error.UnsupportedMode
        If the environment has no render mode.
    """
    if env.render_mode == "rgb_array":
        return picture()
    if env.render_mode == "ansi":
        return text()
    if env.render_mode is None:
        raise gymnasium.error.UnsupportedMode(
            f"render: expected a render_mode, one of {', '.join(MODES)}, got an environment without"
            " a render_mode"
        )
    if getattr(env, "_live_window", None) is None:
        from shoal.views.drawing.encoding import LiveWindow

        env._live_window = LiveWindow(type(env).__name__)
    env._live_window.show(picture(), pause=1 / env.metadata["render_fps"])
    return None


def close_window(env: Any) -> None:
    """Close the window of an environment if the environment has opened one."""
    if getattr(env, "_live_window", None) is not None:
        env._live_window.close()
        env._live_window = None


def enlarged(raster: Picture) -> Picture:
    """Enlarge a picture with one pixel per cell by a whole factor, so that its longer side has
    about `SIDE` pixels.
    """
    times = max(1, SIDE // max(raster.shape[:2]))
    return raster.repeat(times, axis=0).repeat(times, axis=1)
