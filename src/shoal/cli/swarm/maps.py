"""shoal maps: list, show and write maps, describe what Shoal reads in a map file, and find vessels
in photographs.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.options import takes_problem
from shoal.cli.output import check_folder, print_json, print_table, say
from shoal.core.checks import count_text, shape_text
from shoal.core.errors import InvalidInputError
from shoal.core.notices import quiet
from shoal.swarm.problem import READING, SwarmProblem

if TYPE_CHECKING:
    from shoal.swarm.maps.resampling import Box
    from shoal.swarm.maps.workspace import GridWorkspace

MAP_OPTIONS = (*READING, "largest_component", "cell_size")
EXAMPLE = "Example: shoal maps vessels:2000 --out vessels.png"
SIDES = ("layers", "rows", "columns")


@takes_problem(SwarmProblem, only=MAP_OPTIONS, map="file")
def maps(
    problem: SwarmProblem,
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[MAP]",
            help=(
                "Generated map, such as cave:80x60, or a map file, or with --vessels a photograph."
            ),
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help=(
                "Output file: .png .tif .bmp .jpg .txt .map .npy .csv .nii .nii.gz. With --vessels,"
                " a folder for mask.png (at "
                "the photograph's resolution), overlay.png and map.png."
            ),
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option("--seed", help="Seed of a random map (in place of the 7 in cave:80x60:7)."),
    ] = None,
    json_: options.Json = False,
) -> None:
    """List the generated maps, show a map, or write a map to a file. For a map file, describe what
    Shoal reads in it.

    The options for map files are those of 'shoal map'. With --vessels, find the vessels in a
    photograph.
    """
    if name is None:
        given = problem.to_dict()
        fields = [(f"--{key.replace('_', '-')}", given.get(key)) for key in MAP_OPTIONS]
        for option, value in (
            ("--out", out),
            ("--seed", seed),
            *fields,
        ):
            if value is not None:
                raise InvalidInputError(
                    f"{option}: expected the name of a map beside this option, such as maze:21x15,"
                    " got none"
                )
        _list(json_)
    elif problem.vessels:
        _vessels(problem.replaced(map=name), out, json_)
    else:
        _show(problem, name, out, seed, json_)


def _show(
    problem: SwarmProblem, name: str, out: Path | None, seed: int | None, json_: bool
) -> None:
    """Show a map, or write it to a file. Describe the parts of a map that is read from a file."""
    from shoal.swarm.maps.files import keeps_spacing, write_map

    if seed is not None:
        if problem.replaced(map=name).place_is_file():
            raise InvalidInputError(f"seed: expected no seed for a map file, got {seed}")
        if name.count(":") > 1:
            raise InvalidInputError(f"seed: expected one seed, got {name!r} and --seed {seed}")
        name = f"{name}:{seed}"
    problem = problem.replaced(map=name)
    with quiet():
        read = problem.replaced(largest_component=False).place
    workspace = read.largest_component() if problem.largest_component else read
    if out is not None:
        write_map(workspace, out)
        if workspace.spacing is not None and not keeps_spacing(out):
            say(f"shoal: {out}: such a file cannot hold the size of a cell, which is lost")
    of_file = problem.place_is_file()
    described = of_file or problem.largest_component
    parts = _parts(read, workspace.n_free, problem) if described else {}
    if json_:
        print_json(_told(workspace) | parts | {"file": None if out is None else str(out)})
    elif out is not None or workspace.ndim == 3 or of_file:
        rows = [("size", _size(workspace)), *_part_rows(parts, problem)]
        print_table(rows, title=workspace.name, written=[] if out is None else [out])
    else:
        print(workspace)


def _parts(read: GridWorkspace, n_free: int, problem: SwarmProblem) -> dict[str, Any]:
    """Return the number of parts of a map, the share of the largest part, and its place in the
    file, or with a width in the map. ``n_free`` is the number of free cells that are kept.
    """
    from shoal.swarm.maps.resampling import parts_of

    parts = parts_of(read.free)
    size = {
        "free_share": n_free / read.free.size,
        "spacing": None if read.spacing is None else list(read.spacing),
    }
    if parts is None:
        return {"parts": None, "largest_share": None, "place": None, **size}
    box = parts.largest if problem.largest_component else parts.whole
    # with a width, the place is that in the smaller map
    scale = problem.scale if problem.width is None else 1.0
    scales = (1.0, scale, scale)[3 - read.ndim :]
    box = tuple(
        (int(first / scale), int((last + 1) / scale - 1e-9))
        for (first, last), scale in zip(box, scales, strict=True)
    )
    return {
        "parts": parts.number,
        "largest_share": parts.share,
        "place": _place(box),
        **size,
    }


def _place(box: Box) -> dict[str, list[int]]:
    return {side: list(ends) for side, ends in zip(SIDES[3 - len(box) :], box, strict=True)}


def _part_rows(parts: dict[str, Any], problem: SwarmProblem) -> list[tuple[str, str]]:
    """Return the rows of the table that describe the parts of a map."""
    if not parts:
        return []
    rows = [("free", f"{100 * parts['free_share']:.3g} % of all cells")]
    if parts["parts"] is None:
        rows.append(("parts", "not counted in a map of this size"))
    else:
        share = f"{100 * parts['largest_share']:.4g} % of the free cells"
        kept = f"the largest has {share}"
        if problem.largest_component:
            kept += ", and only it is kept"
        elif parts["parts"] > 1:
            kept += "; --largest-component keeps only it"
        rows.append(
            (
                "parts",
                f"{count_text(parts['parts'], 'part')}: {kept}" if parts["parts"] > 1 else "1 part",
            )
        )
        rows.append(("place", _place_text(parts["place"], problem)))
    if parts["spacing"]:
        rows.append(("cell", f"{' × '.join(f'{side:.4g}' for side in parts['spacing'])} mm"))
    return rows


def _place_text(place: dict[str, list[int]], problem: SwarmProblem) -> str:
    from shoal.swarm.maps.pages import PICTURES

    ends = ", ".join(f"{side} {first} to {last}" for side, (first, last) in place.items())
    what = "the largest part lies" if problem.largest_component else "the free cells lie"
    picture = Path(problem.map).suffix.lower() in PICTURES or Path(problem.map).is_dir()
    where = (
        f"map of --width {problem.width}"
        if problem.width is not None
        else "picture"
        if picture
        else "map"
    )
    return f"{what} in {ends} of the {where}, counted from 0"


def _vessels(problem: SwarmProblem, out: Path | None, json_: bool) -> None:
    """Find the vessels in a photograph, print how certain the result is, and write pictures of the
    vessels.
    """
    from shoal.cli.swarm.exploration import overlay, vessels_of
    from shoal.swarm.maps.files import write_map
    from shoal.swarm.maps.imaging import VesselMap
    from shoal.swarm.maps.resampling import parts_of
    from shoal.views.swarm.figures import mask_picture, save_picture

    if out is not None:
        check_folder(out)
    with quiet():
        workspace = problem.place
    vessels = vessels_of(problem)
    if vessels.warning:
        say(f"shoal: warning: {problem.map}: {vessels.warning}")
    written: list[Path] = []
    if out is not None:
        written = [
            save_picture(mask_picture(vessels.mask), out / "mask.png"),
            *overlay(problem, out),
            out / "map.png",
        ]
        write_map(workspace, out / "map.png")
    mapped, share = VesselMap(vessels.mask, width=problem.width), float(vessels.mask.mean())
    parts = parts_of(vessels.mask, corners=True)
    if json_:
        result = {
            "confidence": vessels.confidence,
            "bright": vessels.bright,
            "vessel_share": share,
            "pixels_a_cell": mapped.pixels_a_cell,
            "parts": None if parts is None else parts.number,
            "kept_share": mapped.share,
            "place": _place(mapped.box),
            "files": [*map(str, written)],
        }
        print_json(_told(workspace) | result)
        return
    count = "" if parts is None else f"{count_text(parts.number, 'part')}: "
    ends = ", ".join(
        f"{name} {first} to {last}" for name, (first, last) in _place(mapped.box).items()
    )
    rows = [
        (
            "vessels",
            (
                f"{'brighter' if vessels.bright else 'darker'} than the background, {100 * share:.1f}"
                " % of the photograph"
            ),
        ),
        ("confidence", f"{vessels.confidence:.2f} of 1"),
        (
            "parts",
            f"{count}the network that is kept has {100 * mapped.share:.4g} % of the vessel pixels",
        ),
        ("place", f"the map is {ends} of the photograph, counted from 0"),
        ("map", _size(workspace)),
        ("cell", f"{mapped.pixels_a_cell:.4g} pixels per side"),
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
        print_json(
            {
                "maps": [
                    {"name": g.name, "size": g.size, "example": g.example, "summary": g.summary}
                    for g in generators
                ]
            }
        )
        return
    print_table(
        [(g.example, f"{g.name}:{g.size}{'[:SEED]' * g.seeded}. {g.summary}") for g in generators],
        title="Generated maps",
    )
