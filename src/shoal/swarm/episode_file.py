"""Episodes on disk: one ``.npz`` file without pickles, its text fields checked by a schema."""

from __future__ import annotations

import io
import os
import warnings
import zipfile
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, FiniteFloat, NonNegativeInt, ValidationError

from shoal.errors import InvalidInputError
from shoal.files import atomic, interruption_held
from shoal.swarm.episode import Episode
from shoal.swarm.grid.commands import RULES, letters_of
from shoal.swarm.grid.scans import MOVE_COST, SCAN_COST, ScanRule
from shoal.swarm.grid.world import check_start
from shoal.swarm.maps.reading import MAX_CELLS
from shoal.swarm.maps.workspace import GridWorkspace

FORMAT: Literal[1] = 1


class Header(BaseModel):
    """The text fields of an episode file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal[1]
    version: str
    map: str
    shape: tuple[int, ...]
    rule: str
    task: str
    policy: str
    placement: str
    seed: NonNegativeInt
    trial: NonNegativeInt
    status: Literal["complete", "stalled", "limit"]
    first_frontier: NonNegativeInt
    seconds: FiniteFloat
    scan_every: str = "1"
    scan_cost: FiniteFloat = SCAN_COST
    move_cost: FiniteFloat = MOVE_COST
    spacing: tuple[FiniteFloat, ...] | None = None  # of the workspace, where it is known
    slip: FiniteFloat | None = None  # these four of episodes with noise only
    misplace: FiniteFloat | None = None
    miss: FiniteFloat | None = None
    confidence: FiniteFloat | None = None


def save(episode: Episode, path: str | os.PathLike[str]) -> None:
    """Write an episode; see `Episode.save`."""
    target = Path(path)
    if target.suffix != ".npz":
        raise InvalidInputError(f"{target}: expected the suffix .npz, got {target.suffix!r}")
    from shoal.swarm.noise import NoisyEpisode

    noisy = {}
    if isinstance(episode, NoisyEpisode):
        noisy = {**vars(episode.noise), "confidence": episode.confidence}
    header = Header(
        format=FORMAT,
        version=episode.version,
        map=episode.workspace.name,
        shape=episode.workspace.shape,
        rule=episode.rule,
        task=episode.task,
        policy=episode.policy,
        placement=episode.placement,
        seed=episode.seed,
        trial=episode.trial,
        status=episode.status,  # type: ignore[arg-type]  # checked by the schema
        first_frontier=episode.first_frontier,
        seconds=episode.seconds,
        scan_every=episode.scanning.every,
        scan_cost=episode.scanning.scan_cost,
        move_cost=episode.scanning.move_cost,
        spacing=episode.workspace.spacing,
        **noisy,
    )
    arrays: dict[str, NDArray[Any]] = {
        "header": np.frombuffer(header.model_dump_json(exclude_none=True).encode(), dtype=np.uint8),
        "free": np.packbits(episode.workspace.free),
        "start": episode.start.astype(np.int32),
        "commands": episode.codes,
        "done": episode.done,
        "frontier": episode.frontier,
        "travelled": episode.travelled,
        "scanned": np.packbits(episode.scanned),
    }
    if episode.targets is not None:
        arrays["targets"] = np.packbits(episode.targets)
    buffer = io.BytesIO()  # first in memory, which is quick, as Ctrl-C has to wait for it
    with interruption_held():
        np.savez_compressed(buffer, allow_pickle=False, **arrays)
    with atomic(target) as temporary:
        temporary.write_bytes(buffer.getvalue())


def load(path: str | os.PathLike[str]) -> Episode:
    """Read an episode; see `Episode.load`."""
    source = Path(path)
    if not os.path.isfile(source):  # unlike Path.is_file it takes names of any length
        raise InvalidInputError(
            f"{source}: expected an episode file, got {'a folder' if os.path.isdir(source) else 'no such file'}"
        )
    try:
        with source.open("rb") as file:
            arrays = _arrays(file)
        return _assembled(Header.model_validate_json(arrays["header"].tobytes()), arrays)
    except OSError as error:
        raise InvalidInputError(f"{source}: cannot be read: {error.strerror or error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "its header"
        raise InvalidInputError(f"{source}: not an episode of format {FORMAT}: {where}: {first['msg']}") from None
    except InvalidInputError as error:
        raise InvalidInputError(f"{source}: no episode file (.npz), or a damaged one: {error}") from None


def _arrays(file: BinaryIO) -> dict[str, NDArray[Any]]:
    """Return the arrays of the file that make an episode; others are not looked at."""
    if not zipfile.is_zipfile(file):
        raise InvalidInputError("expected a zip archive of arrays, got another format or one that is cut off")
    file.seek(0)
    arrays: dict[str, NDArray[Any]] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of odd array headers: what matters about them is checked
        try:
            with np.load(file, allow_pickle=False) as archive:
                for name in ("header", "free", "start", "commands", *_COLUMNS, "targets", "scanned"):
                    if name in archive.files:
                        arrays[name] = np.asarray(archive[name])
        except Exception as error:  # zip, deflate and array headers have many ways to be damaged
            raise InvalidInputError(" ".join(str(error).split())[:200] or type(error).__name__) from None
    missing = [name for name in ("header", "free", "start", "commands", *_COLUMNS) if name not in arrays]
    if missing:
        raise InvalidInputError(f"expected the arrays {', '.join(missing)}, got none of that name")
    return arrays


def _assembled(header: Header, arrays: dict[str, NDArray[Any]]) -> Episode:
    size = int(np.prod(header.shape, dtype=object))
    if len(header.shape) not in (2, 3) or not 0 < size <= MAX_CELLS or min(header.shape) < 1:
        raise InvalidInputError(f"shape: expected 2 or 3 lengths of at most {MAX_CELLS} cells in all, got {header.shape}")
    if header.rule not in RULES:
        raise InvalidInputError(f"rule: expected {', '.join(RULES)}, got {header.rule!r}")
    workspace = GridWorkspace(_mask(arrays["free"], header.shape, "free"), name=header.map, spacing=header.spacing)
    codes = _column(arrays, "commands", np.int8)
    commands = len(letters_of(workspace.ndim))
    if len(codes) and not 0 <= int(codes.min()) <= int(codes.max()) < commands:
        raise InvalidInputError(f"commands: expected codes 0 to {commands - 1}, got {codes.min()} to {codes.max()}")
    columns = {name: _column(arrays, name, dtype) for name, dtype in _COLUMNS.items()}
    for name, column in columns.items():
        if len(column) != len(codes):
            raise InvalidInputError(f"{name}: expected {len(codes)} entries, one a command, got {len(column)}")
    make: Any = Episode
    if header.slip is not None:
        from shoal.swarm.noise import CONFIDENCE, Noise, NoisyEpisode

        rates = Noise(header.slip, header.misplace or 0.0, header.miss or 0.0)
        make = partial(NoisyEpisode, noise=rates, confidence=CONFIDENCE if header.confidence is None else header.confidence)
    made: Episode = make(
        workspace=workspace,
        start=check_start(workspace, arrays["start"], rule=header.rule),
        codes=codes,
        rule=header.rule,
        task=header.task,
        policy=header.policy,
        placement=header.placement,
        targets=_mask(arrays["targets"], header.shape, "targets") if "targets" in arrays else None,
        seed=header.seed,
        trial=header.trial,
        status=header.status,
        first_frontier=header.first_frontier,
        seconds=header.seconds,
        version=header.version,
        scanning=ScanRule.parse(header.scan_every, scan_cost=header.scan_cost, move_cost=header.move_cost),
        scanned=_mask(arrays["scanned"], (len(codes),), "scanned") if "scanned" in arrays else None,
        **columns,
    )
    return made


_COLUMNS: dict[str, type[np.generic]] = {"done": np.int32, "frontier": np.int32, "travelled": np.int64}


def _column(arrays: dict[str, NDArray[Any]], name: str, dtype: type[np.generic]) -> NDArray[Any]:
    column = arrays[name]
    if column.ndim != 1 or column.dtype != dtype:
        raise InvalidInputError(f"{name}: expected a column of {np.dtype(dtype)}, got {column.dtype} {column.shape}")
    return column


def _mask(packed: NDArray[Any], shape: tuple[int, ...], name: str) -> NDArray[np.bool_]:
    size = int(np.prod(shape))
    if packed.dtype != np.uint8 or packed.shape != (-(-size // 8),):
        raise InvalidInputError(f"{name}: expected {-(-size // 8)} packed bytes for {shape}, got {packed.dtype} {packed.shape}")
    return np.unpackbits(packed, count=size).astype(np.bool_).reshape(shape)
