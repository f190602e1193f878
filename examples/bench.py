"""A laboratory bench in one program, to rehearse with: four coils on a pseudo-terminal, which take
the lines of examples/actuation/four_coil_puller.toml, a physical plant that they act on, and a
camera that sends its pictures as MJPEG over HTTP. It needs the extras physics and opencv.

    python examples/bench.py vessels:100 --particles 8 --pty /tmp/coils --port 8090
    shoal drive --actuator coils:puller.toml --sensor "opencv:..." ...

In puller.toml stands connection = "serial:/tmp/coils", and the bench prints the name of its camera.
docs/how-to/coils.md goes through it. The signal SIGUSR1 pulls the cable of the coils for --pause
seconds, and SIGUSR2 that of the camera. With --count FILE, the bench writes down each pulse.
"""

from __future__ import annotations

import argparse
import os
import select
import signal
import threading
import time
import tty
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from math import atan2, cos, degrees, hypot, radians, sin
from pathlib import Path

import cv2
import numpy as np

from shoal import open_map
from shoal.rigs import Plant, PlantProperties
from shoal.swarm.grid.board import trial_rng
from shoal.swarm.grid.tasks import place

SCALE, MARGIN = 20, 10  # pixels a cell, and around the vessel
FULL = 180.0  # duty that moves a particle by one cell in a pulse of .083 s
STEP = 0.004  # seconds between two looks at the line


class Bench:
    """Coils and a plant in real time."""

    running = True

    def __init__(self, vessel, particles, seed, **properties):
        cells = place(vessel, particles, "uniform", trial_rng(seed))
        points = [(col + 0.5, vessel.shape[0] - row - 0.5) for row, col in cells]
        about = PlantProperties.of("pull", delay=0, settle=0, **properties)
        self.plant = Plant(vessel, points, about, np.random.default_rng(seed))
        self.duty, self.lines, self.picture = (0.0, 0.0, 0.0, 0.0), 0, b""
        self.count = lambda pulse: None  # told of each pulse
        self.pulled, self.blind = False, -1.0  # the cable of the coils; when the camera sees again
        rows, cols = vessel.shape
        self.blank = np.full((rows * SCALE + 2 * MARGIN, cols * SCALE + 2 * MARGIN), 20, np.uint8)
        free = np.kron(vessel.free, np.ones((SCALE, SCALE), dtype=bool))
        self.blank[MARGIN:-MARGIN, MARGIN:-MARGIN][free] = 60
        self.look(0.0, 0.0, False)

    def look(self, turn, shear, mirror):
        """Turn the camera by an angle in degrees, shear its picture, and mirror it."""
        height, width = self.blank.shape
        cosine, sine = cos(radians(turn)), sin(radians(turn))
        linear = np.array([[cosine, -sine], [sine, cosine]]) @ [[1, shear], [0, 1]]
        linear = linear @ np.diag([-1 if mirror else 1, 1])
        corners = np.array([(0, 0), (width, 0), (0, height), (width, height)]) @ linear.T
        self.view = np.column_stack([linear, -corners.min(axis=0)])
        self.size = tuple(int(side) for side in np.ceil(np.ptp(corners, axis=0)))

    def take(self, line):
        """Carry out a line, and return the answer."""
        self.lines += 1
        words = line.split()
        try:
            duty = tuple(float(word) for word in words[1:])
        except ValueError:
            duty = ()
        if words[:1] != ["SET"] or len(duty) != 4 or not all(0 <= one <= 255 for one in duty):
            return f"ERR {line[:40]}\n"
        if any(duty) and not any(self.duty):
            self.count(f"{self.plant.clock:.3f} {' '.join(words[1:])}")
        self.duty = duty
        return "OK\n"

    def act(self, seconds):
        """Let the plant move for some seconds under the coils as they are."""
        right, up, left, down = self.duty
        x, y = (right - left) / FULL, (up - down) / FULL
        if x or y:
            self.plant.push(degrees(atan2(y, x)), seconds=seconds, strength=hypot(x, y))
        else:
            self.plant.wait(seconds)

    def draw(self):
        """Take a picture, as JPEG."""
        picture = self.blank.copy()
        _, points = self.plant.picture()
        radius = round(self.plant.apparatus.radius * SCALE * 16)
        for x, y in points * [1, -1] + [0, self.plant.workspace.shape[0]]:
            middle = (
                round((x * SCALE + MARGIN - 0.5) * 16),
                round((y * SCALE + MARGIN - 0.5) * 16),
            )
            cv2.circle(picture, middle, radius, 230, -1, cv2.LINE_AA, shift=4)
        picture = cv2.warpAffine(picture, self.view, self.size, borderValue=20)
        self.picture = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()

    def run(self, path, pause):
        """Read lines from a pseudo-terminal of this name, and answer them."""
        came, began, drawn, terminal = b"", time.monotonic(), -1.0, None
        plugged = began  # when the cable of the coils is there
        while self.running:
            now = time.monotonic()
            if self.pulled and terminal is not None:
                terminal, came = close_terminal(terminal, path), b""
                self.pulled, plugged = False, now + pause
            if terminal is None and now >= plugged:
                terminal = open_terminal(path)
            if terminal is None:
                time.sleep(STEP)
            elif select.select(terminal[:1], [], [], STEP)[0]:
                with suppress(OSError):
                    came += os.read(terminal[0], 4096)
            ahead = time.monotonic() - began - self.plant.clock
            if ahead > 0:
                self.act(ahead)
            while b"\n" in came:
                line, _, came = came.partition(b"\n")
                os.write(terminal[0], self.take(line.decode(errors="replace")).encode())
            if self.plant.clock - drawn >= 1 / self.plant.apparatus.frame_rate:
                drawn = self.plant.clock
                self.draw()


def open_terminal(path):
    """Open a pseudo-terminal with a name, and return its two ends."""
    ends = os.openpty()
    for end in ends:
        tty.setraw(end)
    with suppress(FileNotFoundError):
        os.unlink(path)
    os.symlink(os.ttyname(ends[1]), path)
    return ends


def close_terminal(ends, path):
    """Close both ends, and remove the name."""
    os.unlink(path)
    for end in ends:
        os.close(end)


def serve(bench, port):
    """Send the pictures to everybody who asks for them."""

    class Camera(BaseHTTPRequestHandler):
        def do_GET(self):
            if time.monotonic() < bench.blind:
                return
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            sent = b""
            with suppress(OSError):
                while time.monotonic() >= bench.blind:
                    if bench.picture is not sent:
                        sent = bench.picture
                        self.wfile.write(b"--frame\r\nContent-Type: image/jpeg\r\n")
                        self.wfile.write(b"Content-Length: %d\r\n\r\n" % len(sent) + sent + b"\r\n")
                    time.sleep(STEP)

        def log_message(self, *_words):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", port), Camera)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


def main():
    """Run the bench until Ctrl-C."""
    parser = argparse.ArgumentParser(description="A laboratory bench to rehearse with.")
    parser.add_argument("map", help="true map, such as vessels:100")
    parser.add_argument("--particles", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--radius", type=float, default=0.35, help="of the particles, in cells")
    parser.add_argument("--turn", type=float, default=0.0, help="angle of the camera in degrees")
    parser.add_argument("--shear", type=float, default=0.0, help="of the picture")
    parser.add_argument("--mirror", action="store_true", help="mirror the picture")
    parser.add_argument("--friction", type=float, default=0.2, help="between particles and walls")
    parser.add_argument("--pty", required=True, help="name of the pseudo-terminal of the coils")
    parser.add_argument("--port", type=int, default=8090, help="of the camera")
    parser.add_argument("--count", type=Path, help="file with a line for each pulse")
    parser.add_argument("--pause", type=float, default=2.0, help="seconds without a cable")
    options = parser.parse_args()
    vessel = open_map(options.map)
    properties = {"radius": options.radius, "friction": options.friction}
    bench = Bench(vessel, options.particles, options.seed, **properties)
    bench.look(options.turn, options.shear, options.mirror)
    book = None if options.count is None else options.count.open("a", buffering=1)
    bench.count = lambda pulse: print(pulse, file=book) if book else None
    signal.signal(signal.SIGUSR1, lambda *_: setattr(bench, "pulled", True))
    blinded = lambda *_: setattr(bench, "blind", time.monotonic() + options.pause)  # noqa: E731
    signal.signal(signal.SIGUSR2, blinded)
    serve(bench, options.port)
    print(f"coils:  serial:{options.pty}")
    print(
        f"camera: opencv:http://127.0.0.1:{options.port}/,particles=bright,threshold=150",
        flush=True,
    )
    try:
        bench.run(options.pty, options.pause)
    except KeyboardInterrupt:
        with suppress(FileNotFoundError):
            os.unlink(options.pty)


if __name__ == "__main__":
    main()
