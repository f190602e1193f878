"""Simulation of steering: one apparatus with noise, and many worlds at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.core.random import world_generators
from shoal.steering.contact.world import RegionWorld, generators, stop_at_others
from shoal.steering.kernels import contact, region_contact
from shoal.steering.problem import SteeringProblem, check_can_part
from shoal.steering.workspaces.convex import EXACT_TOUCH, TOUCH, Points


class Apparatus:
    """The interface between a closed-loop planner and the simulated world: send a move, and observe
    the particles.

    Attributes
    ----------
    problem : SteeringProblem
        The problem of the run, in which a planner may read the standard deviation of the noise.
    states : list of ndarray of float64, shape (n, d)
        True positions of the n particles at the start and after each move.
    inputs : list of ndarray of float64, shape (d,)
        The moves that the planner has sent, before the simulation adds noise.
    remark : str
        A remark of the planner about the run, which becomes a part of the episode's reason.
    """

    def __init__(self, problem: SteeringProblem, start: Points, *, seed: int) -> None:
        self.problem, self.remark = problem, ""
        self._world = problem.world(seed=seed)
        _, self._execution, self._camera, _ = generators(seed)
        self.states = [self._world.initial(start)]
        self.inputs: list[Points] = []

    def restart(self) -> None:
        """Discard all moves so far, and put the particles back at their starts."""
        del self.states[1:], self.inputs[:]

    def with_noise(self, noise: float, *, seed: int = 0) -> Apparatus:
        """Return a new apparatus with the same start positions, and with input noise of the
        standard deviation ``noise``.
        """
        return Apparatus(self.problem.replaced(execution=noise), self.states[0], seed=seed)

    def look(self) -> Points:
        """Return the positions of the particles that the noisy camera observes."""
        noise, state = self.problem.measurement, self.states[-1]
        return np.asarray(
            state + self._camera.normal(scale=noise, size=state.shape) if noise else state.copy()
        )

    def send(self, move: Points) -> None:
        """Move the particles by the input ``move`` plus noise."""
        self.inputs.append(np.asarray(move, dtype=np.float64))
        noise = self.problem.execution
        executed = (
            self.inputs[-1] + self._execution.normal(scale=noise, size=len(move))
            if noise
            else self.inputs[-1]
        )
        self.states.append(self._world.step(self.states[-1], executed))


def executed_moves(problem: SteeringProblem, inputs: Points, *, seed: int) -> Points:
    """Return the executed moves, which are the inputs plus random noise; float64, shape
    (moves, d).
    """
    if not problem.execution:
        return inputs
    return np.asarray(
        inputs + generators(seed)[1].normal(scale=problem.execution, size=inputs.shape)
    )


def replay(problem: SteeringProblem, inputs: Points, *, seed: int) -> Points:
    """Return the positions of the particles during a replay of ``inputs``; float64, shape (moves +
    1, n, d).
    """
    start, _ = problem.endpoints(seed)
    return np.asarray(
        problem.world(seed=seed).play(start, executed_moves(problem, inputs, seed=seed))
    )


def condition(problem: SteeringProblem, inputs: Points, *, seed: int) -> float:
    """Return the amplification of errors: the largest ratio of a final position error to the small
    error that causes it.

    The function displaces the start of each particle along each axis by 1e-12 of the workspace's
    size, in both directions, and simulates the moves after each displacement. It also simulates the
    moves with a contact tolerance of 1e-12 of the workspace's size instead of 1e-9. The
    amplification of errors is large if a small change of the start causes a wall to release a
    particle.
    """
    world, moves = problem.world(seed=seed), executed_moves(problem, inputs, seed=seed)
    start, _ = problem.endpoints(seed)
    end = world.play(start, moves)[-1]
    exact = replace(world, touch=EXACT_TOUCH).play(start, moves)[-1]
    step = EXACT_TOUCH * problem.place.size
    worst = float(np.linalg.norm(exact - end, axis=1).max()) / (TOUCH * problem.place.size)
    for particle, axis in np.ndindex(start.shape):
        for side in (-step, step):
            displaced = start.copy()
            displaced[particle, axis] += side
            if problem.place.contains(displaced).all():
                worst = max(
                    worst,
                    float(np.linalg.norm(world.play(displaced, moves)[-1] - end, axis=1).max())
                    / step,
                )
    return float(worst)


SEEDS = 2**31
"""Exclusive upper limit of the seeds that are drawn for episodes without a given seed."""


class SteeringBatch:
    """Many simulated worlds of one steering problem, each with its own start, goal, noise and
    moves.

    Parameters
    ----------
    problem : SteeringProblem
    worlds : int
        Number of simulated worlds.

    Attributes
    ----------
    states, seen : ndarray of float64, shape (worlds, particles, dimensions)
        ``states``: the true positions of the particles. ``seen``: the positions that the noisy
        camera observes.
    goals : ndarray of float64, shape (worlds, orders, particles, dimensions)
        The goals of the particles. If goals are interchangeable, the array holds the goals in every
        order.
    errors : ndarray of float64, shape (worlds,)
        For each world, the largest distance of a particle from its goal, with the best order of the
        goals.
    moves, seeds : ndarray of int64, shape (worlds,)
        ``moves``: for each world, the number of moves in the current episode. ``seeds``: the seed
        of the current episode.
    terminated, truncated : ndarray of bool, shape (worlds,)
        ``terminated``: all particles of the world are within the tolerance of their goals.
        ``truncated``: the world has made the maximum number of moves, but not all of its particles
        are at their goals.

    Notes
    -----
    A world behaves exactly like a `shoal.steering.simulation.Apparatus` with the same seed.

    Examples
    --------
    >>> batch = SteeringBatch(SteeringProblem(start=[(0.2, 0.5), (0.4, 0.5)], goal=[(0.3, 0.5), (0.4, 0.5)]), 2)
    >>> batch.reset(seed=1)
    >>> batch.send(np.array([[-0.3, 0.0], [0.0, 0.1]]))
    >>> batch.states[:, 0].round(3).tolist()
    [[0.0, 0.5], [0.2, 0.6]]
    """

    def __init__(self, problem: SteeringProblem, worlds: int) -> None:
        self.problem, self._world = problem, problem.world()
        n, d = problem.n_particles, problem.place.dimensions
        orders = permutations(range(n)) if problem.interchangeable else [range(n)]
        self._orders = np.array([list(order) for order in orders])
        self.states, self.seen = np.zeros((worlds, n, d)), np.zeros((worlds, n, d))
        self.goals = np.zeros((worlds, len(self._orders), n, d))
        self.errors, self.moves, self.seeds = (
            np.zeros(worlds),
            np.zeros(worlds, np.int64),
            np.zeros(worlds, np.int64),
        )
        self.terminated, self.truncated = np.zeros(worlds, np.bool_), np.zeros(worlds, np.bool_)
        self._gains, self._shares = np.zeros((worlds, d + 1)), np.ones((worlds, n))
        self._all, self._spare = np.arange(worlds), np.zeros(d)
        self._noises: list[Any] = [None] * worlds  # generators of execution and camera
        self._rngs: list[Generator] = []

    def __len__(self) -> int:
        return len(self._all)

    def _chosen(self, where: NDArray[np.bool_] | None) -> NDArray[np.int64]:
        return self._all if where is None else where.nonzero()[0]

    def reset(
        self,
        where: NDArray[np.bool_] | None = None,
        *,
        seed: int | Sequence[int | None] | None = None,
    ) -> None:
        """Begin a new episode in all worlds, or in the worlds that ``where`` selects.

        Parameters
        ----------
        where : ndarray of bool, shape (worlds,), optional
            Mask of the worlds to reset; by default, all worlds.
        seed : int, or sequence of int or None, one per world, optional
            Seeds of the new episodes. From one integer ``seed``, world i gets the seed ``seed +
            i``. Without a seed, each world draws the seed of its next episode from its own random
            generator.

        Raises
        ------
        InvalidInputError
            If a seed or the start of a new episode is invalid. After an error, all worlds are
            unchanged.
        """
        chosen, problem = self._chosen(where), self.problem
        rngs = world_generators(seed, chosen, len(self), self._rngs)
        seeds = [own if own is not None else int(rng.integers(SEEDS)) for own, rng in rngs]
        ends = [problem.endpoints(own) for own in seeds]
        for start, goal in ends:
            check_can_part(start, goal, problem.tolerance)
            self._world.initial(start)
        if not self._rngs:
            self._rngs = [rng for _, rng in rngs]
        for world, own, (start, goal), (_, rng) in zip(
            chosen.tolist(), seeds, ends, rngs, strict=True
        ):
            self._rngs[world], self.seeds[world] = rng, own
            self.states[world], self.goals[world] = start, goal[self._orders]
            self._noises[world] = (
                generators(own)[1:3] if problem.execution or problem.measurement else None
            )
            if not isinstance(self._world, RegionWorld):
                self._gains[world] = (
                    problem.world(seed=own).gain if problem.gain else self._world.gain
                )
        self.moves[chosen] = 0
        self.terminated[chosen] = self.truncated[chosen] = False
        self._look(chosen)

    def send(self, moves: Points, where: NDArray[np.bool_] | None = None) -> None:
        """Move the particles of the selected worlds, and observe the particles.

        The array ``moves`` has the shape (worlds, dimensions), with a row for every world, also for
        worlds that are not selected.
        """
        chosen, problem = self._chosen(where), self.problem
        executed = np.array(moves, dtype=np.float64, order="C")
        if problem.execution:
            for world in chosen.tolist():
                executed[world] += self._noises[world][0].normal(
                    scale=problem.execution, size=executed.shape[1]
                )
        before = self.states.copy() if problem.particle_radius else self.states
        if isinstance(self._world, RegionWorld):
            region_contact.advance_worlds(self.states, executed, chosen, self._world.edges)
        else:
            contact.advance_worlds(
                self.states,
                executed,
                chosen,
                self._gains,
                self._world.walls,
                self._shares,
                self._spare,
            )
        if problem.particle_radius:
            for world in chosen.tolist():
                apart = 2 * problem.particle_radius
                stop_at_others(
                    before[world], executed[world], self._shares[world], apart, self.states[world]
                )
        self.moves[chosen] += 1
        self._look(chosen)
        self.terminated[chosen] = self.errors[chosen] <= problem.tolerance
        self.truncated[chosen] = ~self.terminated[chosen] & (
            self.moves[chosen] >= problem.max_moves
        )

    def _look(self, chosen: NDArray[np.int64]) -> None:
        states = self.states[chosen]
        self.errors[chosen] = (
            np.linalg.norm(self.goals[chosen] - states[:, None], axis=3).max(axis=2).min(axis=1)
        )
        self.seen[chosen] = states
        if self.problem.measurement:
            for world in chosen.tolist():
                self.seen[world] += self._noises[world][1].normal(
                    scale=self.problem.measurement, size=states.shape[1:]
                )
