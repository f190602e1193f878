"""shoal drive --calibrate: measure a bench, and write the calibration file and a picture of it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli.output import print_json, print_table, say
from shoal.core.errors import InvalidInputError, OutputError

if TYPE_CHECKING:
    from shoal.rigs.calibration import BenchCalibration
    from shoal.rigs.ports import Actuator, Sensor
    from shoal.rigs.registration import Tie
    from shoal.swarm import GridWorkspace

CalibrateInto = Annotated[
    Path | None,
    typer.Option(
        "--calibrate",
        metavar="FILE.json",
        help=(
            "Instead of a drive: measure with test pulses where a pixel lies in the grid and how"
            " pulses move the particles, and write FILE.json and FILE.png."
        ),
    ),
]
CalibrationFile = Annotated[
    Path | None,
    typer.Option(
        "--calibration",
        metavar="FILE",
        help="Calibration of the two devices, written with --calibrate (JSON or TOML).",
    ),
]
Marks = Annotated[
    list[str] | None,
    typer.Option(
        "--mark",
        metavar="X,Y=ROW,COLUMN",
        help=(
            "For --calibrate: a pixel, and the row and column there (the middle of the first cell"
            " is 0,0). At least three marks tie the picture to the grid; four show an error."
        ),
    ),
]
PixelSize = Annotated[
    float | None,
    typer.Option(
        "--pixel-size",
        metavar="UM",
        help=(
            "For --calibrate without marks: side of a pixel in µm. With --cell-size, a grid over the"
            " whole picture is made, along the directions of the pulses."
        ),
    ),
]
Frequencies = Annotated[
    list[float] | None,
    typer.Option(
        "--frequency",
        metavar="HZ",
        help=(
            "For --calibrate: a frequency of the turning field at which the speed is measured as well"
            " (at least three), to find the step-out frequency."
        ),
    ),
]
Trim = Annotated[
    bool | None,
    typer.Option(
        "--trim/--no-trim",
        help=(
            "Correct length and heading of the pulses during the drive by what the camera shows."
        ),
        show_default="with --calibration",
    ),
]


def read_marks(texts: list[str]) -> list[tuple[float, ...]]:
    """Return x, y, row and column of each mark."""
    number = r"\s*([+-]?(?:\d+\.?\d*|\.\d+))\s*"
    form = re.compile(f"{number},{number}={number},{number}")
    marks = []
    for text in texts:
        found = form.fullmatch(text)
        if found is None:
            raise InvalidInputError(
                f"mark: expected X,Y=ROW,COLUMN, such as 120,80.5=0,3, got {text[:60]!r}"
            )
        marks.append(tuple(map(float, found.groups())))
    return marks


def check_calibrating(
    into: Path | None,
    marks: list[str] | None,
    pixel_size: float | None,
    frequencies: list[float] | None,
    **of_a_drive: Any,
) -> None:
    """Refuse options without effect, and a file that cannot be written."""
    if into is None:
        only = {"mark": marks, "pixel-size": pixel_size, "frequency": frequencies}
        for name, value in only.items():
            if value:
                raise InvalidInputError(f"{name}: expected --calibrate FILE beside it, got none")
        return
    for name, value in of_a_drive.items():
        if value is not None:
            raise InvalidInputError(f"{name}: expected a drive, got --calibrate, which makes none")
    if into.suffix != ".json":
        raise InvalidInputError(f"calibrate: expected a file FILE.json, got {str(into)!r}")
    if not into.parent.is_dir():
        raise OutputError(f"calibrate: expected an existing folder, got {str(into.parent)!r}")
    if marks and pixel_size is not None:
        raise InvalidInputError(
            "pixel-size: expected either marks or the size of a pixel, got both"
        )


def calibrate_bench(
    devices: tuple[Actuator, Sensor],
    into: Path,
    *,
    marks: list[str] | None,
    pixel_size: float | None,
    frequencies: list[float] | None,
    cell_size: tuple[float, ...] | None,
    shape: tuple[int, ...] | None,
    truth: GridWorkspace | None,
    json_: bool,
) -> None:
    """Calibrate two devices, write the file and its picture, and print what was found."""
    from shoal.rigs.measuring import calibrate, pulses_of
    from shoal.views.calibration import calibration_figure
    from shoal.views.drawing.charts import save_figure

    actuator, sensor = devices
    view = shape or (None if truth is None else truth.shape)
    side = _side(cell_size)
    tie, about = _tie(sensor, marks, pixel_size, side, view, truth)
    say("shoal: test pulses move the particles back and forth along both axes")
    found = calibrate(
        actuator,
        sensor,
        pulses=pulses_of(actuator),
        tie=tie,
        cell_size=side,
        frequencies=frequencies or (),
        **about,
    )
    picture = getattr(sensor, "picture", lambda: None)()
    points = sensor.observe().points
    figure = calibration_figure(found, points=points, picture=picture)
    found.save(into)
    save_figure(figure, into.with_suffix(".png"))
    _report(found, into, json_=json_)


def _side(cell_size: tuple[float, ...] | None) -> float | None:
    if cell_size is None:
        return None
    if len(set(cell_size)) > 1:
        raise InvalidInputError(f"cell-size: expected square cells, got {cell_size}")
    return cell_size[0]


def _tie(
    sensor: Sensor,
    marks: list[str] | None,
    pixel_size: float | None,
    cell_size: float | None,
    shape: tuple[int, ...] | None,
    truth: GridWorkspace | None,
) -> tuple[Tie | None, dict[str, Any]]:
    """Return how pixels lie in the grid, as far as it is known before the pulses."""
    from shoal.rigs.registration import tie_by_map, tie_by_marks, tie_by_sensor

    if pixel_size is not None:
        size = getattr(sensor, "size", None)
        if cell_size is None:
            raise InvalidInputError("cell-size: expected one beside --pixel-size, got none")
        if size is None:
            raise InvalidInputError(
                f"pixel-size: expected a camera, got the sensor {sensor.name} without pictures"
            )
        return None, {"cell": cell_size * 1000 / pixel_size, "size": size}
    if marks:
        tie = tie_by_marks(read_marks(marks))
    elif getattr(sensor, "calibration", None) is not None:
        shape = getattr(sensor, "shape", shape)
        tie = tie_by_sensor(sensor)
    elif truth is not None and hasattr(sensor, "picture"):
        tie = tie_by_map(sensor.picture(), truth.free)
    else:
        raise InvalidInputError(
            "calibrate: expected at least three --mark, a MAP that the picture shows, or"
            " --pixel-size with --cell-size, got none"
        )
    if shape is None:
        raise InvalidInputError(
            "size: expected --size ROWSxCOLUMNS or a MAP beside marks, got none"
        )
    if len(shape) != 2:
        raise InvalidInputError(f"size: expected rows and columns, got {len(shape)} numbers")
    return tie, {"shape": tuple(shape)}


def summary(found: BenchCalibration) -> dict[str, Any]:
    """Return what ``shoal drive --calibrate --json`` prints."""
    directions = {}
    for letter in "lurd":
        angle, seconds = found.pulse(letter)
        directions[letter] = {
            "gain": round(found.gain(letter) or 0.0, 4),
            "heading": round(found.responses.heading(letter), 3),
            "angle": round(angle, 3),
            "seconds": round(seconds, 6),
            "motions": found.responses.counts.get(letter, 0),
        }
    return {
        "shape": list(found.shape),
        "tie": found.tie,
        "residual": found.residual,
        "pulse_residual": found.responses.residual,
        "pixels_per_cell": round(found.pixels_per_cell, 3),
        "noise": round(found.noise, 4),
        "latency": round(found.latency, 4),
        "own_gain": round(found.own_gain, 4),
        "dead": round(found.responses.dead, 6),
        "directions": directions,
        "speed": None if found.speed is None else found.speed.model_dump(),
        "notes": found.notes,
    }


def _speed_rows(found: BenchCalibration) -> list[tuple[str, str]]:
    speed = found.speed
    if speed is None:
        return []
    pairs = zip(speed.frequencies, speed.speeds, strict=True)
    out = "none seen" if speed.step_out is None else f"{speed.step_out:.3g} Hz"
    return [
        ("speed", ", ".join(f"{each:.2f} cells/s at {hertz:g} Hz" for hertz, each in pairs)),
        ("step-out", out),
    ]


def _report(found: BenchCalibration, into: Path, *, json_: bool) -> None:
    about = summary(found)
    if json_:
        print_json(about)
        return
    residual = "not known" if found.residual is None else f"{found.residual:.3f} cells"
    rows = [
        (
            "grid",
            f"{found.shape[0]} × {found.shape[1]} cells, {found.pixels_per_cell:.1f} pixels a cell",
        ),
        ("pixels to cells", f"by {found.tie}, residual {residual}"),
        ("pulses", f"residual {found.responses.residual:.3f} cells"),
    ]
    for letter, one in about["directions"].items():
        text = (
            f"gain {one['gain']:.3f}, heading {one['heading']:+.1f}°; now {one['seconds']:.4g} s at"
            f" {one['angle']:.1f}° ({one['motions']} motions)"
        )
        rows.append((letter, text))
    rows += [
        ("camera", f"noise {found.noise:.2f} pixels, at rest {found.latency:.3f} s after a pulse"),
        ("particles", f"own gains differ by {100 * found.own_gain:.0f} %"),
        *_speed_rows(found),
        *(("note", note) for note in found.notes),
    ]
    written = [into, into.with_suffix(".png")]
    print_table(rows, title="calibration", written=written)
