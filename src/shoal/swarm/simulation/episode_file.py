"""Episode files of swarms. Each episode file is an ``.npz`` file with a validated JSON header and
without pickled objects.
"""

from __future__ import annotations

import io
import json
import os
import warnings
import zipfile
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import (
    check_choice,
    check_integer,
    check_number,
    check_text,
    describe_missing_file,
    parse_json,
    shortened,
)
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.core.files import atomic, check_suffix
from shoal.core.interruption import interruption_held
from shoal.swarm.grid.board import letters_of
from shoal.swarm.grid.scans import COLUMNS, Trace
from shoal.swarm.grid.world import check_start
from shoal.swarm.maps.reading import MAX_CELLS
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.problem import SwarmProblem

FORMAT: Literal[1] = 1
_COLUMNS = {name: kind for name, kind in COLUMNS.items() if name != "scanned"}
MOST_COMMANDS = 20_000_000
"""Maximum number of commands in an episode file. A file with the maximum number of commands has a
size of 340 MB.
"""

_ROOM = 1024  # maximum bytes of an array's header
_LIMITS = {
    "header": 50_000_000,
    "free": MAX_CELLS // 8,
    "targets": MAX_CELLS // 8,
    "start": 400_000_000,
    "scanned": MOST_COMMANDS // 8 + 1,
    **{name: MOST_COMMANDS * np.dtype(kind).itemsize for name, kind in _COLUMNS.items()},
}
_FIELDS = {
    "format",
    "problem",
    "map",
    "policy",
    "first_frontier",
    "seed",
    "trial",
    "seconds",
    "status",
    "versions",
}


def write(
    path: str | os.PathLike[str],
    problem: SwarmProblem,
    values: dict[str, Any],
    trace: Trace,
    *,
    start: NDArray[np.int64],
    targets: NDArray[np.bool_] | None,
) -> None:
    """Write an episode file. ``values`` holds all fields of the episode that are not arrays.

    `shoal.swarm.episode.SwarmEpisode.save` describes the errors.
    """
    target = check_suffix(path, ".npz")
    workspace, fields = problem.place, problem.to_dict()
    if not isinstance(fields["map"], str):  # it is in the file
        fields["map"] = {}
    about = {"name": workspace.name, "shape": workspace.shape, "spacing": workspace.spacing}
    header = json.dumps(
        {"format": FORMAT, "problem": fields, "map": about} | values, allow_nan=False
    )
    arrays: dict[str, NDArray[Any]] = {
        "header": np.frombuffer(header.encode(), dtype=np.uint8),
        "free": np.packbits(workspace.free),
        "start": start.astype(np.int32),
        **{name: getattr(trace, name) for name in _COLUMNS},
        "scanned": np.packbits(trace.scanned),
    }
    if targets is not None:
        arrays["targets"] = np.packbits(targets)
    # written in memory first, which is fast, because Ctrl-C has to wait for it
    buffer = io.BytesIO()
    with interruption_held():
        np.savez_compressed(buffer, allow_pickle=False, **arrays)
    with atomic(target) as temporary:
        temporary.write_bytes(buffer.getvalue())


def read(path: str | os.PathLike[str], *, trust: bool) -> dict[str, Any]:
    """Read an episode file, and return the fields of the `SwarmEpisode`."""
    source = Path(path)
    if missing := describe_missing_file(source):
        raise InvalidInputError(f"{source}: expected an episode file, got {missing}")
    try:
        with source.open("rb") as file:
            arrays = _arrays(file)
        return _assemble(arrays, trust=trust)
    except OSError as error:
        raise InvalidInputError(f"{source}: cannot be read: {error.strerror or error}") from None
    except (InvalidInputError, UnknownNameError) as error:
        raise InvalidInputError(
            f"{source}: expected an episode file (.npz), got another file or a damaged one: {error}"
        ) from None


def _arrays(file: BinaryIO) -> dict[str, NDArray[Any]]:
    """Return the arrays of an episode from an ``.npz`` file. Ignore arrays in the file that do not
    belong to an episode.
    """
    if not zipfile.is_zipfile(file):
        raise InvalidInputError(
            "expected a zip archive of arrays, got another format or a truncated archive"
        )
    file.seek(0)
    _check_sizes(file)
    file.seek(0)
    needed = ("header", "free", "start", *_COLUMNS, "scanned")
    with warnings.catch_warnings():
        # about unusual array headers: the relevant parts are checked below
        warnings.simplefilter("ignore")
        try:
            with np.load(file, allow_pickle=False) as archive:
                arrays = {
                    name: np.asarray(archive[name])
                    for name in (*needed, "targets")
                    if name in archive.files
                }
        except (
            Exception
        ) as error:  # damage of zip, deflate or array headers raises many kinds of exceptions
            raise InvalidInputError(
                " ".join(str(error).split())[:200] or type(error).__name__
            ) from None
    missing = [name for name in needed if name not in arrays]
    if missing:
        raise InvalidInputError(f"expected the arrays {', '.join(missing)}, got none of that name")
    return arrays


def _check_sizes(file: BinaryIO) -> None:
    """Refuse a file with arrays that are larger than an episode can hold. The check unpacks no
    array.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            sizes = {
                entry.filename.removesuffix(".npy"): entry.file_size for entry in archive.infolist()
            }
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise InvalidInputError(" ".join(str(error).split())[:200]) from None
    for name, most in _LIMITS.items():
        if sizes.get(name, 0) > most + _ROOM:
            raise InvalidInputError(f"{name}: expected at most {most} bytes, got {sizes[name]}")


def _header(raw: NDArray[Any]) -> dict[str, Any]:
    try:
        header = parse_json(raw.tobytes().decode("utf-8"), where="header")
    except UnicodeDecodeError:
        raise InvalidInputError("header: expected text in UTF-8, got other bytes") from None
    if (
        not isinstance(header, dict)
        or not isinstance(header.get("map"), dict)
        or _FIELDS - set(header)
    ):
        raise InvalidInputError(
            f"header: expected the fields {', '.join(sorted(_FIELDS))}, got {shortened(header)}"
        )
    if set(header) - _FIELDS:
        raise InvalidInputError(
            f"header: expected no such field, got {shortened(min(set(header) - _FIELDS))}"
        )
    if header["format"] != FORMAT:
        raise InvalidInputError(f"format: expected {FORMAT}, got {shortened(header['format'])}")
    return header


def _assemble(arrays: dict[str, NDArray[Any]], *, trust: bool) -> dict[str, Any]:
    header = _header(arrays["header"])
    workspace = _workspace(header["map"], arrays["free"])
    fields = header["problem"]
    if isinstance(fields, dict) and fields.get("map") == {}:
        fields["map"] = workspace
    if not trust:  # a replay runs only the task among the objects that the problem names
        SwarmProblem.refuse_code(fields, where="problem", names=("task",))
    problem = SwarmProblem.from_dict(fields).at_place(workspace)
    trace = _trace(arrays, commands=len(letters_of(workspace.ndim)))
    versions = header["versions"]
    if not isinstance(versions, dict) or not all(
        isinstance(text, str) for text in versions.values()
    ):
        raise InvalidInputError(f"versions: expected texts by name, got {shortened(versions)}")
    values: dict[str, Any] = {
        "policy": check_text(header["policy"], what="policy"),
        "status": Status(
            check_choice(
                header["status"], what="status", choices=[str(status) for status in Status]
            )
        ),
        "seconds": check_number(header["seconds"], what="seconds", least=0),
        "versions": versions,
        **{
            name: check_integer(header[name], what=name, least=0)
            for name in ("first_frontier", "seed", "trial")
        },
    }
    targets = _mask(arrays["targets"], workspace.shape, "targets") if "targets" in arrays else None
    start = check_start(workspace, arrays["start"], rule=problem.rule)
    return values | {"problem": problem, "trace": trace, "start": start, "targets": targets}


def _workspace(about: dict[str, Any], free: NDArray[Any]) -> GridWorkspace:
    shape = about.get("shape")
    sides: list[int] = (
        shape
        if isinstance(shape, list) and all(isinstance(side, int) and side > 0 for side in shape)
        else []
    )
    if len(sides) not in (2, 3) or int(np.prod(sides, dtype=object)) > MAX_CELLS:
        raise InvalidInputError(
            f"shape: expected 2 or 3 lengths of at most {MAX_CELLS} cells in all, got"
            f" {shortened(shape)}"
        )
    spacing = about.get("spacing")
    if spacing is not None:
        if not isinstance(spacing, list):
            raise InvalidInputError(f"spacing: expected sizes of a cell, got {shortened(spacing)}")
        spacing = tuple(check_number(side, what="spacing", above=0) for side in spacing)
    return GridWorkspace(
        _mask(free, tuple(sides), "free"),
        name=check_text(about.get("name"), what="map"),
        spacing=spacing,
    )


def _trace(arrays: dict[str, NDArray[Any]], *, commands: int) -> Trace:
    for name, dtype in _COLUMNS.items():
        column = arrays[name]
        if column.ndim != 1 or column.dtype != dtype:
            raise InvalidInputError(
                f"{name}: expected a column of {np.dtype(dtype)}, got {column.dtype} {column.shape}"
            )
    codes = arrays["commands"]
    if len(codes) and not 0 <= int(codes.min()) <= int(codes.max()) < commands:
        raise InvalidInputError(
            f"commands: expected codes 0 to {commands - 1}, got {codes.min()} to {codes.max()}"
        )
    for name in _COLUMNS:
        if len(arrays[name]) != len(codes):
            raise InvalidInputError(
                f"{name}: expected {len(codes)} entries, one per command, got {len(arrays[name])}"
            )
    return Trace(
        **{name: arrays[name] for name in _COLUMNS},
        scanned=_mask(arrays["scanned"], (len(codes),), "scanned"),
    )


def _mask(packed: NDArray[Any], shape: tuple[int, ...], name: str) -> NDArray[np.bool_]:
    size = int(np.prod(shape))
    if packed.dtype != np.uint8 or packed.shape != (-(-size // 8),):
        raise InvalidInputError(
            f"{name}: expected {-(-size // 8)} packed bytes for {shape}, got {packed.dtype}"
            f" {packed.shape}"
        )
    return np.unpackbits(packed, count=size).astype(np.bool_).reshape(shape)
