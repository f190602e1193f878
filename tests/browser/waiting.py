"""Waiting for what a page does."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page

PATIENCE = 20.0
"""How many seconds to wait for what a busy machine does late."""


def until(page: Page, expression: str) -> None:
    """Wait for an expression (the page's policy forbids it the eval that
    wait_for_function needs).
    """
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if page.evaluate(expression):
            return
        page.wait_for_timeout(20)
    raise AssertionError(f"never became true: {expression}")


def settle(page: Page) -> None:
    """Wait until the page has been laid out and drawn: its script has run when it is open, but no
    frame has.
    """
    page.evaluate(
        "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() =>"
        " requestAnimationFrame(done))))"
    )


def stays_drawn(page: Page) -> bool:
    """Return whether the picture is still there when its stage has just got another size, before
    the next frame.
    """
    return bool(
        page.evaluate("""new Promise((done) => {
            const stage = document.getElementById("stage"), picture = document.getElementById("picture");
            let times = 0;
            new ResizeObserver(() => {
                times += 1;
                if (times === 1) stage.style.width = "70%";
                else done(picture.getContext("2d").getImageData(0, 0, picture.width, picture.height).data.some((x) => x));
            }).observe(stage);
        })""")
    )
