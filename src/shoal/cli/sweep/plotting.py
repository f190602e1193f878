"""shoal sweep plot: plot the means of a sweep with their confidence intervals."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shoal.cli import options
from shoal.cli.output import check_folder, print_json, print_table
from shoal.cli.sweep.results import StoreFile, SweepName
from shoal.core.errors import InvalidInputError
from shoal.core.files import check_suffix

PLOT_EXAMPLE = "Example: shoal sweep plot results.sqlite --measure moves --out moves.png"
FIGURES = (".png", ".svg", ".pdf")


def plot(
    store: StoreFile,
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="File for the figure: .png, .svg or .pdf.")
    ],
    name: SweepName = None,
    measure: Annotated[
        str | None, typer.Option("--measure", help="Measure to draw, such as moves.")
    ] = None,
    seed: options.UnusedSeed = 0,
    json_: options.Json = False,
) -> None:
    """Plot means with 95 % intervals over the first numeric axis, one line for each combination of
    the other axes' values.
    """
    check_folder(check_suffix(out, *FIGURES).parent)
    from shoal.lab import Store
    from shoal.lab.statistics import first_measure, summarise
    from shoal.views import save_figure
    from shoal.views.drawing.curves import PointMean, means_figure

    with Store(store) as opened:
        chosen = opened.only(name)
        wanted = measure or first_measure(opened.stored(chosen).measures)
        rows = [
            (row.values, row.estimate)
            for row in summarise(opened, chosen, wanted)
            if row.estimate is not None
        ]
    if not rows:
        raise InvalidInputError(
            f"{store}: sweep {chosen}: expected finished trials to draw, got none"
        )
    means = [PointMean(values, found.mean, found.low, found.high) for values, found in rows]
    save_figure(means_figure(means, title=chosen, measure=wanted), out)
    if json_:
        print_json({"sweep": chosen, "measure": wanted, "points": len(means), "out": str(out)})
    else:
        print_table([("points", str(len(means)))], title=f"{wanted} of {chosen}", written=[out])
