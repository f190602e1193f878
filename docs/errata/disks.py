"""Errata of paper W about two particles on a disk: sections IV.E, IV.F and VI."""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

from .checking import Check, into

CHECKS: list[Check] = []
erratum = into(CHECKS)

Vector = NDArray[np.float64]


def _unit(angle: float | Vector) -> Vector:
    """Return the unit vectors e(ψ) = (cos ψ, sin ψ) for angles ψ in radians; float64, shape (...,
    2).
    """
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _pairs(rng: np.random.Generator, count: int, radius: float) -> Vector:
    """Return random pairs of points in a disk around the origin; float64, shape (count, 2, 2)."""
    return (
        radius
        * np.sqrt(rng.uniform(0, 1, (count, 2, 1)))
        * _unit(rng.uniform(0, 2 * pi, (count, 2)))
    )


@erratum(
    "paper W, section IV.E, eq. 2",
    "the contact points of particle 1 lie around the angle θ = arctan((p1.x - p2.x) / (p1.y -"
    " p2.y)), where p1 and p2 are the positions of the particles",
    "the contact points of particle 1 lie around the angle θ = atan2(p1.y - p2.y, p1.x - p2.x), the"
    " direction from p2 to p1. The contact points of particle 2 lie around the angle θ + π",
    "for 20,000 pairs of positions with a random contact point of particle 1, a program tests"
    " whether particle 2 is inside the disk",
)
def _contacts() -> tuple[str, bool]:
    rng, r = np.random.default_rng(2), 0.5
    pairs, angles = _pairs(rng, 20_000, r), rng.uniform(0, 2 * pi, 20_000)
    apart = pairs[:, 1] - pairs[:, 0]
    inside = np.hypot(*(r * _unit(angles) + apart).T) <= r
    half = pi / 2 - np.arcsin(np.hypot(*apart.T) / (2 * r))
    agree = []
    for theta in (np.arctan2(-apart[:, 1], -apart[:, 0]), np.arctan2(-apart[:, 0], -apart[:, 1])):
        told = np.abs((angles - theta + pi) % (2 * pi) - pi) <= half
        agree.append(float(np.mean(told == inside)))
    found = (
        f"the corrected equation is right in {100 * agree[0]:.2f} % and the printed equation in"
        f" {100 * agree[1]:.2f} % of the cases"
    )
    return found, agree[0] == 1 and agree[1] < 0.9


@erratum(
    "paper W, section IV.E, eq. 3",
    "the chord around the contact angle ψ extends over the angles ψ ± γ/2",
    "the chord around the contact angle ψ extends over the angles ψ ± γ, because γ is already half"
    " of the angle of the chord",
    "a program computes the distances of two points of the circle from the chord. The two points"
    " lie on the circle at the angles γ and γ/2 from the contact point",
)
def _half_angle() -> tuple[str, bool]:
    r, depth = 0.5, 0.2  # depth: distance of the chord from the contact point
    gamma = float(np.arccos((r - depth) / r))
    off = [abs(r * np.cos(angle) - (r - depth)) for angle in (gamma, gamma / 2)]
    return (
        (
            f"on a disk of diameter 1, the distance from the chord is {off[0]:.1e} at the angle γ"
            f" and {off[1]:.3f} at the angle γ/2"
        ),
        off[0] < 1e-12 < off[1],
    )


@erratum(
    "paper W, section IV.E, eq. 4",
    "when particle 1 touches the wall of a disk at the point p_ψ, the distance of particle 2 from"
    " the tangent is d⊥ = 2 ‖s1·p_ψ - s2·p_ψ‖, where s1 and s2 are the start positions",
    "the distance of particle 2 from the tangent is d⊥ = |(s1 - s2)·e(ψ)|, where e(ψ) = (cos ψ, sin"
    " ψ). The length of the vector p_ψ is the radius r of the disk, so the printed formula needs"
    " the factor 1/r in place of 2. The printed factor 2 is right only for a disk of radius r = ½",
    "a program computes the distance of particle 2 from the tangent directly from the positions,"
    " for 1000 pairs of positions on disks of radius r = 0.5 and r = 1",
)
def _depth() -> tuple[str, bool]:
    rng, worst = np.random.default_rng(3), {}
    for r in (0.5, 1.0):
        pairs = _pairs(rng, 1000, r)
        apart = pairs[:, 1] - pairs[:, 0]
        half = np.arccos(np.clip(np.hypot(*apart.T) / (2 * r), -1, 1))
        # e: directions in which particle 1 can touch the wall
        e = _unit(np.arctan2(-apart[:, 1], -apart[:, 0]) + half * rng.uniform(-1, 1, 1000))
        depth = r - np.sum((r * e + apart) * e, axis=1)
        corrected = np.abs(np.sum(apart * e, axis=1))
        printed = 2 * np.abs(
            np.sum(pairs[:, 0] * (r * e), axis=1) - np.sum(pairs[:, 1] * (r * e), axis=1)
        )
        worst[r] = float(np.abs(corrected - depth).max()), float(np.abs(printed - depth).max())
    found = "; ".join(
        f"for a disk of radius r = {r:g}, the largest error of the distance is {a:.0e} for the"
        f" corrected equation and {b:.2g} for the printed equation"
        for r, (a, b) in worst.items()
    )
    return found, max(worst[0.5][0], worst[0.5][1], worst[1.0][0]) < 1e-12 and worst[1.0][1] > 0.5


def _lines(distance: float, r: float, *, printed: bool) -> list[Vector]:
    """Return the lines l1 to l4 of equation 6 for Δ = (distance, 0), if particle 1 touches the
    wall; float64, shape (n, 2) each.

    With ``printed``, the lines have the sign of the printed equation.
    """
    half = float(np.arccos(distance / (2 * r)))
    low, high = pi - half, pi + half  # equation 2, corrected: θ = π
    along = np.linspace(low, high, 2001)
    gamma = np.arccos(1 - distance * np.abs(np.cos(along)) / r)  # 3 and 4, corrected
    first, last = np.linspace(0, gamma[0], 501), np.linspace(-gamma[-1], 0, 501)
    at = [np.full(len(first), low), np.full(len(last), high), along, along]
    lines = [
        r * (_unit(psi + turn) - _unit(psi))
        for psi, turn in zip(at, (first, last, gamma, -gamma), strict=True)
    ]
    return [-line for line in lines] if printed else lines


def _way_out(lines: list[Vector], ahead: Vector) -> float:
    """Return the distance from 0 to the farthest crossing of the lines with the ray in the
    direction ``ahead``.
    """
    furthest = 0.0
    for line in lines:
        side, far = line @ np.array([-ahead[1], ahead[0]]), line @ ahead
        for k in np.flatnonzero(side[:-1] * side[1:] <= 0):
            share = side[k] / (side[k] - side[k + 1]) if side[k] != side[k + 1] else 0.0
            furthest = max(furthest, float(far[k] + share * (far[k + 1] - far[k])))
    return furthest


@erratum(
    "paper W, section IV.E, eq. 6",
    "the lines l = r (cos ψ - cos(ψ + γ) + sin ψ - sin(ψ + γ)) bound the set of differences that"
    " two moves reach. A point of a line must be a vector, but the printed l is a number. The"
    " printed line l2 belongs to the angles γ(ψ_max) < γ < 0",
    "the points of the bounding lines are the vectors l = r (e(ψ + a) - e(ψ)), where e(ψ) = (cos ψ,"
    " sin ψ). The corrected line l2 belongs to the angles -γ(ψ_max) < a < 0",
    "for the initial difference Δ = (0.3, 0), a program computes the distance from 0 to the"
    " bounding lines, in 45 directions. In each of the 45 directions, a bisection with the exact"
    " condition for two moves gives the true distance from 0 to the bounding line",
)
def _outline() -> tuple[str, bool]:
    from shoal.steering import disk, reached_in_two_moves

    r, distance = 0.5, 0.3
    lines, wrong = _lines(distance, r, printed=False), _lines(distance, r, printed=True)
    off = [0.0, 0.0]
    for ahead in _unit((np.arange(45) + 0.5) * 2 * pi / 45):
        low, high = 0.0, 2 * r
        # the reachable set contains 0, and each point between 0 and a reachable difference
        for _ in range(24):
            middle = (low + high) / 2
            low, high = (
                (low, middle)
                if reached_in_two_moves(disk(r), (distance, 0), middle * ahead) is None
                else (middle, high)
            )
        off = [
            max(worst, abs(_way_out(made, ahead) - low))
            for worst, made in zip(off, (lines, wrong), strict=True)
        ]
    found = (
        f"the largest error of the distance is {off[0]:.1e} for the corrected lines, and"
        f" {off[1]:.2f} for the printed lines (as vectors)"
    )
    return found, off[0] < 1e-4 and off[1] > 0.1


@erratum(
    "paper W, section IV.E, eq. 7",
    "while the wall of a disk of radius r holds particle 1 at the point r e, a move can reach the"
    " difference Δg if ‖Δg - C‖² ≥ r² and (Δg - C)·e ≤ r cos γ, where C = -r e. In equation 7, γ is"
    " the half angle of the chord through particle 2",
    "both inequalities must be reversed: a move can reach the difference Δg if ‖Δg - C‖² ≤ r² and"
    " (Δg - C)·e ≥ r cos γ",
    "a program simulates 2000 pairs of moves with random contact points",
)
def _inequalities() -> tuple[str, bool]:
    from shoal.steering import ContactWorld, disk

    world, rng, r = ContactWorld(disk()), np.random.default_rng(1), 0.5
    corrected, reversed_, count = 0, 0, 0
    while count < 2000:
        angle, other = rng.uniform(0, 2 * pi), rng.uniform(-r, r, 2)
        e = np.array([np.cos(angle), np.sin(angle)])
        if np.linalg.norm(other) > 0.98 * r:
            continue
        depth = float((r * e - other) @ e)  # of particle 2 below the wall that holds particle 1
        push = rng.uniform(-1, 1, 2)
        if push @ e < 0:
            continue  # a push away from the wall would move particle 1
        state = world.step(np.stack([r * e, other]), push)
        delta, centre = state[1] - state[0], -r * e
        inside = float((delta - centre) @ (delta - centre)) <= r * r + 1e-9
        # r cos γ, γ the half angle of the chord at that depth
        above = float((delta - centre) @ e) >= (r - depth) - 1e-9
        corrected += inside and above
        reversed_ += not inside and not above
        count += 1
    found = (
        f"the corrected inequalities hold in {corrected} of {count} cases, and the printed"
        f" inequalities in {reversed_} cases"
    )
    return found, corrected == count and reversed_ == 0


@erratum(
    "paper W, section IV.E, eq. 8",
    "the first move must lead particle 1 to the wall at the angle ψ = arctan(w.x / w.y), where w ="
    " Δp - Δg is the initial difference minus the desired difference",
    "the first move must lead particle 1 to the wall at the angle ψ = atan2(w.x, -w.y) or ψ + π."
    " The wall at the corrected angle ψ is parallel to w, and not to the mirror image of w",
    "a program simulates plans for 500 goals. In each of the 500 plans, particle 1 first moves to"
    " the wall at the angle ψ, and particle 2 then moves parallel to the wall",
)
def _contact_of_a_chord() -> tuple[str, bool]:
    from shoal.steering import ContactWorld, disk

    world, rng, r = ContactWorld(disk()), np.random.default_rng(5), 0.5
    reached, tried = [0, 0], 0
    while tried < 500:
        start, psi = _pairs(rng, 1, r)[0], rng.uniform(0, 2 * pi)
        apart = start[1] - start[0]
        there = r * _unit(psi) + apart
        push = rng.uniform(-1, 1) * _unit(psi + pi / 2)
        if max(np.hypot(*there), np.hypot(*(there + push))) > 0.99 * r:
            continue  # particle 2 is outside, or too near to the wall for the tolerance of contacts
        tried += 1
        w = -push
        for k, (y, x) in enumerate(((w[0], -w[1]), (w[0], w[1]))):
            angle = np.arctan2(y, x)
            ways = (
                world.play(start, [r * _unit(a) - start[0], push])[-1] for a in (angle, angle + pi)
            )
            reached[k] += any(np.hypot(*(end[1] - end[0] - apart - push)) < 1e-9 for end in ways)
    found = (
        f"with the corrected angle, plans reach {reached[0]} of {tried} goals, and with the printed"
        f" angle {reached[1]} of {tried} goals"
    )
    return found, reached[0] == tried > 2 * reached[1]


@erratum(
    "paper W, section IV.F",
    "two moves on a disk reach at most 0.373 of the Δ configuration space, if the particles start"
    " about 0.81 diameters apart",
    "two moves on a disk reach at most 0.377 of the Δ configuration space, if the particles start"
    " about 0.82 diameters apart",
    "a program computes the share of the Δ configuration space that two moves reach, and the"
    " maximum of this share over all distances at the start",
)
def _most() -> tuple[str, bool]:
    from shoal.papers.steering.figures import largest_two_move_fraction

    at, most = largest_two_move_fraction()
    return (
        f"the maximum share is {most:.4f}, for particles that start {at:.2f} diameters apart",
        most > 0.3765 and abs(at - 0.8175) < 0.005,
    )


@erratum(
    "paper W, Fig. 15",
    "the remaining distance from the goals falls as 8.66 / length³, where length is the length of"
    " the plan in diameters",
    "the printed law holds only if particle 2 always touches the wall. If the particle nearer to"
    " its contact point touches the wall, a plan of half the printed length brings the particles"
    " within 0.01 diameters of the goals",
    "a program computes plans in which particle 2 always touches the wall, cycle by cycle. The"
    " program computes plans in which the particle nearer to its contact point touches the wall",
)
def _law() -> tuple[str, bool]:
    from shoal.papers.steering.figures import swap_antipodes

    second, nearer = (swap_antipodes(toucher=who).length_to(0.01) for who in ("second", "nearer"))
    found = (
        f"for a remaining distance of 0.01 diameters, a plan needs {second:.1f} diameters if"
        f" particle 2 touches, and {nearer:.1f} diameters if the nearer particle touches; the"
        f" printed law gives {(8.66 / 0.01) ** (1 / 3):.1f} diameters"
    )
    return found, nearer < 0.6 * second
