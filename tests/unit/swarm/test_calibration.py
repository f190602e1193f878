"""The calibration of a bench: registration, test pulses, and the trim of pulses."""

from __future__ import annotations

import json

import numpy as np
import pytest
from tests.benches import SeenPlant, plant_of, render, view_of

from shoal import GridWorkspace, InvalidInputError, open_map
from shoal.cli import run as shoal
from shoal.core.errors import RigError
from shoal.rigs import BenchRig, PlantPorts, drive
from shoal.rigs.calibration import BenchCalibration, Responses, transform_points
from shoal.rigs.following import free_motion, match
from shoal.rigs.measuring import calibrate
from shoal.rigs.physics import ANGLES, TOLD
from shoal.rigs.registration import tie_by_map, tie_by_marks
from shoal.rigs.trim import PulseTrim

VESSEL = open_map("vessels:200")
PULSES = {letter: (angle, 0.083) for letter, angle in ANGLES.items()}
CORNERS = np.array([(0, 0), (0, 20), (20, 0), (20, 20), (8, 3), (5, 17), (13, 11)], dtype=float)


def bench(seed=0, *, turn=100.0, shear=0.2, mirror=True, particles=15, **properties):
    plant = plant_of(VESSEL, particles, seed, camera_error=0.0, **properties)
    matrix, size = view_of(VESSEL.shape, turn=turn, shear=shear, mirror=mirror)
    return SeenPlant(plant, matrix, size, seed=seed)


def calibrated(seen, **options):
    tie = tie_by_marks(seen.marks(CORNERS, 0.3))
    return calibrate(seen, seen, pulses=PULSES, tie=tie, shape=VESSEL.shape, **options)


@pytest.mark.parametrize(
    ("turn", "shear", "mirror"), [(0, 0, False), (100, 0.2, True), (-37, -0.3, False)]
)
def test_marks_tie_a_turned_sheared_or_mirrored_camera(turn, shear, mirror):
    matrix, _ = view_of((21, 21), turn=turn, shear=shear, mirror=mirror)
    rng = np.random.default_rng(1)
    for _ in range(6):
        marks = np.hstack([transform_points(matrix, CORNERS) + rng.normal(0, 0.3, (7, 2)), CORNERS])
        tie = tie_by_marks(marks)
        away = transform_points(tie.matrix, transform_points(matrix, CORNERS)) - CORNERS
        assert np.linalg.norm(away, axis=1).max() < 0.1
        assert 0.003 < tie.residual < 0.1


def test_a_tilted_camera_is_tied_by_a_homography():
    matrix, _ = view_of((21, 21), turn=20)
    matrix[2] = [0.01, -0.006, 1]
    cells = np.array([(r, c) for r in (0, 10, 20) for c in (0, 10, 20)], dtype=float)
    tie = tie_by_marks(np.hstack([transform_points(matrix, cells), cells]))
    assert tie.residual < 1e-3
    assert transform_points(tie.matrix, transform_points(matrix, [(4, 17)])) == pytest.approx(
        np.array([(4, 17)])
    )


@pytest.mark.parametrize(
    ("cells", "hidden"),
    [
        ([(0, 0), (20, 0), (0, 20), (20, 20)], True),
        ([(0, 0), (20, 0), (0, 20), (20, 20), (10, 10)], True),
        ([(0, 0), (20, 0), (0, 20), (20, 20), (5, 12)], False),
        (CORNERS, False),
    ],
)
def test_marks_that_hide_the_error_of_a_lens_are_said(cells, hidden):
    cells = np.array(cells, dtype=float)
    away = cells - 10
    pixels = 20 * (10 + away * (1 - 2e-4 * np.sum(away**2, axis=1))[:, None])[:, ::-1]
    tie = tie_by_marks(np.hstack([pixels, cells]), limit=9.0)
    between = np.array([(10.0, 0.0), (0.0, 10.0)])
    seen = 20 * (10 + (between - 10) * (1 - 2e-4 * 100))[:, ::-1]
    wrong = np.linalg.norm(transform_points(tie.matrix, seen) - between, axis=1).max()
    assert (wrong > 3 * tie.residual) == hidden
    assert any("whether the lens bends lines" in note for note in tie.notes) == hidden


def test_a_mark_that_contradicts_the_others_is_left_out_and_named():
    matrix, _ = view_of((21, 21), turn=70, mirror=True)
    marks = np.hstack([transform_points(matrix, CORNERS), CORNERS])
    marks[4, 2:] = (3, 8)  # row and column exchanged
    tie = tie_by_marks(marks)
    assert tie.residual < 1e-6
    assert "=3,8 contradicts the others" in tie.notes[0]


@pytest.mark.parametrize(
    ("marks", "message"),
    [
        ([(0, 0, 0, 0), (9, 9, 1, 1)], "at least 3 marks, got 2"),
        ([(k, k, k, k) for k in range(5)], "pixels that are not on one line"),
        (
            [(0, 0, 0, 0), (9, 0, 0, 1), (0, 9, 0, 2), (9, 9, 0, 3)],
            "cells that are not on one line",
        ),
        ([(0, 0, 0, 0), (90, 0, 0, 5), (0, 90, 5, 0), (90, 90, 7, 5)], "a residual of 2"),
    ],
)
def test_bad_marks_are_refused(marks, message):
    with pytest.raises(InvalidInputError, match=message):
        tie_by_marks(marks)


def test_three_marks_say_that_they_cannot_show_an_error():
    tie = tie_by_marks([(0, 0, 0, 0), (90, 0, 0, 5), (0, 90, 5, 0)])
    assert tie.residual is None
    assert "four or more" in tie.notes[0]


@pytest.mark.parametrize(("bright", "mirror"), [(True, True), (False, False)])
def test_a_known_map_is_found_in_the_picture_among_its_particles(bright, mirror):
    pytest.importorskip("cv2")
    rng = np.random.default_rng(3)
    matrix, size = view_of(VESSEL.shape, cell=14, turn=200, shear=0.15, mirror=mirror)
    picture = render(VESSEL, VESSEL.cells[::13], matrix, size, rng, bright=bright)
    tie = tie_by_map(picture, VESSEL.free)
    corners = np.array([(0, 0), (20, 0), (0, 20), (20, 20)], dtype=float)
    away = transform_points(tie.matrix, transform_points(matrix, corners)) - corners
    assert np.linalg.norm(away, axis=1).max() < 0.1
    assert tie.residual < 0.1
    with pytest.raises(InvalidInputError, match="give marks"):
        tie_by_map(picture, open_map("vessels:200:9").free)


def bent(picture, share):
    """Return a picture through a lens that draws points nearer to the middle, with the cube of their
    distance.
    """
    import cv2

    size = np.array(picture.shape[::-1])
    middle, half = (size - 1) / 2, size.max() / 2
    offsets = (np.indices(picture.shape)[::-1].transpose(1, 2, 0) - middle) / half
    seen = middle + half * offsets * (1 + share * np.sum(offsets**2, axis=-1, keepdims=True))
    return cv2.remap(picture, seen.astype(np.float32), None, cv2.INTER_LINEAR, borderValue=60)


@pytest.mark.parametrize("seed", range(3))
def test_a_map_that_fits_on_average_but_not_near_its_border_is_refused(seed):
    """A lens put cells up to .4 cells off, and the outlines were less than .1 cells apart on average."""
    pytest.importorskip("cv2")
    vessel = open_map("vessels:300")
    matrix, size = view_of(vessel.shape, cell=14, turn=200 + 60 * seed, mirror=bool(seed % 2))
    rng = np.random.default_rng(seed)
    picture = render(vessel, vessel.cells[::13], matrix, size, rng)
    assert tie_by_map(bent(picture, 0.02), vessel.free).residual < 0.05
    with pytest.raises(InvalidInputError, match=r"0.2 cells .* everywhere, got 0.\d+ near row \d"):
        tie_by_map(bent(picture, 0.065), vessel.free)


def test_a_map_that_looks_the_same_when_turned_is_refused():
    pytest.importorskip("cv2")
    cross = np.zeros((9, 9), dtype=bool)
    cross[4, :] = cross[:, 4] = True
    matrix, size = view_of(cross.shape)
    picture = render(GridWorkspace(cross), [], matrix, size, np.random.default_rng(1))
    with pytest.raises(InvalidInputError, match="turned or mirrored as well"):
        tie_by_map(picture, cross)


def test_particles_that_walls_hold_do_not_count():
    rng = np.random.default_rng(2)
    motions = np.vstack(
        [
            rng.normal((1, 0.1), 0.02, (8, 2)),
            rng.normal((0, 0), 0.02, (12, 2)),  # held
            np.column_stack([rng.uniform(0.6, 0.8, 4), np.zeros(4)]),  # stopped on the way
        ]
    )
    motion, free = free_motion(motions, 0.02)
    assert motion == pytest.approx((1, 0.1), abs=0.03)
    assert free[:8].all()
    assert not free[8:20].any()


def test_neighbours_in_a_row_are_not_confused():
    before = np.array([(0.0, 0), (1, 0), (2, 0), (3, 0)])
    after = np.array([(1.05, 0), (2.05, 0), (3.0, 0), (2.95, 0.02)])
    pairs = match(before, after, (1.05, 0), 0.5)
    found = dict(pairs.tolist())
    assert [round(after[found[k], 0] - before[k, 0], 2) for k in (0, 1)] == [1.05, 1.05]


@pytest.mark.parametrize("seed", range(3))
def test_responses_are_the_inverse_of_their_pulses(seed):
    rng = np.random.default_rng(seed)
    sides = {
        letter: tuple(
            rng.uniform(5, 20)
            * np.array([np.cos(a := np.radians(angle + rng.uniform(-15, 15))), np.sin(a)])
        )
        for letter, angle in ANGLES.items()
    }
    angles = {letter: angle + rng.uniform(-10, 10) for letter, angle in ANGLES.items()}
    responses = Responses(**sides, angles=angles, dead=0.004)
    for _ in range(50):
        motion = rng.normal(0, 1, 2)
        angle, seconds = responses.pulse_for(motion)
        assert responses.displacement(angle, seconds) == pytest.approx(motion)


@pytest.mark.parametrize(("seed", "turn", "mirror"), [(0, 100, True), (3, -20, False)])
def test_gains_and_headings_are_measured_under_any_camera(seed, turn, mirror):
    seen = bench(seed, turn=turn, mirror=mirror, coil_gain=0.12, heading=15.0, own_gain=0.05)
    found = calibrated(seen)
    plant, own = seen.plant, np.median(seen.plant.own_gains)
    assert found.residual < 0.1
    assert found.responses.residual < 0.1
    assert found.noise == pytest.approx(0.3, rel=0.3)
    for letter, wanted in ANGLES.items():
        angle, seconds = found.pulse(letter)
        turned = np.radians(angle + plant.heading)
        ahead = np.array([np.cos(turned), np.sin(turned)])
        gains = plant.coil_gains[[0, 1], (ahead > 0).astype(int)]
        moved = own * gains * ahead * seconds / plant.apparatus.pulse
        goal = found.aim * np.array([np.cos(np.radians(wanted)), np.sin(np.radians(wanted))])
        assert np.linalg.norm(moved - goal) < 0.1
    assert abs(found.responses.heading("r") - plant.heading) < 4


def test_one_particle_is_enough():
    room = open_map("rectangle:9x9")
    for seed in range(3):
        matrix, size = view_of(room.shape, turn=50)
        plant = plant_of(room, 1, seed, coil_gain=0.15, heading=10.0, camera_error=0.0)
        seen = SeenPlant(plant, matrix, size)
        cells = np.array([(0, 0), (0, 8), (8, 0), (8, 8)], dtype=float)
        tie = tie_by_marks(seen.marks(cells))
        found = calibrate(seen, seen, pulses=PULSES, tie=tie, shape=room.shape)
        for letter in ANGLES:
            assert abs(found.responses.heading(letter) - plant.heading) < 5


def test_a_calibration_goes_through_its_file(tmp_path):
    seen = bench(1)
    found = calibrated(seen, cell_size=0.5)
    found.save(tmp_path / "bench.json")
    assert BenchCalibration.load(tmp_path / "bench.json") == found
    points = seen.observe().points
    assert found.to_pixels(found.to_cells(points)) == pytest.approx(points)
    text = json.loads((tmp_path / "bench.json").read_text())
    (tmp_path / "bad.json").write_text(json.dumps(text | {"matrix": [[0, 0, 0]] * 3}))
    with pytest.raises(InvalidInputError, match="can be inverted"):
        BenchCalibration.load(tmp_path / "bad.json")
    (tmp_path / "bad.json").write_text(json.dumps(text | {"aim": -1}))
    with pytest.raises(InvalidInputError, match=r"bad\.json: aim"):
        BenchCalibration.load(tmp_path / "bad.json")


def test_a_scale_lays_the_grid_along_the_pulses():
    seen = bench(2, shear=0.0, heading=0.0, coil_gain=0.1)
    found = calibrate(seen, seen, pulses=PULSES, cell=20.0, size=seen.size)
    assert found.tie == "scale"
    assert found.pixels_per_cell == pytest.approx(20.0)
    assert [abs(found.responses.heading(letter)) < 2 for letter in "lurd"] == [True] * 4
    cells = found.to_cells([(0, 0), (0, seen.size[1]), (seen.size[0], 0), seen.size])
    assert (cells > -0.6).all()
    assert (cells < np.array(found.shape)).all()
    # right is right: the picture's mirror is undone
    step = found.to_cells(transform_points(seen.matrix, [(5, 6), (5, 5)]))
    assert step[0] - step[1] == pytest.approx((0, 1), abs=0.05)


def test_a_mirrored_grid_is_refused():
    seen = bench(0)
    marks = seen.marks(CORNERS)
    marks[:, 3] = 20 - marks[:, 3]
    with pytest.raises(RigError, match=r"command [lr] to move particles within 45 degrees"):
        calibrate(seen, seen, pulses=PULSES, tie=tie_by_marks(marks), shape=VESSEL.shape)


def test_a_dead_coil_and_an_old_picture_are_refused(monkeypatch):
    seen = bench(0)
    monkeypatch.setattr(seen, "push", lambda angle, seconds: None)
    with pytest.raises(RigError, match="move freely at the command r"):
        calibrated(seen)
    seen = bench(0)
    old = seen.observe()
    monkeypatch.setattr(seen, "observe", lambda: old)
    monkeypatch.setattr("shoal.rigs.measuring.PATIENCE", 0.01)
    with pytest.raises(RigError, match="the same one again and again"):
        calibrated(seen)


def test_whole_commands_are_measured_and_stay():
    seen = bench(0, length=0.9, heading=0.0, coil_gain=0.0)
    seen.whole = True
    found = calibrated(seen)
    assert found.pulses == PULSES
    assert found.gain("r") == pytest.approx(0.9, abs=0.06)
    assert any("moves particles by 0.9" in note or "by 0.8" in note for note in found.notes)


def test_custom_commands_keep_their_directions():
    seen = bench(0, heading=10.0, coil_gain=0.1)
    seen.only = True
    found = calibrated(seen)
    assert {letter: angle for letter, (angle, _) in found.pulses.items()} == ANGLES
    seen.whole = False
    trim = PulseTrim(found.responses)
    assert trim.pulse("u")[0] == 90


def test_the_speed_falls_beyond_the_step_out_frequency():
    seen = bench(0, heading=0.0)
    seen.frequency = 4.0

    def turning(f, step_out=9.0):
        return f if f <= step_out else f - (f**2 - step_out**2) ** 0.5

    def push(angle, seconds):
        seen.plant.push(angle, seconds=seconds, strength=turning(seen.frequency) / 4)
        seen._ended = seen.plant.clock

    seen.push = push
    seen.set_frequency = lambda f: setattr(seen, "frequency", f)
    found = calibrated(seen, frequencies=[2, 4, 6, 8, 10, 12, 16])
    assert found.speed.step_out == pytest.approx(9.0, rel=0.12)
    assert found.speed.slope == pytest.approx(1 / seen.plant.apparatus.pulse / 4, rel=0.12)
    assert seen.frequency == 4.0
    with pytest.raises(InvalidInputError, match="at least 3 different ones"):
        calibrated(seen, frequencies=[2, 4])
    with pytest.raises(InvalidInputError, match="whose field turns"):
        calibrated(bench(0), frequencies=[2, 4, 6])


def drive_of(plant, *, trim):
    ports = PlantPorts(plant)
    trimmed = PulseTrim(Responses.from_pulses(ports.pulses)) if trim else None
    rig = BenchRig(ports, ports, trim=trimmed)
    return drive(rig, policy="closest-frontier", max_moves=90, **TOLD), rig


@pytest.mark.parametrize("every", [4, 1])
def test_pulses_that_a_busy_computer_makes_too_long_do_not_count(every):
    class Busy:
        """Makes every few pulses 2.4 times as long, and says so."""

        name, late, pulses = "busy", None, PULSES

        def __init__(self, seen):
            self.seen, self.number = seen, 0

        def push(self, angle, seconds):
            self.number += 1
            self.late = 2.4 * seconds if self.number % every == 0 else None
            self.seen.push(angle, self.late or seconds)

        def stop(self):
            self.seen.stop()

        def close(self):
            self.seen.close()

    seen = bench(2, coil_gain=0.12)
    tie = tie_by_marks(seen.marks(CORNERS, 0.3))
    about = {"pulses": PULSES, "tie": tie, "shape": VESSEL.shape}
    if every == 1:
        with pytest.raises(RigError, match="because this computer is busy"):
            calibrate(Busy(seen), seen, **about)
        return
    found, usual = calibrate(Busy(seen), seen, **about), calibrated(bench(2, coil_gain=0.12))
    for letter in PULSES:
        assert found.pulse(letter)[1] == pytest.approx(usual.pulse(letter)[1], rel=0.06)


def test_the_trim_mends_raw_gains():
    results = []
    for trim in (False, True):
        plant = plant_of(VESSEL, 12, 4)
        plant.coil_gains[:] = (0.75, 1.15), (1.2, 0.8)
        results.append(drive_of(plant, trim=trim))
    raw, trimmed = results
    assert trimmed[0].compared(VESSEL)["false_obstacles"] == 0
    slips = [result.rates["slip"].observed for result, _ in (raw, trimmed)]
    assert slips[1] < slips[0] / 3
    plant, responses = trimmed[1].actuator.plant, trimmed[1].trim.responses
    for letter, (axis, side) in {"r": (0, 1), "l": (0, 0), "u": (1, 1), "d": (1, 0)}.items():
        speed = np.linalg.norm(getattr(responses, letter)) * plant.apparatus.pulse
        assert speed == pytest.approx(plant.coil_gains[axis, side], rel=0.12)


def test_the_trim_does_not_learn_from_particles_at_walls():
    corridor = GridWorkspace(np.ones((2, 12), dtype=bool))
    ports = PlantPorts(plant_of(corridor, 5, 1, kind="exact"))
    trim = PulseTrim(Responses.from_pulses(ports.pulses))
    rig = BenchRig(ports, ports, trim=trim)
    for _ in range(16):  # all end at the wall
        rig.send("r")
    rig.look()
    before = trim.responses
    for _ in range(10):
        rig.send("r")
        rig.look()
    assert trim.responses == before
    assert trim.offset.tolist() == [0, 0]


OPTIONS = ["--actuator", "physics:roll,coil-gain=.1,heading=8", "--sensor", "physics"]


def test_the_command_writes_a_calibration_and_uses_it(tmp_path, capsys):
    file = tmp_path / "bench.json"
    common = ["drive", "vessels:100", *OPTIONS, "--particles", "8", "--json"]
    assert shoal([*common, "--calibrate", str(file)]) == 0
    about = json.loads(capsys.readouterr().out)
    assert set(about["directions"]) == set("lurd")
    assert about["pulse_residual"] < 0.1
    assert file.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert shoal([*common, "--calibration", str(file), "--policy", "closest-frontier"]) == 0
    assert json.loads(capsys.readouterr().out)["wrong"]["false_free"] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--rig", "simulated", "--trim"], "trim: expected --actuator and --sensor"),
        (["--rig", "simulated", "--calibrate", "a.json"], "calibrate: expected --actuator"),
        ([*OPTIONS, "--mark", "1,2=3,4"], "mark: expected --calibrate FILE"),
        ([*OPTIONS, "--calibrate", "a.txt"], "expected a file FILE.json"),
        ([*OPTIONS, "--calibrate", "a.json", "--mark", "1,2"], "expected X,Y=ROW,COLUMN"),
        ([*OPTIONS, "--calibrate", "a.json", "--pixel-size", "3"], "cell-size: expected one"),
        ([*OPTIONS, "--calibrate", "a.json", "--log", "a.jsonl"], "log: expected a drive"),
    ],
)
def test_options_without_effect_are_refused(options, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert shoal(["drive", "vessels:100", *options]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
