"""Planner robust: a closed loop of moves and observations, for simulated worlds with noise."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.steering.contact.world import direction_away_from, touched_normals
from shoal.steering.kernels import annealing as kernels
from shoal.steering.kernels.contact import first_contact
from shoal.steering.kernels.sampling import step
from shoal.steering.planners.annealing import MOST_STEPS, Annealing, Plan, copy_of, steps_of
from shoal.steering.planners.chain_search import shortest_chain
from shoal.steering.planners.chains import Chain, ChainQuery
from shoal.steering.planners.clearance import plan_with_clearance
from shoal.steering.planners.greedy import exact_chain
from shoal.steering.planners.sampling import MORE_ROUNDS, Sampling, Translations, Tree, world_of
from shoal.steering.planners.shortest import Shortest
from shoal.steering.planners.task import SteeringTask
from shoal.steering.workspaces.convex import Points
from shoal.steering.workspaces.region import Region

SURE = 4.0  # number of standard deviations that counts as impossible
LEAST = 1e-4  # relative to the size: minimum overshoot, limited to half of the tolerance
CENTRAL = np.array([8.0, 40.0])  # sharpness that keeps chains far from all limits


class Cycles:
    """One run of the closed loop in a convex workspace, which makes one cycle (contact and
    adjustment) at a time.

    The move to a wall contact aims behind the wall, so that the touching particle reaches the wall
    despite noise and an unknown gain. The loop computes each adjustment from the positions that the
    camera observes. Each adjustment aims at the position difference that the planned chain has
    after its first cycle, and pushes the touching particle into the wall. The loop estimates the
    gain (displacement of a particle divided by the input) from the observed motion of the
    particles.
    """

    def __init__(self, task: SteeringTask, apparatus: Any, noise: Any) -> None:
        self.task, self.apparatus, self.noise = task, apparatus, noise
        self.workspace = task.world.free_space
        self.least = min(
            LEAST * self.workspace.size, max(task.tolerance / 2, 1e-8 * self.workspace.size)
        )
        self.field = GainBelief(self.workspace, self.noise)
        self.seen = self._inside(apparatus.look())

    @property
    def sent(self) -> int:
        """Number of moves sent so far."""
        return len(self.apparatus.inputs)

    def run(self) -> None:
        """Run the closed loop until the camera observes all particles at their goals, or the
        maximum number of moves is reached.
        """
        while self.sent < self.task.max_moves and not self._arrived():
            apart = float(
                np.linalg.norm(self._target_difference(self.seen) - (self.seen[1] - self.seen[0]))
            )
            if apart <= self._allowed_error():
                self._translate(self._to_goal(self.seen))
                continue
            if not self._cycle():
                # No cycle is possible from this state. Move to the centre and observe again.
                self._send((self.workspace.middle - self.seen.mean(axis=0)) * 0.5)

    def _arrived(self) -> bool:
        near: float = max(
            self.task.tolerance - 2 * self.noise.measurement, 0.6 * self.task.tolerance
        )
        return self.task.error(self.seen) <= near

    def _allowed_error(self) -> float:
        """Return the largest error of the position difference with which a translation to the goals
        succeeds despite noise.
        """
        far: float = max(
            1.2 * self.task.tolerance - 2 * self.noise.measurement, 0.8 * self.task.tolerance
        )
        return far

    def _cycle(self) -> bool:
        """Plan a chain to the goals and make its first contact and adjustment; return False if no
        chain was found.
        """
        spread = SURE * float(np.hypot(self.noise.execution, self.noise.measurement))
        chain: Chain | None = None
        for share in (1.0, 0.5, 0.2, 0.05, 0.0):
            margin = max(share * 2 * spread, self.least)
            query = self._chain_query(margin)
            chain = shortest_chain(query, cycles=(1, 2, 3), first_found=True)
            if chain is not None:
                break
        if chain is None:
            query = self._chain_query(1e-6 * self.workspace.size)
            chain = exact_chain(query)
            if chain is None:
                return False
        walls = query.walls
        toucher = int(chain.touchers[0])
        contact = walls.restored(chain.contacts(walls)[0])
        target = chain.differences(query.before, query.after)[1] * walls.scale
        last = chain.cycles == 1
        if not self._touch(toucher, contact, spread):
            return True
        self._adjust(toucher, target, last=last, spread=spread)
        return True

    def _chain_query(self, margin: float) -> ChainQuery:
        """Return a query for a chain that keeps ``margin`` from the walls.

        Each adjustment of the chain pushes the touching particle into its wall by at least 1.5
        times ``margin``.
        """
        seen = self.seen
        difference = self._target_difference(seen)
        middle = self.task.goal.mean(axis=0)
        aim = np.stack([middle - difference / 2, middle + difference / 2])
        query = self.task.chain_query(start=seen, aim=aim)
        scaled_margin = margin / query.walls.scale
        return ChainQuery(
            query.walls,
            query.start,
            query.goal,
            friction=query.friction * 0.9,
            margin=scaled_margin,
            push=1.5 * scaled_margin,
            rounds=CENTRAL,
        )

    def _touch(self, toucher: int, contact: Points, spread: float) -> bool:
        """Move a particle against a wall with an overshoot; return whether the camera then observes
        the particle at the wall.

        If the gain is uncertain, the first move ends before the wall. A move from far away would
        need a large overshoot, which might bring the other particle to the wall.
        """
        for attempt in range(4):
            if self.sent >= self.task.max_moves:
                return False
            position = self.seen[toucher]
            inward = self._normal(contact)
            approach = contact - position
            unsure = 2 * self.field.deviation(position, contact) * float(np.linalg.norm(approach))
            apart = float(inward @ (self.seen[1 - toucher] - position))
            if unsure > min(spread, 0.2 * apart) and attempt < 3:
                approach = approach + inward * (unsure + spread)
                self._translate(approach / self.field.mean(position, contact))
                continue
            # Limit the overshoot so that the other particle does not reach the wall.
            over = max(min(spread + unsure, 0.45 * apart), self.least)
            self._translate(approach / self.field.mean(position, contact) - inward * over)
            if (
                self._distance(self.seen[toucher])
                <= 3 * self.noise.measurement + 2e-9 * self.workspace.size
            ):
                return True
            contact = self._foot(self.seen[toucher])
        return False

    def _translate(self, move: Points) -> None:
        """Send a translation that no wall blocks at its start.

        If a particle may touch a wall, the method first sends a small move off the wall.
        """
        near = 3 * self.noise.measurement / self.workspace.size + 2e-9
        normals = np.vstack(
            [touched_normals(self.workspace, point, within=near) for point in self.seen]
        )
        least = SURE * self.noise.execution + 1e-8 * self.workspace.size
        if len(normals) and float((normals @ move).min()) < least:
            lift = direction_away_from(normals)
            if lift is not None:
                lift = lift * (2 * least + 3 * self.noise.measurement)
                self._send(lift)
                move = move - lift
        self._send(move)

    def _adjust(self, toucher: int, target: Points, *, last: bool, spread: float) -> None:
        """Move the other particle towards the position difference ``target`` while a wall holds the
        touching particle.

        The method repeats the move, at most twice, if the observed position difference is still too
        far from the target.
        """
        sign = 1.0 if toucher == 0 else -1.0
        other = 1 - toucher
        for attempt in range(3):
            if self.sent >= self.task.max_moves:
                return
            inward = self._normal(self._foot(self.seen[toucher]))
            if last:
                target = self._target_difference(self.seen)
            # The toucher is on the wall, so its position is known better than observed.
            positions = self.seen.copy()
            positions[toucher] = self._foot(positions[toucher])
            change = sign * (target - (positions[1] - positions[0]))
            move = change / self.field.mean(positions[other], positions[other] + change)
            length = float(np.linalg.norm(move))
            unsure = 2 * self.field.deviation(positions[other], positions[other] + change) * length
            if unsure > 2 * spread and attempt < 2:
                move = move * max(1 - (unsure + spread) / length, 0.3)
            push = -float(inward @ move)
            least = max(spread, self.least)
            if self.task.world.friction < inf:
                along = float(np.linalg.norm(move + push * inward))
                least = max(least, 1.1 * along / float(self.task.world.friction))
            if push < least:
                # The wall may not hold the toucher. Push into the wall as well, and correct the
                # resulting error later.
                if push < -least:
                    return
                move = move - inward * (least - push)
            free = self._free_length(positions[other], move) - spread
            length = float(np.linalg.norm(move))
            if free < length:
                if free < 0.2 * length:
                    return  # no progress: another contact will be better
                move = move * (free / length)
            self._send(move)
            error = float(np.linalg.norm(target - (self.seen[1] - self.seen[0])))
            if error <= max(self._allowed_error() / 2, spread if not last else 0.0):
                return

    def _free_length(self, point: Points, move: Points) -> float:
        """Return how far a particle at ``point`` can move in the direction of ``move`` before it
        meets a wall.
        """
        share, _ = first_contact(point, np.ascontiguousarray(move), self.task.world.walls, -1)
        return float(share * np.linalg.norm(move))

    def _target_difference(self, seen: Points) -> Points:
        """Return the position difference from which a translation, with the estimated gain, leads
        both particles to their goals.
        """
        goal = self.task.goal
        before = goal.copy()
        move = (goal - seen).mean(axis=0)
        for _round in range(3):
            before = np.stack([self.field.behind(point, move) for point in goal])
            move = goal[0] - seen[0]
            gain = self.field.mean(seen[0], goal[0])
            move = move / gain
        return np.asarray(before[1] - before[0])

    def _to_goal(self, seen: Points) -> Points:
        """Return the translation that brings both particles as close to their goals as possible,
        with the estimated gain.
        """
        move = (self.task.goal - seen).mean(axis=0)
        for _round in range(4):
            after = np.stack([self.field.ahead(point, move) for point in seen])
            move = move + (self.task.goal - after).mean(axis=0)
        return np.asarray(move)

    def _send(self, move: Points) -> None:
        """Send a move unless the maximum number of moves is reached, then observe the particles and
        update the estimated gain.
        """
        if self.sent >= self.task.max_moves:
            return
        before = self.seen
        self.apparatus.send(move)
        self.seen = self._inside(self.apparatus.look())
        for start, end in zip(before, self.seen, strict=True):
            # A particle without wall contact gives information about the gain.
            clear = 4 * self.noise.measurement + 1e-6 * self.workspace.size
            if self._distance(start) > clear and self._distance(end) > clear:
                self.field.learn(start, end, move)

    def _distance(self, point: Points) -> float:
        return float(self.workspace.depth(point))

    def _inside(self, points: Points) -> Points:
        """Return the given points, with points outside the workspace projected onto the wall."""
        return np.stack(
            [self._foot(point) if self._distance(point) < 0 else point for point in points]
        )

    def _foot(self, point: Points) -> Points:
        """Return the wall point nearest to ``point``, corrected near corners so that it lies inside
        the workspace.
        """
        workspace = self.workspace
        for _round in range(4):
            walls = workspace.wall_distances(point)
            circle = float(workspace.circle_distance(point))
            if len(walls) and walls.min() <= circle:
                point = point - walls.min() * workspace.normals[int(np.argmin(walls))]
            else:
                outward = point[:2] - workspace.center
                point = np.concatenate(
                    [
                        workspace.center + outward * (workspace.radius / float(np.hypot(*outward))),
                        point[2:],
                    ]
                )
            if self._distance(point) >= -1e-12 * workspace.size:
                break
        return np.asarray(point)

    def _normal(self, contact: Points) -> Points:
        workspace = self.workspace
        walls = workspace.wall_distances(contact)
        if len(walls) and walls.min() <= float(workspace.circle_distance(contact)):
            return np.asarray(workspace.normals[int(np.argmin(walls))])
        inward = np.zeros(len(contact))
        inward[:2] = workspace.center - contact[:2]
        return inward / float(np.linalg.norm(inward))


PRIOR = 0.3  # prior standard deviation of the gain's slope, in gains per size


class GainBelief:
    """Estimate of the gain at each point p with the model a + b · (p - c) / s.

    The vector c is the centre of the workspace's base, and s is the size of the workspace. The
    estimate of the coefficients a and b is a normal distribution. Each observed move without wall
    contact improves the estimate.
    """

    def __init__(self, workspace: Any, noise: Any) -> None:
        d = workspace.dimensions
        self.size, self.noise = workspace.size, noise
        self.center = np.zeros(d)
        self.center[:2] = workspace.center
        self.estimate: NDArray[np.float64] = np.eye(d + 1)[0]
        self.spread = np.diag(np.r_[PRIOR / 3, np.full(d, PRIOR)]) ** 2 * (
            1.0 if noise.gain else 1e-12
        )

    def _features(self, point: Points) -> NDArray[np.float64]:
        return np.asarray(np.r_[1.0, (point - self.center) / self.size])

    def at(self, point: Points) -> float:
        """Return the expected gain (displacement of a particle divided by the input) at a point,
        but at least 0.2.
        """
        return max(float(self._features(point) @ self.estimate), 0.2)

    def mean(self, start: Points, end: Points) -> float:
        """Return the expected mean gain on the straight path between two points."""
        return self.at((start + end) / 2)

    def deviation(self, start: Points, end: Points) -> float:
        """Return the standard deviation of the estimated mean gain on the straight path between two
        points.
        """
        features = self._features((start + end) / 2)
        return float(np.sqrt(features @ self.spread @ features))

    def ahead(self, point: Points, move: Points) -> Points:
        """Return the expected end point of a particle that starts at ``point``, receives the input
        ``move`` and touches no wall.
        """
        middle = point + self.at(point) * move / 2
        return np.asarray(point + self.at(middle) * move)

    def behind(self, point: Points, move: Points) -> Points:
        """Return the expected start point of a particle that the input ``move`` brings to ``point``
        without wall contact.
        """
        middle = point - self.at(point) * move / 2
        return np.asarray(point - self.at(middle) * move)

    def learn(self, start: Points, end: Points, move: Points) -> None:
        """Update the estimate after the input ``move`` has moved a particle without wall contact
        from ``start`` to ``end``.

        The observed gain is the distance travelled in the direction of the input, divided by the
        length of the input. The method uses the observed gain as the gain at the midpoint of the
        path. The method ignores inputs that are short compared with the noise.
        """
        length = float(np.linalg.norm(move))
        if length < 20 * max(self.noise.measurement, self.noise.execution, 1e-9 * self.size):
            return
        gain = float((end - start) @ move) / length**2
        variance = (2 * self.noise.measurement**2 + self.noise.execution**2) / length**2 + 1e-6
        features = self._features((start + end) / 2)
        along = self.spread @ features
        weight = along / (float(features @ along) + variance)
        self.estimate = self.estimate + weight * (gain - float(features @ self.estimate))
        self.spread = self.spread - np.outer(weight, along)


STATES = 256
LIKELY = 16  # effective states: with fewer what is seen counts alone
# share of the states that have arrived: of a run that has just begun, and of one at its end
ARRIVED_SHARE, SATISFIED = (0.95, 0.5)


class PositionBelief:
    """A particle filter: many possible positions of both particles, all equally likely.

    Attributes
    ----------
    states : ndarray of float64, shape (states, 2, 2)
        The possible states. A state holds one row of coordinates for each particle.
    state : ndarray of float64, shape (2, 2)
        The possible state that is nearest to the mean of all possible states.
    """

    def __init__(
        self, workspace: Any, world: Any, noise: Any, seen: Points, rng: np.random.Generator
    ) -> None:
        self.workspace, self.world, self.noise, self.rng = workspace, world, noise, rng
        self._set_states(self._draw_states(seen))

    def update(self, move: Points, seen: Points) -> None:
        """Update the particle filter after the move ``move``, with the positions ``seen`` that the
        camera then observed.
        """
        states = self._propagate(move, seen) if self.noise.measurement else None
        self._set_states(self._draw_states(seen) if states is None else states)

    def _propagate(self, move: Points, seen: Points) -> NDArray[np.float64] | None:
        """Return possible states after a move, or None if hardly any state agrees with the observed
        positions ``seen``.

        The method draws states at random. A state that agrees better with the observed positions
        has a larger probability.
        """
        moves = move + self.rng.normal(scale=self.noise.execution, size=(STATES, 2))
        states = self.states.copy()
        kernels.step_all(states, moves, self.world)
        unlikely = np.sum((states - seen) ** 2, axis=(1, 2)) / (2 * self.noise.measurement**2)
        weights = np.exp(unlikely.min() - unlikely)
        weights /= weights.sum()
        return (
            None
            if 1 / np.sum(weights**2) < LIKELY
            else states[self.rng.choice(STATES, STATES, p=weights)]
        )

    def arrived(self, goal: Points, tolerance: float, *, share: float) -> bool:
        """Return whether enough possible states are within the tolerance of the goals.

        ``share`` is the fraction of the maximum number of moves that the loop has used. The larger
        this fraction is, the fewer states need to be within the tolerance.
        """
        near = np.mean(np.linalg.norm(self.states - goal, axis=2).max(axis=1) <= tolerance)
        return bool(near >= ARRIVED_SHARE - (ARRIVED_SHARE - SATISFIED) * share)

    def _draw_states(self, seen: Points) -> NDArray[np.float64]:
        """Return new possible states, drawn around the observed positions ``seen``."""
        if not self.noise.measurement:
            return np.repeat(seen[None], STATES, axis=0)
        states = seen + self.rng.normal(scale=self.noise.measurement, size=(STATES, 2, 2))
        outside = ~self.workspace.contains(states)
        states[outside] = _project_inside(self.workspace, states[outside])
        return states

    def _set_states(self, states: NDArray[np.float64]) -> None:
        self.states = np.ascontiguousarray(states)
        self.state = self.states[
            int(np.argmin(np.sum((states - states.mean(axis=0)) ** 2, axis=(1, 2))))
        ].copy()


def _project_inside(workspace: Any, points: Points) -> Points:
    """Return, for each point outside a plane workspace, the nearest point of the workspace;
    float64, shape (n, 2).
    """
    import shapely

    if workspace.round:
        away = points - workspace.center
        return np.asarray(
            workspace.center + workspace.radius * away / np.linalg.norm(away, axis=1, keepdims=True)
        )
    lines = shapely.shortest_line(workspace.shape, shapely.points(points))
    return np.asarray(shapely.get_coordinates(shapely.get_point(lines, 0)))


# grown at the start, and where the plan so far has become worse than it was
FIRST_TREES, TREES = (4, 2)
SHORTENED = 5_000  # changes of a new plan in a world without noise
# standard deviations of noise: how far behind walls contacts of new plans aim
OVERSHOOTS = (0.0, 1.5, 3.0)
MARGINS = (3.0, 1.5, 0.5)  # of these: how far from walls ways around obstacles keep
SCENARIOS, JUDGED = 32, 256  # in which plans are changed, and in which they are judged
REFINED, CHANGES = 3, 400  # of the best plans, so many changes each
WORSE = 0.5  # moves more than were expected: then new plans are looked for
# growth of the cost of a wrong difference with each move, so that no loop waits for better luck
IMPATIENCE = 1.15
CYCLE = 3  # moves that mend a wrong difference, at the least


class Replanning:
    """One run of the closed loop in the plane.

    A plan is a sequence of steps. Each step computes its move from the present positions of the
    particles, so that it corrects the effects of noise. The loop compares plans by their mean
    number of moves in simulations with noise. If a simulated plan ends before the particles reach
    their goals, the loop adds an estimate of the remaining moves to the plan's number of moves.

    Parameters
    ----------
    task : SteeringTask
    apparatus : shoal.steering.simulation.Apparatus
    noise : SteeringProblem
        A problem whose fields ``execution`` and ``measurement`` hold the standard deviations of the
        assumed noise.
    """

    def __init__(self, task: SteeringTask, apparatus: Any, noise: Any) -> None:
        self.task, self.apparatus = task, apparatus
        self.world, self.workspace = world_of(task.world), task.world.free_space
        self.rng = np.random.default_rng([task.seed, 4])
        self.belief = PositionBelief(self.workspace, self.world, noise, apparatus.look(), self.rng)
        self.deviation = max(
            float(np.hypot(noise.execution, noise.measurement)), 1e-9 * self.workspace.size
        )
        # probability that a normal error in the plane is shorter than a share of the tolerance
        near, far = (
            1 - np.exp(-0.5 * (share * task.tolerance / self.deviation) ** 2)
            for share in (1.0, 1.2)
        )
        self.cycle = float(min(1 / near + CYCLE / far, 1e3))
        margins = tuple(share * self.deviation / self.workspace.size for share in MARGINS)
        self.translations = Translations(task, margins)
        self.exact = Translations(task)

    def run(self) -> None:
        """Run the closed loop until the particles are probably at their goals, or until the maximum
        number of moves is reached.
        """
        plan, move = None, np.zeros(2)
        while (sent := len(self.apparatus.inputs)) < self.task.max_moves:
            if self.belief.arrived(
                self.task.goal, self.task.tolerance, share=sent / self.task.max_moves
            ):
                return
            plan = self._plan(plan)
            kernels.make_move(plan.steps, 0, self.belief.state, move)
            self.apparatus.send(move.copy())
            self.belief.update(move, self.apparatus.look())

    def _plan(self, last: Plan | None) -> Plan:
        """Return the best plan for the estimated positions of the particles."""
        sent = len(self.apparatus.inputs)
        remaining, cycle = (
            min(self.task.max_moves - sent, MOST_STEPS),
            min(self.cycle * IMPATIENCE**sent, 1e6),
        )
        task = replace(self.task, start=self.belief.state, max_moves=remaining)
        errors = self.rng.normal(scale=self.deviation, size=(JUDGED, MOST_STEPS, 2))
        many_scenarios = kernels.Noise(self.belief.states, errors, self.deviation, cycle)
        scenarios = kernels.Noise(
            self.belief.states[:SCENARIOS], errors[:SCENARIOS].copy(), self.deviation, cycle
        )
        annealing = Annealing(task, self.world, self.rng)

        def costs(plans: Iterable[Plan]) -> list[Plan]:
            return [annealing.anneal(plan, changes=0, noise=many_scenarios) for plan in plans]

        candidates = costs(self._candidate_plans(task, last))
        useful = [plan for plan in candidates if self._moves_particles(plan, scenarios)]
        if last is None:
            candidates += costs(self._new_plans(annealing, FIRST_TREES))
        elif (
            not task.late
            and min((plan.cost for plan in useful), default=inf) > last.cost - 1 + WORSE
        ):
            candidates += costs(self._new_plans(annealing, TREES))
        candidates.sort(key=lambda plan: plan.cost)
        best = [plan for plan in candidates if self._moves_particles(plan, scenarios)][:REFINED]
        candidates += costs(
            annealing.anneal(plan, changes=CHANGES, noise=scenarios)
            for plan in best
            if not task.late
        )
        useful = [plan for plan in candidates if self._moves_particles(plan, scenarios)]
        return min(useful or candidates, key=lambda plan: plan.cost)

    def _moves_particles(self, plan: Plan, noise: kernels.Noise) -> bool:
        """Return whether, in at least one noise scenario, the first move of a plan moves a particle
        farther than the noise does.

        The loop carries out a plan whose first move changes nothing only if it has no other plan.
        After such a move, the loop would be in the same state, and would often choose the same move
        again.
        """
        move, state = np.zeros(2), np.zeros((2, 2))
        for start, errors in zip(noise.starts, noise.errors, strict=True):
            kernels.make_move(plan.steps, 0, start, move)
            state[:] = start
            step(state, move + errors[0], self.world)
            if np.abs(state - start).max() > self.deviation:
                return True
        return False

    def _candidate_plans(self, task: SteeringTask, last: Plan | None) -> Iterator[Plan]:
        """Yield the last plan, the last plan without its first step, and translations straight to
        the goals or around obstacles.
        """
        offset = (task.start - task.goal).mean(axis=0)
        for moves in [-offset[None], *self.translations.around(offset)]:
            if len(moves) <= task.max_moves:
                yield steps_of(task, moves)
        if last is not None:
            yield from (
                copy_of(last, first) for first in (0, 1) if 0 < last.count - first <= task.max_moves
            )

    def _new_plans(self, annealing: Annealing, trees: int) -> Iterator[Plan]:
        """Yield new plans for a world without noise, and copies of these plans whose moves to
        contacts aim behind the walls.
        """
        task = annealing.task
        shortest = None if isinstance(self.workspace, Region) else Shortest().plan(task)
        plans = [steps_of(task, np.zeros((0, 2)) if shortest is None else shortest)]
        for tree in range(trees if shortest is None else 0):
            if tree and task.late:
                break
            moves = Tree(task, self.world, self.rng, rounds=MORE_ROUNDS).search(self.exact)
            if moves is not None:
                plans.append(annealing.anneal(steps_of(task, moves), changes=SHORTENED))
        for plan in plans:
            for share in OVERSHOOTS if plan.count <= task.max_moves else ():
                steps = copy_of(plan).steps
                outward = np.stack([-steps.along[:, 1], steps.along[:, 0]], axis=1)
                steps.targets[:] += share * self.deviation * outward
                yield Plan(steps, plan.count)


ASSUMED = 1 / 16  # relative to the tolerance: assumed noise if the problem has none
QUIET_MOVES = 12  # maximum number of moves with assumed noise
# relative to the tolerance: with stronger noise, plans are evaluated in simulated noise
SLIGHT = 1 / 12
# relative to the tolerance: noise levels to test, and number of runs for each
STOOD, STOOD_RUNS = ((0.25, 0.0625), 3)


class Robust:
    """A planner for worlds with noise, which works in a closed loop: make one move, observe the
    particles, and plan again.

    In the plane, the planner compares plans by simulations with noise (class `Replanning`). In
    three dimensions, and in a convex workspace with a nonuniform gain or slight noise, the planner
    makes one cycle at a time (class `Cycles`).

    Notes
    -----
    Source: an addition by Shoal, for apparatuses with a nonuniform field, such as the apparatus in
    section VII.A of paper W.
    """

    name = "robust"
    obstacles = True

    def plan(self, task: SteeringTask) -> Points | None:
        """Return a short plan for a world without noise, in which no closed loop is necessary."""
        return (Sampling() if isinstance(task.world.free_space, Region) else Shortest()).plan(task)

    def control(self, task: SteeringTask, apparatus: Any) -> tuple[Points, Points]:
        """Run the closed loop, and return the moves that were sent and the resulting positions of
        the particles.

        In a world without noise, the method first sends a short plan. If this plan fails, the
        method puts the particles back at their starts and runs the closed loop with a small assumed
        noise. Whether or not the short plan fails, the method stores in ``apparatus.remark`` how
        much noise the closed loop would tolerate.
        """
        if apparatus.problem.noisy:
            _loop(task, apparatus, apparatus.problem, slight=SLIGHT).run()
        else:
            short = replace(task, max_moves=min(task.max_moves, QUIET_MOVES))
            plan = plan_with_clearance(task, self)
            for move in plan if plan is not None and len(plan) <= task.max_moves else ():
                apparatus.send(move)
            if task.error(apparatus.states[-1]) > task.tolerance:
                apparatus.restart()
                _loop(
                    short, apparatus, apparatus.with_noise(ASSUMED * task.tolerance).problem
                ).run()
            apparatus.remark = _describe_tolerated_noise(short, apparatus)
        d = task.start.shape[1]
        return np.array(apparatus.inputs).reshape(-1, d), np.array(apparatus.states)


def _loop(
    task: SteeringTask, apparatus: Any, noise: Any, *, slight: float = inf
) -> Cycles | Replanning:
    """Return the closed loop that suits the workspace and the noise.

    Noise is slight if its standard deviation is at most ``slight`` times the tolerance of the
    goals.
    """
    convex = not isinstance(task.world.free_space, Region)
    by_cycles = noise.gain > 0 or max(noise.execution, noise.measurement) <= slight * task.tolerance
    return (
        Cycles if convex and (by_cycles or task.world.free_space.dimensions == 3) else Replanning
    )(task, apparatus, noise)


def _describe_tolerated_noise(task: SteeringTask, apparatus: Any) -> str:
    """Return a sentence about the largest tested execution noise with which all runs of the closed
    loop succeed.
    """
    for share in STOOD:
        noise = share * task.tolerance
        for seed in range(STOOD_RUNS):
            trial = apparatus.with_noise(noise, seed=seed)
            _loop(task, trial, trial.problem).run()
            if task.error(trial.states[-1]) > task.tolerance or task.late:
                break
        else:
            return (
                f"in {STOOD_RUNS} of {STOOD_RUNS} runs with execution noise {noise:.2g} the loop"
                " also reaches the goals"
            )
    return f"execution noise of {STOOD[-1] * task.tolerance:.2g} is too much here"
