"""Answers for the studio's page Steering: plans, workspaces, and the Δ configuration space."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

import shoal
from shoal.core.checks import check_integer
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_problem, checked_seed


def steer(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the plan for a steering problem: the moves, the paths of the particles, and the
    result.
    """
    from shoal.views.steering.trajectories import trajectories_of

    problem: Any = checked_problem(about["problem"], folder, part="steering")
    episode: Any = shoal.run(problem, seed=checked_seed(about))
    paths: list[list[Any]] = [[] for _ in episode.states[0]]
    for trajectory in trajectories_of(episode):
        for particle, path in enumerate(paths):
            path.extend(_for_drawing(trajectory.points[:, particle], problem.place.size).tolist())
    return {
        "planner": episode.planner,
        "status": str(episode.status),
        "reason": episode.reason,
        "moves": episode.moves,
        "length": episode.length,
        "bound": episode.lower_bound,
        "error": episode.error,
        "inputs": episode.inputs.tolist(),
        "ways": paths,
        "seconds": episode.seconds,
    }


def workspace(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the outline of a workspace, the starts and goals of the particles, and what the
    defaults of the form stand for (``chosen``).
    """
    from shoal.views.steering.figures import outlines_of

    problem: Any = checked_problem(about["problem"], folder, part="steering").opened()
    place, (start, goal) = problem.place, problem.endpoints(checked_seed(about))
    rings = [_for_drawing(ring, place.size).tolist() for ring in outlines_of(place)]
    return {
        "kind": place.kind,
        "dimensions": place.dimensions,
        "size": place.size,
        "rings": rings,
        "start": start.tolist(),
        "goal": goal.tolist(),
        "convex": hasattr(place, "vertices"),
        "chosen": {"planner": problem.chosen_planner.name} if problem.planner == "auto" else {},
    }


def reach(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the outline of the Δ configuration space, and the position differences that two, four,
    ... moves reach; without outlines where these sets are not known: with obstacles, in space, of
    other numbers of particles, and with friction, gain or a particle radius.
    """
    from shoal.steering import ConvexWorkspace, disk_reach, polygon_reach
    from shoal.views.steering.figures import outlines_of

    problem: Any = checked_problem(about["problem"], folder, part="steering").opened()
    place, start = problem.place, problem.endpoints(checked_seed(about))[0]
    plain = problem.friction == math.inf and not (problem.gain or problem.particle_radius)
    if (
        not isinstance(place, ConvexWorkspace)
        or place.dimensions == 3
        or len(start) != 2
        or not plain
    ):
        return {"sets": [], "rings": []}
    moves = check_integer(
        4 if about.get("moves") is None else about["moves"], what="moves", least=2, most=6
    )
    delta = start[1] - start[0]
    turned = np.eye(2)
    if place.round:
        sets: Any = disk_reach(float(np.hypot(*delta)), moves=moves, radius=place.radius)
        # its sets are rotated as if Δ pointed to the right
        length = max(float(np.hypot(*delta)), 1e-300)
        cosine, sine = delta
        turned = np.array([[cosine, sine], [-sine, cosine]]) / length
    else:
        sets = polygon_reach(place, delta, moves=moves)
    answer = [
        {
            "moves": one.moves,
            "fraction": one.fraction(),
            "rings": [_for_drawing(one.outline @ turned, place.size)],
        }
        for one in sets
    ]
    return {"rings": [outlines_of(place.differences)[0]], "delta": delta, "sets": answer}


def _for_drawing(points: Any, size: float) -> NDArray[np.float64]:
    """Round points to five digits of the size of their workspace, which may be tiny."""
    digits = 5 - math.floor(math.log10(size))
    return np.asarray(np.round(np.asarray(points, dtype=np.float64), digits), dtype=np.float64)
