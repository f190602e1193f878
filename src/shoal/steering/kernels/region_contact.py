"""Motion of one particle in a region of any shape for one straight move of the shared input."""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.steering.kernels.contact import PUSHED, TOUCH

# fraction of the region's size: extension of edges, so that no particle passes between two edges
GAP = 1e-12
EVENTS = 256  # most contacts of one slide


class Edges(NamedTuple):
    """The boundary of a region."""

    ends: NDArray[np.float64]  # (edges, 4): x and y of both ends, the free side on the left
    normals: NDArray[np.float64]  # (edges, 2): inward
    lengths: NDArray[np.float64]  # (edges,)
    links: NDArray[np.int64]  # (edges, 2): the edge before and the edge after
    reflex: NDArray[np.bool_]  # (edges,): whether the corner at the beginning bends inward
    size: float  # of the region; a particle touches an edge within TOUCH times the size
    boxes: NDArray[np.float64]
    """(groups, 4): smallest x, largest x, smallest y and largest y of consecutive edges. If a path
    is far from a box, the edges in the box need no test."""
    pushed: float = PUSHED
    """Fraction of a move: an edge holds a particle unless the move leads off it by more."""
    friction: float = inf


@in_place_kernel
def signed_distance(x, y, edge, edges):
    """Return the signed distance of a point from the line of an edge, positive on the free side."""
    ends, normals = edges.ends, edges.normals
    return normals[edge, 0] * (x - ends[edge, 0]) + normals[edge, 1] * (y - ends[edge, 1])


@in_place_kernel
def place_along(x, y, edge, edges):
    """Return the position of a point along an edge, measured from the beginning of the edge."""
    ends, normals = edges.ends, edges.normals
    return normals[edge, 1] * (x - ends[edge, 0]) - normals[edge, 0] * (y - ends[edge, 1])


@in_place_kernel
def is_on(x, y, edge, edges, touch):
    """Return whether the distance of a point from an edge is at most ``touch``."""
    away = signed_distance(x, y, edge, edges)
    if abs(away) > touch:
        return False
    place = place_along(x, y, edge, edges)
    beyond = max(-place, place - edges.lengths[edge], 0.0)
    return away * away + beyond * beyond <= touch * touch


@in_place_kernel
def pushes(move, edge, edges, length):
    """Return whether a move leads towards an edge or along the edge."""
    normals = edges.normals
    return normals[edge, 0] * move[0] + normals[edge, 1] * move[1] <= edges.pushed * length


@in_place_kernel
def is_excused(x, y, move, length, edge, end, edges, touch):
    """Return whether the other edge of a reflex corner releases a particle that the edge ``edge``
    would hold. The corner is at the beginning of the edge if ``end`` is 0, else at its end.

    A reflex corner has more than 180 degrees of free space. At the corner, the other edge releases
    the particle if the move leads away from the other edge. Near the corner, the wall between the
    two edges may be thinner than ``touch``, and only the edge on the particle's side can hold the
    particle.
    """
    neighbour = edges.links[edge, end]
    if not edges.reflex[edge if end == 0 else neighbour]:
        return False
    corner_x, corner_y = edges.ends[edge, 2 * end], edges.ends[edge, 2 * end + 1]
    if (x - corner_x) ** 2 + (y - corner_y) ** 2 <= touch * touch:
        return not pushes(move, neighbour, edges, length)
    if not is_on(x, y, neighbour, edges, touch):
        return False
    return signed_distance(x, y, neighbour, edges) > signed_distance(x, y, edge, edges)


@in_place_kernel
def edges_near(run, x, y, x_after, y_after, near, edges):
    """Return the index range (first, last + 1) of a group of edges, or (0, 0) if a path is farther
    than ``near`` from the group.
    """
    boxes, count = edges.boxes, edges.ends.shape[0]
    size = -(-count // boxes.shape[0])
    if min(x, x_after) - near > boxes[run, 1] or max(x, x_after) + near < boxes[run, 0]:
        return 0, 0
    if min(y, y_after) - near > boxes[run, 3] or max(y, y_after) + near < boxes[run, 2]:
        return 0, 0
    return run * size, min((run + 1) * size, count)


@in_place_kernel
def is_held(point, move, edges):
    """Return whether an edge that a particle touches prevents a move."""
    x, y, touch = point[0], point[1], TOUCH * edges.size
    length = sqrt(move[0] ** 2 + move[1] ** 2)
    for run in range(edges.boxes.shape[0]):
        first, last = edges_near(run, x, y, x, y, touch, edges)
        for edge in range(first, last):
            if not pushes(move, edge, edges, length) or not is_on(x, y, edge, edges, touch):
                continue
            if not (
                is_excused(x, y, move, length, edge, 0, edges, touch)
                or is_excused(x, y, move, length, edge, 1, edges, touch)
            ):
                return True
    return False


@in_place_kernel
def first_edge(point, move, edges):
    """Return how much of a move a free particle makes before it meets an edge, the edge's index,
    and the position along the edge.

    If the particle meets no edge, the index is -1. An edge that the particle touches at the start
    does not stop the particle. A reflex corner (more than 180 degrees of free space) on the path
    does not stop the particle if one of the corner's two edges lets the particle continue.
    """
    lengths, links, reflex = edges.lengths, edges.links, edges.reflex
    x, y, touch = point[0], point[1], TOUCH * edges.size
    length = sqrt(move[0] ** 2 + move[1] ** 2)
    share, met, along = 1.0, -1, 0.0
    for run in range(edges.boxes.shape[0]):
        first, last = edges_near(run, x, y, x + share * move[0], y + share * move[1], touch, edges)
        for edge in range(first, last):
            speed = edges.normals[edge, 0] * move[0] + edges.normals[edge, 1] * move[1]
            away = signed_distance(x, y, edge, edges)
            # A particle behind the line of an edge cannot meet the edge's free side; ``touch``
            # allows for rounding.
            if (
                speed >= 0
                or away > -speed * share
                or away < -touch
                or is_on(x, y, edge, edges, touch)
            ):
                continue
            reached = max(away / -speed, 0.0)
            place = place_along(x + reached * move[0], y + reached * move[1], edge, edges)
            if place < -GAP * edges.size or place > lengths[edge] + GAP * edges.size:
                continue
            if reflex[edge] and place < touch and not pushes(move, links[edge, 0], edges, length):
                continue
            if (
                reflex[links[edge, 1]]
                and place > lengths[edge] - touch
                and not pushes(move, links[edge, 1], edges, length)
            ):
                continue
            share, met, along = reached, edge, min(max(place, 0.0), lengths[edge])
    return share, met, along


@in_place_kernel
def slide_at(point, move, edges):
    """Return the edge along which a particle slides, and its displacement per unit of input.

    The edge is -1 if the particle is free, and -2 if edges hold the particle. A particle that is pushed into an edge slides by ``along - friction * into``.
    """
    x, y, touch = point[0], point[1], TOUCH * edges.size
    length = sqrt(move[0] ** 2 + move[1] ** 2)
    least = PUSHED * length
    if not is_held(point, move, edges):
        return -1, (move[0], move[1])
    for run in range(edges.boxes.shape[0]):
        first, last = edges_near(run, x, y, x, y, touch, edges)
        for edge in range(first, last):
            if not pushes(move, edge, edges, length) or not is_on(x, y, edge, edges, touch):
                continue
            normal_x, normal_y = edges.normals[edge, 0], edges.normals[edge, 1]
            into = -(normal_x * move[0] + normal_y * move[1])
            along = normal_y * move[0] - normal_x * move[1]
            speed = abs(along) - edges.friction * max(into, 0.0)
            place = place_along(x, y, edge, edges)
            length_ahead = edges.lengths[edge] - place if along > 0 else place
            if speed <= least or length_ahead <= touch:
                continue
            speed = speed if along > 0 else -speed
            velocity = (speed * normal_y, -speed * normal_x)
            if not is_blocked_along(x, y, velocity, edge, edges, touch):
                return edge, velocity
    return -2, (0.0, 0.0)


@in_place_kernel
def is_blocked_along(x, y, velocity, sliding, edges, touch):
    """Return whether an edge that a particle touches, other than ``sliding``, is in the way."""
    length = sqrt(velocity[0] ** 2 + velocity[1] ** 2)
    for run in range(edges.boxes.shape[0]):
        first, last = edges_near(run, x, y, x, y, touch, edges)
        for edge in range(first, last):
            if edge == sliding or not is_on(x, y, edge, edges, touch):
                continue
            speed = edges.normals[edge, 0] * velocity[0] + edges.normals[edge, 1] * velocity[1]
            if (
                speed < -PUSHED * length
                and not is_excused(x, y, velocity, length, edge, 0, edges, touch)
                and not is_excused(x, y, velocity, length, edge, 1, edges, touch)
            ):
                return True
    return False


@in_place_kernel
def advance_with_friction(point, move, edges):
    """Move one particle in place, with Coulomb friction. Return the fraction of the input after
    which an edge first held or braked the particle, or 1.
    """
    ends, normals = edges.ends, edges.normals
    remaining, free_until = 1.0, -1.0
    for _event in range(EVENTS):
        edge, velocity = slide_at(point, move, edges)
        if edge != -1 and free_until < 0:
            free_until = 1.0 - remaining
        if edge == -2:
            break
        velocity = (remaining * velocity[0], remaining * velocity[1])
        share, met, along = first_edge(point, velocity, edges)
        if edge >= 0:  # a slide also stops at the end of its edge
            place = place_along(point[0], point[1], edge, edges)
            speed = normals[edge, 1] * velocity[0] - normals[edge, 0] * velocity[1]
            length_ahead = edges.lengths[edge] - place if speed > 0 else place
            if length_ahead < abs(speed) * share:
                share, met = length_ahead / abs(speed), edge
                along = edges.lengths[edge] if speed > 0 else 0.0
        if met >= 0:
            point[0] = ends[met, 0] + along * normals[met, 1]
            point[1] = ends[met, 1] - along * normals[met, 0]
            remaining *= 1.0 - share
            continue
        point[0] += velocity[0]
        point[1] += velocity[1]
        if edge >= 0:
            away = signed_distance(point[0], point[1], edge, edges)
            point[0] -= away * normals[edge, 0]
            point[1] -= away * normals[edge, 1]
        break
    return 1.0 if free_until < 0 else free_until


@in_place_kernel
def advance(point, move, edges):
    """Move one particle in place. Return the fraction of the input after which an edge stopped it,
    or 1 if no edge stopped it.
    """
    if move[0] == 0 and move[1] == 0:
        return 1.0
    if edges.friction < inf:
        return advance_with_friction(point, move, edges)
    ends, normals = edges.ends, edges.normals
    if is_held(point, move, edges):
        return 0.0
    share, met, along = first_edge(point, move, edges)
    if met < 0:
        point[0] += move[0]
        point[1] += move[1]
        return 1.0
    point[0] = ends[met, 0] + along * normals[met, 1]
    point[1] = ends[met, 1] - along * normals[met, 0]
    return share


@in_place_kernel
def advance_all(state, move, edges):
    """Move all particles in place. Return the smallest fraction of the input after which an edge
    stopped a particle, or 1.
    """
    least = 1.0
    for p in range(state.shape[0]):
        least = min(least, advance(state[p], move, edges))
    return least


@in_place_kernel
def advance_plan(state, moves, edges):
    """Make all moves of a plan with all particles in place; the rows of ``moves`` are the moves."""
    for m in range(moves.shape[0]):
        advance_all(state, moves[m], edges)


@in_place_kernel
def advance_worlds(states, moves, chosen, edges):
    """Move all particles of the worlds ``chosen`` in place. Each world has its own move."""
    for k in range(chosen.shape[0]):
        for p in range(states.shape[1]):
            advance(states[chosen[k], p], moves[chosen[k]], edges)
