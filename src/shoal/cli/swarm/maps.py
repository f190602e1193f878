"""shoal maps: list, show and write generated maps, and find vessels in photographs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.options import takes_problem
from shoal.cli.output import check_folder, print_json, print_table, quiet, say
from shoal.core.counts import shape_text
from shoal.core.errors import InvalidInputError
from shoal.swarm.problem import SwarmProblem

if TYPE_CHECKING:
    from shoal.swarm.maps.workspace import GridWorkspace

VESSEL_OPTIONS = ("vessels", "width", "low", "high", "bright", "thickest")
EXAMPLE = "Example: shoal maps vessels:2000 --out vessels.png"


@takes_problem(SwarmProblem, only=VESSEL_OPTIONS, map="photograph")
def maps(
    problem: SwarmProblem,
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="Generated map, such as cave:80x60, or with --vessels a photograph."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Output file: .png .tif .bmp .jpg .txt .map .npy .csv .nii .nii.gz. With --vessels, a folder for mask.png (at "
            "the photograph's resolution), overlay.png and map.png.",
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Seed of a random map (in place of the 7 in cave:80x60:7).")] = None,
    json_: options.Json = False,
) -> None:
    """List the generated maps, show a map, or write a map to a file. With --vessels, find the vessels in a photograph."""
    if name is None:
        for option, value in (("--out", out), ("--seed", seed), ("--vessels", problem.vessels or None)):
            if value is not None:
                raise InvalidInputError(f"{option}: expected the name of a map beside this option, such as maze:21x15, got none")
        _list(json_)
    elif problem.vessels:
        _vessels(problem.replaced(map=name), out, json_)
    else:
        _show(name, out, seed, json_)


def _show(name: str, out: Path | None, seed: int | None, json_: bool) -> None:
    """Show a generated map, or write it to a file."""
    from shoal.swarm.maps.files import write_map
    from shoal.swarm.maps.open import open_map

    if seed is not None:
        if name.count(":") > 1:
            raise InvalidInputError(f"seed: expected one seed, got {name!r} and --seed {seed}")
        name = f"{name}:{seed}"
    workspace = open_map(name)
    if out is not None:
        write_map(workspace, out)
    if json_:
        print_json(_told(workspace) | {"file": None if out is None else str(out)})
    elif out is not None or workspace.ndim == 3:
        print_table([("size", _size(workspace))], title=workspace.name, written=[] if out is None else [out])
    else:
        print(workspace)


def _vessels(problem: SwarmProblem, out: Path | None, json_: bool) -> None:
    """Find the vessels in a photograph, print how certain the result is, and write pictures of the vessels."""
    from shoal.cli.swarm.exploration import overlay, vessels_of
    from shoal.swarm.maps.files import write_map
    from shoal.swarm.maps.imaging import dropped_parts, pixels_a_cell
    from shoal.views.swarm.photographs import mask_picture, save_picture

    if out is not None:
        check_folder(out)
    with quiet():
        workspace = problem.place
    found = vessels_of(problem)
    if found.warning:
        say(f"shoal: warning: {problem.map}: {found.warning}")
    written: list[Path] = []
    if out is not None:
        written = [save_picture(mask_picture(found.mask), out / "mask.png"), *overlay(problem, out), out / "map.png"]
        write_map(workspace, out / "map.png")
    share, side = float(found.mask.mean()), pixels_a_cell(found.mask, width=problem.width)
    parts, dropped = dropped_parts(found.mask)
    if json_:
        result = {
            "dropped_parts": parts,
            "dropped_share": dropped,
            "confidence": found.confidence,
            "bright": found.bright,
            "vessel_share": share,
            "pixels_a_cell": side,
            "files": [*map(str, written)],
        }
        print_json(_told(workspace) | result)
        return
    rows = [
        ("vessels", f"{'brighter' if found.bright else 'darker'} than the background, {100 * share:.1f} % of the photograph"),
        ("confidence", f"{found.confidence:.2f} of 1"),
        ("map", _size(workspace)),
        (
            "dropped",
            f"{parts} parts with {100 * dropped:.2g} % of the vessel pixels, not connected to the map" if parts else "nothing",
        ),
        ("cell", f"{side:.4g} pixels per side"),
    ]
    print_table(rows, title=workspace.name, written=written)


def _told(workspace: GridWorkspace) -> dict[str, Any]:
    return {"name": workspace.name, "shape": list(workspace.shape), "free_cells": workspace.n_free}


def _size(workspace: GridWorkspace) -> str:
    return f"{shape_text(workspace.shape)}, {workspace.n_free} free cells"


def _list(json_: bool) -> None:
    from shoal.swarm.maps.generators import GENERATORS

    generators = [GENERATORS.get(key) for key in GENERATORS]
    if json_:
        print_json({"maps": [{"name": g.name, "size": g.size, "example": g.example, "summary": g.summary} for g in generators]})
        return
    print_table([(g.example, f"{g.name}:{g.size}{'[:SEED]' * g.seeded}. {g.summary}") for g in generators], title="Generated maps")
