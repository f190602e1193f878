"""The command line: the JSON contract, and that every command has what all commands have."""

from __future__ import annotations

import gc
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pathspec
import pytest

from shoal import cli
from shoal.cli import main, run
from shoal.cli.commands import COMMANDS
from shoal.core.version import __version__

ROOT = Path(__file__).parents[2]
FIELDS = [
    "task",
    "policy",
    "map",
    "particles",
    "placement",
    "rule",
    "seed",
    "trials",
    "moves",
    "status",
    "mean",
    "std",
]
FIELDS += [
    "scan_every",
    "scan_cost",
    "move_cost",
    "scans",
    "cost",
    "mean_cost",
    "distance",
    "unreachable_cells",
]
FIELDS += ["cell_m", "cell_mm", "distance_mm", "move_seconds", "scan_seconds", "apparatus_seconds"]


@pytest.mark.parametrize("command", [*COMMANDS])
def test_every_command_has_the_common_options_and_an_example(command, capsys):
    assert run([*command.split(), "--help"]) == 0
    text = capsys.readouterr().out
    # The studio has no result to print or to write: its pages have.
    for option in ("--help",) if command == "studio" else ("--json", "--out", "--help"):
        assert option in text
    assert f"Example: shoal {command}" in text


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "studio"])
def test_every_command_takes_a_seed_and_help_shows_it_only_if_it_has_an_effect(command, capsys):
    assert run([*command.split(), "--seed", "5", "--help"]) == 0
    without = {
        "schedule",
        "tour",
        "robot",
        "rehearse",
        *(name for name in COMMANDS if name.startswith(("missions ", "bench "))),
        *(name for name in COMMANDS if name.startswith("sweep ") and name != "sweep run"),
    }
    assert ("--seed" in capsys.readouterr().out) is (command not in without)


def test_a_seed_without_an_effect_is_told(capsys):
    assert run(["schedule", "--scan-cost", "1", "--move-cost", "1", "--seed", "3", "--json"]) == 0
    printed, said = capsys.readouterr()
    assert json.loads(printed)
    assert said == "shoal: --seed has no effect on schedule, in which nothing is random\n"
    assert run(["schedule", "--scan-cost", "1", "--move-cost", "1"]) == 0
    assert capsys.readouterr().err == ""


def test_help_lists_commands_and_options_under_headings(capsys):
    assert run(["--help"]) == 0
    text = capsys.readouterr().out
    headings = [
        re.search(f"─ {heading} ─", text).start()
        for heading in ("Swarm", "Steering", "Search", "Experiments", "General")
    ]
    assert headings == sorted(headings)
    assert headings[0] < text.index(" cover ") < headings[1] < text.index(" reach ") < headings[2]
    assert run(["search", "--help"]) == 0
    text = capsys.readouterr().out
    places = [
        text.index(word)
        for word in (
            "--json",
            "─ Robots ─",
            "--robots",
            "─ Tour ─",
            "--tour",
            "─ Region ─",
            "--no-go",
            "─ Missions ─",
        )
    ]
    assert places == sorted(places)


@pytest.mark.parametrize(
    ("arguments", "task"),
    [
        (["map", "maze:9x7"], "mapping"),
        (["cover", "maze:9x7"], "coverage"),
        (["cover", "maze:9x7", "--subset", "0.2"], "subset-coverage"),
    ],
)
def test_json_of_map_and_cover(arguments, task, capsys):
    assert run([*arguments, "-n", "4", "--trials", "3", "--seed", "6", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert sorted(result) == sorted(FIELDS)
    assert result["task"] == task
    assert result["map"] == {"name": "maze:9x7", "shape": [7, 9], "free_cells": 39}
    assert (result["particles"], result["trials"], result["seed"], result["rule"]) == (
        4,
        3,
        6,
        "block",
    )
    assert len(result["moves"]) == len(result["status"]) == 3
    assert result["mean"] == pytest.approx(sum(result["moves"]) / 3)


def test_same_seed_same_output_for_any_workers(capsys):
    outputs = []
    for workers in ("1", "2", "5"):
        arguments = [
            "map",
            "cave:30x20",
            "-n",
            "9",
            "--trials",
            "11",
            "--seed",
            "3",
            "--workers",
            workers,
            "--json",
        ]
        assert run(arguments) == 0
        outputs.append(capsys.readouterr().out)
    assert len(set(outputs)) == 1


def test_progress_goes_to_stderr(capsys):
    assert run(["map", "line:30", "-n", "5", "--trials", "20", "--json"]) == 0
    captured = capsys.readouterr()
    assert "trials: 100 %" in captured.err
    assert len(captured.out.splitlines()) == 1


def test_out_and_replay(tmp_path, capsys):
    out = tmp_path / "result"
    assert (
        run(["map", "maze:9x7", "-n", "4", "--out", str(out), "--film", str(out / "film.html")])
        == 0
    )
    assert {path.name for path in out.iterdir()} == {
        "map.png",
        "frontier.png",
        "episode.npz",
        "summary.json",
        "film.html",
    }
    capsys.readouterr()
    assert run(["replay", str(out / "episode.npz"), "--seed", "0", "--json"]) == 0
    replayed = json.loads(capsys.readouterr().out)
    stored = json.loads((out / "summary.json").read_text())
    assert replayed["verified"] is True
    assert {key: replayed[key] for key in FIELDS} == stored
    assert len(replayed["commands"]) == replayed["moves"][0]


def test_replay_of_a_changed_episode_fails(tmp_path, capsys):
    import numpy as np

    path = tmp_path / "episode.npz"
    assert run(["map", "maze:9x7", "-n", "4", "--out", str(tmp_path)]) == 0
    with np.load(path) as archive:
        arrays = dict(archive)
    arrays["frontier"][3] += 1
    np.savez_compressed(path, **arrays)
    capsys.readouterr()
    assert run(["replay", str(path)]) == 1
    assert "frontier differs at move 4" in capsys.readouterr().err


def test_many_trials_write_their_episodes(tmp_path, capsys):
    assert run(["map", "maze:9x7", "-n", "4", "--trials", "3", "--out", str(tmp_path)]) == 0
    assert sorted(path.name for path in (tmp_path / "episodes").iterdir()) == [
        "00000.npz",
        "00001.npz",
        "00002.npz",
    ]


@pytest.mark.parametrize("group", ["missions", "sweep"])
def test_a_group_without_a_command_is_refused_in_a_sentence(group, capsys):
    assert run([group]) == 2
    printed = capsys.readouterr()
    assert "Commands" in printed.out
    assert printed.err == "shoal: expected a command, one of those above\n"


def test_maps(tmp_path, capsys):
    assert run(["maps", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["maps"]
    assert {entry["name"] for entry in listed} == {
        "line",
        "rectangle",
        "htree",
        "vessels",
        "vessels3d",
        "vessels3d-loops",
        "maze",
        "cave",
    }
    assert (
        run(["maps", "vessels:400", "--seed", "3", "--out", str(tmp_path / "v.png"), "--json"]) == 0
    )
    written = json.loads(capsys.readouterr().out)
    assert (written["name"], written["free_cells"]) == ("vessels:400:3", 400)
    assert run(["map", str(tmp_path / "v.png"), "-n", "9", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["map"]["free_cells"] == 400
    assert run(["maps", "line:3"]) == 0
    assert capsys.readouterr().out == "...\n"


def test_sizes_of_maps_name_their_sides(tmp_path, capsys):
    assert run(["maps", "cave:60x36", "--out", str(tmp_path / "cave.png")]) == 0
    assert "36 rows × 60 columns" in capsys.readouterr().out
    assert run(["map", "rectangle:5x8", "-n", "4"]) == 0
    assert "rectangle:5x8, 5 rows × 8 columns, 40 free cells" in capsys.readouterr().out
    assert run(["drive", "line:6", "--rig", "simulated", "-n", "2"]) == 0
    assert "1 row × 6 columns" in capsys.readouterr().out
    assert run(["tour", "comb", "8x4x3"]) == 0
    assert "3 layers × 4 rows × 8 columns" in capsys.readouterr().out


def test_version(capsys):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.strip() == __version__


def test_a_policy_beside_the_command(tmp_path):
    """A user's own policy is found in the folder where the command is typed."""
    (tmp_path / "mine.py").write_text(
        "class Mine:\n    name = 'mine'\n    def decide(self, view, memory, rng):\n        return"
        " 'lurd'[rng.integers(4)], None\n"
    )
    command = [
        sys.executable,
        "-c",
        "from shoal.__main__ import main; main()",
        "map",
        "line:4",
        "-n",
        "2",
        "--policy",
        "mine:Mine",
        "--json",
    ]
    done = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
    assert json.loads(done.stdout)["policy"] == "mine"


def test_nothing_that_was_loaded_is_looked_through_at_the_end(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["shoal", "--version"])
    before = gc.get_threshold()
    with pytest.raises(SystemExit):
        main()
    frozen = gc.get_freeze_count()
    gc.unfreeze()
    gc.set_threshold(*before)
    assert frozen > 1000


def test_an_interruption_is_said_while_c_libraries_are_quiet():
    script = "from shoal.core.notices import quiet; from shoal.core.interruption import end\nwith quiet(): end()"
    ended = subprocess.run(
        [sys.executable, "-c", script], check=False, capture_output=True, text=True
    )
    assert (ended.returncode, ended.stderr) == (130, "shoal: interrupted\n")


def test_importing_shoal_loads_nothing_heavy():
    script = (
        "import sys, shoal; heavy = {'numpy', 'numba', 'matplotlib', 'scipy', 'typer', 'PIL'} &"
        " set(sys.modules); assert not heavy, heavy; import shoal.cli; assert 'numpy' not in"
        " sys.modules, 'for help'; assert set(shoal.__all__) <= set(dir(shoal)); [getattr(shoal,"
        " name) for name in shoal.__all__]"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


def test_small_commands_load_no_library_that_they_do_not_use():
    script = (
        "import sys; from shoal.cli import run\n"
        "for part in ('map', 'maps', 'drive', 'search', 'steer', 'missions check'):\n"
        "    assert run([*part.split(), '--help']) == 0\n"
        "    unused = {'pydantic', 'llvmlite', 'numba', 'ssl'} & set(sys.modules)\n"
        "    assert not unused, (part, unused)\n"
        "words = ['map', 'line:9', '-n', '3', '--slip', '0.1', '--json']\n"
        "assert run(words) == 0; assert not {'pydantic', 'numba'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", script], check=True, stdout=subprocess.DEVNULL)


@pytest.mark.parametrize("number", ["3", "003", "+3", " 3", "3.0"])
def test_whole_numbers_are_read_with_and_without_the_library_that_checks_them(number, capsys):
    assert run(["map", "line:9", "-n", number, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["particles"] == 3


@pytest.mark.parametrize("text", ["9" * 5000, "3.5", "-", "\u0663x", "1e1"])
def test_what_is_no_whole_number_is_refused_in_a_sentence(text, capsys):
    assert run(["map", "line:9", "-n", text, "--json"]) == 2
    assert re.match("shoal: (-n|--particles|particles): ?", capsys.readouterr().err)


@pytest.mark.parametrize(
    ("text", "code"),
    [("0.25", 0), (".25", 0), ("1e-1", 0), ("0", 0), ("nan", 2), ("x", 2), ("9" * 400, 2)],
)
def test_numbers_are_read_with_and_without_the_library_that_checks_them(text, code, capsys):
    assert run(["map", "line:9", "-n", "3", "--slip", text, "--json"]) == code
    if code == 0:
        rate = json.loads(capsys.readouterr().out).get("noise", {}).get("slip", 0)
        assert rate == float(text)


def test_the_list_of_commands_bears_a_folder_that_an_earlier_version_left(tmp_path):
    folder = tmp_path / "shoal"
    shutil.copytree(
        Path(cli.__file__).parents[1] / "cli",
        folder / "cli",
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    (folder / "cli" / "sweep" / "__pycache__").mkdir(parents=True)
    script = (
        "import sys, shoal; shoal.__path__.insert(0, sys.argv[1])\n"
        "from shoal.cli import run; sys.exit(run(['sweep', '--help']))"
    )
    subprocess.run(
        [sys.executable, "-c", script, str(folder)], check=True, stdout=subprocess.DEVNULL
    )


def test_depth_first_states_its_ratio(capsys):
    assert run(["map", "maze:9x7", "-n", "1", "--policy", "depth-first"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "steps, of which any tour of the cells needs 38 (never above 2)" in text


def test_episodes_of_an_earlier_run_do_not_stay(tmp_path):
    for trials in ("4", "2", "1"):
        assert run(["map", "line:9", "-n", "4", "--trials", trials, "--out", str(tmp_path)]) == 0
        count = int(trials) if trials != "1" else 0
        assert len(list((tmp_path / "episodes").glob("*.npz"))) == count
    assert (tmp_path / "episode.npz").exists()


def test_a_refused_run_leaves_no_folder(tmp_path, capsys):
    assert (
        run(
            [
                "map",
                "line:9",
                "-n",
                "99",
                "--out",
                str(tmp_path / "out"),
                "--film",
                str(tmp_path / "films" / "f.gif"),
            ]
        )
        == 2
    )
    assert not list(tmp_path.iterdir())


def test_an_internal_error_has_an_exit_code_of_its_own(monkeypatch, capsys):
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr("shoal.lab.Store", broken)
    assert run(["sweep", "status", "results.sqlite"]) == 70
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "Traceback" in printed.err
    assert (
        printed.err.splitlines()[-1] == "shoal: internal error: ZeroDivisionError: division by zero"
    )
    assert run(["--help"]) == 0
    assert "70 an error in Shoal itself" in " ".join(capsys.readouterr().out.split())


def test_help_lists_all_commands(capsys):
    """One whose module became a folder once took the whole list away."""
    assert run(["--help"]) == 0
    listed = capsys.readouterr().out
    assert [name for name in COMMANDS if f"│ {name.split()[0]} " not in listed] == []


def test_packages_leave_nothing_out():
    """What is ignored in the checkout is in no wheel, even if it was committed: ``demo/`` once took
    the command's own demo away.
    """
    ignored = pathspec.GitIgnoreSpec.from_lines(
        (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()
    )
    files = [
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "src").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    ]
    assert len(files) > 400
    assert not [*ignored.match_files(files)]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missions", "start", ".", "--lowest-battery", "200"], "--lowest-battery: expected"),
        (["missions", "upload", ".", "--sortie", "0"], "--sortie: expected"),
        (["robot", ".", "--radio", "udp:lo:1,lo:2", "--id", "0"], "--id: expected"),
        (
            ["drive", "line:5", "--rig", "simulated", "--enter-every", "0"],
            "--enter-every: expected",
        ),
    ],
)
def test_numbers_out_of_range_are_refused(arguments, message, capsys):
    assert run(arguments) == 2
    assert message in capsys.readouterr().err
