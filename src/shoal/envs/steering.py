"""SteeringEnv: a Gymnasium environment in which one continuous shared input steers two or more particles, one move per step."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import gymnasium
import numpy as np

from shoal.core.checks import shortened
from shoal.core.episode import Status
from shoal.core.version import versions
from shoal.envs.options import (
    SEEDS,
    OptionError,
    SteeringEnvOptions,
    check_no_options,
    check_render_mode,
    check_running,
    option_errors,
    split_fields,
)
from shoal.envs.rendering import MODES, close_window, rendered
from shoal.steering.episode import SteeringEpisode
from shoal.steering.problem import SteeringProblem, check_can_part
from shoal.steering.run import run
from shoal.steering.simulation.apparatus import Apparatus
from shoal.steering.workspaces.convex import TOUCH
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.region import Region

Observation = dict[str, Points]


class SteeringEnv(gymnasium.Env[Observation, Any]):
    """Particles in a workspace that one shared input brings to their goals.

    An action is a move, with one number from -1 to 1 per axis, where 1 means ``longest_move`` times the size of the workspace.
    After ``reset(seed=s)``, start, goal and noise are those of ``shoal.run(problem, seed=s)``. Later resets draw their seeds, which
    are in ``info["seed"]``. Observations are the camera's view as a dict of float64 arrays. ``particles`` and ``goals`` have shape
    (particles, dimensions). ``delta`` and ``goal_delta``, shape (particles - 1, dimensions), are the differences of all other
    particles from the first one, now and at the goals. Only walls can change these differences.

    Parameters
    ----------
    render_mode : str, optional
        "rgb_array", "ansi" or "human".
    **fields
        Fields of `SteeringProblem` and `SteeringEnvOptions`.

    Raises
    ------
    OptionError
        If an option is invalid. OptionError is a ValueError and a gymnasium.error.Error.

    Notes
    -----
    Source: paper W; docs/how-to/environments.md.

    Examples
    --------
    >>> env = SteeringEnv(start=[(0.2, 0.5), (0.4, 0.5)], goal=[(0.3, 0.5), (0.4, 0.5)])
    >>> observation, info = env.reset(seed=1)
    >>> observation["delta"].tolist(), round(info["error"], 3)
    ([[0.2, 0.0]], 0.1)
    >>> observation, reward, terminated, truncated, info = env.step([-0.3, 0.0])
    >>> observation["delta"].round(3).tolist(), terminated
    ([[0.1, 0.0]], False)
    """

    metadata: dict[str, Any] = {"render_modes": MODES, "render_fps": 10}  # noqa: RUF012 - as in its base

    def __init__(self, *, render_mode: str | None = None, **fields: Any) -> None:
        self.problem, self.options = split_fields(fields, SteeringProblem, SteeringEnvOptions)
        with option_errors():
            self.problem.check_at_place()
        self.render_mode = check_render_mode(render_mode, MODES)
        n, d = self.problem.n_particles, self.problem.place.dimensions
        low, high = self._bounds()
        seen = (np.full(d, -np.inf), np.full(d, np.inf)) if self.problem.measurement else (low, high)
        spaces: dict[str, gymnasium.Space[Any]] = {
            "particles": _box(seen[0], seen[1], n),
            "delta": _box(seen[0] - seen[1], seen[1] - seen[0], n - 1),
            "goals": _box(low, high, n),
            "goal_delta": _box(low - high, high - low, n - 1),
        }
        self.observation_space = gymnasium.spaces.Dict(spaces)  # type: ignore[assignment]  # arrays by name are its elements
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (d,), np.float64)
        self._apparatus: Apparatus | None = None
        self._running = False

    def _bounds(self) -> tuple[Points, Points]:
        """Return the smallest and the largest possible coordinates of a particle or a goal."""
        place = self.problem.place
        if place.round:
            low, high = place.center - place.radius, place.center + place.radius
        else:
            corners = place.outline if isinstance(place, Region) else place.vertices
            low, high = corners.min(axis=0), corners.max(axis=0)
        if place.dimensions == 3:
            caps = (-np.inf, np.inf) if place.open_ends else (0.0, place.height)
            low, high = np.append(low, caps[0]), np.append(high, caps[1])
        if self.problem.goal_x is not None:  # a goal may be outside
            goal = np.array([self.problem.goal_x, self.problem.goal_y])
            low[:2], high[:2] = np.minimum(low[:2], goal), np.maximum(high[:2], goal)
        room = TOUCH * place.size  # maximum distance outside of a particle on a wall
        return low - room, high + room

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, dict[str, Any]]:
        """Start an episode. ``options`` must be empty.

        Raises
        ------
        OptionError
        """
        super().reset(seed=seed)
        check_no_options(options)
        drawn = int(self.np_random.integers(SEEDS)) if seed is None else seed
        with option_errors():
            start, goal = self.problem.endpoints(drawn)
            check_can_part(start, goal, self.problem.tolerance)
            self._apparatus = Apparatus(self.problem, start, seed=drawn)
        orders = permutations(range(len(start))) if self.problem.interchangeable else [range(len(start))]
        self._goals = np.array([goal[list(order)] for order in orders])
        self._drawn, self._running = drawn, True
        self._trajectories: list[Any] = []  # number of moves that the window has shown
        return self._told()

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move the particles and observe.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before a reset, and after the end of an episode.
        gymnasium.error.InvalidAction
        """
        check_running(self._running)
        assert self._apparatus is not None
        d = self.problem.place.dimensions
        try:
            chosen = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError):
            chosen = np.zeros(0)
        if chosen.shape != (d,) or not (np.abs(chosen) <= 1).all():
            raise gymnasium.error.InvalidAction(f"action: expected {d} numbers from -1 to 1, got {shortened(action)}")
        before, options, size = self.error, self.options, float(self.problem.place.size)
        self._apparatus.send(chosen * options.longest_move * size)
        after, moves = self.error, len(self._apparatus.inputs)
        terminated = after <= self.problem.tolerance
        truncated = not terminated and moves >= self.problem.max_moves
        reward = options.progress_reward * (before - after) / size - options.move_price + options.final_bonus * terminated
        self._running = not (terminated or truncated)
        observation, info = self._told()
        return observation, reward, terminated, truncated, info

    @property
    def error(self) -> float:
        """Largest distance of a particle from its goal. For interchangeable goals, the best assignment counts."""
        assert self._apparatus is not None
        return float(np.linalg.norm(self._goals - self._apparatus.states[-1], axis=2).max(axis=1).min())

    def _told(self) -> tuple[Observation, dict[str, Any]]:
        """Return observation and info, and update the window."""
        assert self._apparatus is not None
        if self.render_mode == "human":
            self.render()
        seen, goals = self._apparatus.look(), self._goals[0].copy()
        observation = {"particles": seen, "delta": seen[1:] - seen[0], "goals": goals, "goal_delta": goals[1:] - goals[0]}
        return observation, {"error": self.error, "moves": len(self._apparatus.inputs), "seed": self._drawn}

    def expert_actions(self, planner: Any) -> list[Points]:
        """Return the actions of a planner's plan for the episode that has just begun.

        Raises
        ------
        OptionError
            If the planner cannot do the task, or a move is longer than an action can be.
        """
        check_running(self._running)
        with option_errors():
            episode = run(self.problem.replaced(planner=planner), seed=self._drawn)
        longest = self.options.longest_move * self.problem.place.size
        far = float(np.abs(episode.inputs).max(initial=0.0) / longest)
        if far > 1:
            raise OptionError(
                f"longest_move: expected {far * self.options.longest_move:.3g} for the moves of {episode.planner}, "
                f"got {self.options.longest_move:g}"
            )
        return list(episode.inputs / longest)

    def render(self) -> Any:
        """Return a picture (rgb_array), a text (ansi) or None (human, which shows a window).

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first reset.
        """
        check_running(self._apparatus is not None)
        return rendered(self, self._picture, self._text)

    def _text(self) -> str:
        assert self._apparatus is not None
        pairs = zip(self._apparatus.states[-1], self._goals[0], strict=True)
        rows = [
            f"particle {k}: {np.array2string(here, precision=4)} to {np.array2string(goal, precision=4)}"
            for k, (here, goal) in enumerate(pairs, start=1)
        ]
        return "\n".join([*rows, f"after {len(self._apparatus.inputs)} moves {self.error:.4g} from the goals"])

    def _picture(self) -> Any:
        from shoal.views.steering.films import HEIGHT, SteeringFilm
        from shoal.views.steering.trajectories import FilmMoment, trajectories_of

        assert self._apparatus is not None
        apparatus, known = self._apparatus, len(self._trajectories)
        self._trajectories += trajectories_of(self._episode(apparatus.states[known:], apparatus.inputs[known:]))
        film = SteeringFilm(self._episode(apparatus.states, apparatus.inputs), self._trajectories, height=HEIGHT[".gif"])
        return next(film.frames([FilmMoment(max(0, len(apparatus.inputs) - 1), 1.0)]))

    def _episode(self, states: list[Points], inputs: list[Points]) -> SteeringEpisode:
        """Return moves as an episode that views can draw."""
        problem = self.problem.replaced(start=states[0], goal=self._goals[0], execution=0.0, goal_x=None, goal_y=None)
        return SteeringEpisode(
            problem=problem, planner="steering", status=Status.INCOMPLETE if self.error > problem.tolerance else Status.SOLVED,
            inputs=np.array(inputs).reshape(-1, problem.place.dimensions), states=np.array(states), order=np.arange(len(states[0])),
            seed=self._drawn, lower_bound=None, seconds=0.0, versions=versions(),
        )  # fmt: skip

    def close(self) -> None:
        """Close the window if it exists."""
        close_window(self)


def _box(low: Points, high: Points, count: int) -> gymnasium.spaces.Box:
    """Return the space of ``count`` points."""
    return gymnasium.spaces.Box(np.tile(low, (count, 1)), np.tile(high, (count, 1)), dtype=np.float64)
