"""Map tiles below the studio's plan view: python -m benchmarks.tiles

How much time of processors a zoomed view takes to be laid out and drawn, with and without the tiles
of a large window, in Chromium without a graphics card. docs/adr/0020-map-tiles.md states it.
"""

from __future__ import annotations

import argparse
import io
import os
import shutil
import sys
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright

from benchmarks.studio import cpu_of, go_to, processes_below, served

ZOOM, FIRST, SIDE = 17, (68620, 45880), 16  # tiles in a row around 8.5 E, 47.4 N
STEPS = 60
FIELD = [[8.5, 47.4], [8.51, 47.4], [8.51, 47.406], [8.5, 47.406], [8.5, 47.4]]


def write_tiles(folder: Path) -> None:
    """Write a folder of tiles that are as hard to compress as aerial photographs."""
    rng = np.random.default_rng(1)
    for column in range(FIRST[0], FIRST[0] + SIDE):
        place = folder / str(ZOOM) / str(column)
        place.mkdir(parents=True)
        for row in range(FIRST[1], FIRST[1] + SIDE):
            grey = rng.integers(80, 160, (256, 256, 3), dtype=np.uint8)
            made = io.BytesIO()
            Image.fromarray(grey).save(made, "JPEG", quality=80)
            (place / f"{row}.jpg").write_bytes(made.getvalue())


PAN = """(steps) => new Promise((done) => {
    const plane = document.querySelector('.plane');
    const step = (k) => requestAnimationFrame(() => {
        if (k === steps) return done();
        plane.dispatchEvent(new WheelEvent('wheel', {deltaY: k % 2 ? 20 : -20, bubbles: true, cancelable: true}));
        step(k + 1);
    });
    step(0);
})"""


def main() -> int:
    with served() as (server, folder), sync_playwright() as playwright:
        write_tiles(folder / "town")
        (folder / "field.geojson").write_text(
            f'{{"type": "Polygon", "coordinates": [{FIELD}]}}', encoding="utf-8"
        )
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 1920, "height": 1080})
        page.goto(server.address)
        for words, under in (("no tiles", None), ("tiles", {"file": "town"})):
            problem = {"region": "field.geojson", "robots": 2, "footprint": "40"}
            go_to(page, server, "search", {"problem": problem, "seed": 0, "under": under})
            page.locator(".search-place .facts:has-text('searched in')").wait_for()
            page.wait_for_timeout(3000)
            shown = page.locator("[data-came=load]").count()
            began, served_before = cpu_of(processes_below(os.getpid())), server.cpu()
            page.evaluate(PAN, STEPS)
            spent = cpu_of(processes_below(os.getpid())) - began - (server.cpu() - served_before)
            print(
                f"{words}: {shown} tiles, {1000 * spent / STEPS:.0f} ms of CPU a step of the wheel"
            )
        browser.close()
    return 0


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    sys.exit(main())
