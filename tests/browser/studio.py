"""A studio for tests: a server of a folder, a browser on it, and what people do there."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

from playwright.sync_api import Page
from tests.browser.waiting import PATIENCE

import shoal

Form = tuple[Literal["light", "dark"], int, int]
FORMS: list[Form] = [
    ("light", 1280, 800),
    ("light", 390, 844),
    ("dark", 1280, 800),
    ("dark", 390, 844),
]
HOSTILE = "<img src=x onerror=alert(1)>"


class Studio:
    """A server of a folder, and a browser on it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.begin()

    def begin(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "shoal", "studio", str(self.folder), "--no-browser"],
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stderr is not None
        found = re.search(r"http://127\.0\.0\.1:(\d+)/\?token=\S+", self.process.stderr.readline())
        assert found is not None
        self.address, self.root = found[0], f"http://127.0.0.1:{found[1]}/"

    def end(self, how: int = signal.SIGINT) -> None:
        self.process.send_signal(how)
        self.process.wait(20)
        assert self.process.stderr is not None
        self.process.stderr.close()

    def open(self, page: Page, place: str = "", given: dict[str, Any] | None = None) -> None:
        page.goto("about:blank")
        page.goto(self.root + (f"#{place}?{quote(json.dumps(given))}" if place else ""))
        page.wait_for_selector("body[data-ready]")


def on_plane(
    page: Page, shown: tuple[float, float], *points: tuple[float, float]
) -> list[tuple[float, float]]:
    """Pixels of points in metres on the canvas of a search, which shows so many metres around (0,
    0) whole.
    """
    page.locator(".plane").scroll_into_view_if_needed()
    box = page.locator(".plane").bounding_box()
    assert box is not None
    left, top, right, bottom = 36, 40, 62, 50  # pixels around what is shown
    wide, high = box["width"] - left - right, box["height"] - top - bottom
    scale = min(wide / shown[0], high / shown[1])
    middle = box["x"] + left + wide / 2, box["y"] + top + high / 2
    return [(middle[0] + x * scale, middle[1] - y * scale) for x, y in points]


def wear(page: Page, theme: Literal["light", "dark"], width: int, height: int) -> None:
    """Show a page in one of the four forms."""
    page.set_viewport_size({"width": width, "height": height})
    page.emulate_media(color_scheme=theme, reduced_motion="reduce")


def tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=name, exact=True).click()


def tab_to(page: Page, words: str) -> None:
    """Press Tab, around the page while it loads, until these words or label have the focus."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        page.keyboard.press("Tab")
        if words in page.evaluate(
            "[document.activeElement.textContent, document.activeElement.ariaLabel]"
        ):
            return
    raise AssertionError(f"Tab never came to {words}")


def run_and_load(page: Page, studio: Studio, button: str = "Run", *, by_keys: bool = False) -> Any:
    before = set(studio.folder.iterdir())
    if by_keys:
        tab_to(page, button)
        page.keyboard.press("Enter")
    else:
        page.get_by_role("button", name=button, exact=True).click()
    page.wait_for_selector(".panel:not([hidden]) .exports")
    (new,) = [
        path for path in set(studio.folder.iterdir()) - before if path.suffix in (".npz", ".json")
    ]
    return shoal.load(new)


def written_by(page: Page, studio: Studio, button: str) -> Path:
    """Click on an export and return the file that it writes."""
    page.locator(".exports:visible").get_by_role("button", name=button).click()
    note = page.locator(".note", has_text="Written into the folder").last
    note.wait_for(timeout=90_000)  # films take a while
    name = note.locator("span").inner_text().partition(": ")[2]
    note.get_by_role("button", name="Close").click()
    return studio.folder / name
