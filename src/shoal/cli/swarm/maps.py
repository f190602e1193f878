"""shoal maps: the generated maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import print_json, print_table

EXAMPLE = "Example: shoal maps vessels:2000 --out vessels.png"


def maps(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="A generated map, such as cave:80x60.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FILE", help="Write it: .png .tif .bmp .jpg .txt .map .npy .csv .nii .nii.gz.", show_default=False
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", help="Seed of a random map (as in cave:80x60:7).", show_default=False)
    ] = None,
    json_: options.Json = False,
) -> None:
    """List the generated maps; show one, or write it to a file."""
    from shoal.errors import InvalidInputError

    if name is None:
        for option, value in (("--out", out), ("--seed", seed)):
            if value is not None:
                raise InvalidInputError(f"{option}: expected the name of a map with it, such as maze:21x15, got none")
        _list(json_)
        return
    from shoal.swarm.maps.files import write_map
    from shoal.swarm.maps.open import open_map

    if seed is not None:
        if name.count(":") > 1:
            raise InvalidInputError(f"seed: expected one seed, got {name!r} and --seed {seed}")
        name = f"{name}:{seed}"
    workspace = open_map(name)
    if out is not None:
        write_map(workspace, out)
    result: dict[str, Any] = {
        "name": workspace.name,
        "shape": list(workspace.shape),
        "free_cells": workspace.n_free,
        "file": None if out is None else str(out),
    }
    if json_:
        print_json(result)
    elif out is not None:
        size = "x".join(map(str, workspace.shape))
        print_table([("size", f"{size}, {workspace.n_free} free cells"), ("written", str(out))], title=workspace.name)
    else:
        print(workspace)


def _list(json_: bool) -> None:
    from shoal.swarm.maps.generators import GENERATORS

    generators = [GENERATORS.get(key) for key in GENERATORS]
    if json_:
        print_json({"maps": [{"name": g.name, "size": g.size, "example": g.example, "summary": g.summary} for g in generators]})
        return
    print_table([(g.example, f"{g.name}:{g.size}{'[:SEED]' * g.seeded}. {g.summary}") for g in generators], title="Generated maps")
