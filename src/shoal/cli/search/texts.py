"""Texts for the printed summary of the command ``shoal search``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shoal.cli.output import print_table
from shoal.cli.search.missions import approach_text, area_text, margin_text, zones_text

if TYPE_CHECKING:
    from shoal.search import SearchEpisode

_ROWS = 12


def print_search(episode: SearchEpisode, result: dict[str, Any], written: list[Path], *more: tuple[str, str]) -> None:
    """Print the summary of a search."""
    region = result["region"]
    rows = [
        (
            "region",
            f"{region['cells']} cells of {region['cell_m']:.4g} m, {region['area_m2']:.6g} m²{zones_text(region['no_go_zones'])}"
            f"{margin_text(region['margin_m'], region['unseen_m2'])}",
        ),
        *layers_rows(result["layers"]),
        ("status", f"{result['status']}: {result['reason']}"),
        ("time", times_text(result)),
        ("covered", f"{100 * result['covered_fraction']:.4f} %, {area_text(result['uncovered_m2'])} not seen"),
        ("messages", f"{result['messages']['sent']} sent, {result['messages']['lost']} lost; {result['takeovers']} takeovers"),
    ]
    for route in result["routes"][:_ROWS]:
        stops = "" if route["stops"] == route["cells"] else f" from {route['stops']} stops with {route['footprint_m']:g} m"
        told = f"{route['status']}: {route['cells']} cells{stops}, {route['length_m']:.5g} m, {route['turns']} turns"
        rows.append((f"robot {route['robot']}", told))
    if len(result["routes"]) > _ROWS:
        rows.append(("", f"and {len(result['routes']) - _ROWS} more"))
    rows += [
        ("found", f"at {place_text(finding)}, sure to {100 * finding['confidence']:.1f} %")
        for finding in result["findings"][:_ROWS]
    ]
    if "missions" in result:
        rows += missions_rows(result["missions"])
    rows += [("compared", text) for text in compared_texts(result["compared"])]
    print_table([*rows, *more], title=f"{result['allocation']} along {result['tour']}", written=files_text(written))


def times_text(result: dict[str, Any]) -> str:
    """Return the actual time, the planned time and the minimum time of a search as text, each as a duration and in cells."""
    from shoal.search.episode import duration_text

    if result["makespan_s"] is None:
        return "not all was searched"
    made, planned, least = (
        f"{duration_text(result[f'{name}_s'])} ({result[f'{name}_cells']:.6g} cells)"
        for name in ("makespan", "planned", "lower_bound")
    )
    return f"{made}; planned {planned}, at least {least}"


def missions_rows(told: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of a summary that describe missions: their start times, and the distances between vehicles.

    Each sortie after the first sortie of its vehicle has its own row, in the order of the start times.
    """
    from shoal.search.episode import duration_text

    first = [start["delay_s"] for start in told["starts"] if start["sortie"] == 1]
    later = [start for start in told["starts"] if start["sortie"] > 1]
    timed = sorted((start["start_s"], start["mission"]) for start in later if start["start_s"] is not None)
    heights = ", ".join(f"{height:g}" for height in sorted({start["altitude_m"] for start in told["starts"]}))
    last = f", last sortie at {duration_text(timed[-1][0])}" if timed else ""
    rows = [("starts", f"first starts within {duration_text(max(first, default=0.0))}{last}; at {heights} m")]
    rows += [("sortie", f"{name}: start it {duration_text(time)} after the first missions") for time, name in timed[:_ROWS]]
    if len(timed) > _ROWS:
        rows.append(("", f"and {len(timed) - _ROWS} more, in missions.json"))
    if later:
        unset = "" if told["recharge_s"] else "; set recharge in --vehicle"
        rows.append(("recharge", f"{told['recharge_s'] / 60:g} min between the sorties of a vehicle{unset}"))
    if told["airspace_m"]:
        rows.append(("airspace", f"turns lead up to {told['airspace_m']:.3g} m outside of the region; the fence contains them"))
    if told["separation_m"] is not None:
        rows.append(("nearest", approach_text(told["nearest_approach"], *told["separation_m"])))
    if told["near_homes"] is not None:
        rows.append(("warning", told["near_homes"]["warning"]))
    return rows


def layers_rows(layers: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Return the rows of a summary that describe the altitude layers, one row for each of several layers.

    For a single layer, the only row gives the size of the camera's pixels on the ground; without a camera, the result has no row.
    """
    pixels = [f", {100 * layer['ground_sample_m']:.3g} cm per pixel" if layer["ground_sample_m"] else "" for layer in layers]
    if len(layers) == 1:
        return [("camera", pixels[0][2:])] if pixels[0] else []
    texts = [
        f"{layer['altitude_m']:.4g} m: {layer['cells']} cells of {layer['cell_m']:.4g} m, "
        f"rows at {layer['angle_degrees']:.4g}\N{DEGREE SIGN}, {100 * layer['covered_fraction']:.4f} % seen{pixel}"
        for layer, pixel in zip(layers, pixels, strict=True)
    ]
    told = texts[:_ROWS] + [f"and {len(texts) - _ROWS} more"] * (len(texts) > _ROWS)
    return [("layers" if not number else "", text) for number, text in enumerate(told)]


def compared_texts(compared: list[dict[str, Any]]) -> list[str]:
    """Return lines of text that list the compared tours and allocations with their search times in cells.

    Examples
    --------
    >>> told = {"angle_degrees": 0.0, "tour": "comb"}
    >>> hop, stay = told | {"allocation": "hop", "cells": 30}, told | {"allocation": "stay", "cells": 41}
    >>> compared_texts([hop, stay])
    ['time of all in cells: hop 30, stay 41']
    """
    tours = [f"{one['tour']} at {one['angle_degrees']:.4g}° {one['cells']:.6g}" for one in compared if "allocation" not in one]
    shares = [f"{one['allocation']} {one['cells']:.6g}" for one in compared if "allocation" in one]
    told = {"time once round in cells, turns included": tours, "time of all in cells": shares}
    return [f"{what}: {', '.join(texts)}" for what, texts in told.items() if texts]


def place_text(finding: dict[str, Any]) -> str:
    """Return the position of a finding as text: latitude and longitude, or x and y in metres for a region in metres."""
    up = f", {finding['altitude']:.4g} m up" if "altitude" in finding else ""
    if "latitude" not in finding:
        return f"({finding['x']:.6g}, {finding['y']:.6g}) m{up}"
    north, east = finding["latitude"], finding["longitude"]
    return f"{abs(north):.6f}° {'N' if north >= 0 else 'S'}, {abs(east):.6f}° {'E' if east >= 0 else 'W'}{up}"


def files_text(written: list[Path]) -> list[str]:
    """Return lines of text with the names of files, in which all missions of one robot share one line.

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
        suffixes, sorties = dict.fromkeys(file.suffix for file in files), len({file.stem for file in files})
        kinds = "" if files == [Path(name)] else " " + " ".join(suffixes)
        found.append(f"{name}{kinds}{f', {sorties} sorties' if sorties > 1 else ''}")
    return found
