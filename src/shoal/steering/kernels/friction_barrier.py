"""The barrier curve across which wall reactions with friction cannot move the position difference Δ of two particles.

If a wall holds or brakes a particle, the reaction of the wall changes the position difference Δ. For the first particle, the angle
between the change and the wall's outward normal is at most atan(friction). For the second particle, the angle between the change
and the wall's inward normal is at most atan(friction). A particle can touch a wall only if the other particle is inside the
workspace. For each direction of Δ, a particle can therefore touch a wall only up to some length of Δ. The code computes the barrier
in polar coordinates. Angles of wall reactions are measured counter-clockwise from the direction opposite to Δ.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel
from shoal.steering.kernels.contact import dot
from shoal.steering.kernels.cycles import contact_range

SWEEPS = 12
HALVINGS = 24
SAME = 1e-9
FLAT = 1e-9  # in radians: wall reactions that leave a half-plane by less count as inside


@kernel
def touchable(angle, step, most, model, ends, turns):
    """Compute, for each wall and particle, up to which length of the position difference Δ the particle can touch the wall.

    ``ends`` receives the greatest length of Δ at which the particle can touch the wall. The length is at most ``most``, and 0 if
    the particle can never touch the wall. The kernel allows all directions of Δ that differ from ``angle`` by at most half of
    ``step``. ``turns`` receives the angles of the wall reactions without friction, for the direction ``angle``.
    """
    normals, reaches, walls = model.normals, model.reaches, model.normals.shape[0]
    ray = np.array([np.cos(angle), np.sin(angle)])
    delta = np.empty(2)
    for wall in range(walls):
        height = dot(normals[wall], ray)
        across = ray[0] * normals[wall, 1] - ray[1] * normals[wall, 0]
        for toucher in range(2):
            sign = 1.0 if toucher == 0 else -1.0
            row = 2 * wall + toucher
            ends[row] = 0.0
            if sign * height <= 0:
                continue
            turns[row] = np.arctan2(sign * across, sign * height)  # angle from -Δ to -sign N, or from Δ to sign N
            inner, outer = 0.0, most
            for halving in range(HALVINGS):
                middle = outer if halving == 0 else (inner + outer) / 2
                delta[:] = middle * ray
                near = step * middle
                low, high = contact_range(delta, sign, wall, model, -near - reaches[wall], reaches[wall] + near, -near)
                if low <= high:
                    inner = middle
                else:
                    outer = middle
                if inner == outer:
                    break
            ends[row] = outer


@kernel
def carried(radius, side, step, most, ends, turns, cone):
    """Return the largest length of the position difference Δ after wall reactions turn Δ by one step, and before this turn.

    At first, the length of Δ is at most ``radius``. Before the turn, wall reactions may already increase this length, but not if
    all possible wall reactions point into one half-plane.
    """
    rows = ends.shape[0]
    before = radius
    for row in range(rows):
        if ends[row] > before:
            low, high = spread_at(ends[row], ends, turns, cone)
            if high - low > np.pi + FLAT:
                before = min(ends[row], most)
    after = 0.0
    for row in range(rows + 1):  # at the lengths on the ray where a particle loses touch with a wall, and at ``before``
        place = before if row == rows else ends[row]
        if not 0 < place <= before:
            continue
        low, high = spread_at(place, ends, turns, cone)
        way = -low if side > 0 else high  # a reaction on one side of -Δ turns Δ to the other side
        if way > 0:
            after = max(after, most if way + step >= np.pi else place * np.sin(way) / np.sin(way + step))
    return after, before


@kernel
def spread_at(place, ends, turns, cone):
    """Return the smallest and the largest angle of the wall reactions on a position difference of length ``place``."""
    low, high = np.inf, -np.inf
    for row in range(ends.shape[0]):
        if ends[row] >= place:
            low, high = min(low, turns[row] - cone), max(high, turns[row] + cone)
    return low, high


@kernel
def kept_out(start, radius, angles, farthest, model, first, last, goal):
    """Return whether wall reactions can never bring the position difference to the length ``goal`` at any of the given angles.

    The array ``angles`` ascends over the full circle. The given angles have the indices from ``first`` to ``last`` in this array.
    At the start, the position difference has the angle with the index ``start`` and the length ``radius``. Between two neighbouring
    angles in ``angles``, the position difference is never parallel to a wall. The array ``farthest`` contains the largest possible
    length of the position difference at each angle. The result is also False if the computation does not converge.
    """
    count, rows, cone = angles.shape[0], 2 * model.normals.shape[0], np.arctan(model.friction)
    ends, turns, steps = np.empty((count, rows)), np.empty((count, rows)), np.empty(count)
    for k in range(count):
        steps[k] = (angles[(k + 1) % count] - angles[k]) % (2 * np.pi)
        most = max(farthest[k], farthest[(k + 1) % count])
        touchable(angles[k] + steps[k] / 2, steps[k], most, model, ends[k], turns[k])
    radii = np.zeros(count)
    radii[start] = radius
    for _sweep in range(SWEEPS):
        settled = True
        for side in (1, -1):
            for turn in range(count):
                k = (start + side * turn) % count
                if radii[k] <= 0:
                    continue
                following = (k + side) % count
                cell = k if side > 0 else following
                after, before = carried(radii[k], side, steps[cell], farthest[k], ends[cell], turns[cell], cone)
                after = min(after, farthest[following])
                if before > radii[k] * (1 + SAME) or after > radii[following] * (1 + SAME):
                    settled = False
                radii[k], radii[following] = max(before, radii[k]), max(after, radii[following])
            for k in range(first, last + 1):
                if radii[k % count] >= goal:
                    return False
        if settled:
            return True
    return False
