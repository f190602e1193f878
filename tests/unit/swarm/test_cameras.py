"""Cameras as sensors: OpenCV on pictures, a video file and a stream, and Micro-Manager."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from tests.benches import plant_of, render, view_of

from shoal import InvalidInputError, open_map
from shoal.core.errors import RigError
from shoal.rigs import BenchRig, drive
from shoal.rigs.calibration import transform_points
from shoal.rigs.cameras import CameraSensor, Detector, MicroManagerSource, Vision, open_camera
from shoal.rigs.measuring import calibrate
from shoal.rigs.physics import ANGLES
from shoal.rigs.ports import open_sensor
from shoal.rigs.registration import tie_by_map
from shoal.rigs.trim import PulseTrim
from shoal.testing import check_sensor

cv2 = pytest.importorskip("cv2")

VESSEL = open_map("vessels:100")


def discs(points, *, size=(240, 200), radius=5.0, ground=60.0, disc=200.0, noise=3.0, seed=1):
    picture = np.full(size[::-1], ground, dtype=np.float32)
    for x, y in points:
        at = round(float(x) * 16), round(float(y) * 16)
        cv2.circle(picture, at, round(radius * 16), disc, -1, cv2.LINE_AA, 4)
    rng = np.random.default_rng(seed)
    return np.clip(picture + rng.normal(0, noise, picture.shape), 0, 255).astype(np.uint8)


def spread_points(count=12, size=(240, 200), apart=16.0, seed=1):
    rng, points = np.random.default_rng(seed), []
    while len(points) < count:
        point = rng.uniform(12, np.subtract(size, 12))
        if all(np.linalg.norm(point - one) > apart for one in points):
            points.append(point)
    return np.array(points)


POINTS = spread_points()


def same_points(found, points, within=0.5):
    assert len(found) == len(points)
    assert cdist(points, found).min(1).max() < within


@pytest.mark.parametrize(("ground", "disc"), [(60.0, 200.0), (210.0, 90.0)])
def test_bright_and_dark_particles_are_found_within_half_a_pixel(ground, disc):
    same_points(Detector().find(discs(POINTS, ground=ground, disc=disc)), POINTS)


def test_few_small_particles_in_a_large_picture():
    points = spread_points(3, (900, 800))
    same_points(
        Detector().find(discs(points, size=(900, 800), radius=4, disc=160, noise=8)), points
    )


def test_a_vessel_is_no_particle():
    matrix, size = view_of(VESSEL.shape)
    cells, rng = VESSEL.cells[::9], np.random.default_rng(1)
    picture = render(VESSEL, cells, matrix, size, rng)
    with pytest.raises(RigError, match="may be the vessel"):
        Detector(Vision(particles="bright")).find(picture)
    found = Detector(Vision(threshold="40", particles="dark", max_area=400)).find(picture)
    same_points(found, transform_points(matrix, cells))


def test_colour_and_sixteen_bits():
    grey = discs(POINTS)
    same_points(Detector().find(np.stack([grey // 2, grey, grey], axis=2)), POINTS)
    same_points(Detector().find(grey.astype(np.uint16) * 17), POINTS)


def test_touching_particles_are_counted_by_their_area():
    points = np.vstack([POINTS, POINTS[0] + (10.5, 0)])
    found = Detector().find(discs(points))
    same_points(found, points, within=0.8)
    assert len(Detector(Vision(area=float("inf"))).find(discs(points))) == len(POINTS)


def test_what_is_too_small_or_too_large_is_no_particle():
    picture = discs(POINTS)
    picture[:30, :60] = 220
    picture[100, 3] = 255
    found = Detector(Vision(min_area=20, max_area=300)).find(picture)
    kept = POINTS[(POINTS[:, 0] > 66) | (POINTS[:, 1] > 36)]
    same_points(found, kept)


def test_a_background_is_taken_away(tmp_path):
    uneven = np.tile(np.linspace(20, 180, 240), (200, 1))
    shown = np.clip(uneven + discs(POINTS, ground=0, disc=60, noise=0), 0, 255)
    cv2.imwrite(str(tmp_path / "empty.png"), uneven.astype(np.uint8))
    vision = Vision(background=str(tmp_path / "empty.png"), threshold="30")
    same_points(Detector(vision).find(shown.astype(np.uint8)), POINTS)
    assert len(Detector(vision).find(uneven.astype(np.uint8))) == 0
    with pytest.raises(InvalidInputError, match="background: expected a picture of 20x10"):
        Detector(vision).find(np.zeros((10, 20), dtype=np.uint8))


def test_a_dark_picture_and_too_many_blobs_are_errors():
    with pytest.raises(RigError, match="brightness 7 to 7"):
        Detector().find(np.full((50, 50), 7, dtype=np.uint8))
    noise = np.random.default_rng(1).integers(0, 255, (100, 100)).astype(np.uint8)
    with pytest.raises(RigError, match="nothing stands out of the noise"):
        Detector().find(noise)
    with pytest.raises(RigError, match="at most 10 particles, got 12"):
        Detector(Vision(most=10)).find(discs(POINTS))


@pytest.mark.parametrize(
    ("spec", "error", "message"),
    [
        ("opencv:", InvalidInputError, "expected opencv:INDEX, FILE or ADDRESS"),
        (
            "opencv:none.avi",
            InvalidInputError,
            "the number of a camera, a video file or an address",
        ),
        ("opencv:0,area=x", InvalidInputError, "area: expected a number, got 'x'"),
        ("opencv:0,colour=3", InvalidInputError, "one of background, .*min-area.*'colour'"),
        ("opencv:0,threshold=dark", InvalidInputError, "threshold: expected a number"),
        ("opencv:0,area=2,area=3", InvalidInputError, "area twice"),
        ("pymmcore:none.cfg", InvalidInputError, "expected a configuration file"),
        ("opencv:http://127.0.0.1:9/none", RigError, "cannot open"),
    ],
)
def test_a_camera_that_is_not_there_is_told_in_one_sentence(spec, error, message):
    with pytest.raises(error, match=message):
        open_sensor(spec)


class Pictures:
    """A source of pictures that a test makes."""

    def __init__(self, make, rate=200.0):
        self.make, self.rate, self.closed = make, rate, False

    def open(self):
        pass

    def grab(self):
        time.sleep(1 / self.rate)
        return self.make()

    def close(self):
        self.closed = True


def test_frozen_lost_and_noiseless_cameras():
    state = {"frozen": False, "seed": 0}

    def make():
        state["seed"] += not state["frozen"]
        return discs(POINTS, seed=state["seed"])

    source = Pictures(make)
    sensor = CameraSensor("desk", source, Vision(stale=0.2))
    first = sensor.observe()
    while sensor.observe().number < 12:
        time.sleep(0.01)
    assert sensor.observe().time > first.time
    state["frozen"] = True
    with pytest.raises(RigError, match="same picture again and again"):
        watch(sensor, 3.0)
    state["frozen"] = False
    time.sleep(0.05)
    sensor.observe()
    source.make = lambda: None
    with pytest.raises(RigError, match="no picture for"):
        watch(sensor, 3.0)
    sensor.close()
    assert source.closed
    # pictures without noise are equal while nothing moves, and no error
    sensor = CameraSensor("drawn", Pictures(lambda: discs(POINTS)), Vision(stale=0.05))
    watch(sensor, 0.3)
    sensor.close()


def test_a_camera_passes_the_check_of_sensors():
    seeds = iter(range(10**6))
    source = Pictures(lambda: discs(POINTS, seed=next(seeds)))
    check_sensor(CameraSensor("desk", source))
    assert source.closed


def watch(sensor, seconds):
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        sensor.observe()
        time.sleep(0.01)


def test_particles_keep_their_rows_from_picture_to_picture():
    state = {"step": 0}

    def make():
        state["step"] += 1
        return discs(POINTS + np.array([0.5 * state["step"] % 8, 0]), seed=state["step"])

    sensor = CameraSensor("desk", Pictures(make))
    first = sensor.observe().points
    for _ in range(10):
        time.sleep(0.02)
        points = sensor.observe().points
        assert np.abs(points - first).max() < 9
    sensor.close()


def test_a_video_file_is_played_at_its_speed_and_ends(tmp_path):
    file = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), 50, (240, 200), False)
    for k in range(20):
        writer.write(discs(POINTS + np.array([k % 5, 0]), seed=k))
    writer.release()
    sensor = open_camera(f"opencv:{file},min-area=20")
    assert sensor.size == (240, 200)
    frames = []

    def play():
        while True:
            frames.append(sensor.observe())
            time.sleep(0.005)

    with pytest.raises(RigError, match="has ended"):
        play()
    sensor.close()
    assert frames[-1].number == 20
    assert all(len(frame.points) == len(POINTS) for frame in frames)
    numbers = [frame.number for frame in frames]
    assert numbers == sorted(numbers)


class Stage:
    """A plant whose clock is that of this computer, and which can be drawn."""

    def __init__(self, *, seed=0, particles=8, **properties):
        self.plant = plant_of(VESSEL, particles, seed, settle=0.0, camera_error=0.0, **properties)
        self.matrix, self.size = view_of(VESSEL.shape, cell=12, turn=100, shear=0.1, mirror=True)
        self.rng, self.lock, self.name = np.random.default_rng(seed), threading.Lock(), "stage"
        self.pulses = {letter: (angle, 0.083) for letter, angle in ANGLES.items()}

    def push(self, angle, seconds):
        with self.lock:
            self.plant.push(angle, seconds=seconds)

    def stop(self):
        pass

    close = stop

    def picture(self):
        with self.lock:
            points = self.plant.points
        cells = np.column_stack([VESSEL.shape[0] - 0.5 - points[:, 1], points[:, 0] - 0.5])
        return render(VESSEL, cells, self.matrix, self.size, self.rng)


@pytest.fixture
def stream():
    """An MJPEG stream of a stage over HTTP, as web cameras and microscopes have it."""
    stage = Stage(coil_gain=0.1, heading=8.0)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
            self.end_headers()
            try:
                while True:
                    data = cv2.imencode(".jpg", stage.picture())[1].tobytes()
                    head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}"
                    self.wfile.write(head.encode() + b"\r\n\r\n" + data + b"\r\n")
                    time.sleep(0.01)
            except OSError:  # the camera was closed
                pass

        def log_message(self, *about):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    stage.address = f"http://127.0.0.1:{server.server_port}/live.mjpg"
    yield stage
    server.shutdown()
    server.server_close()


def test_a_stream_is_calibrated_by_the_map_and_driven(stream, monkeypatch):
    monkeypatch.setattr("shoal.rigs.measuring.CYCLES", (1, 1))  # each pulse takes real time
    sensor = open_camera(f"opencv:{stream.address},particles=dark,threshold=40,min-area=20")
    tie = tie_by_map(sensor.picture(), VESSEL.free)
    found = calibrate(stream, sensor, pulses=stream.pulses, tie=tie, shape=VESSEL.shape, wait=0.2)
    assert found.residual < 0.1
    rig = BenchRig(
        stream,
        sensor,
        found,
        shape=found.shape,
        pulses=found.pulses,
        latency=found.latency,
        trim=PulseTrim(found.responses),
    )
    result = drive(
        rig, policy="closest-frontier", slip=0.05, misplace=0.02, miss=0.01, max_moves=25
    )
    rig.close()
    assert result.status in ("complete", "limit")
    assert len(result.belief.open) > 15
    assert result.compared(VESSEL)["false_free"] == 0


DEMO = """Property,Core,Initialize,0
Device,Camera,DemoCamera,DCam
Property,Core,Initialize,1
Property,Core,Camera,Camera
Property,Camera,Mode,Fluorescent Beads
Property,Camera,BeadDensity,20
"""


def test_the_demo_camera_of_micro_manager_shows_its_beads(tmp_path):
    pytest.importorskip("pymmcore")
    pytest.importorskip("mm_test_adapters")
    file = tmp_path / "demo.cfg"
    file.write_text(DEMO)
    sensor = open_sensor(f"pymmcore:{file},threshold=60,min-area=3")
    try:
        assert sensor.size == (512, 512)
        first = sensor.observe()
        assert 10 < len(first.points) < 40
        picture = sensor.picture()
        for x, y in np.rint(first.points).astype(int):
            assert picture[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3].max() > 60
        while sensor.observe().number < first.number + 3:
            time.sleep(0.01)
    finally:
        sensor.close()
    file.write_text(DEMO.replace("Fluorescent Beads", "Feast"))
    with pytest.raises(RigError, match="Feast"):
        open_sensor(f"pymmcore:{file}")
    file.write_text("Property,Core,Initialize,1\n")
    with pytest.raises(RigError, match="expected a configuration with a camera"):
        open_sensor(f"pymmcore:{file}")


CAMERA = """
import time
import numpy as np
from pymmcore_plus.experimental.unicore import SimpleCameraDevice
from tests.unit.swarm.test_cameras import Stage

class PlantCamera(SimpleCameraDevice):
    stage = Stage()
    exposure = 10.0

    def get_exposure(self):
        return self.exposure

    def set_exposure(self, exposure):
        self.exposure = exposure

    def sensor_shape(self):
        return self.stage.size[::-1]

    def dtype(self):
        return np.uint8

    def snap(self, buffer):
        time.sleep(0.01)
        buffer[:] = self.stage.picture()
        return {}
"""


STILL_CAMERA = """
import time
import numpy as np
from pymmcore_plus.experimental.unicore import SimpleCameraDevice


class StillCamera(SimpleCameraDevice):
    def get_exposure(self):
        return 10.0

    def set_exposure(self, exposure):
        pass

    def sensor_shape(self):
        return 20, 20

    def dtype(self):
        return np.uint8

    def snap(self, buffer):
        time.sleep(0.01)
        buffer[:] = 0
        return {}
"""


def test_a_python_camera_of_micro_manager_renders_a_plant(tmp_path, monkeypatch):
    unicore = pytest.importorskip("pymmcore_plus.experimental.unicore", exc_type=ImportError)
    (tmp_path / "plant_camera.py").write_text(CAMERA)
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "plant.cfg"
    file.write_text(
        "#py pyDevice,Camera,plant_camera,PlantCamera\nProperty,Core,Initialize,1\n"
        "#py Property,Core,Camera,Camera\n"
    )
    looks = "particles=dark,threshold=40,min-area=20"
    core = unicore.UniMMCore()
    core.loadSystemConfiguration(str(file))
    for sensor in (  # a file, and a core that is set up already
        open_sensor(f"pymmcore:{file},{looks}"),
        CameraSensor("plant", MicroManagerSource(core)),
    ):
        try:
            assert tie_by_map(sensor.picture(), VESSEL.free).residual < 0.1
        finally:
            sensor.close()


def test_a_program_with_a_python_camera_of_micro_manager_ends_well(tmp_path):
    pytest.importorskip("pymmcore_plus.experimental.unicore", exc_type=ImportError)
    (tmp_path / "still_camera.py").write_text(STILL_CAMERA)
    file = tmp_path / "still.cfg"
    file.write_text(
        "#py pyDevice,Camera,still_camera,StillCamera\nProperty,Core,Initialize,1\n"
        "#py Property,Core,Camera,Camera\n"
    )
    # the threads of several cores: one of them alone rarely meets a Python that ends
    program = (
        "from shoal.rigs.ports import open_sensor\n"
        f"sensors = [open_sensor('pymmcore:{file}') for _ in range(6)]\n"
        "for sensor in sensors: sensor.close()"
    )
    paths = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")
