"""The records of a drive: a table of all frames, written from its log, and the statistics of several
drives.
"""

from __future__ import annotations

import csv
import io
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from shoal.core.errors import InvalidInputError
from shoal.core.files import write_text
from shoal.rigs.log import RecordedRig, read_log
from shoal.swarm.episode import SwarmEpisode

AXIS_NAMES = {2: ("row", "column"), 3: ("layer", "row", "column")}


def episode_of_log(
    log: str | os.PathLike[str] | RecordedRig, *, trust: bool = False
) -> SwarmEpisode:
    """Return the episode of the drive that a log tells of. Of a drive of a plant, it knows where the
    particles were.

    Parameters
    ----------
    log : path or RecordedRig
    trust : bool
        Whether the log may name a third-party task.

    Raises
    ------
    InvalidInputError
        Raised if the log is damaged, or if its drive has found no free cell.
    """
    from shoal.rigs.driving import replay_log

    past = log if isinstance(log, RecordedRig) else read_log(log, trust=trust)
    result, _ = replay_log(past, trust=trust)
    if result.episode is None:
        raise InvalidInputError(f"{past.path}: expected a drive that has found free cells")
    return with_true_cells(result.episode, past)


def with_true_cells(episode: SwarmEpisode, past: RecordedRig) -> SwarmEpisode:
    """Return the episode of a log with where the particles were, if the log tells it."""
    if episode.observations is None or not past.true:
        return episode
    true = {move: np.array(cells).reshape(-1, 2) for move, cells in past.true.items()}
    return replace(episode, true_cells=true)


def write_frames(log: str | os.PathLike[str] | RecordedRig, path: str | os.PathLike[str]) -> Path:
    """Write a table (CSV) of what each scan of a log shows, with one line for each particle.

    The columns are the number of the frame, the time in seconds since the start, the number of
    commands before the frame, the commands since the frame before, the number of the particle in the
    frame (particles are not followed from frame to frame), its cell, and the values that the rig
    reports, such as currents. A frame without particles has one line without a cell.

    Parameters
    ----------
    log : path or RecordedRig
    path : path

    Raises
    ------
    InvalidInputError, OutputError
    """
    past = log if isinstance(log, RecordedRig) else read_log(log, trust=True)
    lines = past.path.read_bytes().split(b"\n")[:-1]
    entries = [json.loads(line) for line in lines]
    frames = [entry for entry in entries if entry["kind"] == "scan"]
    values = sorted({name for frame in frames for name in frame.get("values", {})})
    axes = AXIS_NAMES[len(past.shape)]
    commands, before, rows = past.commands + past.tail, 0, []
    for number, frame in enumerate(frames):
        sent = commands[before : frame["move"]]
        row: dict[str, Any] = {
            "frame": number,
            "time": frame["time"],
            "move": frame["move"],
            "commands": sent,
        }
        row |= frame.get("values", {})
        before = max(before, frame["move"])
        for particle, cell in enumerate(frame["cells"]):
            rows.append(row | {"particle": particle} | dict(zip(axes, cell, strict=True)))
        if not frame["cells"]:
            rows.append(row)
    text = io.StringIO()
    names = ["frame", "time", "move", "commands", "particle", *axes, *values]
    table = csv.DictWriter(text, names, lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    write_text(path, text.getvalue())
    return Path(path)
