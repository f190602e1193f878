"""Answers for the first page: examples to begin with, and where a file of the folder is opened."""

from __future__ import annotations

import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

from shoal.core.checks import check_choice, decode_text, parse_json, read_text, shortened
from shoal.core.errors import InvalidInputError
from shoal.core.files import atomic
from shoal.missions.mission_set import VEHICLE
from shoal.parts import read_problem
from shoal.studio.folder import MISSIONS_PAGE, PICTURES, Folder, is_episode, purpose_of

EYE = "eye.png"
_EYE_PIXELS = 500  # on each side: enough for its vessels, and quick to look through

MOST_UNPACKED = 64_000_000
"""Maximum size of a file in an archive of missions, in bytes."""

_VESSELS, _STEERING, _SEARCH, _LAB = "vessels", "steering", "search", "lab"
PLACES = {"swarm": _VESSELS, "steering": _STEERING, "search": _SEARCH}
"""The page of each part of Shoal."""

EXAMPLES: dict[str, tuple[str, dict[str, Any]]] = {
    "eye": (_VESSELS, {"problem": {"map": EYE, "vessels": True, "particles": 300}, "run": True}),
    "leaf": (_VESSELS, {"problem": {"map": "vessels:5000:3", "particles": 100}, "run": True}),
    "tree": (_VESSELS, {"problem": {"map": "vessels3d:1500:5", "particles": 80}, "run": True}),
    "field": (_SEARCH, {"run": True}),
    "dying": (
        _SEARCH,
        {
            "problem": {
                "region": "square:300",
                "robots": 6,
                "footprint": "15",
                "vehicle": {"preset": VEHICLE},
                "loss": 0.3,
                "faults": ["crash:2@20", "crash:5@45"],
            },
            "run": True,
        },
    ),
    "race": (
        _VESSELS,
        {"problem": {"map": "maze:21x15:4", "particles": 12}, "stage": "race", "run": True},
    ),
}
"""Examples by name: the page that shows each of them, and what the page opens."""


def example(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the page of an example and what the page opens. Write the photograph of an eye to the
    folder if the example needs it.
    """
    name = check_choice(about["name"], what="example", choices=EXAMPLES)
    place, given = EXAMPLES[name]
    if name == "eye" and not folder.path(EYE).exists():
        from PIL import Image

        from shoal.swarm.maps.imaging.samples import retina

        with atomic(folder.path(EYE)) as temporary:
            picture = Image.fromarray(retina())
            picture.resize((_EYE_PIXELS, _EYE_PIXELS), Image.Resampling.LANCZOS).save(
                temporary, format="PNG"
            )
    return {"place": place, "given": given}


def open_(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the page that opens a file of the folder, and what the page opens.

    Raises
    ------
    InvalidInputError
        Raised for a file that no page opens.
    """
    name = str(about["file"])
    path, kind = folder.path(name), purpose_of(name)
    if not path.is_file():
        raise InvalidInputError(
            f"file: expected a file of the folder, got no such file: {shortened(name)}"
        )
    if name.lower().endswith(".csv") and _has_header(path):
        return _of_region(name)
    if kind == "map":
        photograph = name.lower().endswith(PICTURES)
        return _on(_VESSELS, problem={"map": name} | ({"vessels": True} if photograph else {}))
    if kind == "workspace":
        return _on(_STEERING, problem={"workspace": name})
    if kind == "region":
        return _of_region(name)
    if kind == "episode":
        return _on(_LAB, tab="episodes", episode=name)
    if kind == "store":
        return _on(_LAB, tab="sweeps", store=name)
    if kind == "sweep":
        return _on(_LAB, tab="new", toml=read_text(path, what="sweep file"))
    if kind == "missions":
        return _of_missions(folder, name, path)
    if kind == "problem" and is_episode(path):
        return _on(_LAB, tab="episodes", episode=name)
    if kind == "problem":
        return _of_json(name, read_problem(path))
    raise InvalidInputError(
        f"{shortened(name)}: expected a picture, volume, map, region, workspace, problem, episode,"
        f" sweep or missions, got a file that no page opens"
    )


def _has_header(path: Path) -> bool:
    """Return whether the first line of a table names its columns: corners of a region and not the
    cells of a map.
    """
    with path.open("rb") as file:
        return any(chr(byte).isalpha() for byte in file.readline(200))


def _of_region(name: str) -> dict[str, Any]:
    """Return the page of a region that is to be searched by vehicles."""
    return _on(_SEARCH, problem={"region": name, "vehicle": {"preset": VEHICLE}})


def _of_json(name: str, data: Any) -> dict[str, Any]:
    """Return the page of a JSON file: a problem with its part, or a region as GeoJSON."""
    if isinstance(data, dict) and data.get("kind") in PLACES:
        problem = {key: value for key, value in data.items() if key != "seed"}
        return _on(PLACES[data["kind"]], problem=problem, seed=data.get("seed", 0))
    if isinstance(data, dict) and isinstance(data.get("type"), str):
        return _of_region(name)
    raise InvalidInputError(
        f"{shortened(name)}: expected a problem with its kind ({', '.join(PLACES)}) or GeoJSON, got"
        f" {shortened(json.dumps(data))}"
    )


def _of_missions(folder: Folder, name: str, path: Path) -> dict[str, Any]:
    """Return the page of an archive of missions that the studio wrote. Write the map in it to the
    folder, if it is not there.
    """
    from shoal.views.search.missions import MAP

    try:
        with zipfile.ZipFile(path) as archive:
            inside = (MISSIONS_PAGE, f"missions/{MAP}")
            if any(archive.getinfo(one).file_size > MOST_UNPACKED for one in inside):
                raise InvalidInputError(
                    f"{shortened(name)}: expected at most 64 MB a file, got more"
                )
            page, picture = map(archive.read, inside)
    except (KeyError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise InvalidInputError(
            f"{shortened(name)}: expected missions that the studio wrote, got {error}"
        ) from None
    given = parse_json(decode_text(page, where=name), where=name)
    written = given.get("written") if isinstance(given, dict) else None
    if not isinstance(written, dict) or not isinstance(given.get("problem"), dict):
        raise InvalidInputError(
            f"{shortened(name)}: expected missions with their problem, got {shortened(given)}"
        )
    stem = name.rpartition("/")[2].partition(".")[0]
    shown = f"{stem}-missions-figure.png"
    if not folder.path(shown).is_file() or folder.path(shown).read_bytes() != picture:
        shown = folder.new_name(f"{stem}-missions-figure", ".png")
        with atomic(folder.path(shown)) as temporary:
            temporary.write_bytes(picture)
    return _on(_SEARCH, **given | {"written": written | {"file": name, "map": shown}})


def _on(place: str, **given: Any) -> dict[str, Any]:
    return {"place": place, "given": given}
