"""SwarmWorlds: a batch of simulated swarm worlds with observations, rewards and infos.

The environments `SwarmEnv` and `SwarmVectorEnv` use the class SwarmWorlds.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.envs import observations
from shoal.envs.options import OptionError, SwarmEnvOptions, check_no_options, option_errors, split_fields
from shoal.envs.rendering import SIDE, enlarged
from shoal.swarm.batch import WorldBatch
from shoal.swarm.grid.trace import Trace
from shoal.swarm.maps.raster import raster_of
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
                    "scan_every: expected a number, doubling or hyper, because actions cannot choose when to scan, got adaptive"
                )
            problems = [self.problem.replaced(map=name) for name in self.options.maps] or [self.problem]
            self.batch = WorldBatch(problems, count, seed=None)
        self.observation_space = observations.observation_space(self.batch.layout.window, self.options, rule=self.problem.rule)
        self.action_space = gymnasium.spaces.Discrete(2 * self.batch.layout.ndim)
        self.scanning = self.problem.scanning
        self._streaks, self._last = np.zeros(count, dtype=np.int64), np.full(count, -1)

    def reset(self, where: NDArray[np.bool_] | None = None, *, seed: Any = None, options: dict[str, Any] | None = None) -> None:
        """Start episodes as `WorldBatch.reset` does.

        The option ``map`` selects the map of each world, by one index for all worlds or by one index for each world.
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

    def step(self, actions: Any, where: NDArray[np.bool_] | None = None) -> tuple[NDArray[np.float64], Trace]:
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
        return observations.rewards_of(trace.classified, batch.moves - before, done, self.options), trace

    def _check_actions(self, given: NDArray[Any], where: NDArray[np.bool_] | None) -> None:
        count, last = len(self.batch), int(self.action_space.n) - 1
        if given.dtype.kind not in "iu" or given.shape != (count,):
            raise gymnasium.error.InvalidAction(
                f"actions: expected {count} whole numbers from 0 to {last}, one per environment, got {given.dtype} {given.shape}"
            )
        bad = np.logical_or(given < 0, given > last) & (True if where is None else where)
        if bad.any():
            raise gymnasium.error.InvalidAction(f"actions: expected whole numbers from 0 to {last}, got {given[np.argmax(bad)]}")

    def observed(self, where: NDArray[np.bool_] | None = None, out: Any = None) -> NDArray[Any]:
        """Return the observation of each world."""
        return observations.observed(self.batch, self.options, where, out)

    def info(self, where: NDArray[np.bool_] | None = None) -> dict[str, NDArray[Any]]:
        """Return the info of each world: action mask, number of moves, number of frontier cells, seed and map."""
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

        The picture of a three-dimensional map shows the map from a corner, with three slices of the map.
        """
        from shoal.views.swarm.volume import CORNER, Fit, Slices, sheet

        codes = self._codes(world)
        if codes.ndim == 2:
            return enlarged(raster_of(codes))
        place = self.batch.problems[int(self.batch.maps[world])].place
        return sheet(codes, Slices.of(place), azimuth=CORNER, side=SIDE, spacing=place.spacing, fit=Fit.of(place))

    def characters(self, world: int) -> str:
        """Return the known cells as text, one character per cell: o particle, . free, # obstacle, ? frontier, blank unknown."""
        codes = self._codes(world)
        layers = np.array(list(" ?.#o"))[codes.reshape(-1, *codes.shape[-2:])]
        return "\n\n".join("\n".join("".join(row) for row in layer) for layer in layers)

    def _codes(self, world: int) -> NDArray[np.uint8]:
        from shoal.views.swarm.cell_colours import codes_of

        return codes_of(self.batch.state(world), self.batch.belief(world))
