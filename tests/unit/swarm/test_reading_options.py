"""Every reading option on every kind of map: it changes what is read, or it is refused with the
reason.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.unit.swarm.map_samples import GREYS, write_samples

from shoal.cli import run as run_command
from shoal.core.errors import InvalidInputError
from shoal.parts import load_problem
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_problem
from shoal.swarm import GridWorkspace, SwarmProblem
from shoal.swarm.maps.files import FORMATS, open_map
from shoal.swarm.maps.reading import KINDS, REASONS
from shoal.swarm.maps.resampling import diagonal_contacts
from shoal.swarm.problem import READING

for library in ("tifffile", "nibabel", "nrrd", "pydicom"):  # extras
    pytest.importorskip(library)

OPTIONS = {
    "threshold": 0.2,
    "invert": True,
    "scale": 2.0,
    "level": 50,
    "label": 100,
    "channel": 2,
    "frame": 2,
    "width": 20,
    "low": 0.5,
    "high": 1.0,
    "bright": True,
    "thickest": 0.1,
}
GREY = {"threshold", "invert", "scale", "level", "label"}
COLOUR = {"threshold", "invert", "scale", "channel"}
NUMBERS = {"invert", "level", "label"}
# The options that change what is read, and those that the file needs before another option can be
# tried.
USED = {
    "grey.png": (GREY, {}),
    "grey.bmp": (GREY, {}),
    "deep.tif": (GREY, {}),
    "double.tif": (GREY, {}),
    "stack.tif": (GREY, {}),
    "slices": (GREY, {}),
    "colour.png": (COLOUR, {}),
    "colour.jpg": (COLOUR, {}),
    "planes.tif": (COLOUR, {}),
    "palette.png": ({*COLOUR, "label"}, {}),
    "film.gif": ({*GREY, "frame"}, {"frame": 1}),
    "imagej.tif": ({*GREY, "channel", "frame"}, {"channel": 1, "frame": 1}),
    "cells.ome.tif": ({*GREY, "channel", "frame"}, {"channel": 1, "frame": 1}),
    "rows.txt": ({"invert"}, {}),
    "octile.map": ({"invert"}, {}),
    "table.csv": (NUMBERS, {"label": 220}),
    "savetxt.txt": (NUMBERS, {"label": 220}),
    "flat.npy": (NUMBERS, {"label": 220}),
    "fortran.npy": (NUMBERS, {"label": 220}),
    "colour.npy": ({*NUMBERS, "channel"}, {"label": 220}),
    "matrix.mat": (NUMBERS, {"label": 220}),
    "volume.nii.gz": (NUMBERS, {"label": 220}),
    "film.nii": ({*NUMBERS, "frame"}, {"label": 220, "frame": 1}),
    "volume.nrrd": (NUMBERS, {"label": 220}),
    "series": (NUMBERS, {"label": 220}),
    "coloured": ({*NUMBERS, "channel"}, {"channel": 1, "label": 220}),
    "line:7": (set(), {}),
}
SCALED_LABEL = {"deep.tif": {"level": 50 * 290, "label": 100 * 290}, "palette.png": {"label": 2}}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return write_samples(tmp_path_factory.mktemp("kinds")) | {"line:7": "line:7"}


def test_the_table_has_every_option_and_every_format(files):
    assert {*OPTIONS, "vessels", "join_diagonals"} == set(READING) == set(REASONS)
    names = [name.lower() for name in USED]
    # second names of the same readers
    for suffix in set(FORMATS) - {".tiff", ".jpeg", ".nii", ".nhdr", ".dcm"}:
        assert any(name.endswith(suffix) for name in names), suffix
    assert set(files) == set(USED)


@pytest.mark.parametrize("option", OPTIONS)
@pytest.mark.parametrize("name", USED)
def test_an_option_is_used_or_refused(files, name, option):
    used, needed = USED[name]
    used = used | {"width"} if name != "line:7" else used
    value = SCALED_LABEL.get(name, {}).get(option, OPTIONS[option])
    others = {
        key: one
        for key, one in needed.items()
        if not (option in {"level", "label"} and key == "label")
    }
    if option not in used:
        with pytest.raises(InvalidInputError, match=rf"{option}: expected .*, got .*") as refused:
            open_map(files[name], **{**others, option: value})
        assert "\n" not in str(refused.value)
        return
    plain = open_map(files[name], **needed)
    changed = open_map(files[name], **{**others, option: value})
    assert changed.n_free > 0
    assert changed.shape != plain.shape or not np.array_equal(changed.free, plain.free)


DEFAULTS = {
    "vessels": False,
    "low": 0.6,
    "high": 1.2,
    "invert": False,
    "scale": 1.0,
    "join_diagonals": False,
}


def takes(name: str, option: str) -> bool:
    """Whether a kind of map has a meaning for an option at its default value."""
    if option == "vessels":  # it says of a picture that it is no photograph
        return name.endswith((".png", ".bmp", ".jpg", ".tif", ".gif"))
    return option in USED[name][0] or (option == "join_diagonals" and name != "line:7")


def test_the_defaults_are_those_of_the_problem():
    declared = SwarmProblem.declarations()
    assert {
        name: declared[name].default for name in READING if declared[name].default is not None
    } == DEFAULTS


@pytest.mark.parametrize("option", DEFAULTS)
@pytest.mark.parametrize("name", USED)
def test_an_option_at_its_default_is_used_or_refused(files, name, option, monkeypatch):
    monkeypatch.chdir(Path(files["grey.png"]).parent)
    given = {**USED[name][1], option: DEFAULTS[option]}
    problem = checked_problem(
        {"kind": "swarm", "map": Path(files[name]).name, **given}, Folder(".")
    )  # as the studio does
    if takes(name, option):
        plain = open_map(files[name], **USED[name][1])
        assert np.array_equal(open_map(files[name], **given).free, plain.free)
        assert np.array_equal(problem.place.free, plain.free)
        return
    flag = option.replace("_", "-")
    for attempt in (lambda: open_map(files[name], **given), lambda: problem.place):
        with pytest.raises(InvalidInputError, match=rf"{flag}: expected .*, got .*") as refused:
            attempt()
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize("option", [name for name in DEFAULTS if name != "vessels"])
def test_an_option_at_its_default_is_no_option_of_arrays_workspaces_and_photographs(files, option):
    given = {option: DEFAULTS[option]}
    words = rf"{option.replace('_', '-')}: expected no "
    with pytest.raises(InvalidInputError, match=words):
        open_map(GridWorkspace(GREYS), **given)
    if option in {"low", "high", "scale"}:
        with pytest.raises(InvalidInputError, match=words):
            open_map(GREYS, **given)
    else:
        assert np.array_equal(open_map(GREYS, **given).free, open_map(GREYS).free)
    if option not in {"low", "high"}:
        with pytest.raises(InvalidInputError, match=words):
            open_map(files["grey.png"], vessels=True, **given)


@pytest.mark.parametrize("option", DEFAULTS)
@pytest.mark.parametrize("command", [["maps"], ["map", "-n", "1"], ["cover", "-n", "1"]])
def test_commands_refuse_an_option_at_its_default(command, option, capsys):
    value, flag = DEFAULTS[option], option.replace("_", "-")
    words = [f"--no-{flag}"] if value is False else [f"--{flag}", str(value)]
    assert run_command([command[0], "line:7", *command[1:], *words]) == 2
    said = capsys.readouterr().err
    assert f"{flag}: expected no {flag}" in said
    assert said.count("\n") == 1


def test_an_option_replaces_that_of_a_problem_file(tmp_path, files, capsys):
    source = tmp_path / "problem.json"
    source.write_text(
        json.dumps({"kind": "swarm", "map": str(files["grey.png"]), "scale": 2.0, "particles": 1})
    )
    assert load_problem(source).replaced(scale=1.0).place.shape == open_map(files["grey.png"]).shape
    assert "scale" in load_problem(source).replaced(particles=2).given


@pytest.mark.parametrize("name", USED)
def test_diagonal_contacts_are_joined_in_files_only(files, name):
    needed = USED[name][1]
    if name == "line:7":
        with pytest.raises(
            InvalidInputError,
            match=r"join-diagonals: expected no join-diagonals for the generated map",
        ):
            open_map(name, join_diagonals=True)
        return
    plain, joined = (
        open_map(files[name], **needed).free,
        open_map(files[name], **needed, join_diagonals=True).free,
    )
    assert not (plain & ~joined).any()
    assert diagonal_contacts(joined) == 0


@pytest.mark.parametrize(
    "name", [name for name in USED if not name.endswith((".png", ".tif", ".gif", ".bmp", ".jpg"))]
)
def test_vessels_are_found_in_photographs_only(files, name):
    with pytest.raises(InvalidInputError, match=r"expected (a photograph|a picture)"):
        open_map(files[name], vessels=True)


@pytest.mark.parametrize("option", ["threshold", "invert", "scale", "level", "label"])
def test_vessels_exclude_the_options_of_masks(files, option):
    with pytest.raises(
        InvalidInputError,
        match=rf"grey\.png: {option}: expected no {option} for a photograph, got .* \(.+\)",
    ):
        open_map(files["grey.png"], vessels=True, **{option: OPTIONS[option]})


@pytest.mark.parametrize(
    "option", [name for name in OPTIONS if name not in {"invert", "level", "label", "width"}]
)
def test_arrays_and_workspaces(option):
    given = {option: OPTIONS[option]}
    with pytest.raises(
        InvalidInputError, match=rf"{option}: expected no {option} .*, got .* \(.+\)"
    ):
        open_map(GREYS, **given)
    with pytest.raises(
        InvalidInputError, match=rf"{option}: expected no {option} .*, got .* \(.+\)"
    ):
        open_map(GridWorkspace(GREYS), **given)


def test_a_number_decides_in_arrays():
    assert open_map(GREYS, label=220).n_free == np.count_nonzero(GREYS == 220)
    assert open_map(GREYS, label=220, invert=True).n_free == np.count_nonzero(GREYS != 220)
    assert open_map(GREYS, level=100).n_free == np.count_nonzero(GREYS)
    assert open_map(GREYS > 0, invert=True).n_free == np.count_nonzero(GREYS == 0)
    with pytest.raises(InvalidInputError, match="expected no label for a finished workspace"):
        open_map(GridWorkspace(GREYS), label=1)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"threshold": 0.2, "level": 3}, "threshold: expected a threshold or a level, got both"),
        ({"threshold": 0.2, "label": 3}, "threshold: expected a threshold or a label, got both"),
        ({"channel": 0}, "channel: expected a whole number, 1 or more, got 0"),
        ({"channel": ""}, "channel: expected the name of a channel or its number from 1"),
        ({"channel": "²"}, "channel: expected one of"),
        ({"channel": "9" * 400}, "channel: expected the name of a channel or its number from 1"),
        (
            {"channel": "violet"},
            r"channel: expected one of 1 \(red\), 2 \(green\), 3 \(blue\), got 'violet'",
        ),
        ({"frame": 0}, "frame: expected a whole number, 1 or more, got 0"),
        ({"frame": 3}, "frame: expected no frame for a file without a time axis, got 3"),
    ],
)
def test_wrong_values(files, options, words):
    with pytest.raises(InvalidInputError, match=words):
        open_map(files["colour.png"], **options)


def test_every_kind_has_known_options():
    for kind in KINDS.values():
        assert kind.options <= set(READING)


def test_problems_refuse_what_a_finished_workspace_does_not_take():
    from shoal.swarm import SwarmProblem

    with pytest.raises(
        InvalidInputError, match="level: expected no level for a finished workspace, got 3"
    ):
        assert SwarmProblem(GridWorkspace(GREYS), level=3, particles=1).place
    assert SwarmProblem(GridWorkspace(GREYS), particles=1).place.n_free == np.count_nonzero(GREYS)
