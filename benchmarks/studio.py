"""How the studio feels, and how it bears attacks: python -m benchmarks.studio [--attacks]
[--sockets N] [--bytes N]

Without options: a table of what a hand feels, measured in headless Chromium on a studio of its own.
With --attacks: connections that never say anything, a body that never ends, 500 jobs, three jobs
whose server is killed, one that eats memory, and whether the studio answers, loses nothing and
leaves no process behind.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import json
import os
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from urllib.parse import quote

import numpy as np
from PIL import Image, ImageDraw
from playwright.sync_api import Page, sync_playwright

TIMES = 9
SIDE = 2000  # pixels of the photograph


def processes_below(pid: int) -> list[int]:
    """Return a process and all that it has started."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                parents[int(entry.name)] = int(
                    (entry / "stat").read_text().rpartition(")")[2].split()[1]
                )
    found = [pid]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found


def cpu_of(processes: list[int]) -> float:
    """Return the seconds of processors that processes have used."""
    ticks = 0
    for one in processes:
        with contextlib.suppress(OSError):
            ticks += sum(
                map(int, Path(f"/proc/{one}/stat").read_text().rpartition(")")[2].split()[11:13])
            )
    return ticks / os.sysconf("SC_CLK_TCK")


class Server:
    """A studio of a folder in a process of its own."""

    def __init__(self, folder: Path) -> None:
        began = time.perf_counter()
        words = [sys.executable, "-m", "shoal", "studio", str(folder), "--no-browser"]
        self.process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
        assert self.process.stderr is not None
        found = re.search(r"http://127\.0\.0\.1:(\d+)/\?token=\S+", self.process.stderr.readline())
        assert found is not None
        self.address, self.port = found[0], int(found[1])
        self.seconds = time.perf_counter() - began
        self.cookie = self.ask(self.address.partition(str(self.port))[2])[1][
            "set-cookie"
        ].partition(";")[0]

    def ask(
        self, path: str, method: str = "GET", body: object = None
    ) -> tuple[int, dict[str, str], bytes]:
        with contextlib.closing(
            http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        ) as line:
            headers = {"cookie": getattr(self, "cookie", ""), "content-type": "application/json"}
            line.request(method, path, None if body is None else json.dumps(body), headers)
            answer = line.getresponse()
            return (
                answer.status,
                {name.lower(): value for name, value in answer.getheaders()},
                answer.read(),
            )

    def processes(self) -> list[int]:
        """Return the server and all that it has started."""
        return processes_below(self.process.pid)

    def cpu(self) -> float:
        """Return the seconds of processors that these have used."""
        return cpu_of(self.processes())

    def end(self, how: int = signal.SIGINT) -> list[int]:
        """End it; return the processes that are left two seconds later; those that nobody has
        buried are none.
        """
        below = self.processes()
        self.process.send_signal(how)
        self.process.wait(30)
        time.sleep(2)
        return [one for one in below if self._runs(one)]

    @staticmethod
    def _runs(pid: int) -> bool:
        with contextlib.suppress(OSError):
            return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
        return False


@contextlib.contextmanager
def served() -> Iterator[tuple[Server, Path]]:
    with tempfile.TemporaryDirectory() as name:
        server = Server(Path(name))
        try:
            yield server, Path(name)
        finally:
            if server.process.poll() is None:
                server.end()


def draw_photograph(path: Path) -> None:
    """Write a photograph with dark vessels on a pale, noisy ground."""
    image = Image.new("L", (SIDE, SIDE), 190)
    pen, rng = ImageDraw.Draw(image), np.random.default_rng(1)
    for _ in range(25):
        at = np.cumsum(rng.normal(0, SIDE / 12, (8, 2)), axis=0) + SIDE / 2
        pen.line(
            [tuple(point) for point in at.tolist()],
            fill=95,
            width=int(rng.integers(4, 22)),
            joint="curve",
        )
    noisy = np.asarray(image, float) + rng.normal(0, 6, (SIDE, SIDE))
    Image.fromarray(noisy.clip(0, 255).astype(np.uint8)).save(path)


def measures(page: Page, name: str) -> list[float]:
    found: list[float] = page.evaluate(
        f"performance.getEntriesByName('{name}').map((one) => one.duration)"
    )
    return found


def go_to(page: Page, server: Server, place: str, given: object) -> None:
    page.goto("about:blank")
    page.goto(f"http://127.0.0.1:{server.port}/#{place}?{quote(json.dumps(given))}")
    page.wait_for_selector("body[data-ready]")


def count(page: Page, name: str, wanted: int) -> list[float]:
    """Wait until something was measured so often."""
    until = time.monotonic() + 60
    while len(found := measures(page, name)) < wanted and time.monotonic() < until:
        page.wait_for_timeout(20)
    return found


def overlay(page: Page, server: Server) -> list[float]:
    go_to(
        page,
        server,
        "vessels",
        {"problem": {"map": "photograph.png", "vessels": True, "low": 1.0}, "seed": 0},
    )
    count(page, "shoal-overlay", 2)  # the filters run once, then the exact answer comes
    slider = page.locator("[data-field=low] input[type=range]")
    for k in range(TIMES):
        before = len(measures(page, "shoal-overlay"))
        slider.evaluate(
            "(input, value) => { input.value = value; input.dispatchEvent(new Event('input')); }",
            0.8 + 0.05 * k,
        )
        count(page, "shoal-overlay", before + 1)
    return measures(page, "shoal-overlay")[2:]


def drag(page: Page, server: Server) -> list[float]:
    given = {
        "workspace": "square",
        "start": [[0.2, 0.3], [0.5, 0.35]],
        "goal": [[0.8, 0.2], [0.3, 0.75]],
    }
    go_to(page, server, "steering", {"problem": given, "seed": 0})
    count(page, "shoal-greedy", 1)
    box = page.get_by_role("button", name="Particle 1 at").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    for k in range(4 * TIMES):
        page.mouse.move(box["x"] + 12 + 3 * k, box["y"] + 12 - k)
        page.wait_for_timeout(30)
    page.mouse.up()
    return measures(page, "shoal-greedy")[1:]


def first_frame(page: Page, server: Server) -> list[float]:
    found: list[float] = []
    for seed in range(5):
        given = {"map": "vessels:5000:7", "particles": 100, "policy": "closest-frontier"}
        go_to(page, server, "vessels", {"problem": given, "seed": seed})
        page.locator(".underStage .facts:has-text('free')").wait_for()
        page.wait_for_timeout(500)
        page.get_by_role("button", name="Run", exact=True).click()
        found += count(page, "shoal-first-frame", 1)
        page.locator(".panel:not([hidden]) .exports").wait_for(timeout=60_000)
    return found


def frames(page: Page, server: Server) -> list[float]:
    given = {
        "map": "rectangle:250x250",
        "particles": 10_000,
        "policy": "random-moves",
        "max_moves": 3000,
        "task": "coverage",
    }
    go_to(page, server, "vessels", {"problem": given, "seed": 0})
    page.locator(".underStage .facts:has-text('free')").wait_for()
    page.get_by_role("button", name="Run", exact=True).click()
    count(page, "shoal-first-frame", 1)
    page.wait_for_timeout(1500)
    inside = page.frames[-1] if len(page.frames) > 1 else page.main_frame
    for frame in page.frames:
        if frame != page.main_frame and frame.evaluate("!!window.shoalPlayer"):
            inside = frame
    rate: float = inside.evaluate(
        "new Promise((done) => { let shown = 0; const began = performance.now(); (function next() {"
        " shown++; if (performance.now() - began < 3000) requestAnimationFrame(next); else"
        " done(shown / 3); })(); })"
    )
    return [rate]


def feel() -> int:
    with served() as (server, folder), sync_playwright() as playwright:
        draw_photograph(folder / "photograph.png")
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"),
            args=["--no-sandbox", "--enable-gpu-rasterization"],
        )
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        asked: set[str] = set()
        page.on("request", lambda request: asked.add(request.url))
        began = time.perf_counter()
        page.goto(server.address)
        page.wait_for_selector("body[data-ready]")
        ready = 1000 * (server.seconds + time.perf_counter() - began)
        files = len([address for address in asked if "/api/" not in address])
        fresh = []
        for _ in range(TIMES):
            page.goto("about:blank")
            began = time.perf_counter()
            page.goto(f"http://127.0.0.1:{server.port}/")
            page.wait_for_selector("body[data-ready]")
            fresh.append(1000 * (time.perf_counter() - began))
        page.wait_for_timeout(4000)
        before = server.cpu()
        page.wait_for_timeout(5000)
        idle = 100 * (server.cpu() - before) / 5
        rows = [
            ("start to a page that can be used, ms", [ready], 1500),
            ("first page of a studio that runs, ms", fresh, 500),
            (f"slider to overlay, {SIDE} x {SIDE} photograph, ms", overlay(page, server), 150),
            ("drag to greedy's plan, ms", drag(page, server), 50),
            ("Run to first frame, 5,000 cells, ms", first_frame(page, server), 300),
            ("frames a second, 10,000 particles", frames(page, server), 50),
            ("processors used while idle, %", [idle], 0),
            ("files that the first page asks for", [files], 12),
        ]
        browser.close()
    print(f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    print(f"{'':<52} {'median':>8} {'most':>8} {'aim':>6}")
    for words, found, aim in rows:
        print(f"{words:<52} {median(found):>8.0f} {max(found):>8.0f} {aim:>6}")
    return 0


def attacks(sockets: int, size: int) -> int:
    faults = []
    resource.setrlimit(resource.RLIMIT_NOFILE, (resource.getrlimit(resource.RLIMIT_NOFILE)[1],) * 2)
    with served() as (server, folder):

        def check_well(after: str) -> None:
            try:
                well = server.ask("/api/start")[0] == 200
            except OSError:
                well = False
            print(f"{after}: the studio {'answers' if well else 'DOES NOT ANSWER'}")
            faults.extend([after] * (not well))

        lines: list[socket.socket] = []
        refused = 0
        for _ in range(sockets):
            try:
                lines.append(socket.create_connection(("127.0.0.1", server.port), timeout=5))
            except OSError:
                refused += 1
        check_well(f"{len(lines)} sockets open at once that say nothing ({refused} refused)")
        for line in lines:
            line.close()
        check_well("none of them")

        sent, piece = 0, b"100000\r\n" + b"x" * 2**20 + b"\r\n"
        head = (
            f"PUT /api/files/huge.npy HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nCookie:"
            f" {server.cookie}\r\n"
        )
        with contextlib.closing(
            socket.create_connection(("127.0.0.1", server.port), timeout=30)
        ) as line:
            line.sendall(f"{head}Transfer-Encoding: chunked\r\n\r\n".encode())
            with contextlib.suppress(OSError):
                while sent < size:
                    line.sendall(piece)
                    sent += 2**20
        time.sleep(0.5)
        check_well(f"a body of {size >> 20} MiB without an end ({sent >> 20} MiB went)")
        faults.extend(
            ["a body that was cut off is kept"]
            * any(path.name.endswith("npy") for path in folder.iterdir())
        )

        spec = {
            "problem": {
                "kind": "swarm",
                "map": "maze:9x7",
                "particles": 4,
                "policy": "closest-frontier",
            }
        }
        for seed in range(500):
            server.ask("/api/jobs", "POST", {"kind": "play", "spec": spec | {"seed": seed}})
        until = time.monotonic() + 600
        while (counts := json.loads(server.ask("/api/jobs")[2])["counts"]).get(
            "done", 0
        ) < 500 and time.monotonic() < until:
            time.sleep(0.5)
        print(f"500 jobs: {counts}, {len(list(folder.glob('*.npz')))} episodes")
        faults.extend(
            ["a job is lost"] * (counts != {"done": 500} or len(list(folder.glob("*.npz"))) != 500)
        )
        check_well("500 jobs")
        left = kill_and_count(server, folder, spec, faults)
    with served() as (server, _):
        eat(server, faults)
        check_well("a job that eats memory")
        left += server.end()
        print(f"processes left: {left}")
        faults.extend(["a process is left"] * bool(left))
    print("faults: " + ("; ".join(faults) or "none"))
    return 1 if faults else 0


def eat(server: Server, faults: list[str]) -> None:
    """Run a job that asks for more memory than it may have; it has to fail with a sentence."""
    spec = {
        "problem": {
            "kind": "swarm",
            "map": "rectangle:16000x16000",
            "particles": 4,
            "policy": "closest-frontier",
        },
        "seed": 0,
    }
    number = json.loads(server.ask("/api/jobs", "POST", {"kind": "play", "spec": spec})[2])["id"]
    until, job = time.monotonic() + 120, {"state": "queued"}
    while job["state"] in ("queued", "running") and time.monotonic() < until:
        time.sleep(0.2)
        job = next(
            one for one in json.loads(server.ask("/api/jobs")[2])["jobs"] if one["id"] == number
        )
    print(f"a job that eats memory: {job['state']}, {job.get('result')}")
    faults.extend(
        ["a job that eats memory is not refused"] * ("memory" not in str(job.get("result")))
    )


def kill_and_count(
    server: Server, folder: Path, spec: dict[str, dict[str, object]], faults: list[str]
) -> list[int]:
    """Kill the server while three jobs run; the next one has to finish them. Return the processes
    that either left behind.
    """
    there = len(list(folder.glob("*.npz")))
    for seed in range(3):
        long = {"problem": spec["problem"] | {"map": "maze:151x151", "particles": 30}, "seed": seed}
        server.ask("/api/jobs", "POST", {"kind": "play", "spec": long})
    while json.loads(server.ask("/api/jobs")[2])["counts"].get("running", 0) < min(
        3, os.cpu_count() or 1
    ):
        time.sleep(0.05)
    left = server.end(signal.SIGKILL)
    server = Server(folder)
    until = time.monotonic() + 300
    while (counts := json.loads(server.ask("/api/jobs")[2])["counts"]).get(
        "done", 0
    ) < 503 and time.monotonic() < until:
        time.sleep(0.5)
    kept = len(list(folder.glob("*.npz"))) - there
    print(f"three jobs and a killed server: {counts}, {kept} more episodes")
    faults.extend(["a job of a killed server is lost"] * (counts != {"done": 503} or kept != 3))
    return left + server.end()


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--attacks", action="store_true", help="attack it, instead of measuring how it feels"
    )
    parser.add_argument("--sockets", type=int, default=10_000)
    parser.add_argument("--bytes", type=int, default=2**30)
    options = parser.parse_args()
    return attacks(options.sockets, options.bytes) if options.attacks else feel()


if __name__ == "__main__":
    sys.exit(main())
