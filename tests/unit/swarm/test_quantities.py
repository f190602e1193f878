"""Metres, millimetres and seconds in every result of a swarm."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest

from shoal import cli, write_map
from shoal.core.errors import InvalidInputError
from shoal.swarm import GridWorkspace, SwarmEpisode, SwarmProblem
from shoal.swarm.run import run

TOWER = np.zeros((4, 3, 5), dtype=bool)
TOWER[:, 1, 2] = TOWER[2, 1, :] = True


def moved(episode):
    """Return the distance in mm, from the frames of the episode."""
    states = [state.cells for state, _ in episode.frames()]
    assert all(len(cells) == 1 for cells in states)
    return float(
        sum(
            np.abs((after - before) * np.array(episode.workspace.spacing)).sum()
            for before, after in pairwise(states)
        )
    )


def test_a_stack_with_three_spacings(tmp_path):
    problem = SwarmProblem(
        TOWER, particles=1, cell_size=(5.0, 0.5, 0.25), move_seconds=0.2, scan_seconds=1.5
    )
    episode = run(problem)
    report = episode.report()
    assert report["cell_mm"] == [5.0, 0.5, 0.25]
    assert report["cell_m"] == [0.005, 0.0005, 0.00025]
    assert report["distance_mm"] == pytest.approx(moved(episode))
    assert report["distance_mm"] > episode.distance * 0.25
    assert report["apparatus_seconds"] == pytest.approx(0.2 * episode.moves + 1.5 * episode.scans)
    episode.save(tmp_path / "episode.npz")
    assert SwarmEpisode.load(tmp_path / "episode.npz").report() == report
    again = SwarmProblem.from_dict(json.loads(json.dumps(problem.to_dict())))
    assert again.place.spacing == (5.0, 0.5, 0.25)
    assert run(again).report() == report


def test_unknown_quantities_are_null():
    report = run(SwarmProblem("maze:9x7", particles=3)).report()
    assert {
        report[name]
        for name in (
            "cell_m",
            "cell_mm",
            "distance_mm",
            "move_seconds",
            "scan_seconds",
            "apparatus_seconds",
        )
    } == {None}
    assert (
        run(SwarmProblem("maze:9x7", particles=3, move_seconds=2.0)).report()["apparatus_seconds"]
        > 0
    )


@pytest.mark.parametrize("command", ["map", "cover"])
@pytest.mark.parametrize("trials", [1, 3])
def test_commands_print_them(tmp_path, capsys, command, trials):
    write_map(GridWorkspace(TOWER), tmp_path / "stack.tif")
    given = [
        command,
        str(tmp_path / "stack.tif"),
        "-n",
        "1",
        "--cell-size",
        "5,0.5,0.25",
        "--move-seconds",
        "0.5",
        "--trials",
        str(trials),
    ]
    assert cli.run([*given, "--json", "--out", str(tmp_path / "out")]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["cell_mm"] == [5.0, 0.5, 0.25]
    assert result["cell_m"] == [0.005, 0.0005, 0.00025]
    assert len(result["distance_mm"]) == trials
    assert result["move_seconds"] == 0.5
    assert result["apparatus_seconds"] == [0.5 * moves for moves in result["moves"]]
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["cell_mm"] == [
        5.0,
        0.5,
        0.25,
    ]
    assert cli.run(given) == 0
    text = capsys.readouterr().out
    assert "5 × 0.5 × 0.25 mm (layer, row, column)" in text
    assert "apparatus" in text
    if trials == 1:
        assert f"({result['distance_mm'][0]:.6g} mm)" in text


def test_volumes_and_widths_keep_their_spacing(tmp_path):
    pytest.importorskip("nibabel")
    write_map(GridWorkspace(TOWER, spacing=(5.0, 0.5, 0.25)), tmp_path / "volume.nii.gz")
    assert run(SwarmProblem(str(tmp_path / "volume.nii.gz"), particles=1)).report()[
        "cell_mm"
    ] == pytest.approx([5.0, 0.5, 0.25])


def test_sizes_that_do_not_fit_are_refused(capsys):
    with pytest.raises(
        InvalidInputError, match=r"cell_size: expected 1 size or 2 sizes for a 2-D map, got 3"
    ):
        assert SwarmProblem("maze:9x7", cell_size=(1.0, 2.0, 3.0)).place
    for wrong in ("0", "1,2,3,4", "1,-1", "1,nan", "one"):
        assert cli.run(["map", "maze:9x7", "-n", "2", "--cell-size", wrong]) == 2
        assert "cell" in capsys.readouterr().err
