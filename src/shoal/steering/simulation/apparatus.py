"""The simulated apparatus: a noisy input, a noisy camera, and the resulting positions of the particles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from shoal.steering.contact.disturbances import generators
from shoal.steering.problem import SteeringProblem
from shoal.steering.workspaces.base import EXACT_TOUCH, TOUCH
from shoal.steering.workspaces.convex_geometry import Points


class Apparatus:
    """The interface between a closed-loop planner and the simulated world: send a move, and observe the particles.

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
        """Return a new apparatus with the same start positions, and with input noise of the standard deviation ``noise``."""
        return Apparatus(self.problem.replaced(execution=noise), self.states[0], seed=seed)

    def look(self) -> Points:
        """Return the positions of the particles that the noisy camera observes."""
        noise, state = self.problem.measurement, self.states[-1]
        return np.asarray(state + self._camera.normal(scale=noise, size=state.shape) if noise else state.copy())

    def send(self, move: Points) -> None:
        """Move the particles by the input ``move`` plus noise."""
        self.inputs.append(np.asarray(move, dtype=np.float64))
        noise = self.problem.execution
        executed = self.inputs[-1] + self._execution.normal(scale=noise, size=len(move)) if noise else self.inputs[-1]
        self.states.append(self._world.step(self.states[-1], executed))


def executed_moves(problem: SteeringProblem, inputs: Points, *, seed: int) -> Points:
    """Return the executed moves, which are the inputs plus random noise; float64, shape (moves, d)."""
    if not problem.execution:
        return inputs
    return np.asarray(inputs + generators(seed)[1].normal(scale=problem.execution, size=inputs.shape))


def replay(problem: SteeringProblem, inputs: Points, *, seed: int) -> Points:
    """Return the positions of the particles during a replay of ``inputs``; float64, shape (moves + 1, n, d)."""
    start, _ = problem.endpoints(seed)
    return np.asarray(problem.world(seed=seed).play(start, executed_moves(problem, inputs, seed=seed)))


def condition(problem: SteeringProblem, inputs: Points, *, seed: int) -> float:
    """Return the amplification of errors: the largest ratio of a final position error to the small error that causes it.

    The function displaces the start of each particle along each axis by 1e-12 of the workspace's size, in both directions, and
    simulates the moves after each displacement. It also simulates the moves with a contact tolerance of 1e-12 of the workspace's
    size instead of 1e-9. The amplification of errors is large if a small change of the start causes a wall to release a particle.
    """
    world, moves = problem.world(seed=seed), executed_moves(problem, inputs, seed=seed)
    start, _ = problem.endpoints(seed)
    end = world.play(start, moves)[-1]
    exact = replace(world, touch=EXACT_TOUCH).play(start, moves)[-1]
    step = EXACT_TOUCH * problem.place.size
    worst = float(np.linalg.norm(exact - end, axis=1).max()) / (TOUCH * problem.place.size)
    for particle, axis in np.ndindex(start.shape):
        for side in (-step, step):
            moved = start.copy()
            moved[particle, axis] += side
            if problem.place.contains(moved).all():
                worst = max(worst, float(np.linalg.norm(world.play(moved, moves)[-1] - end, axis=1).max()) / step)
    return float(worst)
