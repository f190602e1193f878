"""The data of a steering episode for the player page."""

from __future__ import annotations

from typing import Any

import numpy as np

from shoal.core.errors import InvalidInputError
from shoal.steering import ConvexWorkspace, Region, SteeringEpisode
from shoal.views.player import render
from shoal.views.steering.figures import outlines_of
from shoal.views.steering.trajectories import (
    FilmSchedule,
    delta_outline,
    has_delta,
    trajectories_of,
    two_move_rings,
)

LARGEST = 200_000
"""Maximum number of path points that a page plays smoothly."""


def player_page(episode: SteeringEpisode) -> str:
    """Return the HTML page that plays a steering episode.

    Raises
    ------
    InvalidInputError
        If the data of the episode are too large for a browser.
    """
    return render("steering", page_data(episode))


def page_data(episode: SteeringEpisode) -> dict[str, object]:
    """Return the data of a steering episode for the player page, as JSON data.

    Returns
    -------
    dict
        ``title``, ``planner``, ``kind``, ``status``, ``reason`` and ``version`` are texts, and
        ``seed`` is an integer. ``size`` (of the workspace), ``radius`` (of a particle),
        ``tolerance`` (of the goals) and ``length`` (of the plan) are numbers. ``bound`` is the
        lower bound on the length of all plans, or None. ``walls`` is the result of `_walls` for the
        workspace.

        ``start`` and ``goal`` are lists of points, one for each particle. ``trajectories`` is a
        list with the data ``{"sent", "length", "shares", "points", "held"}`` of each move; see the
        class `shoal.views.steering.trajectories.MoveTrajectory`. ``starts`` and ``lasting`` are the
        start and the duration of each move in the film, in seconds. ``seconds`` is the duration of
        the film in seconds.

        ``delta`` holds the data ``{"walls", "sets", "which"}`` of the Δ configuration space (all
        position differences), or is None if `has_delta` is false. In ``delta``, ``walls`` is the
        outline of the space, ``sets`` holds the sets that two moves can reach, and ``which`` is the
        index of the set for each move.

    Raises
    ------
    InvalidInputError
        If the data of the episode are too large for a browser.
    """
    problem, trajectories = episode.problem, trajectories_of(episode)
    points = sum(
        trajectory.points.shape[0] * trajectory.points.shape[1] for trajectory in trajectories
    )
    if points > LARGEST:
        raise InvalidInputError(
            f"the HTML player: expected paths of at most {LARGEST} points, got {points} (use .gif"
            " or .mp4)"
        )
    schedule = FilmSchedule(trajectories, size=problem.place.size)
    names = {2: "Two", 3: "Three", 4: "Four", 5: "Five"}
    count = names.get(problem.n_particles, str(problem.n_particles))
    return {
        "title": f"{count} particles in a {problem.place.kind}",
        "planner": episode.planner,
        "kind": problem.place.kind,
        "status": str(episode.status),
        "reason": episode.reason,
        "version": episode.versions["shoal"],
        "seed": episode.seed,
        "noise": episode.problem.noisy,
        "friction": None if episode.problem.friction == np.inf else episode.problem.friction,
        "size": problem.place.size,
        "radius": episode.problem.particle_radius,
        "tolerance": problem.tolerance,
        "length": episode.length,
        "bound": episode.lower_bound,
        "walls": _walls(problem.place),
        "start": episode.states[0].tolist(),
        "goal": episode.goal.tolist(),
        "trajectories": [
            {
                "sent": trajectory.sent.tolist(),
                "length": trajectory.length,
                "shares": trajectory.shares.tolist(),
                "points": trajectory.points.tolist(),
                "held": trajectory.held,
            }
            for trajectory in trajectories
        ],
        "starts": schedule.starts,
        "lasting": schedule.lasting,
        "seconds": schedule.seconds,
        "delta": _delta(episode) if has_delta(episode) else None,
    }


def _walls(workspace: ConvexWorkspace | Region) -> dict[str, Any]:
    """Return a workspace's walls: ``rings`` (outlines), ``circle`` (x, y, radius) or None,
    ``height``, ``open`` (no end caps).
    """
    circle = (
        [*workspace.center.tolist(), workspace.radius]
        if isinstance(workspace, ConvexWorkspace) and workspace.round
        else None
    )
    return {
        "rings": [] if circle else [ring.tolist() for ring in outlines_of(workspace)],
        "circle": circle,
        "height": workspace.height,
        "open": isinstance(workspace, ConvexWorkspace) and workspace.open_ends,
    }


def _delta(episode: SteeringEpisode) -> dict[str, Any]:
    sets: list[Any] = []
    which: list[int] = []
    last: Any = None
    for rings in two_move_rings(episode):
        if rings is not last:
            sets.append([np.round(ring, 6).tolist() for ring in rings])
        last = rings
        which.append(len(sets) - 1)
    return {"walls": _walls(delta_outline(episode)), "sets": sets, "which": which}
