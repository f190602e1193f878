"""Environments for mapping and coverage by a swarm: `SwarmEnv` with one simulated world,
`SwarmVectorEnv` with many.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from shoal.core.checks import count_text, shortened
from shoal.core.errors import InvalidInputError
from shoal.envs.forms import observation_form
from shoal.envs.options import (
    OptionError,
    SwarmEnvOptions,
    check_no_options,
    check_running,
    option_errors,
    split_fields,
)
from shoal.envs.rendering import SIDE, enlarged
from shoal.envs.worlds import WorldEnv, Worlds, WorldsVectorEnv
from shoal.swarm.batch import WorldBatch
from shoal.swarm.grid.board import LETTERS
from shoal.swarm.grid.scans import Trace
from shoal.swarm.maps.workspace import raster_of
from shoal.swarm.policies.protocol import View
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.run import run

PLANES = ("particles", "free", "obstacles", "frontier")
"""Planes of an observation: particles per cell; known free cells; known obstacles; frontier cells.

In mapping, frontier cells are unknown cells beside known free cells. In coverage, frontier cells
are cells not yet visited.
"""

PARTICLES, FREE, OBSTACLES, FRONTIER = range(4)
BEYOND = (0, 0, 1, 0)
"""Value of each plane in cells beyond the map, which count as obstacles."""


class SwarmWorlds(Worlds):
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
        If a field is unknown or invalid, or if ``map`` and ``maps`` are both missing.
    """

    action_space: gymnasium.spaces.Discrete

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
        window = self.batch.layout.window
        self.form = observation_form(
            self.options.observation,
            observation_space(window, self.options, rule=self.problem.rule),
            dimensions=len(window),
            beyond=BEYOND,
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
        batch, commands = self.batch, self._check_actions(actions, where)
        chosen: Any = slice(None) if where is None else where
        self._streaks[chosen] = np.where(commands == self._last, self._streaks + 1, 0)[chosen]
        self._last[chosen] = commands[chosen]
        repeat: Any = 1
        if not self.scanning.every_move:
            repeat = np.array([self.scanning.interval(streak) for streak in self._streaks.tolist()])
        options, before = self.options, batch.moves.copy()
        trace = batch.step(commands, repeat=repeat, where=where)
        done = batch.complete & trace.scanned
        rewards = (
            options.classified_reward * trace.classified
            - options.move_price * (batch.moves - before)
            + options.final_bonus * done
        )
        return np.asarray(rewards), trace

    def _check_actions(self, actions: Any, where: NDArray[np.bool_] | None) -> NDArray[Any]:
        count, last = len(self.batch), int(self.action_space.n) - 1
        commands = np.asarray(actions)
        whole = commands.dtype.kind in "iu" and commands.shape == (count,)
        if (
            not whole
            or ((commands < 0) | (commands > last))[slice(None) if where is None else where].any()
        ):
            raise gymnasium.error.InvalidAction(
                f"actions: expected {count_text(count, 'whole number')} from 0 to {last}, one per"
                f" environment, got {shortened(actions)}"
            )
        return commands

    def seen(self, where: NDArray[np.bool_] | None = None, out: Any = None) -> NDArray[Any]:
        """Return the observation of each world before it gets its form."""
        return observed(self.batch, self.options, where, out)

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
        infos = {name: column[chosen].astype(np.int64) for name, column in columns.items()}
        return {"action_mask": batch.action_masks(where=where), **infos}

    def action_masks(self) -> NDArray[np.bool_]:
        """Return whether each command can have an effect in each world."""
        return np.asarray(self.batch.action_masks(), dtype=np.bool_)

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
        from shoal.views.swarm.colours import codes_of

        return codes_of(self.batch.state(world), self.batch.belief(world))


class SwarmEnv(WorldEnv, gymnasium.Env[Any, Any]):
    """An environment for exploration: commands to a swarm must map or cover a workspace.

    An action is one command to all particles, as an index from 0 into the text ``lurd`` (in three
    dimensions ``lurdio``).

    After ``reset(seed=s)``, the particles, targets and noise equal those of ``shoal.run(problem,
    seed=s)``. A later reset without a seed draws a new seed, and returns the new seed in
    ``info["seed"]``. If ``scan_every`` is above 1, an action sends its command several times before
    a scan follows.

    Parameters
    ----------
    render_mode : str, optional
        Render mode of the environment: "rgb_array" (pictures), "ansi" (texts) or "human" (a
        window).
    **fields
        Fields of the classes `SwarmProblem` and `SwarmEnvOptions`.

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
    >>> env = SwarmEnv(map="line:9", particles=3, observation="compact")
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape, info["action_mask"].tolist(), info["frontier"]
    ((21,), [1, 1, 1, 1], 11)
    """

    worlds = SwarmWorlds
    _worlds: SwarmWorlds
    problem: SwarmProblem
    options: SwarmEnvOptions

    def action_masks(self) -> NDArray[np.bool_]:
        """Return whether each command can have an effect, as ``info["action_mask"]`` does; bool,
        shape (commands,).
        """
        return np.asarray(self._worlds.action_masks()[0])

    @property
    def planes(self) -> NDArray[np.uint8]:
        """The known states of all cells, as uint8 planes of shape (4, ...) in the order of
        `shoal.envs.swarm.PLANES`.
        """
        return np.asarray(self._worlds.batch.planes()[0])

    @property
    def view(self) -> View:
        """The present view of the swarm, in the form that a policy of `shoal.swarm` receives."""
        batch, rule = self._worlds.batch, self.problem.rule
        mapping = self.problem.setup.mapping
        last = (
            (0, 0)
            if self._effects is None
            else (int(self._effects.travelled[0]), int(self._effects.classified[0]))
        )
        return View(
            batch.belief(0), batch.state(0).occupied, rule, mapping, int(batch.moves[0]), *last
        )

    def expert_actions(self, policy: Any) -> list[int]:
        """Return the actions with which a policy solves the present episode from its start.

        Parameters
        ----------
        policy : str or Policy

        Raises
        ------
        OptionError
            If the policy does not support the task, or if ``scan_every`` is not 1, because a policy
            itself chooses when to scan.
        """
        check_running(self._running)
        with option_errors():
            if not self.problem.scanning.every_move:
                raise InvalidInputError(
                    "scan_every: expected 1, because a policy chooses when to scan, got"
                    f" {self.problem.scanning.every}"
                )
            batch = self._worlds.batch
            problem = batch.problems[int(batch.maps[0])].replaced(policy=policy)
            return [
                LETTERS.index(letter) for letter in run(problem, seed=int(batch.seeds[0])).commands
            ]


class SwarmVectorEnv(WorldsVectorEnv, VectorEnv[Any, Any, Any]):
    """A vector of environments, each of which behaves exactly like a `shoal.envs.SwarmEnv` with the
    same seed.

    The function `gymnasium.make_vec` returns a SwarmVectorEnv.

    Parameters
    ----------
    num_envs : int
    autoreset_mode : str or gymnasium.vector.AutoresetMode
        The rule that determines when an environment starts its next episode after the end of an
        episode: "NextStep", "SameStep", or "Disabled". In the mode "Disabled", a call of ``reset``
        with the option ``reset_mask`` starts the next episode, as in Gymnasium's own vector
        environments.
    copy : bool
        Whether each observation is a separate array. If ``copy`` is false and the option
        ``observation`` is "planes", each step overwrites the array of the previous observation.
        Other observations are always separate arrays.
    render_mode : str, optional
        Render mode of the environments: "rgb_array" (pictures) or "ansi" (texts).
    **fields
        Fields of the classes `SwarmProblem` and `SwarmEnvOptions`.

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
    >>> envs = gymnasium.make_vec("shoal.envs:shoal/Mapping-v0", num_envs=3, map="line:9", particles=4)
    >>> observations, infos = envs.reset(seed=1)
    >>> observations.shape, infos["seed"].tolist()
    ((3, 4, 3, 11), [1, 2, 3])
    >>> rewards = envs.step([0, 1, 2])[1]
    """

    worlds = SwarmWorlds
    _worlds: SwarmWorlds

    def action_masks(self) -> NDArray[np.bool_]:
        """Return whether each command can have an effect; bool, shape (num_envs, commands)."""
        return np.asarray(self._worlds.action_masks())


def observation_space(
    window: tuple[int, ...], options: SwarmEnvOptions, *, rule: str
) -> gymnasium.spaces.Box:
    """Return the observation space of one simulated world.

    The parameter ``window`` is the shape of the map with a rim of one cell on each side. Unless the
    option ``observation`` is "window", each plane of an observation has this shape. Images and
    vectors are made of planes (`shoal.envs.forms`).
    """
    if options.observation == "compact":
        count = 3 * 2 * len(window) + 3 + 3 * len(window)
        return gymnasium.spaces.Box(-1.0, 1.0, (count,), np.float32)
    shape = (options.window,) * len(window) if options.observation == "window" else window
    high = np.ones((len(PLANES), *shape), dtype=np.uint8)
    if rule == "merge":
        high[PARTICLES] = 255
    return gymnasium.spaces.Box(np.zeros_like(high), high, dtype=np.uint8)


def observed(
    batch: WorldBatch,
    options: SwarmEnvOptions,
    where: NDArray[np.bool_] | None = None,
    out: Any = None,
) -> NDArray[Any]:
    """Return what the option ``observation`` shows of each world: a window, the compact numbers, or
    planes.

    Planes are written into the array ``out`` if it is given.
    """
    if options.observation == "compact":
        return compact_of(batch, where)
    if options.observation != "window":
        return batch.planes(PLANES, where=where, out=out)
    if options.center == "particles":
        sums = batch.measures(where=where, commands=False)
        centers = np.rint(sums.middle).astype(np.int64)
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
