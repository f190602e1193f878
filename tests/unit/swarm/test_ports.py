"""Rigs that are made of an actuator and a sensor, and the checks of both."""

from __future__ import annotations

import json
import socketserver
import threading
import time

import numpy as np
import pytest
from tests.unit.swarm.test_rigs import BenchTransport, example, free_of

from shoal import GridWorkspace, InvalidInputError, open_map
from shoal.cli import run as shoal
from shoal.core.errors import RigError
from shoal.core.registry import look_in
from shoal.rigs import (
    BenchRig,
    Frame,
    GridCalibration,
    PlantPorts,
    RemoteRig,
    SimulatedRig,
    SteeringBench,
    decode_message,
    drive,
    encode_message,
)
from shoal.rigs.calibration import Responses
from shoal.rigs.physics import ANGLES, Plant, PlantProperties
from shoal.rigs.ports import (
    CellCalibration,
    RemoteActuator,
    RemoteSensor,
    open_actuator,
    open_own_rig,
    open_sensor,
)
from shoal.rigs.protocol import Done, Points, Refusal, Stopped, Welcome
from shoal.testing import check_actuator, check_rig, check_sensor

ROOM = GridWorkspace(np.ones((3, 4)), name="room")
EXACT = PlantProperties()


def plant_ports(points=((0.5, 0.5), (2.5, 1.5)), apparatus=EXACT):
    return PlantPorts(Plant(ROOM, points, apparatus, np.random.default_rng(1)))


class Grid(SimulatedRig):
    """An exact actuator and sensor in one."""

    calibration, pulses = CellCalibration(), {letter: (at, 0.1) for letter, at in ANGLES.items()}

    def __init__(self, workspace=ROOM, cells=((0, 0), (1, 2))):
        super().__init__(workspace, cells)
        self.number = 0

    def push(self, angle, seconds):
        if not seconds >= 0 or seconds == np.inf or angle not in ANGLES.values():
            raise InvalidInputError("expected whole commands")
        self.number += 1
        self.send(next(letter for letter, at in ANGLES.items() if at == angle))

    def observe(self):
        return Frame(super().observe().astype(float), time.monotonic(), self.number)

    def close(self):
        pass


def grid_device():
    return Grid()


# -------------------------------------------------------------------------------------------------
# conformance


def one_particle():
    return plant_ports([(1.5, 0.5)])  # two discs may share a cell


@pytest.mark.parametrize("make", [one_particle, grid_device])
def test_our_own_devices_keep_the_rules(make):
    check_sensor(make())
    check_actuator(make())
    device = make()
    check_rig(BenchRig(device, device), moves=20)


class Actuator:
    name, pulses = "coils", {letter: (at, 0.1) for letter, at in ANGLES.items()}
    stopped = False

    def push(self, angle, seconds):
        if not (np.isfinite(angle) and 0 <= seconds < 1):
            raise InvalidInputError("expected numbers")
        if self.stopped:
            raise RigError("stopped")

    def stop(self):
        self.stopped = True

    def close(self):
        self.stopped = True


def actuator(**members):
    return type("Coils", (Actuator,), members)()


def test_an_actuator_that_keeps_the_rules():
    check_actuator(actuator())
    check_actuator(actuator(pulses=None))


def raising(error):
    def push(self, angle, seconds):
        if self.stopped or not (np.isfinite(angle) and 0 <= seconds < 1):
            raise error

    return push


def reviving(self):
    self.stopped = False


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({"name": 5}, "expected a text as name"),
        ({"pulses": {"l": (0, 1)}}, "the commands l, u, r and d"),
        ({"pulses": dict.fromkeys("lurd", (0, 0))}, "a time above 0"),
        ({"push": lambda self, angle, seconds: seconds}, "expected None from push"),
        ({"push": lambda self, angle, seconds: None}, "InvalidInputError for push.*got none"),
        ({"push": raising(RigError("no"))}, "InvalidInputError for push.*got RigError"),
        ({"push": raising(InvalidInputError("no"))}, "RigError for a push after stop.*Invalid"),
        ({"stop": lambda self: None}, r"RigError for a push after stop\(\), got none"),
        ({"close": reviving}, r"RigError for a push after close\(\), got none"),
    ],
)
def test_violations_of_actuators_are_found(members, words):
    with pytest.raises(AssertionError, match=words):
        check_actuator(actuator(**members))


def test_what_is_no_device():
    with pytest.raises(AssertionError, match="attributes and methods of Actuator"):
        check_actuator(object())
    with pytest.raises(AssertionError, match="attributes and methods of Sensor"):
        check_sensor(object())


class Sensor:
    name = "camera"

    def __init__(self, change=lambda frame, at: frame):
        self.at, self.change = 0, change

    def observe(self):
        self.at += 1
        number = self.at // 2  # each picture twice
        points = np.array([[1.0, 2.0], [number, 3.0]])
        return self.change(Frame(points, time.monotonic(), number), self.at)

    def close(self):
        pass


def changed(frame, at, **values):
    return Frame(**{"points": frame.points, "time": frame.time, "number": frame.number} | values)


def test_a_sensor_that_keeps_the_rules():
    check_sensor(Sensor())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda frame, at: frame.points, "expected a Frame"),
        (lambda frame, at: changed(frame, at, points=[[1, 2]]), "an array of points, got list"),
        (lambda frame, at: changed(frame, at, points=np.array([[1, 2]])), "float64, got int64"),
        (lambda frame, at: changed(frame, at, points=np.zeros(2)), r"shape \(n, 2\), got \(2,\)"),
        (lambda frame, at: changed(frame, at, points=np.zeros((1, 4))), r"got \(1, 4\)"),
        (lambda frame, at: changed(frame, at, points=np.full((1, 2), np.nan)), "finite points"),
        (lambda frame, at: changed(frame, at, number=1.0), "a whole number, got 1.0"),
        (lambda frame, at: changed(frame, at, time=1), "a time in seconds, got 1"),
        (lambda frame, at: changed(frame, at, time=frame.time + 60), "from now"),
        (lambda frame, at: changed(frame, at, number=9 - at), "was followed by picture"),
        (lambda frame, at: changed(frame, at, points=frame.points + at), "with other points"),
        (lambda frame, at: changed(frame, at, time=1000.0 - at), "arrived before"),
        (lambda frame, at: changed(frame, at, points=np.zeros((1, 2 + at % 2))), "points of"),
    ],
)  # fmt: skip
def test_violations_of_sensors_are_found(change, words):
    with pytest.raises(AssertionError, match=words):
        check_sensor(Sensor(change))


def test_a_sensor_that_changes_a_frame_afterwards_is_found():
    points = np.zeros((1, 2))

    def same_array(frame, at):
        points[:] = at
        return changed(frame, at, points=points, number=at)

    with pytest.raises(AssertionError, match="changed afterwards"):
        check_sensor(Sensor(same_array))


# -------------------------------------------------------------------------------------------------
# a rig of two devices


def test_an_exact_rig_of_two_devices_maps_as_the_simulated_one():
    workspace = open_map("maze:9x7")
    device = Grid(workspace, workspace.cells[:4])
    result = drive(BenchRig(device, device), seed=3, exact=True)
    simulated = drive(SimulatedRig(workspace, workspace.cells[:4]), seed=3, exact=True)
    assert result.commands == simulated.commands
    assert result.compared(workspace) == {"false_free": 0, "false_obstacles": 0}


def test_points_become_cells_whose_centres_are_whole_numbers():
    ports = plant_ports([(2.5, 0.5)])
    rig = BenchRig(ports, ports)
    assert ports.observe().points == pytest.approx(np.array([[50.0, 50.0]]))  # 20 pixels a cell
    assert rig.look().points == pytest.approx(np.array([[2.0, 2.0]]))
    rig.push(90.0, EXACT.pulse / 2)  # up: by half a cell
    assert rig.look().points == pytest.approx(np.array([[1.5, 2.0]]), abs=0.02)
    turned = GridCalibration(10, origin=(5, 0))
    assert turned.to_cells(np.array([[30.0, 5.0]])).tolist() == [[0.0, 2.0]]


def test_particles_that_share_a_cell_are_both_listed():
    # discs that are small for their cells
    apparatus = PlantProperties(radius=0.2)
    ports = plant_ports(((2.3, 0.5), (0.3, 2.4), (0.75, 2.6)), apparatus)
    assert BenchRig(ports, ports).observe().tolist() == [[0, 0], [0, 0], [2, 2]]


def test_what_a_camera_sees_outside_the_grid_is_left_out_and_told():
    class Dust(Grid):
        """A camera that sees a spot beside the grid."""

        spots = ((-4.0, 2.0),)

        def observe(self):
            frame = super().observe()
            return Frame(np.vstack([frame.points, self.spots]), frame.time, frame.number)

    dust = Dust()
    result = drive(BenchRig(dust, dust), exact=True)
    assert result.status == "complete"
    assert result.compared(ROOM) == {"false_free": 0, "false_obstacles": 0}
    looks = result.scans
    assert result.notes == (
        f"{dust.name}: {looks} spots outside the grid left out, in {looks} pictures",
    )
    dust = Dust()
    dust.spots = ((-4.0, 2.0), (-4.0, 3.0), (5.0, 9.0))
    with pytest.raises(
        RigError, match=r"got 3 of 5 outside, such as in \(-4, 2\): the calibration is"
    ):
        BenchRig(dust, dust).observe()


def test_a_push_is_seen_in_a_picture_that_was_taken_after_it():
    camera = Sensor()
    rig = BenchRig(Actuator(), camera, CellCalibration(), shape=(9, 9), latency=0.02)
    rig.look()
    rig.look()
    before = rig.look().number
    rig.send("r")
    ended = time.monotonic()
    seen = rig.look()
    assert seen.number > before
    assert seen.time >= ended + 0.019


@pytest.mark.parametrize(
    "change",
    [
        lambda frame, at: changed(frame, at, number=3),  # the camera repeats one picture
        lambda frame, at: changed(frame, at, time=5.0),  # pictures from before the push
    ],
)
def test_a_frozen_camera_ends_the_drive(change):
    rig = BenchRig(Actuator(), Sensor(change), CellCalibration(), shape=(9, 9), patience=0.03)
    rig.look()
    rig.send("u")
    with pytest.raises(RigError, match=r"camera: no new picture for 0.03 s.*an old picture"):
        rig.look()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"calibration": None}, "calibration: expected one for the sensor camera"),
        ({"shape": (2, 3, 4)}, "shape: expected rows and columns, got"),
        ({"shape": None}, "shape: expected the rows and columns that the sensor camera sees"),
        ({"rule": "tilt"}, "rule: expected one of block, merge"),
        ({"latency": -1}, "latency: expected a number, 0 or more"),
        ({"patience": 0}, "patience: expected a number, above 0"),
        ({"pulses": {"l": (0, 1)}}, "got no r"),
    ],
)
def test_a_rig_of_two_devices_says_what_is_missing(options, words):
    given = {"calibration": CellCalibration(), "shape": (9, 9)} | options
    with pytest.raises(InvalidInputError, match=words):
        BenchRig(Actuator(), Sensor(), **given)
    with pytest.raises(InvalidInputError, match="for the actuator coils, got none"):
        BenchRig(actuator(pulses=None), Sensor(), CellCalibration(), shape=(9, 9))


# -------------------------------------------------------------------------------------------------
# a bench that steers


def test_a_bench_moves_particles_by_vectors():
    about = PlantProperties.of("exact", radius=0.2)
    plant = Plant(GridWorkspace(np.ones((8, 8))), [(4, 4), (4, 5)], about, np.random.default_rng(1))
    ports = PlantPorts(plant)
    ports.longest = 0.15  # seconds: longer moves are several pulses
    responses = Responses.from_pulses(ports.pulses)
    bench = SteeringBench(BenchRig(ports, ports), responses, unit=0.1, origin=(-0.4, -0.4))
    start = bench.look()
    assert start == pytest.approx(np.array([[0, 0], [0, 0.1]]), abs=1e-3)
    expected = start.copy()
    for move in ((0.05, 0.02), (-0.3, 0.1), (0, 0), (0.1, -0.25)):
        bench.send(move)
        expected += move
        assert bench.look() == pytest.approx(expected, abs=2e-3)
    bench.stop()
    with pytest.raises(RigError):
        bench.send((0.1, 0))
    with pytest.raises(InvalidInputError, match="pushes in every direction"):
        SteeringBench(BenchRig(ports, ports), Responses.from_pulses(ports.pulses, only=True))


class PushingRig:
    """A rig of the protocol that pushes in every direction and says where particles are."""

    def __init__(self, ports, can=("push", "look")):
        self.ports, self.can, self.session, self.seq, self.stopped = ports, can, "", 0, False

    def reply(self, line):
        message = decode_message(line) if line.strip() else None
        if message is None:
            return b""
        if message.type == "hello":
            if message.session != self.session:
                self.session, self.seq, self.stopped = message.session, 0, False
            about = {"shape": list(self.ports.shape), "can": list(self.can), "pulse": 0.083}
            return encode_message(
                Welcome(protocol=1, session=self.session, seq=self.seq, name="far", **about)
            )
        if message.type == "stop":
            self.stopped = True
            return encode_message(Stopped())
        self.seq = message.seq
        if message.type == "look":
            cells = self.ports.calibration.to_cells(self.ports.observe().points)
            return encode_message(Points(seq=message.seq, points=cells.tolist()))
        if self.stopped:
            return encode_message(Refusal(seq=message.seq, text="stopped"))
        self.ports.push(message.angle, message.seconds)
        return encode_message(Done(seq=message.seq, values={"current": 0.8}))


def test_a_rig_behind_a_connection_may_push_in_every_direction():
    about = PlantProperties.of("exact", radius=0.2)
    plant = Plant(GridWorkspace(np.ones((8, 8))), [(4, 4), (4, 5)], about, np.random.default_rng(1))

    def remote(**options):
        transport = BenchTransport(PushingRig(PlantPorts(plant), **options))
        return RemoteRig(transport, repeat_after=1, end_after=3)

    bench = SteeringBench(remote(), Responses.from_pulses(remote().pulses))
    start = bench.look()
    bench.send((0.3, -1.2))
    assert bench.look() - start == pytest.approx(np.array([[0.3, -1.2]] * 2), abs=0.01)
    assert bench.values == {"current": 0.8}
    coils = RemoteActuator(remote())
    assert not coils.whole
    check_actuator(coils)
    check_sensor(RemoteSensor(remote()))
    whole = remote(can=())
    with pytest.raises(InvalidInputError, match="expected a rig that pushes in every direction"):
        whole.push(45.0, 0.1)
    with pytest.raises(InvalidInputError, match="far, which can neither"):
        SteeringBench(whole, Responses.from_pulses(whole.pulses))


def test_a_rig_behind_a_connection_is_steered(tmp_path, capsys):
    about = PlantProperties.of("exact", radius=0.2)
    plant = Plant(GridWorkspace(np.ones((8, 8))), [(2, 2), (6, 5)], about, np.random.default_rng(1))
    rig = PushingRig(PlantPorts(plant))

    class Line(socketserver.StreamRequestHandler):
        def handle(self):
            for line in self.rfile:
                self.wfile.write(rig.reply(line.strip()))

    corners = [[0.2, 0.2], [7.8, 0.2], [7.8, 7.8], [0.2, 7.8]]
    problem = {"kind": "steering", "workspace": {"type": "polygon", "vertices": corners}}
    file = tmp_path / "room.json"
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Line) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        named = f"tcp:127.0.0.1:{server.server_address[1]}"
        file.write_text(json.dumps(problem))
        words = [
            "drive",
            "--steer",
            str(file),
            "--rig",
            named,
            "--waypoints",
            "3,4 4,2.5",
            "--json",
        ]
        code = shoal(words)
        server.shutdown()
    out, err = capsys.readouterr()
    assert code == 0, err
    assert json.loads(out)["status"] == "arrived"
    assert plant.points[0] == pytest.approx([4, 2.5], abs=0.2)


# -------------------------------------------------------------------------------------------------
# named on the command line

OWN = """
import numpy as np
from shoal import open_map
from shoal.rigs import Plant, PlantPorts, PlantProperties, SimulatedRig

vessel = open_map("maze:9x7")

def rig():
    return SimulatedRig(vessel, vessel.cells[:4])

def ports():
    points = [(c + .5, vessel.shape[0] - r - .5) for r, c in vessel.cells[:4]]
    return PlantPorts(Plant(vessel, points, PlantProperties(), np.random.default_rng(1)))

shared = ports()
number = 3

class Broken:
    def __init__(self):
        raise OSError("no coils")

def broken():
    raise OSError("no coils")
"""
NOISE = ("--slip", "0.05", "--misplace", "0.05", "--miss", "0.01")


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    (folder / "bench_devices.py").write_text(OWN)
    look_in(str(folder))


@pytest.mark.parametrize(
    ("options", "name"),
    [
        (["--rig", "bench_devices:rig"], "maze:9x7"),
        (["--rig", "bench_devices:ports", *NOISE], "maze:9x7"),
        (["--actuator", "bench_devices:ports", "--sensor", "bench_devices:ports", *NOISE], None),
        (["--actuator", "physics:exact", "--sensor", "physics", "--particles", "4"], None),
    ],
)
def test_devices_of_the_user_and_plants_are_driven(own, options, name, capsys):
    assert shoal(["drive", "maze:9x7", *options, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["status"], result["rig"]) == ("complete", name or "maze:9x7")
    assert result["wrong"]["false_free"] == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--rig", "foo"], "rig: expected simulated, physics:KIND, serial:"),
        (["--rig", "bench_devices:number"], "rig: expected an object with name, shape"),
        (["--rig", "bench_devices:absent"], "cannot import the rig 'bench_devices:absent'"),
        (["--rig", "bench_devices:Broken"], "cannot create the rig"),
        (["--rig", "bench_devices:broken"], "OSError: no coils"),
        (["--rig", "bench_devices:rig", "--repeat-after", "2"], "repeat-after: expected a rig beh"),
        (["--rig", "bench_devices:rig", "--start", "0,0"], "start: expected the rig simulated"),
        (["--actuator", "bench_devices:ports"], "sensor: expected one beside"),
        (["--sensor", "bench_devices:ports"], "actuator: expected one beside"),
        (["--actuator", "foo", "--sensor", "physics"], "sensor: expected physics with an actuator"),
        (["--actuator", "foo", "--sensor", "bar"], "actuator: expected coils:FILE, physics:KIND"),
        (["--actuator", "physics:roll", "--sensor", "bar:foo"], "sensor: expected physics"),
        (["--actuator", "a:b", "--sensor", "a:b", "--rig", "simulated"], "either --rig or two"),
        (["--actuator", "tcp:x:1", "--sensor", "tcp:x:1"], "another device than the actuator"),
        (["--actuator", "bench_devices:ports", "--sensor", "bench_devices:number"], "an object w"),
    ],
)
def test_wrong_devices(own, options, words, capsys):
    assert shoal(["drive", "maze:9x7", *options]) == 2
    out, err = capsys.readouterr()
    assert words in err
    assert err.count("\n") == 1
    assert not out


def test_devices_by_name_in_python(own):
    assert open_actuator("bench_devices:shared") is open_sensor("bench_devices:shared")
    assert open_own_rig("bench_devices:rig").shape == (7, 9)


def test_two_devices_behind_connections():
    """A coil controller and a camera that are two programs, over the protocol of rigs."""
    swarm = example.Swarm(free_of(ROOM), 2, 1)

    def device():
        transport = BenchTransport(example.Rig(swarm, ROOM.shape, name="bench"))
        return RemoteRig(transport, repeat_after=1, end_after=3)

    coils, camera = RemoteActuator(device()), RemoteSensor(device())
    result = drive(BenchRig(coils, camera))
    assert (result.status, result.compared(ROOM)["false_free"]) == ("complete", 0)
    assert camera.counts.requests == result.scans
    check_sensor(camera)
    check_actuator(RemoteActuator(device()))
