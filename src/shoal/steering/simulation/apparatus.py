"""The simulated apparatus: an input with noise, a camera with noise, and the states that the inputs led to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from shoal.steering.contact.disturbances import generators
from shoal.steering.problem import SteeringProblem
from shoal.steering.workspaces.convex import TOUCH
from shoal.steering.workspaces.convex_geometry import Points

EXACT_TOUCH = 1e-12  # of the size: how near who touches is to a wall, where contacts are looked at closely


class Apparatus:
    """What a planner in a closed loop can do: send a move, look.

    Attributes
    ----------
    problem : SteeringProblem
        Its noise, as far as a planner may know it.
    states : list of ndarray of float64, shape (n, d)
        At the start and after each move.
    inputs : list of ndarray of float64, shape (d,)
        The moves that were sent.
    remark : str
        What the planner has to say of the run; it becomes part of the reason.
    """

    def __init__(self, problem: SteeringProblem, start: Points, *, seed: int) -> None:
        self.problem, self.remark = problem, ""
        self._world = problem.world(seed=seed)
        _, self._execution, self._camera, _ = generators(seed)
        self.states = [self._world.initial(start)]
        self.inputs: list[Points] = []

    def restart(self) -> None:
        """Forget all moves: the particles are at their start."""
        del self.states[1:], self.inputs[:]

    def with_noise(self, noise: float, *, seed: int = 0) -> Apparatus:
        """Return another apparatus at the same start, with execution noise of that standard deviation."""
        return Apparatus(self.problem.replaced(execution=noise), self.states[0], seed=seed)

    def look(self) -> Points:
        """Return where the camera sees the particles."""
        noise, state = self.problem.measurement, self.states[-1]
        return np.asarray(state + self._camera.normal(scale=noise, size=state.shape) if noise else state.copy())

    def send(self, move: Points) -> None:
        """Move the particles."""
        self.inputs.append(np.asarray(move, dtype=np.float64))
        noise = self.problem.execution
        executed = self.inputs[-1] + self._execution.normal(scale=noise, size=len(move)) if noise else self.inputs[-1]
        self.states.append(self._world.step(self.states[-1], executed))


def executed_moves(problem: SteeringProblem, inputs: Points, *, seed: int) -> Points:
    """Return what becomes of inputs with the noise of their execution; float64, shape (moves, d)."""
    if not problem.execution:
        return inputs
    return np.asarray(inputs + generators(seed)[1].normal(scale=problem.execution, size=inputs.shape))


def replay(problem: SteeringProblem, inputs: Points, *, seed: int) -> Points:
    """Return all states when inputs are sent, again, with a seed; float64, shape (moves + 1, n, d)."""
    start, _ = problem.endpoints(seed)
    return np.asarray(problem.world(seed=seed).play(start, executed_moves(problem, inputs, seed=seed)))


def condition(problem: SteeringProblem, inputs: Points, *, seed: int) -> float:
    """Return how many times as large the error at the end is as one of the start, or as the tolerance of contacts.

    The start is moved by 1e-12 of the size along each coordinate of each particle, and once particles are held only where they are
    nearer to a wall than that. If a wall then no longer holds one, it is large.
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
