"""Answers for the studio's page Vessels: maps, photographs, the vessels in photographs, and painted
cells.
"""

from __future__ import annotations

import base64
import math
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer, check_text, shortened
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.studio.answers.pictures import (
    LARGEST_SHOWN,
    base64_of,
    fit_to_page,
    picture_of,
    picture_of_mask,
)
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_problem, checked_seed
from shoal.studio.words import fault_of

MOST_CELLS = 4_000_000
"""Maximum number of cells in a map that a page shows."""


def map_(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the cells of a map, the start cells of the particles, and what the defaults of the
    form stand for on this map (``chosen``). For the vessels of a photograph, ``box`` is where the map
    is in the picture.

    If the page has painted cells over the map (``about["cells"]``), the particles start in the
    painted map.
    """
    from shoal.swarm.maps.workspace import GridWorkspace

    problem: Any = checked_problem(about["problem"], folder, part="swarm")
    workspace = problem.opened().place
    if about.get("cells") is not None:
        workspace = GridWorkspace(
            _cells(about["cells"]), name=workspace.name, spacing=workspace.spacing
        )
    if workspace.free.size > MOST_CELLS:
        raise InvalidInputError(
            f"map: expected at most {MOST_CELLS} cells for the studio, got {workspace.free.size}"
        )
    answer = {
        "name": workspace.name,
        "shape": list(workspace.shape),
        "cells": workspace.n_free,
        "spacing": workspace.spacing,
        "free": base64_of(np.packbits(workspace.free.ravel()).tobytes()),
        "start": None,
        "chosen": {},
        "box": _box_of(_map_in_photograph(problem)),
        "problem": None,
    }
    try:
        from shoal.swarm.grid.board import trial_rng

        setup = problem.at_place(workspace).setup
        if problem.policy == "auto":
            answer["chosen"] = {"policy": setup.policy_name}
        start, _ = setup.draw_start(trial_rng(checked_seed(about), 0))
        answer["start"] = np.ravel_multi_index(tuple(start.T), workspace.shape).tolist()
    except ShoalError as error:
        answer["problem"] = fault_of(error, about)
    return answer


def _map_in_photograph(problem: Any) -> Any:
    """Return the map of the vessels in a photograph, or None for a map of no photograph."""
    from shoal.swarm.maps.files import vessel_map

    if not problem.vessels or not isinstance(problem.map, str):
        return None
    return vessel_map(problem.map, **problem.reading)


def _box_of(found: Any) -> list[float] | None:
    """Return the left, top, right and bottom edge of the map in its photograph, as shares of the
    photograph's width and height.
    """
    if found is None:
        return None
    height, width = found.mask.shape
    sides = (width, height, width, height)
    return [edge / side for edge, side in zip(found.picture_box, sides, strict=True)]


def photograph(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return a photograph as a JPEG picture, with at most `LARGEST_SHOWN` pixels on each side."""
    pixels = _pixels(*_file(folder, str(about["file"])))
    height, width = pixels.shape[:2]
    return {"width": width, "height": height, "picture": picture_of(fit_to_page(pixels), "JPEG")}


def vessels(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the vessels in a photograph as a picture, which has the size of the picture that
    `photograph` returns.

    If ``exact`` is true, the answer includes the confidence that the photograph shows vessels,
    where the map is in the photograph (``box``), and the number of parts that are not in the map,
    with their share of the vessel pixels (``dropped``).
    """
    from shoal.swarm.maps.files import finder_of, vessels_in

    problem: Any = checked_problem(about["problem"], folder, part="swarm")
    fields = {name: getattr(problem, name) for name in ("bright", "thickest", "channel", "frame")}
    thresholds = {"low": problem.low, "high": problem.high}
    answer: dict[str, Any] = {"exact": bool(about.get("exact"))}
    if answer["exact"]:
        vessels = vessels_in(problem.map, **thresholds, **fields)
        mask = vessels.mask
        network = _map_in_photograph(problem)
        answer |= {
            "confidence": vessels.confidence,
            "warning": vessels.warning,
            "bright": vessels.bright,
            "box": _box_of(network),
            "dropped": network.dropped if network is not None else (0, 0.0),
        }
    else:
        finder = finder_of(problem.map, **fields)
        rows, columns = finder.shape
        step = -(-max(rows, columns) // LARGEST_SHOWN)
        mask = finder.mask(**thresholds, shape=(-(-rows // step), -(-columns // step)))
    answer["share"] = float(mask.mean())
    return answer | {"mask": picture_of_mask(fit_to_page(mask))}


def sketch(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Write the cells that a user has painted to a map file. Return the name of the map file.

    The file is new, or, with ``about["over"]``, the file that an earlier call has written and
    that no problem uses yet.
    """
    from shoal.swarm.maps.files import write_map
    from shoal.swarm.maps.workspace import GridWorkspace

    free = _cells(about)
    stem = str(about.get("name") or "map").partition(":")[0].rpartition("/")[2].partition(".")[0]
    over = about.get("over")
    if over is None:
        name = folder.new_name(f"{stem}-painted" if not stem.endswith("-painted") else stem, ".png")
    elif not re.fullmatch(r"[^/]*-painted(-\d+)?\.png", over):
        raise InvalidInputError(f"over: expected the file of a painted map, got {shortened(over)}")
    else:
        name = over
    write_map(GridWorkspace(free), folder.path(name))
    return {"file": name}


def _cells(painted: dict[str, Any]) -> NDArray[np.bool_]:
    """Return painted cells: the ``shape`` of a map, and its ``free`` cells as bits, encoded in
    base64.
    """
    sides, packed = painted.get("shape"), painted.get("free")
    if not isinstance(sides, list) or len(sides) != 2:
        raise InvalidInputError(
            f"shape: expected the numbers of rows and columns, got {shortened(sides)}"
        )
    shape = [check_integer(side, what="shape", least=1, most=MOST_CELLS) for side in sides]
    cells = math.prod(shape)
    if cells > MOST_CELLS:
        raise InvalidInputError(
            f"shape: expected rows and columns of at most {MOST_CELLS} cells, got {shape}"
        )
    try:
        bits = np.frombuffer(
            base64.b64decode(check_text(packed, what="free"), validate=True), dtype=np.uint8
        )
    except ValueError:
        raise InvalidInputError(f"free: expected bits in base64, got {shortened(packed)}") from None
    if len(bits) != -(-cells // 8):
        raise InvalidInputError(f"free: expected {-(-cells // 8)} bytes, got {len(bits)}")
    return np.unpackbits(bits, count=cells).reshape(shape).astype(np.bool_)


def _file(folder: Folder, name: str) -> tuple[Path, int]:
    folder.check_fields({"file": name})
    path = folder.path(name)
    return path, path.stat().st_mtime_ns


@lru_cache(maxsize=2)
def _pixels(path: Path, _stamp: int) -> NDArray[np.uint8]:
    from shoal.swarm.maps.pictures import read_pixels

    return read_pixels(path)
