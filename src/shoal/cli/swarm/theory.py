"""shoal line, shoal schedule, shoal adversary: the theory of mapping in one dimension."""

from __future__ import annotations

import re
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import check_folder, patience, print_json, print_table, progress
from shoal.core.checks import check_integer
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from shoal.swarm.theory.one_dimension import Line, LineSample
    from shoal.swarm.theory.scan_schedules import OptimalSchedule, ScanSchedule

LINE_EXAMPLE = "Example: shoal line --cells 1000 --particles 100 --monte-carlo 100000"
ADVERSARY_EXAMPLE = "Example: shoal adversary closest-frontier --cells 40"
SCHEDULE_EXAMPLE = "Example: shoal schedule --scan-cost 10 --move-cost 1 --max-distance 500"

EXACT_CELLS = 10_000
PRINTED_IN = {
    "boundary": "paper D, eq. 2",
    "coverage": "papers M and D, section III.A.2",
    "largest_gap": "the data of paper M, Fig. 5",
}
_LISTED = 20_000  # maximum number of schedule positions in the JSON
_DIGITS = 1_000

_Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="FOLDER", help="Folder for the figures and summary.json."),
]


def line(
    cells: Annotated[int, typer.Option("--cells", help="Number of cells of the line (m).")],
    particles: Annotated[int, typer.Option("-n", "--particles", help="Number of particles (n).")],
    monte_carlo: Annotated[
        int | None,
        typer.Option(
            "--monte-carlo",
            metavar="TRIALS",
            help="Number of random placements to draw, in addition to the exact means.",
        ),
    ] = None,
    seed: options.Seed = 0,
    workers: options.Workers = None,
    out: _Out = None,
    json_: options.Json = False,
) -> None:
    """Compute exact means for particles on a line: moves to find both ends, moves to visit all
    cells, and largest gap.
    """
    from shoal.swarm.theory.one_dimension import Line, sample

    chosen = Line(cells, particles)
    if workers is not None and check_integer(workers, what="workers", least=1) and not monte_carlo:
        raise InvalidInputError(f"workers: expected --monte-carlo beside it, got {workers}")
    if out is not None:
        check_folder(out)
    drawn = None
    if monte_carlo is not None:
        with progress("placements", monte_carlo, shown=True) as advance:
            drawn = sample(chosen, monte_carlo, seed=seed, workers=workers, on_trials=advance)
    with patience("counting placements ..."):
        result = line_summary(chosen, drawn, seed=seed)
    written = []
    if out is not None:
        from shoal.views.swarm.theory import gap_distributions, move_distributions

        figures = {"gaps.png": gap_distributions(chosen, drawn)} if cells <= EXACT_CELLS else {}
        if drawn is not None and figures:
            figures["moves.png"] = move_distributions(chosen, drawn)
        written = _write(out, figures, result)
    if json_:
        print_json(result)
        return
    rows = [
        (name.replace("_", " "), _means(result[name]))
        for name in ("boundary", "coverage", "largest_gap")
    ]
    gap = result["largest_gap"]
    rows.append(
        (
            "asymptotic largest gap",
            f"{gap['asymptotic']:.4f}; {gap['printed_asymptotic']:.4f} by papers M and D",
        )
    )
    print_table(rows, title=f"{particles} particles in a line of {cells} cells", written=written)


def line_summary(line: Line, sample: LineSample | None, *, seed: int) -> dict[str, Any]:
    """Return the data that ``shoal line`` prints as JSON.

    For long lines, the data contain no exact values, because the computation of exact values would
    take too long.
    """
    short = line.cells <= EXACT_CELLS
    means: dict[str, tuple[float | None, float | None]] = {
        "boundary": (line.boundary_float, 3 * (1 + line.cells) / (1 + line.particles))
    }
    for name in ("coverage", "largest_gap"):
        mean = getattr(line, name) if short else None
        means[name] = (None, None) if mean is None else (float(mean.exact), float(mean.printed))
    result: dict[str, Any] = {"cells": line.cells, "particles": line.particles}
    for name, (exact, printed) in means.items():
        result[name] = {
            "exact": exact,
            "printed": printed,
            "printed_in": PRINTED_IN[name],
            "monte_carlo": None if sample is None else float(getattr(sample, name).mean()),
            "standard_error": None if sample is None else sample.standard_error(name),
        }
    result["boundary"]["exact_in"] = (
        "papers M and D, eq. 1" if line.particles == 1 else "paper M, eq. 2"
    )
    result["largest_gap"] |= {
        "asymptotic": line.largest_gap_law,
        "printed_asymptotic": line.printed_largest_gap_law,
    }
    result["coverage"]["published"] = float(line.published_coverage) if short else None
    return result | {"trials": 0 if sample is None else sample.trials, "seed": seed}


def _means(row: dict[str, Any]) -> str:
    exact = (
        f"more than {EXACT_CELLS} cells: Monte Carlo only"
        if row["exact"] is None
        else f"{row['exact']:.4f} exact"
    )
    parts = [f"{exact} ({row['exact_in']})" if "exact_in" in row else exact]
    if row["printed"] is not None:
        parts.append(
            f"{row['printed']:.4f} by {row['printed_in']} ({row['printed'] - row['exact']:+.4f})"
        )
    if row["monte_carlo"] is not None:
        parts.append(f"{row['monte_carlo']:.4f} ± {row['standard_error']:.4f} by Monte Carlo")
    return ", ".join(parts)


def _write(out: Path, figures: dict[str, Figure], result: dict[str, Any]) -> list[Path]:
    from shoal.core.files import write_json
    from shoal.views.drawing.charts import save_figure

    for name, figure in figures.items():
        save_figure(figure, out / name)
    write_json(out / "summary.json", result)
    return [*(out / name for name in figures), out / "summary.json"]


def adversary(
    policy: Annotated[
        str,
        typer.Argument(
            metavar="POLICY", help="Policy, or MODULE:ATTRIBUTE, as in shoal map --policy."
        ),
    ],
    cells: Annotated[
        int,
        typer.Option("--cells", help="Largest number of free cells on each side of the start."),
    ] = 40,
    max_moves: Annotated[
        int, typer.Option("--max-moves", help="Number of commands after which the policy stops.")
    ] = 1_000_000,
    seed: options.Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FOLDER", help="Folder for summary.json."),
    ] = None,
    json_: options.Json = False,
) -> None:
    """Let an adversary choose a corridor against a policy with one particle, and print the ratio of
    the policy's moves to the moves of one who knows the corridor.

    The exit code is 1 if the policy does not complete the corridor; then the ratio is a lower bound.
    """
    from shoal.swarm.adversary import play_adversary

    if out is not None:
        check_folder(out)
    with patience("playing ..."):
        game = play_adversary(policy, cells, seed=seed, max_moves=max_moves)
    result = {
        "policy": game.policy,
        "cells": cells,
        "left": game.left,
        "right": game.right,
        "moves": game.moves,
        "least": game.least,
        "ratio": game.ratio,
        "status": game.status,
        "seed": seed,
    }
    written = [] if out is None else _write(out, {}, result)
    done = game.status == Status.COMPLETE
    if json_:
        print_json(result)
        raise typer.Exit(0 if done else 1)
    rows = [
        ("corridor", f"{game.left} free cells to the left of the start, {game.right} to the right"),
        ("moves along it", f"{game.moves} ({game.status})"),
        ("of one who knows it", str(game.least)),
        ("ratio", f"{game.ratio:.4f}" if done else f"at least {game.ratio:.4f}"),
    ]
    print_table(rows, title=f"the adversary against {game.policy}", written=written)
    raise typer.Exit(0 if done else 1)


def schedule(
    scan_cost: Annotated[
        str, typer.Option("--scan-cost", metavar="PRICE", help="Price of a scan, in any unit.")
    ],
    move_cost: Annotated[
        str,
        typer.Option(
            "--move-cost",
            metavar="PRICE",
            help="Price of a move, in the same unit as the price of a scan.",
        ),
    ],
    max_distance: Annotated[
        str,
        typer.Option(
            "--max-distance",
            metavar="D",
            help="Largest distance of the wall, such as 1000, 1e100 or 10^100.",
        ),
    ] = "1000",
    seed: options.UnusedSeed = 0,
    out: _Out = None,
    json_: options.Json = False,
) -> None:
    """Find the scan schedule with the smallest worst-case cost ratio for finding a wall at an
    unknown distance.

    For comparison, the output contains the worst-case cost ratios of five classic scan schedules.
    """
    from shoal.swarm.theory.scan_schedules import (
        EveryStep,
        Hyperexponential,
        OneJump,
        Powers,
        check_prices,
        optimal_schedule,
    )

    scan, move = check_prices(scan_cost, move_cost)
    distance = whole_number(max_distance, option="--max-distance")
    if out is not None:
        check_folder(out)
    with patience("searching the best schedule ..."):
        best = optimal_schedule(scan_cost=scan, move_cost=move, max_distance=distance)
        others = [EveryStep(), Powers(2), Powers(4), Hyperexponential(), OneJump(distance + 1)]
        result: dict[str, Any] = {
            "scan_cost": float(scan),
            "move_cost": float(move),
            "max_distance": distance,
            "optimal": (
                _schedule_entry(best, best)
                | {
                    "positions": _positions(best),
                    "step": getattr(best.schedule, "step", None),
                }
            ),
            "schedules": [_schedule_entry(one, best) for one in others],
        }
    written = []
    if out is not None:
        from shoal.views.swarm.theory import schedule_ratios

        written = _write(
            out,
            {"ratios.png": schedule_ratios([*others[:-1], best], max_distance=distance)},
            result,
        )
    if json_:
        print_json(result)
        return
    shown = [*islice(best.positions(), 13)]
    more = ", ..." if len(shown) == 13 else ""
    rows = [
        ("scan after", ", ".join(_short(position) for position in shown[:12]) + more + " moves"),
        *((entry["name"], _ratio(entry)) for entry in (result["optimal"], *result["schedules"])),
    ]
    title = (
        f"a wall at a distance of at most {_short(distance)}, {scan_cost} per scan, {move_cost} per"
        " move"
    )
    print_table(rows, title=title, written=written)


def _schedule_entry(schedule: ScanSchedule, best: OptimalSchedule) -> dict[str, Any]:
    """Return the data of a schedule: its name, the moves and scans for the largest distance, and
    its worst cost ratio.
    """
    cost = schedule.cost(best.max_distance)
    worst = schedule.worst(
        scan_cost=best.scan_cost, move_cost=best.move_cost, max_distance=best.max_distance
    )
    return {
        "name": schedule.name,
        "moves": cost.moves,
        "scans": cost.scans,
        "worst_ratio": _float(worst.ratio),
        "worst_distance": worst.distance,
    }


def _float(ratio: Any) -> float | None:
    """Return a ratio as a float, or None if the ratio is too large for a float."""
    try:
        return float(ratio)
    except OverflowError:
        return None


def _positions(schedule: OptimalSchedule) -> list[int] | None:
    """Return all positions at which a schedule scans, or None for more than `_LISTED` positions.

    A schedule with more than `_LISTED` positions has equal distances between successive scans.
    """
    positions = [*islice(schedule.positions(), _LISTED + 1)]
    return positions if len(positions) <= _LISTED else None


def _ratio(entry: dict[str, Any]) -> str:
    ratio = "above 1e308" if entry["worst_ratio"] is None else f"{entry['worst_ratio']:.4g}"
    return (
        f"worst ratio {ratio}, at {_short(entry['worst_distance'])}; {_short(entry['moves'])}"
        f" moves, {_short(entry['scans'])} scans"
    )


def _short(number: int) -> str:
    text = str(number)
    return text if len(text) <= 12 else f"{text[0]}.{text[1:4]}e{len(text) - 1}"


def whole_number(text: str, *, option: str) -> int:
    """Return the whole number that a text such as 1000, 1e100 or 10^100 describes.

    Raises
    ------
    InvalidInputError
        If ``text`` does not describe a whole number, or if the number has more than a thousand
        digits.

    Examples
    --------
    >>> whole_number("1.5e3", option="--max-distance"), whole_number("2^10", option="--max-distance")
    (1500, 1024)
    >>> whole_number("10^600", option="--max-distance") == 10**600
    True
    """
    text = text.strip()
    base, _, power = text.partition("^")
    written = re.fullmatch(r"\d+(\.\d+)?([eE]\+?\d{1,4})?|\d+\^\d{1,4}", text, flags=re.ASCII)
    # before a power of too many digits is computed
    if written and (len(base) - 1) * int(power or 1) < _DIGITS:
        value = Fraction(base) ** int(power or 1)
        if value.denominator == 1 and value < 10**_DIGITS:
            return int(value)
    raise InvalidInputError(
        f"{option}: expected a whole number of at most {_DIGITS} digits, such as 1000, 1e100 or"
        f" 10^100, got {text[:80]!r}"
    )
