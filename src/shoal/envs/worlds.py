"""Worlds behind the environments: one swarm or one steering problem, stepped by actions."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import shortened
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError
from shoal.core.version import versions
from shoal.envs import options as observations
from shoal.envs.options import (
    SIDE,
    OptionError,
    SteeringEnvOptions,
    SwarmEnvOptions,
    check_no_options,
    enlarged,
    option_errors,
    split_fields,
)
from shoal.steering.episode import SteeringEpisode
from shoal.steering.problem import SteeringProblem
from shoal.steering.simulation import SteeringBatch
from shoal.steering.workspaces.convex import TOUCH, Points
from shoal.swarm.batch import WorldBatch
from shoal.swarm.grid.scans import Trace
from shoal.swarm.maps.workspace import raster_of
from shoal.swarm.problem import SwarmProblem


class SwarmWorlds:
    """The simulated swarm worlds of an environment.

    Parameters
    ----------
    count : int
        Number of simulated worlds.
    **fields
        Fields of the classes `SwarmProblem` and `SwarmEnvOptions`.

    Raises
    ------
    OptionError
    """

    def __init__(self, count: int, *, pictured: bool = False, **fields: Any) -> None:
        if "map" not in fields and fields.get("maps"):
            fields = {"map": fields["maps"][0], **fields}
        if "map" not in fields:
            raise OptionError("map: expected the option map or the option maps, got neither")
        self.problem, self.options = split_fields(fields, SwarmProblem, SwarmEnvOptions)
        with option_errors():
            if self.problem.scan_every == "adaptive":
                raise InvalidInputError(
                    "scan_every: expected a number, doubling or hyper, because actions cannot"
                    " choose when to scan, got adaptive"
                )
            problems = [self.problem.replaced(map=name) for name in self.options.maps] or [
                self.problem
            ]
            self.batch = WorldBatch(problems, count, seed=None)
        self.observation_space = observations.observation_space(
            self.batch.layout.window, self.options, rule=self.problem.rule
        )
        self.action_space = gymnasium.spaces.Discrete(2 * self.batch.layout.ndim)
        self.scanning = self.problem.scanning
        self._streaks, self._last = np.zeros(count, dtype=np.int64), np.full(count, -1)

    def reset(
        self,
        where: NDArray[np.bool_] | None = None,
        *,
        seed: Any = None,
        options: dict[str, Any] | None = None,
    ) -> None:
        """Start episodes as `WorldBatch.reset` does.

        The option ``map`` selects the map of each world, by one index for all worlds or by one
        index for each world.
        """
        check_no_options(options or {}, ("map",))
        maps = (options or {}).get("map")
        try:
            with option_errors():
                self.batch.reset(where, seed=seed, maps=maps)
        except OptionError as error:
            raise OptionError(f"reset: {error}") from None
        self._streaks[slice(None) if where is None else where] = 0
        self._last[slice(None) if where is None else where] = -1

    def step(
        self, actions: Any, where: NDArray[np.bool_] | None = None
    ) -> tuple[NDArray[np.float64], Trace]:
        """Send to each world the command of its action, once or several times before the next scan.

        The method returns the reward of each world, and a trace with the effect of each command.
        """
        batch, given = self.batch, np.asarray(actions)
        chosen: Any = slice(None) if where is None else where
        self._check_actions(given, where)
        self._streaks[chosen] = np.where(given == self._last, self._streaks + 1, 0)[chosen]
        self._last[chosen] = given[chosen]
        repeat: Any = 1
        if not self.scanning.every_move:
            repeat = np.array([self.scanning.interval(streak) for streak in self._streaks.tolist()])
        before = batch.moves.copy()
        trace = batch.step(given, repeat=repeat, where=where)
        done = batch.complete & trace.scanned
        return (
            observations.rewards_of(trace.classified, batch.moves - before, done, self.options),
            trace,
        )

    def _check_actions(self, given: NDArray[Any], where: NDArray[np.bool_] | None) -> None:
        count, last = len(self.batch), int(self.action_space.n) - 1
        if given.dtype.kind not in "iu" or given.shape != (count,):
            raise gymnasium.error.InvalidAction(
                f"actions: expected {count} whole numbers from 0 to {last}, one per environment,"
                f" got {given.dtype} {given.shape}"
            )
        bad = np.logical_or(given < 0, given > last) & (True if where is None else where)
        if bad.any():
            raise gymnasium.error.InvalidAction(
                f"actions: expected whole numbers from 0 to {last}, got {given[np.argmax(bad)]}"
            )

    def observed(self, where: NDArray[np.bool_] | None = None, out: Any = None) -> NDArray[Any]:
        """Return the observation of each world."""
        return observations.observed(self.batch, self.options, where, out)

    def info(self, where: NDArray[np.bool_] | None = None) -> dict[str, NDArray[Any]]:
        """Return the info of each world: action mask, number of moves, number of frontier cells,
        seed and map.
        """
        batch, chosen = self.batch, slice(None) if where is None else where
        columns: dict[str, NDArray[Any]] = {
            "moves": batch.moves,
            "frontier": batch.frontier,
            "seed": batch.seeds,
            "map": batch.maps,
        }
        told = {name: column[chosen].astype(np.int64) for name, column in columns.items()}
        return {"action_mask": batch.action_masks(where=where), **told}

    def picture(self, world: int) -> NDArray[np.uint8]:
        """Return a picture of a world as a uint8 array of shape (height, width, 3).

        The picture of a three-dimensional map shows the map from a corner, with three slices of the
        map.
        """
        from shoal.views.swarm.volume import CORNER, Fit, Slices, sheet

        codes = self._codes(world)
        if codes.ndim == 2:
            return enlarged(raster_of(codes))
        place = self.batch.problems[int(self.batch.maps[world])].place
        return sheet(
            codes,
            Slices.of(place),
            azimuth=CORNER,
            side=SIDE,
            spacing=place.spacing,
            fit=Fit.of(place),
        )

    def characters(self, world: int) -> str:
        """Return the known cells as text, one character per cell: o particle, . free, # obstacle, ?
        frontier, blank unknown.
        """
        codes = self._codes(world)
        layers = np.array(list(" ?.#o"))[codes.reshape(-1, *codes.shape[-2:])]
        return "\n\n".join("\n".join("".join(row) for row in layer) for layer in layers)

    def _codes(self, world: int) -> NDArray[np.uint8]:
        from shoal.views.swarm.volume import codes_of

        return codes_of(self.batch.state(world), self.batch.belief(world))


Observation = dict[str, Points]


class SteeringWorlds:
    """The simulated steering worlds of an environment.

    Parameters
    ----------
    count : int
        Number of simulated worlds.
    pictured : bool
        Whether the environment needs pictures of the worlds. Pictures show whole episodes, so a
        world with pictures stores its episode.
    **fields
        Fields of the classes `SteeringProblem` and `SteeringEnvOptions`.

    Raises
    ------
    OptionError
    """

    def __init__(self, count: int, *, pictured: bool = False, **fields: Any) -> None:
        self.problem, self.options = split_fields(fields, SteeringProblem, SteeringEnvOptions)
        with option_errors():
            self.problem.check_at_place()
            self.batch = SteeringBatch(self.problem, count)
        n, d = self.problem.n_particles, self.problem.place.dimensions
        low, high = self._bounds()
        seen = (
            (np.full(d, -np.inf), np.full(d, np.inf)) if self.problem.measurement else (low, high)
        )
        spaces: dict[str, gymnasium.Space[Any]] = {
            "particles": _box(seen[0], seen[1], n),
            "delta": _box(seen[0] - seen[1], seen[1] - seen[0], n - 1),
            "goals": _box(low, high, n),
            "goal_delta": _box(low - high, high - low, n - 1),
        }
        self.observation_space = gymnasium.spaces.Dict(spaces)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (d,), np.float64)
        self._pictured = np.full(count, pictured)
        self._states: list[list[Points]] = [
            [] for _ in range(count)
        ]  # of the whole episodes, where there are pictures
        self._inputs: list[list[Points]] = [[] for _ in range(count)]
        self._trajectories: list[list[Any]] = [
            [] for _ in range(count)
        ]  # of the moves that a picture has shown

    def _bounds(self) -> tuple[Points, Points]:
        """Return the smallest and the largest possible coordinates of particles and goals."""
        place = self.problem.place
        low, high = place.bounds
        if place.dimensions == 3:
            caps = (-np.inf, np.inf) if place.open_ends else (0.0, place.height)
            low, high = np.append(low, caps[0]), np.append(high, caps[1])
        if self.problem.goal_x is not None:  # a goal may be outside
            goal = np.array([self.problem.goal_x, self.problem.goal_y])
            low[:2], high[:2] = np.minimum(low[:2], goal), np.maximum(high[:2], goal)
        room = TOUCH * place.size  # maximum distance outside of a particle on a wall
        return low - room, high + room

    def reset(
        self,
        where: NDArray[np.bool_] | None = None,
        *,
        seed: Any = None,
        options: dict[str, Any] | None = None,
    ) -> None:
        """Start episodes as `SteeringBatch.reset` does. Steering worlds have no reset options."""
        check_no_options(options)
        with option_errors():
            self.batch.reset(where, seed=seed)
        for world in self._shown(where):
            self._states[world], self._inputs[world], self._trajectories[world] = (
                [self.batch.states[world].copy()],
                [],
                [],
            )

    def _shown(self, where: NDArray[np.bool_] | None) -> list[int]:
        """Return the indices of the selected worlds that appear in pictures."""
        shown: list[int] = np.flatnonzero(
            self._pictured & (True if where is None else where)
        ).tolist()
        return shown

    def step(
        self, actions: Any, where: NDArray[np.bool_] | None = None
    ) -> tuple[NDArray[np.float64], None]:
        """Send an action to each world, and return the rewards and None (in place of the trace that
        `SwarmWorlds.step` returns).
        """
        batch, options, size = self.batch, self.options, float(self.problem.place.size)
        given = self._checked(actions, where)
        before, moved = batch.errors.copy(), slice(None) if where is None else where
        inputs = given * options.longest_move * size
        batch.send(inputs, where)
        for world in self._shown(where):
            self._states[world].append(batch.states[world].copy())
            self._inputs[world].append(inputs[world])
        rewards = np.zeros(len(batch))
        gained = options.progress_reward * (before - batch.errors) / size - options.move_price
        rewards[moved] = (gained + options.final_bonus * batch.terminated)[moved]
        return rewards, None

    def _checked(self, actions: Any, where: NDArray[np.bool_] | None) -> Points:
        shape = (len(self.batch), self.problem.place.dimensions)
        try:
            given = np.asarray(actions, dtype=np.float64)
        except (TypeError, ValueError):
            given = np.zeros(0)
        if given.shape != shape:
            raise gymnasium.error.InvalidAction(
                f"actions: expected numbers from -1 to 1 of shape {shape}, one row per environment,"
                f" got {shortened(actions)}"
            )
        bad = ~(np.abs(given) <= 1).all(axis=1) & (True if where is None else where)
        if bad.any():
            raise gymnasium.error.InvalidAction(
                f"actions: expected {shape[1]} numbers from -1 to 1 per environment, "
                f"got {shortened(given[np.argmax(bad)].tolist())}"
            )
        return given

    def observed(self, where: NDArray[np.bool_] | None = None, out: Any = None) -> Observation:
        """Return the observations by name, as new arrays with one row for each world; the argument
        ``out`` has no effect.
        """
        chosen = slice(None) if where is None else where
        seen, goals = self.batch.seen[chosen].copy(), self.batch.goals[chosen, 0].copy()
        return {
            "particles": seen,
            "delta": seen[:, 1:] - seen[:, :1],
            "goals": goals,
            "goal_delta": goals[:, 1:] - goals[:, :1],
        }

    def info(self, where: NDArray[np.bool_] | None = None) -> dict[str, NDArray[Any]]:
        """Return the largest distance of a particle from its goal (``error``), the number of moves
        and the seed for each world.
        """
        batch, chosen = self.batch, slice(None) if where is None else where
        return {
            "error": batch.errors[chosen].copy(),
            "moves": batch.moves[chosen].copy(),
            "seed": batch.seeds[chosen].copy(),
        }

    def characters(self, world: int) -> str:
        """Return the positions and the goals of all particles in a world as text."""
        batch = self.batch
        pairs = zip(batch.states[world], batch.goals[world, 0], strict=True)
        rows = [
            f"particle {k}: {np.array2string(here, precision=4)} to"
            f" {np.array2string(goal, precision=4)}"
            for k, (here, goal) in enumerate(pairs, start=1)
        ]
        return "\n".join(
            [*rows, f"after {batch.moves[world]} moves {batch.errors[world]:.4g} from the goals"]
        )

    def picture(self, world: int) -> NDArray[np.uint8]:
        """Return a picture of all moves so far in the episode of a world; uint8, shape (height,
        width, 3).
        """
        from shoal.views.steering.films import HEIGHT, SteeringFilm
        from shoal.views.steering.trajectories import FilmMoment, trajectories_of

        states, inputs, known = self._states[world], self._inputs[world], self._trajectories[world]
        known += trajectories_of(self._episode(world, states[len(known) :], inputs[len(known) :]))
        film = SteeringFilm(self._episode(world, states, inputs), known, height=HEIGHT[".gif"])
        return next(film.frames([FilmMoment(max(0, len(inputs) - 1), 1.0)]))

    def _episode(self, world: int, states: list[Points], inputs: list[Points]) -> SteeringEpisode:
        """Return the moves in a world as an episode that the package ``views`` can draw."""
        batch = self.batch
        problem = self.problem.replaced(
            start=states[0], goal=batch.goals[world, 0], execution=0.0, goal_x=None, goal_y=None
        )
        status = Status.INCOMPLETE if batch.errors[world] > problem.tolerance else Status.SOLVED
        return SteeringEpisode(
            problem=problem,
            planner="steering",
            status=status,
            inputs=np.array(inputs).reshape(-1, problem.place.dimensions),
            states=np.array(states),
            order=np.arange(len(states[0])),
            seed=int(batch.seeds[world]),
            lower_bound=None,
            seconds=0.0,
            versions=versions(),
        )


def _box(low: Points, high: Points, count: int) -> gymnasium.spaces.Box:
    """Return the observation space of ``count`` points between the coordinates ``low`` and
    ``high``.
    """
    return gymnasium.spaces.Box(
        np.tile(low, (count, 1)), np.tile(high, (count, 1)), dtype=np.float64
    )
