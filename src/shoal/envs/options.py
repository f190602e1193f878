"""Options of the environments, and the checks that all environments share."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar, TypeVar

import gymnasium

from shoal.core.checks import check_integer, shortened, suggestion
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.core.problem import Problem, option

P = TypeVar("P", bound=Problem)
O = TypeVar("O", bound="EnvOptions")  # noqa: E741 - an option

SEEDS = 2**31
"""Exclusive upper limit of random seeds for episodes."""

FORMS = ("image", "flat")
"""Forms in which every learning program accepts observations (see `shoal.envs.forms`)."""

OBSERVATIONS = ("planes", "window", "compact", *FORMS)
CENTERS = ("particles", "frontier")
WIDEST = 2**12 - 1  # cells along the side of an observation window, whose planes then take 64 MiB


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
    """Fields of the problem that the environment leaves out, because they have no effect on steps that
    the user chooses.
    """


def _check_maps(given: Any) -> tuple[str, ...]:
    if not isinstance(given, list | tuple) or not all(isinstance(name, str) for name in given):
        raise InvalidInputError(f"maps: expected a list of names or paths, got {shortened(given)}")
    return tuple(given)


def _check_window(given: Any) -> int:
    side = check_integer(given, what="window", least=3, most=WIDEST)
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
    decided: ClassVar[tuple[str, ...]] = (
        "policy",
        "budget",
        "time_per_move",
        "scan_cost",
        "move_cost",
        "move_seconds",
        "scan_seconds",
    )

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
            "Kind of observation: planes (all cells), window (the cells around one place), compact"
            " (a vector of numbers), image (planes with values from 0 to 255) or flat (planes as"
            " one axis of float32)."
        ),
        choices=OBSERVATIONS,
    )
    window: int = option(
        33,
        help="Side of the square that the observation window shows.",
        unit="cells",
        least=3,
        most=WIDEST,
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

    def check_together(self) -> None:
        """Raise an error if the observation leaves an option without effect."""
        for name in ("window", "center"):
            if name in self.given and self.observation != "window":
                raise InvalidInputError(
                    f"{name}: expected the observation window together with it, got"
                    f" {self.observation}"
                )


@dataclass(frozen=True, eq=False)
class SteeringEnvOptions(EnvOptions):
    """Additional fields of the steering environments, for inputs and rewards."""

    part: ClassVar[str] = "steering-environment"
    decided: ClassVar[tuple[str, ...]] = (
        "planner",
        "time",
        "friction_at_least",
        "angle_error",
        "gain_error",
        "clearance",
    )

    observation: str = option(
        "dict",
        help="Kind of observation: dict (arrays by name) or flat (one axis of float32).",
        choices=("dict", "flat"),
    )
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
    decided: ClassVar[tuple[str, ...]] = (
        "allocation",
        "at_most",
        "order",
        "simulate",
        "live",
    )

    observation: str = option(
        "dict",
        help=(
            "Kind of observation: dict (arrays by name), image (the planes, with values from 0 to"
            " 255) or flat (one axis of float32)."
        ),
        choices=("dict", *FORMS),
    )
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
    found_reward: float = option(
        0.0,
        help="With targets: reward of the robot that is the first to find one (search_v0 only).",
    )
    step_price: float = option(
        0.1, help="Penalty for each step, subtracted from an agent's reward."
    )
    final_bonus: float = option(
        10.0, help="Reward of each active agent when all cells are searched, or all targets found."
    )
    until: str = option(
        "searched",
        help=(
            "When episodes terminate: when all cells are searched, or when all targets are found"
            " (search_v0 only)."
        ),
        choices=("searched", "found"),
    )
    target_moves: float = option(
        0.0,
        help=(
            "With targets: probability that a target, until it is found, moves to a random one of"
            " the four cells beside it in a step (search_v0 only)."
        ),
        least=0,
        most=1,
    )
    max_cycles: int = option(
        10_000,
        help=(
            "Maximum number of steps of an episode. A step takes the time in which the fastest"
            " robot searches one cell."
        ),
        least=1,
    )


TARGETS = ("found_reward", "until", "target_moves")
"""Options of searches with targets."""


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
                f"{name}: expected no such option, because it has no effect on chosen actions, got"
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


def check_running(running: bool) -> None:
    """Raise ResetNeeded if ``running`` is false, that is, before the first reset or after the end
    of an episode.
    """
    if not running:
        raise gymnasium.error.ResetNeeded(
            "step: expected a reset first, because no episode is running, got an action"
        )
