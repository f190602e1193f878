"""shoal tour: compute a closed tour through all cells of a region."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import check_folder, print_json, print_table
from shoal.core.checks import shape_text
from shoal.core.errors import InvalidInputError
from shoal.search.tours import TOURS

if TYPE_CHECKING:
    from shoal.search import Tour

TOUR_EXAMPLE = "Example: shoal tour spanning-tree cave:64x48 --out tour"
FILES = ("tour.png", "tour.csv", "summary.json")


def tour(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help=f"Kind of tour: {', '.join(TOURS)} or MODULE:ATTRIBUTE.",
        ),
    ],
    size: Annotated[
        str,
        typer.Argument(
            metavar="SIZE",
            help=(
                "Number of cells along each side: 64, 64x48 (width, height) or 16x16x16 (width,"
                " height, layers). Or a map whose "
                "free cells are "
                "to be searched, as for 'shoal map': cave:64x48, a picture, text, .map, .npy or"
                " .csv."
            ),
        ),
    ],
    seed: options.UnusedSeed = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="Folder for tour.png, tour.csv (the cells in order) and summary.json.",
        ),
    ] = None,
    json_: options.Json = False,
) -> None:
    """Compute a closed tour through all cells of a region and print its length, closing edge,
    number of turns, and locality.
    """
    from shoal.search import make_tour

    region = parse_size(size)
    if out is not None:
        check_folder(out)
    made = make_tour(name, region)
    result = report(made, region=size)
    written = [] if out is None else _write_tour(made, result, out)
    if json_:
        print_json(result)
        return
    shown = {key: _shown(value) for key, value in result.items() if key != "tour"} | {
        "shape": shape_text(made.shape)
    }
    rows = [(key.replace("_", " "), text) for key, text in shown.items()]
    print_table(rows, title=f"tour {made.name}", written=written)


def parse_size(text: str) -> Any:
    """Return the shape (rows first) or the mask of cells that the command-line argument SIZE
    describes.

    Examples
    --------
    >>> parse_size("64"), parse_size("64x48"), parse_size("5x4x3")
    ((64, 64), (48, 64), (3, 4, 5))
    """
    if re.fullmatch(r"\d{1,18}(x\d{1,18}){0,2}", text):
        sides = [int(side) for side in text.split("x")]
        return tuple(reversed(sides * 2 if len(sides) == 1 else sides))
    if re.fullmatch(r"[-+\d.x\s,]+", text) and not Path(text).exists():
        raise InvalidInputError(f"SIZE: expected 64, 64x48, 16x16x16 or a map, got {text[:80]!r}")
    from shoal.swarm.maps.files import open_map

    return open_map(text).free


def report(made: Tour, *, region: str) -> dict[str, Any]:
    """Return the metrics of a tour as JSON data."""
    return {
        "tour": made.name,
        "region": region,
        "shape": list(made.shape),
        "closed": made.closed,
        **made.metrics().report(),
    }


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return " × ".join(map(str, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _write_tour(made: Tour, result: dict[str, Any], out: Path) -> list[Path]:
    from shoal.core.files import atomic, write_json
    from shoal.views.drawing.charts import save_figure
    from shoal.views.search.tour import tour_figure

    save_figure(tour_figure(made), out / FILES[0])
    with (
        atomic(out / FILES[1]) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("layer", "row", "col")[3 - len(made.shape) :])
        writer.writerows(made.cells.tolist())
    write_json(out / FILES[2], result)
    return [out / name for name in FILES]
