"""Drives with other tasks than mapping, maps that are known beforehand, rigs whose errors nobody
has stated, and what the first commands show of a rig.
"""

import json

import numpy as np
import pytest

from shoal import GridWorkspace, open_map
from shoal.cli import run as shoal
from shoal.core.errors import InvalidInputError
from shoal.rigs import NoisyRig, PhysicsRig, PlantProperties, SimulatedRig, drive, replay_log
from shoal.rigs.physics import TOLD
from shoal.rigs.rig import EnteringRig
from shoal.rigs.suspects import MOVES
from shoal.swarm.grid.board import noise_rng
from shoal.swarm.grid.tasks import place
from shoal.swarm.noise import Noise

MAZE = open_map("maze:9x7")
VESSEL = open_map("vessels:150:1")
VESSELS = open_map("vessels:300:3")
NOISE = Noise(0.05, 0.02, 0.02)
FEW = {"policy": "closest-frontier", "max_moves": 3000}
TASKS = ({"task": "coverage"}, {"task": "coverage", "subset": 0.2}, {"target": ((6, 8),)})


def start(workspace, particles, seed=1):
    return place(workspace, particles, "uniform", np.random.default_rng(seed))


def wrong_maze():
    """Return the maze with one free cell more and one less, and the two cells."""
    free = MAZE.free.copy()
    cell = next(
        tuple(c)
        for c in MAZE.cells.tolist()
        if MAZE.free[max(0, c[0] - 1) : c[0] + 2, c[1]].sum()
        + MAZE.free[c[0], max(0, c[1] - 1) : c[1] + 2].sum()
        == 3
    )  # a dead end
    free[cell] = False
    return GridWorkspace(free, name="yesterday"), cell


# -------------------------------------------------------------------------------------------------
# tasks


@pytest.mark.parametrize("noise", [{}, vars(NOISE)], ids=["exact", "noise"])
@pytest.mark.parametrize("task", TASKS, ids=str)
def test_a_dead_rig_is_not_a_wrong_map(task, noise):
    """Particles that never move look like walls in the known map, which may cut it into parts."""
    rig = SimulatedRig(VESSEL, start(VESSEL, 4))
    rig.send = lambda command: None
    target = {"target": (tuple(VESSEL.cells[-1].tolist()),)} if "target" in task else task
    driven = drive(rig, known=VESSEL, policy="closest-frontier", max_moves=400, **target, **noise)
    assert driven.status == "alarm"
    assert [alarm.kind for alarm in driven.alarms] == ["still"]
    assert driven.trust.level == "none"


@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
@pytest.mark.parametrize("task", TASKS, ids=str)
def test_tasks_on_a_known_map_without_noise(task, rule, tmp_path):
    log = tmp_path / "log.jsonl"
    rig = SimulatedRig(MAZE, start(MAZE, 4), rule=rule)
    driven = drive(rig, known=MAZE, log=log, **task, **FEW)
    if rule != "tilt" or driven:
        assert driven.status == "complete"
        assert driven.visited == driven.targets
    assert driven.episode.verify()
    again, verified = replay_log(log)
    assert verified, verified.message
    assert (bool(again), again.visited, again.task) == (
        bool(driven),
        driven.visited,
        driven.task,
    )


@pytest.mark.parametrize("task", TASKS, ids=str)
@pytest.mark.parametrize("stated", [True, False])
def test_tasks_on_a_known_map_with_noise(task, stated, tmp_path):
    log = tmp_path / "log.jsonl"
    cells = start(MAZE, 4)
    rig = NoisyRig(MAZE, cells, NOISE, np.random.default_rng(1))
    seen, truly = [], set(map(tuple, cells.tolist()))
    observe = rig.observe

    def observed():
        truly.update(map(tuple, np.argwhere(there(rig, MAZE))))
        seen.append(observe())
        return seen[-1]

    rig.observe = observed
    driven = drive(rig, known=MAZE, log=log, **(vars(NOISE) if stated else {}), **task, **FEW)
    assert driven.status == "complete"
    assert driven.visited == driven.targets
    assert bool(driven.notes) is not stated
    wanted = (
        {(6, 8)}
        if "target" in task
        else set(map(tuple, MAZE.cells.tolist()))
        if len(task) == 1
        else set()
    )
    assert len(wanted - truly) <= 1  # the confidence of a visit is .99
    assert driven.episode.verify()
    again, verified = replay_log(log)
    assert verified, verified.message
    assert again.visited == driven.visited


def there(rig, workspace):
    flat = rig._noisy.state.occupied.reshape([size + 6 for size in workspace.shape])
    return flat[3:-3, 3:-3]


def test_a_target_is_complete_as_soon_as_a_particle_is_in_it():
    row = GridWorkspace([[1] * 9])
    driven = drive(SimulatedRig(row, [(0, 1)]), known=row, target=((0, 6),), test_move=False)
    assert (str(driven.status), driven.commands) == ("complete", "rrrrr")
    driven = drive(SimulatedRig(row, [(0, 6)]), known=row, target=((0, 6),), test_move=False)
    assert (str(driven.status), driven.commands) == ("complete", "")


@pytest.mark.parametrize("noise", [False, True])
def test_a_target_that_is_a_wall_is_never_complete(noise):
    known, cell = wrong_maze()
    rig = (
        NoisyRig(known, start(known, 4), NOISE, np.random.default_rng(1))
        if noise
        else SimulatedRig(known, start(known, 4))
    )
    driven = drive(rig, known=MAZE, target=(cell,), **(vars(NOISE) if noise else {}), **FEW)
    assert driven.status == "alarm"
    assert driven.visited == 0
    assert [alarm.kind for alarm in driven.alarms] == ["map"]
    assert f"{cell}" in driven.alarms[0].text


@pytest.mark.parametrize("task", ["mapping", "coverage"])
@pytest.mark.parametrize("noise", [False, True])
def test_a_wrong_known_map_is_said(task, noise):
    truth, cell = wrong_maze()
    about = vars(NOISE) if noise else {}
    cells = start(truth, 4)

    def rig(workspace):
        if noise:
            return NoisyRig(workspace, cells, NOISE, np.random.default_rng(2))
        return SimulatedRig(workspace, cells)

    driven = drive(rig(truth), known=MAZE, task=task, **about, **FEW)  # a cell that is a wall now
    assert "map" in [alarm.kind for alarm in driven.alarms]
    assert driven.compared(truth) == {"false_free": 0, "false_obstacles": 0}
    assert driven.status == ("complete" if task == "mapping" else "alarm")
    assert driven.trust.level == "limited"
    assert cell not in driven.belief.open
    if task == "mapping":  # a wall that is free now
        driven = drive(rig(MAZE), known=truth, task=task, **about, **FEW)
        assert driven.compared(MAZE) == {"false_free": 0, "false_obstacles": 0}
        assert f"open at 1 wall, such as {cell}" in driven.alarms[-1].text


def test_a_mapping_with_a_known_map_needs_fewer_moves_under_noise():
    def moves(**about):
        rigs = [
            NoisyRig(VESSELS, start(VESSELS, 20, seed), NOISE, np.random.default_rng(seed))
            for seed in range(2)
        ]
        driven = [drive(rig, **about, **vars(NOISE), **FEW) for rig in rigs]
        assert all(driven)
        return sum(each.moves for each in driven)

    assert moves(known=VESSELS) < 0.9 * moves()


@pytest.mark.parametrize(
    ("about", "words"),
    [
        ({"task": "coverage"}, "known: expected a known map for the task coverage, got none"),
        ({"known": VESSEL}, r"known: expected a map of shape \(7, 9\)"),
        ({"known": MAZE, "target": ((0, 99),)}, "target: expected cells"),
        ({"known": MAZE, "task": "target"}, "target: expected cells together with the task"),
        ({"known": MAZE, "task": "mapping", "target": ((6, 8),)}, "expected the task target"),
        ({"exact": True, "slip": 0.1}, "exact: expected a rig without error rates"),
    ],
)
def test_drives_that_are_refused(about, words):
    with pytest.raises(InvalidInputError, match=words):
        drive(SimulatedRig(MAZE, start(MAZE, 4)), **about)


def test_the_command_takes_a_task(capsys, tmp_path):
    words = ["drive", "maze:9x7", "--rig", "simulated", "--particles", "4", "--json"]
    for task in (["--task", "coverage"], ["--task", "coverage", "--subset", "0.3"]):
        out = tmp_path / task[-1]
        assert shoal([*words, *task, "--out", str(out)]) == 0
        told = json.loads(capsys.readouterr().out)
        assert (told["status"], told["visited"]) == ("complete", told["targets"])
        assert (out / "map.png").exists()
    assert shoal([*words, "--target", "6,8"]) == 0
    assert json.loads(capsys.readouterr().out)["targets"] == 1
    assert shoal([*words, "--target", "6,8", "--slip", "0.1", "--misplace", "0.02"]) == 0
    assert json.loads(capsys.readouterr().out)["visited"] == 1


# -------------------------------------------------------------------------------------------------
# noise that nobody has stated


class Unstated(SimulatedRig):
    """A rig that makes no errors, but does not say so."""

    exact = False


def test_a_perfect_rig_is_mapped_in_about_as_many_moves_as_if_it_were_known_to_be_perfect():
    cells = start(VESSEL, 10)
    told = drive(SimulatedRig(VESSEL, cells), **FEW)
    driven = drive(Unstated(VESSEL, cells), **FEW)
    assert driven.status == "complete"
    assert driven.compared(VESSEL) == {"false_free": 0, "false_obstacles": 0}
    assert (driven.alarms, driven.notes, driven.trust.level) == ((), (), "high")
    assert driven.moves <= 1.2 * told.moves + 5


def test_a_small_map_is_complete_only_after_enough_commands_without_an_error():
    """One particle, a rig that slips at one command in twenty: without further moves, a slip at a
    wall would pass for the wall.
    """
    row = GridWorkspace([[1, 1, 1]])
    driven = drive(Unstated(row, [(0, 0)]), **FEW)
    assert driven.status == "complete"
    assert driven.moves >= 36
    wrong = cells = 0
    for seed in range(20):
        rig = NoisyRig(row, [(0, 0)], Noise(slip=0.05), np.random.default_rng(seed))
        driven = drive(rig, **FEW)
        wrong += sum(driven.compared(row).values())
        cells += len(driven.belief.known)
    assert wrong <= 0.01 * cells


def test_a_rig_that_errs_is_driven_with_noise_from_the_first_contradiction_on(tmp_path):
    rig = NoisyRig(VESSEL, start(VESSEL, 10), NOISE, np.random.default_rng(3))
    driven = drive(rig, log=tmp_path / "log.jsonl", **FEW)
    assert driven.status == "complete"
    assert len(driven.notes) == 1
    assert "--slip 0.05, --misplace 0.05, --miss 0.01" in driven.notes[0]
    assert sum(driven.compared(VESSEL).values()) <= 2
    assert driven.rates["slip"].stated == TOLD["slip"]
    _, verified = replay_log(tmp_path / "log.jsonl")
    assert verified, verified.message
    rig = NoisyRig(VESSEL, start(VESSEL, 10), NOISE, np.random.default_rng(3))
    assert drive(rig, exact=True, **FEW).status == "alarm"


@pytest.mark.parametrize("exact", [None, True])
def test_two_particles_in_one_cell_are_no_end_of_a_drive(exact):
    """Particles smaller than half a cell share cells although the rig says block."""

    class Sharing(SimulatedRig):
        @property
        def rule(self):
            return "block"

    rig = Sharing(VESSEL, start(VESSEL, 10), rule="merge")
    driven = drive(rig, exact=exact, **FEW)
    assert driven.status == "complete"
    assert driven.compared(VESSEL)["false_free"] == 0
    assert driven.notes


def test_a_perfect_rig_that_must_be_surer_than_a_drive_can_show_is_driven_with_noise(tmp_path):
    log = tmp_path / "log.jsonl"
    driven = drive(Unstated(MAZE, start(MAZE, 4)), log=log, confidence=0.999, **FEW)
    assert driven.status == "complete"
    assert (
        "too few for the confidence 0.999"
        in json.loads(next(line for line in log.read_text().splitlines() if '"noise"' in line))[
            "text"
        ]
    )
    _, verified = replay_log(log)
    assert verified, verified.message


def test_error_rates_that_nobody_has_stated_follow_the_scans(tmp_path):
    noise = Noise(0.05, 0.02, 0.25)
    rig = NoisyRig(VESSEL, start(VESSEL, 10), noise, np.random.default_rng(3))
    driven = drive(rig, log=tmp_path / "log.jsonl", **FEW)
    assert len(driven.notes) >= 2
    assert driven.rates["miss"].low < 1.5 * driven.rates["miss"].stated
    assert "rates" not in [alarm.kind for alarm in driven.alarms]
    assert sum(driven.compared(VESSEL).values()) <= 2
    _, verified = replay_log(tmp_path / "log.jsonl")
    assert verified, verified.message


# -------------------------------------------------------------------------------------------------
# the start


@pytest.mark.parametrize("kind", ["perfect", "grid"])
@pytest.mark.parametrize("stated", [True, False])
def test_particles_that_come_in_at_a_stated_inlet_are_no_alarm(kind, stated, tmp_path):
    inlet = tuple(MAZE.cells[0].tolist())
    made = apparatus(kind, [inlet], 1, MAZE)
    rig = EnteringRig(made, inlet, every=4, most=9)
    about = TOLD if stated and kind == "grid" else {"exact": True} if stated else {}
    driven = drive(rig, inlet=inlet, log=tmp_path / "log.jsonl", **about, **FEW)
    assert driven.status == "complete"
    assert "number" not in [alarm.kind for alarm in driven.alarms]
    assert len(made.observe()) >= 8
    assert sum(driven.compared(MAZE).values()) <= (2 if kind == "grid" else 0)
    _, verified = replay_log(tmp_path / "log.jsonl")
    assert verified, verified.message


def test_particles_that_come_in_without_a_stated_inlet_are_an_alarm():
    inlet = tuple(VESSELS.cells[0].tolist())
    rig = EnteringRig(apparatus("perfect", [inlet], 1), inlet, every=5, most=9)
    driven = drive(rig, **FEW)
    assert (driven.status, driven.alarms[0].kind) == ("alarm", "number")


def test_the_command_takes_a_start(tmp_path, capsys):
    mask = np.zeros(MAZE.shape, dtype=bool)
    mask[tuple(MAZE.cells[:5].T)] = True
    (tmp_path / "mask.txt").write_text(f"{GridWorkspace(mask)}\n")
    words = ["drive", "maze:9x7", "--json", "--start"]
    assert shoal([*words, str(tmp_path / "mask.txt")]) == 0
    assert json.loads(capsys.readouterr().out)["particles"] == 5
    inlet = "inlet:" + ",".join(map(str, MAZE.cells[0]))
    assert shoal([*words, inlet, "--particles", "6"]) == 0
    assert json.loads(capsys.readouterr().out)["particles"] == 6
    assert shoal([*words, inlet, "--particles", "6", "--enter-every", "3"]) == 0
    assert json.loads(capsys.readouterr().out)["particles"] == 6
    assert shoal([*words, "0,1", "--enter-every", "3"]) == 2
    assert "enter-every: expected a start such as inlet:3,4" in capsys.readouterr().err
    assert shoal([*words, "inlet:99,99", "--particles", "6"]) == 2
    assert "inlet: start" in capsys.readouterr().err
    assert shoal(["map", "maze:9x7", "--start", inlet, "--particles", "6", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["placement"] == "inlet"


# -------------------------------------------------------------------------------------------------
# the first moves

SWAP = dict(zip("lurd", "uldr", strict=True))
MIRROR = dict(zip("lurd", "ruld", strict=True))
WRONG = {
    "dead coil": ("still", "'d'", lambda n, letter: "" if letter == "d" else letter),
    "swapped axis": ("direction", "swapped", lambda n, letter: SWAP[letter]),
    "mirrored": ("direction", "mirrored", lambda n, letter: MIRROR[letter]),
    "half speed": ("commands", "half speed", lambda n, letter: letter if n % 2 else ""),
    "half speed, later": ("commands", "half speed", lambda n, letter: "" if n % 2 else letter),
    "frozen": ("still", "old picture", None),
}


class Wrong:
    """A rig that carries out ``act(n, letter)`` at its n-th command, or whose camera is frozen."""

    exact, rule = False, "block"

    def __init__(self, rig, act):
        self.rig, self.act, self.name, self.shape = rig, act, "wrong", rig.shape
        self.sent, self.first = 0, rig.observe()

    def send(self, letter):
        self.sent += 1
        done = letter if self.act is None else self.act(self.sent, letter)
        if done:
            self.rig.send(done)

    def observe(self):
        return self.first if self.act is None else self.rig.observe()

    def stop(self):
        self.rig.stop()


def apparatus(kind, cells, seed, workspace=VESSELS):
    if kind == "grid":
        return NoisyRig(workspace, cells, Noise(**TOLD), noise_rng(seed))
    if kind == "perfect":
        return SimulatedRig(workspace, cells)
    return PhysicsRig(workspace, cells, PlantProperties.of(kind), noise_rng(seed))


@pytest.mark.parametrize("kind", ["grid", "perfect", "roll"])
@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("particles", [20, 120])
def test_what_is_wrong_is_named_within_the_first_moves(wrong, kind, particles):
    if kind == "roll":
        pytest.importorskip("pymunk")
    sort, word, act = WRONG[wrong]
    rig = Wrong(apparatus(kind, start(VESSELS, particles), 1), act)
    driven = drive(rig, **FEW, **(TOLD if kind == "grid" else {}))
    assert driven.status == "alarm"
    assert [alarm.kind for alarm in driven.alarms] == [sort]
    assert word in driven.alarms[0].text
    assert driven.moves <= MOVES


@pytest.mark.parametrize("kind", ["roll", "pull"])
def test_pulses_of_half_a_cell_are_named(kind):
    pytest.importorskip("pymunk")
    half = PlantProperties.of(kind, length=0.5)
    for seed in range(2):
        rig = PhysicsRig(VESSELS, start(VESSELS, 20, seed), half, noise_rng(seed))
        driven = drive(rig, **FEW)
        assert (driven.status, driven.alarms[0].kind) == ("alarm", "commands")
        assert "half speed" in driven.alarms[0].text
        assert driven.moves <= MOVES


@pytest.mark.parametrize("kind", ["grid", "perfect", "roll", "pull"])
def test_an_honest_rig_needs_few_test_moves_and_is_not_accused(kind):
    if kind in ("roll", "pull"):
        pytest.importorskip("pymunk")
    for seed in range(3):
        rig = Wrong(apparatus(kind, start(VESSELS, 20, seed), seed), lambda n, letter: letter)
        driven = drive(rig, policy="closest-frontier", max_moves=MOVES)
        assert driven.status == "limit"
        assert driven.commands.startswith("llrud")
        assert not {"still", "direction", "commands"} & {alarm.kind for alarm in driven.alarms}
