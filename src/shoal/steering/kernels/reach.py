"""The sets of position differences that cycles of contacts reach in a polygon, in compiled code.

Each cycle makes a union of convex sets, and each of these sets contains the zero vector. Thus the
union is a star: for each direction, a radius says how far the set extends from zero.
"""

from __future__ import annotations

from math import atan2, inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.steering.kernels.contact import dot

FLAT = 1e-12  # a wall and a direction with a smaller sine count as parallel
SAME = 1e-9  # in radians: directions that differ by less count as one


class WallSamples(NamedTuple):
    """A polygon, and sample points on its sides, in counter-clockwise order."""

    corners: NDArray[np.float64]  # (sides, 2)
    normals: NDArray[np.float64]  # (sides, 2): inward
    offsets: NDArray[np.float64]  # (sides,)
    contacts: NDArray[np.float64]  # (contacts, 2)
    firsts: NDArray[np.int64]  # (sides + 1,): the first contact of each side, and their number


@in_place_kernel
def cross(ax, ay, bx, by):
    return ax * by - ay * bx


@in_place_kernel
def star_radii(rays, samples, depths, radii, pieces):
    """Write to ``radii`` how far the differences after a cycle extend along each unit vector of
    ``rays``, and to ``pieces`` the index of the convex set that extends so far, or -1.

    While the toucher is at a contact, the depth is the distance of the other particle from the line
    of the contact's wall. The array ``depths``, shape (2, contacts), holds the largest depths
    before the cycle, for each toucher; a depth is -1 if the contact is impossible. From a contact,
    the other particle reaches all points of the polygon that are no deeper than it was. Between two
    neighbouring contacts, the smaller of their two depths counts. The set with the index 2 (t n +
    k) + b belongs to the toucher t and, of n contacts, to the contact k (b = 0) or to all contacts
    between k and k + 1 (b = 1).
    """
    for i in range(rays.shape[0]):
        radii[i], pieces[i] = 0.0, -1
        for toucher in range(2):
            sign = 1.0 if toucher == 0 else -1.0
            radius, index = widest(
                sign * rays[i, 0], sign * rays[i, 1], samples, depths[toucher], radii[i]
            )
            if index >= 0:
                radii[i] = radius
                pieces[i] = index + 2 * toucher * depths.shape[1]


@in_place_kernel
def widest(across, up, samples, depths, least):
    """Return how far the other particle can move in a direction from a contact of the toucher, and
    the index of the convex set that allows it; -1 if no set allows more than ``least``.

    The walls that the ray can start from, and the walls that it can end at, are two chains. Their
    points are met in the same order by a line parallel to the ray, so one pass suffices.
    """
    corners, normals, firsts = samples.corners, samples.normals, samples.firsts
    sides = normals.shape[0]
    wall = 0  # the first wall of the chain that rays start from
    while across * normals[wall, 0] + up * normals[wall, 1] >= -FLAT:
        wall += 1
    while across * normals[wall, 0] + up * normals[wall, 1] < -FLAT:
        wall = wall + 1 if wall + 1 < sides else 0
    end = wall - 1 if wall > 0 else sides - 1
    rate = -(across * normals[end, 0] + up * normals[end, 1])
    beside = across * corners[end, 1] - up * corners[end, 0]
    best, index = least, -1
    slope = across * normals[wall, 0] + up * normals[wall, 1]
    while slope >= -FLAT:
        previous = peak = 0.0
        for k in range(firsts[wall], firsts[wall + 1]):
            point = samples.contacts[k]
            place = across * point[1] - up * point[0]
            while beside > place:
                following = end - 1 if end > 0 else sides - 1
                further = -(across * normals[following, 0] + up * normals[following, 1])
                if further <= FLAT:
                    break
                if slope > FLAT:  # the ray that ends in the corner between two walls
                    clear = dot(normals[wall], corners[end]) - samples.offsets[wall]
                    peak = max(peak, clear / slope)
                end, rate = following, further
                beside = across * corners[end, 1] - up * corners[end, 0]
            distance = max((dot(normals[end], point) - samples.offsets[end]) / rate, 0.0)
            if depths[k] >= 0:
                radius = min(distance, depths[k] / slope) if slope > FLAT else distance
                if radius > best:
                    best, index = radius, 2 * k
                if k > firsts[wall] and depths[k - 1] >= 0:
                    radius = max(distance, previous, peak)
                    if slope > FLAT:
                        radius = min(radius, min(depths[k - 1], depths[k]) / slope)
                    if radius > best:
                        best, index = radius, 2 * k - 1
            previous, peak = distance, 0.0
        wall = wall + 1 if wall + 1 < sides else 0
        slope = across * normals[wall, 0] + up * normals[wall, 1]
    return best, index


@in_place_kernel
def piece_radii(rays, pieces, lasts, samples, depths, radii):
    """Write to ``radii`` how far the convex set with each index of ``pieces``, as in `star_radii`,
    extends along the unit vector in the same row of ``rays``.

    The set with the odd index 2 k + 1 belongs to all contacts from k to ``lasts[k]``.
    """
    count, sides = depths.shape[1], samples.normals.shape[0]
    for i in range(rays.shape[0]):
        radii[i] = 0.0
        if pieces[i] < 0:
            continue
        toucher, first = divmod(pieces[i] // 2, count)
        last = lasts[pieces[i] // 2] if pieces[i] % 2 else first
        sign = 1.0 if toucher == 0 else -1.0
        across, up = sign * rays[i, 0], sign * rays[i, 1]
        wall = 0
        while samples.firsts[wall + 1] <= first:
            wall += 1
        slope = across * samples.normals[wall, 0] + up * samples.normals[wall, 1]
        if slope < -FLAT:
            continue
        far = 0.0
        for k in range(first, last + 1):
            distance = inf
            for other_wall in range(sides):
                rate = -(
                    across * samples.normals[other_wall, 0] + up * samples.normals[other_wall, 1]
                )
                if rate > FLAT:
                    clear = dot(samples.normals[other_wall], samples.contacts[k])
                    distance = min(distance, max((clear - samples.offsets[other_wall]) / rate, 0.0))
            far = max(far, distance)
        if slope > FLAT:
            begin, end = samples.contacts[first], samples.contacts[last]
            ends = across * begin[1] - up * begin[0], across * end[1] - up * end[0]
            for k in range(sides):
                place = across * samples.corners[k, 1] - up * samples.corners[k, 0]
                if ends[1] < place < ends[0]:
                    clear = dot(samples.normals[wall], samples.corners[k])
                    far = max(far, (clear - samples.offsets[wall]) / slope)
            far = min(far, min(depths[toucher, first], depths[toucher, last]) / slope)
        radii[i] = far


@in_place_kernel
def star_depths(rays, radii, samples, depths):
    """Write to ``depths``, shape (contacts,), the largest depth of the other particle at each
    contact of particle 1, if the position difference is any of a star's.

    The star's outline has the corners ``radii * rays``; the unit vectors ``rays`` are in
    counter-clockwise order from the angle -π. At a contact, the position difference must also be in
    the polygon as seen from the contact, which is another star. The largest depth occurs at a
    corner of one star inside the other, or where the two outlines cross, so one pass around both
    outlines suffices.
    """
    corners, normals = samples.corners, samples.normals
    sides, count = corners.shape[0], rays.shape[0]
    for wall in range(sides):
        nx, ny = normals[wall, 0], normals[wall, 1]
        for k in range(samples.firsts[wall], samples.firsts[wall + 1]):
            cx, cy = samples.contacts[k, 0], samples.contacts[k, 1]
            corner, corners_left = wall + 1, sides - 1
            # A contact in a corner of the polygon does not see this corner.
            if k == samples.firsts[wall]:
                corners_left -= 1
            elif k == samples.firsts[wall + 1] - 1:
                corner, corners_left = corner + 1, corners_left - 1
            bx, by = corners[corner % sides, 0] - cx, corners[corner % sides, 1] - cy
            ray = starting_ray(atan2(by, bx) - SAME, rays)
            ex, ey = radii[ray] * rays[ray, 0], radii[ray] * rays[ray, 1]
            ray = ray + 1 if ray + 1 < count else 0
            fx, fy = radii[ray] * rays[ray, 0], radii[ray] * rays[ray, 1]
            share = ray_share(bx, by, ex, ey, fx, fy)
            inside = share <= 1.0  # whether the star is inside the polygon in this direction
            best = max(min(share, 1.0) * (nx * bx + ny * by), 0.0)
            ax, ay = bx, by
            corner += 1
            bx, by = corners[corner % sides, 0] - cx, corners[corner % sides, 1] - cy
            while corners_left > 0:
                ux, uy = rays[ray, 0], rays[ray, 1]
                # whether the star's corner comes before the polygon's corner
                first = cross(ux, uy, bx, by) >= -SAME * sqrt(bx * bx + by * by)
                if first:
                    far = ray_share(ux, uy, ax, ay, bx, by)
                    was, inside = inside, radii[ray] <= far
                    depth = min(radii[ray], far) * (nx * ux + ny * uy)
                else:
                    share = ray_share(bx, by, ex, ey, fx, fy)
                    was, inside = inside, share <= 1.0
                    depth = min(share, 1.0) * (nx * bx + ny * by)
                best = max(best, depth)
                if was != inside:
                    sx, sy, tx, ty = fx - ex, fy - ey, bx - ax, by - ay
                    turn = cross(sx, sy, tx, ty)
                    if turn != 0:
                        along = cross(ax - ex, ay - ey, tx, ty) / turn
                        across = cross(ax - ex, ay - ey, sx, sy) / turn
                        if 0 <= along <= 1 and 0 <= across <= 1:
                            best = max(best, nx * (ex + along * sx) + ny * (ey + along * sy))
                if first:
                    ex, ey = fx, fy
                    ray = ray + 1 if ray + 1 < count else 0
                    fx, fy = radii[ray] * rays[ray, 0], radii[ray] * rays[ray, 1]
                else:
                    ax, ay = bx, by
                    corner, corners_left = corner + 1, corners_left - 1
                    bx, by = corners[corner % sides, 0] - cx, corners[corner % sides, 1] - cy
            depths[k] = best


@in_place_kernel
def starting_ray(angle, rays):
    """Return the index of the last unit vector whose angle is at most ``angle``."""
    low, high = 0, rays.shape[0]
    while low < high:
        middle = (low + high) // 2
        if atan2(rays[middle, 1], rays[middle, 0]) <= angle:
            low = middle + 1
        else:
            high = middle
    return low - 1 if low > 0 else rays.shape[0] - 1


@in_place_kernel
def ray_share(ux, uy, ax, ay, bx, by):
    """Return how many times the vector u fits between zero and the line from the point a to the
    point b, which is ahead; 0 if the line points to zero.
    """
    x, y = bx - ax, by - ay
    rate = cross(ux, uy, x, y)
    if rate <= 0 or rate * rate <= (FLAT * FLAT) * (ux * ux + uy * uy) * (x * x + y * y):
        return 0.0
    return max(cross(ax, ay, bx, by) / rate, 0.0)
