"""shoal robot: what it refuses, and a search of one robot that goes on after its end."""

from __future__ import annotations

import json
import socket

import pytest

from shoal.cli import run
from shoal.robots.tasks import write_task
from shoal.search import SearchProblem
from shoal.search.run import run as run_search


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("prepared")
    problem = SearchProblem("rectangle:60x20", robots=1, footprint=20, vehicle="multirotor")
    write_task(run_search(problem, seed=1), folder)
    return folder


@pytest.fixture
def radio():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"udp:127.0.0.1:{probe.getsockname()[1]},127.0.0.1:9"


def test_a_robot_searches_and_a_new_program_knows_that_it_has(prepared, radio, tmp_path, capsys):
    command = ["robot", str(prepared), "--id", "1", "--radio", radio, "--state", str(tmp_path)]
    command += ["--speed-up", "20", "--json"]
    assert run(command) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["complete"], told["searched"], told["cells"]) == (True, 3, 3)
    assert (told["fault"], told["landed"]) == ("", True)
    assert run(command) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["searched"] == 3
    assert "goes on after" in output.err


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ([], "id: expected the number of this robot, got none"),
        (["--id", "2"], "id: expected a robot from 1 to 1, got 2"),
        (["--id", "1", "--vehicle", "boat:"], "vehicle: expected mavlink:LINK or simulated:"),
        (["--id", "1", "--vehicle", "mavlink:udp:x"], "connect: expected udpin:HOST:PORT"),
        (["--id", "1", "--arm"], "arm: expected --vehicle mavlink:..., got simulated:"),
        (["--id", "1", "--accept", "luck"], "accept: expected failsafe, fence, return, got 'luck'"),
        (["--id", "1", "--seconds", "3"], "seconds: expected --watch together with it, got none"),
        (["--id", "1", "--speed-up", "0"], "speed-up: expected a number from 0.1 to 20, got 0"),
        (["--id", "1", "--clock", "none"], "clock: expected the clock of a rehearsal, got none"),
        (["--watch", "--seconds", "0"], "seconds: expected a number, above 0, got 0"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_sentence(
    prepared, radio, tmp_path, capsys, options, sentence
):
    state = ["--state", str(tmp_path / "state")] if "--watch" not in options else []
    assert run(["robot", str(prepared), "--radio", radio, *options, *state]) == 2
    output = capsys.readouterr()
    assert sentence in output.err
    assert len(output.err.splitlines()) == 1
    assert output.out == ""
    assert not [*tmp_path.rglob("*.journal")]


def test_a_check_reads_the_state_that_the_start_reads(prepared, radio, tmp_path, capsys):
    command = ["robot", str(prepared), "--id", "1", "--radio", radio, "--state", str(tmp_path)]
    assert run([*command, "--check"]) == 0
    assert not [*tmp_path.iterdir()]
    state = tmp_path / "robot-01.journal"
    state.write_text("garbage\n")
    capsys.readouterr()
    assert run([*command, "--check"]) == 2
    assert "robot-01.journal: line 1: expected a line with its checksum" in capsys.readouterr().err
    assert state.read_text() == "garbage\n"
    assert run(command) == 2
    assert state.read_text() == "garbage\n"


def test_a_check_says_that_the_radio_does_not_reach_all(radio, tmp_path, capsys):
    problem = SearchProblem("rectangle:60x20", robots=3, footprint=20, vehicle="multirotor")
    write_task(run_search(problem, seed=1), tmp_path)
    command = ["robot", str(tmp_path), "--id", "1", "--check", "--radio"]
    assert run([*command, radio]) == 0
    assert "the radio sends to 1 of 2 other robots" in capsys.readouterr().err
    assert run([*command, f"{radio},127.0.0.1:10"]) == 0
    assert capsys.readouterr().err == ""


def test_no_radio_and_no_task_are_refused(prepared, radio, tmp_path, capsys):
    assert run(["robot", str(prepared), "--id", "1", "--radio", "udp:0.0.0.0:9000,1.2.3.4:9"]) == 2
    assert "expected the address or the name of one interface, got 0.0.0.0" in (
        capsys.readouterr().err
    )
    assert run(["robot", str(tmp_path / "none"), "--id", "1", "--radio", radio]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
