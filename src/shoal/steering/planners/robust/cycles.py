"""The closed loop in convex workspaces: make a wall contact, observe, adjust the other particle, and plan again."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np

from shoal.steering.contact.gain_belief import GainBelief
from shoal.steering.contact.wall_release import direction_away_from, touched_normals
from shoal.steering.kernels.contact import first_contact
from shoal.steering.planners.chains.chain import Chain, ChainQuery
from shoal.steering.planners.chains.search import shortest_chain
from shoal.steering.planners.greedy import any_chain
from shoal.steering.planners.task import SteeringTask
from shoal.steering.workspaces.convex_geometry import Points

SURE = 4.0  # number of standard deviations that counts as impossible
LEAST = 1e-4  # relative to the size: minimum overshoot, limited to half of the tolerance
CENTRAL = np.array([8.0, 40.0])  # sharpness that keeps chains far from all limits


class Cycles:
    """One run of the closed loop in a convex workspace, which makes one cycle (contact and adjustment) at a time.

    The move to a wall contact aims behind the wall, so that the touching particle reaches the wall despite noise and an unknown
    gain. The loop computes each adjustment from the positions that the camera observes. Each adjustment aims at the position
    difference that the planned chain has after its first cycle, and pushes the touching particle into the wall. The loop estimates
    the gain (displacement of a particle divided by the input) from the observed motion of the particles.
    """

    def __init__(self, task: SteeringTask, apparatus: Any, noise: Any) -> None:
        self.task, self.apparatus, self.noise = task, apparatus, noise
        self.room = task.world.room
        self.least = min(LEAST * self.room.size, max(task.tolerance / 2, 1e-8 * self.room.size))
        self.field = GainBelief(self.room, self.noise)
        self.seen = self._inside(apparatus.look())

    @property
    def sent(self) -> int:
        """Number of moves sent so far."""
        return len(self.apparatus.inputs)

    def run(self) -> None:
        """Run the closed loop until the camera observes all particles at their goals, or the maximum number of moves is reached."""
        while self.sent < self.task.max_moves and not self._arrived():
            apart = float(np.linalg.norm(self._wanted(self.seen) - (self.seen[1] - self.seen[0])))
            if apart <= self._good_enough():
                self._translate(self._to_goal(self.seen))
                continue
            if not self._cycle():
                # No cycle is possible from this state. Move to the centre and observe again.
                self._send((self.room.middle - self.seen.mean(axis=0)) * 0.5)

    def _arrived(self) -> bool:
        near: float = max(self.task.tolerance - 2 * self.noise.measurement, 0.6 * self.task.tolerance)
        return self.task.error(self.seen) <= near

    def _good_enough(self) -> float:
        """Return the largest error of the position difference with which a translation to the goals succeeds despite noise."""
        far: float = max(1.2 * self.task.tolerance - 2 * self.noise.measurement, 0.8 * self.task.tolerance)
        return far

    def _cycle(self) -> bool:
        """Plan a chain to the goals and make its first contact and adjustment; return False if no chain was found."""
        spread = SURE * float(np.hypot(self.noise.execution, self.noise.measurement))
        found: Chain | None = None
        for share in (1.0, 0.5, 0.2, 0.05, 0.0):
            margin = max(share * 2 * spread, self.least)
            query = self._chain_query(margin)
            found = shortest_chain(query, cycles=(1, 2, 3), first_found=True)
            if found is not None:
                break
        if found is None:
            query = self._chain_query(1e-6 * self.room.size)
            found = any_chain(query)
            if found is None:
                return False
        walls = query.walls
        toucher = int(found.touchers[0])
        contact = walls.restored(found.contacts(walls)[0])
        target = found.differences(query.before, query.after)[1] * walls.scale
        last = found.cycles == 1
        if not self._touch(toucher, contact, spread):
            return True
        self._adjust(toucher, target, last=last, spread=spread)
        return True

    def _chain_query(self, margin: float) -> ChainQuery:
        """Return a query for a chain that keeps ``margin`` from the walls.

        Each adjustment of the chain pushes the touching particle into its wall by at least 1.5 times ``margin``.
        """
        seen = self.seen
        wanted = self._wanted(seen)
        middle = self.task.goal.mean(axis=0)
        aim = np.stack([middle - wanted / 2, middle + wanted / 2])
        query = self.task.chain_query(start=seen, aim=aim)
        part = margin / query.walls.scale
        return ChainQuery(
            query.walls, query.start, query.goal, friction=query.friction * 0.9, margin=part, push=1.5 * part, rounds=CENTRAL
        )

    def _touch(self, toucher: int, contact: Points, spread: float) -> bool:
        """Move a particle against a wall with an overshoot; return whether the camera then observes the particle at the wall.

        If the gain is uncertain, the first move ends before the wall. A move from far away would need a large overshoot, which
        might bring the other particle to the wall.
        """
        for attempt in range(4):
            if self.sent >= self.task.max_moves:
                return False
            here = self.seen[toucher]
            inward = self._normal(contact)
            way = contact - here
            unsure = 2 * self.field.deviation(here, contact) * float(np.linalg.norm(way))
            apart = float(inward @ (self.seen[1 - toucher] - here))
            if unsure > min(spread, 0.2 * apart) and attempt < 3:
                way = way + inward * (unsure + spread)
                self._translate(way / self.field.mean(here, contact))
                continue
            # Limit the overshoot so that the other particle does not reach the wall.
            over = max(min(spread + unsure, 0.45 * apart), self.least)
            self._translate(way / self.field.mean(here, contact) - inward * over)
            if self._distance(self.seen[toucher]) <= 3 * self.noise.measurement + 2e-9 * self.room.size:
                return True
            contact = self._foot(self.seen[toucher])
        return False

    def _translate(self, move: Points) -> None:
        """Send a translation that no wall blocks at its start.

        If a particle may touch a wall, the method first sends a small move off the wall.
        """
        near = 3 * self.noise.measurement / self.room.size + 2e-9
        normals = np.vstack([touched_normals(self.room, point, within=near) for point in self.seen])
        least = SURE * self.noise.execution + 1e-8 * self.room.size
        if len(normals) and float((normals @ move).min()) < least:
            lift = direction_away_from(normals)
            if lift is not None:
                lift = lift * (2 * least + 3 * self.noise.measurement)
                self._send(lift)
                move = move - lift
        self._send(move)

    def _adjust(self, toucher: int, target: Points, *, last: bool, spread: float) -> None:
        """Move the other particle towards the position difference ``target`` while a wall holds the touching particle.

        The method repeats the move, at most twice, if the observed position difference is still too far from the target.
        """
        sign = 1.0 if toucher == 0 else -1.0
        other = 1 - toucher
        for attempt in range(3):
            if self.sent >= self.task.max_moves:
                return
            inward = self._normal(self._foot(self.seen[toucher]))
            if last:
                target = self._wanted(self.seen)
            # The toucher is on the wall, so its position is known better than observed.
            here = self.seen.copy()
            here[toucher] = self._foot(here[toucher])
            change = sign * (target - (here[1] - here[0]))
            move = change / self.field.mean(here[other], here[other] + change)
            length = float(np.linalg.norm(move))
            unsure = 2 * self.field.deviation(here[other], here[other] + change) * length
            if unsure > 2 * spread and attempt < 2:
                move = move * max(1 - (unsure + spread) / length, 0.3)
            push = -float(inward @ move)
            least = max(spread, self.least)
            if self.task.world.friction < inf:
                along = float(np.linalg.norm(move + push * inward))
                least = max(least, 1.1 * along / float(self.task.world.friction))
            if push < least:
                # The wall may not hold the toucher. Push into the wall as well, and correct the resulting error later.
                if push < -least:
                    return
                move = move - inward * (least - push)
            room = self._room_along(here[other], move) - spread
            length = float(np.linalg.norm(move))
            if room < length:
                if room < 0.2 * length:
                    return  # no progress: another contact will be better
                move = move * (room / length)
            self._send(move)
            left = float(np.linalg.norm(target - (self.seen[1] - self.seen[0])))
            if left <= max(self._good_enough() / 2, spread if not last else 0.0):
                return

    def _room_along(self, point: Points, move: Points) -> float:
        """Return how far a particle at ``point`` can move in the direction of ``move`` before it meets a wall."""
        share, _ = first_contact(point, np.ascontiguousarray(move), self.task.world.walls, -1)
        return float(share * np.linalg.norm(move))

    def _wanted(self, seen: Points) -> Points:
        """Return the position difference from which a translation, with the estimated gain, leads both particles to their goals."""
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
        """Return the translation that brings both particles as close to their goals as possible, with the estimated gain."""
        move = (self.task.goal - seen).mean(axis=0)
        for _round in range(4):
            after = np.stack([self.field.ahead(point, move) for point in seen])
            move = move + (self.task.goal - after).mean(axis=0)
        return np.asarray(move)

    def _send(self, move: Points) -> None:
        """Send a move unless the maximum number of moves is reached, then observe the particles and update the estimated gain."""
        if self.sent >= self.task.max_moves:
            return
        before = self.seen
        self.apparatus.send(move)
        self.seen = self._inside(self.apparatus.look())
        for here, there in zip(before, self.seen, strict=True):
            # A particle without wall contact gives information about the gain.
            clear = 4 * self.noise.measurement + 1e-6 * self.room.size
            if self._distance(here) > clear and self._distance(there) > clear:
                self.field.learn(here, there, move)

    def _distance(self, point: Points) -> float:
        return float(self.room.depth(point))

    def _inside(self, points: Points) -> Points:
        """Return the given points, with points outside the workspace projected onto the wall."""
        return np.stack([self._foot(point) if self._distance(point) < 0 else point for point in points])

    def _foot(self, point: Points) -> Points:
        """Return the wall point nearest to ``point``, corrected near corners so that it lies inside the workspace."""
        room = self.room
        for _round in range(4):
            walls = room.wall_distances(point)
            circle = float(room.circle_distance(point))
            if len(walls) and walls.min() <= circle:
                point = point - walls.min() * room.normals[int(np.argmin(walls))]
            else:
                outward = point[:2] - room.center
                point = np.concatenate([room.center + outward * (room.radius / float(np.hypot(*outward))), point[2:]])
            if self._distance(point) >= -1e-12 * room.size:
                break
        return np.asarray(point)

    def _normal(self, contact: Points) -> Points:
        room = self.room
        walls = room.wall_distances(contact)
        if len(walls) and walls.min() <= float(room.circle_distance(contact)):
            return np.asarray(room.normals[int(np.argmin(walls))])
        inward = np.zeros(len(contact))
        inward[:2] = room.center - contact[:2]
        return inward / float(np.linalg.norm(inward))
