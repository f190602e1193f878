"""Texts for the printed summary of the command ``shoal search``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shoal.cli.output import print_table
from shoal.cli.search.missions import (
    approach_text,
    area_text,
    flights_rows,
    margin_text,
    zones_text,
)

if TYPE_CHECKING:
    from shoal.search import SearchEpisode

_ROWS = 12
_SEEN = 0.01  # metres: a smaller distance outside of the region is due to rounding


def print_search(
    episode: SearchEpisode, result: dict[str, Any], written: list[Path], *more: tuple[str, str]
) -> None:
    """Print the summary of a search."""
    region = result["region"]
    rows = [
        (
            "region",
            (
                f"{region['cells']} cells of {region['cell_m']:.4g} m, each searched in"
                f" {episode.cell_time:.3g} s; "
                f"{region['area_m2']:.6g} m²{zones_text(region['no_go_zones'])}"
                f"{margin_text(region['margin_m'], region['unseen_m2'])}"
            ),
        ),
        *layers_rows(result["layers"]),
        ("status", f"{result['status']}: {result['reason']}"),
        ("time", times_text(result)),
        *prior_rows(result),
        *lateral_rows(result["lateral_range"]),
        (
            "covered",
            (
                f"{100 * result['covered_fraction']:.4f} %, {area_text(result['uncovered_m2'])} not"
                " seen"
            ),
        ),
        (
            "messages",
            (
                f"{result['messages']['sent']} sent, {result['messages']['lost']} lost;"
                f" {result['takeovers']} takeovers"
            ),
        ),
    ]
    for route in result["routes"][:_ROWS]:
        stops = (
            ""
            if route["stops"] == route["cells"]
            else f" from {route['stops']} stops with {route['footprint_m']:g} m"
        )
        told = (
            f"{route['status']}: {route['cells']} cells{stops}, {route['length_m']:.5g} m,"
            f" {route['turns']} turns"
        )
        rows.append((f"robot {route['robot']}", told))
    if len(result["routes"]) > _ROWS:
        rows.append(("", f"and {len(result['routes']) - _ROWS} more"))
    if targets := result["targets"]["there"]:
        rows.append(("targets", f"{result['targets']['found']} of {targets} found"))
    rows += [
        ("found", f"at {place_text(finding)}, sure to {100 * finding['confidence']:.1f} %")
        for finding in result["findings"][:_ROWS]
    ]
    rows += outside_rows(result["routes"])
    if "missions" in result:
        rows += missions_rows(result["missions"])
    rows += compared_rows(episode)
    title = (
        f"search: tour {result['tour']}, divided among the robots by the allocation"
        f" {result['allocation']}"
    )
    print_table([*rows, *more], title=title, written=files_text(written))


def times_text(result: dict[str, Any]) -> str:
    """Return the actual time, the planned time and the minimum time of a search as text.

    Examples
    --------
    >>> times_text({"simulated": True, "makespan_s": 1088.0, "planned_s": 1019.0, "lower_bound_s": 875.0})
    '0:18:08 in the simulation; planned 0:16:59, and no plan takes less than 0:14:35'
    """
    from shoal.search.episode import duration_text

    if result["makespan_s"] is None:
        return "not all was searched"
    made, planned, least = (
        duration_text(result[f"{name}_s"]) for name in ("makespan", "planned", "lower_bound")
    )
    how = " in the simulation" if result["simulated"] else ""
    bound = f", and no plan takes less than {least}" if result["lower_bound_s"] >= 1 else ""
    return f"{made}{how}; planned {planned}{bound}"


def prior_rows(result: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the row of a summary that tells of the prior, or none without a prior.

    Examples
    --------
    >>> prior = {"inside": 0.9, "success": 1.0, "at_most": 1.25, "plain_s": 900.0}
    >>> prior |= {"before": 0.0, "left": None}
    >>> prior_rows({"prior": prior, "expected_find_s": 300.0})
    [('target', 'found after 0:05:00 on average, if it is in the region (90 % by the prior)')]
    """
    from shoal.search.episode import duration_text

    if result["prior"] is None:
        return []
    if result["expected_find_s"] is None:
        return [("target", "cannot be found: no search of a place where it may be detects it")]
    prior, mean = result["prior"], duration_text(result["expected_find_s"])
    inside = f"if it is in the region ({100 * prior['inside']:.3g} % by the prior)"
    found = f"{100 * prior['success']:.3g} %"
    if prior["left"] is not None:
        limit = duration_text(prior["at_most"] * prior["plain_s"])
        text = (
            f"found with a probability of {found}, {inside} at the start; on average after"
            f" {mean}, where {limit} stands for not found; out of the region at the end with"
            f" {100 * prior['left']:.3g} %"
        )
    else:
        text = f"found after {mean} on average, {inside}"
        if prior["success"] < 1 - 1e-9:
            text += f" and robots repeat the search until then; one search finds it with {found}"
    seen = f"the tracks would have found the target with a probability of {100 * prior['before']:.3g} %"
    return [("target", text), *([("searched", seen)] if prior["before"] else [])]


def lateral_rows(report: dict[str, float] | None) -> list[tuple[str, str]]:
    """Return the row of a summary that tells of the lateral range, or none without one.

    Examples
    --------
    >>> lateral_rows({"detection": 0.5, "sweep_width_m": 10.0, "row_distance_m": 20.0})
    [('detection', '50 % for one passage of a row: sweep width 10 m, rows 20 m apart')]
    """
    if report is None:
        return []
    return [
        (
            "detection",
            f"{100 * report['detection']:.3g} % for one passage of a row: sweep width"
            f" {report['sweep_width_m']:.3g} m, rows {report['row_distance_m']:.4g} m apart",
        )
    ]


def finding_text(expected: float | None, success: float | None) -> str:
    """Return the expected time to find a target, with the probability that it is found if it is not
    sure.

    Examples
    --------
    >>> finding_text(300.0, 1.0), finding_text(300.0, 0.805), finding_text(None, 0.0)
    ('0:05:00', '0:05:00 (80.5 %)', 'never')
    """
    from shoal.search.episode import duration_text

    if expected is None or success is None:
        return "never"
    sure = "" if success > 1 - 1e-9 else f" ({100 * success:.3g} %)"
    return duration_text(expected) + sure


def missions_rows(told: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of a summary that describe missions: their start times, and the distances
    between vehicles.

    Each sortie after the first sortie of its vehicle has its own row, in the order of the start
    times.
    """
    from shoal.search.episode import duration_text, starts_text

    first = [start["start_s"] for start in told["starts"] if start["sortie"] == 1]
    later = [start for start in told["starts"] if start["sortie"] > 1]
    timed = sorted((start["start_s"], start["mission"]) for start in later)
    heights = ", ".join(
        f"{height:g}" for height in sorted({start["altitude_m"] for start in told["starts"]})
    )
    last = f", last sortie at {duration_text(timed[-1][0])}" if timed else ""
    rows = flights_rows(told["starts"], told["usable_s"])
    rows += [("starts", f"{starts_text(first)}{last}; at {heights} m")]
    if told["cross_track_m"]:
        rows.append(
            (
                "reserve",
                (
                    f"{told['cross_track_m']:.3g} m on each side of a row for errors of positions:"
                    " without missions there is none by default, and the search takes less time"
                ),
            )
        )
    rows += [
        ("sortie", f"{name}: start it {duration_text(time)} after the first missions")
        for time, name in timed[:_ROWS]
    ]
    if len(timed) > _ROWS:
        rows.append(("", f"and {len(timed) - _ROWS} more, in missions.json"))
    if later:
        unset = "" if told["recharge_s"] else "; set recharge in --vehicle"
        rows.append(
            ("recharge", f"{told['recharge_s'] / 60:g} min between the sorties of a vehicle{unset}")
        )
    if told["airspace_m"] > _SEEN:
        rows.append(
            (
                "airspace",
                (
                    f"turns lead up to {told['airspace_m']:.3g} m outside of the region"
                    f"{'; the fence contains them' if told['fenced'] else ''}"
                ),
            )
        )
    if told["separation_m"] is not None:
        rows.append(("nearest", approach_text(told["nearest_approach"], *told["separation_m"])))
    if told["near_homes"] is not None:
        rows.append(("warning", told["near_homes"]["warning"]))
    rows += [("caution", text) for text in told["cautions"]]
    return rows


def outside_rows(routes: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Return the row of a summary with the lengths of paths outside the region, from launch and to
    landing points.

    Examples
    --------
    >>> outside_rows([{"robot": 1, "outside_out_m": 20.0, "outside_home_m": 0.0}])
    [('outside', 'robot 1 leads 20 m outside the region on its way out, and 0 m on its way home')]
    """
    far = [one for one in routes if max(one["outside_out_m"], one["outside_home_m"]) > _SEEN]
    rows = [
        (
            "outside" if not number else "",
            (
                f"robot {one['robot']} leads {one['outside_out_m']:.4g} m outside the region on its"
                f" way out, and {one['outside_home_m']:.4g} m on its way home"
            ),
        )
        for number, one in enumerate(far[:_ROWS])
    ]
    return rows + ([("", f"and {len(far) - _ROWS} more")] if len(far) > _ROWS else [])


def layers_rows(layers: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Return the rows of a summary that describe the altitude layers.

    If there are several layers, each layer has one row. For a single layer, the only row gives the
    size of the camera's pixels on the ground. For a single layer without a camera, the result has
    no row.
    """
    pixels = [
        f", {100 * layer['ground_sample_m']:.3g} cm per pixel" if layer["ground_sample_m"] else ""
        for layer in layers
    ]
    if len(layers) == 1:
        return [("camera", pixels[0][2:])] if pixels[0] else []
    texts = [
        f"{layer['altitude_m']:.4g} m: {layer['cells']} cells of {layer['cell_m']:.4g} m, rows at"
        f" {layer['angle_degrees']:.4g}\N{DEGREE SIGN}, {100 * layer['covered_fraction']:.4f} %"
        f" seen{pixel}"
        for layer, pixel in zip(layers, pixels, strict=True)
    ]
    told = texts[:_ROWS] + [f"and {len(texts) - _ROWS} more"] * (len(texts) > _ROWS)
    return [("layers" if not number else "", text) for number, text in enumerate(told)]


def compared_rows(episode: SearchEpisode) -> list[tuple[str, str]]:
    """Return the rows of a summary that list the compared tours and the compared allocations, each
    with its time.
    """
    from shoal.search.episode import duration_text

    plan = episode.plan
    tours = [
        f"{one.tour}, rows at {one.angle:.4g}\N{DEGREE SIGN}: "
        + duration_text(one.cells * plan.cell_seconds if one.seconds is None else one.seconds)
        for one in plan.compared
        if one.allocation is None
    ]
    shares = [
        f"{one.allocation} {duration_text(plan.seconds(one.cells))}"
        for one in plan.compared
        if one.allocation is not None
    ]
    alone = not any(one.seconds is not None for one in plan.compared)
    done = "all robots finish within"
    apart = "" if plan.schedule is None else ", not yet kept apart,"
    if plan.flies:
        done = f"all vehicles{apart} are back within"
    rows = [
        ("tours", "one robot searches the whole tour in" if alone else done, tours),
        ("allocations", "all robots finish within" if alone else done, shares),
    ]
    return [(name, f"{what}: {'; '.join(texts)}") for name, what, texts in rows if texts]


def place_text(finding: dict[str, Any]) -> str:
    """Return the position of a finding as text: latitude and longitude, or x and y in metres for a
    region in metres.
    """
    up = f", {finding['altitude']:.4g} m up" if "altitude" in finding else ""
    if "latitude" not in finding:
        return f"({finding['x']:.6g}, {finding['y']:.6g}) m{up}"
    north, east = finding["latitude"], finding["longitude"]
    return (
        f"{abs(north):.6f}° {'N' if north >= 0 else 'S'}, {abs(east):.6f}°"
        f" {'E' if east >= 0 else 'W'}{up}"
    )


def files_text(written: list[Path]) -> list[str]:
    """Return lines of text with the names of files. The files of all missions of one robot share
    one line.

    Examples
    --------
    >>> files_text([Path("out/map.png"), Path("m/robot-01.plan"), Path("m/robot-01.kml"), Path("m/robot-01-2.plan")])
    ['out/map.png', 'm/robot-01 .plan .kml, 2 sorties']
    """
    lines: dict[str, list[Path]] = {}
    for path in written:
        robot = re.fullmatch(r"(robot-\d+)(-\d+)?", path.stem)
        lines.setdefault(str(path.parent / robot[1]) if robot else str(path), []).append(path)
    found = []
    for name, files in lines.items():
        suffixes, sorties = (
            dict.fromkeys(file.suffix for file in files),
            len({file.stem for file in files}),
        )
        kinds = "" if files == [Path(name)] else " " + " ".join(suffixes)
        found.append(f"{name}{kinds}{f', {sorties} sorties' if sorties > 1 else ''}")
    return found
