"""Chromium, and a function that opens an episode in the player."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, sync_playwright

from shoal.views.player import render

OpenPlayer = Callable[..., Page]
ARGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Browser tests come last: while Playwright is open, asyncio.run() fails in every other test."""
    items.sort(key=lambda item: item.get_closest_marker("browser") is not None)


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """The browser: the one of the system, or else Playwright's own."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGS)
        yield browser
        browser.close()


class Visitor:
    """Opens files in pages, and notes what the pages ask for and write to the console."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser
        self.requests: list[str] = []
        self.messages: list[str] = []
        self.contexts: list[BrowserContext] = []
        self.plain = self.page()  # serves every test that needs no special context: a new one costs 0.4 s

    def page(self, **options: Any) -> Page:
        context = self.browser.new_context(**{"viewport": {"width": 1280, "height": 800}, **options})
        self.contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(5000)
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("console", lambda message: self.messages.append(message.text))
        page.on("pageerror", lambda error: self.messages.append(str(error)))
        return page


@pytest.fixture(scope="session")
def visitor(chromium: Browser) -> Iterator[Visitor]:
    """One visitor for all tests."""
    visitor = Visitor(chromium)
    yield visitor
    visitor.plain.context.close()


@pytest.fixture
def open_player(visitor: Visitor, tmp_path: Path) -> Iterator[OpenPlayer]:
    """Open an episode, its data or the text of its page. That may load nothing else and must leave the console empty."""
    files: list[str] = []
    visitor.requests.clear()
    visitor.messages.clear()

    def open_(data: dict[str, object] | str, **options: Any) -> Page:
        file = tmp_path / f"player-{len(files)}.html"
        file.write_text(data if isinstance(data, str) else render("swarm", data), encoding="utf-8")
        files.append(file.as_uri())
        page = visitor.page(**options) if options else visitor.plain
        page.mouse.move(0, 0)
        page.goto(files[-1])
        return page

    yield open_
    for context in visitor.contexts[1:]:
        context.close()
    del visitor.contexts[1:]
    assert [url for url in visitor.requests if not url.startswith("data:")] == files
    assert visitor.messages == []
