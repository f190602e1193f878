"""shoal drive --steer."""

import json

import pytest

from shoal.cli import run

pytest.importorskip("pymunk")

PROBLEM = {
    "workspace": "square",
    "start": [[0.2, 0.3], [0.5, 0.35]],
    "goal": [[0.6, 0.2], [0.7, 0.4]],
}


@pytest.fixture
def problem(tmp_path):
    path = tmp_path / "problem.json"
    path.write_text(json.dumps(PROBLEM))
    return str(path)


def test_two_particles_arrive_with_log_and_picture(problem, tmp_path, capsys):
    log, out = tmp_path / "log.jsonl", tmp_path / "out"
    plant = "physics:roll,friction=2"
    options = ["--friction-at-least", "1", "--log", str(log), "--out", str(out), "--json"]
    assert run(["drive", "--steer", problem, "--rig", plant, *options]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["status"], report["policy"]) == ("arrived", "robust")
    assert report["error"] <= report["tolerance"] == 0.02
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert sum("input" in line for line in lines) == report["moves"]
    assert json.loads((out / "drive.json").read_text())["status"] == "arrived"
    assert (out / "drive.png").stat().st_size > 5000


def test_way_points_and_a_rig_of_ones_own(tmp_path, monkeypatch, capsys):
    (tmp_path / "mine_for_steering.py").write_text(
        "import numpy as np\n"
        "class Rig:\n"
        "    name = 'mine'\n"
        "    def __init__(self):\n"
        "        self.at = np.array([[0.2, 0.2], [0.5, 0.5]])\n"
        "    def look(self):\n"
        "        return self.at\n"
        "    def send(self, move):\n"
        "        self.at = np.clip(self.at + 0.8 * move, 0, 1)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    points = ["--waypoints", "0.6,0.3 0.3,0.8", "--json"]
    assert run(["drive", "--steer", "square", "--rig", "mine_for_steering:Rig", *points]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["rig"] == "mine"
    assert report["estimates"]["waypoints_reached"] == 2
    assert report["estimates"]["gain"][0] == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--friction-at-least", "1"], "friction-at-least: expected --steer PROBLEM"),
        (["--steer", "square", "--particles", "3"], "particles: expected no such option"),
        (["--steer", "square", "--follow", "1"], "follow: expected --waypoints"),
        (["--steer", "square", "--waypoints", "a"], "waypoints: "),
        (["--steer", "square", "--waypoints", "3,3"], "waypoints"),
        (["--steer", "square", "--rig", "physics:roll,ghosts=1"], "expected no ghosts"),
    ],
)
def test_wrong_options_get_one_sentence(arguments, message, capsys):
    assert run(["drive", *arguments]) == 2
    assert message in capsys.readouterr().err
