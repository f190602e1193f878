"""The physical plant: motion, walls, forces and camera, and drives that map it."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("pymunk")

from shoal import GridWorkspace, InvalidInputError, open_map
from shoal.cli import run as shoal
from shoal.core.errors import RigError
from shoal.rigs import drive
from shoal.rigs.physics import (
    TOLD,
    USUAL,
    PhysicsRig,
    Plant,
    PlantProperties,
    wall_segments,
)
from shoal.swarm.grid.tasks import place
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.noise import MapErrors
from shoal.testing import check_rig

ROOM = GridWorkspace(np.ones((9, 9)))


def plant(points, workspace=ROOM, *, seed=1, kind="roll", **values):
    return Plant(workspace, points, PlantProperties(kind, **values), np.random.default_rng(seed))


def push(plant, angle, cells=1.0):
    about = plant.apparatus
    plant.push(angle, seconds=about.pulse * cells / about.length)


@pytest.mark.parametrize("radius", [0.5, 0.35, 0.15])
@pytest.mark.parametrize("name", ["vessels:150:1", "maze:9x11", "cave:12x15"])
def test_a_particle_without_errors_moves_as_in_the_grid(name, radius):
    vessel, rng = open_map(name), np.random.default_rng(5)
    rig = PhysicsRig(vessel, place(vessel, 1, "uniform", rng), PlantProperties(radius=radius), rng)
    world = GridWorld(vessel, "block")
    state = world.initial(rig.observe())
    for command in rng.choice(list("lurd"), 120):
        rig.send(command)
        state = world.step(state, command)
        assert rig.observe().tolist() == state.cells.tolist()


@pytest.mark.parametrize("kind", USUAL)
def test_particles_stay_in_the_vessel_and_apart(kind):
    vessel, rng = open_map("vessels:60:3"), np.random.default_rng(2)
    values = {"attraction": 3.0, "flow_x": 0.4, "flow_y": -0.2, "adhesion": 0.2}
    start = place(vessel, 12, "uniform", rng)
    rig = PhysicsRig(vessel, start, PlantProperties.of(kind, **values), rng)
    for command in rng.choice(list("lurd"), 40):
        rig.send(command)
        points = rig.plant.points
        assert vessel.free[tuple(rig.plant.cells_of(points).T)].all()
        apart = np.linalg.norm(points[:, None] - points, axis=2) + np.eye(len(points))
        assert apart.min() > 0.9 * 2 * rig.plant.apparatus.radius


def test_particles_of_different_size_touch_where_their_rims_meet():
    lane = GridWorkspace([[1] * 6])
    two = plant([(0.5, 0.5), (3.5, 0.5)], lane, radius=0.3, own_radius=0.3, seed=4)
    near, far = two.radii.tolist()
    assert abs(near - far) > 0.05
    assert (two.radii <= 0.5).all()
    push(two, 0.0, 8)
    first, second = two.points[:, 0].tolist()
    assert 6 - second == pytest.approx(far, abs=0.02)  # at the wall
    assert second - first == pytest.approx(near + far, abs=0.04)
    assert two.enter((0.5, 0.5))
    assert len(two.radii) == len(two.points) == 3
    same = plant([(0.5, 0.5), (3.5, 0.5)], lane, radius=0.3)
    assert same.radii.tolist() == [0.3, 0.3]


def test_a_seed_repeats_everything():
    def run(seed):
        rig = PhysicsRig(ROOM, [(1, 1), (4, 5)], PlantProperties.of("pull", ghosts=1), _rng(seed))
        seen = []
        for command in "rrdlu":
            rig.send(command)
            seen.append(rig.observe().tolist())
        return seen, rig.plant.points.tolist()

    assert run(3) == run(3)
    assert run(3) != run(4)


def _rng(seed):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("lag", [0.0, 0.002, 0.02])
def test_a_pulse_moves_by_its_length_whatever_the_lag(lag):
    one = plant([(2.5, 4.5)], length=1.25, lag=lag, settle=0.3)
    push(one, 90.0, 1.25)
    assert np.allclose(one.points, [(2.5, 5.75)], atol=1e-3)
    about = one.apparatus
    assert np.isclose(one.clock, about.delay + about.pulse + about.settle)


@pytest.mark.parametrize(("friction", "left"), [(0.0, 1.0), (0.25, 0.75), (1.0, 0.0), (2.0, 0.0)])
def test_a_wall_takes_friction_times_the_pressure_from_the_motion_along_it(friction, left):
    """Coulomb: pushed at 45 degrees, the speed along the wall falls by friction times the speed
    into it.
    """
    one = plant([(2.0, 8.65)], friction=friction)
    push(one, 45.0, 2.0)
    along = one.points[0, 0] - 2.0
    assert along == pytest.approx(left * 2.0 / 2**0.5, abs=0.02)
    assert 8.64 < one.points[0, 1] < 8.7


def test_a_pull_grows_towards_the_coil_and_converges():
    values = {"kind": "pull", "weakest": 0.74, "strongest": 1.36, "convergence": 5.3}
    one = plant([(0.5, 4.5), (7.0, 4.5), (4.5, 8.5)], **values)
    before = one.points
    push(one, 0.0, 0.5)
    moved = one.points - before
    assert moved[1, 0] > 1.5 * moved[0, 0] > 0
    assert abs(moved[0, 1]) < 1e-6
    # at the upper edge the field leads down, towards the axis of the coil
    angle = np.degrees(np.arctan2(moved[2, 1], moved[2, 0]))
    assert angle == pytest.approx(-5.3 * 8 / 9, abs=0.1)


def test_constant_errors_are_drawn_once():
    one = plant([(2.5, 2.5), (2.5, 6.5)], heading=5.0, own_gain=0.1, coil_gain=0.1, seed=4)
    before = one.points
    push(one, 0.0)
    first = one.points - before
    push(one, 0.0)
    assert np.allclose(one.points - before, 2 * first, atol=1e-6)
    assert np.degrees(np.arctan2(*first[0, ::-1])) != 0
    assert first[0, 0] != pytest.approx(first[1, 0], abs=1e-3)
    expected = one.own_gains * one.coil_gains[0, 1] * np.cos(np.radians(one.heading))
    assert np.allclose(first[:, 0], expected, atol=1e-6)


def test_flow_moves_particles_at_all_times():
    one = plant([(2.5, 2.5)], flow_x=0.5, flow_y=-0.25)
    one.wait(2.0)
    assert np.allclose(one.points, [(3.5, 2.0)], atol=0.02)


def test_flow_is_slower_near_walls():
    near, far = (plant([(x, 4.5)], flow_y=-0.5, radius=0.1) for x in (0.25, 4.5))
    for each in (near, far):
        each.wait(1.0)
    assert np.allclose(far.points, [(4.5, 4.0)], atol=0.02)
    assert np.allclose(near.points, [(0.25, 4.5 - 0.75 * 0.5)], atol=0.02)


def test_a_spinning_particle_rolls_along_the_wall_on_its_right():
    one = plant([(8.65, 4.5), (0.35, 4.5), (4.5, 0.35), (4.5, 4.5)], spin=0.5)
    before = one.points
    push(one, 0.0)
    moved = one.points - before
    assert np.allclose(moved[0], (0, 0.5), atol=0.02)
    # it leaves the wall behind it, and is faster along the one on its right
    assert moved[1, 0] == pytest.approx(1, abs=0.02)
    assert -0.2 < moved[1, 1] < 0
    assert np.allclose(moved[2], (1.5, 0), atol=0.02)
    assert np.allclose(moved[3], (1, 0), atol=0.02)


def test_a_crowd_does_not_press_particles_through_walls():
    vessel, rng = open_map("vessels:100:1"), np.random.default_rng(0)
    rig = PhysicsRig(vessel, place(vessel, 80, "uniform", rng), PlantProperties.of("roll"), rng)
    for command in rng.choice(list("lurd"), 80):
        rig.send(command)
        assert vessel.free[tuple(rig.plant.cells_of(rig.plant.points).T)].all()


def test_particles_that_leap_and_ghosts_are_no_lies():
    vessel = open_map("vessels:200")
    apparatus = PlantProperties.of("pull", radius=0.15, ghosts=1.0)
    start = place(vessel, 15, "uniform", np.random.default_rng(1))
    rig = PhysicsRig(vessel, start, apparatus, np.random.default_rng(1))
    result = drive(rig, slip=0.03, misplace=0.02, policy="closest-frontier", max_moves=1500)
    assert result.status == "complete"
    assert not {alarm.kind for alarm in result.alarms} - {"rates"}
    errors = MapErrors.of(vessel, start, result.belief)
    assert errors.right > 0.98
    assert not errors.false_free


def test_a_slow_particle_sticks_to_a_wall():
    free, held = (plant([(0.35, 4.5), (4.5, 4.5)], adhesion=value) for value in (0.0, 0.5))
    for each in (free, held):
        each.push(0.0, seconds=each.apparatus.pulse, strength=0.4)
    assert np.allclose(free.points[:, 0], [0.75, 4.9], atol=0.02)
    assert np.allclose(held.points[:, 0], [0.35, 4.9], atol=0.02)


@pytest.mark.parametrize(("kind", "angle"), [("roll", 0.0), ("pull", 0.0), ("pull", 90.0)])
def test_dipoles_attract_in_line_with_the_field_and_repel_beside_it(kind, angle):
    """A rotating field attracts from all sides."""
    one = plant([(3.5, 4.5), (4.7, 4.5)], kind=kind, attraction=4.0)
    push(one, angle, 0.5)
    gap = float(np.linalg.norm(np.diff(one.points, axis=0)))
    assert (gap > 1.2 + 1e-3) if (kind, angle) == ("pull", 90.0) else (gap < 1.2 - 1e-3)


def test_the_camera_is_late():
    one = plant([(2.5, 4.5)], settle=0.0, late=0.2, frame_rate=50.0)
    push(one, 0.0)
    assert one.picture()[1].tolist() == [[2.5, 4.5]]
    one.wait(0.3)
    taken, seen = one.picture()
    assert np.allclose(seen, [(3.5, 4.5)], atol=0.02)
    assert one.clock - 0.2 - 1 / 50 <= taken <= one.clock - 0.2


def test_what_the_camera_shows():
    points = [(1.5, 1.5), (1.9, 1.5), (6.5, 6.5)]
    assert len(plant(points, radius=0.1, miss=1.0).picture()[1]) == 0
    assert len(plant(points, radius=0.1, double=1.0).picture()[1]) == 6
    blurred = plant(points, radius=0.1, blur=10.0).picture()[1]
    assert np.allclose(sorted(blurred.tolist()), [(1.7, 1.5), (6.5, 6.5)])
    ghostly = plant(points, radius=0.1, ghosts=2.0)
    assert 1.5 < np.mean([len(ghostly.picture()[1]) - 3 for _ in range(300)]) < 2.5
    shaken = plant(points, radius=0.1, camera_error=2.0, pixels=20.0)
    errors = np.array([shaken.picture()[1] - points for _ in range(300)])
    assert 0.09 < errors.std() < 0.11


def test_walls_are_few_long_segments():
    free = np.array([[1, 1, 0], [1, 1, 0], [0, 1, 1]], dtype=bool)
    segments = wall_segments(free)
    length = sum(abs(a[0] - b[0]) + abs(a[1] - b[1]) for a, b in segments)
    padded = np.pad(free, 1)
    edges = (padded[1:] != padded[:-1]).sum() + (padded[:, 1:] != padded[:, :-1]).sum()
    assert length == edges == 12
    assert len(segments) == 8


@pytest.mark.parametrize(
    ("points", "about"),
    [
        ([(0.2, 4.5)], "touch neither"),
        ([(4.5, 4.5), (4.9, 4.5)], "touch neither"),
        ([(4.5, 20.0)], "touch neither"),
        ([], "expected 1 to"),
    ],
)
def test_particles_without_room_are_refused(points, about):
    with pytest.raises(InvalidInputError, match=about):
        plant(points)


def test_a_plant_is_flat():
    with pytest.raises(InvalidInputError, match="two dimensions"):
        plant([(0.5, 0.5)], GridWorkspace(np.ones((2, 2, 2))))


@pytest.mark.parametrize(
    ("text", "about"),
    [
        ("swim", "expected one of exact, roll, pull, got 'swim'"),
        ("roll,size=1", "expected one of radius"),
        ("roll,radius", "NAME=NUMBER"),
        ("roll,radius=wide", "NAME=NUMBER"),
        ("roll,radius=.2,radius=.3", "each name once"),
        ("roll,radius=0.9", "radius: expected a number from 0.02 to 0.5"),
        ("pull,weakest=2", "at most strongest"),
        ("pull,miss=nan", "miss: expected a number"),
    ],
)
def test_wrong_properties_are_refused(text, about):
    with pytest.raises(InvalidInputError, match=about):
        PlantProperties.parse(text)


def test_a_stopped_plant_refuses_commands():
    rig = PhysicsRig(ROOM, [(1, 1)], PlantProperties(), _rng(1))
    rig.stop()
    with pytest.raises(RigError, match="stopped"):
        rig.send("r")


def test_a_plant_is_a_rig():
    check_rig(PhysicsRig(ROOM, [(1, 1)], PlantProperties(), _rng(1)))


@pytest.mark.parametrize("kind", USUAL)
def test_a_plant_is_mapped(kind):
    vessel = open_map("vessels:100:2")
    start = place(vessel, 6, "uniform", _rng(3))
    rig = PhysicsRig(vessel, start, PlantProperties.of(kind), _rng(3))
    result = drive(rig, policy="closest-frontier", **TOLD)
    errors = MapErrors.of(vessel, start, result.belief)
    assert errors.right > 0.98
    assert not errors.false_free


def test_the_command_drives_a_plant(capsys):
    words = ["drive", "vessels:60:2", "--rig", "physics:roll,own-gain=0.05", "--particles", "6"]
    assert shoal([*words, "--json"]) == 0
    shown = capsys.readouterr()
    result = json.loads(shown.out)
    assert result["status"] == "complete"
    assert result["wrong"]["false_free"] == 0
    assert set(result["rates"]) == {"slip", "miss", "misplace"}
    assert "--slip 0.05" in shown.err
    assert shoal([*words, "--slip", "0.1", "--json"]) == 0
    shown = capsys.readouterr()
    assert json.loads(shown.out)["rates"]["slip"]["stated"] == 0.1
    assert "--slip" not in shown.err


@pytest.mark.parametrize(
    ("words", "about"),
    [
        (["--rig", "physics:roll"], "expected a map"),
        (["vessels:50", "--rig", "physics:roll", "--end-after", "3"], "end-after: expected a rig"),
        (["vessels:50", "--rig", "physics:roll", "--rule", "merge"], "rule: expected block"),
        (["vessels3d:50", "--rig", "physics:roll"], "two dimensions"),
        (["vessels:50", "--rig", "physics:fly"], "expected one of exact, roll, pull"),
    ],
)
def test_the_command_refuses(words, about, capsys):
    assert shoal(["drive", *words]) == 2
    said = capsys.readouterr().err
    assert about in said
    assert len(said.strip().splitlines()) == 1
