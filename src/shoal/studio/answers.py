"""Quick answers: what a page asks for while somebody draws, drags or moves a slider. A process that stays gives them."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Callable
from functools import lru_cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import shoal
from shoal.checks import check_integer, parse_json, read_text
from shoal.errors import InvalidInputError, ShoalError
from shoal.files import atomic
from shoal.problem import LARGEST_PROBLEM
from shoal.studio.folder import PAPERS, Folder
from shoal.studio.forms import checked_problem, copies_of
from shoal.studio.jobs.work import storable

LARGEST_SHOWN = 1600
"""Pixels of the larger side of a photograph as pages show it."""

MOST_CELLS = 4_000_000
"""Cells of a map that pages draw."""


def answer_all(connection: Connection, root: str) -> None:
    """Answer questions until the connection ends: (number, what, about) gives (number, "answer" or "error", value)."""
    os.chdir(root)
    folder = Folder(root)
    while True:
        try:
            number, what, about = connection.recv()
        except EOFError:
            return
        try:
            connection.send((number, "answer", storable(ANSWERS[what](folder, about))))
        except ShoalError as error:
            connection.send((number, "error", str(error)))
        except MemoryError:
            connection.send((number, "error", "it takes more memory than the studio has for a preview"))
        except OSError as error:
            connection.send((number, "error", f"cannot read {error.filename or 'a file'}: {error.strerror or error}"))
        except Exception as error:  # the last resort: whatever it is, the browser is told
            connection.send((number, "error", f"{type(error).__name__}: {error}"[:300]))


def _seed(about: dict[str, Any]) -> int:
    return check_integer(about.get("seed", 0), what="seed", least=0)


def map_(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the cells of a map, and where its particles start."""
    problem: Any = checked_problem(about["problem"], folder)
    workspace = _opened(problem)
    if workspace.free.size > MOST_CELLS:
        raise InvalidInputError(f"map: expected at most {MOST_CELLS} cells for the studio, got {workspace.free.size}")
    told = {
        "name": workspace.name,
        "shape": list(workspace.shape),
        "cells": workspace.n_free,
        "spacing": workspace.spacing,
        "free": _base64(np.packbits(workspace.free.ravel()).tobytes()),
        "start": None,
        "problem": None,
    }
    try:
        from shoal.swarm.grid.randomness import trial_rng
        from shoal.swarm.simulation.starts import draw_start

        placed = problem.at_place(workspace)
        placed.check_at_place()
        start, _ = draw_start(placed, trial_rng(_seed(about), 0))
        told["start"] = np.ravel_multi_index(tuple(start.T), workspace.shape).tolist()
    except ShoalError as error:
        told["problem"] = str(error)
    return told


_places: dict[str, Any] = {}


def _opened(problem: Any) -> Any:
    """Return the place of a problem; the last few are remembered while their files stay as they are."""
    name = next(iter(problem.declarations()))
    path = getattr(problem, name)
    stamp = os.stat(path).st_mtime_ns if problem.place_is_file() else 0
    key = f"{stamp} {problem.place_key()}"
    if key not in _places:
        if len(_places) > 7:
            del _places[next(iter(_places))]
        _places[key] = problem.place
    return _places[key]


def photograph(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return a picture for pages: PNG or JPEG, no larger than they show it."""
    pixels = _pixels(*_file(folder, str(about["file"])))
    height, width = pixels.shape[:2]
    return {"width": width, "height": height, "picture": _picture(_shrunk(pixels), "JPEG")}


def vessels(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the vessels of a photograph as a picture of the same size as `photograph`'s; with ``exact`` also how sure it is."""
    from shoal.swarm.maps.open import finder_of, vessels_in

    problem: Any = checked_problem(about["problem"], folder)
    fields = {name: getattr(problem, name) for name in ("bright", "thickest")}
    thresholds = {"low": problem.low, "high": problem.high}
    told: dict[str, Any] = {"exact": bool(about.get("exact"))}
    if told["exact"]:
        found = vessels_in(problem.map, **thresholds, **fields)
        mask = found.mask
        told |= {"confidence": found.confidence, "warning": found.warning, "bright": found.bright}
    else:
        finder = finder_of(problem.map, **fields)
        rows, columns = finder.shape
        step = -(-max(rows, columns) // LARGEST_SHOWN)
        mask = finder.mask(**thresholds, shape=(-(-rows // step), -(-columns // step)))
    told["share"] = float(mask.mean())
    return told | {"mask": _mask_picture(_shrunk(mask))}


def sketch(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Write cells that were painted as a new map file; return its name."""
    from shoal.swarm.maps.files import write_map
    from shoal.swarm.maps.workspace import GridWorkspace

    shape = [check_integer(side, what="shape", least=1) for side in about["shape"]]
    cells = int(np.prod(shape))
    if len(shape) != 2 or cells > MOST_CELLS:
        raise InvalidInputError(f"shape: expected rows and columns of at most {MOST_CELLS} cells, got {shape}")
    packed = np.frombuffer(base64.b64decode(about["free"], validate=True), dtype=np.uint8)
    if len(packed) != -(-cells // 8):
        raise InvalidInputError(f"free: expected {-(-cells // 8)} bytes, got {len(packed)}")
    free = np.unpackbits(packed, count=cells).reshape(shape).astype(np.bool_)
    stem = str(about.get("name", "map")).partition(":")[0].rpartition("/")[2].partition(".")[0]
    name = folder.new_name(f"{stem}-painted" if not stem.endswith("-painted") else stem, ".png")
    write_map(GridWorkspace(free), folder.path(name))
    return {"file": name}


def page(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the data of the player for an episode of the folder."""
    from importlib import import_module

    name = str(about["file"])
    episode: Any = shoal.load(folder.path(name))
    data: dict[str, Any] = import_module(f"shoal.views.{episode.part}.page").page_data(episode)
    fields = episode.problem.to_dict()
    return {"part": episode.part, "data": data, "problem": fields, "seed": episode.seed, "sentence": episode.sentence}


def copies(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return a problem as Python, as a command and as a file."""
    return dict(copies_of(checked_problem(about["problem"], folder), seed=_seed(about)))


def save_problem(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Write a problem file; return its name."""
    problem = checked_problem(about["problem"], folder)
    name = folder.new_name(str(about.get("name") or problem.part), ".json")
    with atomic(folder.path(name)) as temporary:
        temporary.write_text(copies_of(problem, seed=_seed(about))["file"], encoding="utf-8")
    return {"file": name}


def steer(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the plan of a steering problem: its moves, the ways of the particles, and what came of it."""
    from shoal.views.steering.trajectories import trajectories_of

    problem = checked_problem(about["problem"], folder)
    episode: Any = shoal.run(problem, seed=_seed(about))
    ways: list[list[Any]] = [[] for _ in episode.states[0]]
    for trajectory in trajectories_of(episode):
        for particle, way in enumerate(ways):
            way.extend(np.round(trajectory.points[:, particle], 5).tolist())
    return {
        "planner": episode.planner, "status": str(episode.status), "reason": episode.reason, "moves": episode.moves,
        "length": episode.length, "bound": episode.lower_bound, "error": episode.error, "inputs": episode.inputs.tolist(),
        "ways": ways, "seconds": episode.seconds,
    }  # fmt: skip


def workspace(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the outline of a workspace, and where the particles start and are to go."""
    from shoal.views.steering.axes import outlines_of

    problem: Any = checked_problem(about["problem"], folder)
    place, (start, goal) = _opened(problem), problem.endpoints(_seed(about))
    rings = [np.round(ring, 6).tolist() for ring in outlines_of(place)]
    return {
        "kind": place.kind, "dimensions": place.dimensions, "size": place.size, "rings": rings, "start": start.tolist(),
        "goal": goal.tolist(), "convex": hasattr(place, "vertices"),
    }  # fmt: skip


def reach(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the Δ configuration space: its outline, and what two, four, ... moves reach of it."""
    from shoal.steering import ConvexWorkspace, disk_reach, polygon_reach
    from shoal.views.steering.axes import outlines_of

    problem: Any = checked_problem(about["problem"], folder)
    place, start = _opened(problem), problem.endpoints(_seed(about))[0]
    if not isinstance(place, ConvexWorkspace) or place.dimensions == 3 or len(start) != 2:
        return {"sets": [], "rings": []}
    moves = check_integer(about.get("moves", 4), what="moves", least=2, most=6)
    delta = start[1] - start[0]
    turned = np.eye(2)
    if place.round:
        sets: Any = disk_reach(float(np.hypot(*delta)), moves=moves, radius=place.radius)
        (cosine, sine), length = delta, max(float(np.hypot(*delta)), 1e-300)  # its sets lie as if Δ pointed right
        turned = np.array([[cosine, sine], [-sine, cosine]]) / length
    else:
        sets = polygon_reach(place, delta, moves=moves)
    told = [{"moves": one.moves, "fraction": one.fraction(), "rings": _rings(one.outline, turned)} for one in sets]
    return {"rings": [outlines_of(place.differences)[0]], "delta": delta, "sets": told}


def _rings(outline: Any, turned: NDArray[np.float64]) -> list[Any]:
    """Return the outlines and holes of a set, rounded for drawing."""
    pieces = [outline] if isinstance(outline, np.ndarray) else [part for ring, holes in outline for part in (ring, *holes)]
    return [np.round(np.asarray(piece) @ turned, 5) for piece in pieces]


def papers(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of the papers, and of those that were reproduced in this folder what came of it."""
    from shoal.papers.reproduce import recipes

    told = []
    for name in recipes():
        recipe = recipes().get(name)
        one: dict[str, Any] = {"name": name, "source": recipe.source, "title": recipe.title, "result": None}
        summary = folder.path(f"{PAPERS}/{name}.json")
        if summary.is_file():
            found = parse_json(read_text(summary, what="summary", most=LARGEST_PROBLEM), where=str(summary))
            if isinstance(found, dict) and found.get("figure") == name:
                one["result"] = {key: found.get(key) for key in ("verdict", "claims", "sentence", "files")}
        told.append(one)
    page_file = folder.path(f"{PAPERS}/index.html")
    return {"figures": told, "page": f"{PAPERS}/index.html" if page_file.is_file() else None}


def _file(folder: Folder, name: str) -> tuple[Path, int]:
    folder.check_fields({"file": name})
    path = folder.path(name)
    return path, path.stat().st_mtime_ns


@lru_cache(maxsize=2)
def _pixels(path: Path, _stamp: int) -> NDArray[np.uint8]:
    from shoal.swarm.maps.pictures import read_pixels

    return read_pixels(path)


def _shrunk(pixels: NDArray[Any]) -> NDArray[Any]:
    step = -(-max(pixels.shape[:2]) // LARGEST_SHOWN)
    return pixels[::step, ::step]


def _picture(pixels: NDArray[Any], kind: str) -> str:
    from PIL import Image

    encoded = io.BytesIO()
    Image.fromarray(pixels).save(encoded, format=kind, **({"quality": 88} if kind == "JPEG" else {"compress_level": 1}))
    return _base64(encoded.getvalue())


def _mask_picture(mask: NDArray[np.bool_]) -> str:
    """Return a mask as a PNG of one bit: white where it is true, else clear."""
    from PIL import Image

    encoded = io.BytesIO()
    Image.fromarray(mask.astype(np.uint8) * 255).convert("1").save(encoded, format="PNG", transparency=0, compress_level=1)
    return _base64(encoded.getvalue())


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()


ANSWERS: dict[str, Callable[[Folder, dict[str, Any]], dict[str, Any]]] = {
    "map": map_, "photograph": photograph, "vessels": vessels, "sketch": sketch, "page": page, "copies": copies,
    "save": save_problem, "papers": papers, "steer": steer, "workspace": workspace, "reach": reach,
}  # fmt: skip
"""What may be asked, by name."""
