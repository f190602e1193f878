"""Take the pictures of the studio for the documentation: python docs/make_studio_images.py
[FOLDER].

With a folder every page is also taken there, light and dark, wide and narrow, to be looked at.
Needs Chromium.
"""

from __future__ import annotations

import argparse
import contextlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image, ImageOps
from playwright.sync_api import Browser, Error, Frame, Locator, Page, sync_playwright

IMAGES = Path(__file__).parent / "images"
CARDS = Path(__file__).parents[1] / "src/shoal/studio/static/places/welcome"
CARD = 480, 300  # pixels of the picture of an example
PATIENCE = 180_000  # milliseconds: the machine may be busy
COLOURS = 256  # of the pictures kept: what is on the pages has few
# The median cut mixes the colours of small things. Means settle those of wide ones.
METHOD = Image.Quantize.MAXCOVERAGE


def start(page: Page) -> None:
    page.get_by_role("link", name="Start").click()
    page.locator(".welcome .card img").last.wait_for()


def make_cards(browser: Browser, address: str) -> None:
    """Take the pictures of the examples on the first page, each in a browser window of its own: what
    one example leaves on a page could pass for the next one.
    """
    for number in range(len(list(CARDS.glob("*.png")))):
        page = opened(browser, address, FORMS[0])
        start(page)
        make_card(page, page.locator(".welcome .card").nth(number))
        page.context.close()


def make_card(page: Page, card: Locator) -> None:
    file = CARDS / Path(card.locator("img").get_attribute("src") or "").name
    card.click()
    if file.stem == "race":
        page.wait_for_selector(".pad:not([hidden])")
        for key in ["ArrowLeft", "ArrowDown", "ArrowRight", "ArrowUp"] * 6:
            page.keyboard.press(key)
    else:
        page.locator(".panel:not([hidden]) .exports").wait_for()
    page.wait_for_timeout(2500)
    inside = player(page)
    inside.evaluate("document.querySelector('.cut')?.remove()")
    if file.stem in ("field", "dying"):
        # without a value: what `seek` returns cannot be copied out of the page
        inside.evaluate("shoalPlayer.pause(); void shoalPlayer.seek(0.55 * shoalPlayer.length)")
        page.wait_for_timeout(500)
    inside.locator("#stage").screenshot(path=file)
    with Image.open(file) as shot:
        whole = ImageOps.crop(shot.convert("RGB"), border=12)  # without its round corners
    ground = whole.getpixel((0, whole.height // 2))
    picture = ImageOps.pad(whole, CARD, Image.Resampling.LANCZOS, color=ground)
    picture.quantize(COLOURS, METHOD, kmeans=4).save(file, optimize=True)


def player(page: Page) -> Frame:
    """Return the frame of the film that is seen, once there is a film in it."""
    until = time.monotonic() + PATIENCE / 1000
    while time.monotonic() < until:
        for frame in page.frames[1:]:
            with contextlib.suppress(Error):  # a frame that has just gone
                if frame.frame_element().is_visible() and frame.evaluate("!!window.shoalPlayer"):
                    return frame
        page.wait_for_timeout(100)
    raise TimeoutError("no film came")


def vessels(page: Page) -> None:
    page.get_by_role("link", name="Vessels").click()
    page.locator(".underStage .facts:has-text('free')").wait_for()


def run(page: Page) -> None:
    vessels(page)
    page.get_by_role("button", name="Run", exact=True).click()
    page.locator(".panel:not([hidden]) .exports").wait_for()


def race(page: Page) -> None:
    page.get_by_role("tab", name="Drive").click()
    page.get_by_role("button", name="Start the race").click()
    page.wait_for_selector(".pad:not([hidden])")
    for key in ["ArrowLeft", "ArrowDown", "ArrowRight", "ArrowUp"] * 6:
        page.keyboard.press(key)


def compare(page: Page) -> None:
    page.get_by_role("tab", name="Compare").click()
    page.locator("#compareTrials").fill("8")
    page.locator(".compare").get_by_role("button", name="Compare").click()
    page.wait_for_selector(".quad iframe:not([hidden])", timeout=90_000)


def steering(page: Page) -> None:
    page.get_by_role("link", name="Steering").click()
    page.wait_for_selector(".reach", state="attached")
    page.locator(".plan:has-text('fewest-moves'):not(:has-text('planning'))").wait_for()


def play(page: Page) -> None:
    page.get_by_role("button", name="Play", exact=True).click()
    page.locator(".panel:not([hidden]) .exports").wait_for()


def search(page: Page) -> None:
    page.get_by_role("link", name="Search").click()
    page.locator(".search-place .facts:has-text('nearest')").wait_for()


def simulate(page: Page) -> None:
    page.get_by_role("button", name="Simulate", exact=True).click()
    page.locator(".panel:not([hidden]) .exports").wait_for()
    page.locator(".panel:not([hidden]) iframe:not([hidden])").wait_for()
    page.wait_for_timeout(4000)
    page.get_by_role("button", name="Robot 3 dies now").click()
    page.get_by_role("button", name="Keep this run").wait_for()
    page.wait_for_timeout(3000)


def missions(page: Page) -> None:
    page.get_by_role("tab", name="Missions").click()
    page.get_by_role("button", name="Write missions").click()
    page.locator(".missionMap img").wait_for()


def lab(page: Page) -> None:
    new_sweep(page)
    if not page.locator("[role=status]:has-text('is there')").count():
        page.locator("#sweepToml").fill(SWEEP)
        page.locator(".drafting [role=status]:has-text('12 points')").wait_for()
        page.get_by_role("button", name="Run the sweep").click()
    page.get_by_role("tab", name="Sweeps").click()
    page.locator(".sweepCard:has-text('complete')").wait_for(timeout=180_000)
    page.locator(".chartArea .u-over").first.wait_for()


def new_sweep(page: Page) -> None:
    page.get_by_role("link", name="Lab").click()
    page.get_by_role("tab", name="New sweep").click()
    page.locator(".drafting [role=status]:has-text('trials')").wait_for()


def episodes(page: Page) -> None:
    page.get_by_role("tab", name="Episodes").click()
    page.locator(".shelf .card img").first.wait_for()


def papers(page: Page) -> None:
    page.get_by_role("link", name="Papers").click()
    page.locator(".paper").first.wait_for()
    if not page.locator(".paper .verdictChip").count():
        page.get_by_role("button", name="Run quickly: m-fig3").click()
    page.locator(".paper .verdictChip").wait_for(timeout=90_000)
    page.locator(".paper:has(.verdictChip)").evaluate("paper => paper.scrollIntoView()")


SWEEP = """name = "vessels"
trials = 12
seed = 1
paired = ["policy"]

[problem]
kind = "swarm"
map = "vessels:300"

[axes]
policy = ["closest-frontier", "greedy-classify", "elect-particle"]
particles = { from = 5, to = 40, count = 4, scale = "log" }
"""


PAGES: dict[str, Callable[[Page], None]] = {
    "start": start,
    "vessels": vessels,
    "run": run,
    "race": race,
    "compare": compare,
    "steering": steering,
    "play": play,
    "search": search,
    "simulate": simulate,
    "missions": missions,
    "lab": lab,
    "new": new_sweep,
    "episodes": episodes,
    "papers": papers,
}
KEPT = ("start", "vessels", "compare", "steering", "search", "lab", "papers")
FORMS = [(theme, *size) for theme in ("light", "dark") for size in ((1280, 800), (390, 844))]


def main(folder: Path | None) -> None:
    with tempfile.TemporaryDirectory() as parent:
        place = str(Path(parent) / "example")
        server = subprocess.Popen(
            [sys.executable, "-m", "shoal", "studio", place, "--no-browser"],
            stderr=subprocess.PIPE,
            text=True,
        )
        assert server.stderr is not None
        address = re.search(r"http://\S+", server.stderr.readline())
        assert address is not None
        try:
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(
                    executable_path=shutil.which("chromium"), args=["--no-sandbox"]
                )
                for theme, width, height in FORMS if folder else FORMS[:1]:
                    if (theme, width) == ("light", 1280):
                        make_cards(browser, address[0])
                    page = opened(browser, address[0], (theme, width, height))
                    for name, show in PAGES.items():
                        show(page)
                        page.wait_for_timeout(800)
                        if folder:
                            page.screenshot(path=folder / f"{name}-{theme}-{width}.png")
                        if name in KEPT and (theme, width) == ("light", 1280):
                            keep(page, IMAGES / f"studio-{name}.png")
                    page.context.close()
                browser.close()
        finally:
            server.send_signal(signal.SIGINT)
            server.wait()


def opened(browser: Browser, address: str, form: tuple[Any, int, int]) -> Page:
    """Open the studio in a window of its own."""
    theme, width, height = form
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=theme)
    page = context.new_page()
    page.set_default_timeout(PATIENCE)
    page.goto(address)
    page.wait_for_selector("body[data-ready]")
    return page


def keep(page: Page, path: Path) -> None:
    page.screenshot(path=path)
    Image.open(path).convert("RGB").quantize(COLOURS, METHOD, kmeans=4).save(path, optimize=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, help="for pictures of all pages and forms")
    main(parser.parse_args().folder)
