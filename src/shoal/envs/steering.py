"""Environments in which one shared input steers two or more particles: `SteeringEnv` with one
simulated world, `SteeringVectorEnv` with many. Each step is one move.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from shoal.core.checks import shortened
from shoal.core.episode import Status
from shoal.core.version import versions
from shoal.envs.forms import observation_form
from shoal.envs.options import (
    OptionError,
    SteeringEnvOptions,
    check_no_options,
    check_running,
    option_errors,
    split_fields,
)
from shoal.envs.worlds import WorldEnv, Worlds, WorldsVectorEnv
from shoal.steering.episode import SteeringEpisode
from shoal.steering.problem import SteeringProblem
from shoal.steering.run import run
from shoal.steering.simulation import SteeringBatch
from shoal.steering.workspaces.convex import TOUCH, Points

Observation = dict[str, NDArray[np.float32]]


class SteeringWorlds(Worlds):
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
        If a field is unknown or invalid.
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
        self.form = observation_form(self.options.observation, gymnasium.spaces.Dict(spaces))
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (d,), np.float32)
        self._pictured = np.full(count, pictured)
        # of the whole episodes, where there are pictures
        self._states: list[list[Points]] = [[] for _ in range(count)]
        self._inputs: list[list[Points]] = [[] for _ in range(count)]
        # of the moves that a picture has shown
        self._trajectories: list[list[Any]] = [[] for _ in range(count)]

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
        moves = self._checked(actions, where)
        before, moved = batch.errors.copy(), slice(None) if where is None else where
        inputs = moves * options.longest_move * size
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
            moves = np.asarray(actions, dtype=np.float64)
        except (TypeError, ValueError):
            moves = np.zeros(0)
        if (
            moves.shape != shape
            or not (np.abs(moves[slice(None) if where is None else where]) <= 1).all()
        ):
            raise gymnasium.error.InvalidAction(
                f"actions: expected {shape[1]} numbers from -1 to 1 per environment, of shape"
                f" {shape}, got {shortened(actions)}"
            )
        return moves

    def seen(self, where: NDArray[np.bool_] | None = None, out: Any = None) -> Observation:
        """Return the observations by name, as new arrays with one row for each world; the argument
        ``out`` has no effect.
        """
        chosen = slice(None) if where is None else where
        seen, goals = self.batch.seen[chosen], self.batch.goals[chosen, 0]
        arrays = {
            "particles": seen,
            "delta": seen[:, 1:] - seen[:, :1],
            "goals": goals,
            "goal_delta": goals[:, 1:] - goals[:, :1],
        }
        return {name: array.astype(np.float32) for name, array in arrays.items()}

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
    # Rounding keeps the order of numbers, so rounded points are within rounded bounds.
    least, most = (np.tile(bound, (count, 1)).astype(np.float32) for bound in (low, high))
    return gymnasium.spaces.Box(least, most, dtype=np.float32)


class SteeringEnv(WorldEnv, gymnasium.Env[Any, Any]):
    """An environment for steering: one shared input must bring all particles of a workspace to
    their goals.

    An action is a move, with one number from -1 to 1 for each axis. The number 1 is a displacement
    of ``longest_move`` times the size of the workspace. After ``reset(seed=s)``, the starts, goals
    and noise equal those of ``shoal.run(problem, seed=s)``. A later reset without a seed draws a
    new seed, and returns the new seed in ``info["seed"]``. An observation is the view of the
    camera, as a dict of float32 arrays; the simulation computes with float64. The arrays ``particles`` and ``goals`` have the shape
    (particles, dimensions). The array ``delta``, shape (particles - 1, dimensions), holds the
    positions of particles 2, 3, ... relative to particle 1. The array ``goal_delta`` holds the
    positions of goals 2, 3, ... relative to goal 1. If the gain is uniform, only wall contacts
    change the true relative positions of the particles.

    Parameters
    ----------
    render_mode : str, optional
        Render mode of the environment: "rgb_array" (pictures), "ansi" (texts) or "human" (a
        window).
    **fields
        Fields of the classes `SteeringProblem` and `SteeringEnvOptions`.

    Raises
    ------
    OptionError
        If an option is invalid. OptionError is a subclass of ValueError and of
        gymnasium.error.Error.

    Notes
    -----
    Source: paper W; docs/how-to/environments.md.

    Examples
    --------
    >>> env = SteeringEnv(start=[(0.2, 0.5), (0.4, 0.5)], goal=[(0.3, 0.5), (0.4, 0.5)])
    >>> observation, info = env.reset(seed=1)
    >>> observation["delta"], round(info["error"], 3)
    (array([[0.2, 0. ]], dtype=float32), 0.1)
    >>> observation, reward, terminated, truncated, info = env.step([-0.3, 0.0])
    >>> observation["delta"].round(3), terminated
    (array([[0.1, 0. ]], dtype=float32), False)
    """

    worlds = SteeringWorlds
    problem: SteeringProblem
    options: SteeringEnvOptions

    def expert_actions(self, planner: Any) -> list[NDArray[np.float32]]:
        """Return the actions with which a planner solves the present episode from its start.

        The actions are the moves of the planner, rounded to float32.

        Raises
        ------
        OptionError
            If the planner does not support the task, or if a move of the plan is longer than the
            longest possible action.
        """
        check_running(self._running)
        with option_errors():
            episode = run(
                self.problem.replaced(planner=planner), seed=int(self._worlds.batch.seeds[0])
            )
        longest = self.options.longest_move * self.problem.place.size
        far = float(np.abs(episode.inputs).max(initial=0.0) / longest)
        if far > 1:
            raise OptionError(
                f"longest_move: expected {far * self.options.longest_move:.3g} or more for the"
                f" moves of the planner {episode.planner}, got {self.options.longest_move:g}"
            )
        return list((episode.inputs / longest).astype(np.float32))


class SteeringVectorEnv(WorldsVectorEnv, VectorEnv[Any, Any, Any]):
    """A vector of environments, each of which behaves exactly like a `shoal.envs.SteeringEnv` with
    the same seed.

    The function `gymnasium.make_vec` returns a SteeringVectorEnv.

    Parameters
    ----------
    num_envs : int
    autoreset_mode, render_mode : str, optional
        Autoreset mode and render mode, as in `SwarmVectorEnv`.
    copy : bool
        The parameter has no effect, because observations of steering are always separate arrays.
    **fields
        Fields of the classes `SteeringProblem` and `SteeringEnvOptions`.

    Raises
    ------
    OptionError
        If an option is invalid. OptionError is a subclass of ValueError and of
        gymnasium.error.Error.

    Notes
    -----
    See docs/how-to/environments.md.

    Examples
    --------
    >>> envs = gymnasium.make_vec("shoal.envs:shoal/Steering-v0", num_envs=3, workspace="disk")
    >>> observations, infos = envs.reset(seed=1)
    >>> observations["delta"].shape, infos["seed"].tolist()
    ((3, 1, 2), [1, 2, 3])
    >>> rewards = envs.step(np.zeros((3, 2)))[1]
    """

    worlds = SteeringWorlds
